"""When loads, springs, supports and joints act: between times, or until conditions hold."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from .. import jets
from ..binder import INVALID, Binder, Issue, Path, dotted
from ..declare import key, record
from ..kinds import Number
from ..nodes import Node
from ..programs import Assembler, Function
from ..records import Record
from ..syntax import Comparison, Constant, Time, compares, syntax
from .amplitudes import Constant as Always
from .amplitudes import ExpressionText


class Condition(ExpressionText):
    """An expression that is true or not: one that compares."""

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
    """When something acts: from a time or a condition on, until another. Conditions count once they have held."""

    from_: float | None = key(Number("s"), "When it begins (default: at the start)", default=None, example=0.5)
    to: float | None = key(Number("s"), "When it ends (default: never)", default=None, example=1)
    after: str | None = key(Condition(), "Condition that starts it, in place of from", default=None,
                            example="abs(tip.y) > 0.1")
    until: str | None = key(Condition(), "Condition that ends it once it has begun, in place of to", default=None,
                            example="tip.vy < 0")

    def check(self) -> Iterator[Issue]:
        """Yield a time that is none."""
        if self.from_ is None and self.to is None and not self.waits:
            yield Issue((), "{}: nothing is given", "from or after, to or until")
        elif self.from_ is not None and self.to is not None and not self.from_ < self.to:
            yield Issue(("to",), f"{{}}: from must be less than to, got from {self.from_:g} to {self.to:g}")
        for given, other in (("after", "from"), ("until", "to")):
            if getattr(self, given) is not None and getattr(self, "from_" if other == "from" else other) is not None:
                yield Issue((given,), f"{{}}: {other} and {given} are both given", f"one of {other} and {given}")

    @property
    def waits(self) -> bool:
        """Whether conditions tell when it begins or ends."""
        return self.after is not None or self.until is not None

    @property
    def begins(self) -> bool:
        """Whether it does not act from the start."""
        return self.from_ is not None or self.after is not None

    @property
    def times(self) -> tuple[float, float]:
        """Where it begins and ends, infinite where it does not, or where that is not known beforehand."""
        begin = -math.inf if self.after is None else math.inf
        return begin if self.from_ is None else self.from_, math.inf if self.to is None else self.to

    def at(self, t: float) -> bool:
        """Whether it acts at t: where it begins it does, where it ends not any more."""
        return _within(self.times, t)


# what a case has that may begin and end
SWITCHED = ("boundary_conditions", "joints", "springs", "loads")
ACTIVE, ACTIVE_DOC = Record(Active), "When it acts (dynamic; default: always)"


def _within(times: tuple[float, float], t: float) -> bool:
    """Whether t is at the first time or behind it, and before the second."""
    return times[0] <= t < times[1]


class Latch:
    """When something acts that waits for conditions: from ``begin`` until ``end``, infinite as long as these wait."""

    def __init__(self, active: Active) -> None:
        self.active = active
        self.begin, self.end = active.times

    def at(self, t: float) -> bool:
        """Whether it acts at t, as far as that is known."""
        return _within(self.times, t)

    @property
    def times(self) -> tuple[float, float]:
        """Where it begins and ends, as far as that is known."""
        return self.begin, self.end

    def waiting(self) -> str | None:
        """Return the condition that it waits for, ``after`` or ``until``."""
        if self.begin == math.inf:
            return "after"
        return "until" if self.end == math.inf and self.active.until is not None else None


@dataclass(frozen=True)
class Windowed(Function):
    """Another amplitude from a time on until another, zero outside."""

    inner: Any
    begin: float
    end: float

    @property
    def knots(self) -> tuple[float, ...]:  # type: ignore[override]
        """The times at which it begins and ends."""
        return tuple(x for x in (self.begin, self.end) if math.isfinite(x))

    @property
    def parts(self) -> tuple[Function, ...]:  # type: ignore[override]
        """The other amplitude."""
        return (self.inner,)

    @property
    def quantities(self) -> tuple[str, ...]:
        """What a motion has to tell for the other amplitude to have a value."""
        return tuple(self.inner.quantities)

    def emit(self, out: Assembler) -> None:
        """Put it on the stack."""
        out.tree(Comparison(Constant(self.begin), (("<=", Time()), ("<", Constant(self.end)))))
        _put_where(self.inner, out)


@dataclass(frozen=True)
class Gated(Function):
    """Another amplitude while a latch lets it act, zero outside.

    Its program begins with a number, the gate: 1 where it acts, 0 where not.
    """

    inner: Any
    latch: Latch

    @property
    def ungated(self) -> Function:
        """The other amplitude."""
        return self.inner  # type: ignore[no-any-return]

    @property
    def quantities(self) -> tuple[str, ...]:
        """What a motion has to tell for the other amplitude to have a value."""
        return tuple(self.inner.quantities)

    def emit(self, out: Assembler) -> None:
        """Put it on the stack, the gate open."""
        out.emit(jets.NUMBER, 1, 1.0)
        _put_where(self.inner, out)

    def jet(self, t: float) -> tuple[float, float, float]:
        """Return the value at t and two derivatives, nan where there is none."""
        found: tuple[float, float, float] = self.inner.jet(t) if self.latch.at(t) else (0.0, 0.0, 0.0)
        return found

    def described(self) -> str:
        """Return what messages call it."""
        return str(self.inner.described())


def _put_where(inner: Any, out: Assembler) -> None:
    """Put an amplitude with its scale in the place of a condition on the stack, 0 where that does not hold."""
    otherwise = out.emit(jets.BRANCH, -1)
    inner.emit(out)
    out.emit(jets.SCALE, 0, inner.scale, 0.0)
    done = out.emit(jets.JUMP, -1)
    out.land([otherwise])
    out.emit(jets.NUMBER, 1, 0.0)
    out.land([done])


def amplitude_of(load: Any, window: Active | Latch | None = None) -> Any:
    """Return the amplitude that a load follows, zero while it does not act; None where it always acts and has none.

    ``window`` tells when it acts where the load alone does not. What ``switches`` begins and ends as springs do.
    """
    active = getattr(load, "active", None)
    if active is None or getattr(load, "switches", False):
        return load.amplitude
    inner = load.amplitude or Always()
    return Gated(inner, window) if isinstance(window, Latch) else Windowed(inner, *active.times)
