"""The rotation of the section at a point, its derivatives with respect to the coordinates, and its full turns."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property

import numpy as np

from ..elements.shape import Array
from .mesh import BodyMesh, Index
from .point_patch import DIRECTION, PointPatch, turn_fields
from .points import PointRef, point_ref

# rotation and strain below which all sections of a body are on the same turn
SMALL = 0.5


class Rotation:
    """theta at a point: of r_y, of r_x for the cable, or the coordinate theta; 0 in the reference.

    ``dofs`` (n,) are the coordinates that it depends on.
    """

    def __init__(self, point: PointRef) -> None:
        self.point = point
        if point.turns_by_theta:
            self.dofs, self.weights = point.theta()
            return
        (cx, wx), (cy, wy) = point.director()[0]
        self.dofs = np.concatenate([cx, cy])
        self.V = np.zeros((2, len(self.dofs)))
        self.V[0, :len(cx)], self.V[1, len(cx):] = wx, wy

    def value(self, e: Array, d: Array, near: float = 0.0) -> float:
        """Return theta on the turn nearest to ``near``; small angles keep their digits, computed from displacements."""
        if self.point.turns_by_theta:
            return float(self.weights @ d[self.dofs])
        v, dv = self.V @ e[self.dofs], self.V @ d[self.dofs]
        v0 = v - dv
        angle = math.atan2(v0[0] * dv[1] - v0[1] * dv[0], v0 @ v0 + v0 @ dv)
        return angle + 2 * math.pi * round((near - angle) / (2 * math.pi))

    def linear(self, e0: Array, d: Array) -> float:
        """Return the linearised theta: dtheta/de in the reference times d."""
        return float(self.gradient(e0) @ d[self.dofs])

    def gradient(self, e: Array) -> Array:
        """Return dtheta/de (n,)."""
        if self.point.turns_by_theta:
            return self.weights
        v = self.V @ e[self.dofs]
        return (v[0] * self.V[1] - v[1] * self.V[0]) / (v @ v)

    def axes(self, e: Array, d: Array) -> Array:
        """Return the section's axes as columns (2, 2): along the body and across it."""
        angle = self.point.angle + self.value(e, d)
        c, s = math.cos(angle), math.sin(angle)
        return np.array([[c, -s], [s, c]])


class SectionAngles:
    """Rotations of the sections along a body; for types with directions instead of theta."""

    def __init__(self, mesh: BodyMesh) -> None:
        self.mesh = mesh
        # whether coordinates give rotations and strains
        self.known = bool(mesh.gradients.any())
        self.coordinates = slice(mesh.first_dof, mesh.first_dof + mesh.n_dofs)
        self.xi = np.linspace(0.0, 1.0, 2 * mesh.plan.element.degree_x + 2)

    def _rows(self, xi: Array, i: int, j: int) -> Array:
        """Return derivatives of the shape functions (classes, stations, n_shape) on the axis."""
        return np.array([cls.shape(xi, np.zeros_like(xi), i, j) for cls in self.mesh.classes])

    def _along(self, rows: Array, q: Array, block: slice) -> Array:
        """Return x and y (2, block, stations) of the product of rows with the body's coordinates q (n_dofs,)."""
        mesh = self.mesh
        values = q[mesh.dofs[block] - mesh.first_dof]
        parts = [values[:, k::mesh.plan.element.components] for k in (0, 1)]
        if len(rows) == 1:
            return np.array([part @ rows[0].T for part in parts])
        return np.array([np.einsum("esk,ek->es", rows[mesh.cls[block]], part) for part in parts])

    @cached_property
    def _directing(self) -> Array:
        """The rows that give the directions of the sections."""
        across = self.mesh.plan.element.section_kind == "interpolated"
        return self._rows(self.xi, *((0, 1) if across else (1, 0)))

    @cached_property
    def _reference(self) -> Array:
        """The directions of the sections in the reference, for the first block of elements."""
        return self._along(self._directing, self.mesh.e0, self.mesh.blocks[0])

    def small(self, d: Array) -> bool:
        """Return whether rotations and strains are so small that all sections are on the same turn."""
        return self.known and self.mesh.largest_gradient(d) < SMALL

    def angles(self, d: Array) -> Array:
        """Return theta (elements, stations) at d, continuous along the body; the first one is nearest to 0."""
        rows, own = self._directing, d[self.coordinates]
        angles = np.empty((len(self.mesh.dofs), len(self.xi)))
        for block in self.mesh.blocks:
            x, y = self._along(rows, self.mesh.e0, block) if block.start else self._reference
            dx, dy = self._along(rows, own, block)
            angles[block] = np.arctan2(x * dy - y * dx, x * (x + dx) + y * (y + dy))
        return np.unwrap(angles.ravel()).reshape(angles.shape)

    def follow(self, before: Array, turned: float, d: Array) -> float:
        """Return theta at S = 0 at d, given its value ``turned`` at the state ``before``.

        The full turns are found at the section that moved least between the two states.
        """
        old, new = (self.angles(at)[:, ::len(self.xi) - 1].copy() for at in (before, d))
        old += whole_turns(turned - old[0, 0])
        moved = np.abs(np.sin(0.5 * (new - old)))
        ends, change = self._rows(self.xi[[0, -1]], 0, 0), d[self.coordinates] - before[self.coordinates]
        for block in self.mesh.blocks:
            dx, dy = self._along(ends, change, block) / self.mesh.plan.length
            moved[block] += np.hypot(dx, dy)
        ie, end = divmod(int(np.argmin(moved)), 2)
        return float(new[0, 0] + whole_turns(old[ie, -end] - new[ie, -end]))

    def near(self, point: PointRef, d: Array, turned: float) -> float:
        """Return theta near a point at d, if it is ``turned`` at S = 0."""
        angles = self.angles(d)
        k = int(np.argmin(np.abs(self.xi - point.xi)))
        return float(angles[point.ie, k] + whole_turns(turned - angles[0, 0]))


def whole_turns(angle: float) -> float:
    """Return the multiple of a full turn that is nearest to an angle."""
    return 2 * math.pi * round(angle / (2 * math.pi))


class Turns:
    """Rotations of all sections, counted through full turns.

    The state needed besides the coordinates is ``turned`` (bodies,): theta at S = 0 of each body. All other rotations
    follow, as theta is continuous along a body. ``counted`` are the bodies with directions instead of theta, with the
    fields ``along`` and ``across`` of ``turn_fields``: for body counted[i] they are weights of d[dofs] from begin[i] to
    begin[i + 1]; ``length`` is the length of the direction.
    """

    def __init__(self, meshes: dict[str, BodyMesh]) -> None:
        self.number = {name: k for k, name in enumerate(meshes)}
        self.angles = [SectionAngles(mesh) for mesh in meshes.values()]
        found = [turn_fields(point_ref(mesh, 0.0)) for mesh in meshes.values()]
        self.counted = np.array([k for k, (kind, _) in enumerate(found) if kind == DIRECTION], dtype=np.int64)
        self.by_theta = [(k, fields[0]) for k, (kind, fields) in enumerate(found) if kind != DIRECTION]
        fields = [found[k][1] for k in self.counted]
        self.begin = np.cumsum([0, *(len(along.coords) for along, _ in fields)])
        self.dofs, self.along, self.across = (np.concatenate([np.zeros(0), *parts]) for parts in (
            [a.coords for a, _ in fields], [a.weights for a, _ in fields], [b.weights for _, b in fields]))
        self.dofs = self.dofs.astype(np.int64)
        self.length = np.array([a.p0 for a, _ in fields])

    def at(self, d: Array, near: Array) -> Array:
        """Return ``turned`` at d; for counted bodies on the turn nearest to ``near`` (counted,)."""
        out = np.zeros(len(self.angles))
        for k, field in self.by_theta:
            out[k] = field.weights @ d[field.coords]
        if len(self.counted):
            x, y = (np.add.reduceat(w * d[self.dofs], self.begin[:-1]) for w in (self.along, self.across))
            angle = np.arctan2(y, self.length + x)
            out[self.counted] = angle + 2 * np.pi * np.round((near - angle) / (2 * np.pi))
        return out

    def follow(self, before: Array, turned: Array, d: Array) -> Array:
        """Return ``turned`` at d, one load step after the state ``before``, also if sections rotate far in between."""
        near = [turned[k] if self.angles[k].small(d) and self.angles[k].small(before)
                else self.angles[k].follow(before, float(turned[k]), d) for k in self.counted]
        return self.at(d, np.array(near))

    def match_angle(self, point: PointRef, angle: float, e: Array, d: Array, turned: Array) -> None:
        """Add full turns to ``turned`` for the body of a point, so that the section there is nearest to the angle."""
        turned[self.number[point.mesh.plan.name]] += whole_turns(angle - self.theta(Rotation(point), e, d, turned))

    def from_reference(self, d: Array) -> Array:
        """Return ``turned`` at d if no other state than the reference is known."""
        return self.follow(np.zeros_like(d), np.zeros(len(self.angles)), d)

    def theta(self, rotation: Rotation, e: Array, d: Array, turned: Array) -> float:
        """Return the rotation of a section at nodal coordinates e with displacements d."""
        point = rotation.point
        k = self.number[point.mesh.plan.name]
        near, angles = float(turned[k]), self.angles[k]
        if not point.turns_by_theta and point.s > 0.0 and not angles.small(d):
            near = angles.near(point, d, near)
        return rotation.value(e, d, near)

    def set_spring_angles(self, springs: Iterable[PointPatch], e: Array, d: Array, turned: Array) -> None:
        """Set the stored angles of torsion springs to those of a state."""
        for spring in springs:
            for k, end in enumerate(spring.sections):
                spring.mem[k] = 0.0 if end is None else self.theta(Rotation(end), e, d, turned)


class CoordinateKinds:
    """Full coordinates by kind: ``x`` of positions and gradients (their y is next), ``theta``, ``positions``.

    ``positions`` are those of ``x`` that are positions.
    """

    def __init__(self, meshes: Iterable[BodyMesh]) -> None:
        kinds = np.concatenate([m.kinds for m in meshes])
        self.x: Index = np.flatnonzero((kinds == 0) | (kinds == 3))
        self.positions: Index = np.flatnonzero(kinds == 0)
        self.theta: Index = np.flatnonzero(kinds == 2)

    def translation(self, out: Array, vx: float, vy: float) -> None:
        """Add the rates of a translation to ``out`` (n_q,)."""
        out[self.positions] += vx
        out[self.positions + 1] += vy

    def rotation(self, out: Array, e: Array, omega: float, about: tuple[float, float] = (0.0, 0.0)) -> None:
        """Add the rates of nodal coordinates e (n_q,) in a rotation with rate omega about a point to ``out``."""
        out[self.x] -= omega * e[self.x + 1]
        out[self.x + 1] += omega * e[self.x]
        out[self.theta] += omega
        self.translation(out, omega * about[1], -omega * about[0])
