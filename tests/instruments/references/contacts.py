"""Beams and bodies in contact: closed forms and shooting solutions, without finite elements.

Beams are thin and inextensible where no stiffnesses are asked for: theta' = kappa_0 + M/EI along the arclength s
(the elastica). Without friction an obstacle pushes along its normal alone. Where such a beam lies on an obstacle it
has the obstacle's curvature, a constant moment and so no shear force; the shear force jumps where it lifts off, which
takes a concentrated force there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from instruments.references.statics import Array, Beam, march, shoot

# ---------------------------------------------------------------------- a strip over a drum


@dataclass(frozen=True)
class Wrapped:
    """A strip on a drum: the angle at which it lifts off, its tip, and the drum's pressure and force at lift-off."""

    angle: float
    tip: Array
    pressure: float
    point: float


def strip_on_drum(EI: float, length: float, radius: float, force: float) -> Wrapped:
    """Return the shape of a strip that is clamped on top of a drum, along x, with a dead force down at its tip.

    ``radius`` is that of the strip's axis on the drum. It lies on the drum up to the angle where EI/radius is the
    moment of the force, EI/(2 radius^2) = force (sin(tip) - sin(angle)), with tension force * sin(angle) and shear
    force * cos(angle) beyond, which are pressure * radius and the concentrated force.
    """
    def tip_angle(angle: float) -> float:
        return math.asin(min(math.sin(angle) + EI / (2.0 * radius**2 * force), 1.0))

    def free(angle: float, f: Callable[[float], float]) -> float:
        end = tip_angle(angle)
        def g(u: float) -> float:
            # theta = end - u^2: sin(end) - sin(theta) over u^2
            half = 0.5 * u * u
            slope = math.cos(end - half) * (math.sin(half) / half if half > 0.0 else 1.0)
            return 2.0 * f(end - u * u) / math.sqrt(2.0 * force / EI * slope)
        return quad(g, 0.0, math.sqrt(end - angle), epsabs=1e-13, epsrel=1e-13)[0]

    def excess(angle: float) -> float:
        return radius * angle + free(angle, lambda _: 1.0) - length

    if excess(0.0) > 0.0:
        raise ValueError("the strip does not touch the drum beyond its clamp")
    # up to where the tip hangs straight down
    steepest = math.asin(max(1.0 - EI / (2.0 * radius**2 * force), 0.0)) - 1e-12
    angle = brentq(excess, 0.0, steepest, xtol=1e-15)
    x = radius * math.sin(angle) + free(angle, math.cos)
    y = -radius * (1.0 - math.cos(angle)) - free(angle, math.sin)
    return Wrapped(angle, np.array([x, y]), force * math.sin(angle) / radius, force * math.cos(angle))


def strip_at_drum(beam: Beam, length: float, center: tuple[float, float], radius: float, force: float,
                  guess: tuple[float, float, float]) -> tuple[Array, float, float]:
    """Return (tip x, y, theta), the place s and the force of the contact of a clamped strip along x with a drum below.

    A dead force pulls the tip down; the strip touches the drum, of that radius to its axis, at one point. ``guess``: of
    the moment at the clamp times length/EI, s/length and the contact force over ``force``. Valid while the curvature
    at the contact does not exceed that of the drum.
    """
    def states(q: Array) -> tuple[Array, Array]:
        down = np.array([0.0, -force])
        n = normal(q)
        touch = march(beam, [0.0, 0.0, 0.0, q[0] * beam.EI / length], down + q[2] * force * n, q[1] * length)
        return touch, march(beam, touch, down, (1.0 - q[1]) * length)

    def normal(q: Array) -> Array:
        # the direction of the contact force: from the drum's centre, by the angle that the contact turns out to have
        return np.array([-math.sin(q[3]), math.cos(q[3])])

    def residual(q: Array) -> Array:
        touch, end = states(q)
        at = np.array(center) + radius * normal(q)
        return np.array([touch[0] - at[0], touch[1] - at[1], (touch[2] - q[3]) * length,
                         end[3] * length**2 / beam.EI]) / length

    q = shoot(residual, [*guess, 0.0])
    touch, end = states(q)
    if -touch[3] / beam.EI * radius > 1.0 + 1e-9:
        raise ValueError("the strip lies on the drum along a line")
    return end[:3], float(q[1] * length), float(q[2] * force)


# ---------------------------------------------------------------------- rings, supports, walls, floors

# integrals of sin(theta)^(-1/2) and sin(theta)^(1/2) from 0 to pi/2
QUARTER_LENGTH = 2.6220575542921198
QUARTER_HEIGHT = 1.1981402347355923


def ring_flattens(EI: float, radius: float) -> float:
    """Return the force at which a thin ring between two flat plates begins to flatten."""
    return EI * (2.0 * QUARTER_LENGTH / (math.pi * radius)) ** 2


def ring_between_plates(EI: float, radius: float, force: float) -> tuple[float, float]:
    """Return the distance of two flat plates pressed onto a thin ring by a force, and the flat length.

    A quarter of the ring carries force/2 without a horizontal force: EI kappa^2/2 = EI kappa_0^2/2 + force/2
    sin(theta), kappa_0 at the plate, where it is positive at a point contact and 0 where the ring lies flat.
    """
    k = force / EI
    if force >= ring_flattens(EI, radius):
        flat = 0.5 * math.pi * radius - QUARTER_LENGTH / math.sqrt(k)
        return 2.0 * QUARTER_HEIGHT / math.sqrt(k), 2.0 * flat

    def quarter(kappa_0: float, f: Callable[[float], float]) -> float:
        # theta = u^2: the integrand is steep at small kappa_0
        def g(u: float) -> float:
            return 2.0 * u * f(u * u) / math.sqrt(kappa_0**2 + k * math.sin(u * u))
        return quad(g, 0.0, math.sqrt(0.5 * math.pi), epsabs=1e-13, epsrel=1e-13, limit=500)[0]

    kappa_0 = brentq(lambda c: quarter(c, lambda _: 1.0) - 0.5 * math.pi * radius, 1e-12 / radius, 2.0 / radius,
                     xtol=1e-15)
    return 2.0 * quarter(kappa_0, math.sin), 0.0


def on_knife_edges(EI: float, half_span: float, angle: float, radius: float = 0.0) -> tuple[float, float]:
    """Return the force at the middle and the sag of a thin beam that slides on two round supports without friction.

    ``angle`` is the slope of the beam at the supports, 0 to pi/2; ``radius`` of the supports is that to the beam's
    axis, and their centres are half_span from the middle. The reaction R of one support stands normal to the beam:
    EI kappa^2/2 = R sin(angle - theta), force = 2 R cos(angle).
    """
    def along(f: Callable[[float], float]) -> float:
        def g(u: float) -> float:
            ratio = math.sin(u * u) / (u * u) if u > 0.0 else 1.0
            return 2.0 * f(angle - u * u) / math.sqrt(2.0 * ratio)
        return quad(g, 0.0, math.sqrt(angle), epsabs=1e-13, epsrel=1e-13)[0]

    span = half_span - radius * math.sin(angle)
    scale = along(math.cos) / span
    sag = along(math.sin) / scale + radius * (1.0 - math.cos(angle))
    return 2.0 * EI * scale**2 * math.cos(angle), sag


def most_on_knife_edges(EI: float, half_span: float) -> tuple[float, float]:
    """Return the largest force that a thin beam on knife edges can carry, and its sag there."""
    low, high = 0.2, 1.4
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    for _ in range(90):
        a, b = high - golden * (high - low), low + golden * (high - low)
        if on_knife_edges(EI, half_span, a)[0] > on_knife_edges(EI, half_span, b)[0]:
            high = b
        else:
            low = a
    return on_knife_edges(EI, half_span, 0.5 * (low + high))


def lifted_from_floor(EI: float, weight: float, height: float) -> tuple[float, float]:
    """Return the length that a heavy beam lifts off a floor, and the force, for a small rise of one end.

    ``weight`` is that per length. At the lift-off nothing bends the beam: weight length^4/24 EI = height, force =
    weight length/2.
    """
    length = (24.0 * EI * height / weight) ** 0.25
    return length, 0.5 * weight * length


def lifted_far(EI: float, weight: float, force: float) -> tuple[float, Array]:
    """Return the length that lifts off a frictionless floor, and (x, y, theta) of the end, at large rotations.

    (x, y) from the lift-off; the end is pulled straight up. From the lift-off on, M'= -V cos(theta) where V = force -
    weight * (length beyond), which vanishes there in the mean as in ``lifted_from_floor``.
    """
    from scipy.integrate import solve_ivp

    def end(length: float) -> Array:
        def rate(s: float, z: Array) -> list[float]:
            lever = force - weight * (length - s)
            return [math.cos(z[2]), math.sin(z[2]), z[3] / EI, -lever * math.cos(z[2])]
        return solve_ivp(rate, (0.0, length), [0.0, 0.0, 0.0, 0.0], method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]

    length = 2.0 * force / weight
    found = brentq(lambda a: end(a)[3], 0.7 * length, 1.3 * length, xtol=1e-14)
    return found, end(found)[:3]


def between_walls(EI: float, length: float, gap: float, force: float) -> tuple[str, float]:
    """Return the stage of a thin clamped beam between walls at a distance ``gap``, and its end shortening.

    For small slopes (Domokos, Holmes & Royce 1997). With l = 2 pi sqrt(EI/force): straight while
    length < l, then one wave of height gap that touches the wall at a point until length = 2 l, and lies on it between
    two pieces of length l until the flat part buckles in turn, at length = 3 l.
    """
    wave = 2.0 * math.pi * math.sqrt(EI / force)
    if length < wave:
        return "straight", 0.0
    if length <= 2.0 * wave:
        return "point", 2.0 * _half_wave(0.5 * length, gap, math.sqrt(force / EI))
    if length <= 3.0 * wave:
        # from wall to wall by gap: w = gap (s/l - sin(2 pi s/l)/2 pi), of which (w')^2/2 is 3 gap^2/4 l in all
        return "line", 2.0 * 0.75 * gap**2 / wave
    return "buckled again", math.nan


def _half_wave(a: float, gap: float, k: float) -> float:
    """Return the shortening of w = A (1 - cos kx) + B (kx - sin kx), w(a) = gap, w'(a) = 0."""
    c, s = math.cos(k * a), math.sin(k * a)
    A, B = np.linalg.solve([[1.0 - c, k * a - s], [s, 1.0 - c]], [gap, 0.0])
    return quad(lambda x: 0.5 * (k * (A * math.sin(k * x) + B * (1.0 - math.cos(k * x)))) ** 2, 0.0, a,
                epsabs=1e-15, epsrel=1e-13)[0]


# ---------------------------------------------------------------------- friction


def capstan(tension: float, mu: float, angle: float) -> float:
    """Return the force that ``tension`` can hold by a rope on a drum over an angle of contact (Euler)."""
    return tension * math.exp(mu * angle)


def on_incline(angle: float, mu: float, g: float, t: float) -> float:
    """Return the distance that a block has slid from rest down a slope."""
    return 0.5 * max(math.sin(angle) - mu * math.cos(angle), 0.0) * g * t * t


def rolls_down(angle: float, mu: float, g: float, t: float, inertia: float) -> tuple[float, float]:
    """Return the distance of a disc rolling down a slope from rest, and its rotation [rad] times its radius.

    ``inertia`` is that over mass and radius squared: 1/2 of a disc, 1 of a ring. It rolls while tan(angle) <=
    mu (1 + 1/inertia), and else slides, too.
    """
    if math.tan(angle) <= mu * (1.0 + 1.0 / inertia):
        s = 0.5 * g * math.sin(angle) / (1.0 + inertia) * t * t
        return s, s
    return on_incline(angle, mu, g, t), 0.5 * mu * g * math.cos(angle) / inertia * t * t


def bowled(v: float, mu: float, g: float, inertia: float) -> tuple[float, float]:
    """Return when a disc that starts sliding without rotation begins to roll, and its velocity from then on."""
    rolling = v / (1.0 + inertia)
    return (v - rolling) / (mu * g), rolling


# ---------------------------------------------------------------------- impacts


def bar_against_wall(EA: float, rhoA: float, length: float, v: float) -> tuple[float, float, float]:
    """Return duration, force and velocity after the impact of an elastic bar on a rigid wall (St Venant).

    A wave of the stress EA v/c runs to the far end and back: 2 length/c with c = sqrt(EA/rhoA). All of the bar then has
    the velocity -v.
    """
    c = math.sqrt(EA / rhoA)
    return 2.0 * length / c, EA * v / c, -v


def bar_against_layer(EA: float, rhoA: float, length: float, v: float, stiffness: float, t: float
                      ) -> tuple[float, float]:
    """Return force and impulse of an elastic layer before a wall on a bar, at a time t after first touch.

    With y = force/(Z v), Z = EA/c, tau = Z/stiffness and s = t/tau, the end moves by the wave that comes in less y:
    y' = 1 - y during one passage of the bar and back, and y' = 1 - y - 2 y(t - 2 length/c) thereafter (d'Alembert),
    until y = 0: 2 (1 + s) exp(-s) = 1 beyond the passage where that is long beside tau.
    """
    c = math.sqrt(EA / rhoA)
    Z, passage = EA / c, 2.0 * length / c
    tau = Z / stiffness
    first = min(max(t, 0.0), passage) / tau
    force, impulse = 1.0 - math.exp(-first), first - 1.0 + math.exp(-first)
    if t > passage:
        end = force
        def later(s: float) -> float:
            return -1.0 + (end + 1.0) * math.exp(-s) + 2.0 * s * math.exp(-s)
        s = min((t - passage) / tau, brentq(later, 0.5, 3.0, xtol=1e-15))
        force = max(later(s), 0.0)
        impulse += -s + (end + 1.0) * (1.0 - math.exp(-s)) + 2.0 * (1.0 - math.exp(-s) * (1.0 + s))
    return Z * v * force, Z * v * tau * impulse


def far_end_of_bar(EA: float, rhoA: float, length: float, v: float, t: float) -> float:
    """Return the displacement towards the wall of the far end of that bar at a time t after its first touch."""
    passage = length / math.sqrt(EA / rhoA)
    return v * t if t <= passage else v * (2.0 * passage - t)


def bounces(height: float, restitution: float, g: float, count: int) -> tuple[list[float], list[float]]:
    """Return the times of the first impacts of a body dropped from a height, and its height after each."""
    t = math.sqrt(2.0 * height / g)
    times, heights, speed = [t], [], g * t
    for _ in range(count):
        speed *= restitution
        heights.append(speed**2 / (2.0 * g))
        times.append(times[-1] + 2.0 * speed / g)
    return times, heights


def struck_with_friction(mass: float, inertia: float, arm: Array, motion: Array, friction: float, restitution: float
                         ) -> Array:
    """Return (vx, vy, omega) of a rigid body after an impact on a floor along x, from those before it.

    ``arm`` (2,) leads from its centre of mass to the point that hits. The impulse across the floor gives its velocity
    there back times ``restitution``; that of friction stops the point, or is Coulomb's limit against its way behind the
    impact (Routh, Dynamics of a System of Rigid Bodies, 1905, chapter 5; Glocker, Set-Valued Force Laws, 2001).
    """
    jacobian = np.array([[1.0, 0.0, -arm[1]], [0.0, 1.0, arm[0]]])
    given = np.linalg.solve(np.diag([mass, mass, inertia]), jacobian.T)
    answer, before = jacobian @ given, jacobian @ motion
    wanted = -(1.0 + restitution) * before[1]
    impulse = np.linalg.solve(answer, np.array([-before[0], wanted]))
    if abs(impulse[0]) > friction * impulse[1]:
        share = np.array([math.copysign(friction, impulse[0]), 1.0])
        impulse = share * wanted / float(answer[1] @ share)
    out: Array = motion + given @ impulse
    return out


def struck_rod(mass: float, inertia: float, arm: float, v: float, restitution: float) -> tuple[float, float, float]:
    """Return (velocity, rate of rotation, impulse) after a rod that falls flat with v hits a stop.

    The stop is at ``arm`` to the right of its middle. Velocities are upwards and counter-clockwise: v' = -v + p/m,
    omega' = p arm/I, and the point that hits leaves with restitution * v.
    """
    p = (1.0 + restitution) * v / (1.0 / mass + arm**2 / inertia)
    return -v + p / mass, p * arm / inertia, p
