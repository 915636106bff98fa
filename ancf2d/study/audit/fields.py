"""Tools of the checks: linear fields as nodal coordinates, forces of stresses, free beams, cantilevers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...elements.definition import ElementType, derivative_order
from ...elements.section import Section
from ...elements.shape import Array, ShapeFunctions, gauss
from ...errors import ComputationError
from ...model.mesh import BodyMesh
from ...model.model import Model
from ...model.points import dot, point_ref
from .subject import Subject

# (x, y) -> stresses xx, xy, yy
Stress = Callable[[Array, Array], tuple[Array, Array, Array]]
# load on a linear beam that moves it by a small share of its length
SMALL = 1e-6
# F L^2/(EI) that deflects a cantilever by about half its length, and the solver for it
FAR, LARGE = 2.0, {"type": "static", "steps": 2}


def beam(model: Model) -> BodyMesh:
    """Return the only body of an audit's model."""
    return model.meshes["beam"]


def linear_field(model: Model, G: Array) -> Array:
    """Return the displacements (n_q,) of nodal coordinates in the field u = G (x, y), G (2, 2) small.

    Sections rotate with the material line across the beam: theta = -du_x/dy.
    """
    mesh = beam(model)
    pattern: dict[tuple[int, int], Array] = {(1, 0): G[:, 0], (0, 1): G[:, 1]}
    values: list[list[float]] = []
    for _, name in mesh.plan.element.functionals:
        values.append([*pattern.get(derivative_order(name), np.zeros(2)), -G[0, 1]])
    nc = mesh.plan.element.components
    d = mesh.tile([v for row in values for v in row[:nc]])
    place = mesh.kinds == 0
    r = np.stack([model.e0[place], model.e0[np.flatnonzero(place) + 1]], axis=1) @ G.T
    d[place], d[np.flatnonzero(place) + 1] = r[:, 0], r[:, 1]
    return d


def rigidly_moved(model: Model, d: Array, angle: float, shift: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Return the displacements (n_q,) of a deformed body after a rotation about the origin and a translation."""
    e = rotated(model, model.e0 + d, angle)
    place = np.flatnonzero(beam(model).kinds == 0)
    e[place] += shift[0]
    e[place + 1] += shift[1]
    e[beam(model).kinds == 2] += angle
    return e - model.e0


def rotated(model: Model, e: Array, angle: float) -> Array:
    """Return coordinates or forces (n_q,) with the vectors among them, positions and slopes, rotated."""
    kinds, out = beam(model).kinds, e.copy()
    first = np.flatnonzero((kinds == 0) | (kinds == 3))
    c, s = np.cos(angle), np.sin(angle)
    out[first], out[first + 1] = c * e[first] - s * e[first + 1], s * e[first] + c * e[first + 1]
    return out


def displacement_rows(mesh: BodyMesh, shape: ShapeFunctions, xi: Array, eta: Array) -> Array:
    """Return the matrix (points, 2, n_dof) that gives the displacement of points of an element along x.

    Sections of a beam with theta, or of one without coordinates of the section, rotate as rigid lines.
    """
    element, nc = mesh.plan.element, mesh.plan.element.components
    across = element.section_kind == "interpolated"
    S = shape(xi, eta if across else np.zeros_like(xi))
    rows = np.zeros((len(xi), 2, element.n_dof))
    rows[:, 0, 0::nc] = rows[:, 1, 1::nc] = S
    if not across:
        y = 0.5 * mesh.plan.section.height * np.asarray(eta)
        slope = S if element.has_theta else shape(xi, np.zeros_like(xi), 1, 0)
        rows[:, 0, (2 if element.has_theta else 1)::nc] -= y[:, None] * slope
    return rows


def points_over(element: ElementType) -> tuple[Array, Array]:
    """Return xi in [0, 1] and eta in [-1, 1] of points over an element, edges included."""
    x, y = np.linspace(0.0, 1.0, element.degree_x + 3), np.linspace(-1.0, 1.0, element.degree_y + 3)
    return np.repeat(x, len(y)), np.tile(y, len(x))


def boundary_forces(model: Model, stress: Stress) -> Array:
    """Return the generalised forces (n_q,) of the tractions that a stress field exerts on ends and faces of a beam."""
    mesh = beam(model)
    element, half = mesh.plan.element, 0.5 * mesh.plan.section.height
    Q = np.zeros(model.n_q)
    y, wy = gauss(element.degree_y + 4)
    x, wx = gauss(element.degree_x + 4)
    eta, start = 2 * y - 1, 0.0
    for ie, dofs in enumerate(mesh.dofs):
        shape = mesh.classes[mesh.cls[ie]].shape
        l = shape.l
        for xi, side in ((0.0, -1.0), (1.0, 1.0)):
            if ie == (0 if side < 0 else len(mesh.dofs) - 1):
                xx, xy, _ = stress(np.full_like(eta, start + xi * l), half * eta)
                rows = displacement_rows(mesh, shape, np.full_like(eta, xi), eta)
                t = side * np.stack([xx, xy], axis=1) * (2 * half * wy)[:, None]
                Q[dofs] += np.einsum("pc,pcn->n", t, rows)
        for face in (-1.0, 1.0):
            _, xy, yy = stress(start + l * x, np.full_like(x, face * half))
            rows = displacement_rows(mesh, shape, x, np.full_like(x, face))
            t = face * np.stack([xy, yy], axis=1) * (l * wx)[:, None]
            Q[dofs] += np.einsum("pc,pcn->n", t, rows)
        start += l
    return Q


def uniform(xx: float, xy: float, yy: float) -> Stress:
    """Return a constant stress."""
    return lambda x, y: (xx + 0 * x, xy + 0 * x, yy + 0 * x)


def element_stiffness(model: Model) -> Array:
    """Return the tangents (ne, n_dof, n_dof) of all elements at the reference."""
    from ...kernels.elements import element_matrices

    (group,) = model.groups
    n, ne = mesh_size(model)
    Q, K = np.zeros((ne, n)), np.zeros((ne, n, n))
    element_matrices(group, np.zeros(model.n_q), Q, K)
    return K


def mesh_size(model: Model) -> tuple[int, int]:
    """Return (coordinates per element, elements)."""
    ne, n = beam(model).dofs.shape
    return n, ne


def stiffness(model: Model) -> Array:
    """Return the assembled tangent (n_q, n_q) at the reference."""
    K = np.zeros((model.n_q, model.n_q))
    for Ke, dofs in zip(element_stiffness(model), beam(model).dofs, strict=True):
        K[np.ix_(dofs, dofs)] += Ke
    return K


def elastic(model: Model, d: Array) -> tuple[float, Array]:
    """Return the strain energy and the elastic forces (n_q,) at displacements d."""
    from ...kernels.elements import force

    Q = np.zeros(model.n_q)
    (group,) = model.groups
    return float(force(group, d, Q)), Q


def reduced(model: Model, K: Array) -> Array:
    """Return T^T K T (n_unknowns, n_unknowns), the stiffness of the unknowns that remain after welding the pieces."""
    num = model.numbering
    T = np.zeros((model.n_q, num.n_unknowns))
    for k, row in enumerate(np.eye(num.n_unknowns)):
        T[:, k] = num.expanded(row)[:model.n_q]
    return T.T @ K @ T


def response(model: Model, Q: Array) -> Array:
    """Return displacements (n_q,) of a free beam under self-equilibrated forces (n_q,), K d = Q.

    They contain no motions without strain energy: neither rigid ones nor zero-energy modes.
    """
    num = model.numbering
    w = model.weights[num.free]
    K = reduced(model, stiffness(model)) / np.outer(w, w)
    values, vectors = np.linalg.eigh(0.5 * (K + K.T))
    parts = vectors.T @ (num.reduce(Q) / w)
    stiff = values > ZERO * values[-1]
    return num.expanded((vectors[:, stiff] @ (parts[stiff] / values[stiff])) / w)[:model.n_q]


def compliance(model: Model, Q: Array) -> float:
    """Return Q . d of a free beam under self-equilibrated forces (n_q,)."""
    return float(Q @ response(model, Q))


def work_inside(model: Model, d: Array) -> float:
    """Return d . K d of the elements in the middle half of a beam, undisturbed by the ends."""
    dofs, K = beam(model).dofs, element_stiffness(model)
    inner = slice(len(dofs) // 4, len(dofs) - len(dofs) // 4)
    return float(np.einsum("ea,eab,eb->", d[dofs[inner]], K[inner], d[dofs[inner]]))


# eigenvalues of K, scaled to displacements, below this share of the largest count as zero
ZERO = 1e-12


def last_state(model: Model) -> Array:
    """Return the displacements (n_q,) in the last state of a model's solver. Raises ComputationError."""
    from ...solvers.registry import solve

    state = list(solve(model))[-1]
    return state.d[:model.n_q]


def tip_force(s: Subject, F: float, at: str) -> dict[str, Any]:
    """Return a transverse force at an end, distributed like shear stress if the section is interpolated."""
    spread = {"spread": "parabolic"} if s.element.section_kind == "interpolated" else {}
    return {"type": "force", "at": at, "value": [0.0, F], **spread}


def deflected(s: Subject, length: float, count: int, F: float, solver: Any = "linear_static", *,
              angle: float = 0.0, wall: int = 0) -> tuple[Model, Array]:
    """Return model and displacements of a cantilever clamped at S = ``wall``, under a force at its other end.

    The clamp lets its section contract; if zero-energy modes make that singular, it holds every coordinate. Raises
    ComputationError.
    """
    walls = [{**s.wall, "at": f"beam@{wall}"}, {"type": "clamp", "at": f"beam@{wall}", "hold": "all"}]
    load = tip_force(s, F, f"beam@{1 - wall}")
    if angle:
        load["value"] = [-F * np.sin(angle), F * np.cos(angle)]
    for k, held in enumerate(walls):
        model = s.model(length, count, solver, angle=angle, boundary_conditions=[held], loads=[load])
        try:
            return model, last_state(model)
        except ComputationError:
            if k == len(walls) - 1:
                raise
    raise AssertionError("one of the walls is the last")


def deflection(model: Model, d: Array, wall: int = 0, angle: float = 0.0) -> float:
    """Return the transverse displacement of the tip relative to the clamped end."""
    mesh = beam(model)
    ends = [np.array([dot(c, d) for c in point_ref(mesh, float(at)).position()]) for at in (wall, 1 - wall)]
    return float((ends[1] - ends[0]) @ np.array([-np.sin(angle), np.cos(angle)]))


def tip_deflection(s: Subject, length: float, count: int, angle: float = 0.0) -> float:
    """Return the linear deflection of a cantilever under a unit force at its tip. Raises ComputationError."""
    model, d = deflected(s, length, count, SMALL, angle=angle)
    return deflection(model, d, angle=angle) / SMALL


def timoshenko_deflection(section: Section, length: float, kGA: float) -> float:
    """Return the deflection of Timoshenko's cantilever under a unit force at its tip: L^3/(3 EI) + L/(k GA)."""
    return length**3 / (3.0 * section.EI) + length / kGA
