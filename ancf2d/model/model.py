"""The arrays that a solver needs, made from a case."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..case import Case, Latch, LoadedCase, Point
from ..elements.shape import Array
from ..interactions.forces import LoadSet, Patch
from ..interactions.springs import Spring
from .body_groups import Pool, make_pools
from .constraints import Constraint, Row
from .mesh import BodyMesh, Index, joined
from .numbering import Elimination, Numbering
from .points import PointRef, point_ref
from .rotation import Turns
from .timing import Timing

if TYPE_CHECKING:
    from ..interactions.body_contact import BodyPair
    from ..interactions.contact import ContactPair
    from ..interactions.obstacles import Frame
    from .contact_tables import ContactTable
    from .feedback import Feedback
    from .point_tables import Interactions


def symmetric(loads: LoadSet, contacts: Sequence[ContactPair | BodyPair] = ()) -> bool:
    """Return whether loads and contacts keep the tangent symmetric: follower forces and friction have no potential."""
    return (not loads.flows and all(p.symmetric for p in loads.patches)
            and not any(c.item.friction for c in contacts))


@dataclass
class Model:
    """Bodies, connections, loads and numbering of one case.

    ``e0`` (n_q,) are the reference nodal coordinates; the current ones are e0 + d. ``loaded`` is the case with its
    source positions, for problems that are found only after the model is built.
    """

    case: Case
    meshes: dict[str, BodyMesh]
    e0: Array
    rows: list[Row]
    constraints: list[Constraint]
    elimination: Elimination
    numbering: Numbering
    loads: LoadSet
    springs: list[Spring]
    supports: list[tuple[str, PointRef]]
    extent: float
    timing: Timing
    warnings: list[str] = field(default_factory=list)
    loaded: LoadedCase | None = None
    # only gravity holds the model: the reference is a mechanism
    hangs: bool = False
    # the loads that are inputs of small motions, by name; they are not in ``loads``
    inputs: dict[str, LoadSet] = field(default_factory=dict)
    contacts: list[ContactPair | BodyPair] = field(default_factory=list)
    # reference pose and motion of each obstacle, by name
    frames: dict[str, Frame] = field(default_factory=dict)
    # a model with which it shares meshes and classes of elements
    like: Model | None = None
    # the linear equations that were found to leave no body free to move
    checked_rows: tuple[Any, ...] | None = None

    @property
    def n_q(self) -> int:
        """Number of nodal coordinates before elimination."""
        return len(self.e0)

    @property
    def n_elements(self) -> int:
        """Number of elements of all bodies."""
        return sum(m.plan.count for m in self.meshes.values())

    def point(self, at: Point, y: float = 0.0) -> PointRef:
        """Return the reference to a point of the case."""
        return point_ref(self.meshes[at.body], at.s, y)

    @cached_property
    def _groups(self) -> tuple[list[Any], Array]:
        from .groups import make_group, with_states

        natural = [*self.loads.natural, *(load for one in self.inputs.values() for load in one.natural)]
        known = [] if self.like is None else zip(self.like.pools, self.like.groups, strict=True)
        sampled = {pool.plan.name: (pool, group) for pool, group in known}
        return with_states([make_group(pool, natural, sampled.get(pool.plan.name)) for pool in self.pools])

    @property
    def groups(self) -> list[Any]:
        """The element groups in the form that the kernels need (imports numba)."""
        return self._groups[0]

    @property
    def states(self) -> Array:
        """History variables of the elements at the last accepted state, in one array; solvers update it."""
        return self._groups[1]

    @contextmanager
    def remembering(self, states: Array | None) -> Iterator[None]:
        """Replace the elements' history variables by ``states`` within the context; None keeps the current ones."""
        now = self.states.copy() if states is not None else None
        if states is not None:
            self.states[:] = states
        try:
            yield
        finally:
            if now is not None:
                self.states[:] = now

    @cached_property
    def clocks(self) -> Index:
        """Places in ``states`` of the time since the last accepted state, one for each point of a law that relaxes."""
        runs = [first + size - 1 + size * np.arange(points) for _, first, points, size, *_ in self.relaxing[0].tolist()]
        return np.concatenate([np.zeros(0, dtype=np.int64), *runs])

    @cached_property
    def relaxing(self) -> tuple[Index, Array]:
        """Places of relaxing laws in ``states`` (m, 8), and their Maxwell terms (n, 2): modulus and time [s].

        Rows of the first are (group, first number, points, numbers of a point, strains, first term, terms, first of the
        strains of all points); groups with the same Maxwell terms share these.
        """
        runs, terms, first, strains = list[list[int]](), list[tuple[float, float]](), 0, 0
        places = dict[tuple[tuple[float, float], ...], int]()
        # making groups loads the element kernels, which models without relaxing laws do not need here
        relaxes = any(pool.plan.formulation.law.timed for pool in self.pools)
        for k, (pool, group) in enumerate(zip(self.pools, self.groups, strict=True) if relaxes else ()):
            law, size, own = pool.plan.formulation.law, group.values.memory.states.size, pool.plan.section.maxwell
            if law.timed:
                if own not in places:
                    places[own] = len(terms)
                    terms += own
                runs.append([k, first, size // law.state, law.state, law.strains, places[own], len(own),
                             strains])
                strains += size // law.state * law.strains
            first += size
        return np.array(runs, dtype=np.int64).reshape(-1, 8), np.array(terms).reshape(-1, 2)

    def set_step(self, h: float) -> None:
        """Set the time [s] since the last accepted state of laws that relax; infinite means fully relaxed."""
        self.states[self.clocks] = h

    @property
    def maxwell(self) -> list[tuple[tuple[float, float], ...]]:
        """The distinct sets of Maxwell terms of the materials."""
        return [terms for terms in dict.fromkeys(m.plan.section.maxwell for m in self.meshes.values()) if terms]

    @property
    def remembers(self) -> list[str]:
        """The bodies whose law has inelastic history variables, so that their forces depend on the path to a state."""
        laws = {m.plan.name: m.plan.formulation.law for m in self.meshes.values()}
        return [name for name, law in laws.items() if law.remembers]

    @cached_property
    def pools(self) -> list[Pool]:
        """The pools: bodies of the same kind, one pool for each element group."""
        return make_pools(self.case, self.meshes)

    @cached_property
    def weights(self) -> Array:
        """Displacement [m] that one unit of each nodal coordinate stands for (n_q,)."""
        return joined([m.weights for m in self.meshes.values()])

    @cached_property
    def straining(self) -> Array:
        """Weights of Newton's increments (n_q,) [m]: displacements, or in slender elements an equally large strain."""
        from .numbering import straining_weights

        return joined([straining_weights(m, self.extent) for m in self.meshes.values()])

    @cached_property
    def turns(self) -> Turns:
        """The counter of full turns of the bodies."""
        return Turns(self.meshes)

    @property
    def winds(self) -> bool:
        """Return whether forces depend on full turns: there are torsion springs on sections without theta."""
        return any(end is not None for spring in self.springs for end in spring.sections)

    @property
    def sided(self) -> bool:
        """Return whether there are unilateral constraints: contacts without a law."""
        return any(contact.hard for contact in self.contacts)

    @cached_property
    def contact_tables(self) -> list[ContactTable]:
        """The tables of contact points, one for each contact (imports numba if there are any)."""
        if not self.contacts:
            return []
        from .contact_tables import contact_table

        self.interactions  # noqa: B018  the tables need constants that this sets
        return [contact_table(self.constraints, pair) for pair in self.contacts]

    @property
    def symmetric(self) -> bool:
        """Return whether the tangent is symmetric: follower forces and friction have no potential."""
        return symmetric(self.loads, self.contacts)

    def prescribed(self, t: float, out: Array, order: int = 0) -> None:
        """Add the right-hand sides of prescribed motion at t to the dependent coordinates of ``out``.

        ``order`` 1 and 2 add their first and second time derivatives instead.
        """
        values: dict[int, float] = {}
        for coord, dependent in self.elimination.dependents.items():
            for r, factor in dependent.rhs.items():
                if self.rows[r].signal is not None:
                    if r not in values:
                        values[r] = self.rows[r].value(t, order)
                    out[coord] += factor * values[r]

    @cached_property
    def moves(self) -> bool:
        """Return whether some linear row prescribes a motion."""
        return any(r.signal is not None for r in self.rows)

    def displacements(self, z: Array, t: float, out: Array | None = None) -> Array:
        """Return the full coordinates (n_full,) of unknowns z at load factor or time t, in ``out`` if given."""
        if out is None:
            out = np.zeros(len(self.numbering.place))
        else:
            out.fill(0.0)
        self.numbering.expand(z, out)
        if self.moves:
            self.prescribed(t, out)
        return out

    def external(self, t: float) -> Array:
        """Return the dead loads Q_k (n_full,) at t."""
        out = np.zeros(len(self.numbering.place))
        for load in self.loads.dead:
            factor = load.amplitude(t)
            if factor != 0.0:
                np.add.at(out, load.dofs, load.values * factor)
        return out

    def set_natural(self, t: float | None, rates: dict[int, float] | None = None) -> None:
        """Set the natural strains of the elements to those at load factor or time t, or to zero if t is None.

        ``rates`` maps numbers of ``loads.natural`` to the rates of these loads; all other rates are 0.
        """
        for k, load in enumerate(self.loads.natural):
            load.amount[:] = 0.0 if t is None else load.at(t)
            load.amount[1] = rates.get(k, 0.0) if rates else 0.0

    def gravity_potential(self, d: Array, t: float) -> float:
        """Return the potential of gravity relative to the reference."""
        return -sum(float(load.values @ d[load.dofs]) * load.amplitude(t)
                    for load in self.loads.dead if load.gravity)

    def coordinate_names(self) -> list[str]:
        """Return a label such as 'ry_x of beam at S = 0.25' for every nodal coordinate (n_q,)."""
        out = [""] * self.n_q
        for body, mesh in self.meshes.items():
            nodes = zip(mesh.coordinate_names, mesh.plan.element.nodes, strict=True)
            labels = [(label, node.at) for names, node in nodes for label in names]
            for local, (label, at) in enumerate(labels):
                along = (mesh.starts + at * mesh.lengths) / mesh.plan.length
                for full, s in zip(mesh.dofs[:, local].tolist(), along.tolist(), strict=True):
                    out[full] = f"{label} of {body} at S = {s:.4g}"
        return out

    def describe_coordinate(self, full: int) -> str:
        """Return the label of a nodal coordinate."""
        return self.coordinate_names()[full]

    def describe_multiplier(self, number: int) -> str:
        """Return the label of the multiplier of constraint ``number``."""
        constraint = self.constraints[number]
        return f"the multiplier of {constraint.owner} ({constraint.holds})"

    @cached_property
    def interactions(self) -> Interactions:
        """Springs, turning and moving loads and constraints in the form that the kernels need (imports numba)."""
        from .contacts import set_stick_stiffness
        from .point_tables import Interactions

        out = Interactions(self.springs, self.loads.patches, self.constraints, self.e0, self.loads.flows)
        set_stick_stiffness(self, out)
        return out

    @cached_property
    def feedback(self) -> Feedback:
        """The signals that depend on the motion, possibly none. Raises CaseError for a probe that cannot be used."""
        from .feedback import Feedback

        return Feedback(self, list(getattr(self.timing, "feedback", {}).values()))

    @property
    def hardens(self) -> bool:
        """Return whether a fibre law is inelastic."""
        return any(not law.elastic for pool in self.pools for law in pool.plan.section.laws)

    @property
    def hinges(self) -> bool:
        """Return whether fibres yield until they bear hardly more stress, so that a section becomes a plastic hinge."""
        return any(law.flows for pool in self.pools for law in pool.plan.section.laws)

    @property
    def latches(self) -> list[Latch]:
        """The latches, which switch items on and off by conditions."""
        return list(getattr(self.timing, "latches", {}).values())

    @property
    def patches(self) -> list[Patch]:
        """All springs, loads and flows with forces that depend on the configuration; without the elements."""
        return [*self.springs, *self.loads.patches, *self.loads.flows]


