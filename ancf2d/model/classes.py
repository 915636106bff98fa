"""Classes of elements that share their shape functions and reference, and their mass matrices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ..elements.formulations import Sampler
from ..elements.formulations.base import across_mass, cross, product_points
from ..elements.registry import RIGID_FRAME, RIGID_TYPE
from ..elements.shape import Array, ShapeFunctions, gauss, lobatto

T = TypeVar("T")
# additional points along a section that varies, to integrate its mass; points along a rigid body
MORE, RIGID_POINTS = 3, 20


@dataclass(frozen=True)
class ElementClass:
    """Elements with the same shape functions and, up to a rotation, the same reference: equal length and curvature.

    ``key`` distinguishes the classes within a pool. It has the section, the length rounded to mesh accuracy, the
    curvature (or, if that changes along the element, the axis and the place on it) and, if the section varies along the
    element, the body's name and the element's start. ``turn`` is the angle by which the axis turns along the element.
    """

    sampler: Sampler
    key: tuple[Any, ...]
    turn: float

    @property
    def mass(self) -> Array:
        """The mass matrix (n_dof, n_dof) of an element in its own frame."""
        return self._inertia[0]

    @property
    def mass_weights(self) -> Array:
        """int rho s_k dV of an element (n_shape,) [kg]."""
        return self._inertia[1]

    @cached_property
    def _inertia(self) -> tuple[Array, Array]:
        volume = over_body(self.sampler)
        return mass_matrix(self.sampler, volume), volume.dm @ volume.S

    @cached_property
    def _found(self) -> dict[Any, Any]:
        return {}

    def once(self, key: Any, find: Callable[[], T]) -> T:
        """Return the result of ``find`` for the class, computed once per key; models that share the class share it."""
        if key not in self._found:
            self._found[key] = find()
        found: T = self._found[key]
        return found

    @property
    def shape(self) -> ShapeFunctions:
        """Shape functions of the class."""
        return self.sampler.shape


class Volume(NamedTuple):
    """Quadrature of the mass of an element: S (points, n_shape), mass ``dm`` and rotary inertia ``dI`` (points,) of
    each point."""

    S: Array
    dm: Array
    dI: Array


def over_body(sampler: Sampler, upto: float = 1.0, ends: bool = False) -> Volume:
    """Return the mass quadrature of an element.

    ``upto`` ends the volume at a fraction of the element's length. With ``ends``, the points along the element are the
    degree + 1 Gauss-Lobatto points, which integrate S^T S inexactly (one degree short).
    """
    element = sampler.shape.element
    along = lobatto(element.degree_x + 1) if ends else along_mass(sampler, upto)
    # a rigid body has its mass on the axis, and a rotary inertia
    on_axis = element.degree_y == 0 or element is RIGID_FRAME
    xi, eta, w = product_points(along, (np.array([0.5]), np.ones(1)) if on_axis else across_mass(sampler))
    rx = sampler.derivative(xi, eta, 1, 0) @ sampler.e0
    density = np.hypot(rx[:, 0], rx[:, 1]) if on_axis else cross(rx, sampler.derivative(xi, eta, 0, 1) @ sampler.e0)
    dv, section = w * density * sampler.shape.l, sampler.at(xi)
    return Volume(sampler.derivative(xi, eta, 0, 0), dv * section.rhoA, dv * section.rhoI)


def along_mass(sampler: Sampler, upto: float) -> tuple[Array, Array]:
    """Return points and weights on [0, ``upto``] that integrate S^T S times the mass per length."""
    element = sampler.shape.element
    if sampler.profile is None:
        x, w = gauss(RIGID_POINTS if element is RIGID_FRAME else element.degree_x + 2)
        return upto * x, upto * w
    x, w = gauss(RIGID_POINTS if element in (RIGID_TYPE, RIGID_FRAME) else element.degree_x + 2 + MORE)
    ends = [0.0, *(c for c in sampler.cuts if c < upto), upto]
    return (np.concatenate([a + (b - a) * x for a, b in pairwise(ends)]),
            np.concatenate([(b - a) * w for a, b in pairwise(ends)]))


def mass_matrix(sampler: Sampler, volume: Volume | None = None) -> Array:
    """Return the mass matrix M = int rho S^T S dV of one element in its own frame (n_dof, n_dof).

    It is exact except for the share ``lobatto`` that is integrated at the Lobatto points. The share p/(p + 1) for
    degree p along x is best for waves: the error of their speed has order 2 p + 2 in the wave number, not 2 p
    (Ainsworth & Wajid 2010). Beams with theta have rhoA at r and rhoI at theta; a rigid bar has its rhoI at r_x, of
    unit length, a frame half of it at each of its axes; the cable has no rotary inertia. ``volume`` is the result of
    ``over_body`` if known.
    """
    element, nc = sampler.shape.element, sampler.e0.shape[1]
    S, dm, dI = volume or over_body(sampler)
    parts = [(S * d[:, None]).T @ S for d in (dm, dI)]
    if element.lobatto:
        T, *ends = over_body(sampler, ends=True)
        parts = [(1.0 - element.lobatto) * m + element.lobatto * (T * d[:, None]).T @ T
                 for m, d in zip(parts, ends, strict=True)]
    M = np.zeros((element.n_dof, element.n_dof))
    for k in range(nc):
        M[k::nc, k::nc] = parts[1] if k == 2 else parts[0]
        if element is RIGID_TYPE:
            M[k::nc, k::nc] += dI.sum() / sampler.shape.l**2 * np.array([[1.0, -1.0], [-1.0, 1.0]])
        elif element is RIGID_FRAME:
            M[k::nc, k::nc] += 0.5 * dI.sum() * np.diag([0.0, 1.0, 1.0])
    return M
