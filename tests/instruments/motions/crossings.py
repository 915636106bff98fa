"""Forces and masses that cross a simply supported beam, compared with series: largest deflection, and when.

The beam has unit length, bending stiffness and mass per length. At the critical speed, pi, a crossing takes half the
period of the first mode.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import ancf2d
from scripts.pages import small, table

Array = NDArray[np.float64]
CRITICAL = math.pi
SPEEDS = (0.1, 0.3, 0.5, 0.617, 0.8, 1.0, 1.5, 2.0)
MASSES = ((0.2, 0.5), (0.6, 1.0), (1.0, 0.5), (2.0, 0.5))


def bridge(speed: float, count: int = 12, tolerance: float = 1e-6, **more: Any) -> dict[str, Any]:
    """Return the case of a slender beam that is crossed at a given share of the critical speed."""
    return {"bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                                "section": {"EA": 1e4, "kGA": 1e6, "EI": 1, "rhoA": 1, "rhoI": 0},
                                "element": {"type": "cable", "count": count}}},
            "boundary_conditions": [{"type": "pin", "at": "beam@0"}, {"type": "roller", "at": "beam@1", "fixed": "y"}],
            "solver": {"type": "dynamic", "t_end": 1.0 / (speed * CRITICAL), "tolerance": tolerance, "estimate": False},
            "output": {"probes": {"mid": "beam@0.5"}, "interval": 1.0 / (speed * CRITICAL) / 200}, **more}


def along(speed: float) -> dict[str, Any]:
    """Return the position of the load on the beam."""
    return {"on": "beam", "s": {"type": "expression", "value": f"{speed * CRITICAL!r}*t"}}


def under_force(speed: float, force: float, count: int = 20) -> dict[str, Any]:
    """Return the case of a force [N] that crosses the beam."""
    return bridge(speed, count, loads=[{"type": "force", "at": along(speed), "value": [0, force]}])


def under_mass(speed: float, mass: float, g: float, count: int = 16) -> dict[str, Any]:
    """Return the case of a mass [kg] that crosses the beam; the weight of the beam is left out."""
    return bridge(speed, count, masses=[{"at": along(speed), "mass": mass}],
                  loads=[{"type": "gravity", "value": [0, -g]}, {"type": "distributed", "on": "beam", "value": [0, g]}])


def moving_force(speed: float, x: float, t: Array, force: float, modes: int = 60) -> Array:
    """Return the deflection at x under a force that crosses the beam (Timoshenko; Fryba 1972, Eq. 1.31)."""
    out = np.zeros_like(t)
    v = speed * CRITICAL
    for j in range(1, modes + 1):
        w, drive = (j * math.pi) ** 2, j * math.pi * v
        q = ((np.sin(drive * t) - drive / w * np.sin(w * t)) / (w * w - drive * drive) if abs(drive - w) > 1e-9 * w
             else (np.sin(w * t) - w * t * np.cos(w * t)) / (2 * w * w))
        out += 2.0 * force * q * math.sin(j * math.pi * x)
    return out


def moving_mass(speed: float, mass: float, t: Array, modes: int = 8) -> Array:
    """Return the deflection of the middle, for g = 1, under a crossing mass: M q'' + C q' + K q = m g, by modes."""
    v, k = speed * CRITICAL, math.pi * np.arange(1, modes + 1)

    def rates(t: float, y: Array) -> Array:
        q, dq = y[:modes], y[modes:]
        s, c = np.sin(k * v * t), k * np.cos(k * v * t)
        M = 0.5 * np.eye(modes) + mass * np.outer(s, s)
        f = -mass * s - 0.5 * k**4 * q - 2 * mass * v * s * (c @ dq) + mass * v * v * s * ((k * k * s) @ q)
        return np.concatenate([dq, np.linalg.solve(M, f)])
    y = solve_ivp(rates, (0, t[-1]), np.zeros(2 * modes), "DOP853", t, rtol=1e-8, atol=1e-11).y
    return np.asarray(np.sin(k * 0.5) @ y[:modes])


def peak(t: Array, deflection: Array, static: float) -> tuple[float, float]:
    """Return the largest deflection over the static one, and the share of the crossing at which it occurs."""
    k = int(np.argmax(deflection / static))
    factor, at = float(deflection[k] / static), float(t[k])
    if 0 < k < len(t) - 1:
        # the parabola through the three highest values
        a, b, c = (deflection[k - 1:k + 2] / static).tolist()
        shift = 0.5 * (a - c) / (a - 2 * b + c)
        factor, at = b - 0.25 * (a - c) * shift, at + shift * float(t[1] - t[0])
    return factor, at / float(t[-1])


def first_term(speed: float) -> float:
    """Return the peak factor of the first term of the series for forces, if it occurs during the crossing."""
    a = speed
    if a == 1.0:
        return 0.5 * math.pi * 96 / math.pi**4
    t = np.linspace(0.0, math.pi / a, 100001)
    return float(np.max((np.sin(a * t) - a * np.sin(t)) / (1 - a * a))) * 96 / math.pi**4


def report() -> str:
    """Return the table of peak factors."""
    rows = []
    force = -1e-3
    for speed in SPEEDS:
        solved = ancf2d.solve(under_force(speed, force))
        t, found = solved.course_t, solved.course["mid"]["uy"]
        wanted = moving_force(speed, 0.5, t, force)
        rows.append(row(["force", f"{speed:g}", f"{first_term(speed):.4f}"], t, wanted, found, force / 48))
    for speed, mass in MASSES:
        solved = ancf2d.solve(under_mass(speed, mass, 1e-3))
        t, found = solved.course_t, solved.course["mid"]["uy"]
        wanted = 1e-3 * moving_mass(speed, mass, t, 40)
        rows.append(row([f"mass, {mass:g} of the beam's", f"{speed:g}", ""], t, wanted, found, -1e-3 * mass / 48))
    return table(["load", "v/critical speed", "first term alone", "peak factor: series", "ancf2d",
                  "place S of the load at the peak: series", "ancf2d", "largest difference over time"], rows)


def row(head: list[str], t: Array, wanted: Array, found: Array, static: float) -> list[str]:
    """Return a row of the table: peaks, positions, and the difference of the curves over the largest deflection."""
    (factor, at), (ours, ours_at) = (peak(t, y, static) for y in (wanted, found))
    off = float(np.abs(found - wanted).max() / np.abs(wanted).max())
    return [*head, f"{factor:.4f}", f"{ours:.4f}", f"{at:.3f}", f"{ours_at:.3f}", small(off)]
