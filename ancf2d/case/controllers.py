"""Controllers as equations: the rates of their states, or what these become at sampling instants, and their outputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from .schema.controllers import Controller, Pid
from .syntax import (
    Call,
    Chain,
    Choice,
    Comparison,
    Constant,
    Negative,
    Power,
    Quantity,
    Time,
    Tree,
    named_in,
    renamed,
    syntax,
)

# what the rate of a quantity of a probe is
_RATES = {"x": "vx", "ux": "vx", "y": "vy", "uy": "vy", "theta": "omega"}


class Equations(NamedTuple):
    """A controller as equations; its states are named CONTROLLER:STATE.

    initial : values at t = 0, as trees in quantities of the motion; rates : of the states, 0 where they are held;
    samples : what states become at every multiple of ``sample``, from those before; output : tree; given : expressions
    of the case by what messages call them.
    """

    initial: dict[str, Tree]
    rates: dict[str, Tree]
    output: Tree
    sample: float | None
    samples: dict[str, Tree]
    given: dict[str, Tree]


def equations(name: str, controller: Controller) -> Equations:
    """Return the equations of a controller. Raises DerivativeError where a rate that it needs is not known."""
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
        initial[state], rates[state] = Constant(0.0), _stopped(gain, total, pid.limit)
    return Equations(initial, rates, _limited(total, pid.limit), None, {},
                     {_called(pid.input, f"{name}.input"): e})


def _sampled(name: str, pid: Pid, step: float) -> Equations:
    """The rate is a backward difference, the integral a sum of what has been seen, the last included."""
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
    """Return what is integrated: nothing where it would drive an output at its limit further."""
    if limit is None:
        return gain
    low, high, zero = Constant(limit[0]), Constant(limit[1]), Constant(0.0)
    above = Choice(_compared(gain, ">", zero), zero, gain)
    below = Choice(_compared(gain, "<", zero), zero, gain)
    return Choice(_compared(value, ">=", high), above, Choice(_compared(value, "<=", low), below, gain))


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
    """An expression whose rate the positions and velocities of a motion do not tell."""


def rate_of(tree: Tree) -> Tree:
    """Return the derivative by time of an expression in t and positions. Raises DerivativeError of other quantities."""
    match tree:
        case Time():
            return Constant(1.0)
        case Quantity(name):
            probe, _, quantity = name.partition(".")
            if quantity not in _RATES:
                raise DerivativeError(f"the rate of {name} is not known")
            return Quantity(f"{probe}.{_RATES[quantity]}")
        case Negative(operand):
            return Negative(rate_of(operand))
        case Power(base, Constant(n)):
            return _times(_times(Constant(n), Power(base, Constant(n - 1.0))), rate_of(base)) if n else Constant(0.0)
        case Power(_, _):
            raise DerivativeError("the rate of a power with an exponent that varies is not known")
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


def loop(outputs: Mapping[str, Tree]) -> list[str]:
    """Return controllers that need the output of each other at the same instant, the first one again at the end."""
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
