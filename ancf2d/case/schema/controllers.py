"""Controllers, which compute numbers for loads from quantities of a motion, as keys of a case and as equations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from ...quantities import RATE_OF
from ..binder import Binder, Issue, Path, dotted
from ..declare import key, record
from ..kinds import MapOf, Number, Vector
from ..nodes import MapNode, Node
from ..records import OneOf
from ..syntax import (
    IDENTIFIER,
    WORDS,
    Call,
    Chain,
    Choice,
    Comparison,
    Constant,
    Negative,
    Power,
    Quantity,
    Tree,
    Variable,
    named_in,
    renamed,
    syntax,
)
from .amplitudes import ExpressionText

# width of the band around a limit in which integration fades out, relative to the range between the limits
BAND = 1e-10
# the rate of a state has its name and this sign; name of a number in rates of limited integrals (``_bounded``)
RATE_SIGN, PULL = "'", "pull'"


class Identifiers(MapOf):
    """The kind of a mapping by names that expressions can use."""

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        if isinstance(node, MapNode):
            for name, entry in node.entries.items():
                if not IDENTIFIER.fullmatch(name) or name in WORDS:
                    binder.fail(entry.mark, (*path, name), f"{dotted((*path, name))}: expressions cannot use this name",
                                f"a letter, then letters, digits and _, and none of {', '.join(WORDS)}")
        return super().bind(node, path, binder)


@record
class Pid:
    """A PID controller: kp e + ki times the integral of e + kd times the rate of e."""

    tag = "pid"
    input: str = key(ExpressionText(feedback=True), "Error e, which the controller reduces to zero",
                     example="1 - arm.theta")
    kp: float = key(Number(), "Gain", default=0.0)
    ki: float = key(Number(), "Gain of the integral [1/s]", default=0.0)
    kd: float = key(Number(), "Gain of the rate [s]", default=0.0)
    filter: float = key(Number("s", ge=0), "Time constant of a filter on the rate, which starts at the input",
                        default=0.0)
    limit: tuple[float, float] | None = key(
        Vector(Number(), "lowest, highest"), "Bounds of the output; the integration stops there", default=None,
        example=[-5, 5])
    sample: float | None = key(Number("s", gt=0), "Sampling interval; the output is held in between, the integral is "
                               "a sum and the rate a difference (default: continuous)",
                               default=None)

    def check(self) -> Iterator[Issue]:
        """Yield an issue if the limits are not in order, or no gain is given."""
        if self.limit is not None and not self.limit[0] < self.limit[1]:
            yield Issue(("limit",), f"{{}}.limit: the lowest must be less than the highest, got {self.limit[0]:g} and "
                        f"{self.limit[1]:g}")
        if self.kp == self.ki == self.kd == 0.0:
            yield Issue((), "{}: no gain is given", "kp, ki or kd")


@record
class StateController:
    """A controller with states of its own, which obey differential equations."""

    tag = "state"
    rate: dict[str, str] = key(Identifiers(ExpressionText(feedback=True), "rates of states by name", 1),
                               "Rate of each state", example={"z": "1 - arm.theta - z"})
    output: str = key(ExpressionText(feedback=True), "Output", example="3*z")
    initial: dict[str, float] = key(Identifiers(Number(), "initial values of states by name"),
                                    "Value of each state at t = 0 (default: 0)", default={})

    def check(self) -> Iterator[Issue]:
        """Yield an issue for each initial value without a state."""
        for name in self.initial:
            if name not in self.rate:
                yield Issue(("initial", name), f"{{}}.initial: there is no state '{name}'", ", ".join(self.rate))


Controller = Pid | StateController


class ControllerKind(OneOf):
    """The kind of a controller, whose expressions may use its states."""

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        rates = node.entries.get("rate") if isinstance(node, MapNode) else None
        binder.states = tuple(rates.node.entries) if rates is not None and isinstance(rates.node, MapNode) else ()
        found = super().bind(node, path, binder)
        binder.states = ()
        return found


class Equations(NamedTuple):
    """A controller as equations; its states are named CONTROLLER:STATE.

    initial : values at t = 0, as trees in quantities of the motion; rates : of the states, 0 for states that are held;
    samples : new values of states at every multiple of ``sample``, from the old ones; output : tree; given :
    expressions of the case, by their names in messages.
    """

    initial: dict[str, Tree]
    rates: dict[str, Tree]
    output: Tree
    sample: float | None
    samples: dict[str, Tree]
    given: dict[str, Tree]


def equations(name: str, controller: Controller) -> Equations:
    """Return the equations of a controller. Raises DerivativeError if the rate of its input is needed but unknown."""
    if isinstance(controller, Pid):
        return _sampled(name, controller, controller.sample) if controller.sample else _continuous(name, controller)
    own: dict[str, Tree] = {state: Quantity(f"{name}:{state}") for state in controller.rate}
    trees = {f"{name}:{state}": renamed(syntax(text), own) for state, text in controller.rate.items()}
    initial: dict[str, Tree] = {f"{name}:{s}": Constant(controller.initial.get(s, 0.0)) for s in controller.rate}
    output = renamed(syntax(controller.output), own)
    given = {_called(text, f"{name}.rate.{state}"): trees[f"{name}:{state}"] for state, text in controller.rate.items()}
    return Equations(initial, trees, output, None, {}, {**given, _called(controller.output, f"{name}.output"): output})


def _called(text: str, place: str) -> str:
    return f"the expression '{text}' in controllers.{place}"


def _continuous(name: str, pid: Pid) -> Equations:
    e, initial, rates = syntax(pid.input), {}, {}
    total: Tree = _times(Constant(pid.kp), e)
    if pid.kd != 0.0 and pid.filter > 0.0:
        state = f"{name}:filtered"
        initial[state], rates[state] = e, _over(_minus(e, Quantity(state)), Constant(pid.filter))
        total = _plus(total, _times(Constant(pid.kd), rates[state]))
    elif pid.kd != 0.0:
        total = _plus(total, _times(Constant(pid.kd), rate_of(e)))
    if pid.ki != 0.0:
        state, gain = f"{name}:integral", _times(Constant(pid.ki), e)
        total = _plus(total, Quantity(state))
        initial[state], rates[state] = Constant(0.0), _bounded(gain, total, pid.limit, state)
    return Equations(initial, rates, _limited(total, pid.limit), None, {},
                     {_called(pid.input, f"{name}.input"): e})


def _sampled(name: str, pid: Pid, step: float) -> Equations:
    """Return the equations of a sampled PID controller.

    The rate is a backward difference, the integral a sum over all samples including the last one.
    """
    e, before, integral = syntax(pid.input), Quantity(f"{name}:filtered"), Quantity(f"{name}:integral")
    change = _over(_minus(e, before), Constant(pid.filter + step))
    fixed = _plus(_times(Constant(pid.kp), e), _times(Constant(pid.kd), change))
    gain = _times(Constant(pid.ki * step), e)
    added = _plus(integral, _stopped(gain, _plus(_plus(fixed, integral), gain), pid.limit))
    output = f"{name}:output"
    samples = {output: _limited(_plus(fixed, added), pid.limit), f"{name}:integral": added,
               f"{name}:filtered": _plus(before, _times(Constant(step), change))}
    initial: dict[str, Tree] = {output: Constant(0.0), f"{name}:integral": Constant(0.0), f"{name}:filtered": e}
    return Equations(initial, {state: Constant(0.0) for state in initial}, Quantity(output), step, samples,
                     {_called(pid.input, f"{name}.input"): e})


def _limited(value: Tree, limit: tuple[float, float] | None) -> Tree:
    if limit is None:
        return value
    low, high = map(Constant, limit)
    return Choice(_compared(value, "<", low), low, Choice(_compared(value, ">", high), high, value))


def _stopped(gain: Tree, value: Tree, limit: tuple[float, float] | None) -> Tree:
    """Return the increment of the integral: zero if it would drive the output further beyond a limit."""
    if limit is None:
        return gain
    low, high, zero = Constant(limit[0]), Constant(limit[1]), Constant(0.0)
    above = Choice(_compared(gain, ">", zero), zero, gain)
    below = Choice(_compared(gain, "<", zero), zero, gain)
    return Choice(_compared(value, ">=", high), above, Choice(_compared(value, "<=", low), below, gain))


def _bounded(gain: Tree, value: Tree, limit: tuple[float, float] | None, state: str) -> Tree:
    """Return the rate of the integral, between 0 and ``gain``: ``gain`` within the limits of the output, 0 beyond the
    one towards which it would drive the output, and in between at that limit.

    If the rest of the output falls while the integral would raise it, the output stays at the limit. Where the rate r
    is an unknown, it solves r = r + PULL (limit - value), cut to these bounds, whatever the positive PULL; else PULL is
    0, and the rate fades out in a band.
    """
    if limit is None:
        return gain
    zero, r = Constant(0.0), Quantity(state + RATE_SIGN)

    def moved(end: float) -> Tree:
        return _plus(r, _times(Quantity(PULL), _minus(Constant(end), value)))
    up, down = moved(limit[1]), moved(limit[0])
    rises = Choice(_compared(up, "<", zero), zero, Choice(_compared(up, ">", gain), gain, up))
    falls = Choice(_compared(down, ">", zero), zero, Choice(_compared(down, "<", gain), gain, down))
    exact = Choice(_compared(gain, ">", zero), rises, falls)
    return Choice(_compared(Quantity(PULL), ">", zero), exact, _faded(gain, value, limit))


def _faded(gain: Tree, value: Tree, limit: tuple[float, float]) -> Tree:
    """Return the rate of the integral, faded out in a band around each limit of the output and zero beyond it.

    A rate that jumped there would have no solution, as it would need both values at once. The band is centred on the
    limit, so that an output that crosses it loses as much before the limit as it gains after it.
    """
    band, half, one, zero = map(Constant, (BAND * (limit[1] - limit[0]), 0.5, 1.0, 0.0))

    def share(inside: Tree) -> Tree:
        """Return 1 at half a band or more inside the limit, 0 at half a band or more beyond it, smooth between."""
        rest = _plus(half, _over(inside, band))
        smooth = _times(_times(rest, rest), _minus(Constant(3.0), _times(Constant(2.0), rest)))
        return Choice(_compared(rest, ">=", one), one, Choice(_compared(rest, "<=", zero), zero, smooth))
    above, below = share(_minus(Constant(limit[1]), value)), share(_minus(value, Constant(limit[0])))
    return _times(gain, Choice(_compared(gain, ">", zero), above, below))


def _compared(a: Tree, op: str, b: Tree) -> Tree:
    return Comparison(a, ((op, b),))


def _plus(a: Tree, b: Tree) -> Tree:
    return Chain(a, (("+", b),))


def _minus(a: Tree, b: Tree) -> Tree:
    return Chain(a, (("-", b),))


def _times(a: Tree, b: Tree) -> Tree:
    return Chain(a, (("*", b),))


def _over(a: Tree, b: Tree) -> Tree:
    return Chain(a, (("/", b),))


class DerivativeError(ValueError):
    """Raised for an expression whose rate does not follow from the positions and velocities of a motion."""


def rate_of(tree: Tree) -> Tree:
    """Return the time derivative of an expression in t and positions. Raises DerivativeError for other quantities."""
    match tree:
        case Variable():
            return Constant(1.0)
        case Quantity(name):
            probe, _, quantity = name.partition(".")
            if quantity not in RATE_OF:
                raise DerivativeError(f"the rate of {name} is unknown")
            return Quantity(f"{probe}.{RATE_OF[quantity]}")
        case Negative(operand):
            return Negative(rate_of(operand))
        case Power(base, Constant(n)):
            return _times(_times(Constant(n), Power(base, Constant(n - 1.0))), rate_of(base)) if n else Constant(0.0)
        case Power(_, _):
            raise DerivativeError("the rate of a power with an exponent that varies is unknown")
        case Chain(first, rest):
            return _rate_of_chain(first, rest)
        case Call(name, x):
            return _times(_outer(name, x), rate_of(x))
        case Choice(condition, chosen, other):
            return Choice(condition, rate_of(chosen), rate_of(other))
    return Constant(0.0)


def _rate_of_chain(first: Tree, rest: tuple[tuple[str, Tree], ...]) -> Tree:
    value, rate = first, rate_of(first)
    for op, operand in rest:
        other = rate_of(operand)
        if op in "+-":
            rate = Chain(rate, ((op, other),))
        elif op == "*":
            rate = _plus(_times(rate, operand), _times(value, other))
        else:
            rate = _over(_minus(rate, _times(_over(value, operand), other)), operand)
        value = Chain(value, ((op, operand),))
    return rate


def _outer(name: str, x: Tree) -> Tree:
    """Return the derivative of a function at x."""
    if name == "sin":
        return Call("cos", x)
    if name == "cos":
        return Negative(Call("sin", x))
    if name == "exp":
        return Call("exp", x)
    if name == "sqrt":
        return _over(Constant(0.5), Call("sqrt", x))
    return Choice(_compared(x, "<", Constant(0.0)), Constant(-1.0), Constant(1.0))


def algebraic_loop(outputs: Mapping[str, Tree]) -> list[str]:
    """Return a cycle of controllers that need each other's output at the same instant, closed by the first; else []."""
    def visit(name: str, way: list[str]) -> list[str]:
        if name in way:
            return [*way[way.index(name):], name]
        for other in named_in(outputs[name]):
            if other in outputs and name not in done:
                found = visit(other, [*way, name])
                if found:
                    return found
        done.add(name)
        return []

    done: set[str] = set()
    return next((found for name in outputs if (found := visit(name, []))), [])
