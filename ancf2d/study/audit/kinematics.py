"""Checks of basis and nodal coordinates alone: properties of the shape functions."""

from __future__ import annotations

import numpy as np

from ...elements.shape import Array, gauss
from ...model.own_element import SINGULAR, condition, rank
from .fields import displacement_rows, linear_field, points_over, rigidly_moved
from .subject import FAIL, NOTE, NU, PASS, ROUND_OFF, Finding, Subject, judged

# lengths relative to the height, and Poisson ratios, for which a basis must keep its rank
LENGTHS = (0.1, 1.0, 100.0)
RATIOS = (0.0, 0.3, 0.49)
WELL = 1e8


def solvability(s: Subject) -> Finding:
    """Examine the matrix of the nodal coordinates applied to the basis: the worst condition number."""
    found = {(nu, l): condition(s.element, l, nu) for nu in RATIOS for l in LENGTHS}
    (nu, length), worst = max(found.items(), key=lambda item: item[1])
    if s.flaw is not None:
        n = s.element.n_shape
        return Finding(max(worst, SINGULAR), FAIL, "the nodal coordinates do not determine the basis: their matrix has "
                       f"rank {rank(s.element, 1.0, NU)} of {n}")
    if worst >= SINGULAR:
        return Finding(worst, FAIL, f"the nodal coordinates do not determine the basis where nu = {nu:g} (length "
                       f"{length:g} h)")
    if worst > WELL:
        return Finding(worst, NOTE, f"nearly singular (nu = {nu:g}, length {length:g} h), so digits are lost")
    return Finding(worst, PASS, "the nodal coordinates determine the basis")


def completeness(s: Subject) -> Finding:
    """Examine whether the shape functions reproduce linear fields from their nodal coordinates."""
    model = s.free(1.0, 1)
    mesh, shape = model.meshes["beam"], s.shape(1.0)
    xi, eta = points_over(s.element)
    rows = displacement_rows(mesh, shape, xi, eta)
    across = s.element.section_kind == "interpolated"
    shift = (1.0, -0.5)
    moved = rigidly_moved(model, np.zeros(model.n_q), 0.0, shift)
    worst = float(np.abs(np.einsum("pcn,n->pc", rows, moved) - np.array(shift)).max())
    for a, b in ((0, 0), (1, 0), (0, 1), (1, 1)):
        G = np.zeros((2, 2))
        G[a, b] = 1.0
        # a rigid section does not change its height, and that of a cable rotates with the axis
        if not across and (b == 1 or not s.element.has_theta):
            G = np.array([[1.0, 0.0], [0.0, 0.0]]) if a == b else np.array([[0.0, -1.0], [1.0, 0.0]])
        d = linear_field(model, G)
        field = np.stack([xi, 0.5 * eta], axis=1) @ G.T
        worst = max(worst, float(np.abs(np.einsum("pcn,n->pc", rows, d) - field).max()))
    return judged(worst, ROUND_OFF, "represents every linear field, including its straight reference",
                  "does not represent all linear fields, so constant strains are missing")


def _change(s: Subject, along: float, across: float) -> float:
    """Return the part of mirrored shapes outside the span: the sine of the largest angle between both spaces."""
    worst = 0.0
    x, wx = gauss(s.element.degree_x + 2)
    y, wy = gauss(s.element.degree_y + 2)
    xi, eta = np.repeat(2 * x - 1, len(y)), np.tile(2 * y - 1, len(x))
    root = np.sqrt(np.outer(wx, wy).ravel())[:, None]
    for length in (1.0, 5.0):
        shape = s.shape(length)
        V, R = np.linalg.qr(root * shape((1 + xi) / 2, eta))
        W = np.linalg.solve(R.T, (root * shape((1 + along * xi) / 2, across * eta)).T).T
        worst = max(worst, float(np.linalg.norm(W - V @ (V.T @ W), 2)))
    return worst


def reversal(s: Subject) -> Finding:
    """Examine whether swapping the ends, S(xi) -> S(-xi), gives the same space of shapes."""
    change = _change(s, -1.0, 1.0)
    if change <= ROUND_OFF:
        return Finding(change, PASS, "swapping the ends gives the same element")
    forth, back = (_tip(s, wall) for wall in (0, 1))
    return Finding(change, FAIL, "not symmetric: swapping the ends changes the shape functions, and the tip deflection "
                   f"of a cantilever of 4 elements in large bending by {abs(back / forth - 1):.1e} of itself")


def _tip(s: Subject, wall: int) -> float:
    """Return the large deflection of a cantilever of four elements, clamped at either end."""
    from .fields import FAR, LARGE, deflected, deflection

    model, d = deflected(s, 10.0, 4, FAR / 1200.0, LARGE, wall=wall)
    return deflection(model, d, wall)


def mirror(s: Subject) -> Finding:
    """Examine whether y -> -y gives the same space of shapes."""
    return judged(_change(s, 1.0, -1.0), ROUND_OFF, "the element is symmetric about its axis",
                  "not symmetric about its axis: exchanging y and -y changes the shape functions")


def _jump(s: Subject, i: int, eta: Array) -> float:
    """Return the largest jump of l^i d^i r/dx^i between neighbours, per unit displacement of a scaled coordinate.

    Both elements have the coordinates of the shared node in common; all others are independent.
    """
    length = 1.0
    shape, weights = s.shape(length), s.free(length, 1).weights[::s.element.components]
    ends = [shape(np.full_like(eta, x), eta, i, 0) * length**i / weights for x in (0.0, 1.0)]
    shared = sum(node == 0 for node, _ in s.element.functionals)
    own = np.abs(ends[0][:, :shared] - ends[1][:, -shared:]).max()
    foreign = max(np.abs(ends[0][:, shared:]).max(initial=0.0), np.abs(ends[1][:, :-shared]).max(initial=0.0))
    return float(max(own, foreign))


def _across(s: Subject) -> Array:
    return np.linspace(-1.0, 1.0, 5) if s.element.section_kind == "interpolated" else np.zeros(1)


def position_continuity(s: Subject) -> Finding:
    """Examine whether neighbours share the whole of their common section."""
    jump = _jump(s, 0, _across(s))
    axis = _jump(s, 0, np.zeros(1))
    if jump <= ROUND_OFF:
        return Finding(jump, PASS, "conforming: neighbours share their whole end faces")
    where = "off the axis" if axis <= ROUND_OFF else "on the axis too"
    return Finding(jump, FAIL, f"nonconforming: end faces of neighbours separate {where} (jump per displacement of a "
                   "node)")


def slope_continuity(s: Subject) -> Finding:
    """Examine whether r_x is continuous between elements."""
    jump, axis = _jump(s, 1, _across(s)), _jump(s, 1, np.zeros(1))
    if jump <= ROUND_OFF:
        return Finding(jump, PASS, "r_x is continuous over the whole section")
    if axis <= ROUND_OFF:
        return Finding(jump, NOTE, "r_x is continuous on the axis, but jumps off it")
    return Finding(jump, NOTE, "r_x jumps between neighbours: the axis has kinks, which vanish under refinement")
