"""All element quantities, batch by batch, computed by one kernel that is called by address and compiled once.

Each quantity is a short program of steps, so that the kernel contains the code of every step only once. The drivers
(``elements``) loop over the batches of a group and assemble the ``results``.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import types

from .batch import (
    add_geometric,
    add_geometric_forces,
    add_stresses,
    begin,
    combine,
    combine_rows,
    copy_rows,
    each_point,
    from_lanes,
    layout,
    material,
    matrices,
    no_group,
    pad,
    points_of,
    product,
    row_of,
    subtract_natural,
    to_lanes,
)
from .compiled_laws import (
    ELASTIC_JACOBIAN,
    MEAN,
    PULL,
    PUSH,
    STRAIN,
    SUBTRACT_INTERNAL,
    SUBTRACT_SLOPE,
    evaluate_internal,
)
from .lanes import PointRows, vectors_of
from .lowlevel.jit import addressed, inner
from .lowlevel.records import STRIDE, address_of, array_at, caller, row, type_of, whole
from .stress_free import BEFORE, CHANGE, NOW, RATES
from .tangents import tangents

# quantities of a batch: strains and stresses; forces; forces and tangents; viscous forces at rates e; K e by way of
# strains; forces (and tangents) of a conserving step from d to e; derivative of the forces by time due to natural
# strains; power of natural strains at rates e, and their work in a step from d to e; update of the history variables at
# d; viscous forces with their geometric term along e; strains, internal ones included
(STRAINS, FORCE, TANGENT, RATE, ACTION, STEP, STEP_TANGENT, SLOPE, POWER, WORK, COMMIT, RATE_GEOMETRIC,
 TOTAL_STRAINS) = range(13)
# steps of a program; their arguments follow in the tuples below
(LANES, LAW, STRESS, COMBINE, PRODUCT, FORCES, MATERIAL, GEOMETRIC, GEOMETRIC_FORCES, TANGENTS, NATURAL,
 MEMORY) = range(12)
# numbers that steps multiply by; the last two are the ``factor`` of the call, and factor + 1/2
ZERO, ONE, HALF, MINUS, MINUS_HALF, FACTOR, HALF_MORE = range(7)
_D, _E = range(2)
# arguments of MEMORY beyond those of the laws: accept the new states, or store them as trial states
_ACCEPT, _TRIAL = -1, -2
_U, _U0, _EPS, _EPS0, _SIGMA, _G = (PointRows._fields.index(name) for name in ("u", "u0", "eps", "eps0", "sigma", "g"))

_STRESSES = [(LANES, _D, _U), (LAW, STRAIN), (NATURAL, NOW, _EPS), (MEMORY, SUBTRACT_INTERNAL), (STRESS, ZERO, ONE)]
_NONE = (COMBINE, ZERO, _EPS, ZERO, _EPS, _EPS)
_ELASTIC = [*_STRESSES, (PRODUCT, HALF, _EPS, _SIGMA, 0), (LAW, PULL), (FORCES,)]
# Q = B^T J^T D tau (J B v - eps*')
_VISCOUS = [(LANES, _D, _U), (LANES, _E, _U0), (LAW, STRAIN), (LAW, PUSH), (COMBINE, ONE, _EPS0, ZERO, _EPS0, _EPS),
            (NATURAL, RATES, _EPS), (STRESS, ZERO, FACTOR), (PRODUCT, ONE, _EPS, _SIGMA, 0), (LAW, PULL), (FORCES,)]
_ACTION = [*_STRESSES, (LANES, _E, _U0), (GEOMETRIC, ZERO), (LAW, PUSH), (COMBINE, ONE, _EPS0, ZERO, _EPS0, _EPS),
           (MEMORY, SUBTRACT_SLOPE), (STRESS, ZERO, ONE), (LAW, PULL), (GEOMETRIC_FORCES,), (FORCES,)]
# Q = B^T (J^T sigma + sigma . d2eps/du2 B v) with sigma = D tau (J B v - eps*')
_RATE_GEOMETRIC = [*_VISCOUS[:-3], (GEOMETRIC, ZERO), (LAW, PULL), (GEOMETRIC_FORCES,), (FORCES,)]
# Q = B^T J^T (D (eps0 + eps1)/2 + tau/h D J (u1 - u0)) with the discrete J: the strain increment J (u1 - u0) keeps
# digits that the difference of the strains has lost. The mean strain is kept in slot g until forces overwrite it.
_MIDDLE = [(LANES, _D, _U), (LAW, STRAIN), (COMBINE, ONE, _U, ZERO, _U, _U0), (COMBINE, ONE, _EPS, ZERO, _EPS, _EPS0),
           (LANES, _E, _U), (LAW, STRAIN), (LAW, MEAN), (NATURAL, NOW, _EPS), (NATURAL, BEFORE, _EPS0),
           (STRESS, ZERO, ONE), (PRODUCT, HALF, _EPS, _SIGMA, 0), (COMBINE, HALF, _EPS, HALF, _EPS0, _G),
           (COMBINE, ONE, _U, MINUS, _U0, _U0), (LAW, PUSH), (NATURAL, CHANGE, _EPS0)]
_STEP = [*_MIDDLE, (COMBINE, ONE, _EPS0, ZERO, _EPS0, _EPS), (STRESS, ZERO, FACTOR), (PRODUCT, ONE, _EPS, _SIGMA, 1),
         (COMBINE, ONE, _G, ZERO, _G, _EPS), (STRESS, ONE, ONE), (LAW, PULL), (FORCES,)]
# Q = -B^T J^T D eps*', and eps*'^T D eps*'/2
_SLOPE = [(LANES, _D, _U), (LAW, STRAIN), _NONE, (NATURAL, RATES, _EPS), (STRESS, ZERO, ONE),
          (PRODUCT, HALF, _EPS, _SIGMA, 0), (LAW, PULL), (FORCES,)]
# -sigma . eps*', and the same over a step, as second result
_POWER = [(LANES, _D, _U), (LANES, _E, _U0), (LAW, STRAIN), (LAW, PUSH), (NATURAL, NOW, _EPS),
          (MEMORY, SUBTRACT_INTERNAL), (NATURAL, RATES, _EPS0), (COMBINE, ONE, _EPS, FACTOR, _EPS0, _EPS),
          (STRESS, ZERO, ONE), _NONE, (NATURAL, RATES, _EPS), (PRODUCT, ONE, _EPS, _SIGMA, 0)]
_WORK = [*_MIDDLE, (COMBINE, ONE, _G, FACTOR, _EPS0, _EPS), (STRESS, ZERO, ONE), _NONE, (NATURAL, CHANGE, _EPS),
         (PRODUCT, ONE, _EPS, _SIGMA, 1)]
# K = B^T ((1/2 + tau/h) J^T D J + sigma . d2eps/du2/2) B with the mean stress, at the mid-configuration. The strain of
# the mid-configuration itself would be wrong, since a rotation by w shortens it by w^2/8. The exact derivative would
# have the Jacobian of the strain at d1 as the second J.
_STEP_TANGENT = [*_STEP, (COMBINE, ONE, _U, MINUS_HALF, _U0, _U), (COMBINE, HALF, _SIGMA, ZERO, _SIGMA, _SIGMA),
                 (MATERIAL, HALF_MORE), (GEOMETRIC, ONE), (TANGENTS,)]
_PROGRAMS = {STRAINS: _STRESSES, FORCE: [*_ELASTIC, (MEMORY, _TRIAL)],
             TANGENT: [*_ELASTIC, (MEMORY, ELASTIC_JACOBIAN), (MATERIAL, ONE), (GEOMETRIC, ONE), (TANGENTS,)],
             RATE: _VISCOUS, ACTION: _ACTION, STEP: _STEP, STEP_TANGENT: _STEP_TANGENT, SLOPE: _SLOPE, POWER: _POWER,
             WORK: _WORK, COMMIT: [*_STRESSES, (MEMORY, _ACCEPT)], RATE_GEOMETRIC: _RATE_GEOMETRIC,
             TOTAL_STRAINS: [(LANES, _D, _U), (LAW, STRAIN), (NATURAL, NOW, _EPS)]}
_STEPS = np.array([(*step, 0, 0, 0, 0, 0)[:6] for k in range(len(_PROGRAMS)) for step in _PROGRAMS[k]])
_STARTS = np.cumsum([0] + [len(_PROGRAMS[k]) for k in range(len(_PROGRAMS))])


@inner
def is_prescribed(group):  # type: ignore[no-untyped-def]
    """Return whether internal strains are prescribed (``Memory.prescribed``) instead of computed by the law."""
    slope = group.memory.slope
    return len(slope) > 0 and slope[0] <= 0.0


@inner
def remembering(group, part):  # type: ignore[no-untyped-def]
    """Return how many stations of a part, its first ones, have internal strains; others have no stiffness for these."""
    S, states = group.law.B.shape[2], group.memory.states
    return min(max(states.shape[1] - part * S, 0), S) if len(states) > 0 else S


@inner
def load_states(group, part, first, count):  # type: ignore[no-untyped-def]
    """Fill slot ``old`` with the accepted states of the elements of a batch."""
    law, work, memory = group.law, group.plan.work, group.memory
    at, slot = layout(law)
    S, kept = law.B.shape[2], remembering(group, part) if len(memory.states) > 0 else 0
    for m in range(count):
        for s in range(kept):
            source = memory.states[memory.row[first + m], part * S + s]
            for p in range(points_of(law)):
                lane, k = (p * at.rows + slot.old) * STRIDE + s * count + m, p * law.state
                target = array_at(work, lane, (law.state, STRIDE))
                for i in range(law.state):
                    target[i, 0] = source[k + i]
    for p in range(points_of(law)):
        pad(work, p * at.rows + slot.old, law.state, kept * count)


@inner
def load_prescribed(group, part, first, count):  # type: ignore[no-untyped-def]
    """Fill slot ``new`` with the prescribed internal strains, and subtract them from the strains."""
    law, work, memory = group.law, group.plan.work, group.memory
    at, slot = layout(law)
    S, k = law.B.shape[2], law.strains
    for m in range(count):
        for s in range(S):
            source = memory.prescribed[memory.row[first + m], part * S + s]
            for p in range(points_of(law)):
                for i in range(k):
                    work[(p * at.rows + slot.new + i) * STRIDE + s * count + m] = source[p * k + i]
    for p in range(points_of(law)):
        eps, new = p * at.rows + slot.eps, p * at.rows + slot.new
        pad(work, new, k, S * count)
        combine_rows(work, 1.0, eps, -1.0, new, eps, k, vectors_of(S * count))


@inner
def load_slopes(group, lanes):  # type: ignore[no-untyped-def]
    """Fill slot ``slope`` with the slope of prescribed internal strains."""
    at, slot = layout(group.law)
    for p in range(points_of(group.law)):
        for i in range(group.law.strains):
            slope = row(group.plan.work, p * at.rows + slot.slope + i * group.law.strains + i)
            for l in range(lanes):
                slope[l] = group.memory.slope[0]


@inner
def work_of_change(group, part, first, count):  # type: ignore[no-untyped-def]
    """Return sigma . change of a batch: the work of the stresses on the prescribed changes of internal strains."""
    law, work, memory = group.law, group.plan.work, group.memory
    at, slot = layout(law)
    S, lost = law.B.shape[2], 0.0
    for i in range(memory.change.shape[2]):
        sigma = row(work, row_of(i, law.strains, at, slot.sigma))
        for s in range(S):
            for m in range(count):
                lost += sigma[s * count + m] * memory.change[memory.row[first + m], part * S + s, i]
    return lost


@inner
def accept_states(group, part, first, count):  # type: ignore[no-untyped-def]
    """Accept the new states of a batch; return the work of the stresses on the change of internal strains."""
    law, work, memory = group.law, group.plan.work, group.memory
    at, slot = layout(law)
    kept, lost = remembering(group, part), 0.0
    for i in range(memory.states.shape[2]):
        new, old = row(work, row_of(i, law.state, at, slot.new)), row(work, row_of(i, law.state, at, slot.old))
        if i % law.state < law.strains:
            sigma = row(work, (i // law.state) * at.rows + slot.sigma + i % law.state)
            for l in range(kept * count):
                lost += sigma[l] * (new[l] - old[l])
    store_states(group, memory.states, part, first, count)
    return lost


@inner
def store_states(group, states, part, first, count):  # type: ignore[no-untyped-def]
    """Write the new states of a batch to ``states`` (rows, stations of all parts, numbers of all points)."""
    law, work, memory = group.law, group.plan.work, group.memory
    at, slot = layout(law)
    S = law.B.shape[2]
    for m in range(count if len(states) > 0 else 0):
        for s in range(remembering(group, part)):
            target = states[memory.row[first + m], part * S + s]
            for p in range(points_of(law)):
                lane, k = (p * at.rows + slot.new) * STRIDE + s * count + m, p * law.state
                source = array_at(work, lane, (law.state, STRIDE))
                for i in range(law.state):
                    target[k + i] = source[i, 0]


@inner
def memory_step(group, what, part, first, count):  # type: ignore[no-untyped-def]
    """Perform a MEMORY step of a program; return the energy that internal strains took (0 unless states are accepted).
    """
    if what == _ACCEPT:
        if is_prescribed(group):
            return work_of_change(group, part, first, count)
        return accept_states(group, part, first, count)
    if what == _TRIAL:
        store_states(group, group.memory.trial, part, first, count)
        return 0.0
    law, prescribed, lanes = group.law, is_prescribed(group), vectors_of(remembering(group, part) * count)
    at, slot = layout(law)
    if what == SUBTRACT_INTERNAL and prescribed:
        load_prescribed(group, part, first, count)
        return 0.0
    # without prescribed ones, SUBTRACT_INTERNAL fills state and slope for the steps that follow
    if prescribed:
        load_slopes(group, lanes)
    elif what == SUBTRACT_INTERNAL:
        load_states(group, part, first, count)
        for p in range(points_of(law)):
            evaluate_internal(law, slot, group.plan.work, p * at.rows, lanes)
    elif what == ELASTIC_JACOBIAN:
        for p in range(points_of(law)):
            copy_rows(group.plan.work, (p * at.rows + slot.J) * STRIDE, STRIDE, (p * at.rows + slot.JE) * STRIDE,
                      STRIDE, law.strains * law.fields, vectors_of(law.B.shape[2] * count))
    each_point(group, what, lanes)
    return 0.0


@addressed
def element_batch(what, record, d, e, first, count, part, factor):  # type: ignore[no-untyped-def]
    """Compute quantity ``what`` for elements first, ..., first + count - 1, which are all of one class.

    STRAINS leaves strains and stresses of one ``part`` of the stations in the work buffer, WHOLE the strains; all other
    quantities loop over all parts. Returns two numbers. The first is the strain energy at d (at e for STEP), for SLOPE
    the energy of natural strains alone, for RATE the dissipated power, for POWER the power of natural strains. The
    second is the energy dissipated in a STEP or, for COMMIT, by internal strains, and for WORK that of natural strains.
    """
    group = whole(record)
    law = group.law
    _, slot = layout(law)
    lanes = law.B.shape[2] * count
    full = vectors_of(lanes)
    factors = (0.0, 1.0, 0.5, -1.0, -0.5, factor, factor + 0.5)
    energy, lost = 0.0, 0.0
    for k in range(part, part + 1 if what in (STRAINS, TOTAL_STRAINS) else group.plan.parts):
        q = begin(group, k, first, count)
        for i in range(_STARTS[what], _STARTS[what + 1]):
            step, a, b = _STEPS[i, 0], _STEPS[i, 1], _STEPS[i, 2]
            if step == LANES:
                to_lanes(group, q, first, count, e if a == _E else d, slot[b])
            elif step == LAW:
                each_point(group, a, full)
            elif step == NATURAL:
                subtract_natural(group, k, first, count, a, slot[b])
            elif step == STRESS:
                add_stresses(group, factors[a], factors[b], full)
            elif step == COMBINE:
                out = _STEPS[i, 5]
                rows = law.fields if out in (_U, _U0) else law.strains
                combine(group, factors[a], slot[b], factors[_STEPS[i, 3]], slot[_STEPS[i, 4]], slot[out], rows, full)
            elif step == PRODUCT:
                v = factors[a] * product(group, slot[b], slot[_STEPS[i, 3]], lanes)
                if _STEPS[i, 4] == 0:
                    energy += v
                else:
                    lost += v
            elif step == FORCES:
                from_lanes(group, k, q, count)
            elif step == MATERIAL:
                material(group, factors[a], full)
            elif step == GEOMETRIC:
                add_geometric(group, factors[a], full)
            elif step == GEOMETRIC_FORCES:
                add_geometric_forces(group, full)
            elif step == MEMORY:
                lost += memory_step(group, a, k, first, count) if law.state > 0 else 0.0
            else:
                tangents(group, k, q, count)
    return energy, lost


# the record type of every element group
GROUP = type_of(no_group())
_x, _i = types.float64[::1], types.int64
_BATCH = types.UniTuple(types.float64, 2)(_i, GROUP, _x, _x, _i, _i, _i, types.float64)
call_batch = caller(_BATCH)


@cache
def batch_address() -> int:
    """Return the address of ``element_batch``, compiled on first use."""
    return address_of(element_batch, _BATCH)


@inner
def results(record, count):  # type: ignore[no-untyped-def]
    """Return the forces (n_dof, count) and packed tangents (entries, count) of the last batch."""
    group = whole(record)
    at, _ = layout(group.law)
    _, _, Q, K, _ = matrices(group, at)
    work = group.plan.work
    return array_at(work, Q, (group.law.B.shape[3], count)), array_at(work, K, (len(group.plan.entries), count))
