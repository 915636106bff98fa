"""Reads HDF5 files from untrusted sources: objects are checked before their data are read."""

from __future__ import annotations

import json
import mmap
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5a

from ancf2d.errors import ResultsError
from ancf2d.results.journal import is_journaled, open_hdf5, stable_copy
from ancf2d.results.records import FORMAT, FORMAT_VERSION, unescape

SIGNATURE = b"\x89HDF\r\n\x1a\n"
MAX_BYTES = 4 << 30  # limit of one read: 8 million coordinates of a state take 64 MB
MAX_TEXT = 64 << 20
MAX_CHUNK = 64 << 20
LARGEST_NUMBER = 8  # bytes: longer numbers cannot become Python numbers
DEFLATE_RATIO = 1032  # maximum compression of gzip: larger ratios of declared to stored bytes are false


@contextmanager
def damage(path: Path) -> Iterator[None]:
    """Turn any exception of HDF5 on damaged data into a ResultsError that names the file."""
    try:
        yield
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, OverflowError,
            RecursionError) as error:
        raise ResultsError(f"'{path}' is damaged and cannot be read ({error}); run its case again, "
                           f"or look for '{path.name}.part'") from error


def open_file(path: Path) -> h5py.File:
    """Open a result file read-only. Raises ResultsError, with the reason, if it is none."""
    if not path.exists():
        part = path.with_name(path.name + ".part")
        more = f"; there is an unfinished '{part}'" if part.exists() else ""
        raise ResultsError(f"there is no result file '{path}'{more}")
    if not path.is_file():
        raise ResultsError(f"'{path}' is not a file, so it holds no results")
    try:
        with path.open("rb") as stream:
            head = stream.read(len(SIGNATURE))
    except OSError as error:
        raise ResultsError(f"cannot read '{path}': {error.strerror}") from error
    if head != SIGNATURE:
        what = "is empty" if not head else "is not an HDF5 file"
        raise ResultsError(f"'{path}' {what}, so it is not an ancf2d result; 'ancf2d run CASE' writes one")
    file = _opened(path)
    try:
        _check_format(path, file)
    except ResultsError:
        file.close()
        raise
    return file


def _opened(path: Path) -> h5py.File:
    try:
        with stable_copy(path) as source:
            if not is_journaled(source) and endless_heap(source) is not None:
                raise ResultsError(f"'{path}' is damaged; run its case again or copy it again")
            return open_hdf5(source)
    except (OSError, RuntimeError) as error:
        cut = "truncated" in str(error)
        what = "is truncated: it was not copied or written completely" if cut else "is damaged"
        raise ResultsError(f"'{path}' {what}; run its case again or copy it again") from error


def _check_format(path: Path, file: h5py.File) -> None:
    with damage(path):
        found = attribute(file, "format")
        version = attribute(file, "format_version")
    if found != FORMAT:
        raise ResultsError(f"'{path}' is an HDF5 file but not an ancf2d result; 'ancf2d run CASE' writes one")
    if not isinstance(version, int) or version < 1:
        raise ResultsError(f"'{path}' is damaged: its format_version is {version!r}")
    if version > FORMAT_VERSION:
        raise ResultsError(f"'{path}' has results format {version}, newer than the "
                           f"{FORMAT_VERSION} that this ancf2d reads; install a newer ancf2d")


def attribute(node: h5py.Group | h5py.Dataset, name: str, default: Any = None) -> Any:
    """Return an attribute as a plain number, string or list; ``default`` if it is missing or of another type."""
    key = name.encode("utf-8", "surrogateescape")
    if not h5a.exists(node.id, key):
        return default
    # h5py would open it twice, for its type and for its value
    found = h5a.open(node.id, key)
    kind = found.dtype
    if kind.kind not in "biufS" and h5py.check_string_dtype(kind) is None:
        return default
    if kind.kind == "f" and kind.itemsize > LARGEST_NUMBER:
        return default
    if found.shape == ():
        one = np.empty((), kind)
        found.read(one)
        value = one[()]
    else:
        value = node.attrs[name]
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    return value


def attributes(node: h5py.Group) -> dict[str, Any]:
    """Return all attributes by name, except names that are not UTF-8, which ancf2d does not write."""
    return {k: attribute(node, k) for k in node.attrs if isinstance(k, str)}


def child(group: h5py.Group, name: str, kind: type) -> Any:
    """Return a member of a kind, or None if it is missing. Raises ValueError for links and other kinds."""
    link = group.get(name, getlink=True)
    if link is None:
        return None
    if not isinstance(link, h5py.HardLink):
        raise ValueError(f"{group.name}/{name} is a link")
    node = group[name]
    if not isinstance(node, kind):
        raise ValueError(f"{group.name}/{name} is not a {kind.__name__.lower()}")
    if kind is h5py.Dataset:
        _check_storage(node)
    return node


def groups(group: h5py.Group | None) -> dict[str, h5py.Group]:
    """Return the groups in a group, by their unescaped names, in the order of creation."""
    return {} if group is None else {unescape(k): child(group, k, h5py.Group) for k in group}


def datasets(group: h5py.Group | None, depth: int = 8) -> dict[str, h5py.Dataset]:
    """Return the datasets in a group and in ``depth`` levels of groups below it, by their path."""
    found: dict[str, h5py.Dataset] = {}
    for key in group or ():
        kind = group.get(key, getclass=True)  # type: ignore[union-attr]
        if kind is h5py.Group and depth:
            below = datasets(child(group, key, h5py.Group), depth - 1)
            found.update({f"{key}/{path}": dataset for path, dataset in below.items()})
        elif kind is h5py.Dataset:
            found[key] = child(group, key, h5py.Dataset)
    return found


def _check_storage(dataset: h5py.Dataset) -> None:
    """Raise ValueError for data stored in another file, unknown types, and shapes too large for the stored bytes."""
    name = dataset.name
    if dataset.is_virtual or dataset.external:
        raise ValueError(f"{name} keeps its data in another file")
    long = dataset.dtype.kind == "f" and dataset.dtype.itemsize > LARGEST_NUMBER
    if dataset.compression not in (None, "gzip") or dataset.dtype.kind not in "iufS" or long:
        raise ValueError(f"{name} has an unknown compression or type")
    if dataset.shape is None:
        raise ValueError(f"{name} is empty")
    declared = int(np.prod([int(n) for n in dataset.shape], dtype=object)) * dataset.dtype.itemsize
    stored = dataset.id.get_storage_size()
    if declared > DEFLATE_RATIO * stored:
        raise ValueError(f"{name} declares {declared} bytes but stores {stored}")
    if dataset.chunks:
        chunk = int(np.prod([int(n) for n in dataset.chunks], dtype=object))
        if chunk * dataset.dtype.itemsize > MAX_CHUNK:
            raise ValueError(f"{name} has chunks of {chunk} entries")


def check_numbers(dataset: h5py.Dataset, ndim: int) -> None:
    """Raise ValueError for a dataset that is not of numbers in ``ndim`` dimensions."""
    if dataset.ndim != ndim or dataset.dtype.kind not in "iuf":
        raise ValueError(f"{dataset.name} has shape {dataset.shape} and type {dataset.dtype}")


def values(dataset: h5py.Dataset, ndim: int) -> np.ndarray:
    """Return the whole dataset from ``child``. Raises ValueError unless it is of numbers in ``ndim`` dimensions."""
    check_numbers(dataset, ndim)
    if dataset.size * dataset.dtype.itemsize > MAX_BYTES:
        raise ValueError(f"{dataset.name} is too large")
    return dataset[()]


def numbers(group: h5py.Group, name: str, ndim: int) -> np.ndarray:
    """Return a numeric dataset of ``ndim`` dimensions. Raises ValueError if there is none."""
    dataset = child(group, name, h5py.Dataset)
    if dataset is None:
        raise ValueError(f"{group.name}/{name} is missing")
    return values(dataset, ndim)


def stations(group: h5py.Group, elements: int) -> np.ndarray:
    """Return the stations xi of a field, (nx,) for all elements or (elements, nx). Raises ValueError without any."""
    dataset = child(group, "xi", h5py.Dataset)
    if dataset is None:
        raise ValueError(f"{group.name}/xi is missing")
    found = values(dataset, 2 if dataset.ndim == 2 else 1)
    if found.ndim == 2 and len(found) != elements:
        raise ValueError(f"{group.name}/xi has {len(found)} rows for {elements} elements")
    return found


def text(group: h5py.Group | None, name: str) -> str:
    """Return a text dataset, or an empty text if there is none."""
    dataset = None if group is None else child(group, name, h5py.Dataset)
    if dataset is None:
        return ""
    if dataset.shape != () or dataset.dtype.kind != "S" or dataset.dtype.itemsize > MAX_TEXT:
        raise ValueError(f"{dataset.name} is not a text")
    return dataset[()].decode("utf-8", "replace")


def strings(group: h5py.Group | None, name: str) -> list[str]:
    """Return a list of texts, or an empty list if there is none."""
    dataset = None if group is None else child(group, name, h5py.Dataset)
    return [] if dataset is None else texts(dataset)


def texts(dataset: h5py.Dataset) -> list[str]:
    """Return a dataset from ``child`` as a list of texts. Raises ValueError if it is not one."""
    if dataset.ndim != 1 or dataset.dtype.kind != "S" or dataset.nbytes > MAX_TEXT:
        raise ValueError(f"{dataset.name} is not a list of texts")
    return [v.decode("utf-8", "replace") for v in dataset[()]]


def json_object(content: str) -> dict[str, Any]:
    """Return the JSON object in a text, or an empty one for an empty text."""
    found = json.loads(content) if content else {}
    if not isinstance(found, dict):
        raise ValueError("the summary is not a JSON object")
    return found


_MARK = b"GCOL\x01\x00\x00\x00"  # a collection of the global heap: signature, version, three unused bytes
_OBJECT = struct.Struct("<HHIQ")  # index, number of references, unused, size
_HEAD = len(_MARK) + 8
SCANNED = 256 << 20  # bytes: texts are written at the beginning
# place of the end-of-file address in the superblock, by its version; bytes that a killed run left beyond do not count
_REACH = {0: 40, 1: 44, 2: 28, 3: 28}


def endless_heap(path: Path) -> int | None:
    """Return the start of a collection of texts that would send HDF5 into an endless loop, or None.

    Source: HDF5 File Format Specification, III.E, the global heap.
    """
    with path.open("rb") as stream:
        try:
            content = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        except (ValueError, OSError):  # empty, or no such file
            return None
        with content:
            end = min(SCANNED, _reach(content))
            at = content.find(_MARK, 0, end)
            while at >= 0:
                if not _ends(content, at):
                    return at
                at = content.find(_MARK, at + 1, end)
    return None


def _reach(content: mmap.mmap) -> int:
    """Return the number of bytes that belong to the file."""
    at = _REACH.get(content[8], len(content)) if len(content) > 8 else len(content)
    return int(struct.unpack_from("<Q", content, at)[0]) if at + 8 <= len(content) else len(content)


def _ends(content: mmap.mmap, at: int) -> bool:
    """Return whether each object of a collection leads on to the next one, within the collection."""
    if at + _HEAD > len(content):
        return True
    size, = struct.unpack_from("<Q", content, at + len(_MARK))
    end = at + size
    if end > len(content):
        return True  # truncated, which HDF5 reports itself
    at += _HEAD
    while at + _OBJECT.size <= end:
        index, _, _, length = _OBJECT.unpack_from(content, at)
        step = _OBJECT.size + -(-length // 8) * 8 if index else length
        if not 0 < step <= end - at:
            return False
        at += step
    return True
