"""Stored states and tables, read row by row or in blocks of rows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import h5py
import numpy as np

from ancf2d.results import safe
from ancf2d.results.records import unescape

BLOCK = 1 << 17  # numbers: a mebibyte, which caches hold and beside which the cost of a call is nothing


class StateRows:
    """A dataset with one row of numbers of the shape ``shape`` per stored state.

    It comes from ``safe.child`` and its rows are checked when the first one is read, once for all: an open file is a
    snapshot, which nobody writes to. Reading raises ValueError for rows of another size and for those that are missing.
    """

    def __init__(self, dataset: h5py.Dataset, shape: tuple[int, ...]) -> None:
        self._dataset, self._shape = dataset, shape
        self._width = math.prod(shape)

    def __len__(self) -> int:
        return len(self._dataset)

    @cached_property
    def _numbers(self) -> h5py.Dataset:
        """The dataset, known to hold rows that can be read."""
        dataset = self._dataset
        safe.check_numbers(dataset, 2)
        if dataset.dtype.kind != "f":
            raise ValueError(f"{dataset.name} has numbers of type {dataset.dtype}, not of floating point")
        if dataset.shape[1] != self._width:
            raise ValueError(f"{dataset.name} has shape {dataset.shape}, not {self._width} numbers in a row")
        if self._width * dataset.dtype.itemsize > safe.MAX_BYTES:
            raise ValueError(f"{dataset.name} is too large")
        return dataset

    def row(self, i: int) -> np.ndarray:
        """Return what was stored of state i, from 0."""
        numbers = self._numbers
        if not 0 <= i < len(numbers):
            raise ValueError(f"{numbers.name} has {len(numbers)} rows")
        return numbers[i].reshape(self._shape)

    def block(self, first: int, stop: int) -> np.ndarray:
        """Return what was stored of the states from ``first`` up to ``stop``, along a new first axis."""
        numbers = self._numbers
        if not 0 <= first <= stop <= len(numbers):
            raise ValueError(f"{numbers.name} has {len(numbers)} rows where {stop} were stored")
        if (stop - first) * self._width * numbers.dtype.itemsize > safe.MAX_BYTES:
            raise ValueError(f"{numbers.name} is too large")
        return numbers[first:stop].reshape(stop - first, *self._shape)

    def bounds(self, count: int) -> Iterator[tuple[int, int]]:
        """Yield where blocks of the first ``count`` states begin and end, which the size of a row alone decides."""
        step = max(1, BLOCK // max(1, self._width))
        for first in range(0, count, step):
            yield first, min(first + step, count)


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
