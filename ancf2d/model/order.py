"""The order of the unknowns: as the bodies run, or reverse Cuthill-McKee where that makes the band narrower."""

from __future__ import annotations

import numpy as np

from ..elements.definition import derivative_order
from ..elements.shape import Array
from .mesh import BodyMesh, Index, shape_weights

# a hundred times what is left of increments, beside the scene's extent
LEFT = 1e-8


def half_bandwidth(position: Index, sets: list[Index]) -> int:
    """Return the largest distance between unknowns that share a row of a set (m, n); -1 marks no unknown."""
    width = 0
    for rows in sets:
        if rows.size == 0 or position.size == 0:
            continue
        places = np.where(rows >= 0, position[rows], -1)
        high = places.max(axis=1)
        low = np.where(places >= 0, places, np.iinfo(np.int64).max).min(axis=1)
        used = high >= 0
        if used.any():
            width = max(width, int((high[used] - low[used]).max()))
    return width


def _cuthill_mckee(n: int, sets: list[Index]) -> Index:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    i, j = [np.arange(n)], [np.arange(n)]
    for rows in sets:
        a = np.repeat(rows, rows.shape[1], axis=1).ravel()
        b = np.tile(rows, (1, rows.shape[1])).ravel()
        used = (a >= 0) & (b >= 0)
        i.append(a[used])
        j.append(b[used])
    rows_, columns = np.concatenate(i), np.concatenate(j)
    graph = coo_matrix((np.ones(len(rows_), dtype=np.int8), (rows_, columns)), shape=(n, n)).tocsr()
    return np.asarray(reverse_cuthill_mckee(graph, symmetric_mode=True), dtype=np.int64)


def order_unknowns(n: int, sets: list[Index], narrow: int) -> tuple[Index, int]:
    """Return the position of each unknown and the half-bandwidth.

    ``sets`` are arrays (m, k) of unknowns that meet in one matrix entry, -1 for none. ``narrow`` is the
    bandwidth that a single chain has: where the natural order reaches it, nothing is reordered.
    """
    natural = np.arange(n, dtype=np.int64)
    width = half_bandwidth(natural, sets)
    if width <= narrow or n <= 1:
        return natural, width
    position = np.empty(n, dtype=np.int64)
    position[_cuthill_mckee(n, sets)] = natural
    better = half_bandwidth(position, sets)
    return (position, better) if better < width else (natural, width)


def coordinate_weights(mesh: BodyMesh) -> Array:
    """Return the displacement that a unit of each coordinate stands for: 1 for r, l for r_x, h/2 for r_y, ... [m]."""
    element, half = mesh.plan.element, mesh.plan.section.height / 2
    pattern: list[float] = []
    for w in shape_weights(mesh).tolist():
        pattern += [w, w] if element.components == 2 else [w, w, half]
    return mesh.tile(pattern)


def straining_weights(mesh: BodyMesh, extent: float) -> Array:
    """Return ``coordinate_weights`` by which Newton's increments may be judged, in a scene of such an extent [m].

    A section that turns or stretches by itself strains by w/(h/2), w its weight; over an element of length l so does a
    displacement of w l/(h/2), which is what it counts as in slender elements: EA times strains that are left has to be
    small beside the bending stiffness EI/l^2 = EA (h/l)^2/12.
    """
    half, l = mesh.plan.section.height / 2, max(p.l for p in mesh.plan.pieces)
    longer = max(1.0, min(l, LEFT * extent * 3.0 * (l / half) ** 2) / half) if half > 0.0 else 1.0
    pattern: list[float] = []
    for _, j in (derivative_order(name) for _, name in mesh.plan.element.functionals):
        share = longer if j > 0 else 1.0
        pattern += [share, share] if mesh.plan.element.components == 2 else [share, share, longer]
    return coordinate_weights(mesh) * mesh.tile(pattern)
