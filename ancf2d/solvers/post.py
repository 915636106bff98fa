"""What a state means to its user: probes, reactions, section forces, energies, balance of forces."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..case import Case, Constant
from ..elements.shape import Array
from ..interactions.forces import DeadLoad
from ..model.mechanism import rigid_motion
from ..model.mesh import Index
from ..model.model import Model
from ..model.points import PointRef, dot
from ..model.rotation import Rotation
from ..model.timing import Signal
from .inside import constraint_forces, equilibrium_rows
from .section_forces import has_section_forces, section_forces
from .state import State

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


def is_constant(amplitude: Callable[[float], float]) -> bool:
    """Whether what a load of a dynamic case follows has the same value at all times."""
    return isinstance(amplitude, Signal) and (amplitude.amplitude is None or isinstance(amplitude.amplitude, Constant))


def has_potential(load: DeadLoad) -> bool:
    """Whether a dead load counts as potential energy, and not by the work it does: gravity that is constant."""
    return load.gravity and is_constant(load.amplitude)


class Kinds:
    """Full coordinates by what they are: ``x`` of positions and gradients (their y is next), ``theta``, ``place``.

    ``place`` are those of ``x`` that are positions.
    """

    def __init__(self, model: Model) -> None:
        kinds = np.concatenate([m.kinds for m in model.meshes.values()])
        self.x: Index = np.flatnonzero((kinds == 0) | (kinds == 3))
        self.place: Index = np.flatnonzero(kinds == 0)
        self.theta: Index = np.flatnonzero(kinds == 2)

    def translation(self, out: Array, vx: float, vy: float) -> None:
        """Add the rates of a translation to ``out`` (n_q,)."""
        out[self.place] += vx
        out[self.place + 1] += vy

    def rotation(self, out: Array, e: Array, omega: float, about: tuple[float, float] = (0.0, 0.0)) -> None:
        """Add the rates of nodal coordinates e (n_q,) that turn about a point: omega x them; omega for theta."""
        out[self.x] -= omega * e[self.x + 1]
        out[self.x + 1] += omega * e[self.x]
        out[self.theta] += omega
        self.translation(out, omega * about[1], -omega * about[0])


class Energies:
    """Kinetic, strain and potential energy and the momentum of one model at states (d, v) in full coordinates."""

    def __init__(self, model: Model) -> None:
        self.model, self.kinds = model, Kinds(model)
        self.gravity = [(load, float(load.amplitude(0.0))) for load in model.loads.dead if has_potential(load)]

    @cached_property
    def M(self) -> csr_matrix:
        """The mass matrix (n_q, n_q) of all nodal coordinates."""
        from .linear import full_mass

        return full_mass(self.model)

    def kinetic(self, v: Array) -> float:
        """Return v^T M v/2."""
        v = v[:self.model.n_q]
        return 0.5 * float(v @ (self.M @ v))

    def strain(self, d: Array, t: float) -> float:
        """Return the elastic energy of elements and springs."""
        from ..kernels.elements import force

        Q = np.zeros(len(d))
        self.model.set_natural(t)
        energy = sum(float(force(group, d, Q)) for group in self.model.groups)
        return energy + self.model.interactions.energy(d, t)

    def potential(self, d: Array) -> float:
        """Return the potential of gravity that is constant, measured from the reference."""
        return -sum(factor * float(load.values @ d[load.dofs]) for load, factor in self.gravity)

    def momentum(self, d: Array, v: Array) -> tuple[float, float, float]:
        """Return the linear momentum px, py and the angular momentum about the origin.

        With m the momenta M v of the coordinates: sums over positions, and over e x m of all vectors plus those of
        theta.
        """
        n_q = self.model.n_q
        m, e, x = self.M @ v[:n_q], self.model.e0 + d[:n_q], self.kinds.x
        angular = e[x] @ m[x + 1] - e[x + 1] @ m[x] + m[self.kinds.theta].sum()
        return float(m[self.kinds.place].sum()), float(m[self.kinds.place + 1].sum()), float(angular)


FORCES = ("N", "Q", "M")


def asks_for_forces(case: Case) -> bool:
    """Whether goal, expected values or fields name a section force."""
    named = [q.quantity for q in (case.goal, *case.expected) if q is not None]
    return any(q in FORCES for q in named) or any(f in FORCES for f in case.output.fields)


class Observer:
    """Reads the probes of a case from states; without ``forces`` no section forces."""

    def __init__(self, model: Model, forces: bool = True) -> None:
        self.model = model
        self.probes = {name: model.point(p.at, p.y) for name, p in model.case.output.probes.items()}
        self.rotations = {name: Rotation(p) for name, p in self.probes.items()}
        self.forces = forces and asks_for_forces(model.case)

    def observe(self, state: State) -> dict[str, dict[str, float]]:
        """Return x, y, ux, uy, theta of every probe; vx, vy, omega of states that move; N, Q, M where asked for."""
        turned = turns_of(self.model, state)
        return {name: self.read(name, state, turned) for name in self.probes}

    def read(self, name: str, state: State, turned: Array) -> dict[str, float]:
        """Return what ``observe`` does of one probe, with the bodies' turns (bodies,) of ``turns_of``."""
        point, rotation, d = self.probes[name], self.rotations[name], state.d[:self.model.n_q]
        e = self.model.e0 + d
        theta = rotation.linear(self.model.e0, d) if state.linear else self.model.turns.theta(rotation, e, d, turned)
        reference, u = place(point, self.model.e0, d, theta, state.linear)
        values = {"x": reference[0] + u[0], "y": reference[1] + u[1], "ux": u[0], "uy": u[1], "theta": theta}
        if state.v is not None:
            omega = float(rotation.gradient(e) @ state.v[rotation.dofs])
            velocity = place_rate(point, state.v, theta, omega)
            values.update(vx=velocity[0], vy=velocity[1], omega=omega)
        if self.forces and has_section_forces(point.mesh):
            values.update(zip(FORCES, section_forces(self.model, state, point), strict=True))
        return {k: float(v) for k, v in values.items()}


def turns_of(model: Model, state: State) -> Array:
    """Return the rotation (bodies,) at S = 0 of each body in a state, counted through full turns."""
    return model.turns.from_reference(state.d) if state.turned is None else state.turned


def _carried(point: PointRef) -> bool:
    """Whether a point off the axis goes with a section that is rigid."""
    return point.eta != 0.0 and point.mesh.plan.element.section_kind != "interpolated"


def _on_axis(point: PointRef) -> PointRef:
    return PointRef(point.mesh, point.s, point.ie, point.xi, point.angle, point.node)


def place(point: PointRef, e0: Array, d: Array, theta: float, linear: bool) -> tuple[Array, Array]:
    """Return the reference position (2,) and displacement (2,) of a point, off the axis too."""
    carried = _carried(point)
    columns = (_on_axis(point) if carried else point).position()
    r0, u = np.array([dot(c, e0) for c in columns]), np.array([dot(c, d) for c in columns])
    if carried:
        # a section that is rigid: y times the change of its normal
        y = 0.5 * point.eta * point.mesh.plan.section.height
        normal = np.array([-np.sin(point.angle), np.cos(point.angle)])
        r0 = r0 + y * normal
        turn = np.array([-normal[1], normal[0]])
        u = u + y * (theta * turn if linear else np.sin(theta) * turn - 2 * np.sin(theta / 2) ** 2 * normal)
    return r0, u


def place_rate(point: PointRef, v: Array, theta: float, omega: float) -> Array:
    """Return the velocity (2,) of a point, off the axis too."""
    carried = _carried(point)
    out = np.array([dot(c, v) for c in (_on_axis(point) if carried else point).position()])
    if carried:
        y, angle = 0.5 * point.eta * point.mesh.plan.section.height, point.angle + theta
        out -= omega * y * np.array([np.cos(angle), np.sin(angle)])
    return out


def reactions(model: Model, state: State) -> dict[str, dict[str, float]]:
    """Return fx, fy and the moment about the point that each support exerts on its body."""
    lam, _ = equilibrium_rows(model, state)
    d = state.d[:model.n_q]
    e = model.e0 if state.linear else model.e0 + d
    out, held = {}, constraint_forces(model, state)
    for name, point in model.supports:
        centre = np.array([dot(c, e) for c in point.position()])
        total = np.zeros(3)
        for row, value in zip(model.rows, lam, strict=True):
            if row.owner == name:
                total += value * (row.coefs @ rigid_motion(point.mesh, row.coords, e, centre))
        for constraint, (dofs, forces) in zip(model.constraints, held, strict=True):
            if constraint.owner == name:
                total += forces @ rigid_motion(point.mesh, dofs, e, centre)
        out[name] = dict(zip(("fx", "fy", "m"), (float(v) for v in total), strict=True))
    return out


def energies(model: Model, state: State) -> dict[str, float]:
    """Return strain, kinetic and (gravity) potential energy of a state."""
    if state.v is None:
        return {"strain": state.energy, "kinetic": 0.0, "potential": model.gravity_potential(state.d, state.t)}
    moving = Energies(model)
    return {"strain": state.energy, "kinetic": moving.kinetic(state.v), "potential": moving.potential(state.d)}


def unbalanced_forces(model: Model, state: State) -> float:
    """Return the sum of the forces that a state leaves without balance [force]: no force in it is known better.

    They are the residuals of the free positions (coordinates r), as absolute values.
    """
    numbering = model.numbering
    positions = np.concatenate([mesh.kinds < 2 for mesh in model.meshes.values()])
    free = numbering.free < model.n_q
    R = numbering.reduce(state.Q - state.F)[free]
    return float(np.abs(R[positions[numbering.free[free]]]).sum())
