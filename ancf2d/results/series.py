"""Datasets of stored states: written row by row, read by rows or blocks, chunked only if they must grow."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5p, h5s, h5t

from ancf2d.results import safe
from ancf2d.results.records import unescape

CHUNK_BYTES = 1 << 20
COLUMN_CHUNK = 128  # numbers, for columns that grow slowly
LARGEST_COLUMN_CHUNK = 1 << 14
STATE_CHUNK_BYTES = 8192
MAX_ATTRIBUTE = 8000  # HDF5 holds at most 64 kB of attributes per object
# Mesh arrays are mostly regular integers: gzip-1 with shuffle makes them 20 to 40 times smaller at 400 MB/s. States are
# not compressed: this would save a quarter, at 70 MB/s instead of 1500 MB/s.
COMPRESS_FROM = 1 << 16
_TEXT, _ONE = h5t.py_create(h5py.string_dtype(), logical=True), h5s.create(h5s.SCALAR)


def describe(dataset: h5py.Dataset, units: str, description: str) -> h5py.Dataset:
    """Set the two attributes that every dataset has."""
    set_text(dataset, "units", units)
    set_text(dataset, "description", description)
    return dataset


def text_type(texts: Sequence[str]) -> np.dtype:
    """Return the type of texts of one fixed length in bytes, that of the longest."""
    longest = max((len(t.encode("utf-8", "replace")) for t in texts), default=1)
    return h5py.string_dtype("utf-8", max(1, longest))


def set_text(node: h5py.Group | h5py.Dataset, name: str, text: str) -> None:
    """Set a text attribute, cut to the space in the header of an object."""
    key = name.encode()
    if h5a.exists(node.id, key):
        h5a.delete(node.id, key)
    _write_text(node.id, key, text)


def _write_text(node: Any, key: bytes, text: str) -> None:
    """Write a new text attribute, in a fraction of the time that h5py takes."""
    h5a.create(node, key, _TEXT, _ONE).write(np.array(_clean(text), h5py.string_dtype()))


def _clean(text: str) -> str:
    return text.replace("\0", "")[:MAX_ATTRIBUTE].encode("utf-8", "replace").decode()


def write_texts(group: h5py.Group, name: str, texts: str | Sequence[str], units: str,
                description: str) -> h5py.Dataset:
    """Write one text or a list of texts."""
    listed = [texts] if isinstance(texts, str) else list(texts)
    data = [t.replace("\0", "").encode("utf-8", "replace") for t in listed]
    kind = text_type(listed)
    array = np.array(data, dtype=kind)
    return describe(group.create_dataset(name, data=array[0] if isinstance(texts, str) else array,
                                         dtype=kind), units, description)


def write_fixed(group: h5py.Group, name: str, data: Any, units: str, description: str,
                compress: bool = False) -> h5py.Dataset:
    """Write an array that does not grow."""
    options: dict[str, Any] = {}
    data = np.asarray(data)
    if compress and data.ndim and data.nbytes >= COMPRESS_FROM:
        row = max(1, data.nbytes // len(data))
        rows = min(len(data), max(1, CHUNK_BYTES // row))
        options = {"chunks": (rows, *data.shape[1:]), "compression": "gzip",
                   "compression_opts": 1, "shuffle": True}
    return describe(group.create_dataset(name, data=data, **options), units, description)


def _write_column(group: h5py.Group, name: str, rows: np.ndarray, chunk: tuple[int, ...] | None,
                  units: str, description: str) -> None:
    """Write a dataset like ``write_fixed`` in half the time, as there may be 100 000; with ``chunk`` it can grow."""
    layout = h5p.create(h5p.DATASET_CREATE)
    layout.set_obj_track_times(False)
    if chunk is not None:
        layout.set_chunk(chunk)
    space = h5s.create_simple(rows.shape, rows.shape if chunk is None else (h5s.UNLIMITED, *rows.shape[1:]))
    dataset = h5d.create(group.id, name.encode(), h5t.py_create(rows.dtype), space, layout)
    dataset.write(h5s.ALL, h5s.ALL, np.ascontiguousarray(rows))
    for label, text in (("units", units), ("description", description)):
        _write_text(dataset, label.encode(), text)


class Series:
    """One growing dataset of rows of ``width`` numbers (width 0: plain numbers).

    Rows stay in memory until ``spill``; a run that ends before its first spill writes a dataset of exactly its size.
    Missing rows (``pad_to``) are NaN, or 0 for counts. Chunks are never compressed, so that a row on disk is not moved
    by later rows.
    """

    def __init__(self, group: h5py.Group, name: str, units: str, description: str,
                 width: int = 0, integer: bool = False) -> None:
        self._group, self._name = group, name
        self._labels = (units, description)
        self._width = width
        self._dtype = np.dtype(np.int64 if integer else np.float64)
        self._rows: list[Any] = []
        self._stored = 0
        self._grows = False  # whether there is a dataset that can grow

    def __len__(self) -> int:
        return self._stored + len(self._rows)

    @property
    def buffered_bytes(self) -> int:
        """The number of bytes that ``spill`` would write."""
        return len(self._rows) * max(1, self._width) * self._dtype.itemsize

    def append(self, row: float | np.ndarray) -> None:
        """Add one row; an array is copied."""
        self._rows.append(np.array(row, dtype=self._dtype) if self._width else row)

    def extend(self, values: np.ndarray) -> None:
        """Add many plain numbers at once."""
        self._rows.extend(np.asarray(values, self._dtype).tolist())

    def write_through(self, row: np.ndarray) -> None:
        """Write one large row to disk now, without a copy of it."""
        self.spill()
        self._put(np.asarray(row, self._dtype)[np.newaxis])

    def pad_to(self, length: int) -> None:
        """Add missing values up to ``length`` rows."""
        missing = 0 if self._dtype.kind == "i" else np.nan
        while len(self) < length:
            self.append(np.full(self._width, missing) if self._width else missing)

    def _buffered(self) -> np.ndarray:
        shape = (len(self._rows), self._width) if self._width else (len(self._rows),)
        return np.asarray(self._rows, self._dtype).reshape(shape)

    def _chunk(self, rows: int) -> tuple[int, ...]:
        if not self._width:
            return (min(max(COLUMN_CHUNK, rows), LARGEST_COLUMN_CHUNK),)
        row_bytes = self._width * self._dtype.itemsize
        return (max(1, STATE_CHUNK_BYTES // row_bytes), min(self._width, CHUNK_BYTES // self._dtype.itemsize))

    def _put(self, rows: np.ndarray) -> None:
        """Write rows after those on disk.

        The dataset is closed again: HDF5 needs 30 to 90 kB for each open one, and there may be 100 000 of them.
        """
        if not self._grows:
            _write_column(self._group, self._name, rows, self._chunk(len(rows)), *self._labels)
            self._grows = True
        elif len(rows):
            self._append(rows)
        self._stored += len(rows)

    def _append(self, rows: np.ndarray) -> None:
        dataset = h5d.open(self._group.id, self._name.encode())
        dataset.set_extent((self._stored + len(rows), *rows.shape[1:]))
        behind = dataset.get_space()
        behind.select_hyperslab((self._stored,) + (0,) * (rows.ndim - 1), rows.shape)
        dataset.write(h5s.create_simple(rows.shape), behind, np.ascontiguousarray(rows))

    def spill(self) -> None:
        """Write the buffered rows to the growing dataset."""
        self._put(self._buffered())
        self._rows = []

    def reopen(self, rows: int) -> None:
        """Continue after the first ``rows`` rows of a dataset that an earlier run left."""
        dataset = self._group[self._name]
        if dataset.maxshape[0] is None:
            dataset.resize(rows, axis=0)
            self._grows, self._stored = True, rows
        else:  # written at its exact size when that run ended
            self._rows = list(dataset[:rows])
            del self._group[self._name]

    def close(self) -> None:
        """Write the remaining rows; a dataset that never spilled gets its exact size."""
        if self._grows:
            self.spill()
            return
        _write_column(self._group, self._name, self._buffered(), None, *self._labels)
        self._rows = []


BLOCK = 1 << 17  # numbers, one mebibyte: fits into caches, and makes the cost of a call negligible


class StateRows:
    """A dataset with one row of numbers of the shape ``shape`` per stored state.

    It comes from ``safe.child``. Its rows are checked only when the first one is read, since an open file is a snapshot
    that nobody writes to. Reading raises ValueError for rows of another size and for missing rows.
    """

    def __init__(self, dataset: h5py.Dataset, shape: tuple[int, ...]) -> None:
        self._dataset, self._shape = dataset, shape
        self._width = math.prod(shape)

    def __len__(self) -> int:
        return len(self._dataset)

    @cached_property
    def _numbers(self) -> h5py.Dataset:
        """The dataset, after checking that it has readable rows."""
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
        """Return the stored values of state i, counted from 0."""
        numbers = self._numbers
        if not 0 <= i < len(numbers):
            raise ValueError(f"{numbers.name} has {len(numbers)} rows")
        return numbers[i].reshape(self._shape)

    def block(self, first: int, stop: int) -> np.ndarray:
        """Return the stored values of the states from ``first`` up to ``stop``, along a new first axis."""
        numbers = self._numbers
        if not 0 <= first <= stop <= len(numbers):
            raise ValueError(f"{numbers.name} has {len(numbers)} rows where {stop} were stored")
        if (stop - first) * self._width * numbers.dtype.itemsize > safe.MAX_BYTES:
            raise ValueError(f"{numbers.name} is too large")
        return numbers[first:stop].reshape(stop - first, *self._shape)

    def bounds(self, count: int) -> Iterator[tuple[int, int]]:
        """Yield begin and end of blocks of the first ``count`` states; they depend on the size of a row only."""
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
    """Return the first ``rows`` of every column of a group, or with None all rows and also texts.

    A missing group has no columns. Raises ValueError if a column is shorter.
    """
    table = Table()
    for key in group or ():
        dataset = safe.child(group, key, h5py.Dataset)
        name = unescape(key)
        if dataset.dtype.kind == "S" and rows is None:  # only tables have texts
            table[name] = safe.texts(dataset)
        else:
            values = safe.values(dataset, 1)
            table[name] = values if rows is None else first_rows(values, rows)
        table.units[name] = str(safe.attribute(dataset, "units", ""))
    return table


def read_tables(groups: Mapping[str, h5py.Group]) -> dict[str, Table]:
    """Return tables by name. Raises ValueError if columns of a table have different lengths."""
    tables = {}
    for name, group in groups.items():
        tables[name] = read_columns(group, None)
        tables[name].attrs = safe.attributes(group)
        if len({len(v) for v in tables[name].values()}) > 1:
            raise ValueError(f"table '{name}' has columns of different lengths")
    return tables


def first_rows(values: np.ndarray, rows: int) -> np.ndarray:
    """Return the first ``rows`` of some values. Raises ValueError if there are fewer."""
    if len(values) < rows:
        raise ValueError(f"{len(values)} rows where {rows} were stored")
    return values[:rows]
