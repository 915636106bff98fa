"""Controllers: what turns quantities of a motion into numbers that loads follow, with states of their own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..binder import Binder, Issue, Path, dotted
from ..declare import key, record
from ..kinds import MapOf, Number, Vector
from ..nodes import MapNode, Node
from ..records import OneOf
from ..syntax import IDENTIFIER, WORDS
from .amplitudes import ExpressionText


class Identifiers(MapOf):
    """Values by names that expressions can use."""

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
    input: str = key(ExpressionText(feedback=True), "What is to become zero, e", example="1 - arm.theta")
    kp: float = key(Number(), "Gain", default=0.0)
    ki: float = key(Number(), "Gain of the integral [1/s]", default=0.0)
    kd: float = key(Number(), "Gain of the rate [s]", default=0.0)
    filter: float = key(Number("s", ge=0), "Time constant of a filter on the rate, which starts at the input",
                        default=0.0)
    limit: tuple[float, float] | None = key(
        Vector(Number(), "lowest, highest"), "Bounds of the output; the integration stops there", default=None,
        example=[-5, 5])
    sample: float | None = key(Number("s", gt=0), "Interval at which it acts, its output being held in between: the "
                               "integral is a sum and the rate a difference (default: it acts all the time)",
                               default=None)

    def check(self) -> Iterator[Issue]:
        """Yield bounds that are no interval, or a controller without any gain."""
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
        """Yield initial values of what is no state."""
        for name in self.initial:
            if name not in self.rate:
                yield Issue(("initial", name), f"{{}}.initial: there is no state '{name}'", ", ".join(self.rate))


Controller = Pid | StateController


class ControllerKind(OneOf):
    """A controller, whose expressions may use its states."""

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        rates = node.entries.get("rate") if isinstance(node, MapNode) else None
        binder.states = tuple(rates.node.entries) if rates is not None and isinstance(rates.node, MapNode) else ()
        found = super().bind(node, path, binder)
        binder.states = ()
        return found
