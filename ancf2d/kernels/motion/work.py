"""Work of loads and of what is moved, and loss to dampers, over a step."""

from __future__ import annotations

from .. import calls
from ..bodies import set_natural
from ..lowlevel.arrays import copy
from ..lowlevel.jit import addressed, inner, seldom
from .dynamics import lost_to_mass_damping, power_of_loads, signals_at, to_full
from .events import interpolate

# errors of methods of second order are of order 3
SECOND = 3
# Lobatto's points in [0, 1], and their weights
POINTS = (0.0, 0.27639320225002106, 0.7236067977499789, 1.0)
WEIGHTS = (1.0 / 12.0, 5.0 / 12.0, 5.0 / 12.0, 1.0 / 12.0)


@inner
def power(p, w, z, v, a, t):  # type: ignore[no-untyped-def]
    """Return (power of varying loads, motion and point laws, power lost) of a state."""
    signals_at(p, t, w.amps)
    _, lost = calls.forces(p.calls, (p, w, z, v))
    return power_of_loads(p, w, v, a), lost + lost_to_mass_damping(p, w, v)


@inner
def recall(m, p, h, x):  # type: ignore[no-untyped-def]
    """Let materials that relax be as they are at the fraction x of the step."""
    if len(p.clocks) > 0:
        calls.inside(m.calls, (p, m.own, h, x))


@inner
def _lost_on_the_way(m, p, w, s, at, t, h, end):  # type: ignore[no-untyped-def]
    """Return the mean power lost up to the fraction ``end`` of a step of a method of second order.

    A dashpot takes its mean force along the way that is moved, c (v_0 + v_1)/2 dz: by differences of the power about
    the mean rate dz/h. What dies out within the step, as behind an impact, begins fast, but moves little.
    """
    interpolate(m, p, s, h, end, at.z, at.v, at.a)
    for i in range(len(s.z)):
        w.R[i] = p.coordinate[i] * (at.z[i] - s.z[i]) / (end * h)
        w.y[i] = 0.5 * (0.5 * (s.v[i] + at.v[i]) - w.R[i]) * p.coordinate[i]
    interpolate(m, p, s, h, 0.5 * end, at.z, at.v, at.a)
    copy(w.y, at.a)
    recall(m, p, h, 0.5 * end)
    signals_at(p, t + 0.5 * end * h, w.amps)
    lost = 0.0
    for k in range(3):
        side, share = (0.0, 1.0, -1.0)[k], (1.0, 0.5, -0.5)[k]
        for i in range(len(s.z)):
            at.v[i] = w.R[i] + side * at.a[i]
        _, dampers = calls.forces(p.calls, (p, w, at.z, at.v))
        lost += share * (dampers + lost_to_mass_damping(p, w, at.v))
    return lost


@inner
def taken_inside(m, p, w, s, at, t, h, end):  # type: ignore[no-untyped-def]
    """Return what internal strains that are solved at stages take up to the fraction ``end`` of the step."""
    lost = 0.0
    if len(p.clocks) > 0 and m.order > SECOND:
        for k in range(4):
            interpolate(m, p, s, h, end * POINTS[k], at.z, at.v, at.a)
            signals_at(p, t + end * POINTS[k] * h, w.amps)
            to_full(p, at.z, w.amps, 0, w.d)
            set_natural(p, w.amps, w.amps)
            lost += end * WEIGHTS[k] * calls.taken(m.calls, (p, w, m.own, end * POINTS[k]))
    return lost


@addressed
@seldom
def work(p, w, s, m, at, t, h, end):  # type: ignore[no-untyped-def]
    """Return (work, loss) up to the fraction ``end`` of the step, from its interpolation.

    By two Gauss points for methods of second order, by four of Lobatto for others. What dampers take in a step of
    second order is their mean force times the way that they move.
    """
    done, lost, low = 0.0, 0.0, m.order <= SECOND
    for k in range(2 if low else 4):
        x = end * ((0.21132486540518713, 0.7886751345948129, 0.0, 0.0) if low else POINTS)[k]
        f = 0.5 if low else WEIGHTS[k]
        interpolate(m, p, s, h, x, at.z, at.v, at.a)
        recall(m, p, h, x)
        one, two = power(p, w, at.z, at.v, at.a, t + x * h)
        done += f * one
        lost += f * two
    if low and lost != 0.0:
        lost = _lost_on_the_way(m, p, w, s, at, t, h, end)
    recall(m, p, h, 0.0)
    return end * h * done, end * h * lost
