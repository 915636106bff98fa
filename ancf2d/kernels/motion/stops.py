"""Locate where in a step a unilateral spring, a tendon or a compliant contact engages or releases; steps end there.

These laws are called stops. The contact points of an elastic body count as one stop, which engages with its first point
and releases with its last; the error control handles changes in between.
"""

from __future__ import annotations

from typing import Any

from .. import calls
from ..facing import EVERY
from ..lowlevel.arrays import vector
from ..lowlevel.jit import addressed, inner, kernel, seldom
from ..moving import place_moving
from ..patches import face_bodies, face_body
from ..points import amplitude_of, does_not_act, fields_of_item, law_of_item, rates_of_item, work_arrays
from .dynamics import signals_at, to_full
from .events import NOWHERE, SAMPLES, interpolate
from .state import ENGAGED_STEP, OLD_STEP, RATE_ERRORS

# fractions of a step: how close to its end a change of a stop must be for the step to end there; how close to its start
# a change is that which ended the previous step. Most tries to hit a change; halvings of an interval
AT_END, AT_START, TRIES, HALVINGS = 1e-6, 3e-6, 5, 40
# a step that passes a change has a wrong path, so the first retry ends at this fraction of the way to the change, and
# is at most this fraction of the step; how far beyond the end of a retry a change is searched [fraction of the step]
FIRST_RETRY, LARGEST_RETRY, SEARCHED_BEYOND = 0.8, 0.5, 1.0
# size of the step after an engagement, as a fraction of the step before: the stiffness of the stop is not known yet
AFTER_ENGAGEMENT = 1e-2
# fraction of the largest step: shorter steps are not made for a stop, and shorter contacts are missed. Without it, many
# points that touch in quick succession would shorten steps until round-off decides whether they act
SHORTEST = 1e-7
# change of the stops at the end of a step: none, one engages, one releases, the last one releases
UNCHANGED, ENGAGES, RELEASES, ALL_RELEASED = range(4)


@inner
def _item_acts(points, i, w, room):  # type: ignore[no-untyped-def]
    """Return whether item i has a nonzero force or energy at w.d with rates w.v."""
    u, rates, a, f, H, C = room
    m = points.field[i + 1] - points.field[i]
    rates_of_item(points, i, w.v, rates)
    fields_of_item(points, i, w.d, u)
    amplitude_of(points, i, w.amps, u, rates, a)
    acts = law_of_item(points, i, u, rates, a, f, H, C, m if points.forces_of_run[i] == 0 else 0)[0] != 0.0
    for j in range(m):
        acts |= f[j] != 0.0
    return acts


@inner
def _fill_acting(p, w, z, v, t, room, out, only):  # type: ignore[no-untyped-def]
    """Set out to 1 for each stop that acts at unknowns z and rates v at time t, else to 0.

    ``only`` : a single stop, whose entry alone is set, or ``EVERY`` stop.
    """
    signals_at(p, t, w.amps)
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    place_moving(p, w.d, w.amps)
    faced = False
    for k in range(len(p.stops)) if only == EVERY else range(only, only + 1):
        # usually the item that acted last still does
        if not faced:
            face_body(p, p.stops[k, 2], w.d)
        out[k], i = 1.0 if _item_acts(p.points, p.stops[k, 2], w, room) else 0.0, p.stops[k, 0]
        if out[k] == 0.0 and not faced:
            face_bodies(p, w.d)
            faced = True
        while i < p.stops[k, 1] and out[k] == 0.0:
            if does_not_act(p.points, i, w.d):
                i += p.points.run[i]
                continue
            if _item_acts(p.points, i, w, room):
                out[k], p.stops[k, 2] = 1.0, i
            i += 1


@kernel
@seldom
def acting(p, w, z, v, t, out):  # type: ignore[no-untyped-def]
    """Set out (k,) to 1 for each stop that acts at unknowns z and rates v at time t, else to 0."""
    _fill_acting(p, w, z, v, t, work_arrays(p.points), out, EVERY)


@inner
def _fill_acting_within(p, w, s, m, at, t, h, x, room, out, only):  # type: ignore[no-untyped-def]
    """Same as ``_fill_acting`` at the fraction x of the step from s at t to m.end."""
    interpolate(m, p, s, h, x, at.z, at.v, at.a)
    _fill_acting(p, w, at.z, at.v, t + x * h, room, out, only)


@addressed
@seldom
def stop_crossing(p, w, s, m, at, t, h, near, beyond):  # type: ignore[no-untyped-def]
    """Return the fraction of the step from s at t, up to 1 + ``beyond``, of the first change of a stop, and its kind.

    The kind is ENGAGES, RELEASES, or ALL_RELEASED if no other stop acts after a release. Without a change, returns
    (NOWHERE, UNCHANGED). A change up to the fraction ``near`` is the one that ended the previous step: ignored.
    """
    n = len(p.stops)
    room = work_arrays(p.points)
    before, now, middle = vector(n), vector(n), vector(n)
    _fill_acting_within(p, w, s, m, at, t, h, 0.0, room, before, EVERY)
    first, what, low = NOWHERE, UNCHANGED, 0.0
    for place in range(1, SAMPLES + (2 if beyond > 0.0 else 1)):
        x = place / SAMPLES if place <= SAMPLES else 1.0 + beyond
        _fill_acting_within(p, w, s, m, at, t, h, x, room, now, EVERY)
        for k in range(n):
            if now[k] == before[k]:
                continue
            left, right = low, x
            for _ in range(HALVINGS):
                half = 0.5 * (left + right)
                _fill_acting_within(p, w, s, m, at, t, h, half, room, middle, k)
                if middle[k] == before[k]:
                    left = half
                else:
                    right = half
            if right <= near:
                before[k] = now[k]
            elif right < first:
                first, what = right, ENGAGES if now[k] > 0.0 else RELEASES
        if first != NOWHERE:
            break
        low = x
    if what == RELEASES:
        _fill_acting_within(p, w, s, m, at, t, h, first + near, room, now, EVERY)
        what = ALL_RELEASED
        for k in range(n):
            if now[k] > 0.0:
                what = RELEASES
    return first, what


@inner
def aim_at_change(m, p, w, s, at, plan, t, h, room, tries):  # type: ignore[no-untyped-def]
    """Return (accepted, step size, change): whether a step may end where it does, and if not, the size to try instead.

    A step is accepted if no stop changes in it or if it ends at a change, which is returned (``stop_crossing``), else
    UNCHANGED. ``room`` is the largest size allowed, ``tries`` the number of tries so far.
    """
    near = max(AT_START * max(h, s.numbers[OLD_STEP]), SHORTEST * plan.largest) / h
    x, what = calls.stop_crossing(p.calls, (p, w, s, m, at, t, h, near, SEARCHED_BEYOND if tries > 0 else 0.0))
    if x == NOWHERE or (x > 1.0 and (h >= room or tries >= TRIES)):
        return True, h, UNCHANGED
    # any implicit step that runs into a stiff stop ends where the stop engages, so the first try proves nothing
    if abs(x - 1.0) <= AT_END and (tries > 0 or what != ENGAGES):
        return True, h, what
    if tries >= TRIES and what != ENGAGES:
        return True, h, what
    if x < 1.0 and (tries == 0 or tries >= TRIES):
        return False, min(FIRST_RETRY * x, LARGEST_RETRY) * h, UNCHANGED
    return False, min(x, room / h) * h, UNCHANGED


@inner
def restart_after_change(m, p, w, s, t, stops):  # type: ignore[no-untyped-def]
    """Restart the method at s and t if ``stops`` is a change, so that the next step does not use earlier forces.

    Rates are projected onto the constraints first: their errors of O(h^2) would act as forces in a much shorter step.
    """
    if stops == UNCHANGED:
        return
    if stops != RELEASES:
        s.numbers[RATE_ERRORS] = 1.0 if stops == ENGAGES else 0.0
    if not m.exact:
        calls.onto_constraints(p.calls, (p, w, s.z, s.v, s.a, t, False))
    calls.restart(m.calls, (s, m.own))


@inner
def size_after_engagement(s, plan, h, stops, wanted):  # type: ignore[no-untyped-def]
    """Return the size of the step after one of size h: short if a stop engages at its end, else ``wanted``.

    If several stops engage in succession, the first one determines the size.
    """
    short = max(AFTER_ENGAGEMENT * h, s.numbers[ENGAGED_STEP], SHORTEST * plan.largest)
    s.numbers[ENGAGED_STEP] = short if stops == ENGAGES else 0.0
    return wanted if s.numbers[ENGAGED_STEP] == 0.0 else s.numbers[ENGAGED_STEP]


def stop_functions(problem: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the entries of the table of a model with stops (``kernels.calls.table``)."""
    return {calls.stop_crossing: (stop_crossing, problem)}
