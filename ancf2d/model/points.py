"""A point of a body as a function of the coordinates: position, section direction, rotation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from ..elements.definition import derivative_order
from ..elements.shape import Array, gauss
from .mesh import BodyMesh, Index


@dataclass(frozen=True)
class PointRef:
    """The point at fraction ``s`` of a body, on the axis unless ``eta`` = 2 y/h differs from 0 (h of the mean section).

    ``node`` is the index of the element's node there, or None between nodes; ``angle`` the reference angle of the
    tangent.
    """

    mesh: BodyMesh
    s: float
    ie: int
    xi: float
    angle: float
    node: int | None
    eta: float = 0.0

    @property
    def label(self) -> str:
        """The point in the notation of case files."""
        return f"{self.mesh.plan.name}@{self.s:g}"

    def shape_row(self, i: int = 0, j: int = 0, spread: str | None = None) -> Array:
        """Return d^(i+j) s_k/dx^i dy^j (n_shape,) here, or its mean over the section with ``spread``."""
        if (i, j, spread) not in self._rows:
            self._rows[i, j, spread] = self._shape_row(i, j, spread)
        return self._rows[i, j, spread].copy()

    @cached_property
    def _rows(self) -> dict[tuple[int, int, str | None], Array]:
        """Cache of ``shape_row``, which is called often."""
        return {}

    def _shape_row(self, i: int, j: int, spread: str | None) -> Array:
        if self._on_node and spread is None:
            own = _own(self.mesh.plan.element.functionals, self.node, i, j)
            if own is not None:
                return own.copy()
        sampler = self.mesh.classes[self.mesh.cls[self.ie]].sampler
        if spread is None:
            row = sampler.shape(np.array([self.xi]), np.array([self.eta]), i, j)[0]
        else:
            y, w = gauss(6)
            eta = 2 * y - 1
            weight = w if spread == "uniform" else 1.5 * w * (1 - eta**2)
            row = weight @ sampler.derivative(np.full(6, self.xi), eta, i, j)
        # coordinates have different units: compare the displacements that they cause
        moves = np.abs(row) / self.mesh.shape_weights
        row[moves < 1e-14 * moves.max()] = 0.0
        return row

    @property
    def _on_node(self) -> bool:
        return self.node is not None and self.eta == 0.0

    def _cached_at_node(self, what: str, compute: Callable[[], Any]) -> Any:
        """Return the result of ``compute``; at nodes it is cached and shared by meshes with the same nodes."""
        if not self._on_node:
            return compute()
        cache, key = self.mesh.at_nodes, (what, self.ie, self.node, self.s)
        if key not in cache:
            cache[key] = compute()
        return cache[key]

    def columns(self, row: Array, component: int) -> tuple[Index, Array]:
        """Return (coordinates, weights) of one component of the vector that a row of shape functions interpolates."""
        nc = self.mesh.plan.element.components
        used = np.flatnonzero(row)
        return self.mesh.dofs[self.ie, used * nc + component], row[used]

    def position(self, spread: str | None = None) -> list[tuple[Index, Array]]:
        """Return (coordinates, weights) of x and of y."""
        if spread is None:
            return list(self._at_point)
        return self._both(self.shape_row(spread=spread))

    @cached_property
    def _at_point(self) -> list[tuple[Index, Array]]:
        """The position without spread, cached for every stored state."""
        found: list[tuple[Index, Array]] = self._cached_at_node("position", lambda: self._both(self.shape_row()))
        return found

    def _both(self, row: Array) -> list[tuple[Index, Array]]:
        return [self.columns(row, 0), self.columns(row, 1)]

    @property
    def turns_by_theta(self) -> bool:
        """Return whether the section rotation is a coordinate."""
        return self.mesh.plan.element.has_theta

    def theta(self) -> tuple[Index, Array]:
        """Return (coordinates, weights) of the section rotation where it is a coordinate."""
        return self.columns(self.shape_row(), 2)

    def director(self) -> tuple[list[tuple[Index, Array]], float]:
        """Return (coordinates, weights) of x and y of the vector that turns with the section, and its reference angle.

        The vector is r_y, or r_x for the cable. Between the nodes of an arc the interpolated vector deviates a little
        from the curve's own direction; the angle is that of the vector, so that equations are met in the reference.
        """
        columns, angle = self._cached_at_node("director", self._director)
        return list(columns), angle

    def _director(self) -> tuple[list[tuple[Index, Array]], float]:
        across = self.mesh.plan.element.section_kind == "interpolated"
        row = self.shape_row(0, 1) if across else self.shape_row(1, 0)
        columns = self._both(row)
        angle = self.angle + (0.5 * math.pi if across else 0.0)
        c, s = math.cos(angle), math.sin(angle)
        x, y = (float(w @ self.mesh.e0[i - self.mesh.first_dof]) for i, w in columns)
        return columns, angle + math.atan2(c * y - s * x, c * x + s * y)

    @cached_property
    def offset(self) -> float:
        """The distance y from the axis of a point that moves with a rigid section; 0 for others and on the axis."""
        carried = self.mesh.plan.element.section_kind != "interpolated"
        return 0.5 * self.eta * self.mesh.plan.section.height if carried else 0.0

    @property
    def carrier(self) -> PointRef:
        """The point that the coordinates move: the one on the axis if a rigid section carries this one."""
        return replace(self, eta=0.0) if self.offset else self

    def before(self) -> PointRef | None:
        """Return the end of the element before if strains along the axis can jump here, else None."""
        if self.node != 0 or (self.ie, True) not in self.mesh.seams:
            return None
        last = len(self.mesh.plan.element.nodes) - 1
        return PointRef(self.mesh, self.s, (self.ie - 1) % self.mesh.plan.count, 1.0, self.angle, last, self.eta)

    def dofs(self) -> Index:
        """Return all coordinates of the node here, or of the element if there is no node."""
        if self.node is not None:
            return self.mesh.node_dofs(self.ie, self.node)
        return self.mesh.dofs[self.ie]


@lru_cache
def _own(functionals: tuple[tuple[int, str], ...], node: int, i: int, j: int) -> Array | None:
    """Return the unit row (n_shape,) if a nodal coordinate at a node is this derivative, else None."""
    found = [k for k, (at, name) in enumerate(functionals) if at == node and derivative_order(name) == (i, j)]
    return np.eye(len(functionals))[found[0]] if found else None


def point_ref(mesh: BodyMesh, s: float, y: float = 0.0) -> PointRef:
    """Return the reference to the point at fraction s of a body's arc length, y off its axis."""
    if (s, y) not in mesh.points:
        ie, xi, angle = mesh.element_at(s)
        node = next((k for k, n in enumerate(mesh.plan.element.nodes) if n.at == xi), None)
        mesh.points[s, y] = PointRef(mesh, s, ie, xi, angle, node, 2.0 * y / mesh.plan.section.height)
    return mesh.points[s, y]


def dot(columns: tuple[Index, Array], e: Array) -> float:
    """Return the sum of weight * coordinate."""
    return float(columns[1] @ e[columns[0]])
