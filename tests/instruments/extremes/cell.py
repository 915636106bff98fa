"""A cell of the map: one scene at one extreme, its measured error compared with a reference, and the verdict."""

from __future__ import annotations

import math
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType

import ancf2d

# what a warning must speak of to announce a wrong number; other warnings excuse nothing
TELLS = ("too stiff", "round-off", "critical point", "unstable", "is inverted", "soften the clamp", "to the mesh",
         "positive load factors", "curves the reference", "cannot contract", "transverse load", "error of the steps",
         "steps are too")
VERDICTS = ("holds", "degrades", "refused", "slow", "wrong")


@dataclass
class Found:
    """Result of a scene: an error compared with its reference, warnings, and a note."""

    error: float
    warnings: list[str] = field(default_factory=list)
    note: str = ""


@dataclass(frozen=True)
class Cell:
    """One scene of the map.

    ``axis`` and ``value`` are its place, ``subject`` the element, formulation or method, ``measure`` what is compared
    with what; an ``error`` up to ``limit`` is what mesh and model explain.
    """

    axis: str
    value: str
    subject: str
    measure: str
    limit: float
    compute: Callable[[], Found]
    seconds: float = 60.0
    quick: bool = False

    @property
    def key(self) -> str:
        """Identification among all cells."""
        return " | ".join((self.axis, self.measure, self.value, self.subject))


@dataclass
class Verdict:
    """The outcome of a cell."""

    key: str
    axis: str
    value: str
    subject: str
    measure: str
    limit: float
    verdict: str
    error: float | None
    message: str
    seconds: float


class TooLongError(BaseException):
    """A cell has used up its time; not an ``Exception``, so that no code in between handles it."""


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise TooLongError in the block after so many seconds of processor time."""
    def stop(number: int, frame: FrameType | None) -> None:
        raise TooLongError

    old = signal.signal(signal.SIGPROF, stop)
    # the processor's time: others on the machine make no cell slow; again and again, should a callback swallow it
    signal.setitimer(signal.ITIMER_PROF, seconds, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, old)


def judge(error: float, limit: float, warnings: list[str]) -> tuple[str, str]:
    """Return verdict and message of a scene that was solved."""
    if math.isfinite(error) and error <= limit:
        return "holds", ""
    told = [w for w in warnings if any(word in w for word in TELLS)]
    return ("degrades", told[0]) if told else ("wrong", "; ".join(warnings))


def run(cell: Cell) -> Verdict:
    """Compute a cell and judge it; any exception other than ancf2d's own errors is wrong."""
    began, error = time.perf_counter(), None
    try:
        with _limited(cell.seconds):
            found = cell.compute()
        error = float(found.error)
        verdict, message = judge(error, cell.limit, found.warnings)
        message = found.note if verdict == "holds" else message
    except (ancf2d.CaseError, ancf2d.ComputationError, ancf2d.ResultsError) as refusal:
        verdict, message = "refused", _said(refusal)
    except TooLongError:
        verdict, message = "slow", f"no answer within {cell.seconds:g} s"
    except Exception:
        verdict, message = "wrong", traceback.format_exc(limit=-3)
    return Verdict(cell.key, cell.axis, cell.value, cell.subject, cell.measure, cell.limit, verdict,
                   error if error is not None and math.isfinite(error) else None, message,
                   time.perf_counter() - began)


def _said(error: Exception) -> str:
    """Return the first sentence of a refusal, with its advice."""
    if isinstance(error, ancf2d.CaseError):
        return error.problems[0].message
    failure = getattr(error, "failure", None)
    return str(error) if failure is None else failure.reason
