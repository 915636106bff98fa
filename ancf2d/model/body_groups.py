"""Pools of bodies of the same kind, whose elements are processed together."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from ..case import Case
from ..elements.shape import Array
from .classes import ElementClass
from .mesh import STATIONS, BodyMesh, Index, joined

# a body with at least this many elements forms a pool of its own, which threads can divide
MANY = 8192


class Pool:
    """Bodies with the same element, formulation, quadrature and damping time ``tau`` [s], their elements in a row.

    ``classes`` contains the classes of all bodies, each once; ``cls`` (ne,), ``dofs`` (ne, n_dof) and ``turn`` (ne or
    1, 2) are the same as in ``BodyMesh``.
    """

    def __init__(self, meshes: list[BodyMesh], tau: float) -> None:
        self.meshes, self.tau = meshes, tau
        self.plan = meshes[0].plan

    @property
    def kind(self) -> tuple[Any, ...]:
        """A key of the shape of the class arrays: pools with equal keys have arrays of equal shape per class."""
        plan = self.plan
        return id(plan.element), plan.formulation.name, plan.formulation.law, plan.rule, len(plan.section.layers)

    @cached_property
    def _classes(self) -> dict[Any, ElementClass]:
        out: dict[Any, ElementClass] = {}
        for mesh in self.meshes:
            for one in mesh.classes:
                out.setdefault(one.key, one)
        return out

    @property
    def classes(self) -> list[ElementClass]:
        """The classes of all bodies, each once."""
        return list(self._classes.values())

    @cached_property
    def _along(self) -> dict[tuple[tuple[int, int], ...], Array]:
        return {}

    def along_axis(self, fields: tuple[tuple[int, int], ...]) -> Array:
        """Return the rows (classes, fields x stations, n_dof) that map coordinates to fields at ``STATIONS``.

        They are those of one class (1, ...) if all are equal. A field is a pair: which of the three matrices in
        ``axis_rows``, and the component.
        """
        if fields not in self._along:
            nc, stations = self.plan.element.components, len(STATIONS)
            rows = np.zeros((len(self.axis_rows), len(fields) * stations, self.dofs.shape[1]))
            for k, (which, component) in enumerate(fields):
                rows[:, k * stations:(k + 1) * stations, component::nc] = [of[which] for of in self.axis_rows]
            # classes may differ in their sections alone, or in where fibres are sampled
            self._along[fields] = rows[:1] if np.all(rows == rows[:1]) else rows
        return self._along[fields]

    @cached_property
    def cls(self) -> Index:
        """The class of each element (ne,)."""
        number = {key: k for k, key in enumerate(self._classes)}
        parts = [np.array([number[c.key] for c in mesh.classes], dtype=np.int64)[mesh.cls] for mesh in self.meshes]
        return np.concatenate(parts)

    @cached_property
    def dofs(self) -> Index:
        """The coordinates of each element (ne, n_dof)."""
        return joined([mesh.dofs for mesh in self.meshes])

    @cached_property
    def turn(self) -> Array:
        """Cosine and sine of each element's direction (ne, 2), or (1, 2) if all are equal."""
        if len(self.meshes) == 1:
            return self.meshes[0].turn
        return np.concatenate([np.broadcast_to(mesh.turn, (len(mesh.dofs), 2)) for mesh in self.meshes])

    @cached_property
    def first(self) -> Index:
        """The number of the first element of each body in the pool."""
        return np.concatenate([[0], np.cumsum([len(mesh.dofs) for mesh in self.meshes])])[:-1]

    @cached_property
    def axis_rows(self) -> list[tuple[Array, Array, Array]]:
        """dS/dx, dS/dy and S (stations, n_shape) at ``STATIONS`` on the axis, for each class."""
        axis = np.zeros(len(STATIONS))
        return [(c.shape(STATIONS, axis, 1, 0), c.shape(STATIONS, axis, 0, 1), c.shape(STATIONS, axis))
                for c in self.classes]


def damping_time(case: Case, name: str) -> float:
    """Return the damping time tau [s] of a body in D (eps + tau d eps/dt): Kelvin-Voigt plus Rayleigh's beta."""
    damping, material = case.damping, case.bodies[name].material
    beta = damping.rayleigh.beta if damping else 0.0
    return beta + (material.damping.kelvin_voigt if material and material.damping else 0.0)


def make_pools(case: Case, meshes: dict[str, BodyMesh]) -> list[Pool]:
    """Return the deformable bodies in pools; large bodies form pools of their own."""
    pools: list[Pool] = []
    found: dict[Any, Pool] = {}
    for name, mesh in meshes.items():
        if mesh.plan.rigid:
            continue
        pool = Pool([mesh], damping_time(case, name))
        key = *pool.kind, pool.tau
        if mesh.plan.count < MANY and key in found:
            found[key].meshes.append(mesh)
            continue
        pools.append(pool)
        if mesh.plan.count < MANY:
            found[key] = pool
    return pools


def place_in_pools(pools: list[Pool], mesh: BodyMesh) -> tuple[int, int]:
    """Return the number of a body's pool, and the number of the body's first element in the pool."""
    for k, pool in enumerate(pools):
        for other, first in zip(pool.meshes, pool.first.tolist(), strict=True):
            if other is mesh:
                return k, first
    raise KeyError(mesh.plan.name)
