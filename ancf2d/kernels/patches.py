"""Point laws and prismatic joints of a model in motion, called through the model's table if it has any."""

from __future__ import annotations

from typing import Any

from . import calls
from .body_passages import bodies_cross
from .curves import add_skew, point_accept, point_forces, point_tangent
from .facing import EVERY, IN_RANGE, IN_RANGE_OR_BESIDE, face
from .lowlevel.arrays import array
from .lowlevel.jit import addressed, inner, kernel, named, seldom
from .matrices.symmetric import in_band, in_fronts, places_in, rows_in
from .points import (
    does_not_act,
    evaluate_at,
    evaluate_item,
    point_constraint_rates,
    point_mean_forces,
    weights_of_item,
    work_arrays,
)
from .sliding import (
    sliding_accept,
    sliding_constraint_rates,
    sliding_forces,
    sliding_mean_forces,
    sliding_noise,
    sliding_tangent,
    sliding_violation,
)


@kernel
def point_violation(points, d, amps):  # type: ignore[no-untyped-def]
    """Return the largest |g| of the active constraints, each relative to the size of its terms (``scale``)."""
    worst = 0.0
    if len(points.forces) == 0:
        return worst
    u, w, a, f, H, C = work_arrays(points)
    for i in range(len(points.forces)):
        if points.multiplier[i] >= 0 and not does_not_act(points, i, d):
            evaluate_item(points, i, d, d, amps, u, w, a, f, H, C)
            g = abs(f[points.field[i + 1] - points.field[i] - 1]) / points.scale[i]
            if not g <= worst:
                worst = g
    return worst


@kernel
@seldom
def point_noise(points, d, out):  # type: ignore[no-untyped-def]
    """Add to out (n_full,) the sum of the sizes of all terms in the forces; times the unit round-off it bounds errors.

    Rates count as 0 and signals as 1, so the bound holds up to the size of the amplitudes.
    """
    if len(points.forces) == 0:
        return
    u, w, a, f, H, C = work_arrays(points)
    signals = 0
    for i in range(len(points.forces)):
        for j in range(3):
            signals = max(signals, points.signal[i, j] + 1)
    no_amps = array(signals, 3)
    no_amps[:] = 1.0
    i = 0
    while i < len(points.forces):
        if does_not_act(points, i, d):
            i += points.run[i]
            continue
        w[:] = 0.0
        evaluate_at(points, i, d, no_amps, u, w, a, f, H, C)
        first, m = points.dof[i], points.field[i + 1] - points.field[i]
        n = points.dof[i + 1] - first
        G = weights_of_item(points, i)
        for q in range(m):
            w[q] = 0.0
            for c in range(n):
                w[q] += abs(G[c, q] * d[points.dofs[first + c]])
        for p in range(m):
            s = abs(f[p])
            for q in range(m):
                s += abs(H[p * m + q]) * w[q]
            for c in range(n):
                out[points.dofs[first + c]] += abs(G[c, p]) * s
        i += 1


@inner
def face_bodies(p, d):  # type: ignore[no-untyped-def]
    """Update which elements the contact points face at d (n_full,), for points close enough to have a force."""
    if len(p.facing.item) > 0:
        calls.face(p.calls, (p.facing, p.points, d, IN_RANGE, EVERY))


@inner
def face_body(p, i, d):  # type: ignore[no-untyped-def]
    """Same as ``face_bodies`` for item i alone, if it is a point between bodies."""
    if len(p.facing.item) > 0:
        calls.face(p.calls, (p.facing, p.points, d, IN_RANGE, i))


@inner
def patch_forces(p, d, v, amps, Q):  # type: ignore[no-untyped-def]
    """Add the forces of point laws and joints to Q; return (energy, dissipated power)."""
    if len(p.sliding.multiplier) > 0:
        calls.sliding_forces(p.calls, (p.sliding, d, v, amps, Q))
    if len(p.points.mem) == 0:
        return 0.0, 0.0
    face_bodies(p, d)
    return calls.point_forces(p.calls, (p.points, d, v, amps, Q))


@inner
def _switch_contacts(p, act):  # type: ignore[no-untyped-def]
    for i in range(len(p.points.mem)):
        if p.points.restitution[i] != -1.0 and p.points.fed[i, 0] < 0:
            p.points.on[i] = act


@inner
def forces_but_contacts(p, d, v, amps, Q):  # type: ignore[no-untyped-def]
    """Same as ``patch_forces``, without contacts except those with obstacles that signals move.

    Contacts with obstacles at rest do no work.
    """
    if not p.touches:
        return patch_forces(p, d, v, amps, Q)
    _switch_contacts(p, False)
    energy, power = patch_forces(p, d, v, amps, Q)
    _switch_contacts(p, True)
    return energy, power


@inner
def add_patch_tangent(p, d, v, amps, c, Q, A):  # type: ignore[no-untyped-def]
    """Add the forces of point laws and joints to Q, and their tangent by d and c times that by v to A.

    With c = CONSTRAINTS, laws without multipliers are left out.
    """
    if len(p.points.mem) > 0:
        face_bodies(p, d)
        calls.point_tangent(p.calls, (p, d, v, amps, c, Q, A))
    if len(p.sliding.multiplier) > 0:
        calls.sliding_tangent(p.calls, (p, d, v, amps, max(c, 0.0), Q, A))


@addressed
def _skew(p, x, y):  # type: ignore[no-untyped-def]
    """Add the skew part of the point laws' tangent times x to y; return whether there is any (``curves.add_skew``)."""
    return add_skew(p.points, x, y, places_in(p))


def _with_matrix(stored: Any, kind: str) -> tuple[Any, Any]:
    """Return the functions that add tangents of point laws and of joints to matrices of one kind."""
    def points(p, d, v, amps, c, Q, A):  # type: ignore[no-untyped-def]
        point_tangent(p.points, d, v, amps, c, Q, stored(p, A), rows_in(p))

    def sliding(p, d, v, amps, c, Q, A):  # type: ignore[no-untyped-def]
        sliding_tangent(p.sliding, d, v, amps, c, Q, stored(p, A), rows_in(p))

    return addressed(named(points, kind)), addressed(named(sliding, kind))


_TANGENTS = _with_matrix(in_band, "band"), _with_matrix(in_fronts, "fronts")


def patch_functions(fronts: bool, has_points: bool, has_sliding: bool, has_facing: bool, mean: bool,
                    problem: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the entries for point laws and joints of the table of a model (``kernels.calls.table``).

    ``has_facing`` : whether bodies may touch each other; ``mean`` : whether forces of energy-momentum steps are needed.
    """
    out: dict[Any, tuple[Any, ...]] = {}
    if has_facing:
        tables = [problem.place[name][1] for name in ("facing", "points")]
        out |= {calls.face: (face, *tables), calls.bodies_cross: (bodies_cross, *tables)}
    if has_points:
        points = problem.place["points"][1]
        out |= {calls.point_forces: (point_forces, points), calls.point_noise: (point_noise, points),
                calls.point_violation: (point_violation, points), calls.point_accept: (point_accept, points),
                calls.point_rates: (point_constraint_rates, points),
                calls.point_tangent: (_TANGENTS[fronts][0], problem), calls.point_skew: (_skew, problem)}
        if mean:
            out[calls.point_mean] = point_mean_forces, points
    if has_sliding:
        sliding = problem.place["sliding"][1]
        out |= {calls.sliding_forces: (sliding_forces, sliding), calls.sliding_noise: (sliding_noise, sliding),
                calls.sliding_violation: (sliding_violation, sliding), calls.sliding_accept: (sliding_accept, sliding),
                calls.sliding_rates: (sliding_constraint_rates, sliding),
                calls.sliding_tangent: (_TANGENTS[fronts][1], problem)}
        if mean:
            out[calls.sliding_mean] = sliding_mean_forces, sliding
    return out


@inner
def patch_noise(p, d, out):  # type: ignore[no-untyped-def]
    """Add the sizes of the terms in the forces of point laws and joints, which bound round-off, to out (n_full,)."""
    if len(p.points.mem) > 0:
        face_bodies(p, d)
        calls.point_noise(p.calls, (p.points, d, out))
    if len(p.sliding.multiplier) > 0:
        calls.sliding_noise(p.calls, (p.sliding, d, out))


@inner
def violation(p, d, amps):  # type: ignore[no-untyped-def]
    """Return the largest |g| of all constraints, each relative to its own scale."""
    worst = 0.0
    if len(p.points.mem) > 0:
        if p.sided:
            face_bodies(p, d)
        worst = max(worst, calls.point_violation(p.calls, (p.points, d, amps)))
    if len(p.sliding.multiplier) > 0:
        worst = max(worst, calls.sliding_violation(p.calls, (p.sliding, d, amps)))
    return worst


@inner
def accept_patches(p, d, amps):  # type: ignore[no-untyped-def]
    """Update the history variables of point laws and joints at the accepted state d."""
    if len(p.points.mem) > 0:
        if len(p.facing.item) > 0:
            calls.face(p.calls, (p.facing, p.points, d, IN_RANGE_OR_BESIDE, EVERY))
        calls.point_accept(p.calls, (p.points, d, amps))
    if len(p.sliding.multiplier) > 0:
        calls.sliding_accept(p.calls, (p.sliding, d))


@inner
def rates_of_constraints(p, d, v, amps, velocity, acceleration):  # type: ignore[no-untyped-def]
    """Set velocity to g_t and acceleration to v^T g_qq v + 2 g_qt v + g_tt, at the multipliers of all constraints."""
    if len(p.points.mem) > 0:
        face_bodies(p, d)
        calls.point_rates(p.calls, (p.points, d, v, amps, velocity, acceleration))
    if len(p.sliding.multiplier) > 0:
        calls.sliding_rates(p.calls, (p.sliding, d, v, amps, velocity, acceleration))
