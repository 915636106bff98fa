"""How deep bodies are in one another, from points of one and straight segments of the curves of the other."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..elements.formulations.base import cross
from ..elements.shape import Array
from ..model.mesh import BodyMesh
from .contact_curves import curve_rows, height_along

# positions along each element of a body's axis
ALONG = 8
# relative to a height: distance along a body from a fold or joint within which its parts overlap as they fold
FOLDED = np.pi


def greatest_depth(pair: Any, d: Array | None, least: float, side: str) -> tuple[float, float]:
    """Return the greatest depth of a point of a ``body_contact.BodyPair`` in its other body, and S of this point.

    It is taken in the reference, or at d (n_full,), less the possible distance of the segments from the curves. Points
    that are less than ``least`` deep may be left out; without any other, the result is 0. At d, those near joints of
    both bodies are, which overlap there as they fold.
    """
    if side == "axis":
        return 0.0, 0.0
    if pair.against is pair.mesh:
        return _depth_in_itself(pair, d)
    a, b = pair.segments(d)
    each = len(a) // len(pair.curves)
    # the distance of a chord from an arc is bounded by the rotation to the next chord
    turn = np.abs(cross(b[:-1] - a[:-1], b[1:] - a[1:])) * (np.hypot(*(b[:-1] - a[1:]).T) < 1e-12 * pair.scale)
    off = float((turn / np.hypot(*(b - a).T)[:-1])[np.arange(1, len(a)) % each > 0].max(initial=0.0))
    arm, places = np.repeat(np.arange(len(pair.arms)), np.array(pair.arms) * each), pair.places(d)
    deepest, at = 0.0, 0.0
    near = _near_points(pair, places, a, b, least)
    for k in near[_is_off_joints(pair, near)].tolist() if d is not None else near.tolist():
        p = places[k]
        above = (a[:, 1] > p[1]) != (b[:, 1] > p[1])
        with np.errstate(divide="ignore", invalid="ignore"):
            x = a[:, 0] + (p[1] - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
        inside = np.flatnonzero(np.bincount(arm, above & (x > p[0])) % 2)
        depth = max((nearest_on_segments(p, a[arm == k], b[arm == k])[0].min() for k in inside), default=0.0) - off
        if depth > deepest:
            deepest, at = float(depth), float(pair.s[k])
    return deepest, at


def greatest_height(mesh: BodyMesh) -> float:
    """Return a bound on the height of a body [m]."""
    return max(float(np.abs(height_along(mesh, ie)).sum()) for ie in range(len(mesh.dofs))) * mesh.plan.section.height


def _is_off_joints(pair: Any, points: Any) -> Any:
    """Return whether points (k,) are not beside a joint of the bodies, so that they can be deep only by contact."""
    far, s = FOLDED * pair.mesh.plan.section.height, pair.s[points] * pair.mesh.plan.length
    return (np.abs(s[:, None] - [at for at, _ in pair.excluded]) >= far).all(axis=1)


def _near_points(pair: Any, places: Array, a: Array, b: Array, least: float) -> Any:
    """Return the points (k,) at ``places`` that may be at least so deep: their distances from the surface allow it."""
    low, high = np.minimum(a, b).min(axis=0), np.maximum(a, b).max(axis=0)
    some = np.flatnonzero(((places >= low) & (places <= high)).all(axis=1))
    if not len(some):
        return some
    from scipy.spatial import cKDTree

    distance = cKDTree(0.5 * (a + b)).query(places[some])[0]
    # within a body, the surface is at most half its height away
    within = distance - 0.5 * float(np.hypot(*(b - a).T).max()) <= pair.height
    return some[within & (distance >= least)]


def _depth_in_itself(pair: Any, d: Array | None) -> tuple[float, float]:
    """Return the greatest depth of a body in itself, by distances of places of its axis, and S of one of them."""
    from scipy.spatial import cKDTree

    mesh, z, height = pair.mesh, np.linspace(-1.0, 1.0, ALONG + 1)[:-1], pair.mesh.plan.section.height
    places, s = [], (mesh.starts[:, None] + 0.5 * (z + 1.0) * mesh.lengths[:, None]).ravel()
    for ie, dofs in enumerate(mesh.dofs):
        rows, terms, _ = curve_rows(mesh, ie, 0.0)
        c = rows[:2 * terms] @ (mesh.e0[dofs - mesh.first_dof] + (0.0 if d is None else d[dofs]))
        places.append(np.vander(z, terms, increasing=True) @ c.reshape(2, terms).T)
    near = cKDTree(np.concatenate(places)).sparse_distance_matrix(cKDTree(np.concatenate(places)), height).tocoo()
    along = np.abs(s[near.row] - s[near.col])
    if mesh.plan.closed:
        along = np.minimum(along, mesh.plan.length - along)
    for at, far in pair.excluded:
        along[np.abs(s[near.row] - at) < far] = 0.0
    apart = np.flatnonzero(along > FOLDED * height)
    if not len(apart):
        return 0.0, 0.0
    k = apart[np.argmin(near.data[apart])]
    return float(height - near.data[k]), float(s[near.row[k]] / mesh.plan.length)


def nearest_on_segments(p: Array, a: Array, b: Array) -> tuple[Array, Array]:
    """Return the distances (n,) of a point from segments from a to b (n, 2), and the nearest places on them, 0 to 1."""
    z = np.clip(np.einsum("nc,nc->n", p - a, b - a) / np.einsum("nc,nc->n", b - a, b - a), 0.0, 1.0)
    return np.hypot(*(p - a - z[:, None] * (b - a)).T), z
