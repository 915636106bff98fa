"""What a state means to its user: probes, reactions, section forces, energies."""

from __future__ import annotations

import numpy as np

from ..case import Case
from ..elements.shape import Array
from ..model.mechanism import rigid_motion
from ..model.model import Model
from ..model.points import PointRef, dot
from ..model.rotation import Rotation
from .section import section_forces
from .state import State

FORCES = ("N", "Q", "M")


def asks_for_forces(case: Case) -> bool:
    """Whether goal, expected values or fields name a section force."""
    named = [q.quantity for q in (case.goal, *case.expected) if q is not None]
    return any(q in FORCES for q in named) or any(f in FORCES for f in case.output.fields)


class Observer:
    """Reads the probes of a case from states, counting rotations through full turns."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.probes = {name: model.point(p.at, p.y) for name, p in model.case.output.probes.items()}
        self.rotations = {name: Rotation(p) for name, p in self.probes.items()}
        self.theta = dict.fromkeys(self.probes, 0.0)
        self.forces = asks_for_forces(model.case)

    def observe(self, state: State) -> dict[str, dict[str, float]]:
        """Return x, y, ux, uy, theta (and N, Q, M where asked for) of every probe."""
        out = {}
        d = state.d[:self.model.n_q]
        e = self.model.e0 + d
        for name, point in self.probes.items():
            rotation = self.rotations[name]
            theta = (rotation.linear(self.model.e0, d) if state.linear
                     else rotation.value(e, d, self.theta[name]))
            self.theta[name] = theta
            reference, u = place(point, self.model.e0, d, theta, state.linear)
            values = {"x": reference[0] + u[0], "y": reference[1] + u[1], "ux": u[0], "uy": u[1], "theta": theta}
            if self.forces:
                values.update(zip(FORCES, section_forces(self.model, state, point), strict=True))
            out[name] = {k: float(v) for k, v in values.items()}
        return out


def place(point: PointRef, e0: Array, d: Array, theta: float, linear: bool) -> tuple[Array, Array]:
    """Return the reference position (2,) and displacement (2,) of a point, off the axis too."""
    axis = PointRef(point.mesh, point.s, point.ie, point.xi, point.angle, point.node)
    carried = point.eta != 0.0 and point.mesh.plan.element.section_kind != "interpolated"
    columns = (axis if carried else point).position()
    r0, u = np.array([dot(c, e0) for c in columns]), np.array([dot(c, d) for c in columns])
    if carried:
        # a section that is rigid: y times the change of its normal
        y = 0.5 * point.eta * point.mesh.plan.section.height
        normal = np.array([-np.sin(point.angle), np.cos(point.angle)])
        r0 = r0 + y * normal
        turn = np.array([-normal[1], normal[0]])
        u = u + y * (theta * turn if linear else np.sin(theta) * turn - 2 * np.sin(theta / 2) ** 2 * normal)
    return r0, u


def equilibrium_rows(model: Model, state: State) -> tuple[Array, Array]:
    """Return the multipliers of the linear rows and what they leave of the residual (n_q,)."""
    R = (state.Q - state.F)[:model.n_q]
    rows = model.rows
    if not rows:
        return np.zeros(0), R
    coords = np.unique(np.concatenate([r.coords for r in rows]))
    where = {int(c): k for k, c in enumerate(coords)}
    if len(rows) * len(coords) <= 4_000_000:
        C = np.zeros((len(rows), len(coords)))
        for i, row in enumerate(rows):
            C[i, [where[int(c)] for c in row.coords]] = row.coefs
        lam = np.linalg.lstsq(C.T, R[coords], rcond=None)[0]
    else:
        lam = _sparse_least_squares(rows, where, R[coords])
    return lam, R


def _sparse_least_squares(rows: list, where: dict[int, int], b: Array) -> Array:
    from scipy.sparse import csr_matrix
    from scipy.sparse.linalg import lsmr

    index = [where[int(c)] for r in rows for c in r.coords]
    owner = [i for i, r in enumerate(rows) for _ in r.coords]
    data = np.concatenate([r.coefs for r in rows])
    return lsmr(csr_matrix((data, (index, owner)), shape=(len(where), len(rows))), b, atol=1e-14, btol=1e-14)[0]


def reactions(model: Model, state: State) -> dict[str, dict[str, float]]:
    """Return fx, fy and the moment about the point that each support exerts on its body."""
    lam, _ = equilibrium_rows(model, state)
    d = state.d[:model.n_q]
    e = model.e0 if state.linear else model.e0 + d
    out = {}
    for name, point in model.supports:
        centre = np.array([dot(c, e) for c in point.position()])
        total = np.zeros(3)
        for row, value in zip(model.rows, lam, strict=True):
            if row.owner == name:
                total += value * (row.coefs @ rigid_motion(point.mesh, row.coords, e, centre))
        for k, constraint in enumerate(model.constraints):
            if constraint.owner == name:
                _, G, _ = constraint.evaluate(e, d, state.t)
                total -= state.d[model.n_q + k] * (G @ rigid_motion(point.mesh, constraint.dofs, e, centre))
        out[name] = dict(zip(("fx", "fy", "m"), (float(v) for v in total), strict=True))
    return out


def energies(model: Model, state: State) -> dict[str, float]:
    """Return strain, kinetic and (gravity) potential energy of a state."""
    return {"strain": state.energy, "kinetic": 0.0,
            "potential": model.gravity_potential(state.d, state.t)}


