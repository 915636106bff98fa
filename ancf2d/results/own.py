"""The files that ancf2d has made itself: those that it replaces, while all others need ``force``."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Sequence
from pathlib import Path

from ancf2d.results.records import FORMAT

# what every file of a format with room for it says of its program: metadata of figures, a comment of pages and texts
MARK = "ancf2d-output"
# how the formats that carry it begin: HDF5, PNG, PDF, PostScript, GIF, JPEG, TIFF, WebP, MP4 and AVIF, SVG, HTML, JSON,
# the reference of cases, archives of NumPy, MATLAB
_FORMATS = re.compile(rb"\x89HDF|\x89PNG|%PDF|%!PS|GIF8|\xff\xd8\xff|II\*\0|MM\0\*|RIFF|....ftyp|<\?xml|<!doctype html|"
                      rb"\{|# Case files|PK\x03\x04|MATLAB 5", re.DOTALL)
_MARKS = (MARK.encode(), FORMAT.encode())
_ENDS = 1 << 16  # bytes at either end of a file that are looked through
_LONGEST_HEADER = 1 << 24
# how the header of a sweep's table ends
SWEEP_COLUMNS = ("elements", "dofs", "wall_s", "estimate", "output", "reason")
_PROBE_COLUMNS = ["x", "y", "ux", "uy", "theta"]
_FACES = [f"{axis}_{face}" for face in ("axis", "top", "bottom") for axis in "xy"]


def is_own(path: str | os.PathLike[str]) -> bool:
    """Return whether ancf2d has made a file, which may be cut off or damaged since; False where it cannot be read.

    It is told by the mark in formats that have room for one, and by the header of tables in CSV, which have none.
    """
    path = Path(path)
    try:
        if not path.is_file():
            return False
        with path.open("rb") as stream:
            head = stream.read(_ENDS)
            stream.seek(max(0, stream.seek(0, os.SEEK_END) - _ENDS))
            ends = head + stream.read(_ENDS)
            if _FORMATS.match(head):
                return any(mark in ends for mark in _MARKS)
            stream.seek(0)
            first = stream.readline(_LONGEST_HEADER)
        return _is_own_header(next(csv.reader([first.decode()]), []))
    except (OSError, ValueError, csv.Error):
        return False


def _is_own_header(names: Sequence[str]) -> bool:
    """Return whether these are the columns of probes (``export``), of a sweep, or of what a figure shows."""
    bare = [name.partition(" [")[0] for name in names]
    if names[:1] in (["t"], ["factor"]):
        return _are_probes(names[1:])
    if names[:1] == ["hz"]:
        bases = [name.removesuffix(".re") for name in names[1::2]]
        whole = [f"{base}.{part}" for base in bases for part in ("re", "im")] == list(names[1:])
        return whole and [base.rpartition(".")[2] for base in bases[:len(_PROBE_COLUMNS)]] == _PROBE_COLUMNS
    if bare[:1] == ["curve"]:
        return len(bare) == 3
    return (tuple(names[-len(SWEEP_COLUMNS):]) == SWEEP_COLUMNS or bare[-len(_FACES):] == _FACES
            or bare[:5] == ["body", "element", "s", "x", "y"])


def _are_probes(names: Sequence[str]) -> bool:
    """Return whether columns are all quantities of one probe after the other: measured data seldom are."""
    quantities: dict[str, list[str]] = {}
    for name in names:
        probe, dot, quantity = name.partition(".")
        quantities.setdefault(probe if dot else "", []).append(quantity)
    return bool(quantities) and all(q[:len(_PROBE_COLUMNS)] == _PROBE_COLUMNS for q in quantities.values())
