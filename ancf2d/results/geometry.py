"""The shape of a body from its nodal coordinates: axis, faces, nodes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial.legendre import legvander

from ancf2d.results.records import BodyRecord

DEGREE = 12  # along the element: no basis has a higher power
STEP = 1e-30  # its square is nothing beside any coordinate
BLOCK = 4096  # elements at a time: bounds the memory of the gathered shape functions
# where coordinates are not finite, or next to it, points are not numbers: those who draw leave them out
_beyond_numbers = np.errstate(over="ignore", invalid="ignore")


def _interpolated(body: BodyRecord, part: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, ...]:
    points = np.einsum("mask,mkc->amsc", body.sample_S[body.classes[part]], x)
    return points[0], points[1], points[2]


def _offset(axis: np.ndarray, normal: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, ...]:
    half = 0.5 * heights[..., None]
    return axis - half * normal, axis, axis + half * normal


def _tangent(body: BodyRecord, part: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, ...]:
    cls = body.classes[part]
    axis = np.einsum("msk,mkc->msc", body.sample_S[cls, 1], x)
    r_x = np.einsum("msk,mkc->msc", body.sample_S_x[cls], x)
    # by its larger component first, so that no square is too large; a plain root, for ``body_rates``
    largest = np.abs(r_x.real).max(axis=-1, keepdims=True)
    r_x /= np.where(largest == 0, 1.0, largest)
    length = np.sqrt(r_x[..., 0]**2 + r_x[..., 1]**2)
    length[length == 0] = 1.0
    normal = np.stack([-r_x[..., 1], r_x[..., 0]], -1) / length[..., None]
    return _offset(axis, normal, body.heights_of(part))


def _theta(body: BodyRecord, part: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, ...]:
    values = np.einsum("msk,mkc->msc", body.sample_S[body.classes[part], 1], x)
    axis, angle = values[..., :2], values[..., 2]
    return _offset(axis, np.stack([-np.sin(angle), np.cos(angle)], -1), body.heights_of(part))


# the one place where a kind of section is added (with its name in records.SECTION_KINDS)
SECTIONS: dict[str, Callable[[BodyRecord, np.ndarray, np.ndarray], tuple[np.ndarray, ...]]] = {
    "interpolated": _interpolated, "tangent": _tangent, "theta": _theta,
}


@_beyond_numbers
def body_faces(body: BodyRecord, e: np.ndarray,
               elements: slice | np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Return points on axis, top (y = h/2) and bottom (y = -h/2) of a body.

    e (nq,): nodal coordinates; ``elements`` selects some. Each entry is (ne, ns, 2) [length].
    """
    chosen = np.arange(len(body.dofs))[elements if elements is not None else slice(None)]
    shape = (len(chosen), len(body.sample_xi), 2)
    faces = {name: np.empty(shape, np.result_type(e, float)) for name in ("bottom", "axis", "top")}
    for start in range(0, len(chosen), BLOCK):
        part = chosen[start:start + BLOCK]
        x = e[body.dofs[part]].reshape(len(part), -1, body.components)
        points = SECTIONS[body.section_kind](body, part, x)
        for name, values in zip(faces, points, strict=True):
            faces[name][start:start + len(part)] = values
    return faces


@_beyond_numbers
def body_rates(body: BodyRecord, e: np.ndarray, v: np.ndarray,
               elements: slice | np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Return the rates of the points of ``body_faces`` where the nodal coordinates change by v (nq,) per unit."""
    # a complex step: what is real is not touched, so that the derivative is exact to round-off for any section
    moved = body_faces(body, e + 1j * STEP * v, elements)
    return {name: values.imag / STEP for name, values in moved.items()}


def axis_shapes(body: BodyRecord, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return coordinates (n, k, 2) and shape functions (n, k) of the axis at fractions s (n,) of a body's arc length.

    The samples of the shape functions are continued between their points by the polynomial through them, exact up to
    DEGREE along the element.
    """
    ne = len(body.dofs)
    ie = np.clip(np.searchsorted(body.arclength, s, side="right") - 1, 0, ne - 1)
    xi = (s - body.arclength[ie]) / (body.arclength[ie + 1] - body.arclength[ie])
    degree = min(len(body.sample_xi) - 1, DEGREE)
    # Legendre polynomials: powers of xi would lose digits
    fit = np.linalg.pinv(legvander(2 * body.sample_xi - 1, degree))
    weights = legvander(2 * xi - 1, degree) @ fit
    shapes = np.einsum("mi,mik->mk", weights, body.sample_S[body.classes[ie], 1])
    return body.dofs[ie].reshape(len(s), -1, body.components)[..., :2], shapes


@_beyond_numbers
def axis_values(body: BodyRecord, q: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Return the axis (n, 2) [length] of a body at fractions s (n,) of its arc length in [0, 1].

    q (nq,): nodal coordinates, or displacements of them for displacements.
    """
    out = np.empty((len(s), 2))
    for start in range(0, len(s), BLOCK):
        part = slice(start, start + BLOCK)
        dofs, shapes = axis_shapes(body, s[part])
        out[part] = np.einsum("mk,mkc->mc", shapes, q[dofs])
    return out


def body_nodes(body: BodyRecord, e: np.ndarray) -> np.ndarray:
    """Return the node positions (n, 2) [length] of a body, each once, in order of their numbers."""
    _, first = np.unique(body.nodes.ravel(), return_index=True)
    ie, k = np.divmod(first, body.nodes.shape[1])
    column = body.node_shape[k] * body.components
    return np.stack([e[body.dofs[ie, column + c]] for c in (0, 1)], -1)
