"""A file that survives a kill while HDF5 writes to it: its contents up to the last commit change all at once.

HDF5 updates its index structures in place, several small writes at a time, so a process killed in
between leaves them torn. Here such writes wait in memory as pages; a commit appends them to the file
with a checksum, puts them in place and cuts them off again. Whoever finds them at the end of a file
reads them in place of what lies below. Whoever reads a file that may be written to reads a copy, made between two
commits.

The plain flushes of HDF5 do not suffice: of the 18 writes of a flush of six states, a kill during 6 leaves a file that
cannot be read (``tests/results/test_results_kills.py`` counts it).
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
except ImportError:  # no such locks here: a copy that is torn is told as damage
    fcntl = None  # type: ignore[assignment]

PAGE = 4096
_TRAILER = struct.Struct("<QQI8s")  # pages, size of the file without them, checksum, mark
_MARK = b"ancf2d-j"
MAX_PAGES = 1 << 18
# what HDF5 keeps of each dataset that is open for reading: some chunks of states, of which row after row is read.
# Its own default, 8 MiB, adds up where there are fields of many bodies.
_CACHE = {"rdcc_nbytes": 1 << 17, "rdcc_nslots": 521}
# where commits and copies exclude each other, far behind the end of any file; neither waits longer than this [s]
_TURN, _PATIENCE = 1 << 62, 2.0


@contextlib.contextmanager
def _alone(descriptor: int, exclusive: bool) -> Iterator[None]:
    """Keep commits (exclusive) from copies, as far as the file system can and others let us."""
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
def steady(path: Path) -> Iterator[Path]:
    """Yield a file that nobody writes to: of one that a run may be writing, NAME.part, a copy between two commits."""
    if path.suffix != ".part":
        yield path
        return
    descriptor, name = tempfile.mkstemp(suffix=".part")
    try:
        with open(descriptor, "wb") as copy, path.open("rb") as source, _alone(source.fileno(), False):
            shutil.copyfileobj(source, copy, 1 << 20)
        yield Path(name)
    finally:
        os.unlink(name)


def _up(size: int) -> int:
    return -(-size // PAGE) * PAGE


class JournaledFile(io.RawIOBase):
    """The file object that h5py writes to; ``commit`` makes everything so far permanent.

    ``failure`` is the first error of the disk. HDF5 is not told of it, which it would not survive: what it goes on to
    write is lost, and the next commit raises the error.
    """

    def __init__(self, descriptor: int, pages: dict[int, bytearray] | None = None,
                 size: int | None = None) -> None:
        self._descriptor = descriptor
        self._pages = pages or {}
        self._committed = self._size = os.fstat(descriptor).st_size if size is None else size
        self._at = 0
        self.failure: OSError | None = None

    def readable(self) -> bool:
        """Always."""
        return True

    def writable(self) -> bool:
        """Always."""
        return True

    def seekable(self) -> bool:
        """Always."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move to an offset from the start, the position or the end."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        """Return the position."""
        return self._at

    def truncate(self, size: int | None = None) -> int:
        """Set the size that the file has from the next commit on."""
        self._size = self._at if size is None else size
        return self._size

    def _overlaps(self, start: int, stop: int) -> list[int]:
        first, last = start // PAGE, (stop - 1) // PAGE
        if len(self._pages) < last - first:
            return [p for p in self._pages if first <= p <= last]
        return [p for p in range(first, last + 1) if p in self._pages]

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer from the position on, with zeros behind the end."""
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
        """Write at the position: at once behind what is committed, else into waiting pages."""
        view = memoryview(data).cast("B")
        start, count = self._at, len(view)
        waiting = min(count, max(0, _up(self._committed) - start))
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
        """Put everything since the last commit into the file, so that no moment shows a part.

        Raises OSError where it, or what was written since the last commit, cannot be put there.
        """
        self.check()
        with _alone(self._descriptor, True):
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
        _write_all(self._descriptor, memoryview(body + trailer), _up(end))
        for number in numbers:
            _write_all(self._descriptor, memoryview(self._pages[number]), number * PAGE)

    def check(self) -> None:
        """Raise the error that the disk gave to a write, if there was one."""
        if self.failure is not None:
            raise self.failure


def _write_all(descriptor: int, data: memoryview, at: int) -> None:
    while data:
        done = os.pwrite(descriptor, data, at)
        data, at = data[done:], at + done


class _Recovered(JournaledFile):
    """A file as its last commit, which did not come to its end, left it."""

    def close(self) -> None:
        """Close the descriptor, which is this object's own."""
        if not self.closed:
            os.close(self._descriptor)
        super().close()


def _waiting_pages(descriptor: int) -> tuple[dict[int, bytearray], int] | None:
    """Return the pages of an unfinished commit and the file's size without them."""
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
    """Whether a file ends with a commit that did not come to its end, so that what lies below may be torn."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        return _waiting_pages(descriptor) is not None
    finally:
        os.close(descriptor)


def recovered(descriptor: int) -> JournaledFile:
    """Return the file object of a file that an earlier process left, as its last commit left it."""
    found = _waiting_pages(descriptor)
    return JournaledFile(descriptor) if found is None else JournaledFile(descriptor, *found)


def open_hdf5(path: Path) -> h5py.File:
    """Open an HDF5 file read-only, as its last commit left it."""
    descriptor = os.open(path, os.O_RDONLY)
    with contextlib.ExitStack() as stack:
        stack.callback(os.close, descriptor)
        found = _waiting_pages(descriptor)
        if found is not None:
            stack.pop_all()
            return h5py.File(_Recovered(descriptor, *found), "r", **_CACHE)
    return h5py.File(path, "r", locking=False, **_CACHE)
