"""Prismatic joints: a point slides on the axis of a deformed body, starting from its foot point in the reference."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from ..case.binder import Issue
from ..case.declare import key, record
from ..case.kinds import NAME, Name
from ..case.schema.active import ACTIVE, ACTIVE_DOC, Active, Latch
from ..case.schema.points import POINT, Point
from ..elements import sliding
from ..elements.shape import Array
from ..elements.sliding import Index, Sliding
from ..errors import ComputationError
from ..model.constraints import Equations
from ..model.mesh import BodyMesh
from ..model.plan import BodyPlan
from ..model.points import PointRef
from .joints import JointContext, JointError, closable, joint, reference_position

# margin, in elements, that keeps a foot point between the ends of its element
BETWEEN = 1e-12


def foot_point(plan: BodyPlan, r: Array) -> tuple[float, float]:
    """Return the fraction S of a body's arc length nearest to r in the reference, and the distance there [m]."""
    found = [(math.dist(p.position(sigma)[0], r), (p.s0 + sigma) / plan.length)
             for p in plan.pieces for sigma in [p.nearest(r)]]
    distance, s = min(found)
    return s, distance


def axis_coefficients(mesh: BodyMesh) -> tuple[Index, Array]:
    """Return the start of each element's coefficients (ne,), and the shape functions on the axis as powers of z."""
    element = mesh.plan.element
    parts = []
    for k in mesh.classes:
        half, centre = k.shape.l / 2, (np.array([0.5]), np.zeros(1))
        parts.append(np.stack([k.shape(*centre, j, 0)[0] * half**j / math.factorial(j)
                               for j in range(element.degree_x + 1)], axis=1))
    return mesh.cls * parts[0].size, np.concatenate([p.ravel() for p in parts])


def _index(*values: int) -> Index:
    return np.array(values, dtype=np.int64)


def _table(point: PointRef, mesh: BodyMesh, s: float) -> Sliding:
    """Return the table of one joint, whose foot point in the reference is at S = s of the body."""
    element = mesh.plan.element
    e0 = np.zeros(max(m.first_dof + m.n_dofs for m in (point.mesh, mesh)))
    size = mesh.plan.length
    for m in (point.mesh, mesh):
        e0[m.first_dof:m.first_dof + m.n_dofs] = m.e0
        size += float(np.abs(m.e0[m.kinds < 2]).max())
    (x, weights), (y, _) = point.position()
    first, coef = axis_coefficients(mesh)
    dofs = mesh.dofs.reshape(len(mesh.dofs), -1, element.components)[:, :, :2].reshape(-1, 2)
    ie, xi, _ = mesh.element_at(s)
    return Sliding(e0, _index(-1), np.zeros(1), np.array([size]), _index(len(weights)), _index(0),
                   np.stack([x, y], axis=1), weights, _index(element.n_shape), _index(element.degree_x + 1),
                   _index(len(mesh.dofs)), _index(0), first, coef, _index(0), dofs, np.array([[ie, 2.0 * xi - 1.0]]),
                   np.ones(1, dtype=bool))


class OnAxis:
    """A constraint that keeps the distance of a point from the axis of a body at its value in the reference.

    ``dofs`` (n,): all coordinates of the body and those of the point. ``multiplier`` is its full coordinate, set
    when the model is numbered.
    """

    multiplier = -1
    # when the joint is active, None for always
    active: Active | Latch | None = None
    facing: Callable[[Array], float] | None = None

    def __init__(self, point: PointRef, mesh: BodyMesh, s: float, owner: str) -> None:
        self.owner, self.holds = owner, f"distance from the axis of {mesh.plan.name}"
        self.label, self.body = point.label, mesh.plan.name
        self.table = _table(point, mesh, s)
        self.scale = float(self.table.scale[0])
        self.dofs: Index = np.unique(np.concatenate([mesh.dofs.ravel(), self.table.point_dofs.ravel()]))
        self.table.gap[0] = self._foot(np.zeros(len(self.table.e0)))[2][0]
        self.start = self.table.memory.copy()

    def _foot(self, d: Array) -> tuple[int, float, tuple[float, ...]]:
        """Return (element, z, (g, nx, ny, tx, ty, c)) of the foot point at d; see ``sliding.foot``."""
        axes = np.zeros((2, 2, int(self.table.terms[0])))
        m, z, measured = sliding.foot(self.table, 0, d, axes)
        return m, float(z), measured

    def foot(self, d: Array) -> tuple[int, float]:
        """Return the element of the foot point at d, and xi in it, kept between the ends of the element."""
        m, z, _ = self._foot(d)
        return m, min(max(0.5 * (z + 1.0), BETWEEN), 1.0 - BETWEEN)

    def lost(self, **at: float) -> ComputationError:
        """Return the error for a point that has left the end of the body, at a time ``t`` in motions."""
        return ComputationError(f"{self.owner}: {self.label} has slid off the end of {self.body}", at=at,
                                advice=f"a longer {self.body}, or a stop for {self.label}")

    def check(self, d: Array) -> None:
        """Raise ComputationError if the point is beyond an end of the body at d."""
        m, z, (g, *_) = self._foot(d)
        last = int(self.table.elements[0]) - 1
        if math.isnan(g) or (m == 0 and z < -sliding.END) or (m == last and z > sliding.END):
            raise self.lost()

    def nearest_foot(self, d: Array) -> tuple[Array, float]:
        """Return element and z (2,) of the nearest foot point at d on the whole body, and the distance there [m]."""
        table, found = self.table, []
        for m in range(int(table.elements[0])):
            table.memory[0] = m, 0.0
            ie, z, (g, *_) = self._foot(d)
            if not math.isnan(g) and abs(z) <= sliding.END:
                found.append((abs(g), ie, z, g))
        _, ie, z, g = min(found, default=(math.inf, 0, 0.0, math.inf))
        return np.array([ie, z]), g

    @property
    def touched(self) -> int:
        """The number of coordinates that the joint acts on at a time, without the multiplier."""
        return 2 * int(self.table.points[0] + self.table.shapes[0])

    def turns_by(self, t: float) -> list[tuple[PointRef, float]]:
        """Return an empty list: no rotation is prescribed."""
        return []

    def reference_gradient(self) -> Array:
        """Return the gradient (n,) of the distance g in the reference."""
        m, z, (_, nx, ny, tx, ty, _) = self._foot(np.zeros(len(self.table.e0)))
        dofs, rows = np.zeros(self.touched, dtype=np.int64), np.zeros((3, self.touched))
        sliding.rows_at(self.table, 0, m, z, nx, ny, tx, ty, dofs, rows)
        gradient = np.zeros(len(self.dofs))
        gradient[np.searchsorted(self.dofs, dofs)] = rows[0]
        return gradient


def check_ends(constraints: Iterable[object], d: Array) -> None:
    """Raise ComputationError if a point has left the body along which it slides."""
    for constraint in constraints:
        if isinstance(constraint, OnAxis):
            constraint.check(d)


_EMPTY = Sliding(np.zeros(0), _index(), np.zeros(0), np.zeros(0), _index(), _index(), np.zeros((0, 2), np.int64),
                 np.zeros(0), _index(), _index(), _index(), _index(), _index(), np.zeros(0), _index(),
                 np.zeros((0, 2), np.int64), np.zeros((0, 2)), np.zeros(0, dtype=bool))
# fields that are indices into another array, and that array
_COUNTS = {"point_first": "point_dofs", "element_first": "coef_first", "coef_first": "coef", "dof_first": "dofs"}


def sliding_table(constraints: Iterable[object], e0: Array) -> Sliding:
    """Return the table of the prismatic joints among the constraints of a model with reference coordinates e0.

    Searches start from the foot points in the reference; the table has its own memory.
    """
    joints = [c for c in constraints if isinstance(c, OnAxis)]
    tables = [c.table._replace(multiplier=_index(c.multiplier), memory=c.start,
                               on=np.array([c.active is None or c.active.at(0.0)])) for c in joints]
    out = {}
    for name in Sliding._fields[1:]:
        parts = [getattr(t, name) for t in tables]
        if name in _COUNTS:
            before = np.cumsum([0, *(len(getattr(t, _COUNTS[name])) for t in tables)])
            parts = [p + b for p, b in zip(parts, before[:-1], strict=True)]
        out[name] = np.concatenate([getattr(_EMPTY, name), *parts])
    return Sliding(e0, **out)


@joint
@record
class PrismaticJoint:
    """Keeps a point on the axis of a deforming body, along which it slides."""

    tag = "prismatic"
    point: Point = key(POINT, "Point that slides", example="slider@0")
    on: str = key(Name("the name of a body"), "Body along which it slides", refers="bodies",
                  example="beam")
    name: str | None = key(NAME, "Name", default=None)
    active: Active | None = key(ACTIVE, ACTIVE_DOC, default=None)

    def check(self) -> Iterator[Issue]:
        """Yield an issue for a body that would slide along itself."""
        if self.point.body == self.on:
            yield Issue(("on",), f"{{}}: '{self.on}' cannot slide along itself")

    @property
    def slides_along(self) -> str:
        """The body along which the point slides."""
        return self.on

    def add(self, context: JointContext, owner: str, out: Equations) -> None:
        """Add the constraint that keeps the distance of the point from the axis."""
        point, mesh = context.point(self.point), context.meshes[self.on]
        x, y = reference_position(point)
        s, gap = foot_point(mesh.plan, np.array([x, y]))
        begins = self.active is not None and self.active.begins
        if not begins and gap > closable(np.array([x, y]), point.mesh, mesh):
            raise JointError([(("point",), f"{context.label}: {point.label} is at ({x:.6g}, {y:.6g}), {gap:.3g} away "
                               f"from the axis of {self.on}", "a point on the axis in the reference")])
        out.constraints.append(OnAxis(point, mesh, s, owner))
