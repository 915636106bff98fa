"""Many states of a motion in one call: their full coordinates, and residuals and tangents for derivatives."""

from __future__ import annotations

from typing import Any, NamedTuple

from .. import calls
from ..bodies import elastic
from ..lowlevel.arrays import copy, copy_rows
from ..lowlevel.jit import inner, kernel
from ..moving import moving_inertia
from .dynamics import FORCES, residual, to_full, twice_kinetic
from .state import evaluate


class Moments(NamedTuple):
    """States of a motion. t (m,); z, v, a (m, n); turns (m, items, memory), feet (m, joints, 2): what laws remember."""

    t: Any
    z: Any
    v: Any
    a: Any
    turns: Any
    feet: Any


@inner
def _recall(p, w, at, k):  # type: ignore[no-untyped-def]
    """Let laws and signals be those of a state."""
    copy_rows(at.turns[k], p.points.mem)
    copy_rows(at.feet[k], p.sliding.memory)
    evaluate(p.programs, at.t[k], w.amps)


@kernel
def read_states(p, w, side, inside, z, v, a, turns, feet, states,  # type: ignore[no-untyped-def]
                d, rates, second, Q, energy):
    """Fill d, rates, second and Q - F (m, n_full) with what stored states are in full coordinates.

    Those inside steps are put onto the constraints first, in z and v (m, n) themselves. side (m,) are the times of
    signals, turns, feet and states what is remembered there (``advance.Rows``). energy (m, 2) : of elements
    and kinetic.
    """
    for k in range(len(side)):
        copy_rows(turns[k], p.points.mem)
        copy_rows(feet[k], p.sliding.memory)
        copy(states[k], p.states)
        if inside[k] and p.patched:
            calls.onto_constraints(p.calls, (p, w, z[k], v[k], side[k]))
        evaluate(p.programs, side[k], w.amps)
        to_full(p, a[k], w.amps, 2, second[k])
        energy[k, 1] = 0.5 * twice_kinetic(p, w, v[k])
        energy[k, 0] = calls.forces(p.calls, (p, w, z[k], v[k]))[0]
        # steps alone are counted
        w.counts[FORCES] -= 1
        if p.patched:
            # of elements alone
            w.other[:] = 0.0
            energy[k, 0] = elastic(p, w.d, w.other)
        moving_inertia(p, w.amps, a[k], w.Q)
        copy(w.d, d[k])
        copy(w.v, rates[k])
        copy(w.Q, Q[k])


@kernel
def residuals(p, w, at, out):  # type: ignore[no-untyped-def]
    """Fill out (m, n) with M (a + alpha v) + T^T (Q - F) of each state."""
    for k in range(len(at.t)):
        _recall(p, w, at, k)
        calls.forces(p.calls, (p, w, at.z[k], at.v[k]))
        residual(p, w, at.v[k], at.a[k])
        copy(w.R, out[k])


@kernel
def actions(p, w, at, dz, dv, da, step, out):  # type: ignore[no-untyped-def]
    """Fill out (m, n) with the derivative of each residual along (dz, dv, da) (m, n), by differences.

    These are of fourth order, over ``step`` times the change.
    """
    n = len(w.R)
    for k in range(len(at.t)):
        z, v, a, total = at.z[k], at.v[k], at.a[k], out[k]
        for i in range(n):
            total[i] = 0.0
        moved = 0.0
        for q in range(5):
            # back to the state at last
            to = (1.0, -1.0, 2.0, -2.0, 0.0)[q] * step
            for i in range(n):
                z[i] += (to - moved) * dz[k, i]
                v[i] += (to - moved) * dv[k, i]
                a[i] += (to - moved) * da[k, i]
            moved = to
            if q < 4:
                f = (8.0, -8.0, -1.0, 1.0)[q] / (12.0 * step)
                _recall(p, w, at, k)
                calls.forces(p.calls, (p, w, z, v))
                residual(p, w, v, a)
                for i in range(n):
                    total[i] += f * w.R[i]


@kernel
def tangents(p, w, at, c, out):  # type: ignore[no-untyped-def]
    """Fill out (m, entries) with dQ/dz + c dQ/dz' of each state, as Newton's method has them."""
    for k in range(len(at.t)):
        _recall(p, w, at, k)
        calls.forces_tangent(p.calls, (p, w, at.z[k], at.v[k], c))
        copy(w.A, out[k])
