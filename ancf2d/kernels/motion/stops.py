"""Where in a step what acts on one side alone, or from a gap on, begins or ceases to act: steps end there.

These are springs, tendons and contacts with a law. Points of an elastic body that may touch count as one: what matters
is when the first of them begins to act, and when the last of them ceases to. After that errors of steps tell.
"""

from __future__ import annotations

from typing import Any

from .. import calls
from ..curves import is_apart
from ..lowlevel.arrays import vector
from ..lowlevel.jit import addressed, inner, kernel, seldom
from ..moving import place_moving
from ..patches import face_bodies
from ..points import amplitude_of, fields_of_item, law_of_item, rates_of_item, work_arrays
from .dynamics import signals_at, to_full
from .events import LOOKS, NOWHERE, interpolate
from .state import OLD_STEP, SOFT_STEP, STRUCK

# of a step: how near to its end a stop begins or ceases to act for the step to end there, and how near to its start
# where the step before has ended there; how often it is aimed at; how often an interval is halved
ENDS, BEHIND, TRIES, HALVINGS = 1e-6, 3e-6, 5, 40
# of a step that ends in a stop, or behind one that has not been seen: its path is wrong, so what is made at first ends
# before the place where the stop begins, and is half of the step at most; how far behind a step that place is aimed at
BEFORE, SURE, AHEAD = 0.8, 0.5, 1.0
# of a step that ends where a stop begins to act: the next one, as nothing is known yet of how stiff it is
SOFT = 1e-2
# of the longest step: no shorter one is made for this, and what acts within so little is not found. Many points that
# touch shortly after one another would shorten steps until round-off tells whether they act
LEAST = 1e-7
# what stops do where a step ends
STAYS, BEGINS, CEASES, PARTS = range(4)


@inner
def _item_acts(points, i, w, room):  # type: ignore[no-untyped-def]
    """Return whether item i has a force or energy at w.d with rates w.v."""
    u, rates, a, f, H, C = room
    m = points.field[i + 1] - points.field[i]
    rates_of_item(points, i, w.v, rates)
    fields_of_item(points, i, w.d, u)
    amplitude_of(points, i, w.amps, u, rates, a)
    acts = law_of_item(points, i, u, rates, a, f, H, C, m if points.along[i] == 0 else 0)[0] != 0.0
    for j in range(m):
        acts |= f[j] != 0.0
    return acts


@inner
def _tell(p, w, z, v, t, room, out):  # type: ignore[no-untyped-def]
    """Fill 1 for the stops that act at unknowns z with rates v at t, 0 for the others."""
    signals_at(p, t, w.amps)
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    place_moving(p, w.d, w.amps)
    face_bodies(p, w.d)
    for k in range(len(p.stops)):
        i, out[k] = p.stops[k, 0], 0.0
        while i < p.stops[k, 1] and out[k] == 0.0:
            if p.points.along[i] != 0 and p.points.apart[i] > 0.0 and is_apart(p.points, i, w.d):
                i += p.points.run[i]
                continue
            out[k] = 1.0 if _item_acts(p.points, i, w, room) else 0.0
            i += 1


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
def stop_crossing(p, w, s, m, at, t, h, near, beyond):  # type: ignore[no-untyped-def]
    """Return (fraction, what): up to 1 + ``beyond`` of the step from s at t, where a stop BEGINS or CEASES to act.

    PARTS where the last one ceases to.

    NOWHERE where none does. What is ``near`` its start is where the step before has ended, and is not found again.
    """
    n = len(p.stops)
    room = work_arrays(p.points)
    before, now, middle = vector(n), vector(n), vector(n)
    _acts(p, w, s, m, at, t, h, 0.0, room, before)
    first, what, low = NOWHERE, STAYS, 0.0
    for place in range(1, LOOKS + (2 if beyond > 0.0 else 1)):
        x = place / LOOKS if place <= LOOKS else 1.0 + beyond
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
                first, what = right, BEGINS if now[k] > 0.0 else CEASES
        if first != NOWHERE:
            break
        low = x
    if what == CEASES:
        _acts(p, w, s, m, at, t, h, first + near, room, now)
        what = PARTS
        for k in range(n):
            if now[k] > 0.0:
                what = CEASES
    return first, what


@inner
def land(m, p, w, s, at, plan, t, h, room, tries):  # type: ignore[no-untyped-def]
    """Return whether a step from t ends where a stop begins or ceases to act or has no such place in it, and else how
    long it has to be; and what happens where it ends, see ``stop_crossing``: STAYS where nothing does.

    ``room`` is how long it may be, ``tries`` how often that was tried.
    """
    near = max(BEHIND * max(h, s.numbers[OLD_STEP]), LEAST * plan.largest) / h
    x, what = calls.stop_crossing(p.calls, (p, w, s, m, at, t, h, near, AHEAD if tries > 0 else 0.0))
    if x == NOWHERE or (x > 1.0 and (h >= room or tries >= TRIES)):
        return True, h, STAYS
    # a stiff stop holds the end of any implicit step where it begins to act
    if abs(x - 1.0) <= ENDS and (tries > 0 or what != BEGINS):
        return True, h, what
    if tries >= TRIES and what != BEGINS:
        return True, h, what
    if x < 1.0 and (tries == 0 or tries >= TRIES):
        return False, min(BEFORE * x, SURE) * h, STAYS
    return False, min(x, room / h) * h, STAYS


@inner
def leave(m, p, w, s, t, stops):  # type: ignore[no-untyped-def]
    """Let the next step from s at t know nothing of the forces before what ``stops`` do there, if anything.

    Rates that are off the constraints by some h^2, as steps leave them, would be forces in one that is much shorter.
    """
    if stops == STAYS:
        return
    if stops != CEASES:
        s.numbers[STRUCK] = 1.0 if stops == BEGINS else 0.0
    if not m.exact:
        calls.onto_constraints(p.calls, (p, w, s.z, s.v, s.a, t, False))
    calls.restart(m.calls, (s, m.own))


@inner
def soften(s, plan, h, stops, usual):  # type: ignore[no-untyped-def]
    """Return how long the step behind one of length h is, at whose end ``stops`` tells what happens, else ``usual``.

    It is short where one begins to act. Of several that begin one after another, the first tells how short.
    """
    s.numbers[SOFT_STEP] = max(SOFT * h, s.numbers[SOFT_STEP], LEAST * plan.largest) if stops == BEGINS else 0.0
    return usual if s.numbers[SOFT_STEP] == 0.0 else s.numbers[SOFT_STEP]


def stop_functions(problem: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the functions that the table of a model of this type has where it has stops."""
    return {calls.stop_crossing: (stop_crossing, problem)}
