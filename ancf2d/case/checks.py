"""Checks that need the whole case; they skip all that depends on INVALID, a value that could not be read."""

from __future__ import annotations

from typing import Any

from ..errors import MAPPING
from .binder import INVALID, Binder, Path, dotted, listed
from .emit import walk
from .nodes import Source, quoted
from .part_checks import (
    check_active,
    check_contacts,
    check_controllers,
    check_feedback,
    check_flows,
    check_materials,
    check_moving,
    check_rates,
)
from .schema import Case, Layers, LimitPoints, Point, Stiffness

STATIC = ("linear_static", "static")
PATHS = (*STATIC, "quasi_static", "dynamic")
SMALL = ("eigen", "frequency_response", "state_space")
# top-level keys and output keys -> the solvers that allow them
_SECTIONS: dict[Path, tuple[str, ...]] = {
    ("initial",): ("dynamic",),
    ("damping",): (*SMALL, "buckling", "dynamic"),
    ("steady_rotation",): ("static", *SMALL),
    ("transport",): (*SMALL, "buckling", "dynamic"),
    ("fluid",): (*SMALL, "buckling", "dynamic"),
    ("contacts",): ("static", "quasi_static", "dynamic", *SMALL),
    ("controllers",): ("dynamic",),
    ("output", "interval"): ("quasi_static", "dynamic"),
    ("output", "every"): ("static", "quasi_static", "dynamic"),
}
# forms of a goal, by their characteristic key -> the solvers that compute them
_GOALS = {"probe": (*PATHS, "state_space"), "reaction": PATHS, "strain_energy": PATHS, "kind": ("eigen",),
          "load_factor": ("buckling",), "limit_point": ("static",), "input": ("frequency_response",)}
_CALLED = {"reaction": "a reaction", "kind": "a mode", "load_factor": "a buckling load factor",
           "limit_point": "a limit point", "input": "a response"}
_WHAT = {"bodies": ("body", "bodies"), "probes": ("probe", "probes in output"),
         "reactions": ("boundary condition named", "boundary conditions with a name")}
# bounds of times, which are squared and used as divisors; the largest number of states that fits into memory
TIMES, MOST_STATES = (1e-100, 1e100), 1e8


def check_case(case: Case, source: Source, binder: Binder) -> None:
    """Report inconsistencies between the parts of a case; do nothing if too many problems were found in the parts."""
    if binder.full:
        return  # the record of the parts that failed is incomplete
    checker = _Checker(case, source, binder)
    checker.references()
    checker.names()
    check_controllers(checker)
    if case.solver is not INVALID:
        checker.sections()
        check_moving(checker)
        check_active(checker)
        check_flows(checker)
        check_feedback(checker)
        check_rates(checker)
        check_materials(checker)
        checker.goals()
        checker.masses()
        checker.times()
        checker.accuracy_needs_goal()
        checker.inputs()
        checker.scaled()
    check_contacts(checker)


class _Checker:
    """The draft of a case, the places of its values, and the binder to report to."""

    def __init__(self, case: Case, source: Source, binder: Binder) -> None:
        self.case, self.source, self.binder = case, source, binder
        self.solver = "" if case.solver is INVALID else type(case.solver).tag
        paths = [*(problem.path for problem in binder.problems), *binder.skipped]
        self.failed = {path[:i] for path in paths for i in range(1, len(path) + 1)}
        self._known: dict[str, tuple[set[str], bool]] = {}
        self.values = walk(case, (), binder.known)

    def fail(self, path: Path, message: str, expected: str = "", near: str = "", on_key: bool = False) -> None:
        mark = self.source.key_mark(path) if on_key else self.source.mark(path)
        self.binder.fail(mark, path, message, expected, near)

    def known(self, what: str) -> tuple[set[str], bool]:
        """Return the names of bodies, probes or reactions, and whether the list is complete."""
        if what not in self._known:
            self._known[what] = self._names_of(what)
        return self._known[what]

    def _names_of(self, what: str) -> tuple[set[str], bool]:
        case = self.case
        if what == "bodies":
            return (set(case.bodies), True) if case.bodies is not INVALID else (set(), False)
        if what == "probes":
            probes: Any = INVALID if case.output is INVALID else case.output.probes
            return (set(probes), True) if probes is not INVALID else (set(), False)
        if case.boundary_conditions is INVALID:
            return set(), False
        names = {getattr(s, "name", None) for s in case.boundary_conditions}
        if case.obstacles is INVALID:
            return set(), False
        names |= set(case.obstacles)
        complete = ("boundary_conditions",) not in self.failed
        return {n for n in names if isinstance(n, str)}, complete

    def references(self) -> None:
        """Check that every named point, body, probe and reaction exists."""
        for path, value, what in self.values:
            if isinstance(value, Point):
                value, what = value.body, "bodies"
            if what:
                self.reference(path, value, what)
        initial = self.case.initial
        if initial and isinstance(initial.bodies, dict):
            for name in initial.bodies:
                self.reference(("initial", "bodies", name), name, "bodies", on_key=True)

    def reference(self, path: Path, name: str, what: str, on_key: bool = False) -> None:
        names, complete = self.known(what)
        if name in names or not complete:
            return
        one, many = _WHAT[what]
        none = "" if names else f"; there are no {many}"
        self.fail(path, f"{dotted(path)}: there is no {one} {quoted(name)}{none}",
                  *self.binder.instead(name, names), on_key)

    def names(self) -> None:
        """Check that names are unique within each list."""
        for section in ("boundary_conditions", "joints", "springs", "masses", "loads", "contacts"):
            seen: dict[str, int] = {}
            items = getattr(self.case, section)
            for i, item in enumerate(items if isinstance(items, tuple) else ()):
                name = getattr(item, "name", None)
                if not isinstance(name, str):
                    continue
                if name in seen:
                    line = self.source.mark((section, seen[name])).line
                    where = "" if self.source.file == MAPPING else f" (line {line})"
                    self.fail((section, i, "name"), f"{section}.{i}.name: '{name}' is already the "
                              f"name of {section}.{seen[name]}{where}")
                else:
                    seen[name] = i

    def sections(self) -> None:
        """Check that each section is allowed for the solver."""
        for path, solvers in _SECTIONS.items():
            value: Any = self.case
            for part in path:
                value = None if value is INVALID else getattr(value, part, None)
            if value not in (None, (), {}, INVALID) and self.solver not in solvers:
                self.fail(path, f"{dotted(path)} cannot be used with solver {self.solver}, only "
                          f"with {listed(solvers)}", on_key=True)
        for i, spring in enumerate(self.case.springs or ()):
            if spring is not INVALID and self.solver == "linear_static" and spring.breaks:
                self.fail(("springs", i), f"springs.{i} is one-sided or has a gap, which linear statics cannot "
                          "represent", "solver static")
        if self.case.steady_rotation is None:
            return
        for i, load in enumerate(self.case.loads or ()):
            if load is not INVALID and load.acceleration is not None:
                self.fail(("loads", i), f"loads.{i}: gravity cannot be used with steady_rotation; "
                          "its direction would rotate in the frame")
        for i, support in enumerate(self.case.boundary_conditions or ()):
            if support is not INVALID and support.motions:
                self.fail(("boundary_conditions", i), f"boundary_conditions.{i}: prescribed motion "
                          "cannot be used with steady_rotation")

    def goals(self) -> None:
        """Check that the solver computes the goal and the expected values."""
        if self.case.goal:
            self.goal(("goal",), self.case.goal)
        for i, expected in enumerate(self.case.expected or ()):
            if expected is not INVALID:
                self.goal(("expected", i), expected)

    def goal(self, path: Path, goal: Any) -> None:
        if path in self.failed:
            return
        form = next((f for f in ("input", "limit_point", "load_factor", "kind", "reaction", "probe")
                     if getattr(goal, f) is not None), "strain_energy")
        moves = form == "probe" and goal.quantity in ("vx", "vy")
        solvers = ("dynamic",) if moves else _GOALS[form]
        what = _CALLED.get(form) or goal.quantity
        below = form if form != "strain_energy" else "quantity"
        if moves:
            below = "quantity"
        if self.solver not in solvers:
            self.fail((*path, below), f"{dotted(path)}: {what} is not available from solver {self.solver}, only from "
                      f"{listed(solvers)}", "input: the name of an input, for a response" if
                      (form, self.solver) == ("probe", "frequency_response") else "", on_key=True)
            return
        if ("solver",) in self.failed:
            return
        number = {"kind": goal.number, "load_factor": goal.load_factor}.get(form)
        modes = getattr(self.case.solver, "modes", None)
        if number is not None and modes is not None and number > modes:
            name = "number" if form == "kind" else form
            self.fail((*path, name), f"{dotted((*path, name))} is {number}, but solver.modes is only {modes}", "a "
                      "larger solver.modes")
        self.window(path, goal)
        if form == "limit_point":
            self.limit_point(path, goal.limit_point)
        if form == "input":
            self.response(path, goal)

    def window(self, path: Path, goal: Any) -> None:
        """Check that a goal over a window of time belongs to a motion, and that the window ends within it."""
        for name in ("mean_over", "peak_over"):
            window, last = getattr(goal, name), getattr(self.case.solver, "t_end", None)
            if window is None:
                continue
            if self.solver != "dynamic":
                self.fail((*path, name), f"{dotted((*path, name))} is not available from solver {self.solver}, only "
                          "from dynamic", on_key=True)
            elif isinstance(last, float) and window[1] > last:
                self.fail((*path, name), f"{dotted((*path, name))} ends at {window[1]:g} s, after the motion",
                          f"times up to solver.t_end = {last:g} s")

    def response(self, path: Path, goal: Any) -> None:
        """Check that the input of a response is one of the solver's, and its frequency one that is computed."""
        solver: Any = self.case.solver
        if goal.input not in solver.inputs:
            self.fail((*path, "input"), f"{dotted((*path, 'input'))}: {quoted(goal.input)} is not among solver.inputs",
                      *self.binder.instead(goal.input, solver.inputs))
        if goal.hz is None:
            return
        if solver.frequencies is not None and goal.hz not in solver.frequencies:
            self.fail((*path, "hz"), f"{dotted((*path, 'hz'))}: {goal.hz:g} is not among solver.frequencies",
                      "one of them")
        elif solver.frequencies is None and not solver.from_ <= goal.hz <= solver.to:
            self.fail((*path, "hz"), f"{dotted((*path, 'hz'))}: {goal.hz:g} is outside the range of the solver",
                      f"from {solver.from_:g} to {solver.to:g}")

    def inputs(self) -> None:
        """Check that each input is the name of one load or prescribed motion."""
        case: Any = self.case
        if INVALID in (case.loads, case.boundary_conditions, case.inputs, getattr(case.solver, "outputs", ())):
            return
        moved = [s.name for s in case.boundary_conditions if s is not INVALID and s.motions and s.name]
        loads = [load.name for load in case.loads if load is not INVALID and load.name]
        self.outputs()
        if self.failed & {("loads",), ("boundary_conditions",)}:
            return
        for i, name in enumerate(case.inputs):
            path: Path = ("solver", "inputs", i)
            if name is INVALID:
                continue
            if name in case.inputs[:i]:
                self.fail(path, f"{dotted(path)}: '{name}' is named twice")
            elif name == "hz":
                self.fail(path, f"{dotted(path)}: 'hz' is reserved for the frequencies in the results", "another name")
            elif name in moved and name in loads:
                self.fail(path, f"{dotted(path)}: '{name}' is the name of a load and of a prescribed motion",
                          "different names")
            elif name not in (*moved, *loads):
                expected, near = self.binder.instead(name, [*loads, *moved])
                self.fail(path, f"{dotted(path)}: there is no load or prescribed motion named {quoted(name)}",
                          expected if loads or moved else "a load or prescribed motion with a name", near)

    def outputs(self) -> None:
        """Check that the probes of outputs exist, and that a solver that reports only probes has some."""
        output = self.case.output
        if self.case.solver.probes_alone and output is not INVALID and not output.probes:
            self.fail(("solver",), f"solver: {self.solver} reports probes, and the case has none", "output.probes")
        for i, name in enumerate(getattr(self.case.solver, "outputs", ())):
            if name is not INVALID:
                self.reference(("solver", "outputs", i), name.partition(".")[0], "probes")

    def scaled(self) -> None:
        """Check that the load factor scales something, if the solver seeks load factors or follows a path."""
        case, method = self.case, getattr(self.case.solver, "method", None)
        if not (self.solver == "buckling" or method in ("arc_length", "displacement")) or case.steady_rotation:
            return
        if INVALID in (case.loads, case.boundary_conditions, case.obstacles, case.transport, case.fluid) or case.flows:
            return
        if self.failed & {("loads",), ("boundary_conditions",), ("obstacles",), ("transport",), ("fluid",)}:
            return
        moved = [value for support in case.boundary_conditions for value in support.motions.values()]
        moved += [value for one in case.obstacles.values() if one.motion
                  for value in (one.motion.x, one.motion.y, one.motion.angle)]
        if all(load.amplitude is not None for load in case.loads) and not any(isinstance(v, float) for v in moved):
            what = f"method {method}" if method else self.solver
            self.fail(("solver",), f"solver: {what} needs a load that scales with the load factor, and the case has "
                      "none", "a load or prescribed motion without an amplitude (an amplitude makes it constant)")

    def limit_point(self, path: Path, number: int) -> None:
        solver: Any = self.case.solver
        path = (*path, "limit_point")
        if solver.method != "arc_length":
            self.fail(path, f"{dotted(path)}: limit points are found with method arc_length only",
                      "solver.method: arc_length", on_key=True)
        elif isinstance(solver.until, LimitPoints) and number > solver.until.count:
            self.fail(path, f"{dotted(path)} is {number}, but the path ends after limit point "
                      f"{solver.until.count}", "a larger solver.until.limit_points")

    def masses(self) -> None:
        """Check that bodies have mass where mass is needed."""
        case = self.case
        gravity = any(load is not INVALID and load.acceleration is not None for load in case.loads or ())
        why = (f"the solver is {self.solver}" if self.solver in ("dynamic", *SMALL) else
               "there is gravity" if gravity else
               "there is steady_rotation" if case.steady_rotation is not None else "")
        if not why or case.bodies is INVALID:
            return
        for name, body in case.bodies.items():
            path = ("bodies", name)
            if body is INVALID or path in self.failed:
                continue
            rigid = body.element.type == "rigid"
            if rigid and body.element.mass is not None and body.element.inertia is not None:
                continue
            self.mass(path, body, rigid, why)

    def mass(self, path: Path, body: Any, rigid: bool, why: str) -> None:
        if rigid and (body.section is None or body.element.mass or body.element.inertia):
            lacking = "inertia" if body.element.inertia is None else "mass"
            self.fail((*path, "element"), f"{dotted(path)}.element.{lacking} is missing: needed "
                      f"because {why}", "mass and inertia, or a section and material.rho")
            return
        if isinstance(body.section, Stiffness):
            if body.section.rhoA is None:
                self.fail((*path, "section"), f"{dotted(path)}.section.rhoA is missing: mass per "
                          f"length, needed because {why}",
                          f"a number > 0 {self.binder.unit('kg/m')}")
            return
        if isinstance(body.section, Layers):
            for k, layer in enumerate(body.section.layers):
                if layer.material.rho is None:
                    place = (*path, "section", "layers", k, "material")
                    self.fail(place, f"{dotted(place)}.rho is missing: density, needed because {why}",
                              f"a number > 0 {self.binder.unit('kg/m^3')}")
            return
        if body.material is None or body.material.rho is None:
            self.fail((*path, "material"), f"{dotted(path)}.material.rho is missing: density, "
                      f"needed because {why}",
                      f"a number > 0 {self.binder.unit('kg/m^3')}")

    def times(self) -> None:
        """Check that the times of a motion are in the range of the arithmetic, and that its states can be stored."""
        solver: Any = self.case.solver
        if self.solver != "dynamic":
            return
        interval = None if self.case.output is INVALID else self.case.output.interval
        times = {("solver", "t_end"): (solver.t_end, 1.0), ("output", "interval"): (interval, MOST_STATES)}
        for path, (time, most) in times.items():
            if time in (None, INVALID) or self.failed & {path, ("solver", "t_end")}:
                continue
            least = max(TIMES[0], solver.t_end / most) if solver.t_end <= TIMES[1] else TIMES[0]
            if time < least or time > TIMES[1]:
                size = "small" if time < least else "large"
                self.fail(path, f"{dotted(path)} is too {size}: {time:g}",
                          f"from {least:.3g} to {TIMES[1]:g} {self.binder.unit('s')}")

    def accuracy_needs_goal(self) -> None:
        """Check that accuracy and element type auto come with a goal."""
        case = self.case
        if case.goal is not None:
            return
        # without a goal, the error control covers all responses
        if isinstance(case.accuracy, float) and self.solver != "frequency_response":
            self.fail(("accuracy",), "accuracy is given without a goal",
                      "goal: {probe, quantity} or another goal")
        for name, body in case.bodies.items() if case.bodies is not INVALID else ():
            if body is not INVALID and body.element is not INVALID and body.element.type == "auto":
                self.fail(("bodies", name, "element"), "element auto needs a goal, and the case has none",
                          "goal: {probe, quantity} or another goal; or an element type")
