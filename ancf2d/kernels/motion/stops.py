"""Where in a step springs that act on one side alone, or from a gap on, begin or cease to act: steps end there."""

from __future__ import annotations

from typing import Any

from .. import calls
from ..lowlevel.arrays import vector
from ..lowlevel.jit import addressed, inner, kernel, seldom
from ..moving import place_moving
from ..points import evaluate_item, work_arrays
from .dynamics import signals_at, to_full
from .events import BEYOND, LOOKS, NOWHERE, interpolate
from .state import OLD_STEP

# of a step: how near to its end a spring begins to act for the step to end there, and how near to its start where the
# step before has ended there; how often it is aimed at; how often an interval is halved
ENDS, BEGINS, TRIES, HALVINGS = 1e-6, 3e-6, 5, 40
# of a step: where a spring begins to act behind this, only half of it is made at first, as the path of a step that does
# not see the spring is wrong
SURE = 0.5
# of a step that ends where a spring begins to act: the next one, as nothing is known yet of how stiff it is
SOFT = 1e-2


@inner
def _tell(p, w, z, v, t, room, out):  # type: ignore[no-untyped-def]
    """Fill 1 for the stops that act at unknowns z with rates v at t, 0 for the others."""
    signals_at(p, t, w.amps)
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    place_moving(p, w.d, w.amps)
    u, rates, a, f, H, C = room
    for k in range(len(p.stops)):
        i = p.stops[k]
        acts = evaluate_item(p.points, i, w.d, w.v, w.amps, u, rates, a, f, H, C)[0] != 0.0
        for j in range(p.points.field[i + 1] - p.points.field[i]):
            acts |= f[j] != 0.0
        out[k] = 1.0 if acts else 0.0


@kernel
@seldom
def acting(p, w, z, v, t, out):  # type: ignore[no-untyped-def]
    """Fill 1 for the stops (k,) that act at unknowns z with rates v at t, 0 for the others."""
    _tell(p, w, z, v, t, work_arrays(p.points), out)


@inner
def _acts(p, w, s, m, at, t, h, x, room, out):  # type: ignore[no-untyped-def]
    """Fill 1 for the stops that act at the fraction x of the step from s at t to m.end, 0 for the others."""
    interpolate(m, p, s, h, x, at.z, at.v, at.a)
    _tell(p, w, at.z, at.v, t + x * h, room, out)


@addressed
@seldom
def stop_crossing(p, w, s, m, at, t, h, beyond):  # type: ignore[no-untyped-def]
    """Return (fraction, begins): up to 1 + ``beyond`` of the step from s at t, where a spring begins or ceases to act.

    NOWHERE where none does. Where the step before has ended there, it is not found again.
    """
    n = len(p.stops)
    room = work_arrays(p.points)
    before, now, middle = vector(n), vector(n), vector(n)
    _acts(p, w, s, m, at, t, h, 0.0, room, before)
    first, begins, low = NOWHERE, False, 0.0
    near = BEGINS * max(1.0, s.numbers[OLD_STEP] / h)
    for place in range(1, LOOKS + (2 if beyond > 0.0 else 1)):
        x = min(place / LOOKS, 1.0 + beyond)
        _acts(p, w, s, m, at, t, h, x, room, now)
        for k in range(n):
            if now[k] == before[k]:
                continue
            left, right = low, x
            for _ in range(HALVINGS):
                half = 0.5 * (left + right)
                _acts(p, w, s, m, at, t, h, half, room, middle)
                if middle[k] == before[k]:
                    left = half
                else:
                    right = half
            if right <= near:
                before[k] = now[k]
            elif right < first:
                first, begins = right, now[k] > 0.0
        if first != NOWHERE:
            break
        low = x
    return first, begins


@inner
def land(m, p, w, s, at, t, h, room, tries):  # type: ignore[no-untyped-def]
    """Return whether a step from t ends where a stop begins or ceases to act or has no such place in it, and else how
    long it has to be; and whether one begins to act where it ends.

    ``room`` is how long it may be, ``tries`` how often that was tried.
    """
    x, begins = calls.stop_crossing(p.calls, (p, w, s, m, at, t, h, BEYOND if tries > 0 else 0.0))
    if x == NOWHERE or (x > 1.0 and (h >= room or tries >= TRIES)):
        return True, h, False
    if abs(x - 1.0) <= ENDS or tries >= TRIES:
        return True, h, begins
    return False, min(x if tries > 0 else min(x, SURE), room / h) * h, begins


def stop_functions(problem: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the functions that the table of a model of this type has where springs act on one side alone."""
    return {calls.stop_crossing: (stop_crossing, problem)}
