"""What a prescribed motion must be so that bodies can follow it: it starts where they are, and does not jump."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ..errors import ComputationError
from .breakpoints import jumps
from .constraints import Equations
from .signals import Signal
from .timing import Course

_KEYS = {"x": "x", "y": "y", "ux": "ux", "uy": "uy", "rotation": "angle"}
_WORDS = {"x": "prescribed x", "y": "prescribed y", "ux": "prescribed displacement ux",
          "uy": "prescribed displacement uy", "angle": "prescribed angle"}


@dataclass(frozen=True)
class Motion:
    """One prescribed motion: how far a position or angle is from the reference; ``key`` is its entry in the case."""

    owner: str
    key: str
    course: Course

    @property
    def name(self) -> str:
        """Support and motion, in words."""
        return f"{self.owner}: the {_WORDS[self.key]}"

    def start_problem(self, extent: float) -> tuple[str, str] | None:
        """Return message and what is expected of a motion that would tear its body at the first step."""
        try:
            away = self.course(0.0)
        except ComputationError as error:
            return f"{self.name} has no value at t = 0: {error}", "an amplitude that is defined at t = 0"
        if abs(away) <= 1e-9 * (1.0 if self.key == "angle" else extent):
            return None
        if self.key in "xy":
            return (f"{self.name} starts {away:.6g} away from the point's reference position",
                    f"a position that starts at the point, or u{self.key} for a displacement")
        return f"{self.name} starts at {away:.6g}", "0 at t = 0"

    def jump_problem(self, t_end: float) -> tuple[str, str] | None:
        """Return message and what is expected of a motion that would ask for an infinite velocity."""
        found = jumps(self.course, 0.0, t_end) if isinstance(self.course, Signal) else []
        if not found:
            return None
        more = ("", " and once more")[len(found) - 1] if len(found) < 3 else f" and {len(found) - 1} times more"
        return f"{self.name} jumps at t = {found[0]:.6g}{more}", "a continuous motion, for instance a smooth table"


def motions(equations: Equations) -> Iterator[Motion]:
    """Yield the prescribed motions among the equations of supports."""
    items: list[Any] = [*equations.rows, *equations.constraints]
    for item in items:
        course = getattr(item, "signal", None)
        if course is not None and item.holds in _KEYS:
            yield Motion(item.owner, _KEYS[item.holds], course)
