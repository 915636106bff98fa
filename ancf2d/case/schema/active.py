"""When loads, springs, supports and joints are active: between times, or until conditions are met."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from .. import jets
from ..binder import INVALID, Binder, Issue, Path, dotted, reversed_range
from ..declare import key, record
from ..kinds import Number
from ..nodes import Node
from ..programs import Assembler, Function
from ..records import Record
from ..syntax import Comparison, Constant, Variable, compares, syntax
from .amplitudes import Constant as Always
from .amplitudes import ExpressionText


class Condition(ExpressionText):
    """The kind of an expression that is true or false: it must contain a comparison."""

    def __init__(self) -> None:
        super().__init__(feedback=True)

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        text = super().bind(node, path, binder)
        if text is not INVALID and not compares(syntax(text)):
            return binder.fail(node.mark, path, f"{dotted(path)} compares nothing",
                               "a condition, such as 'abs(tip.y) > 0.1'")
        return text


@record
class Active:
    """When something acts: from a time or condition until another. A condition counts once it has become true."""

    from_: float | None = key(Number("s"), "When it begins (default: at the start)", default=None, example=0.5)
    to: float | None = key(Number("s"), "When it ends (default: never)", default=None, example=1)
    after: str | None = key(Condition(), "Condition that starts it, in place of from", default=None,
                            example="abs(tip.y) > 0.1")
    until: str | None = key(Condition(), "Condition that ends it once it has begun, in place of to", default=None,
                            example="tip.vy < 0")

    def check(self) -> Iterator[Issue]:
        """Yield an issue if nothing is given, if times are out of order, or if a start or end is given twice."""
        if self.from_ is None and self.to is None and not self.waits:
            yield Issue((), "{}: nothing is given", "from or after, to or until")
        elif self.from_ is not None and self.to is not None:
            yield from reversed_range(self.from_, self.to)
        for given, other in (("after", "from"), ("until", "to")):
            if getattr(self, given) is not None and getattr(self, "from_" if other == "from" else other) is not None:
                yield Issue((given,), f"{{}}: {other} and {given} are both given", f"one of {other} and {given}")

    @property
    def waits(self) -> bool:
        """Whether it begins or ends at a condition."""
        return self.after is not None or self.until is not None

    @property
    def begins(self) -> bool:
        """Whether it is inactive at the start."""
        return self.from_ is not None or self.after is not None

    @property
    def times(self) -> tuple[float, float]:
        """Begin and end; -inf or inf if there is none, inf also for a begin or end at a condition."""
        begin = -math.inf if self.after is None else math.inf
        return begin if self.from_ is None else self.from_, math.inf if self.to is None else self.to

    def at(self, t: float) -> bool:
        """Return whether it is active at t, including its begin and excluding its end."""
        return _within(self.times, t)


# the lists of a case whose items may begin and end
SWITCHED = ("boundary_conditions", "joints", "springs", "loads")
ACTIVE, ACTIVE_DOC = Record(Active), "When it acts (dynamic; default: always)"


def _within(times: tuple[float, float], t: float) -> bool:
    """Return whether t is at or after the first time, and before the second."""
    return times[0] <= t < times[1]


class Latch:
    """The state of something that waits for conditions: active from ``begin`` to ``end``, inf until these are known."""

    def __init__(self, active: Active) -> None:
        self.active = active
        self.begin, self.end = active.times

    def at(self, t: float) -> bool:
        """Return whether it is active at t, as far as is known."""
        return _within(self.times, t)

    @property
    def times(self) -> tuple[float, float]:
        """Begin and end, as far as they are known."""
        return self.begin, self.end

    def waiting(self) -> str | None:
        """Return the key of the condition that it waits for, ``after`` or ``until``, or None."""
        if self.begin == math.inf:
            return "after"
        return "until" if self.end == math.inf and self.active.until is not None else None


@dataclass(frozen=True)
class Windowed(Function):
    """Another amplitude between two times, zero outside."""

    inner: Any
    begin: float
    end: float

    @property
    def knots(self) -> tuple[float, ...]:  # type: ignore[override]
        """The times at which it begins and ends."""
        return tuple(x for x in (self.begin, self.end) if math.isfinite(x))

    @property
    def parts(self) -> tuple[Function, ...]:  # type: ignore[override]
        """The other amplitude, as the only part."""
        return (self.inner,)

    @property
    def quantities(self) -> tuple[str, ...]:
        """The names of the quantities of a motion that the other amplitude depends on."""
        return tuple(self.inner.quantities)

    def emit(self, out: Assembler) -> None:
        """Append the instructions that put it on the stack."""
        out.tree(Comparison(Constant(self.begin), (("<=", Variable()), ("<", Constant(self.end)))))
        _emit_conditional(self.inner, out)


@dataclass(frozen=True)
class Gated(Function):
    """Another amplitude while a latch is active, else zero.

    Its program begins with a number, the gate: 1 while it is active, else 0.
    """

    inner: Any
    latch: Latch

    @property
    def ungated(self) -> Function:
        """The other amplitude."""
        return self.inner  # type: ignore[no-any-return]

    @property
    def quantities(self) -> tuple[str, ...]:
        """The names of the quantities of a motion that the other amplitude depends on."""
        return tuple(self.inner.quantities)

    def emit(self, out: Assembler) -> None:
        """Append the instructions that put it on the stack, with the gate open."""
        out.emit(jets.NUMBER, 1, 1.0)
        _emit_conditional(self.inner, out)

    def jet(self, t: float) -> tuple[float, float, float]:
        """Return the value and two derivatives at t, nan where they do not exist."""
        found: tuple[float, float, float] = self.inner.jet(t) if self.latch.at(t) else (0.0, 0.0, 0.0)
        return found

    def described(self) -> str:
        """Return the name of the other amplitude for messages."""
        return str(self.inner.described())


def _emit_conditional(inner: Any, out: Assembler) -> None:
    """Replace a condition on the stack by an amplitude with its scale if it holds, else by 0."""
    otherwise = out.emit(jets.BRANCH, -1)
    inner.emit(out)
    out.emit(jets.SCALE, 0, inner.scale, 0.0)
    done = out.emit(jets.JUMP, -1)
    out.set_targets([otherwise])
    out.emit(jets.NUMBER, 1, 0.0)
    out.set_targets([done])


def amplitude_of(load: Any, window: Active | Latch | None = None) -> Any:
    """Return the amplitude of a load, zero while it is inactive; None if it is always active and has none.

    ``window`` is its latch if it waits for conditions. Loads with ``switches`` are switched like springs.
    """
    active = getattr(load, "active", None)
    if active is None or getattr(load, "switches", False):
        return load.amplitude
    inner = load.amplitude or Always()
    return Gated(inner, window) if isinstance(window, Latch) else Windowed(inner, *active.times)
