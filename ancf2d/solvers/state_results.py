"""Results of a state: probes, reactions, section forces, energies, balance of forces."""

from __future__ import annotations

from collections.abc import Container

import numpy as np

from ..case import Case
from ..elements.shape import Array
from ..model.determinacy import rigid_motion
from ..model.mesh import Index
from ..model.model import Model
from ..model.points import PointRef, dot
from ..model.rotation import Rotation
from ..quantities import FORCES
from .element_loads import constraint_forces, equilibrium_rows
from .energy import Energies
from .section_forces import SectionForces, has_section_forces
from .state import State


def asks_for_forces(case: Case) -> bool:
    """Return whether goal, expected values or fields of a case name a section force."""
    named = [q.quantity for q in (case.goal, *case.expected) if q is not None]
    return any(q in FORCES for q in named) or any(f in FORCES for f in case.output.fields)


class Observer:
    """Evaluate the probes of a case, or those ``named``, for states; without ``forces`` no section forces."""

    def __init__(self, model: Model, forces: bool = True, named: Container[str] | None = None) -> None:
        self.model = model
        self.probes = {name: model.point(p.at, p.y) for name, p in model.case.output.probes.items()
                       if named is None or name in named}
        self.rotations = {name: Rotation(p) for name, p in self.probes.items()}
        self.forces = forces and asks_for_forces(model.case)
        self._sections: dict[str, SectionForces] = {}

    def observe(self, state: State) -> dict[str, dict[str, float]]:
        """Return x, y, ux, uy, theta of every probe; in motion also vx, vy, omega; N, Q, M if requested."""
        # linear theory has no full turns
        turned = np.zeros(0) if state.linear else turns_of(self.model, state)
        with self.model.remembering(state.memory):
            return {name: self.read(name, state, turned) for name in self.probes}

    def read(self, name: str, state: State, turned: Array) -> dict[str, float]:
        """Return the values of one probe (see ``observe``), given the bodies' turns (bodies,) of ``turns_of``."""
        point, rotation, d = self.probes[name], self.rotations[name], state.d[:self.model.n_q]
        e = self.model.e0 + d
        theta = rotation.linear(self.model.e0, d) if state.linear else self.model.turns.theta(rotation, e, d, turned)
        reference, u = position_of(point, self.model.e0, d, theta, state.linear)
        values = {"x": reference[0] + u[0], "y": reference[1] + u[1], "ux": u[0], "uy": u[1], "theta": theta}
        if state.v is not None:
            omega = float(rotation.gradient(e) @ state.v[rotation.dofs])
            velocity = velocity_of(point, state.v, theta, omega)
            values.update(vx=velocity[0], vy=velocity[1], omega=omega)
        if self.forces and has_section_forces(point.mesh):
            if name not in self._sections:
                self._sections[name] = SectionForces(self.model, point.mesh, np.array([point.xi]))
            values.update(zip(FORCES, self._sections[name](state, np.array([point.ie]))[0, 0].tolist(), strict=True))
        return {k: float(v) for k, v in values.items()}

    def slopes(self, name: str, quantity: str, state: State) -> tuple[Index, Array, Array]:
        """Return coordinates (m,), and the derivatives (m,) of a quantity (not N, Q, M) by them and by their rates."""
        point, rotation = self.probes[name], self.rotations[name]
        e = self.model.e0 + state.d[:self.model.n_q]
        by_theta = rotation.gradient(e)
        if quantity in ("theta", "omega"):
            none = np.zeros(len(rotation.dofs))
            if quantity == "theta":
                return rotation.dofs, by_theta, none
            assert state.v is not None
            return rotation.dofs, _turning_rate(rotation, e, state.v), by_theta
        axis = 0 if quantity.endswith("x") else 1
        coords, by = point.carrier.position()[axis]
        if not point.offset:
            none = np.zeros(len(coords))
            return (coords, none, by) if quantity.startswith("v") else (coords, by, none)
        theta = self.model.turns.theta(rotation, e, state.d[:self.model.n_q], turns_of(self.model, state))
        return _carried_slopes(point, rotation, quantity.startswith("v"), axis, theta, e, state, (coords, by), by_theta)


def _turning_rate(rotation: Rotation, e: Array, v: Array) -> Array:
    """Return the derivatives (m,) of a rotation rate by the coordinates, from differences of its gradient."""
    out = np.zeros(len(rotation.dofs))
    for k, i in enumerate(rotation.dofs.tolist()):
        h, moved = 1e-3 * (float(np.abs(e[rotation.dofs]).max()) or 1.0), e.copy()
        for step, weight in ((1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)):
            moved[i] = e[i] + step * h
            out[k] += weight / (12.0 * h) * float(rotation.gradient(moved) @ v[rotation.dofs])
    return out


def _carried_slopes(point: PointRef, rotation: Rotation, rate: bool, axis: int, theta: float, e: Array, state: State,
                    of_axis: tuple[Index, Array], by_theta: Array) -> tuple[Index, Array, Array]:
    """Return the result of ``Observer.slopes`` for a point off the axis of a rigid section, or its rate."""
    y, angle = point.offset, point.angle + theta
    coords = np.concatenate([of_axis[0], rotation.dofs])
    # derivative of the normal (-sin, cos) with respect to the angle, and the second one
    turned, again = ((-np.cos(angle), -np.sin(angle))[axis], (np.sin(angle), -np.cos(angle))[axis])
    of_place = np.concatenate([of_axis[1], y * turned * by_theta])
    if not rate:
        return coords, of_place, np.zeros(len(coords))
    assert state.v is not None
    omega = float(by_theta @ state.v[rotation.dofs])
    by_d = y * (again * omega * by_theta + turned * _turning_rate(rotation, e, state.v))
    return coords, np.concatenate([np.zeros(len(of_axis[0])), by_d]), of_place


def turns_of(model: Model, state: State) -> Array:
    """Return the rotation (bodies,) at S = 0 of each body in a state, counted through full turns."""
    return model.turns.from_reference(state.d) if state.turned is None else state.turned


def position_of(point: PointRef, e0: Array, d: Array, theta: float, linear: bool) -> tuple[Array, Array]:
    """Return the reference position (2,) and displacement (2,) of a point, on or off the axis."""
    columns, y = point.carrier.position(), point.offset
    r0, u = np.array([dot(c, e0) for c in columns]), np.array([dot(c, d) for c in columns])
    if y:
        # rigid section: y times the change of its normal
        normal = np.array([-np.sin(point.angle), np.cos(point.angle)])
        r0 = r0 + y * normal
        turn = np.array([-normal[1], normal[0]])
        u = u + y * (theta * turn if linear else np.sin(theta) * turn - 2 * np.sin(theta / 2) ** 2 * normal)
    return r0, u


def velocity_of(point: PointRef, v: Array, theta: float, omega: float) -> Array:
    """Return the velocity (2,) of a point, on or off the axis."""
    out = np.array([dot(c, v) for c in point.carrier.position()])
    if point.offset:
        angle = point.angle + theta
        out -= omega * point.offset * np.array([np.cos(angle), np.sin(angle)])
    return out


def reactions(model: Model, state: State) -> dict[str, dict[str, float]]:
    """Return fx, fy and moment of each support on its body, about its point, and of obstacles about their centre."""
    lam, _ = equilibrium_rows(model, state)
    d = state.d[:model.n_q]
    e = model.e0 if state.linear else model.e0 + d
    out, held = {}, constraint_forces(model, state)
    for name, point in model.supports:
        centre = np.array([dot(c, e) for c in point.position()])
        total = np.zeros(3)
        mine = [(r.coords, value * r.coefs) for r, value in zip(model.rows, lam, strict=True) if r.owner == name]
        if mine:
            coords, forces = map(np.concatenate, zip(*mine, strict=True))
            total += forces @ rigid_motion(point.mesh, coords, e, centre)
        for constraint, (dofs, forces) in zip(model.constraints, held, strict=True):
            if constraint.owner == name:
                total += forces @ rigid_motion(point.mesh, dofs, e, centre)
        out[name] = dict(zip(("fx", "fy", "m"), (float(v) for v in total), strict=True))
    if model.contacts:
        from .contact import obstacle_reactions

        out.update(obstacle_reactions(model, state))
    return out


def energies(model: Model, state: State) -> dict[str, float]:
    """Return strain, kinetic and (gravity) potential energy of a state."""
    if state.v is None:
        from .energy import extra_energy

        with model.remembering(state.memory):
            kept = 0.0 if state.linear or state.about is not None else sum(extra_energy(model, state.d, state.side)[:2])
        return {"strain": state.energy + kept, "kinetic": 0.0, "potential": model.gravity_potential(state.d, state.t)}
    moving = Energies(model)
    kinetic = moving.kinetic(state.v) + moving.carried(state.d, state.v, state.side)[0]
    potential = moving.potential(state.d) + moving.lifted(state.d, state.side)
    return {"strain": state.energy, "kinetic": kinetic, "potential": potential}


def unbalanced_forces(model: Model, state: State) -> float:
    """Return the sum of the unbalanced forces of a state [force]: no force in it is more accurate.

    They are the absolute residuals of the free positions (coordinates r).
    """
    numbering = model.numbering
    positions = np.concatenate([mesh.kinds < 2 for mesh in model.meshes.values()])
    free = numbering.free < model.n_q
    R = numbering.reduce(state.Q - state.F)[free]
    return float(np.abs(R[positions[numbering.free[free]]]).sum())
