"""Storage of compiled kernels between processes: a private folder of the user, named by a hash of the sources.

Each kernel is one file that ends with a checksum and is created by an atomic rename, so that neither stale nor damaged
machine code is ever loaded.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import shutil
import struct
import sys
import tempfile
import time
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core import serialize

_PACKAGE = Path(__file__).resolve().parents[2]
# folders whose sources are hashed as a whole, and one file of another folder that kernels compile
FOLDERS, JETS = ("kernels", "elements"), "case/jets.py"
_KEEP_SECONDS = 30 * 24 * 3600
# suffix of kernel files
SUFFIX = ".kernel"
_CHECKSUM = struct.Struct("<I")
_OTHERS_WRITE = 0o022  # permission bits


def source_hash() -> str:
    """Return a hash of all sources that can be part of a kernel; numba itself checks only a kernel's own file."""
    digest = hashlib.sha256(f"{numba.__version__} {llvmlite.__version__}".encode())
    for paths in ([_PACKAGE / JETS], *(sorted((_PACKAGE / folder).rglob("*.py")) for folder in FOLDERS)):
        for path in paths:
            digest.update(path.relative_to(_PACKAGE).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def fingerprint(function: Any) -> str:
    """Return a hash of a function's code, its closure and, outside ``FOLDERS``, the globals that it uses.

    The sources in these folders are hashed as a whole; those of interactions and plugins are not.
    """
    digest, seen = hashlib.sha256(), set()

    def add(value: Any) -> None:
        value = getattr(value, "py_func", value)
        code = getattr(value, "__code__", None)
        if code is None:
            digest.update(repr(value).encode() if isinstance(value, str | int | float | bool | tuple) else b"?")
            return
        digest.update(f"{value.__module__}.{value.__qualname__}".encode() + code.co_code)
        if id(code) in seen:
            return
        seen.add(id(code))
        for cell in value.__closure__ or ():
            add(cell.cell_contents)
        for constant in code.co_consts:
            digest.update(repr(constant).encode() if not hasattr(constant, "co_code") else constant.co_code)
        digest.update(repr(code.co_names).encode())
        if not value.__module__.startswith((*(f"ancf2d.{folder}." for folder in FOLDERS), "numba", "numpy")):
            for name in code.co_names:
                if name in value.__globals__:
                    add(value.__globals__[name])
    add(function)
    return digest.hexdigest()


def file_of(folder: Path, function: Any, kind: str) -> Path:
    """Return the file of a function compiled for a ``kind`` (argument types and processor)."""
    name = f"{sys.implementation.cache_tag} {fingerprint(function)} {kind}"
    return folder / f"{function.__name__}-{hashlib.sha256(name.encode()).hexdigest()[:24]}{SUFFIX}"


def read(path: Path) -> Any:
    """Return the value stored in a file, which contains code to run.

    Raises ValueError if the file is damaged or other users may write to it.
    """
    with open(path, "rb") as stream:
        data = stream.read()
        private = is_private(os.fstat(stream.fileno()))
    if not private or data[-_CHECKSUM.size:] != _CHECKSUM.pack(zlib.crc32(data[:-_CHECKSUM.size])):
        raise ValueError(f"{path} is damaged")
    return pickle.loads(data[:-_CHECKSUM.size])


def write(path: Path, value: Any) -> None:
    """Store a value in a file that only its owner can read; raises OSError if that fails."""
    data = serialize.dumps(value)
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    descriptor, part = tempfile.mkstemp(".part", dir=path.parent)
    try:
        with open(descriptor, "wb") as stream:
            stream.write(data + _CHECKSUM.pack(zlib.crc32(data)))
        os.replace(part, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(part)
        raise


def cache_folder() -> tuple[Path | None, str]:
    """Return the folder of compiled kernels, created if needed, and ""; or None and the reason why there is none.

    It is below NUMBA_CACHE_DIR, XDG_CACHE_HOME or ~/.cache. Since its files are executed, a folder owned by another
    user is not used, and one that others could write to is emptied. Folders unused for 30 days are deleted.
    """
    root = _root()
    if root is None:
        return None, "there is no home folder"
    folder = root / source_hash()
    try:
        for path in (root, folder):
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not is_private(path.stat(), _OTHERS_WRITE):
                if not is_private(path.stat(), 0):
                    return None, f"'{path}' belongs to another user"
                if path == folder:
                    shutil.rmtree(folder)
                    folder.mkdir(mode=0o700)
            path.chmod(0o700)
        os.utime(folder)
        _drop_unused(root, folder)
    except OSError as error:
        return None, f"'{folder}' cannot be written ({error.strerror})"
    if not os.access(folder, os.W_OK | os.X_OK):
        return None, f"'{folder}' cannot be written"
    return folder, ""


def is_private(found: os.stat_result, others: int = _OTHERS_WRITE) -> bool:
    """Return whether a file or folder belongs to this user and has none of the permission bits ``others``."""
    return not hasattr(os, "geteuid") or (found.st_uid == os.geteuid() and not found.st_mode & others)


def _root() -> Path | None:
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return Path(chosen).absolute() / "ancf2d"
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not base.is_absolute():
        home = Path(os.path.expanduser("~"))
        if not home.is_absolute() or home == Path(home.anchor):
            return None
        base = home / ".cache"
    return base / "ancf2d"


def _drop_unused(root: Path, used: Path) -> None:
    for other in root.iterdir():
        if other != used and other.is_dir() and time.time() - other.stat().st_mtime > _KEEP_SECONDS:
            shutil.rmtree(other, ignore_errors=True)
