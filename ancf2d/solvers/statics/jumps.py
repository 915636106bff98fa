"""Load steps that leave their branch: refused, except where bodies in contact snap."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...elements.shape import Array
from ...errors import ComputationError

if TYPE_CHECKING:
    from ...model.model import Model
    from ..system import System

# a step has left the branch if it moves against the tangent prediction at one of its ends, or this many times as far,
# unless it moves less than this share of the model's extent
FURTHER = 8.0
FAINT = 1e-6
# advice for a jump
ADVICE = ("method: arc_length if this is a limit point; solver dynamic with damping, which follows what snaps; else "
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

    def check(self, system: System, start: Array, end: Array, foretold: Array, t: float) -> None:
        """Raise JumpError if ``end`` contradicts ``foretold`` (n_unknowns,), unless jumps are accepted."""
        where = self.model.numbering.where
        moved = system.distance(end, start)
        along = float((system.weights**2 * foretold) @ (end[where] - start[where]))
        if moved <= FAINT * self.model.extent or (along >= 0.0 and moved <= FURTHER * system.norm(foretold)):
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
