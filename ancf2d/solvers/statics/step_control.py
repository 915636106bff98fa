"""Step control of load steps: step sizes, extrapolation from the last equilibria, steps that leave their branch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...elements.shape import Array
from ...errors import ComputationError
from ..long_vectors import chunks

if TYPE_CHECKING:
    from ...model.model import Model
    from ..system import System

# shares of the way: smallest step relative to the way so far, and smallest first step
SMALLEST_STEP = 2.0**-16
SMALLEST_FIRST = 2.0**-50
# additional factor on a step cut at a singular tangent, so that later steps do not hit it again
ASIDE = 0.99
# tries within one full step, or while s doubles, before the path is given up
MOST_TRIES = 60
# a parabola through states extrapolates up to this many last steps, a line up to its square
FARTHEST = 4.0
# easy steps in a row before a cut step grows again
PATIENCE = 2
# an unstable state is bracketed to this share of the way before it is accepted as a loss of stability
CORNERED = 1e-4


@dataclass
class Path:
    """The equilibrium path so far, for extrapolation."""

    t: list[float]
    d: list[Array]

    def extrapolate(self, t: float) -> Array:
        """Return the polynomial through the last states (at most quadratic) at t, of lower order for a long step."""
        k = len(self.t)
        ratio = (t - self.t[-1]) / (self.t[-1] - self.t[-2]) if k > 1 else 0.0
        k = min(k, 3 if ratio <= FARTHEST else 2 if ratio <= FARTHEST**2 else 1)
        ts, ds = self.t[-k:], self.d[-k:]
        weights = [math.prod((t - b) / (a - b) for b in ts if b != a) for a in ts]
        out = weights[0] * ds[0]
        for part in chunks(len(out)):
            for weight, d in zip(weights[1:], ds[1:], strict=True):
                out[part] += weight * d[part]
        return out

    def push(self, t: float, d: Array) -> None:
        self.t, self.d = [*self.t[-2:], t], [*self.d[-2:], d]


class StepSizes:
    """Step sizes on a way s from 0 to 1: failed steps are cut, and grow again after easy ones.

    A step ends at each of ``stops``.
    """

    def __init__(self, longest: float, stops: Sequence[float]) -> None:
        self.longest = self.h = longest
        self.stops = stops
        self.s, self.cutbacks, self.easy = 0.0, 0, PATIENCE
        self.mark, self.tries = 0.0, 0
        # the largest step that led to an unstable state, restored once that state is accepted
        self.resume = 0.0

    def target(self) -> float:
        """Return the next s to try."""
        self.tries += 1
        farthest = self.s + self.h * (1 + 1e-9)
        ahead = min((s for s in (*self.stops, 1.0) if s > self.s * (1 + 1e-12)), default=1.0)
        return ahead if farthest >= ahead else self.s + self.h

    def _cut(self, target: float) -> None:
        # the load that a first step can bear is unknown: it is cut more each time
        self.h = (target - self.s) * 0.5 ** (1 if self.s > 0.0 else self.cutbacks + 1)
        self.cutbacks, self.easy = self.cutbacks + 1, 0

    def cut(self, target: float, aside: bool = False) -> bool:
        """Shorten the step after a failure; return whether to try again.

        ``aside``: the tangent at the target is singular; choose steps whose multiples do not hit it.
        """
        self._cut(target)
        self.h *= ASIDE if aside else 1.0
        smallest = SMALLEST_STEP * min(self.longest, self.s) if self.s > 0.0 else SMALLEST_FIRST
        return self.h >= smallest and self.tries <= MOST_TRIES

    def corner(self, target: float) -> bool:
        """Shorten the step towards an unstable state; return False if it is already bracketed."""
        nearest = CORNERED * self.s if self.s > 0.0 else SMALLEST_FIRST
        self.resume = max(self.resume, self.h)
        if target - self.s <= nearest * (1 + 1e-9) or self.tries > MOST_TRIES:
            self.h = self.resume
            return False
        self._cut(target)
        return True

    def accept(self, target: float) -> None:
        """Continue from a state that was found."""
        self.s, self.cutbacks, self.easy = target, 0, self.easy + 1
        if self.easy >= PATIENCE:
            self.h = min(self.longest, 2 * self.h)
        if target >= min(self.mark + self.longest * (1 - 1e-9), 2 * self.mark):
            self.mark, self.tries = target, 0


# a step has left the branch if it moves against the tangent prediction at one of its ends, or this many times as far,
# unless it moves less than this share of the model's extent
FURTHER = 8.0
FAINT = 1e-6
# advice for a jump
ADVICE = ("method: arc_length if this is a limit point; solver dynamic with damping, which follows the snap; else "
          "more steps, or supports that leave no mechanism")


class JumpError(ComputationError):
    """A state that contradicts the tangent prediction from another one."""


class Jumps:
    """The handling of jumps in load steps.

    Where bodies touch, as at the end of a catch or the corner of an obstacle, there may be no equilibrium close by: the
    shortest step then accepts the one that was found. ``moved`` [m] is the distance of the jump, 0 if there was none.
    """

    def __init__(self, model: Model) -> None:
        self.model, self.accepting, self.moved = model, False, 0.0

    def check(self, system: System, start: Array, end: Array, predicted: Array, t: float) -> None:
        """Raise JumpError if ``end`` contradicts ``predicted`` (n_unknowns,), unless jumps are accepted."""
        where = self.model.numbering.where
        moved = system.distance(end, start)
        along = float((system.weights**2 * predicted) @ (end[where] - start[where]))
        if moved <= FAINT * self.model.extent or (along >= 0.0 and moved <= FURTHER * system.norm(predicted)):
            return
        if not self.accepting:
            raise JumpError("the state jumps to another branch", at={"factor": float(f"{t:.6g}")}, advice=ADVICE)
        self.moved = max(self.moved, moved)

    def accept(self, error: ComputationError) -> bool:
        """Accept the next jump if the shortest step failed by a jump and bodies touch; return whether it is so."""
        may = isinstance(error, JumpError) and bool(self.model.contacts) and not self.accepting
        self.accepting = self.accepting or may
        return may

    def warning(self, t: float) -> list[str]:
        """Return the warning for a step that has jumped, else an empty list; refuse jumps again."""
        if self.moved == 0.0:
            return []
        when = f"t = {t:.6g}" if self.model.case.solver.timed else f"load factor {t:.6g}"
        found = (f"bodies in contact snap at {when}: they move by {self.moved:.2g} m at once, and no "
                 "equilibrium leads there. Solver dynamic with damping follows such a motion")
        self.accepting, self.moved = False, 0.0
        return [found]
