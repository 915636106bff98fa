"""Build a model from a case, and collect every problem."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ..case import (
    Active,
    Case,
    GroundPoint,
    LoadedCase,
    MovingPoint,
    Point,
    Static,
)
from ..case.binder import dotted
from ..elements.shape import Array, UnsolvableBasisError
from ..errors import PartError, raise_any
from ..interactions.body_contact import BodyPair
from ..interactions.contact import ContactPair
from ..interactions.flow import Velocity
from ..interactions.forces import LoadContext, LoadSet
from ..interactions.inertia import centrifugal
from ..interactions.joints import JointContext, JointError, weld_pieces
from ..interactions.moving import moving_mass
from ..interactions.obstacles import frame_of
from ..interactions.springs import moving_spring
from .constraints import Equations, keep_lengths, motions
from .contacts import Contacts
from .determinacy import drop_repeated, free_motions, linear_row
from .element_limits import hidden_warning, hinge_warning, locking_warning
from .mesh import BodyMesh, joined
from .model import Model, symmetric
from .numbering import Elimination, eliminate, inconsistent, number
from .plan import acting_at, plan_bodies, reference_extent, warnings_of
from .points import PointRef, point_ref
from .switched import switched
from .timing import InputTiming, PathTiming, Signal, TimeTiming, Timing


def timing_of(case: Case) -> Timing:
    """Return the timing of a case: the signals of loads and prescribed motions, with or without an amplitude."""
    if (case.solver.scales and not case.flows) or case.solver.on_path:
        return PathTiming()
    return TimeTiming() if case.solver.timed else Timing()


def must_be_held(case: Case) -> bool:
    """Return whether the solver needs an equilibrium, so that no rigid motion may be free."""
    if case.solver.vibrates:
        # at frequency 0 the response is an equilibrium
        return getattr(case.solver, "about", "") == "static" or 0.0 in getattr(case.solver, "hz", ())
    return case.solver.balances or case.solver.scales


def can_hang(case: Case) -> bool:
    """Return whether the solver can find the equilibrium of a mechanism under gravity."""
    solver = case.solver
    static = solver.vibrates or (isinstance(solver, Static) and not solver.on_path)
    return static and solver.course[1] > 0.0 and bool(_gravity(case))


def _gravity(case: Case) -> list[Any]:
    """Return the accelerations of the loads that act on all mass; those of inputs do not act."""
    return [load.acceleration for load in case.loads if any(load.acceleration or ()) and load.name not in case.inputs]


def support_names(case: Case) -> list[str]:
    """Return a unique name for each support: its own, or that of its point."""
    names: dict[str, None] = {}
    met: dict[str, int] = {}
    for support in case.boundary_conditions:
        name = base = support.name or f"{support.at.body}@{support.at.s:g}"
        while name in names:
            met[base] = met.get(base, 1) + 1
            name = f"{base} ({met[base]})"
        names[name] = None
    return list(names)


class _Builder:
    """Meshes, equations, loads and problems of one case while its model is built."""

    def __init__(self, loaded: LoadedCase, moving: bool, like: Model | None, exactly: bool) -> None:
        self.loaded, self.case = loaded, loaded.case
        known = {} if like is None else like.meshes
        self.moving = moving
        self.plans, self.problems = plan_bodies(loaded, moving, {name: mesh.plan for name, mesh in known.items()})
        raise_any(self.problems)
        self.meshes: dict[str, BodyMesh] = {}
        dof = node = 0
        for name, plan in self.plans.items():
            try:
                old = known.get(name)
                same = old is not None and old.plan is plan and (old.first_dof, old.first_node) == (dof, node)
                self.meshes[name] = mesh = old if old is not None and same else BodyMesh(plan, dof, node, old, exactly)
            except UnsolvableBasisError as error:
                self.report(("bodies", name, "element"), f"bodies.{name}: elements of length {plan.pieces[0].l:.3g} "
                            f"and height {plan.section.height:.3g} cannot be computed in floating-point numbers "
                            f"({error})",
                            "fewer elements, or a smaller ratio of length and height")
                continue
            dof, node = dof + mesh.n_dofs, node + mesh.n_nodes
        raise_any(self.problems)
        self.e0: Array = joined([m.e0 for m in self.meshes.values()])
        # the model ``like``, if all bodies have the same reference, else None
        self.twin = like if like is not None and list(known) == list(self.meshes) and all(
            mesh.e0 is known[name].e0 for name, mesh in self.meshes.items()) else None
        self.extent = reference_extent(self.plans) if self.twin is None else self.twin.extent
        self.equations = Equations()
        self.loads = LoadSet()
        # loads that are inputs, by name; they do not act
        self.inputs: dict[str, LoadSet] = {}
        self.springs: list[Any] = []
        self.supports: list[tuple[str, PointRef]] = []
        self.timing = timing_of(self.case)
        self.hangs = False
        # the linear equations, if they alone leave no body free to move
        self.checked_rows: tuple[Any, ...] | None = None
        self.warnings: list[str] = []

    def warn(self) -> None:
        """Add the warnings about meshes, and store them with each mesh."""
        for mesh in self.meshes.values():
            if mesh.warnings is None:
                mesh.warnings = [warnings_of(mesh.plan), *([text for text in [warning(mesh)] if text] for warning in (
                    locking_warning, hidden_warning, hinge_warning))]
        # sorted by kind of warning, then by body
        self.warnings += [text for kind in zip(*(mesh.warnings or () for mesh in self.meshes.values()), strict=True)
                          for texts in kind for text in texts]

    def point(self, at: Point) -> PointRef:
        return point_ref(self.meshes[at.body], at.s)

    def report(self, path: tuple[Any, ...], message: str, expected: str = "", near: str = "") -> None:
        self.problems.append(self.loaded.source.problem(path, message, expected=expected or None, near=near or None))

    def add_supports(self) -> None:
        for i, (support, name) in enumerate(zip(self.case.boundary_conditions, support_names(self.case), strict=True)):
            point = self.point(support.at)
            self.supports.append((name, point))
            timing = InputTiming(str(support.name)) if support.name in self.case.inputs else self.timing
            own = Equations()
            try:
                support.add(point, name, timing, own)
            except PartError as error:
                path = ("boundary_conditions", i, *error.key)
                self.report(path, f"{dotted(path)}: {error}", error.expected, error.near)
            else:
                self._add_equations(own, support.active, point)

    def _add_equations(self, own: Equations, active: Active | None, point: PointRef | None = None) -> None:
        """Add the equations of a support or joint; those that engage or release become constraints."""
        self.equations.warnings += own.warnings
        if active is None:
            self.equations.rows += own.rows
            self.equations.constraints += own.constraints
        else:
            self.equations.constraints += switched(own, self.timing.window(active), self.size, self.extent, point)

    @cached_property
    def weights(self) -> Array:
        """Displacement [m] that one unit of each nodal coordinate stands for (n_q,)."""
        return joined([m.weights for m in self.meshes.values()])

    def size(self, coordinate: int) -> float:
        """Return the magnitude of a coordinate for a unit displacement."""
        return 1.0 / self.weights.item(coordinate)

    def add_joints(self) -> None:
        for mesh in self.meshes.values():
            keep_lengths(mesh, self.equations)
            weld_pieces(mesh, self.equations)
        acting = acting_at(self.case) if self.case.joints else Counter[Point]()
        for i, joint in enumerate(self.case.joints):
            context = JointContext(self.point, self.meshes, f"joints.{i}", acting,
                                   joint.active is not None and joint.active.begins)
            own = Equations()
            try:
                joint.add(context, joint.name or f"joints.{i}", own)
            except JointError as error:
                for key, message, expected in error.problems:
                    self.report(("joints", i, *key), message, expected)
            self._add_equations(own, joint.active)

    def add_springs(self) -> None:
        for k, spring in enumerate(self.case.springs):
            placed: Any
            if k in self.case.resting_springs:
                placed = spring.place([p if isinstance(p, GroundPoint) else self.point(p) for p in spring.between])
                self.springs.append(placed)
            else:
                placed = moving_spring(spring, self.meshes, self.point, self.timing)
                self.loads.patches.append(placed)
            never = spring.unreachable(placed.par[0]) if hasattr(spring, "unreachable") else ""
            if never:
                self.report(("springs", k, "gap"), f"springs.{k}: {never}", "a smaller gap, or a larger length")
            placed.active = self.timing.window(getattr(spring, "active", None))
            placed.breaks = (0,) if getattr(spring, "breaks", False) else ()
            placed.path = f"springs.{k}"

    def add_flows(self) -> None:
        for what in self.case.flows:
            if not isinstance(what.velocity, float):
                course: Any = Signal(what.velocity)
            else:
                course = Signal(None, what.velocity) if self.case.solver.moves else Velocity(what.velocity)
            self.loads.flows += what.patches(self.meshes[what.on], course)

    def add_masses(self) -> None:
        for mass in self.case.masses:
            if isinstance(mass.at, MovingPoint):
                course = self.timing.function_of(mass.at.s)
                self.loads.patches.append(moving_mass(self.meshes[mass.at.on], course, mass.mass))

    def add_loads(self) -> None:
        for i, load in enumerate(self.case.loads):
            context = LoadContext(self.meshes, self.point, self.timing.factor(load), self.case.masses,
                                  self.case.flows, self.timing.function_of,
                                  self.timing.window(getattr(load, "active", None)))
            out = self.loads
            if load.name in self.case.inputs:
                out, context = self.inputs.setdefault(load.name, LoadSet()), replace(context, amplitude=lambda t: 1.0)
            before = len(out.springs)
            try:
                load.add(context, out)
            except PartError as error:
                self.report(("loads", i, *error.key), f"loads.{i}: {error}", error.expected)
            for tendon in out.springs[before:]:
                tendon.path = f"loads.{i}"
        for one in self.inputs.values():
            # tendons that are inputs have zero amplitude in the state of linearisation
            for tendon in one.springs:
                tendon.stop_winding()
            self.loads.springs += one.springs
            self.loads.guides += [guide for guide in one.guides if len(guide.depends)]
        self.springs += self.loads.springs
        if self.case.steady_rotation is not None:
            masses = [(m, self.point(m.at)) for m in self.case.resting_masses]
            self.loads.patches.extend(centrifugal(self.meshes, masses, self.case.steady_rotation))

    def check_motions(self) -> None:
        """Report prescribed motions that no body can follow."""
        solver = self.case.solver
        moving = solver.moves
        # a path first applies its constant motion from the reference; a static solution only needs the final value
        from_reference = ((self.case.initial is None or self.case.initial.from_ == "rest") if moving
                          else isinstance(solver, Static) and not solver.on_path)
        names = [n for n, _ in self.supports]
        for motion in motions(self.equations.rows, self.equations.constraints):
            # a static displacement or angle may jump in the first step
            starts = from_reference and (moving or motion.key in ("x", "y")) and motion.starts
            found = [motion.start_problem(self.extent)] if starts else []
            found += [motion.jump_problem(solver.end)] if moving else []
            for message, expected in filter(None, found):
                self.report(("boundary_conditions", names.index(motion.owner), motion.key), message, expected)

    def drop_repeated(self, elimination: Elimination) -> None:
        """Remove constraints that repeat others; report those among them that prescribe a motion."""
        names = [n for n, _ in self.supports]
        for constraint in drop_repeated(elimination, self.equations, set(names)):
            self.report(("boundary_conditions", names.index(constraint.owner), "angle"),
                        f"{constraint.owner}: another support already holds the {constraint.holds}",
                        "a single support that holds or moves it")

    def check_equations(self, elimination: Elimination) -> None:
        """Report contradictory equations, and warn of redundant ones.

        In linear statics, constraints are linear, too; redundant ones are removed.
        """
        equations = self.equations
        rows, linear = equations.rows, len(equations.rows)
        if self.case.solver.linear and equations.constraints:
            rows = [*rows, *map(linear_row, equations.constraints)]
            elimination = eliminate(rows, self.size)
        names = [n for n, _ in self.supports]
        bad, combined = inconsistent(elimination, rows, *self.case.solver.course), dict(elimination.redundant)
        for number_ in bad:
            row = rows[number_]
            path: tuple[Any, ...] = ("bodies", row.owner) if row.owner in self.meshes else ("joints",)
            if row.owner in names:
                path = ("boundary_conditions", names.index(row.owner))
            others = sorted({rows[r].owner for r in combined[number_]} - {row.owner})
            self.report(path, f"{row.owner}: {row.holds} contradicts other supports or joints "
                        f"({', '.join(others)})", "consistent supports and joints")
        owners = sorted({f"{rows[n].owner} ({rows[n].holds})" for n in combined if n < linear})
        if owners:
            self.warnings.append("redundant: " + ", ".join(owners) + "; the reported reactions are those of least "
                                 "norm")
        for row in (rows[n] for n in combined if n >= linear):
            self.warnings.append(f"redundant: the {row.holds} of {row.owner}; its reaction is indeterminate")
        equations.constraints = [c for k, c in enumerate(equations.constraints, linear) if k not in combined]

    def add_contacts(self, elimination: Elimination) -> list[ContactPair | BodyPair]:
        """Add the contacts, after all supports and joints."""
        self.frames = {name: frame_of(obstacle, self.meshes, self.timing)
                       for name, obstacle in self.case.obstacles.items()}
        found = Contacts(self.case, self.meshes, self.frames, self.e0, self.extent, elimination.dependents,
                         self.case.solver.course[0], self.moving)
        for problem in found.problems:
            self.report(*problem)
        self.equations.constraints += found.constraints
        self.springs += found.springs
        self.warnings += found.warnings
        return found.pairs

    def check_mechanism(self) -> None:
        if not must_be_held(self.case):
            return
        rows, constraints = self.equations.rows, self.equations.constraints
        if not self.springs and not constraints:
            found = tuple((row.coords.tobytes(), row.coefs.tobytes()) for row in rows)
            if self.twin is not None and self.twin.checked_rows == found:
                self.checked_rows = found
                return
        scene = (list(self.meshes.values()), rows, constraints, self.springs, self.e0)
        motions = free_motions(*scene)
        if not motions and not self.springs and not constraints:
            self.checked_rows = found
        if motions and self.case.contacts:
            # only the loads determine what a body rests on
            motions = []
        if motions and can_hang(self.case):
            # gravity can hold motions with rotation, and across what bodies hang on; others have no equilibrium, or
            # infinitely many
            motions = free_motions(*scene, weight=np.sum(_gravity(self.case), axis=0))
            self.hangs = not motions
        for motion in motions:
            idle = [spring.path for spring in self.springs
                    if spring.breaks and not spring.reference_stiffness().any()]
            # loads may make these springs act, but load steps begin in the reference
            so = (f"so no static solution can be reached from the reference ({', '.join(idle)}: inactive in the "
                  "reference)") if idle else "so there is no static solution"
            self.report(("boundary_conditions",), f"{motion}, {so}", "a support, joint, spring or elastic tendon that "
                        "prevents this" + (", such as a weak spring that always acts" if idle else "") + (
                            ", or about: reference if the rotation of the frame holds it"
                            if self.case.solver.vibrates and self.case.steady_rotation is not None else ""))


def build_model(loaded: LoadedCase, moving: bool = False, like: Model | None = None,
                for_differences: bool = False) -> Model:
    """Return the model of a case; raises CaseError with all problems. Nothing is compiled here.

    ``moving`` gives a static case the meshes of a motion. ``like`` is a model of the same case with other values: what
    these do not change is shared, and the model is the same, to the last bit, as without ``like``. With
    ``for_differences``, the values are almost those of ``like``, and the model only serves for differences between the
    two: more is shared, last digits may differ, and the checks and warnings of ``like`` are not repeated.
    """
    b = _Builder(loaded, moving, like, exactly=not for_differences)
    known = like if for_differences else None
    if known is None:
        b.warn()
    b.add_supports()
    b.add_joints()
    b.add_springs()
    raise_any(b.problems)
    elimination = eliminate(b.equations.rows, b.size)
    b.drop_repeated(elimination)
    b.check_motions()
    b.check_equations(elimination)
    b.add_masses()
    b.add_flows()
    b.add_loads()
    if known is None:
        b.check_mechanism()
    else:
        b.hangs = known.hangs
    raise_any(b.problems)
    contacts = b.add_contacts(elimination)
    raise_any(b.problems)
    for k, constraint in enumerate(b.equations.constraints):
        constraint.multiplier = len(b.e0) + k
    moving = b.case.solver.moves
    numbering = number(list(b.meshes.values()), elimination, b.equations.constraints,
                       [*b.springs, *b.loads.patches, *b.loads.flows], len(b.e0), moving,
                       moving or symmetric(b.loads, contacts), None if like is None else like.numbering)
    return Model(b.case, b.meshes, b.e0, b.equations.rows, b.equations.constraints, elimination, numbering, b.loads,
                 b.springs, b.supports, b.extent, b.timing, [*b.warnings, *b.equations.warnings], loaded, b.hangs,
                 b.inputs, contacts, b.frames, like, b.checked_rows)
