"""The shape of a body from its nodal coordinates, and the values that figures can show of its fields."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.polynomial.legendre import legvander

from ancf2d.results.records import BodyRecord, FieldRecord

DEGREE = 12  # along the element: no basis has a higher power
STEP = 1e-30  # complex step: its square is lost to round-off
BLOCK = 4096  # number of elements evaluated at a time, which bounds the memory of the gathered shape functions
# coordinates that are not finite or nearly so give NaN points, which figures leave out
_beyond_numbers = np.errstate(over="ignore", invalid="ignore")


def _interpolated(body: BodyRecord, part: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.einsum("mask,mkc->amsc", body.sample_S[body.classes[part]], x)


def _offset(body: BodyRecord, part: np.ndarray, axis: np.ndarray, normal: np.ndarray) -> np.ndarray:
    if body.levels is None:
        y = np.multiply.outer([-0.5, 0.0, 0.5], body.heights_of(part))
    else:
        y = np.broadcast_to(body.levels[:, None, None], (len(body.levels), *axis.shape[:-1]))
    return np.asarray(axis + y[..., None] * normal)


def _tangent(body: BodyRecord, part: np.ndarray, x: np.ndarray) -> np.ndarray:
    cls = body.classes[part]
    axis = np.einsum("msk,mkc->msc", body.sample_S[cls, 1], x)
    r_x = np.einsum("msk,mkc->msc", body.sample_S_x[cls], x)
    # scaled by the larger component, so that squares do not overflow; sqrt also works for the complex step of
    # body_rates
    largest = np.abs(r_x.real).max(axis=-1, keepdims=True)
    r_x /= np.where(largest == 0, 1.0, largest)
    length = np.sqrt(r_x[..., 0]**2 + r_x[..., 1]**2)
    length[length == 0] = 1.0
    normal = np.stack([-r_x[..., 1], r_x[..., 0]], -1) / length[..., None]
    return _offset(body, part, axis, normal)


def _theta(body: BodyRecord, part: np.ndarray, x: np.ndarray) -> np.ndarray:
    values = np.einsum("msk,mkc->msc", body.sample_S[body.classes[part], 1], x)
    axis, angle = values[..., :2], values[..., 2]
    return _offset(body, part, axis, np.stack([-np.sin(angle), np.cos(angle)], -1))


# the only place where a kind of section is added (and its name in records.SECTION_KINDS)
SECTIONS: dict[str, Callable[[BodyRecord, np.ndarray, np.ndarray], np.ndarray]] = {
    "interpolated": _interpolated, "tangent": _tangent, "theta": _theta,
}


def body_faces(body: BodyRecord, e: np.ndarray,
               elements: slice | np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Return points on axis, upper face (top) and lower face (bottom) of a body.

    e (nq,): nodal coordinates; ``elements`` selects some elements. Each entry is (ne, ns, 2) [length].
    """
    return dict(zip(("bottom", "axis", "top"), body_levels(body, e, elements), strict=False))


@_beyond_numbers
def body_levels(body: BodyRecord, e: np.ndarray, elements: slice | np.ndarray | None = None) -> np.ndarray:
    """Return points (3 + k, ne, ns, 2) [length] on bottom, axis, top and the k interfaces between layers of a body."""
    chosen = np.arange(len(body.dofs))[elements if elements is not None else slice(None)]
    out = np.empty((body.sample_S.shape[1], len(chosen), len(body.sample_xi), 2), np.result_type(e, float))
    for start in range(0, len(chosen), BLOCK):
        part = chosen[start:start + BLOCK]
        x = e[body.dofs[part]].reshape(len(part), -1, body.components)
        out[:, start:start + len(part)] = SECTIONS[body.section_kind](body, part, x)
    return out


@_beyond_numbers
def body_rates(body: BodyRecord, e: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the rates of the points of ``body_levels`` for rates v (nq,) of the nodal coordinates."""
    # complex step: without a difference of real parts, the derivative is exact to round-off for any section
    return np.asarray(body_levels(body, e + 1j * STEP * v).imag / STEP)


def axis_shapes(body: BodyRecord, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return coordinates (n, k, 2) and shape functions (n, k) of the axis at fractions s (n,) of a body's arc length.

    The sampled shape functions are interpolated by the polynomial through the samples, exact up to degree DEGREE along
    the element.
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

    q (nq,): nodal coordinates, or their displacements to obtain displacements of the axis.
    """
    out = np.empty((len(s), 2))
    for start in range(0, len(s), BLOCK):
        part = slice(start, start + BLOCK)
        dofs, shapes = axis_shapes(body, s[part])
        out[part] = np.einsum("mk,mkc->mc", shapes, q[dofs])
    return out


def body_nodes(body: BodyRecord, e: np.ndarray) -> np.ndarray:
    """Return the positions (n, 2) [length] of the nodes of a body, each once, in the order of their numbers."""
    _, first = np.unique(body.nodes.ravel(), return_index=True)
    ie, k = np.divmod(first, body.nodes.shape[1])
    column = body.node_shape[k] * body.components
    return np.stack([e[body.dofs[ie, column + c]] for c in (0, 1)], -1)


POSITIVE = ("mises", "energy", "pressure")  # never below zero
Formula = Callable[[np.ndarray], np.ndarray]


def _one(s: np.ndarray, k: int) -> np.ndarray:
    return s[..., k]


def mises(s: np.ndarray) -> np.ndarray:
    """Return the von Mises equivalents of stresses (..., 3)."""
    xx, yy, xy = s[..., 0], s[..., 1], s[..., 2]
    return np.sqrt(np.maximum(xx**2 - xx * yy + yy**2 + 3.0 * xy**2, 0.0))


# values derived from the stored components, by field
DERIVED: dict[str, dict[str, Formula]] = {"stress": {"mises": mises}}
LABELS = {("stress", "xx"): "stress along the axis, σ_xx", ("stress", "yy"): "stress across the axis, σ_yy",
          ("stress", "xy"): "shear stress, σ_xy", ("stress", "mises"): "von Mises stress",
          ("strain", "xx"): "strain along the axis, ε_xx", ("strain", "yy"): "strain across the axis, ε_yy",
          ("strain", "xy"): "shear strain, 2 ε_xy", ("energy", "energy"): "strain energy density",
          ("plastic_strain", "xx"): "plastic strain along the axis",
          ("N", "N"): "axial force N", ("Q", "Q"): "shear force Q", ("M", "M"): "bending moment M",
          ("pressure", "pressure"): "pressure of contact per length", ("gap", "gap"): "gap",
          ("traction", "traction"): "friction per length"}


def formulas_of(record: FieldRecord) -> dict[str, Formula]:
    """Return the functions for the values that a field can show, by name: stored components, then derived values."""
    formulas: dict[str, Formula] = {c: partial(_one, k=k) for k, c in enumerate(record.components)}
    return formulas | DERIVED.get(record.name, {})


def label_of(field: str, component: str) -> str:
    """Return the label of a component of a field for figures."""
    return LABELS.get((field, component), f"{field} {component}")


def linear_weights(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return weights (len(at), n) for piecewise linear interpolation of values at ``nodes`` (n,), in any order."""
    order = np.argsort(nodes, kind="stable")
    return np.stack([np.interp(at, nodes[order], one) for one in np.eye(len(nodes))[:, order]], axis=-1)


def station_weights(stations: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return weights (len(at), n) for interpolating values at stations (n,); both are fractions in [0, 1].

    Evenly spaced stations are interpolated by one polynomial, others piecewise linearly: these are quadrature points of
    fibres, whose stress has kinks. Raises ValueError if stations coincide.
    """
    steps = np.diff(np.sort(stations))
    if not len(stations) or (steps <= 0.0).any():
        raise ValueError("stations coincide, or there are none")
    if len(steps) and np.ptp(steps) > 1e-9 * steps.max():
        return linear_weights(stations, at)
    low, size = float(stations.min()), float(np.ptp(stations)) or 1.0
    return even_weights(len(stations), (at - low) / size)[:, np.argsort(np.argsort(stations))]


def weights_along(record: FieldRecord, at: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Return the weights of ``station_weights`` (len(at), n) for a field along elements (m,).

    Where each element has stations of its own, as for fibres, they are (m, len(at), n). Beyond the outermost stations
    the values are then constant, since plastic strain does not change its sign there.
    """
    if record.xi.ndim == 1:
        return station_weights(record.xi, at)
    rows, which = np.unique(record.xi[elements], axis=0, return_inverse=True)
    return np.stack([linear_weights(row, at) for row in rows])[which.ravel()]


def even_weights(n: int, at: np.ndarray) -> np.ndarray:
    """Return weights (len(at), n) of the polynomial through n evenly spaced values, at fractions in [0, 1]."""
    x, powers = np.linspace(-1.0, 1.0, n), np.arange(n)
    return ((2 * at - 1)[:, None] ** powers) @ np.linalg.inv(x[:, None] ** powers)
