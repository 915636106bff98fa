"""The rows of the map, in the order of the page."""

from __future__ import annotations

from collections.abc import Iterator

from . import across, modes, motions, scaling, statics, traps
from .cell import Cell

ROOMS = (scaling, statics, across, modes, motions, traps)


def all_rows() -> Iterator[Cell]:
    """Yield every cell."""
    for room in ROOMS:
        yield from room.rows()
