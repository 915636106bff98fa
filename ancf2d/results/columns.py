"""Groups of datasets of one value per row, read as a table."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np

from ancf2d.results import safe
from ancf2d.results.records import unescape


class Table(dict[str, Any]):
    """Columns by name: arrays of numbers or lists of strings, with ``attrs`` and ``units``."""

    def __init__(self) -> None:
        super().__init__()
        self.attrs: dict[str, Any] = {}
        self.units: dict[str, str] = {}

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self.values()), ()))


def read_columns(group: h5py.Group | None, rows: int | None) -> Table:
    """Return the first ``rows`` of every column of a group (None: all, and texts too); ValueError where one is shorter.

    A group that is not there has no columns.
    """
    table = Table()
    for key in group or ():
        dataset = safe.child(group, key, h5py.Dataset)
        name = unescape(key)
        if dataset.dtype.kind == "S" and rows is None:  # texts stand in tables alone
            table[name] = safe.texts(dataset)
        else:
            values = safe.values(dataset, 1)
            table[name] = values if rows is None else enough(values, rows)
        table.units[name] = str(safe.attribute(dataset, "units", ""))
    return table


def enough(values: np.ndarray, rows: int) -> np.ndarray:
    """Return the first ``rows`` of some values; ValueError where there are fewer."""
    if len(values) < rows:
        raise ValueError(f"{len(values)} rows where {rows} were stored")
    return values[:rows]
