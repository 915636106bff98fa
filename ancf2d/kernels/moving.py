"""Points that move along bodies: their current position, and the inertia of their masses.

Forces at such points are point laws (``kernels.points``) whose coordinates and weights are rewritten for every
configuration. A mass at r(s(t), t) has the acceleration S q'' + 2 s' S_s q' + (s'' S_s + s'^2 S_ss) e: the first term
is added to the mass matrix, the others belong to a point law. The table is ``elements.sliding.Moving``.
"""

from __future__ import annotations

import math
from typing import Any

from . import calls
from .lowlevel.arrays import array
from .lowlevel.jit import addressed, inner, named
from .matrices.matrix import scatter
from .matrices.symmetric import in_band, in_fronts, rows_in
from .points import weights_of_item


@inner
def place_moving(p, d, amps):  # type: ignore[no-untyped-def]
    """Update coordinates, weights, p0 and drift of all moving points in the table of point laws, at d (n_full,)."""
    if len(p.moving.item) > 0:
        calls.place_moving(p.calls, (p, d, amps))


@addressed
def _place_all(p, d, amps):  # type: ignore[no-untyped-def]
    for j in range(len(p.moving.item)):
        if p.moving.element[j] >= 0:
            _place(p, j, d, amps)


@inner
def _place(p, j, d, amps):  # type: ignore[no-untyped-def]
    moving, points = p.moving, p.points
    m, i, k = moving.element[j], moving.item[j], moving.signal[j]
    e, shapes, terms, sign = moving.begin[j] + m, moving.shapes[j], moving.terms[j], moving.sign[j]
    scale = 2.0 / moving.lengths[e]
    z = (amps[k, 0] - moving.starts[e]) * scale - 1.0
    first, field, where = points.dof[i], points.field[i], moving.dof_first[j] + m * shapes
    G = weights_of_item(points, i)
    for c in range(2):
        points.p0[field + c], points.drift[field + c] = moving.base[j, c], 0.0
        for r in range(moving.derivatives[j]):
            points.p0[field + 2 * (r + 1) + c] = 0.0
    for q in range(shapes):
        s0, s1, s2 = 0.0, 0.0, 0.0
        for t in range(terms - 1, -1, -1):
            s2 = s2 * z + 2.0 * s1
            s1 = s1 * z + s0
            s0 = s0 * z + moving.coef[moving.coef_first[e] + q * terms + t]
        s0, s1, s2 = sign * s0, sign * s1 * scale, sign * s2 * scale * scale
        for c in range(2):
            dof = moving.dofs[where + q, c]
            points.dofs[first + 2 * q + c] = dof
            G[2 * q + c, c] = s0
            points.p0[field + c] += s0 * p.e0[dof]
            points.drift[field + c] += amps[k, 1] * s1 * (p.e0[dof] + d[dof])
            if moving.derivatives[j] > 0:
                G[2 * q + c, 2 + c] = s1
                G[2 * q + c, 4 + c] = s2
                points.p0[field + 2 + c] += s1 * p.e0[dof]
                points.p0[field + 4 + c] += s2 * p.e0[dof]
    if moving.stretches[j] != 0:
        points.par[i, 1] = math.sqrt(points.p0[field]**2 + points.p0[field + 1]**2)


@inner
def _coordinate(p, c, x, amps, order):  # type: ignore[no-untyped-def]
    """Return full coordinate c from the unknowns x; with ``order`` > 0 add its prescribed rate of that order."""
    k, s = p.place[c], 0.0
    if k >= 0:
        return x[k]
    if k <= -2:
        for m in range(p.indptr[-2 - k], p.indptr[-1 - k]):
            s += p.value[m] * x[p.index[m]]
    if order > 0:
        for m in range(len(p.motion_coord)):
            if p.motion_coord[m] == c:
                s += p.motion_factor[m] * amps[p.motion_signal[m], order]
    return s


@inner
def _of_point(p, j, x, amps, order):  # type: ignore[no-untyped-def]
    """Return both components of S x at point j, with x and ``order`` as in ``_coordinate``."""
    points, i = p.points, p.moving.item[j]
    first, G = points.dof[i], weights_of_item(points, i)
    out_x, out_y = 0.0, 0.0
    for c in range(len(G)):
        u = _coordinate(p, points.dofs[first + c], x, amps, order)
        out_x += G[c, 0] * u
        out_y += G[c, 1] * u
    return out_x, out_y


@inner
def moving_inertia(p, amps, a, Q):  # type: ignore[no-untyped-def]
    """Add m S^T S q'' of the moving masses to Q (n_full,), from second rates a (n,) of the unknowns."""
    if len(p.moving.fixed) > 0:
        calls.moving_inertia(p.calls, (p, amps, a, Q))


@addressed
def _inertia(p, amps, a, Q):  # type: ignore[no-untyped-def]
    for j in range(len(p.moving.item)):
        m = p.moving.mass[j]
        if m > 0.0 and p.moving.element[j] >= 0:
            ax, ay = _of_point(p, j, a, amps, 2)
            points, i = p.points, p.moving.item[j]
            first, G = points.dof[i], weights_of_item(points, i)
            for c in range(len(G)):
                Q[points.dofs[first + c]] += m * (G[c, 0] * ax + G[c, 1] * ay)


@inner
def add_moving_product(p, x, y):  # type: ignore[no-untyped-def]
    """Add the mass matrix of the moving masses, where they were placed last, times x (n,) to y (n,)."""
    if len(p.moving.fixed) > 0:
        calls.moving_product(p.calls, (p, x, y))


@addressed
def _product(p, x, y):  # type: ignore[no-untyped-def]
    for j in range(len(p.moving.item)):
        m = p.moving.mass[j]
        if m > 0.0 and p.moving.element[j] >= 0:
            ax, ay = _of_point(p, j, x, p.mass_diagonals, 0)
            points, i = p.points, p.moving.item[j]
            first, G = points.dof[i], weights_of_item(points, i)
            for c in range(len(G)):
                f = m * (G[c, 0] * ax + G[c, 1] * ay)
                k = p.place[points.dofs[first + c]]
                if k >= 0:
                    y[k] += f
                elif k <= -2:
                    for q in range(p.indptr[-2 - k], p.indptr[-1 - k]):
                        y[p.index[q]] += p.value[q] * f


def _with_matrix(stored: Any, kind: str) -> Any:
    """Return the function that adds the mass matrix of the moving masses to matrices of one kind."""
    def moving_mass(p, factor, A):  # type: ignore[no-untyped-def]
        most = 0
        for i in p.moving.item:
            most = max(most, p.points.dof[i + 1] - p.points.dof[i])
        room = array(most, most)
        for j in range(len(p.moving.item)):
            m = p.moving.mass[j] * factor
            if m > 0.0 and p.moving.element[j] >= 0:
                points, i = p.points, p.moving.item[j]
                first, G = points.dof[i], weights_of_item(points, i)
                n = len(G)
                for a in range(n):
                    for b in range(n):
                        room[a, b] = m * (G[a, 0] * G[b, 0] + G[a, 1] * G[b, 1])
                dofs = points.dofs[first:first + n].reshape((1, n))
                scatter(stored(p, A), room, dofs, 0, rows_in(p))

    return addressed(named(moving_mass, kind))


_MOVING_MASS = _with_matrix(in_band, "band"), _with_matrix(in_fronts, "fronts")


def moving_functions(fronts: bool, has_masses: bool, problem: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the entries for moving points and their masses of the table of a model (``kernels.calls.table``)."""
    out: dict[Any, tuple[Any, ...]] = {calls.place_moving: (_place_all, problem)}
    if has_masses:
        out |= {calls.moving_mass: (_MOVING_MASS[fronts], problem), calls.moving_inertia: (_inertia, problem),
                calls.moving_product: (_product, problem)}
    return out
