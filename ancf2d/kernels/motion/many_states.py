"""Many states of a motion in one call: full coordinates, and residuals and tangents for derivatives."""

from __future__ import annotations

from typing import Any, NamedTuple

from .. import calls
from ..bodies import elastic, group_at, set_natural
from ..elements import tangent_action, viscous_action
from ..lowlevel.arrays import copy, copy_rows, vector
from ..lowlevel.jit import inner, kernel, seldom
from ..lowlevel.records import array_at
from ..moving import moving_inertia
from ..points import add_to, evaluate_item, fields_of_item, work_arrays
from .dynamics import FORCES, norm, residual, signals_at, to_full, to_unknowns, twice_kinetic

# smaller virtual displacements count as zero and are not scaled
NEGLIGIBLE = 1e-200
# correction of a stored state: none; accelerations and multipliers; rates, too; positions, too
AS_IS, FORCES_ALONE, RATES, POSITIONS = range(4)


class States(NamedTuple):
    """States of a motion: t (m,), z, v, a (m, n), history turns (m, items, memory) of point laws, feet (m, joints, 2).
    """

    t: Any
    z: Any
    v: Any
    a: Any
    turns: Any
    feet: Any


@inner
def _load_history(p, w, at, k):  # type: ignore[no-untyped-def]
    """Restore the history of point laws and joints, and the signals, of state k."""
    copy_rows(at.turns[k], p.points.mem)
    copy_rows(at.feet[k], p.sliding.memory)
    signals_at(p, at.t[k], w.amps)


@kernel
@seldom
def read_states(p, w, every, side, onto, z, v, a, turns, feet, states,  # type: ignore[no-untyped-def]
                d, rates, second, Q, energy):
    """Fill d, rates, second and Q = Q - F (m, n_full) with the full coordinates and forces of stored states.

    If not ``every``, only d is filled, and the last three and energy are not used.

    z, v and a (m, n) are first corrected in place as ``onto`` (m,) says: AS_IS (not), RATES (projected onto the
    constraints) or POSITIONS (projected too); FORCES_ALONE only recomputes a and multipliers, from the equations of
    motion. side (m,) are the times for signals; turns, feet and states the history variables (``advance.Rows``).
    energy (m, 2) : strain energy of the elements, and kinetic energy.
    """
    for k in range(len(side)):
        copy_rows(turns[k], p.points.mem)
        copy_rows(feet[k], p.sliding.memory)
        copy(states[k], p.states)
        if not every:
            if onto[k] == POSITIONS:
                calls.onto_constraints(p.calls, (p, w, z[k], v[k], a[k], side[k], True))
            signals_at(p, side[k], w.amps)
            to_full(p, z[k], w.amps, 0, d[k])
            continue
        if onto[k] == FORCES_ALONE:
            rates_there, none = array_at(second[k], 0, v[k].shape), array_at(Q[k], 0, v[k].shape)
            copy(v[k], rates_there)
            none[:] = 0.0
            calls.consistent(p.calls, (p, w, z[k], rates_there, a[k], side[k], none))
            w.counts[FORCES] -= 1
        elif onto[k] != AS_IS:
            calls.onto_constraints(p.calls, (p, w, z[k], v[k], a[k], side[k], onto[k] == POSITIONS))
        signals_at(p, side[k], w.amps)
        to_full(p, a[k], w.amps, 2, second[k])
        energy[k, 1] = 0.5 * twice_kinetic(p, w, v[k])
        energy[k, 0] = calls.forces(p.calls, (p, w, z[k], v[k]))[0]
        # only evaluations of steps are counted
        w.counts[FORCES] -= 1
        if p.patched:
            # without point laws
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
        _load_history(p, w, at, k)
        calls.forces(p.calls, (p, w, at.z[k], at.v[k]))
        residual(p, w, at.v[k], at.a[k])
        copy(w.R, out[k])


@kernel
def derivatives_along(p, w, at, dz, dv, da, step, out):  # type: ignore[no-untyped-def]
    """Fill out (m, n) with the derivative of each residual along (dz, dv, da) (m, n).

    It is computed by differences of fourth order over ``step`` times these vectors.
    """
    n = len(w.R)
    for k in range(len(at.t)):
        z, v, a, total = at.z[k], at.v[k], at.a[k], out[k]
        for i in range(n):
            total[i] = 0.0
        moved = 0.0
        for q in range(5):
            # the last value returns to the state itself
            to = (1.0, -1.0, 2.0, -2.0, 0.0)[q] * step
            for i in range(n):
                z[i] += (to - moved) * dz[k, i]
                v[i] += (to - moved) * dv[k, i]
                a[i] += (to - moved) * da[k, i]
            moved = to
            if q < 4:
                f = (8.0, -8.0, -1.0, 1.0)[q] / (12.0 * step)
                _load_history(p, w, at, k)
                calls.forces(p.calls, (p, w, z, v))
                residual(p, w, v, a)
                for i in range(n):
                    total[i] += f * w.R[i]


@kernel
@seldom
def tangents(p, w, at, c, out):  # type: ignore[no-untyped-def]
    """Fill out (m, entries) with dQ/dz + c dQ/dz' of each state, as used by Newton's method."""
    for k in range(len(at.t)):
        _load_history(p, w, at, k)
        calls.forces_tangent(p.calls, (p, w, at.z[k], at.v[k], c))
        copy(w.A, out[k])


@kernel
def residual_products(p, w, at, lam, out):  # type: ignore[no-untyped-def]
    """Fill out (m, k) with the products of the residual of each state and lam (m, n, k)."""
    for k in range(len(at.t)):
        _load_history(p, w, at, k)
        calls.forces(p.calls, (p, w, at.z[k], at.v[k]))
        residual(p, w, at.v[k], at.a[k])
        for q in range(lam.shape[2]):
            x = 0.0
            for i in range(len(w.R)):
                x += lam[k, i, q] * w.R[i]
            out[k, q] = x


@inner
def _unsymmetric(points, d, v, amps, lam, by_d, by_v):  # type: ignore[no-untyped-def]
    """Add the derivatives of lam . Q of point laws by d and v to by_d and by_v, without the symmetric tangents."""
    if len(points.forces) == 0:
        return
    u, w, a, f, H, C = work_arrays(points)
    mu = vector(len(u))
    for i in range(len(points.forces)):
        m = points.field[i + 1] - points.field[i]
        evaluate_item(points, i, d, v, amps, u, w, a, f, H, C)
        fields_of_item(points, i, lam, mu)
        for r in range(m):
            f[r], w[r] = 0.0, 0.0
            for q in range(m):
                f[r] += 0.5 * (H[q * m + r] - H[r * m + q]) * mu[q]
                w[r] += 0.5 * (C[q * m + r] - C[r * m + q]) * mu[q]
        add_to(points, i, f, by_d)
        add_to(points, i, w, by_v)


@kernel
def derivatives_left_out(p, w, at, lam, none, room, by_z, by_v):  # type: ignore[no-untyped-def]
    """Fill by_z and by_v (m, n) with the derivatives of lam . R by z and v that ``tangents`` leaves out.

    lam (m, n) has one vector per state; none (signals, 3) are zero signals; room (3, n_full) is work space.
    """
    full, by_d, by_rate = room[0], room[1], room[2]
    for k in range(len(at.t)):
        _load_history(p, w, at, k)
        to_full(p, at.z[k], w.amps, 0, w.d)
        to_full(p, at.v[k], w.amps, 1, w.v)
        to_full(p, lam[k], none, 0, full)
        set_natural(p, w.amps, w.amps)
        # differences of terms quadratic in v +- lam keep most digits if both are of similar size
        size, rates = norm(p, lam[k]), max(norm(p, at.v[k]), 1e-3 * p.extent)
        scale = rates / size if size > NEGLIGIBLE else 1.0
        for i in range(len(full)):
            full[i] *= scale
            by_d[i], by_rate[i] = 0.0, 0.0
        for g in range(len(p.groups)):
            if p.tau[g] > 0.0:
                group = group_at(p.groups[g])
                w.Q[:] = 0.0
                viscous_action(group, p.tau[g], w.d, w.v, full, by_d, w.Q, w.other)
                for i in range(len(full)):
                    by_d[i] -= w.Q[i]
                    by_rate[i] += w.Q[i]
                w.Q[:] = 0.0
                tangent_action(group, w.d, full, w.Q)
                for i in range(len(full)):
                    by_rate[i] -= p.tau[g] * w.Q[i]
        _unsymmetric(p.points, w.d, w.v, w.amps, full, by_d, by_rate)
        to_unknowns(p, by_d, by_z[k], False)
        to_unknowns(p, by_rate, by_v[k], False)
        for i in range(len(by_z[k])):
            by_z[k, i] /= scale
            by_v[k, i] *= p.coordinate[i] / scale
