"""Results of a run: goals, and expressions such as ``mass``, ``goal``, ``tip.uy``, ``wall.fx`` and ``max(stress)``."""

from __future__ import annotations

import math
import re
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from ..case import Goal, LoadedCase
from ..case.binder import listed
from ..case.nodes import Mark, Origin
from ..case.part_checks import refused_field
from ..case.records import tag_of
from ..case.syntax import Chain, Comparison, ExpressionError, Names, named_in, syntax
from ..elements.shape import Array
from ..errors import CaseError, ComputationError, Problem, all_of, raise_any
from ..model.model import Model
from ..quantities import KINEMATIC, MOTIONS
from ..results.geometry import mises
from ..solvers.derivatives.readings import CLOSE, Term
from ..solvers.fields import FIELDS, FieldReader, field_problems
from .extremes import MOST, Evaluated, Extreme, Measure, Part, names_of, near, slopes_of, value_of
from .run import describe_goal, quantity
from .windows import Windows, window_of, window_weights

GOAL, MASS, ENERGY = "goal", "mass", "strain_energy"
SECTION = ("N", "Q", "M")
REACTIONS = ("fx", "fy", "m")
_EXTREME = re.compile(r"(?<![\w.])(max|min)\s*\(")
_COMPARES = re.compile(r"[<>]|==")


class Vocabulary:
    """The names that expressions over the results of a case may use."""

    def __init__(self, loaded: LoadedCase) -> None:
        case = loaded.case
        rates = KINEMATIC if case.solver.moves else MOTIONS
        self.probes = tuple(case.output.probes)
        found = [f"{probe}.{q}" for probe in self.probes for q in (*rates, *SECTION)]
        supports = [s.name for s in case.boundary_conditions if s.name]
        found += [f"{name}.{q}" for name in (*supports, *case.obstacles) for q in REACTIONS]
        self.quantities = (*found, MASS, ENERGY, *((GOAL,) if case.goal is not None else ()))
        self.fields = tuple(FIELDS)

    def names(self, more: Sequence[str] = ()) -> Names:
        """Return the known names; ``more`` are parameters and placeholders."""
        return Names("", {}, (*self.quantities, *more), self.probes)


def read_measure(text: str, option: str, words: Vocabulary, parameters: Sequence[str] = ()) -> Measure:
    """Return the expression given by a command line option. Raises CaseError with the places of all mistakes."""
    extremes: dict[str, Extreme | None] = {}
    rest, more, wrong = text, tuple(parameters), list[ExpressionError]()
    try:
        while (found := _EXTREME.search(rest)) is not None:
            end = _closed(rest, found.end() - 1)
            inside = rest[found.end():end]
            # as long as the text it replaces, so that columns in messages stay correct
            name = f"e{len(extremes)}".ljust(end + 1 - found.start(), "_")
            extremes[name] = _extreme(found[1] == "max", inside, found.end(), words, more, wrong)
            rest = rest[:found.start()] + name + rest[end + 1:]
        tree = syntax(rest, words.names((*more, *extremes)))
    except ExpressionError as error:
        wrong += error.each
    raise_any([_place(text, option, one.column).problem(_said(str(one), words), near=one.near) for one in wrong])
    return Measure(text, tree, {name: extreme for name, extreme in extremes.items() if extreme is not None})


def _place(text: str, option: str, column: int = 0) -> Mark:
    shown = f"{option} {text}"
    return Mark(Origin(shown, shown.split("\n"), numbered=False), 1, len(option) + 2 + column)


def _said(message: str, words: Vocabulary) -> str:
    """Return the message about an unknown name, listing the names that expressions may use."""
    if (parameter := re.match(r"'parameters\.(\w+)' is unknown", message)) is not None:
        return f"{parameter[0]}: in expressions the parameter is written {parameter[1]}"
    head, known, _ = message.partition("; known names are ")
    return (f"{head}; there are {', '.join(words.quantities)}, and max(...) and min(...) of these over time, or of "
            f"a field over the bodies ({', '.join(words.fields)}), such as max(abs(M))" if known else message)


def _closed(text: str, at: int) -> int:
    depth = 0
    for k in range(at, len(text)):
        depth += {"(": 1, ")": -1}.get(text[k], 0)
        if depth == 0:
            return k
    raise ExpressionError("')' is missing", len(text))


def _extreme(largest: bool, inside: str, column: int, words: Vocabulary, more: Sequence[str],
             wrong: list[ExpressionError]) -> Extreme | None:
    """Return max or min of a text, which begins at a column; add mistakes in it to ``wrong`` and return None."""
    try:
        if _EXTREME.search(inside):
            raise ExpressionError("max and min cannot stand in each other", 0)
        tree = syntax(inside, words.names((*more, *words.fields)))
        used = dict.fromkeys(named_in(tree))
        field = next((name for name in used if name in words.fields), "")
        if field and len(used) > 1:
            raise ExpressionError(f"max and min are over the bodies for {field} but over time for the other names: "
                                  f"{listed(n for n in used if n != field)} cannot stand beside it there", 0)
        return Extreme(largest, tree, field)
    except ExpressionError as error:
        wrong += [ExpressionError(str(one), column + one.column, one.near) for one in error.each]
        return None


def read_constraint(text: str, option: str, words: Vocabulary, parameters: Sequence[str] = ()
                    ) -> tuple[Measure, Measure, str]:
    """Return the difference that a constraint ``LEFT <= RIGHT`` (>=, ==) bounds by 0, RIGHT, and '<=' or '=='.

    Raises CaseError with the places of all mistakes, also if the text is not a comparison of two expressions.
    """
    none = _place(text, option).problem("no constraint", expected='for example "max(stress) <= 200e6"')
    # a text without a sign is no constraint, whatever its names are
    measure, _ = all_of(lambda: read_measure(text, option, words, parameters),
                        lambda: raise_any([] if _COMPARES.search(text) else [none]))
    tree = measure.tree
    if not (isinstance(tree, Comparison) and len(tree.rest) == 1 and tree.rest[0][0] != "!="):
        raise CaseError(none)
    op, right = tree.rest[0]
    parts = (tree.first, right) if op in ("<=", "<", "==") else (right, tree.first)
    difference = replace(measure, tree=Chain(parts[0], (("-", parts[1]),)))
    of_right = {name: measure.extremes[name] for name in named_in(right) if name in measure.extremes}
    return difference, replace(measure, tree=right, extremes=of_right), "==" if op == "==" else "<="


class Measures:
    """The values of expressions as a function of a model and the states of its run.

    An expression with max or min has a kink where another value becomes the extreme. For expressions flagged in
    ``with_rows``, the values are therefore followed by smooth rows: the expression evaluated with one representative of
    each group of neighbouring values (``Evaluated.chosen``). The largest row equals the expression. ``parts``, one for
    each such extreme, are chosen at the first call; for motions, such that there are at most ``numbers`` values to
    differentiate.
    """

    negligible = CLOSE

    def __init__(self, measures: Sequence[Measure], goal: Goal | None, with_rows: Sequence[bool] = (), numbers: int = 0
                 ) -> None:
        self.measures, self.with_rows, self.numbers = tuple(measures), tuple(with_rows), numbers
        self.names = {name for m in measures for name in names_of(m)}
        self.parameters = {name for name in self.names if "." not in name} - {GOAL, MASS, ENERGY}
        self.goals = (goal,) if goal is not None and GOAL in self.names else ()
        self.along = any(not e.field for m in measures for e in m.extremes.values())
        self.all_states = self.along or any(window_of(g) is not None for g in self.goals)
        self.fields = tuple(dict.fromkeys(e.field for m in measures for e in m.extremes.values() if e.field))
        self.forces = any(name.rpartition(".")[2] in SECTION for name in self.names)
        self.parts: list[Part] | None = None if any(self.with_rows) else []

    def __call__(self, model: Model, states: Sequence[Any]) -> Array:
        """Return the values (measures,), then the rows. Raises ComputationError if one is not computed."""
        met = self._evaluated(model, states, self._values_over_states(model, states))
        found = [one.value() for one in met]
        for one, value in zip(met, found, strict=True):
            if not np.isfinite(value):
                raise ComputationError(f"'{one.measure.text}' has no value here", at={"value": value},
                                       advice="names of values that the solver computes, and functions within their "
                                              "range")
        if self.parts is None:
            self.parts = self._divided(met, model.case.solver.moves)
        return np.concatenate([found, *(met[part.number].rows(part) for part in self.parts)])

    def _divided(self, met: list[Evaluated], moves: bool) -> list[Part]:
        """Return the extremes that get rows, with their numbers of groups."""
        wanted = [one for one, with_rows in zip(met, self.with_rows, strict=False) if with_rows]
        # more expressions than numbers would be differentiated forwards, at the cost of many motions
        most = MOST
        if moves and self.from_probes:
            most = (self.numbers - self.count) // sum(len(one.samples) for one in wanted)
        return [part for k, with_rows in enumerate(self.with_rows) if with_rows for part in met[k].parts(k, most)]

    def rows(self, number: int) -> slice | None:
        """Return the range of the rows of an expression among all values, or None if it has none."""
        of, first = [], len(self.measures)
        for part in self.parts or ():
            of += list(range(first, first + part.groups)) * (part.number == number)
            first += part.groups
        return slice(of[0], of[-1] + 1) if of else None

    def weights(self, values: Array) -> Array:
        """Return 1 for the values (m,) whose derivatives count, else 0.

        They do not count for rows far from the extreme, and for expressions that have rows, because of their kinks.
        """
        out = np.ones(len(values))
        for number in range(len(self.measures)):
            if (rows := self.rows(number)) is not None:
                out[number], out[rows] = 0.0, near(values[rows])
        return out

    def _evaluated(self, model: Model, states: Sequence[Any], course: list[dict[str, float]]) -> list[Evaluated]:
        """Return the expressions evaluated at the states."""
        of_fields, out = {name: self._field(model, states[-1], name) for name in self.fields}, list[Evaluated]()
        for measure in self.measures:
            places = {name: extreme.of_field(of_fields[extreme.field]) if extreme.field else
                      np.array([value_of(extreme.tree, values) for values in course])
                      for name, extreme in measure.extremes.items()}
            ends = {name: float(values[measure.extremes[name].at(values)]) for name, values in places.items()}
            out.append(Evaluated(measure, course[-1] | ends, places))
        return out

    def _values_over_states(self, model: Model, states: Sequence[Any]) -> list[dict[str, float]]:
        """Return the values of all names at each state, or at the last one alone if no extreme needs the others."""
        return [self._values_at(model, states[:k], k == len(states))
                for k in range(1 if self.along else len(states), len(states) + 1)]

    @property
    def from_probes(self) -> bool:
        """Return whether all values follow from the model and from probe quantities given by positions and rates."""
        read = {name.rpartition(".")[2] for name in self.names - self.parameters - {GOAL, MASS}}
        return not self.fields and read <= set(KINEMATIC) and GoalValues(self.goals).from_probes

    @property
    def count(self) -> int:
        """Return the number of values that depend on states, rows included."""
        return (sum(bool(names_of(measure) - self.parameters - {MASS}) for measure in self.measures)
                + sum(part.groups for part in self.parts or ()))

    def alike(self, one: Model, other: Model) -> bool:
        """Return whether both models give the same values for the same states."""
        given, probes = (one.case.parameters, other.case.parameters), {name.rpartition(".")[0] for name in self.names}
        return (MASS not in self.names and all(given[0][name] == given[1][name] for name in self.parameters)
                and probes_alike(one, other, probes - {""}) and GoalValues(self.goals).alike(one, other))

    def terms(self, model: Model, states: Sequence[Any]) -> list[Term]:
        """Return the derivatives of the values by probe quantities (chain rule); an extreme is the value at one state.
        """
        course = self._values_over_states(model, states)
        met, out = self._evaluated(model, states, course), list[Term]()
        chosen = [{name: one.measure.extremes[name].at(values) for name, values in one.samples.items()} for one in met]
        every = [(one, at) for one, at in zip(met, chosen, strict=True)]
        for part in self.parts or ():
            one = met[part.number]
            every += [(one, chosen[part.number] | {part.name: at})
                      for at in one.chosen(part.name, part.groups).tolist()]
        for k, (one, at) in enumerate(every):
            out += [(k, *term) for term in self._terms(model, states, course, one, at)]
        return out

    def _terms(self, model: Model, states: Sequence[Any], course: list[dict[str, float]], one: Evaluated,
               at: dict[str, int]) -> Iterator[tuple[int, str, str, float]]:
        """Yield the derivatives of an expression by probe quantities, with its extremes taken at the places ``at``."""
        meaning = one.meaning | {name: float(one.samples[name][place]) for name, place in at.items()}
        first, goals = len(states) - len(course), GoalValues(self.goals)
        for name, outer in slopes_of(one.measure.tree, meaning):
            inner = [(len(states) - 1, name, 1.0)]
            if name in at:
                tree = one.measure.extremes[name].tree
                inner = [(first + at[name], own, by) for own, by in slopes_of(tree, course[at[name]])]
            for number, own, by in inner:
                if own == GOAL:
                    yield from ((n, probe, quantity, outer * by * weight)
                                for _, n, probe, quantity, weight in goals.terms(model, states[:number + 1]))
                elif "." in own:
                    probe, _, quantity = own.rpartition(".")
                    yield number, probe, quantity, outer * by

    def _values_at(self, model: Model, states: Sequence[Any], ended: bool) -> dict[str, float]:
        """Return the values of the names at the last of some states; a goal over a window is NaN unless ``ended``."""
        reacts = any(name.rpartition(".")[2] in REACTIONS for name in self.names)
        reacts |= any(g.reaction is not None for g in self.goals)
        summary = last_summary(model, states, reacts, self.forces, self.goals if ended else ())
        found = {f"{name}.{q}": float(v) for part in ("probes", "reactions") for name, row in
                 summary.get(part, {}).items() for q, v in row.items()}
        found.update(model.case.parameters)
        if MASS in self.names:
            found[MASS] = mass_of(model)
        if ENERGY in self.names:
            found[ENERGY] = float(summary["energy"]["strain"])
        for goal in self.goals:
            value = quantity(goal, summary) if ended or window_of(goal) is None else math.nan
            if value is None:
                raise ComputationError(f"the solver does not compute {describe_goal(goal)}")
            found[GOAL] = value
        return found

    @staticmethod
    def _field(model: Model, state: Any, name: str) -> Array:
        """Return all values of a field; for stress, the von Mises equivalent stress."""
        problems = field_problems(model, (name,))
        if (refused := refused_field(model.case, tag_of(type(model.case.solver)), name)) is not None:
            problems += [Problem(refused[0], expected=refused[1])]
        raise_any(problems)
        values = list(FieldReader(model, (name,)).read(state).values())
        if name == "stress":
            values = [mises(v) for v in values]
        return np.concatenate([np.ravel(v) for v in values]) if values else np.zeros(1)


def mass_of(model: Model) -> float:
    """Return the mass [F T^2/L] of bodies and point masses: a^T M a for a unit translation a."""
    from ..solvers.linear import fluid_masses, point_masses

    a, total = np.zeros(model.n_q), 0.0
    for mesh in model.meshes.values():
        a[mesh.first_dof:mesh.first_dof + mesh.n_dofs][mesh.kinds == 0] = 1.0
        # all elements of a body have the same kinds of coordinates
        moved = a[mesh.dofs[0]]
        each = np.array([moved @ c.mass @ moved for c in mesh.classes])
        total += float(each @ np.bincount(mesh.cls, minlength=len(each)))
    more = [*fluid_masses(model), *((coords[None, :], M) for coords, M in point_masses(model))]
    return total + sum(float(np.sum((a[coords] @ M) * a[coords])) for coords, M in more)


@dataclass(frozen=True)
class GoalValues:
    """The values of goals at the end of a run, as a function of model and states."""

    goals: tuple[Goal, ...]
    negligible: ClassVar[float] = CLOSE

    @property
    def all_states(self) -> bool:
        """Return whether a value depends on other states than the last."""
        return any(window_of(goal) is not None for goal in self.goals)

    def __call__(self, model: Model, states: Sequence[Any]) -> Array:
        """Return the values. Raises ComputationError if the solver does not compute one of them."""
        summary = last_summary(model, states, any(g.reaction is not None for g in self.goals),
                               goals=self.goals, probes={str(goal.probe) for goal in self.goals},
                               energy=any(goal.probe is None and goal.reaction is None for goal in self.goals))
        found = [quantity(goal, summary) for goal in self.goals]
        for goal, value in zip(self.goals, found, strict=True):
            if value is None:
                raise ComputationError(f"the solver does not compute {describe_goal(goal)}")
        return np.array(found, dtype=float)

    @property
    def from_probes(self) -> bool:
        """Return whether all goals are probe quantities given by positions and rates."""
        return all(goal.probe is not None and goal.quantity in KINEMATIC for goal in self.goals)

    @property
    def count(self) -> int:
        """Return the number of values that depend on states."""
        return len(self.goals)

    def alike(self, one: Model, other: Model) -> bool:
        """Return whether both models give the same values for the same states."""
        return probes_alike(one, other, {str(goal.probe) for goal in self.goals})

    def terms(self, model: Model, states: Sequence[Any]) -> list[Term]:
        """Return the derivatives of the goals by probe quantities at each state."""
        from ..solvers.state_results import Observer

        observer, out = Observer(model, forces=False), list[Term]()
        for k, goal in enumerate(self.goals):
            probe, quantity = str(goal.probe), str(goal.quantity)
            if window_of(goal) is None:
                out.append((k, len(states) - 1, probe, quantity, 1.0))
                continue
            read = np.array([observer.observe(state)[probe][quantity] for state in states])
            weights = window_weights(goal, np.array([state.t for state in states]), read)
            out += [(k, int(n), probe, quantity, float(weights[n])) for n in np.flatnonzero(weights)]
        return out


def probes_alike(one: Model, other: Model, names: Iterable[str]) -> bool:
    """Return whether positions and rotations of the named probes are the same functions of coordinates in two models.
    """
    sides = [(one.case.output.probes[name], other.case.output.probes[name]) for name in names]
    # meshes that share these have the same elements at the same places
    return all(a == b and one.meshes[a.at.body].e0 is other.meshes[b.at.body].e0 for a, b in sides)


def last_summary(model: Model, states: Sequence[Any], reacts: bool = True, forces: bool = False,
                 goals: Sequence[Goal] = (), probes: Container[str] | None = None, energy: bool = True
                 ) -> dict[str, Any]:
    """Return the part of a summary that goals read, at the last state of a run.

    Reactions, energies and section forces at probes are included on request, all ``probes`` if none are named;
    ``goals`` over windows of time use all states.
    """
    from ..solvers.state_results import Observer, energies, reactions

    state = states[-1]
    observer = Observer(model, named=probes)
    observer.forces |= forces
    out: dict[str, Any] = {"probes": observer.observe(state)}
    if energy:
        out["energy"] = dict(state.history) if model.case.solver.moves else energies(model, state)
    if reacts:
        out["reactions"] = reactions(model, state)
    windows = Windows(model, goals)
    if windows.goals:
        for one in states:
            windows.record(one, observer.observe(one), lambda state: reactions(model, state))
        out["windows"] = windows.values()
    for one in states:
        out.update(one.report)
    return out
