"""What every solver yields."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..elements.shape import Array


@dataclass
class State:
    """A state that a solver yields: full coordinates ``d`` at load factor or time ``t``, with how it was found.

    ``Q`` are the elastic and patch forces, ``F`` the dead loads, in full coordinates.
    """

    t: float
    d: Array
    Q: Array
    F: Array
    energy: float
    linear: bool = False
    history: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
