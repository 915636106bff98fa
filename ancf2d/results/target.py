"""Output files that appear complete or not at all; files made by ancf2d are recognised and may be replaced."""

from __future__ import annotations

import contextlib
import csv
import os
import re
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import chain
from pathlib import Path

from ancf2d.errors import ResultsError, write_error
from ancf2d.results.records import FORMAT

# written to every file whose format has room for it: metadata of figures, a comment of pages and texts
MARK = "ancf2d-output"
# first bytes of the formats that have it: HDF5, PNG, PDF, PostScript, GIF, JPEG, TIFF, WebP, MP4 and AVIF, SVG, HTML,
# JSON, the reference of cases, cases with other numbers, archives of NumPy, MATLAB
_FORMATS = re.compile(rb"\x89HDF|\x89PNG|%PDF|%!PS|GIF8|\xff\xd8\xff|II\*\0|MM\0\*|RIFF|....ftyp|<\?xml|<!doctype html|"
                      rb"\{|# Case files|# ancf2d|PK\x03\x04|MATLAB 5", re.DOTALL)
_MARKS = (MARK.encode(), FORMAT.encode())
_ENDS = 1 << 16  # number of bytes searched at either end of a file
_LONGEST_HEADER = 1 << 24
# end of the header of a sweep's table
SWEEP_COLUMNS = ("elements", "dofs", "wall_s", "estimate", "output", "reason")
_PROBE_COLUMNS = ["x", "y", "ux", "uy", "theta"]
# first columns of reactions, controllers, moving points and obstacles, which may follow those of probes
_OTHER_COLUMNS = (["fx", "fy", "m"], ["output"], ["s"], ["ux", "uy", "theta"])
_FACES = [f"{axis}_{face}" for face in ("axis", "top", "bottom") for axis in "xy"]
# kinds of files with one format, whose names may have any suffix but those of the other formats
RESULTS, CASE, PAGE, TABLE = "a result file", "a case", "a page", "a table"
_SUFFIXES = {RESULTS: (".h5", ".hdf5"), CASE: (".yaml", ".yml"), PAGE: (".html", ".htm"), TABLE: (".csv",)}
_FOREIGN = {".json", ".vtkhdf", ".npz", ".mat", ".png", ".svg", ".pdf", ".gif", ".mp4", *chain(*_SUFFIXES.values())}


def is_own(path: str | os.PathLike[str]) -> bool:
    """Return whether ancf2d made a file, which may be truncated or damaged since; False if it cannot be read.

    Files are recognised by the mark in formats with room for one, and by the header of tables in CSV, which have none.
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


# columns of figures, without units, where they are fixed: a map of contact over time or load, and diagrams
_FIGURES = (["face", "time", "s", "pressure"], ["face", "load factor", "s", "pressure"],
            ["quantity", "body", "s", "x", "y", "value"])


def _is_own_header(names: Sequence[str]) -> bool:
    """Return whether these are the columns of probes (``export``), of a sweep, or of the data of a figure."""
    bare = [name.partition(" [")[0] for name in names]
    if names[:1] in (["t"], ["factor"]):
        return _are_probes(names[1:])
    if names[:1] == ["hz"]:
        bases = [name.removesuffix(".re") for name in names[1::2]]
        whole = [f"{base}.{part}" for base in bases for part in ("re", "im")] == list(names[1:])
        return whole and [base.rpartition(".")[2] for base in bases[:len(_PROBE_COLUMNS)]] == _PROBE_COLUMNS
    if bare[:1] == ["curve"]:
        return len(bare) >= 3
    if bare[:2] == ["path", "value"]:
        return len(bare) == 3 and bare[2].startswith("change of ")
    return (bare in _FIGURES or tuple(names[-len(SWEEP_COLUMNS):]) == SWEEP_COLUMNS or bare[-len(_FACES):] == _FACES
            or bare[:5] == ["body", "element", "s", "x", "y"])


def _are_probes(names: Sequence[str]) -> bool:
    """Return whether columns are quantities grouped by source, probes first, which is unlikely for measured data."""
    quantities: dict[str, list[str]] = {}
    for name in names:
        probe, dot, quantity = name.rpartition(".")  # moving points have names with dots: loads.1.at
        quantities.setdefault(probe if dot else "", []).append(quantity)
    heads = (_PROBE_COLUMNS, *_OTHER_COLUMNS)
    first = next(iter(quantities.values()), [])
    return (first[:len(_PROBE_COLUMNS)] == _PROBE_COLUMNS and "" not in quantities
            and all(any(q[:len(head)] == head for head in heads) for q in quantities.values()))


try:
    import fcntl
except ImportError:  # no such locks here: the exclusive link below still separates runs
    fcntl = None  # type: ignore[assignment]


def part_path(path: str | os.PathLike[str]) -> Path:
    """Return the path of an unfinished result while it is written: NAME.part in the folder of NAME."""
    path = Path(path)
    return path.parent / f"{path.name}.part"


def check_output(path: str | os.PathLike[str] | None, force: bool, *inputs: str | os.PathLike[str],
                 kind: str | None = None) -> None:
    """Raise ResultsError if an output file cannot be written, is an input, or was not made by ancf2d.

    Commands call it before any long computation. ``force`` allows to replace files that ancf2d did not make, but none
    of the ``inputs``. ``kind``: what is written, for a file whose name must not have the suffix of another format. A
    path of None is accepted.
    """
    if path is None:
        return
    if not os.fspath(path):
        raise ResultsError("the name of the output file is empty")
    path = Path(path)
    check_folder(path)
    for given in inputs:
        if os.path.exists(given) and path.exists() and os.path.samefile(given, path):
            raise ResultsError(f"'{path}' is an input of this command; choose another output file")
    if kind is not None:
        _check_suffix(path, kind)
    check_replaceable(path, force)


def _check_suffix(path: Path, kind: str) -> None:
    """Raise ResultsError if a file of this kind has the suffix of another format."""
    suffix, own = path.suffix.lower(), _SUFFIXES[kind]
    if suffix in _FOREIGN and suffix not in own:
        raise ResultsError(f"cannot write '{path}': {kind} does not have the format of {suffix}; expected for example "
                           f"'{path.with_suffix(own[0])}'")


def check_folder(path: Path) -> None:
    """Raise ResultsError if ``path`` cannot be written: no folder, no permission, or something in the way."""
    try:
        _check_folder(path)
    except OSError as error:
        raise ResultsError(f"cannot write '{path}': {error.strerror or error}") from error


def _check_folder(path: Path) -> None:
    if path.name in ("", ".."):
        raise ResultsError(f"cannot write '{path}': it is a folder; add the name of a file")
    folder = path.parent
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "does not exist"
        raise ResultsError(f"cannot write '{path}': the folder '{folder}' {what}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ResultsError(f"cannot write '{path}': no permission to write in '{folder}'")
    for existing in (path, part_path(path)):
        if existing.is_dir():
            raise ResultsError(f"cannot write '{path}': the folder '{existing}' is in the way")
        if existing.exists() and not existing.is_file():
            raise ResultsError(f"cannot write '{path}': '{existing}' is a device, not a file")


def check_replaceable(path: Path, force: bool) -> None:
    """Raise ResultsError if ``path`` is a file that ancf2d did not make, unless ``force``."""
    if os.path.lexists(path) and not force and not is_own(path):
        raise ResultsError(f"'{path}' exists and was not made by ancf2d; choose another output file, "
                           f"or replace it with --force")


class BusyError(ResultsError):
    """Raised if another run is writing the file."""


def locked(descriptor: int) -> bool:
    """Acquire the exclusive lock of an open file; return False if another process holds it."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks: the exclusive link below still separates runs
        return True
    return True


class Target:
    """A result file that is being written.

    It appears as NAME.part with its readable beginning, grows there, and is renamed to NAME when complete. The lock
    ends with the process, so a .part without a lock was left by a killed run and may be replaced.
    """

    def __init__(self, path: str | os.PathLike[str], force: bool = False) -> None:
        self.path = Path(path)
        self.part = part_path(self.path)
        self.force = force
        _check_suffix(self.path, RESULTS)
        check_folder(self.path)
        self._descriptor = -1
        self._old = self._claim_old_part()
        try:
            check_replaceable(self.path, force)
            check_replaceable(self.part, force)
        except ResultsError:
            self.release()
            raise

    def _busy(self) -> BusyError:
        return BusyError(f"another run is writing '{self.path}'; wait for it to end or choose "
                         f"another output file")

    def _claim_old_part(self) -> int | None:
        """Lock the file of an earlier run, so that only one new run replaces it."""
        try:
            descriptor = os.open(self.part, os.O_RDWR)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise ResultsError(f"cannot replace '{self.part}': {error.strerror}") from error
        if not locked(descriptor):
            os.close(descriptor)
            raise self._busy()
        with contextlib.suppress(OSError):
            if os.path.samestat(os.stat(self.part), os.fstat(descriptor)):
                return descriptor
        os.close(descriptor)  # its run completed between opening and locking
        return self._claim_old_part()

    def publish(self, image: bytes) -> None:
        """Make ``image``, a readable HDF5 file, appear as NAME.part at once."""
        private = None
        try:
            descriptor, name, private = self._unnamed_file()
            self._descriptor = descriptor
            locked(descriptor)
            rest = memoryview(image)
            while rest:
                rest = rest[os.write(descriptor, rest):]
            if self._old is not None:
                os.unlink(self.part)
            # with a directory descriptor Python uses linkat, the only call that follows /proc links
            os.link(name, self.part, src_dir_fd=descriptor)
        except FileExistsError:
            raise self._busy() from None
        finally:
            self._forget_old()
            if private is not None:
                os.unlink(private)

    def resume(self) -> None:
        """Continue the NAME.part that an earlier run left."""
        if self._old is None:
            raise ResultsError(f"there is no '{self.part}' to resume from")
        self._descriptor, self._old = self._old, None

    def _unnamed_file(self) -> tuple[int, str, str | None]:
        """Return descriptor and path of a new file without a name, or with a private one, and the private path."""
        folder = self.path.parent.absolute()
        try:
            descriptor = os.open(folder, os.O_TMPFILE | os.O_RDWR, 0o666)
            return descriptor, f"/proc/self/fd/{descriptor}", None
        except (AttributeError, OSError):  # not Linux, or not on this file system
            name = str(folder / f".{self.path.name}.{os.getpid()}.{time.monotonic_ns()}.part")
            return os.open(name, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666), name, name

    @property
    def descriptor(self) -> int:
        """The open file that became NAME.part."""
        return self._descriptor

    def replace(self) -> None:
        """Move the complete file to the target, safely on disk before it becomes visible."""
        os.fsync(self._descriptor)
        check_folder(self.path)
        check_replaceable(self.path, self.force)  # it may have changed during the computation
        os.replace(self.part, self.path)
        self.release()

    def keep(self) -> None:
        """Leave the file as NAME.part."""
        os.fsync(self._descriptor)
        self.release()

    def discard(self) -> None:
        """Remove the unfinished file."""
        with contextlib.suppress(OSError):
            if os.path.samestat(os.stat(self.part), os.fstat(self._descriptor)):
                os.unlink(self.part)
        self.release()

    def _forget_old(self) -> None:
        if self._old is not None:
            os.close(self._old)
            self._old = None

    def release(self) -> None:
        """Release the lock."""
        self._forget_old()
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


@contextmanager
def replacing(path: str | os.PathLike[str], force: bool) -> Iterator[Path]:
    """Yield a private path next to ``path``; the file written there replaces it if the block ends without error.

    The private path has the same suffix. Raises ResultsError if nothing can be written, and if the file was not made by
    ancf2d, unless ``force``.
    """
    check_output(path, force)
    path = Path(path)
    private = path.with_name(f".{path.stem}.{os.getpid()}.{time.monotonic_ns()}.part{path.suffix}")
    try:
        yield private
        with private.open("rb") as stream:
            os.fsync(stream.fileno())
        check_output(path, force)  # it may have changed meanwhile
        os.replace(private, path)
    except (OSError, RuntimeError) as error:  # h5py reports disk errors as either
        raise write_error(path, error) from error
    finally:
        with suppress(OSError):
            private.unlink()
