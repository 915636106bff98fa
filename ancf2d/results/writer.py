"""Writes one HDF5 file per run, readable at any moment, moved to its place only when complete."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ancf2d.errors import ResultsError, write_error
from ancf2d.interrupts import uninterrupted
from ancf2d.json_values import plain
from ancf2d.results.checkpoint import (
    Checkpoint,
    checkpoint_to_resume,
    drop_checkpoint,
    refusal,
    write_checkpoint,
)
from ancf2d.results.journal import JournaledFile, recovered
from ancf2d.results.layout import Growth, write_fields, write_head, write_mesh
from ancf2d.results.records import OVER_TIME, BodyRecord, Column, FieldRecord, Units, escape, known_column
from ancf2d.results.series import Series, set_text, write_fixed, write_texts
from ancf2d.results.target import Target

FLUSH_SECONDS = 1.0
# a flush that takes longer than this [s] is made less often, so that flushes take at most a sixth of a run
FLUSH_SLOW = 0.2
COLUMN_SECONDS = 5e-4  # approximate time of the first flush per column
BUFFER_BYTES = 16 << 20
STATUSES = ("converged", "failed", "interrupted")


class ResultWriter:
    """Writes one run to ``path``, through NAME.part under an exclusive lock.

    ``header``: case_text, case_completed, case_name, overrides, title, solver, units (length, force, time),
    command_line; missing entries are empty. ``e0`` (nq,): nodal coordinates in the reference.
    ``coordinate_names``: per body the names of one element's coordinates, in the order of its dofs.
    ``columns``: units and descriptions of history or probe columns other than the known ones.
    ``fields``: the fields stored with the states.

    A complete run replaces NAME; a failed or interrupted one with at least one state stays as NAME.part, so that an
    earlier result is never lost. Raises ResultsError.
    """

    stores = True  # states; a keeper of checkpoints does not

    def __init__(self, path: str | os.PathLike[str], header: Mapping[str, Any],
                 bodies: Sequence[BodyRecord], e0: np.ndarray,
                 coordinate_names: Mapping[str, Sequence[str]] | None = None, *,
                 columns: Sequence[Column] = (), fields: Sequence[FieldRecord] = (), force: bool = False) -> None:
        self._prepare(header, len(e0), columns)
        self._target = Target(path, force)
        with self._disk_errors(begin=True):
            # built in memory (meshes compress well), so that there is never an unreadable file
            with h5py.File("head", "w", driver="core", backing_store=False) as head:
                write_head(head, header, self._units)
                write_mesh(head, self._units, bodies, np.asarray(e0, float),
                           dict(coordinate_names or {}))
                write_fields(head, self._units, fields)
                head.flush()
                image = head.id.get_file_image()
            self._target.publish(image)
            self._begin(JournaledFile(self._target.descriptor))

    def _prepare(self, header: Mapping[str, Any], nq: int, columns: Sequence[Column]) -> None:
        self._units = Units(**{k: v for k, v in dict(header.get("units") or {}).items() if v})
        self._dynamic = header.get("solver") in OVER_TIME
        self._nq, self._columns = nq, {column.name: column for column in columns}
        self._started = self._last_flush = time.monotonic()
        self._earlier, self._committed, self._open = 0.0, 0, False
        self._flush_took: float | None = None
        self._checkpoint: Checkpoint | None = None
        self.resumed: Checkpoint | None = None

    def _begin(self, stream: JournaledFile) -> None:
        self._stream = stream
        self._file = h5py.File(stream, "r+")
        self._open = True
        self._growth = Growth(self._file, self._nq, self._units, self._dynamic,
                              list(self._columns.values()))

    @classmethod
    def resume(cls, path: str | os.PathLike[str], header: Mapping[str, Any], e0: np.ndarray, *,
               columns: Sequence[Column] = (), force: bool = False) -> ResultWriter:
        """Continue the NAME.part that a run of the same case left, from its last checkpoint.

        Data after the checkpoint are cut off; ``resumed`` is that checkpoint. Raises ResultsError if there is none, or
        if case, options or version of ancf2d differ.
        """
        self = cls.__new__(cls)
        self._prepare(header, len(e0), columns)
        self._target = Target(path, force)
        try:
            self.resumed = found = checkpoint_to_resume(self._target.part, header, np.asarray(e0, float))
            self._target.resume()
        except ResultsError:
            self._target.release()
            raise
        self._committed, self._earlier = found.rows[0], found.wall_s
        with self._disk_errors(begin=True):
            self._begin(recovered(self._target.descriptor))
            self._growth.reopen(found.rows)
            if "summary" in self._file:
                del self._file["summary"]
            set_text(self._file, "status", "running")
            self._file.attrs["resumed"] = int(self._file.attrs.get("resumed", 0)) + 1
            self.flush()
        return self

    def reject_checkpoint(self, why: object) -> None:
        """Raise the ResultsError for a checkpoint that does not fit the solver; ``why`` explains it."""
        raise refusal(self._target.part, f"its checkpoint was made by another version of the solver ({why})")

    @property
    def path(self) -> Path:
        """The target; during the run, its states are in NAME.part in the same folder."""
        return self._target.path

    # ------------------------------------------------------------------ growing data

    def append(self, t: float, d: np.ndarray, history: Mapping[str, float] | None = None,
               probes: Mapping[str, Mapping[str, float]] | None = None,
               v: np.ndarray | None = None, a: np.ndarray | None = None, *,
               turned: np.ndarray | None = None,
               steps: Mapping[str, np.ndarray] | None = None,
               energies: Mapping[str, float] | None = None,
               fields: Mapping[tuple[str, str], np.ndarray] | None = None,
               checkpoint: Checkpoint | None = None) -> None:
        """Store one state: displacements ``d`` (nq,) of the nodal coordinates at ``t``.

        ``t`` is the load factor in static cases and the time in dynamic ones; ``history`` and ``probes`` are logged as
        by ``log``, ``steps`` (columns of the steps since the last state) as by ``log_block``; ``v`` and ``a`` (nq,) are
        time derivatives of d; ``turned`` (bodies,) is the rotation at S = 0 of each body through full turns;
        ``energies`` are those of this state; ``fields`` are (ne, nx, ny, components) by body and name; from
        ``checkpoint`` the run can be resumed once this state is on disk.
        """
        with self._disk_errors():
            grown = self._growth
            if steps:
                grown.log_block(steps)
            row = grown.logged if history is not None else grown.logged - 1 if steps is not None else -1
            grown.state(t, row, {"d": d, "v": v, "a": a, "turned": turned}, energies or {}, fields or {})
            self._log(history, probes, t)
            if checkpoint is not None:
                self._checkpoint = checkpoint.copied(grown.rows, self._wall_time())
            self._flush_when_due()

    def log(self, history: Mapping[str, float], *, t: float | None = None,
            probes: Mapping[str, Mapping[str, float]] | None = None) -> None:
        """Record a step that is not stored as a state; ``probes`` also need its ``t``."""
        with self._disk_errors():
            self._log(history, probes, t)
            self._flush_when_due()

    def log_block(self, columns: Mapping[str, np.ndarray]) -> None:
        """Record many steps at once: columns (n,) of the same length, such as dt and iterations."""
        with self._disk_errors():
            self._growth.log_block(columns)
            self._flush_when_due()

    def _log(self, history: Mapping[str, float] | None,
             probes: Mapping[str, Mapping[str, float]] | None, t: float | None) -> None:
        if history is not None:
            self._growth.log(history)
        if probes:
            if t is None:
                raise ResultsError("probe values need their time or load factor")
            self._growth.probe(t, probes)

    # ------------------------------------------------------------------ data written once

    def table(self, name: str, columns: Mapping[str, Sequence[Any]],
              attrs: Mapping[str, Any] | None = None) -> None:
        """Write one table: columns of equal length, of numbers or strings."""
        lengths = {len(values) for values in columns.values()}
        if len(lengths) > 1:
            raise ResultsError(f"table '{name}': columns of different lengths {sorted(lengths)}")
        with self._disk_errors():
            tables = self._file.require_group("tables")
            group = tables.create_group(escape(name), track_order=True)
            for key, value in dict(attrs or {}).items():
                if isinstance(value, (bool, int, float)):
                    group.attrs[key] = value
                else:
                    set_text(group, key, str(value))
            for key, values in columns.items():
                column = self._columns.get(key) or known_column("table", key)
                labels = (escape(key), values, self._units.fill(column.units), column.description)
                if any(isinstance(v, str) for v in values):
                    write_texts(group, labels[0], [str(v) for v in values], *labels[2:])
                else:
                    write_fixed(group, labels[0], _numbers(values), *labels[2:])

    def array(self, path: str, data: np.ndarray, units: str, description: str,
              up_to_sign: bool = False) -> None:
        """Write another dataset, e.g. mode shapes, at ``path`` below /arrays.

        ``up_to_sign``: the sign of each row is arbitrary, and comparisons ignore it.
        """
        with self._disk_errors():
            group = self._file.require_group("arrays")
            dataset = write_fixed(group, path.strip("/"), np.asarray(data),
                                  self._units.fill(units), description)
            dataset.attrs["up_to_sign"] = up_to_sign

    # ------------------------------------------------------------------ the end

    def _wall_time(self) -> float:
        return self._earlier + time.monotonic() - self._started

    def _flush_when_due(self) -> None:
        cost = COLUMN_SECONDS * self._growth.columns if self._flush_took is None else self._flush_took
        due = self._last_flush + FLUSH_SECONDS * max(1.0, cost / FLUSH_SLOW)
        if time.monotonic() >= due or self._growth.buffered_bytes > BUFFER_BYTES:
            self.flush()

    def flush(self) -> None:
        """Make all data readable in NAME.part, even if this process is killed."""
        began = time.monotonic()
        with self._disk_errors():
            self._settle(Series.spill)
            self._file.flush()
            self._stream.commit()
            self._committed = self._growth.states
            self._last_flush = time.monotonic()
            self._flush_took = self._last_flush - began

    def _settle(self, action: Callable[[Series], None]) -> None:
        for series in self._growth.all_series():
            action(series)
        self._file.attrs.modify("committed", np.array(self._growth.rows, np.int64))
        if self._checkpoint is not None:
            write_checkpoint(self._file, self._checkpoint, plain)
            self._checkpoint = None

    def finish(self, summary: Mapping[str, Any] | None = None, status: str = "converged") -> Path:
        """Close the file and return its path: the target if ``converged``, else NAME.part.

        ``summary`` is the object that ``--json`` prints; its ``output`` is set to that path. A failed or interrupted
        run without a state leaves no file.
        """
        if status not in STATUSES:
            raise ResultsError(f"unknown status '{status}' (known: {', '.join(STATUSES)})")
        done = status == "converged"
        with self._disk_errors():
            place = self._target.path if done else self._target.part
            text = json.dumps({**dict(summary or {}), "output": str(place)}, default=plain)
            self._settle(Series.close)
            if done:
                drop_checkpoint(self._file)
            write_texts(self._file, "summary", text, "none",
                        "the object that --json prints, as JSON text")
            self._file.attrs["wall_time_s"] = self._wall_time()
            set_text(self._file, "status", status)
            self._file.close()
            self._open = False
            self._stream.commit()
            if done:
                self._put_in_place()
            elif self._growth.states:
                self._target.keep()
            else:
                self._target.discard()
            return place

    def _put_in_place(self) -> None:
        try:
            self._target.replace()
        except (OSError, ResultsError) as error:
            self._target.release()
            left = f"the complete result stays in '{self._target.part}'"
            if isinstance(error, OSError):
                raise write_error(self._target.path, error, left) from error
            raise ResultsError(f"{error}; {left}") from error

    def discard(self) -> None:
        """Remove the unfinished file; an earlier result stays."""
        self._close_quietly()
        self._target.discard()

    def _close_quietly(self) -> None:
        if self._open:
            self._open = False
            with suppress(OSError, RuntimeError):  # the disk may be full
                self._file.close()

    @contextmanager
    def _disk_errors(self, begin: bool = False) -> Iterator[None]:
        try:
            with uninterrupted():  # HDF5 must not be interrupted during a call
                yield
        except (OSError, RuntimeError) as error:  # h5py reports disk errors as either
            failure = (self._stream.failure if hasattr(self, "_stream") else None) or error
            self._abandon()
            left = f"the states written before stay in '{self._target.part}'" if self._committed else ""
            left += ", and --resume continues from them" if left and self._dynamic else ""
            raise write_error(self._target.path, failure, left) from error
        except BaseException:
            if begin:
                self._abandon()
            raise

    def _abandon(self) -> None:
        """Keep the data of earlier flushes after a disk error, or remove the file if there are none."""
        if self._committed:
            self._close_quietly()
            self._target.release()
        else:
            self.discard()

    def __enter__(self) -> ResultWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None,
                 trace: object) -> None:
        if not self._open:
            return
        if not self._growth.states:
            self.discard()
            return
        interrupted = not isinstance(value, Exception)
        reason = str(value) or type(value).__name__ if value else "closed before it was finished"
        self.finish({"reason": reason}, "interrupted" if interrupted else "failed")


def write_tables(path: str | os.PathLike[str], header: Mapping[str, Any],
                 tables: Mapping[str, tuple[Mapping[str, Sequence[Any]], Mapping[str, Any]]],
                 columns: Sequence[Column], summary: Mapping[str, Any], status: str = "converged",
                 force: bool = False) -> Path:
    """Write a result file of tables only, each (columns, attributes), as studies do; return its path.

    Raises ResultsError.
    """
    with ResultWriter(path, header, [], np.zeros(0), columns=columns, force=force) as writer:
        for name, (table, attrs) in tables.items():
            writer.table(name, table, attrs)
        return writer.finish(summary, status)


def _numbers(values: Sequence[Any]) -> np.ndarray:
    """Return a column as integers if all values are integers, else as doubles with NaN for None."""
    if all(isinstance(v, (int, np.integer)) for v in values):
        return np.asarray(values, np.int64)
    return np.asarray([np.nan if v is None else v for v in values], float)
