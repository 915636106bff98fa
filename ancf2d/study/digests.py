"""Digests of everything that a result depends on: the program and the case."""

from __future__ import annotations

import hashlib
import os
from functools import cache
from pathlib import Path

from .. import __version__
from ..case import LoadedCase
from ..extend import plugins

LENGTH = 16  # hexadecimal digits: enough to tell apart more cases than can be computed
_PACKAGE = Path(__file__).resolve().parents[1]
_SHOWS = ("cli", "plot")  # folders that compute nothing


@cache
def program() -> str:
    """Return the version of ancf2d with a digest of the sources that compute, to detect any change of them."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        place = path.relative_to(_PACKAGE)
        if place.parts[0] not in _SHOWS:
            digest.update(place.as_posix().encode() + path.read_bytes())
    return f"{__version__}+{digest.hexdigest()[:LENGTH]}"


def start_of(loaded: LoadedCase) -> str | None:
    """Return the path of the result file whose state a case starts from, or None if there is none."""
    start = "rest" if loaded.case.initial is None else loaded.case.initial.from_
    return None if start in ("rest", "static") else os.path.join(os.path.dirname(loaded.source.file), start)


def inputs_of(loaded: LoadedCase) -> list[str]:
    """Return the paths of all files that a case is read from: its own, element definitions, the initial state."""
    folder = os.path.dirname(loaded.source.file)
    definitions = (body.element.definition for body in loaded.case.bodies.values() if body.element is not None)
    paths = [loaded.source.file, *(os.path.join(folder, file) for file in definitions if file is not None)]
    start = start_of(loaded)
    return paths if start is None else [*paths, start]


def files_of(loaded: LoadedCase) -> str:
    """Return a digest of the files that a case reads: element definitions, plugins, the initial state."""
    digest = hashlib.sha256(repr(sorted(loaded.definitions.items())).encode() + plugins.digest().encode())
    start = start_of(loaded)
    if start is not None and os.path.isfile(start):
        with open(start, "rb") as stream:
            digest.update(hashlib.file_digest(stream, "sha256").digest())
    return digest.hexdigest()


def content_name(completed: str, files: str) -> str:
    """Return a name for a case by its content: the case completed with defaults, its files and the program."""
    return hashlib.sha256("\0".join((program(), files, completed)).encode()).hexdigest()[:LENGTH]
