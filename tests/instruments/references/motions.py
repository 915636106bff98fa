"""The motions that ``cases/dynamic`` expects, by spectral elements (see spectral_bars), independent of ancf2d."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from instruments.references.spectral_bars import Array, Bar, Crank, Mechanism, Section, hold, pin, rectangle

# Sec. 5.5 of the paper; the size of the follower force is not printed
CRANK, ROD, FORCE = 0.15, 0.3, 0.5


def pendulum(section: Section, length: float, times: Sequence[float], count: int, h: float) -> Array:
    """Return the tip (times, 2) of a bar that falls from the horizontal about its pin."""
    model = Mechanism([Bar(section, (0, 0), (length, 0), count, 6)], held=hold(0, 0))
    return model.point(model.move(times, h), 0, 1)


def pendulum_1(times: Sequence[float], count: int = 2, h: float = 1e-3) -> Array:
    """Return the tip of the paper's first pendulum."""
    return pendulum(rectangle(2.07e11, 0.3, 2766.67, 0.008, 0.03125), 1.8, times, count, h)


def pendulum_1_euler_bernoulli(times: Sequence[float], count: int = 2, h: float = 1e-3) -> Array:
    """Return the tip of the paper's first pendulum with negligible shear strain and rotary inertia."""
    section = rectangle(2.07e11, 0.3, 2766.67, 0.008, 0.03125)
    return pendulum(replace(section, kGA=1e3 * section.kGA, rhoI=1e-3 * section.rhoI), 1.8, times, count, h)


def pendulum_2(times: Sequence[float], count: int = 8, h: float = 1.25e-3) -> Array:
    """Return the tip of the paper's second pendulum, shear factor 5/6."""
    return pendulum(rectangle(7e5, 0.3, 5540, 0.253, 0.006335, 5 / 6), 1.2, times, count, h)


def double_pendulum(times: Sequence[float], count: int = 3, h: float = 2.5e-3) -> Array:
    """Return (elbow x, y, tip x, y) of two soft bars, pinned together, that fall from the horizontal."""
    section = rectangle(2e8, 0.3, 1200, 0.02, 0.02)
    bars = [Bar(section, (0, 0), (1, 0), count, 6), Bar(section, (1, 0), (2, 0), count, 6)]
    model = Mechanism(bars, held=hold(0, 0), ties=pin((0, -1), (1, 0)))
    x = model.move(times, h)
    return np.concatenate([model.point(x, 0, 1), model.point(x, 1, 1)], axis=1)


def slider_crank(times: Sequence[float], count: int = 2, h: float = 1e-3) -> Array:
    """Return the middle of the rod (times, 2) of Sec. 5.5, the crank elastic."""
    crank = Bar(rectangle(1e11, 0.3, 2770, 0.0053, 0.0053), (0, 0), (CRANK, 0), 1, 6)
    rod = Bar(rectangle(5e8, 0.3, 2770, 0.0053, 0.0053), (CRANK, 0), (CRANK + ROD, 0), count, 6)

    def force(x: Array, angle: Array, t: float) -> tuple[Array, Array]:
        f, theta = np.zeros(len(x)), x[model.index((0, "theta", -1))]
        f[model.index((0, "x", -1))], f[model.index((0, "y", -1))] = -FORCE * math.sin(theta), FORCE * math.cos(theta)
        return f, angle

    model = Mechanism([crank, rod], held=hold(0, 0) + hold(1, -1, "y"), ties=pin((0, -1), (1, 0)), gravity=0.0,
                      force=force)
    return model.point(model.move(times, h), 1, 0.5)


def slider_crank_rigid(times: Sequence[float], count: int = 2, h: float = 1e-3) -> Array:
    """Return the middle of the rod (times, 2), the crank rigid."""
    s = rectangle(1e11, 0.3, 2770, 0.0053, 0.0053)
    crank = Crank((0, 0), CRANK, 0.0, s.rhoA * CRANK**3 / 3 + s.rhoI * CRANK)
    rod = Bar(rectangle(5e8, 0.3, 2770, 0.0053, 0.0053), (CRANK, 0), (CRANK + ROD, 0), count, 6)
    model = Mechanism([rod], [crank], held=hold(0, -1, "y"), led=[((0, "x", 0), (0, "y", 0), 0)], gravity=0.0,
                      force=lambda x, angle, t: (np.zeros(len(x)), np.array([FORCE * CRANK])))
    return model.point(model.move(times, h), 0, 0.5)


def spin(t: float, omega: float, T: float, start: float = 0.0) -> tuple[float, float, float]:
    """Return angle, rate and acceleration of Simo & Vu-Quoc's smooth start: at ``T`` it turns with ``omega``."""
    if t >= T:
        return start + omega * (t - T / 2), omega, 0.0
    z = 2 * math.pi * t / T
    return (start + omega / T * (t * t / 2 + (T / (2 * math.pi))**2 * (math.cos(z) - 1)),
            omega / T * (t - T / (2 * math.pi) * math.sin(z)), omega / T * (1 - math.cos(z)))


def four_bar(times: Sequence[float], count: int = 2, h: float = 1e-3) -> Array:
    """Return the middle of the coupler (times, 2): rigid crank driven up to 30 rad/s in 0.1 s, rigid rocker."""
    coupler, arm = rectangle(7e10, 0.3, 2700, 0.001, 0.02), rectangle(7e10, 0.3, 2700, 0.01, 0.02)
    A, B, foot = (0, 0.1), (0.3, 0.2), (0.3, 0)
    cranks = [Crank((0, 0), 0.1, math.pi / 2, arm.rhoA * 0.1**3 / 3 + arm.rhoI * 0.1, arm.rhoA * 0.1**2 / 2),
              Crank(foot, 0.2, math.pi / 2, arm.rhoA * 0.2**3 / 3 + arm.rhoI * 0.2, arm.rhoA * 0.2**2 / 2)]
    model = Mechanism([Bar(coupler, A, B, count, 6)], cranks, led=[((0, "x", 0), (0, "y", 0), 0),
                      ((0, "x", -1), (0, "y", -1), 1)], drive=lambda t: spin(t, 30, 0.1, math.pi / 2))
    return model.point(model.move(times, h), 0, 0.5)


def spin_up(times: Sequence[float], count: int = 2, h: float = 0.01) -> Array:
    """Return the tip (times, 2) of Simo & Vu-Quoc's spin-up manoeuvre in the frame that turns with the hub."""
    model = Mechanism([Bar(Section(2.8e7, 1e7, 1.4e4, 1.2, 6e-4), (0, 0), (10, 0), count, 6)],
                      [Crank((0, 0), 1, 0.0, 1.0)], held=hold(0, 0), turned=[((0, "theta", 0), 0)], gravity=0.0,
                      drive=lambda t: spin(t, 6, 15))
    tip = model.point(model.move(times, h), 0, 1)
    angle = np.array([spin(t, 6, 15)[0] for t in times])
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * tip[:, 0] + s * tip[:, 1], c * tip[:, 1] - s * tip[:, 0]], axis=1)


def free_rod(times: Sequence[float], count: int = 3, h: float = 0.01) -> Array:
    """Return (lower end x, y, upper end x, y) of a free rod, pushed and turned at its lower end until t = 5."""
    model = Mechanism([Bar(Section(1e4, 1e4, 500, 1, 0.05), (6, 0), (0, 8), count, 6)], gravity=0.0)

    def force(x: Array, angle: Array, t: float) -> tuple[Array, Array]:
        f, size = np.zeros(len(x)), max(0.0, 1 - abs(t / 2.5 - 1))
        f[model.index((0, "x", 0))], f[model.index((0, "theta", 0))] = 8 * size, -80 * size
        return f, angle

    model.force = force
    x = model.move(times, h)
    return np.concatenate([model.point(x, 0, 0), model.point(x, 0, 1)], axis=1)


MOTIONS: dict[str, Callable[..., Array]] = {
    f.__name__: f for f in (pendulum_1, pendulum_1_euler_bernoulli, pendulum_2, double_pendulum, slider_crank,
                            slider_crank_rigid, four_bar, spin_up, free_rod)}
