"""Times at which signals are not smooth: time steps must end there, or they lose their order."""

from __future__ import annotations

import math
import operator
from bisect import bisect_left
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ..case import Case, syntax
from ..case.emit import walk
from ..case.programs import Function
from ..elements.shape import Array
from .timing import Signal

# number of times between which switches are searched, at least ten for each switch, and the largest number
SAMPLES, TO_A_SWITCH, MOST_SAMPLES = 20001, 10, 2000001
SMOOTH = 3
# number of times between which turning points of a smooth signal are searched
TURNS = 2001
# number of times between two breaks at which polynomials, and other functions, are compared
BETWEEN, CLOSELY = 5, 1000
CLOSE = 1e-12
_COMPARE = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq,
            "!=": operator.ne}
_BINARY = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}
_FUNCTIONS = {"sin": np.sin, "cos": np.cos, "exp": np.exp, "sqrt": np.sqrt, "abs": np.abs}


class Break(NamedTuple):
    """A jump of the value (order 0), or of the first or second time derivative.

    A signal has its value after the break at ``t``, and its value before it at ``before``, the preceding float.
    """

    t: float
    order: int
    before: float


class MotionPiece(NamedTuple):
    """A time interval in which signals are smooth: evaluated from ``first`` to ``last``, in steps that end at ``stop``.

    Where ``stop`` is a break, ``last`` is the float before it, and ``first`` of the next piece is the break.
    """

    first: float
    last: float
    stop: float


def piece_at(all_pieces: Sequence[MotionPiece], t: float) -> MotionPiece:
    """Return the piece that contains a time; at a break the one before it."""
    return all_pieces[bisect_left(all_pieces, t, key=lambda piece: piece.last)]


def motion_pieces(signals: Iterable[Signal], t_end: float, more: Iterable[Break] = ()) -> list[MotionPiece]:
    """Return the pieces of a motion from 0 to t_end, divided at the breaks of its signals and at ``more``.

    Breaks within round-off of 0 come before the first piece; one within round-off of t_end ends the last.
    """
    near, first = CLOSE * t_end, math.nextafter(0.0, 1.0)
    out: list[MotionPiece] = []
    found = [b for s in dict.fromkeys(signals) for b in breakpoints(s, 0.0, t_end)]
    for b in _merged([*found, *more], t_end):
        if b.t > t_end - near:
            return [*out, MotionPiece(first, b.before, t_end)]
        if b.t > near:
            out.append(MotionPiece(first, b.before, b.t))
        first = b.t
    return [*out, MotionPiece(first, math.inf, t_end)]


def instants(interval: float, t_end: float, each: int = 1) -> Array:
    """Return the multiples of ``each`` intervals strictly between 0 and t_end."""
    count = int(np.floor(t_end / (each * interval) * (1.0 + CLOSE)))
    times = interval * np.arange(each, each * count + 1, each, dtype=float)
    return times[times < t_end * (1.0 - CLOSE)]


def comparison_times(courses: Iterable[Callable[[float], float]], t0: float, t1: float) -> list[float]:
    """Return times in [t0, t1] such that functions equal at all of them are equal: at, just before and between breaks.

    Between breaks, ramps and tables are polynomials, and other functions than signals are linear. Sines and expressions
    are analytic there and need more times.
    """
    if t1 == t0:
        return [t0]
    signals = [s for s in courses if isinstance(s, Signal) and s.amplitude is not None]
    breaks = [b for s in dict.fromkeys(signals) for b in breakpoints(s, t0, t1)]
    ends = sorted({t0, t1, *(b.t for b in breaks), *(b.before for b in breaks)})
    n = BETWEEN if all(s.amplitude is not None and s.amplitude.polynomial for s in signals) else CLOSELY
    inner = 0.5 - 0.5 * np.cos(np.pi * (np.arange(n) + 0.5) / n)
    between = [a + (b - a) * x for a, b in pairwise(ends) for x in inner.tolist()]
    return sorted({*ends, *between})


def jumps(signal: Signal, t0: float, t1: float) -> list[float]:
    """Return the times in (t0, t1] at which the value itself jumps."""
    return [b.t for b in breakpoints(signal, t0, t1) if b.order == 0]


@lru_cache(maxsize=256)
def breakpoints(signal: Signal, t0: float, t1: float) -> tuple[Break, ...]:
    """Return the breaks of a signal in (t0, t1], in order.

    Those of ramps and tables are exact. The switches of an expression (comparisons, conditions, abs) are searched
    between ``SAMPLES`` times, more if there are many, and at every number in the expression, and located to the last
    digit.
    """
    amplitude = signal.amplitude
    if signal.factor == 0.0 or amplitude is None or amplitude.scale == 0.0:
        return ()
    if amplitude.ungated is not amplitude:
        return breakpoints(Signal(amplitude.ungated, signal.factor), t0, t1)
    places = [Break(t, 0, math.nextafter(t, -math.inf)) for t in amplitude.knots if t0 < t <= t1]
    if amplitude.tree is not None:
        places += switches(amplitude.tree, t0, t1)
    for part in amplitude.parts:
        places += breakpoints(Signal(part), t0, t1)
    unit, size = Signal(amplitude), _size(amplitude, t0, t1)
    found = [b._replace(order=_order(unit, b.before, b.t, size, t1 - t0)) for b in _merged(places, t1)]
    return tuple(b for b in found if b.order < SMOOTH)


def case_breaks(case: Case, t0: float, t1: float) -> list[Break]:
    """Return the breaks of all amplitudes of a case in (t0, t1), in order, where a path-dependent history can turn."""
    found = dict.fromkeys(value for _, value, _ in walk(case) if isinstance(value, Function))
    breaks = _merged([b for a in found for b in breakpoints(Signal(a), t0, t1)], t1)
    return [b for b in breaks if b.t < t1]


def case_stops(case: Case, t0: float, t1: float, turns: bool = True, more: Iterable[float] = ()) -> list[Break]:
    """Return the breaks of ``case_breaks``, in order, with other times in (t0, t1), which have the order SMOOTH.

    These are the turning points of amplitudes, if ``turns`` is true, and ``more``.
    """
    others = [*(_turns(case, t0, t1) if turns else ()), *(t for t in more if t0 < t < t1)]
    return _merged([*case_breaks(case, t0, t1), *(Break(t, SMOOTH, t) for t in others)], t1)


def _turns(case: Case, t0: float, t1: float) -> list[float]:
    """Return the turning points of a case's amplitudes, except polynomials, between their breaks in (t0, t1), in order.

    They are searched between ``TURNS`` times and located to round-off; of an interval in which an amplitude is
    constant, both ends are returned.
    """
    from scipy.optimize import brentq

    found = list[float]()
    for amplitude in dict.fromkeys(value for _, value, _ in walk(case) if isinstance(value, Function)
                                  and not value.polynomial):
        signal, t = Signal(amplitude), np.linspace(t0, t1, TURNS)
        rates = np.array([signal.derivatives(x)[1] for x in t.tolist()])
        for k in np.flatnonzero(rates[:-1] * rates[1:] < 0.0).tolist():
            # at a break where it turns, the rate jumps, and the root is this jump
            x = brentq(lambda x, of=signal: of.derivatives(x)[1], t[k], t[k + 1], xtol=CLOSE * (t1 - t0))
            found.append(float(x))
        rests = rates == 0.0
        found += t[1:-1][rests[1:-1] & ~(rests[:-2] & rests[2:])].tolist()
    return sorted(set(found))


def _merged(breaks: Iterable[Break], t1: float) -> list[Break]:
    """Return breaks in order; those that coincide up to round-off become one of the lowest order."""
    out: list[Break] = []
    for b in sorted(breaks, key=lambda b: (b.before, b.t)):
        if out and b.before - out[-1].t <= CLOSE * abs(t1):
            last = out.pop()
            b = Break(max(last.t, b.t), min(last.order, b.order), last.before)
        out.append(b)
    return out


def _size(amplitude: Function, t0: float, t1: float) -> float:
    """Return an estimate of the largest magnitude of the value."""
    if amplitude.tree is not None:
        with np.errstate(all="ignore"):
            v = np.abs(amplitude.scale * _Trace(np.linspace(t0, t1, 101)).value(amplitude.tree))
        return float(np.max(v, where=np.isfinite(v), initial=0.0))
    return max(abs(Signal(amplitude)(t)) for t in (t0, t1, *amplitude.knots))


def _order(signal: Signal, before: float, after: float, size: float, span: float) -> int:
    """Return the lowest derivative that differs between two neighbouring times, or SMOOTH if none does."""
    sides = np.array([signal.derivatives(t) for t in (before, after)])
    change, largest = np.abs(sides[1] - sides[0]), np.max(np.abs(sides), axis=0)
    moved = 2.0 * (after - before) * largest[1] if math.isfinite(largest[1]) else 0.0
    for order in range(SMOOTH):
        scale = max(largest[order], size)
        # written such that a derivative without a value counts as a break
        if not change[order] <= 1e-10 * scale + (moved if order == 0 else 0.0):
            return order
        size /= span
    return SMOOTH


def switches(tree: syntax.Tree, t0: float, t1: float) -> list[Break]:
    """Return the pairs of neighbouring floats in (t0, t1] between which a switch of the expression changes."""
    named = [x for x in _traced(tree, np.array([t0])).named if t0 < x < t1]
    near = [math.nextafter(x, way) for x in named for way in (-math.inf, math.inf)]
    samples = SAMPLES
    while True:
        t = np.unique(np.concatenate([np.linspace(t0, t1, samples), named, near]))
        pattern = _patterns(tree, t)
        if not len(pattern):
            return []
        changed = np.flatnonzero(np.any(pattern[:, 1:] != pattern[:, :-1], axis=0))
        if TO_A_SWITCH * len(changed) <= samples or samples >= MOST_SAMPLES:
            break
        samples = min(10 * samples, MOST_SAMPLES)
    low, high = t[changed], t[changed + 1]
    found: list[Break] = []
    while len(low):
        a, b = _first_change(tree, low, high)
        found += [Break(after, 0, before) for before, after in zip(a.tolist(), b.tolist(), strict=True)]
        # there may be more changes before the next sample
        more = np.any(_patterns(tree, b) != _patterns(tree, high), axis=0)
        low, high = b[more], high[more]
    return found


def _first_change(tree: syntax.Tree, low: Array, high: Array) -> tuple[Array, Array]:
    """Return neighbouring floats in each interval: the last with the pattern of its start, and the first without."""
    a, b, start = low.copy(), high.copy(), _patterns(tree, low)
    while True:
        middle = a + 0.5 * (b - a)
        if not np.any(open_ := (middle > a) & (middle < b)):
            return a, b
        same = np.all(_patterns(tree, middle) == start, axis=0)
        a, b = np.where(open_ & same, middle, a), np.where(open_ & ~same, middle, b)


def _patterns(tree: syntax.Tree, t: Array) -> Array:
    """Return the state (k, n) of every switch at the times t (n,)."""
    return np.array(_traced(tree, t).pattern)


class _Trace:
    """Evaluate an expression at many times at once and record the states of its switches."""

    def __init__(self, t: Array) -> None:
        self.t = t
        self.pattern: list[Array] = []
        self.named: set[float] = set()

    def note(self, state: Any, *operands: Array) -> None:
        """Record a switch as on, off or without a value; it may be in a branch that is not taken."""
        self.pattern.append(np.where(np.any(np.isnan(operands), axis=0), 2, state))

    def value(self, tree: syntax.Tree) -> Array:
        """Return the values (n,), nan where there is none."""
        match tree:
            case syntax.Constant(value):
                self.named.add(value)
                return np.full(len(self.t), value)
            case syntax.Variable():
                return self.t
            case syntax.Quantity():
                # unknown beforehand: conditions on it are events of the running motion
                return np.full(len(self.t), np.nan)
            case syntax.Negative(operand):
                return -self.value(operand)
            case syntax.Power(base, exponent):
                return np.power(self.value(base), self.value(exponent))
            case syntax.Chain(first, rest):
                total = self.value(first)
                for op, operand in rest:
                    total = _BINARY[op](total, self.value(operand))
                return total
            case syntax.Call(name, argument):
                x = self.value(argument)
                if name == "abs":
                    self.note(x >= 0.0, x)
                return _FUNCTIONS[name](x)
            case syntax.Comparison(first, rest):
                return self.comparison(first, rest)
            case syntax.Choice(condition, chosen, other):
                asked, a, b = self.value(condition), self.value(chosen), self.value(other)
                return np.where(np.isnan(asked), np.nan, np.where(asked != 0.0, a, b))

    def comparison(self, first: syntax.Tree, rest: tuple[tuple[str, syntax.Tree], ...]) -> Array:
        """Return 1 where all comparisons of a chain hold, else 0; nan where an operand has no value."""
        left, result = self.value(first), np.ones(len(self.t))
        for op, operand in rest:
            right = self.value(operand)
            holds = _COMPARE[op](left, right)
            self.note(holds, left, right)
            lost = np.isnan(left) | np.isnan(right)
            result = np.where(result == 1.0, np.where(lost, np.nan, holds), result)
            left = right
        return result


def _traced(tree: syntax.Tree, t: Array) -> _Trace:
    trace = _Trace(t)
    with np.errstate(all="ignore"):
        trace.value(tree)
    return trace
