"""Checkpoints: the complete state of a solver, stored in the unfinished file, from which a run is resumed."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ancf2d import __version__
from ancf2d.errors import ResultsError, write_error
from ancf2d.results import safe
from ancf2d.results.layout import write_head, write_mesh
from ancf2d.results.records import Units, escape, unescape
from ancf2d.results.series import describe, write_fixed, write_texts

GROUP = "checkpoint"
EVERY_SECONDS = 1.0


@dataclass(frozen=True)
class Checkpoint:
    """A point of a run from which it can be resumed.

    ``values`` is the solver's complete state, by name; ``notes`` is everything else known at that time, as a JSON-able
    object. ``t`` is the time; ``rows`` are the numbers of rows of states, history and probes that belong to it,
    ``wall_s`` is the time that the run had taken.
    """

    t: float
    values: Mapping[str, np.ndarray]
    notes: Mapping[str, Any] = field(default_factory=dict)
    rows: tuple[int, int, int] = (0, 0, 0)
    wall_s: float = 0.0

    def copied(self, rows: tuple[int, int, int], wall_s: float) -> Checkpoint:
        """Return a copy that shares no arrays, with these rows and wall time."""
        values = {name: np.array(value) for name, value in self.values.items()}
        for name, value in values.items():
            if value.dtype.kind not in "iufb":
                raise ResultsError(f"'{name}' of a checkpoint is of type {value.dtype}, not numeric")
        return Checkpoint(self.t, values, dict(self.notes), rows, wall_s)


def write_checkpoint(file: h5py.File, found: Checkpoint, to_json: Any) -> None:
    """Write a checkpoint, replacing the previous one."""
    group = file.require_group(GROUP)
    group.attrs["t"], group.attrs["wall_s"] = float(found.t), float(found.wall_s)
    group.attrs["rows"] = np.array(found.rows, np.int64)
    values = group.require_group("values")
    for name in values:
        if unescape(name) not in found.values:
            del values[name]
    for name, value in found.values.items():
        _write_value(values, escape(name), np.asarray(value))
    if "notes" in group:
        del group["notes"]
    write_texts(group, "notes", json.dumps(dict(found.notes), default=to_json), "none",
                "everything else that was known then, as JSON text")


def _write_value(group: h5py.Group, name: str, value: np.ndarray) -> None:
    if value.dtype.kind == "b":
        value = value.astype(np.int8)
    old = group.get(name)
    if old is not None and old.shape == value.shape and old.dtype == value.dtype:
        old[...] = value
        return
    if old is not None:
        del group[name]
    if value.size:
        write_fixed(group, name, value, "none", "state of the solver")
    else:
        describe(group.create_dataset(name, value.shape, value.dtype), "none", "state of the solver")


def drop_checkpoint(file: h5py.File) -> None:
    """Remove the checkpoint: a complete file is not resumed."""
    if GROUP in file:
        del file[GROUP]


def checkpoint_of(file: h5py.File) -> Checkpoint | None:
    """Return the checkpoint of an open file, or None if it has none. Raises ValueError if it is damaged."""
    group = safe.child(file, GROUP, h5py.Group)
    if group is None:
        return None
    rows, t, wall = (safe.attribute(group, name) for name in ("rows", "t", "wall_s"))
    committed = safe.attribute(file, "committed")
    if not (isinstance(rows, list) and isinstance(committed, list) and len(rows) == len(committed) == 3
            and all(isinstance(n, int) and 0 <= n <= most for n, most in zip(rows, committed, strict=True))):
        raise ValueError("its checkpoint does not fit its states")
    if not (isinstance(t, float) and isinstance(wall, float)):
        raise ValueError("its checkpoint has no time")
    return Checkpoint(t, _values(group), safe.json_object(safe.text(group, "notes")), tuple(rows), wall)


def _values(group: h5py.Group) -> dict[str, np.ndarray]:
    found = safe.child(group, "values", h5py.Group)
    values = {}
    for key in found or ():
        dataset = safe.child(found, key, h5py.Dataset)
        values[unescape(key)] = np.asarray(safe.values(dataset, dataset.ndim))
    return values


def read_checkpoint(path: str | os.PathLike[str]) -> Checkpoint | None:
    """Return the checkpoint in an unfinished file, or None if it has none."""
    path = Path(path)
    with safe.open_file(path) as file, safe.damage(path):
        return checkpoint_of(file)


def checkpoint_to_resume(part: Path, header: Mapping[str, Any], e0: np.ndarray) -> Checkpoint:
    """Return the checkpoint of an unfinished file of the case of ``header``. Raises ResultsError if there is none."""
    if not part.exists():
        raise ResultsError(f"there is no '{part}' to resume from; run the case without --resume")
    with safe.open_file(part) as file, safe.damage(part):
        found = checkpoint_of(file)
        if found is None:
            raise ResultsError(f"'{part}' holds no checkpoint to resume from; run the case without --resume")
        differs = _difference(file, header, e0)
    if differs:
        raise refusal(part, differs)
    return found


def refusal(part: Path, why: object) -> ResultsError:
    """Return the error for an unfinished file that cannot be resumed."""
    return ResultsError(f"cannot resume from '{part}': {why}; run the case without --resume, or choose another output "
                        "file")


def _difference(file: h5py.File, header: Mapping[str, Any], e0: np.ndarray) -> str:
    """Return in words how an unfinished file differs from this case; empty if it does not."""
    version = safe.attribute(file, "version_ancf2d")
    if version != __version__:
        return f"it was written by ancf2d {version}, this is {__version__}"
    case = safe.child(file, "case", h5py.Group)
    if safe.strings(case, "overrides") != [str(o) for o in header.get("overrides") or []]:
        return "it was started with other --set options"
    for name in ("text", "completed"):
        if safe.text(case, name) != (header.get(f"case_{name}") or ""):
            return "the case has changed since then"
    if safe.attribute(file, "case_files", "") != (header.get("case_files") or ""):
        return "a file that the case reads has changed since then"
    if not np.array_equal(safe.numbers(safe.child(file, "mesh", h5py.Group), "e0", 1), e0):
        return "its mesh is different"
    return ""


class CheckpointKeeper:
    """Stands in for the writer of a result file in runs that store nothing but their checkpoint.

    The file at ``path`` appears after a second, is replaced every second or less often, and is removed when the run
    ends, with or without success. ``header`` and ``e0`` (nq,) are those of ``ResultWriter``; ``resumed`` is the
    checkpoint of an existing file of the same case, if any.
    """

    stores = False  # states

    def __init__(self, path: str | os.PathLike[str], header: Mapping[str, Any], e0: np.ndarray, to_json: Any) -> None:
        self.path, self._to_json = Path(path), to_json
        self._header, self._e0 = header, e0
        self._due = time.monotonic() + EVERY_SECONDS
        self.resumed: Checkpoint | None = None
        if self.path.exists():
            try:
                self.resumed = checkpoint_to_resume(self.path, header, e0)
            except ResultsError:
                self.path.unlink(missing_ok=True)

    def keep(self, checkpoint: Checkpoint | None) -> None:
        """Write the checkpoint of a state, if it has one and it is due. Raises ResultsError if writing fails."""
        now = time.monotonic()
        if checkpoint is None or now < self._due:
            return
        private = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        try:
            with h5py.File(private, "w") as file:
                units = Units(**{k: v for k, v in dict(self._header.get("units") or {}).items() if v})
                write_head(file, self._header, units)
                write_mesh(file, units, [], self._e0, {})
                write_checkpoint(file, checkpoint.copied((0, 0, 0), 0.0), self._to_json)
            os.replace(private, self.path)
        except (OSError, RuntimeError) as error:  # h5py reports disk errors as either
            private.unlink(missing_ok=True)
            raise write_error(self.path, error) from error
        # writing takes at most a tenth of the time
        self._due = time.monotonic() + max(EVERY_SECONDS, 10.0 * (time.monotonic() - now))

    def reject_checkpoint(self, why: object) -> None:
        """Delete a checkpoint that does not fit the solver, so that the run starts from the beginning."""
        self.path.unlink(missing_ok=True)
        self.resumed = None

    def finish(self, summary: Mapping[str, Any], status: str) -> Path:
        """Remove the file, whatever the status of the run, and return its path."""
        self.path.unlink(missing_ok=True)
        return self.path

    def __exit__(self, *error: object) -> None:
        """Leave the file in place: it remains if the run was interrupted."""
