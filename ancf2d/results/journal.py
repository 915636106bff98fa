"""A file that survives a kill while HDF5 writes to it: the committed contents change all at once.

HDF5 updates its index structures in place by several small writes, so a process killed between them leaves inconsistent
structures. Here such writes are kept in memory as pages. A commit appends the pages with a checksum to the end of the
file, writes them to their places and truncates the file again. A reader that finds pages at the end of a file uses them
instead of the bytes at their places. A file that may still be written to is read from a copy, made between two commits.

Plain flushes of HDF5 are not enough: of the 18 writes of a flush of six states, a kill during 6 leaves an unreadable
file (``tests/results/test_results_kills.py`` counts them).
"""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import struct
import tempfile
import time
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

try:
    import fcntl
except ImportError:  # no such locks here: a copy made during a commit is reported as damaged
    fcntl = None  # type: ignore[assignment]

PAGE = 4096
_TRAILER = struct.Struct("<QQI8s")  # number of pages, size of the file without them, checksum, mark
_MARK = b"ancf2d-j"
MAX_PAGES = 1 << 18
# chunk cache of each dataset opened for reading: a few chunks of states, since rows are read in order. The default of
# HDF5, 8 MiB, adds up when there are fields of many bodies.
_CACHE = {"rdcc_nbytes": 1 << 17, "rdcc_nslots": 521}
# byte locked by commits and copies against each other, far beyond the end of any file; longest wait for it [s]
_TURN, _PATIENCE = 1 << 62, 2.0


@contextlib.contextmanager
def _locked_byte(descriptor: int, exclusive: bool) -> Iterator[None]:
    """Keep commits (exclusive) and copies apart, as far as the file system and other processes allow."""
    if fcntl is None:
        yield
        return
    end, held = time.monotonic() + _PATIENCE, False
    while not held and time.monotonic() < end:
        try:
            fcntl.lockf(descriptor, (fcntl.LOCK_EX if exclusive else fcntl.LOCK_SH) | fcntl.LOCK_NB, 1, _TURN)
            held = True
        except (BlockingIOError, PermissionError):
            time.sleep(1e-3)
        except OSError:
            break
    try:
        yield
    finally:
        if held:
            fcntl.lockf(descriptor, fcntl.LOCK_UN, 1, _TURN)


@contextlib.contextmanager
def stable_copy(path: Path) -> Iterator[Path]:
    """Yield a file that nobody writes to: for NAME.part, which a run may write, a copy made between two commits."""
    if path.suffix != ".part":
        yield path
        return
    descriptor, name = tempfile.mkstemp(suffix=".part")
    try:
        with open(descriptor, "wb") as copy, path.open("rb") as source, _locked_byte(source.fileno(), False):
            shutil.copyfileobj(source, copy, 1 << 20)
        yield Path(name)
    finally:
        os.unlink(name)


def _round_up(size: int) -> int:
    return -(-size // PAGE) * PAGE


class JournaledFile(io.RawIOBase):
    """The file object that h5py writes to; ``commit`` makes everything written so far permanent.

    ``failure`` is the first disk error. HDF5 could not recover from it and is not told: later writes are lost, and the
    next commit raises the error.
    """

    def __init__(self, descriptor: int, pages: dict[int, bytearray] | None = None,
                 size: int | None = None) -> None:
        self._descriptor = descriptor
        self._pages = pages or {}
        self._committed = self._size = os.fstat(descriptor).st_size if size is None else size
        self._at = 0
        self.failure: OSError | None = None

    def readable(self) -> bool:
        """Return True."""
        return True

    def writable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move to an offset from the start, the position or the end."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        """Return the position."""
        return self._at

    def truncate(self, size: int | None = None) -> int:
        """Set the size of the file, effective from the next commit."""
        self._size = self._at if size is None else size
        return self._size

    def _overlaps(self, start: int, stop: int) -> list[int]:
        first, last = start // PAGE, (stop - 1) // PAGE
        if len(self._pages) < last - first:
            return [p for p in self._pages if first <= p <= last]
        return [p for p in range(first, last + 1) if p in self._pages]

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer from the position on, with zeros beyond the end."""
        view = memoryview(buffer).cast("B")
        start, count, done = self._at, len(view), 0
        while done < count:
            got = os.preadv(self._descriptor, [view[done:]], start + done)
            if not got:
                view[done:] = bytes(count - done)
                break
            done += got
        for page in self._overlaps(start, start + count):
            low, high = max(start, page * PAGE), min(start + count, (page + 1) * PAGE)
            view[low - start:high - start] = self._pages[page][low - page * PAGE:high - page * PAGE]
        self._at += count
        return count

    def write(self, data: Any) -> int:
        """Write at the position: directly to the file beyond the committed size, else to pages in memory."""
        view = memoryview(data).cast("B")
        start, count = self._at, len(view)
        waiting = min(count, max(0, _round_up(self._committed) - start))
        done = 0
        while done < waiting:
            page, offset = divmod(start + done, PAGE)
            part = min(PAGE - offset, waiting - done)
            if page not in self._pages:
                below = os.pread(self._descriptor, PAGE, page * PAGE)
                self._pages[page] = bytearray(below.ljust(PAGE, b"\0"))
            self._pages[page][offset:offset + part] = view[done:done + part]
            done += part
        try:
            _write_all(self._descriptor, view[waiting:], start + waiting)
        except OSError as error:
            self.failure = self.failure or error
        self._at += count
        self._size = max(self._size, self._at)
        return count

    def commit(self) -> None:
        """Write everything since the last commit to the file, so that a reader sees all of it or nothing.

        Raises OSError if this or an earlier write since the last commit failed.
        """
        self.check()
        with _locked_byte(self._descriptor, True):
            if self._pages:
                self._put_pages()
            os.ftruncate(self._descriptor, self._size)
        self._committed = self._size
        self._pages = {}

    def _put_pages(self) -> None:
        end = max(os.fstat(self._descriptor).st_size, self._size, self._committed)
        numbers = sorted(self._pages)
        body = struct.pack(f"<{len(numbers)}Q", *numbers) + b"".join(self._pages[n] for n in numbers)
        trailer = _TRAILER.pack(len(numbers), self._size, zlib.crc32(body), _MARK)
        _write_all(self._descriptor, memoryview(body + trailer), _round_up(end))
        for number in numbers:
            _write_all(self._descriptor, memoryview(self._pages[number]), number * PAGE)

    def check(self) -> None:
        """Raise the first disk error of a write, if there was one."""
        if self.failure is not None:
            raise self.failure


def _write_all(descriptor: int, data: memoryview, at: int) -> None:
    while data:
        done = os.pwrite(descriptor, data, at)
        data, at = data[done:], at + done


class _Recovered(JournaledFile):
    """A file in the state of its last commit, which was interrupted."""

    def close(self) -> None:
        """Close the descriptor, which belongs to this object."""
        if not self.closed:
            os.close(self._descriptor)
        super().close()


def _waiting_pages(descriptor: int) -> tuple[dict[int, bytearray], int] | None:
    """Return the pages of an interrupted commit and the file's size without them, or None."""
    end = os.fstat(descriptor).st_size
    trailer = os.pread(descriptor, _TRAILER.size, max(0, end - _TRAILER.size))
    if len(trailer) < _TRAILER.size or not trailer.endswith(_MARK):
        return None
    count, size, checksum, _ = _TRAILER.unpack(trailer)
    length = count * (8 + PAGE)
    if not (0 < count <= MAX_PAGES and length + _TRAILER.size <= end and size <= end):
        return None
    body = os.pread(descriptor, length, end - _TRAILER.size - length)
    if len(body) < length or zlib.crc32(body) != checksum:
        return None
    numbers = struct.unpack_from(f"<{count}Q", body)
    start = count * 8
    return {n: bytearray(body[start + k * PAGE:start + (k + 1) * PAGE])
            for k, n in enumerate(numbers)}, size


def is_journaled(path: Path) -> bool:
    """Return whether a file ends with an interrupted commit, so that the bytes at its places may be inconsistent."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        return _waiting_pages(descriptor) is not None
    finally:
        os.close(descriptor)


def recovered(descriptor: int) -> JournaledFile:
    """Return the file object of a file left by an earlier process, in the state of its last commit."""
    found = _waiting_pages(descriptor)
    return JournaledFile(descriptor) if found is None else JournaledFile(descriptor, *found)


def open_hdf5(path: Path) -> h5py.File:
    """Open an HDF5 file read-only, in the state of its last commit."""
    descriptor = os.open(path, os.O_RDONLY)
    with contextlib.ExitStack() as stack:
        stack.callback(os.close, descriptor)
        found = _waiting_pages(descriptor)
        if found is not None:
            stack.pop_all()
            return h5py.File(_Recovered(descriptor, *found), "r", **_CACHE)
    return h5py.File(path, "r", locking=False, **_CACHE)
