"""Where HDF5 keeps texts of any length: checked before HDF5 reads them, as damage there lets it go round for ever."""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

_MARK = b"GCOL\x01\x00\x00\x00"  # a collection: mark, version, three unused bytes
_OBJECT = struct.Struct("<HHIQ")  # index, references, unused, size
_HEAD = len(_MARK) + 8
SCANNED = 256 << 20  # bytes: texts are written at the beginning
# where the superblock says how far the file reaches, by its version; what a killed run left beyond is no part of it
_REACH = {0: 40, 1: 44, 2: 28, 3: 28}


def endless_heap(path: Path) -> int | None:
    """Return where a collection of texts begins that HDF5 would not come to an end with; None where there is none.

    Source: HDF5 File Format Specification, III.E, the global heap.
    """
    with path.open("rb") as stream:
        try:
            content = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        except (ValueError, OSError):  # nothing in it, or no such file
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
    """Return how many bytes belong to the file."""
    at = _REACH.get(content[8], len(content)) if len(content) > 8 else len(content)
    return int(struct.unpack_from("<Q", content, at)[0]) if at + 8 <= len(content) else len(content)


def _ends(content: mmap.mmap, at: int) -> bool:
    """Whether each object of a collection leads on to the next one, within the collection."""
    if at + _HEAD > len(content):
        return True
    size, = struct.unpack_from("<Q", content, at + len(_MARK))
    end = at + size
    if end > len(content):
        return True  # cut off: HDF5 says so itself
    at += _HEAD
    while at + _OBJECT.size <= end:
        index, _, _, length = _OBJECT.unpack_from(content, at)
        step = _OBJECT.size + -(-length // 8) * 8 if index else length
        if not 0 < step <= end - at:
            return False
        at += step
    return True
