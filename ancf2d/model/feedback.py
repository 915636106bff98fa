"""Feedback from the motion: quantities of probes, controllers with their states, and signals that depend on them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..case import Dynamic, Expression, Gated, Latch, Pid, jets
from ..case.programs import state_programs, value_at
from ..case.schema.controllers import PULL, RATE_SIGN, equations
from ..case.syntax import Chain, Choice, Comparison, Constant, Tree, named_in, syntax
from ..elements.shape import Array
from ..errors import CaseError, ComputationError, Problem
from ..quantities import RATES
from .breakpoints import Break
from .point_patch import Field, turn_fields
from .points import PointRef, dot
from .rotation import Rotation
from .timing import FeedbackSignal, Signal

# how a quantity depends on the coordinates (same numbers as in kernels.motion.feedback)
POSITION, RATE, ANGLE, SPIN = range(4)
# tolerance for instants, as a share of the interval
NEAR = 1e-9


class Quantity(NamedTuple):
    """A quantity of a motion: its kind, its coordinates with weights, and its value in the reference (in ``along``)."""

    kind: int
    along: Field
    across: Field | None = None
    rotation: Rotation | None = None


class Condition(NamedTuple):
    """A condition that starts (``after``) or ends (``until``) an action; without a latch, it ends the motion."""

    latch: Latch | None
    which: str
    text: str


class Feedback:
    """The quantities of a motion on which something depends, its controllers, and the conditions that are monitored.

    ``names`` are those of the quantities, then of the states; ``meaning`` maps a name to its number or, for a
    controller, to the tree of its output. ``states`` are the names of controller states, CONTROLLER:STATE,
    ``bounded`` the numbers of those that stop where an output is limited, whose rates then are among the names, too.
    """

    def __init__(self, model: Any, signals: list[FeedbackSignal]) -> None:
        self.model, self.signals = model, signals
        self.controllers = {name: equations(name, c) for name, c in model.case.controllers.items()}
        self.states = [state for c in self.controllers.values() for state in c.initial]
        self.rates: list[Tree] = [tree for c in self.controllers.values() for tree in c.rates.values()]
        used = [name for a in signals if a.amplitude is not None for name in a.amplitude.quantities]
        self.conditions = list(_conditions(model))
        used += [name for tree in (*self._trees(), *self.condition_trees) for name in named_in(tree)]
        probed = dict.fromkeys(name for name in used if "." in name)
        self.quantities = [quantity_of(model, name) for name in probed]
        named = {name for tree in self.rates for name in named_in(tree)}
        self.bounded = [k for k, state in enumerate(self.states) if state + RATE_SIGN in named]
        self.names = [*probed, *self.states, *(self.states[k] + RATE_SIGN for k in self.bounded),
                      *([PULL] if self.bounded else [])]
        self.meaning: dict[str, int | Tree] = {name: k for k, name in enumerate(self.names)}
        self.meaning |= {name: c.output for name, c in self.controllers.items()}
        # caches: programs, with the functions that they evaluate, and the order of controllers that act at the same
        # time
        self._made: dict[tuple[int, ...], tuple[Any, jets.Programs]] = {}
        self._in_turn: dict[tuple[str, ...], list[str]] = {}

    def _trees(self) -> Iterator[Tree]:
        for c in self.controllers.values():
            yield from (*c.initial.values(), *c.rates.values(), *c.samples.values(), c.output)

    @property
    def rank(self) -> int:
        """Number of signals and states that depend on the motion."""
        return len(self.signals) + len(self.states)

    @cached_property
    def condition_trees(self) -> list[Tree]:
        """The conditions as trees."""
        return [syntax(c.text) for c in self.conditions]

    @property
    def switches(self) -> list[Signal]:
        """The expressions of controllers as signals, which may switch at times known beforehand."""
        texts: list[str] = []
        for c in self.model.case.controllers.values():
            texts += [c.input] if isinstance(c, Pid) else [*c.rate.values(), c.output]
        return [Signal(Expression(text)) for text in texts]

    @cached_property
    def sampled(self) -> dict[str, float]:
        """The sampling intervals of the discrete-time controllers."""
        return {name: c.sample for name, c in self.controllers.items() if c.sample is not None}

    def instants(self, t_end: float) -> list[Break]:
        """Return the times in (0, t_end) at which controllers sample."""
        times = sorted({k * step for step in self.sampled.values() for k in range(1, math.ceil(t_end / step))})
        return [Break(t, 0, math.nextafter(t, -math.inf)) for t in times]

    def due(self, t: float) -> list[str]:
        """Return the controllers that sample at t, each after those that it depends on."""
        found = tuple(name for name, step in self.sampled.items()
                      if abs(t / step - round(t / step)) < NEAR * max(t / step, 1.0))
        if found not in self._in_turn:
            self._in_turn[found] = self._ordered(found)
        return self._in_turn[found]

    def _ordered(self, found: tuple[str, ...]) -> list[str]:
        out: list[str] = []

        def add(name: str, above: tuple[str, ...]) -> None:
            for tree in self.controllers[name].given.values():
                for other in named_in(tree):
                    if other in found and other not in (*out, *above, name):
                        add(other, (*above, name))
            if name not in out:
                out.append(name)

        for name in found:
            add(name, ())
        return out

    def programs(self) -> jets.Programs:
        """Return the programs of all signals that depend on the motion, then of state rates, conditions and margins."""
        trees = (*self.rates, *self.condition_trees, *map(margin, self.condition_trees))
        functions = [*((a.amplitude, a.factor) for a in self.signals), *((tree, 1.0) for tree in trees)]
        return state_programs(functions, self.meaning, len(self.names))  # type: ignore[arg-type]

    def values(self, d: Array, v: Array, turned: Array, states: Array) -> Array:
        """Return all quantities and states at d with rates v (n_full,), for bodies turned by ``turned`` (bodies,)."""
        model, d = self.model, d[:self.model.n_q]
        e = model.e0 + d
        out = np.zeros(len(self.names))
        for k, (kind, along, _, rotation) in enumerate(self.quantities):
            if kind == POSITION:
                out[k] = along.p0 + along.weights @ d[along.coords]
            elif kind == RATE:
                out[k] = along.weights @ v[along.coords]
            elif rotation is not None:
                out[k] = (model.turns.theta(rotation, e, d, turned) if kind == ANGLE
                          else rotation.gradient(e) @ v[rotation.dofs])
        first = len(self.quantities)
        out[first:first + len(self.states)] = states
        return out

    def _program(self, functions: list[Any]) -> jets.Programs:
        """Return the programs of (function or tree, factor), compiled once."""
        key = tuple(id(function) for function, _ in functions)
        if key not in self._made:
            self._made[key] = functions, state_programs(functions, self.meaning, len(self.names))
        return self._made[key][1]

    def evaluate(self, trees: Mapping[str, Tree], t: float, values: Array) -> dict[str, float]:
        """Return the values of some trees. Raises ComputationError with the name of one that has none."""
        program = self._program([(tree, 1.0) for tree in trees.values()])
        return {name: self._finite(value_at(program, k, t, values.tolist())[0], name, t, values)
                for k, name in enumerate(trees)}

    def initial(self, d: Array, v: Array, turned: Array) -> Array:
        """Return the controller states at t = 0, at d with rates v (n_full,)."""
        out = np.zeros(len(self.states))
        for c in self.controllers.values():
            values = self.values(d, v, turned, out)
            for name, value in self.evaluate(c.initial, 0.0, values).items():
                out[self.states.index(name)] = value
        return out

    def sample(self, t: float, due: list[str], values: Array) -> Array:
        """Return the controller states after the controllers ``due`` have sampled at t; ``values`` are those before."""
        out = values.copy()
        for name in due:
            c = self.controllers[name]
            for state, value in self.evaluate(c.samples, t, out).items():
                out[self.names.index(state)] = value
        return out[len(self.quantities):len(self.quantities) + len(self.states)]

    def outputs(self, t: float, values: Array) -> dict[str, dict[str, float]]:
        """Return the output of every controller and its states."""
        out = self.evaluate({name: c.output for name, c in self.controllers.items()}, t, values)
        return {name: {"output": out[name], **{state.partition(":")[2]: float(values[self.names.index(state)])
                                               for state in c.rates}} for name, c in self.controllers.items()}

    def evaluate_signals(self, t: float, values: Array) -> None:
        """Evaluate the signals at a state. Raises ComputationError for one without a value."""
        for signal in self.signals:
            assert signal.amplitude is not None
            if isinstance(signal.amplitude, Gated) and not signal.amplitude.latch.at(t):
                signal.level[0] = 0.0
                continue
            program = self._program([(signal.amplitude, signal.factor)])
            found = value_at(program, 0, t, values.tolist())[0]
            signal.level[0] = self._finite(found, signal.amplitude.described(), t, values)

    def check(self, t: float, values: Array) -> None:
        """Raise ComputationError if a signal, rate, output or condition has no value."""
        self.evaluate_signals(t, values)
        self.holding(t, values)
        for c in self.controllers.values():
            self.evaluate(c.rates, t, values)

    def holding(self, t: float, values: Array) -> list[bool]:
        """Return which conditions hold. Raises ComputationError for one without a value."""
        named = {f"the condition '{c.text}'": tree
                 for c, tree in zip(self.conditions, self.condition_trees, strict=True)}
        found = self.evaluate(named, t, values)
        return [found[f"the condition '{c.text}'"] != 0.0 for c in self.conditions]

    def _finite(self, value: float, what: str, t: float, values: Array) -> float:
        if math.isfinite(value):
            return value
        used = {name: float(f"{x:.6g}") for name, x in zip(self.names, values, strict=True)
                if RATE_SIGN not in name}
        what = next(self._origins(t, values), f"the controller's {what}" if ":" in what else what)
        raise ComputationError(f"{what} has no value: it divides by zero, or a square root or a power is not real",
                               at={"t": t, **used}, advice="guard the expression with 'a if c else b'")

    def _origins(self, t: float, values: Array) -> Iterator[str]:
        """Yield the controller expressions without a value, those that others depend on first."""
        for name in self._ordered(tuple(self.controllers)):
            for what, tree in self.controllers[name].given.items():
                if not math.isfinite(value_at(self._program([(tree, 1.0)]), 0, t, values.tolist())[0]):
                    yield what


def _conditions(model: Any) -> Iterator[Condition]:
    """Yield the conditions of all latches, then the one that ends the motion."""
    for latch in model.latches:
        for which in ("after", "until"):
            text = getattr(latch.active, which)
            if text is not None:
                yield Condition(latch, which, text)
    solver = model.case.solver
    if isinstance(solver, Dynamic) and solver.until is not None:
        yield Condition(None, "until", solver.until)


def quantity_of(model: Any, name: str) -> Quantity:
    """Return the quantity PROBE.QUANTITY of a model. Raises CaseError for a point off the axis of a rigid section."""
    probe, _, what = name.partition(".")
    place = model.case.output.probes[probe]
    point = model.point(place.at, place.y)
    if point.offset:
        raise _off_axis(model, probe)
    if what in ("theta", "omega"):
        return _rotation(point, what == "theta")
    coords, weights = point.position()[what.endswith("y")]
    first = point.mesh.first_dof
    start = dot((coords - first, weights), point.mesh.e0) if what in ("x", "y") else 0.0
    return Quantity(RATE if what in RATES else POSITION, Field(coords, weights, start))


def _rotation(point: PointRef, angle: bool) -> Quantity:
    if point.turns_by_theta:
        return Quantity(POSITION if angle else RATE, Field(*point.theta()))
    _, (along, across) = turn_fields(point)
    return Quantity(ANGLE if angle else SPIN, along, across, Rotation(point))


def _off_axis(model: Any, probe: str) -> CaseError:
    path = ("output", "probes", probe)
    message = f"output.probes.{probe}: expressions cannot use a point off the axis of a rigid section"
    if model.loaded is None:
        return CaseError(Problem(message))
    return CaseError(model.loaded.source.problem(path, message, "a point on the axis"))


def margin(tree: Tree) -> Tree:
    """Return a tree that is >= 0 where a condition holds and below 0 elsewhere, as a measure of the distance from it.

    It is smooth where the compared expressions are. Products of comparisons mean "and", sums "or"; the margin of other
    trees is -1.
    """
    match tree:
        case Comparison(left, rest):
            parts: list[Tree] = []
            for op, right in rest:
                one, two = (left, right) if op[0] == ">" else (right, left)
                parts.append(Chain(one, (("-", two),)) if op[0] in "<>" else Constant(-1.0))
                left = right
            return _extreme("<", parts)
        case Choice(condition, chosen, other):
            return Choice(condition, margin(chosen), margin(other))
        case Chain(first, rest) if len({op for op, _ in rest}) == 1 and rest[0][0] in "+*":
            parts = [margin(part) for part in (first, *(x for _, x in rest))]
            return _extreme("<" if rest[0][0] == "*" else ">", parts)
    return Constant(-1.0)


def _extreme(op: str, parts: Sequence[Tree]) -> Tree:
    """Return the smallest (<) or largest (>) of several trees."""
    out, *rest = parts
    for part in rest:
        out = Choice(Comparison(out, ((op, part),)), out, part)
    return out
