"""Inputs and outputs of small motions, N, Q and M linearised, and warnings about parts of a case without effect."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...elements.shape import Array
from ...errors import ComputationError
from ...interactions.forces import LoadSet
from ...kernels.elements import natural_slope
from ...model.mesh import Index
from ...model.point_patch import PointConstraint
from ...model.point_tables import Batch, Interactions
from ...model.points import PointRef
from ...model.rotation import Rotation
from ...model.timing import InputMotion
from ...quantities import FORCES
from ..element_loads import influencing_coordinates
from ..linear import full_mass
from ..section_forces import SectionForces, has_section_forces
from ..state import State
from ..state_results import asks_for_forces, velocity_of
from ..statics.newton import balanced
from .linearised import Linearised, Relaxing

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


# displacement relative to the element size for differences of forces, which cancel each other so far that their
# round-off matters; the same if contact points may open and close
SMALL, CLOSE = 1e-3, 1e-5
# load factor for differences of natural strains
FACTOR = 1e-3


class SmallForces:
    """The section forces of one probe in small motions about a state.

    ``coords`` (n,) and ``weights`` (3, 3, n): N, Q, M are the sum of weights[:, k] @ d[coords] with the coordinates d
    (n_full,), their rates and their second rates for k = 0, 1, 2. Raises ComputationError if a support or joint without
    a multiplier holds the probe's element between its nodes.
    """

    def __init__(self, small: Linearised, name: str, point: PointRef) -> None:
        base = small.base
        case, self.small, self.name, self.point = base.model.case, small, name, point
        acting = [load for load in case.loads if base.loaded and load.name not in case.inputs]
        # a state without rates, with the forces of elements as linear as their tangent
        still = np.zeros((2, len(base.state.d)))
        self.state = replace(base.state, linear=False, v=still[0], a=still[1], about=base.state.d)
        self.model = replace(base.model, case=replace(case, loads=tuple(acting)), inputs={})
        coords = influencing_coordinates(self.model, point.mesh, point.ie, base.state)
        if coords is None:
            raise ComputationError(f"N, Q and M of the probe {name} are not computed, because a support or joint holds "
                                   "its element between the nodes or by a whole section", at={"probe": name},
                                   advice="the default element.nodes, which places a node there, or another probe")
        self.coords = coords
        self.forces = SectionForces(self.model, point.mesh, np.array([point.xi]))
        self.weights = np.stack([self._derivatives(rate) for rate in range(3)], axis=1)

    def by_strain_rates(self) -> Array:
        """Return the derivatives (3, n) of N, Q, M by strain rates alone: viscous forces with a time of 1 s."""
        tau = self.forces.tau
        self.forces.tau = tau + 1.0
        found = self._derivatives(1) - self.weights[:, 1]
        self.forces.tau = tau
        return np.asarray(found)

    def _derivatives(self, rate: int) -> Array:
        """Return the derivatives (3, n) by coordinates, their rates or their second rates."""
        n_q, out = self.model.n_q, np.zeros((3, len(self.coords)))
        key = ("d", "v", "a")[rate]
        start, mesh = getattr(self.state, key), self.point.mesh
        size = min(float(mesh.lengths[self.point.ie]), 0.5 * mesh.plan.section.height)
        size *= CLOSE if self.model.contacts else SMALL
        for k, c in enumerate(self.coords.tolist()):
            if rate and c >= n_q:
                continue  # multipliers have no rates
            # forces are linear in multipliers
            h = size / float(self.model.weights[c]) if c < n_q else max(1.0, abs(start[c]))
            near = self._quotient(key, c, h)
            # rates and multipliers are linear: a difference of second order is exact
            out[:, k] = near if rate or c >= n_q else near + (near - self._quotient(key, c, 2.0 * h)) / 3.0
        return out

    def _quotient(self, key: str, c: int, h: float) -> Array:
        """Return the central difference (3,) of N, Q, M by a coordinate, a rate or a second rate."""
        ends, places = [], []
        for step in (h, -h):
            moved = getattr(self.state, key).copy()
            moved[c] += step
            ends.append(self._at(self.forces, replace(self.state, **{key: moved})))
            places.append(moved[c])
        # the actual steps after rounding
        return (ends[0] - ends[1]) / (places[0] - places[1])

    def _at(self, forces: SectionForces, state: State) -> Array:
        return np.asarray(forces(state, np.array([self.point.ie]))[0, 0])

    def direct(self, name: str) -> Array:
        """Return the direct contribution of an input load to N, Q, M (3,), without motion."""
        model = self.small.base.model
        loads = model.inputs.get(name)
        if loads is None:
            return np.zeros(3)
        # natural strains are not quite linear in their size; loads without an amplitude follow the load factor
        natural = [replace(one, amplitude=lambda t: t) for one in loads.natural]
        guides = [replace(one, tension=lambda d, t, by=one.tension_slope: t * by(d)) for one in loads.guides]
        own = tuple(replace(load, amplitude=None) for load in model.case.loads if load.name == name)
        alone = replace(model, case=replace(model.case, loads=own, steady_rotation=None), inputs={},
                        loads=LoadSet(natural=natural, guides=guides))
        forces = SectionForces(alone, self.point.mesh, np.array([self.point.xi]))
        ends = [self._at(forces, replace(self.state, side=step)) for step in (FACTOR, -FACTOR)]
        alone.set_natural(None)
        return (ends[0] - ends[1]) / (2.0 * FACTOR)


@dataclass(frozen=True)
class Input:
    """The effect of a unit of one input u on small motions d = T z + p u.

    K z + C z' + M z'' = f[0] u + f[1] u' + f[2] u''. ``f`` (3, n_unknowns): loads have only the first row; ``p``
    (n_full,): prescribed motion, 0 for loads. ``relaxing`` (materials, n_unknowns): the part of f[0] from strains of
    relaxing materials, in the order of ``Linearised.relaxing``, which is also multiplied by their function of s.
    """

    name: str
    f: Array
    p: Array
    relaxing: Array


@dataclass(frozen=True)
class Output:
    """A quantity of a probe: sum of weights[k] @ d[coords] over the coordinates d, their rates and second rates.

    ``weights`` (3, n); ``direct``: direct contributions of inputs, by name. ``relaxed``: the part from a relaxing
    material, to be multiplied by its function of s and added.
    """

    probe: str
    quantity: str
    coords: Index
    weights: Array
    direct: dict[str, float] = field(default_factory=dict)
    relaxed: Relaxed | None = None

    @property
    def order(self) -> int:
        """The lowest order of rates on which it depends."""
        return int(np.flatnonzero(self.weights.any(axis=1))[0]) if self.weights.any() else 0

    def contributions(self, d: Array) -> Array:
        """Return the contributions (3,) of d (n_full,) used as coordinates, as rates and as second rates."""
        return np.asarray(self.weights @ d[self.coords])

    def response(self, s: complex, d: NDArray[np.complex128], name: str) -> complex:
        """Return the amplitude in a motion d exp(s t) (n_full,) caused by a unit of the input ``name``."""
        out = self.direct.get(name, 0.0) + complex(s ** np.arange(3) @ (self.weights @ d[self.coords]))
        if self.relaxed is not None:
            own = self.relaxed
            out += own.material.factor(s) * (complex(own.weights @ d[self.coords]) + own.direct.get(name, 0.0))
        return out


@dataclass(frozen=True)
class Relaxed:
    """The part of a section force that comes from strains of a relaxing material, at its long-time modulus.

    ``weights`` (n,) of the coordinates; ``direct``: direct contributions of natural strains, by the name of the input.
    """

    material: Relaxing
    weights: Array
    direct: dict[str, float]


class Inputs:
    """Makes inputs from the names of a model's loads and prescribed motions."""

    def __init__(self, small: Linearised) -> None:
        self.small, self.model = small, small.model
        self.d = small.base.state.d

    def __call__(self, names: Sequence[str]) -> list[Input]:
        """Return the inputs of these names. Raises ComputationError if another support holds a moved coordinate."""
        self._check()
        return [self._load(name) if name in self.model.inputs else self._motion(name) for name in names]

    def _check(self) -> None:
        rows = self.model.rows
        for _, combined in self.model.elimination.redundant:
            for r in combined:
                if isinstance(rows[r].signal, InputMotion):
                    others = sorted({rows[k].owner for k in combined} - {rows[r].owner})
                    raise ComputationError(
                        f"the input {rows[r].owner} moves {rows[r].holds}, which {', '.join(others)} holds too",
                        advice="supports that hold or move each point once")

    def _load(self, name: str) -> Input:
        model, f = self.model, np.zeros((3, self.small.n))
        f[0] = model.numbering.reduce(load_forces(self.small, model.inputs[name]))
        strained = [natural_forces(self.small, model.inputs[name], one.groups) for one in self.small.relaxing]
        return Input(name, f, np.zeros(len(self.d)), self._reduced(strained))

    def _motion(self, name: str) -> Input:
        model, num, n_q = self.model, self.model.numbering, self.model.n_q
        p, force = np.zeros(len(self.d)), np.zeros(len(self.d))
        for coord, dependent in model.elimination.dependents.items():
            for r, factor in dependent.rhs.items():
                drive = model.rows[r].signal
                if isinstance(drive, InputMotion) and drive.name == name:
                    p[coord] += factor * drive.amplitude
        for constraint in model.constraints:
            if isinstance(constraint, PointConstraint) and isinstance(constraint.signal, InputMotion) \
                    and constraint.signal.name == name:
                self._add_driven(constraint, constraint.signal.amplitude, force)
        inertia = np.zeros(len(p))
        inertia[:n_q] = self._mass @ p[:n_q]
        rates = self.small.rates(self.d, p, self.small.base.state.t, lambda: self._mass, linear=True)
        full = (force - self.small.pencil.full_stiffness(p), -rates, -inertia)
        strained = [-one.forces(p) for one in self.small.relaxing]
        return Input(name, np.array([num.reduce(part) for part in full]), p, self._reduced(strained))

    def _reduced(self, forces: Sequence[Array]) -> Array:
        return np.array([self.model.numbering.reduce(one) for one in forces]).reshape(-1, self.small.n)

    def _add_driven(self, constraint: PointConstraint, amplitude: float, out: Array) -> None:
        """Subtract the change of a constraint's forces with the angle that it prescribes."""
        rows, coords = constraint.rows, constraint.coordinates
        _, H, _ = constraint.forces(rows @ self.d[coords], 0.0)
        np.add.at(out, coords, -amplitude * (rows.T @ H[:, constraint.fed]))

    @cached_property
    def _mass(self) -> csr_matrix:
        return full_mass(self.model, self.model.e0 + self.d[:self.model.n_q])


def load_forces(small: Linearised, loads: LoadSet) -> Array:
    """Return the forces (n_full,) of loads at full size, for loads that turn at the state of ``small``."""
    model, d = small.model, small.base.state.d
    out = np.zeros(len(d))
    for load in loads.dead:
        np.add.at(out, load.dofs, load.values * load.amplitude(1.0))
    e = model.e0 + d[:model.n_q]
    for batch in Interactions([], loads.patches, [], model.e0).loads:
        np.subtract.at(out, batch.dofs, batch.evaluate(e, d, 1.0)[1])
    for tendon in loads.springs:
        np.add.at(out, tendon.coordinates, tendon.winding_forces(d))
    return out + natural_forces(small, loads, model.groups)


def natural_forces(small: Linearised, loads: LoadSet, groups: Sequence[Any]) -> Array:
    """Return the forces (n_full,) that natural strains of loads at full size cause in groups of elements."""
    model, d = small.model, small.base.state.d
    out = np.zeros(len(d))
    if not loads.natural:
        return out
    model.set_natural(small.base.state.t if small.base.loaded else None)
    for strain in loads.natural:
        strain.amount[1] = strain.amplitude(1.0)
    for group in groups:
        natural_slope(group, d, out)
    for strain in loads.natural:
        strain.amount[1] = 0.0
    return -out


def outputs(small: Linearised, inputs: Sequence[str] = ()) -> list[Output]:
    """Return x, y, ux, uy, theta, vx, vy and omega of every probe, as changes from the state of ``small``.

    Also N, Q and M if the case asks for them, with the direct contributions of ``inputs``.
    """
    model, out = small.model, []
    for name, at in model.case.output.probes.items():
        point = model.point(at.at, at.y)
        out += _of_probe(small, name, point)
        if asks_for_forces(model.case) and has_section_forces(point.mesh):
            out += _of_forces(small, SmallForces(small, name, point), inputs)
    return out


def _of_forces(small: Linearised, found: SmallForces, inputs: Sequence[str]) -> list[Output]:
    direct, terms = {one: found.direct(one) for one in inputs}, found.point.mesh.plan.section.maxwell
    material = next((one for one in small.relaxing if one.terms == terms), None) if terms else None
    parts: list[Relaxed | None] = [None] * 3
    if material is not None:
        natural = [one for one in inputs if one in small.model.inputs and small.model.inputs[one].natural]
        parts = [Relaxed(material, weights, {one: float(direct[one][k]) for one in natural})
                 for k, weights in enumerate(found.by_strain_rates())]
    return [Output(found.name, q, found.coords, found.weights[k], {one: float(f[k]) for one, f in direct.items()},
                   parts[k]) for k, q in enumerate(FORCES)]


def _of_probe(small: Linearised, name: str, point: PointRef) -> list[Output]:
    model, d = small.model, small.base.state.d
    rotation, e = Rotation(point), model.e0 + d[:model.n_q]
    gradient, theta = rotation.gradient(e), rotation.value(e, d)
    coords = np.unique(np.concatenate([rotation.dofs, *(c for c, _ in point.position())]))
    unit, values = np.zeros(len(d)), np.zeros((3, len(coords)))
    for k, coord in enumerate(coords.tolist()):
        unit[coord] = 1.0
        omega = float(gradient @ unit[rotation.dofs])
        values[:2, k], values[2, k] = velocity_of(point, unit, theta, omega), omega
        unit[coord] = 0.0
    along = dict(zip(("x", "y", "theta"), values, strict=True))
    names = {"x": "x", "y": "y", "ux": "x", "uy": "y", "theta": "theta"}
    rates = {"vx": "x", "vy": "y", "omega": "theta"}
    return [Output(name, q, coords, np.eye(3)[order][:, None] * along[of])
            for order, group in enumerate((names, rates)) for q, of in group.items()]


def warnings_of(small: Linearised, damped: bool = True, inputs: Sequence[Input] = ()) -> list[str]:
    """Return warnings about inputs and dampers without effect, and about unbalanced forces in the reference.

    Dampers are checked only if ``damped``.
    """
    model, base = small.model, small.base
    out = [f"{what}: its damping force is of higher order in the rates, so it has no effect on small motions"
           for what in _of_higher_order(small)] if damped else []
    out += [f"the input {one.name} exerts no force and moves nothing in this state, so nothing responds to it"
            for one in inputs if not one.f.any() and not one.p.any()]
    pencil = small.pencil
    if not base.loaded and not balanced(pencil.system, pencil.balance, pencil.d, base.state.t):
        layers = any(contact.law is not None for contact in model.case.contacts)
        acts = [*["springs are loaded"] * bool(model.case.springs), *["contact layers press"] * layers,
                *["material flows"] * bool(model.loads.flows)]
        out.append(f"the reference is not an equilibrium, because {' or '.join(acts)} there. Use about: static")
    return out


def _of_higher_order(small: Linearised) -> Iterator[str]:
    """Yield the springs and loads whose damping has no first-order term in the rates."""
    model, state = small.model, small.base.state
    loads = [(f"loads.{k}", item) for k, item in enumerate(model.case.loads)
             if getattr(item, "damped", False) and item.name not in model.inputs]
    drags = [patch for patch in model.loads.patches if getattr(patch, "damped", False)]
    parts: list[tuple[str, Any]] = [*((patch.path, patch) for patch in model.springs if patch.path and patch.damped),
                                    *((what, patch) for (what, _), patch in zip(loads, drags, strict=False))]
    for what, patch in parts:
        batch = Batch([patch])
        *_, C = batch.matrices(state.d, state.t)
        if not C.any():
            yield what
