"""Steps of statics that leave their branch: refused, but where bodies touch and snap."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...elements.shape import Array
from ...errors import ComputationError

if TYPE_CHECKING:
    from ...model.model import Model
    from ..system import System

# a step that moves against what the tangent at one of its ends foretells, or this much further, has left the branch,
# unless it moves less than this share of the model's extent
FURTHER = 8.0
FAINT = 1e-6
# what helps there
ADVICE = ("method: arc_length if this is a limit point; solver dynamic with damping, which follows what snaps; else "
          "more steps, or supports that leave no mechanism")


class JumpError(ComputationError):
    """A state to which the tangent at another one foretells no way."""


class Jumps:
    """What becomes of jumps in load steps.

    Where bodies touch, as at the end of a catch or the corner of an obstacle, there may be no equilibrium close by: the
    shortest of steps takes the one that was found. ``moved`` [m] is how far that was, 0 where nothing has jumped.
    """

    def __init__(self, model: Model) -> None:
        self.model, self.taken, self.moved = model, False, 0.0

    def check(self, system: System, start: Array, end: Array, foretold: Array, t: float) -> None:
        """Raise JumpError where the tangent at one state foretells (n_unknowns,) no way to the other, or take it."""
        where = self.model.numbering.where
        moved = system.distance(end, start)
        along = float((system.weights**2 * foretold) @ (end[where] - start[where]))
        if moved <= FAINT * self.model.extent or (along >= 0.0 and moved <= FURTHER * system.norm(foretold)):
            return
        if not self.taken:
            raise JumpError("the state jumps to another branch", at={"factor": float(f"{t:.6g}")}, advice=ADVICE)
        self.moved = max(self.moved, moved)

    def take(self, error: ComputationError) -> bool:
        """Take the next jump, where the shortest of steps failed by one and bodies touch; return whether."""
        may = isinstance(error, JumpError) and bool(self.model.contacts) and not self.taken
        self.taken = self.taken or may
        return may

    def told(self, t: float) -> list[str]:
        """Return what to say of a step that has jumped, empty for others; the next jump is refused again."""
        if self.moved == 0.0:
            return []
        when = f"t = {t:.6g}" if self.model.case.solver.timed else f"load factor {t:.6g}"
        found = (f"bodies in contact snap at {when}: they move by {self.moved:.2g} m at once, and no "
                 "equilibrium leads there. Solver dynamic with damping follows such a motion")
        self.taken, self.moved = False, 0.0
        return [found]
