"""Results out: one HDF5 file per run, readable at any moment, in place only when complete."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.results.head import coordinate_units, write_head, write_mesh
from ancf2d.results.journal import JournaledFile
from ancf2d.results.records import BodyRecord, Column, Units, escape, known_column
from ancf2d.results.series import CHUNK_BYTES, Series, set_text, write_fixed, write_texts
from ancf2d.results.target import Target

FLUSH_SECONDS = 1.0
BUFFER_BYTES = 16 << 20
STATUSES = ("converged", "failed", "interrupted")


def plain(value: Any) -> Any:
    """Return what JSON has no word for as plain numbers, lists and strings."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, complex):
        return [value.real, value.imag]
    return str(value)


class ResultWriter:
    """Writes one run to ``path``, through NAME.part under an exclusive lock.

    ``header``: case_text, case_completed, case_name, overrides, title, solver, units (length,
    force, time), command_line; what is left out is empty. ``e0`` (nq,): nodal coordinates in the
    reference.
    ``coordinate_names``: per body the names of one element's coordinates, in the order of its dofs.
    ``columns``: units and descriptions of history or probe columns beyond the well-known ones.

    A complete run replaces NAME; a failed or interrupted one with at least one state stays as
    NAME.part, so that an earlier result is never lost. Errors: ResultsError.
    """

    def __init__(self, path: str | os.PathLike[str], header: Mapping[str, Any],
                 bodies: Sequence[BodyRecord], e0: np.ndarray,
                 coordinate_names: Mapping[str, Sequence[str]] | None = None, *,
                 columns: Sequence[Column] = (), force: bool = False) -> None:
        self._header = dict(header)
        units = {k: v for k, v in dict(header.get("units") or {}).items() if v}
        self._units = Units(**units)
        self._columns = {column.name: column for column in columns}
        self._nq = len(e0)
        self._started = self._last_flush = time.monotonic()
        self._history: dict[str, Series] = {}
        self._probes: dict[tuple[str, str], Series] = {}
        self._logged = self._probed = self._states = self._committed = 0
        self._fields: dict[str, Series] = {}
        self._open = False
        self._target = Target(path, force)
        with self._disk_errors(begin=True):
            # built in memory (meshes compress well), so that no moment leaves an unreadable file
            with h5py.File("head", "w", driver="core", backing_store=False) as head:
                write_head(head, self._header, self._units)
                write_mesh(head, self._units, bodies, np.asarray(e0, float),
                           dict(coordinate_names or {}))
                head.flush()
                image = head.id.get_file_image()
            self._target.publish(image)
            self._stream = JournaledFile(self._target.descriptor)
            self._file = h5py.File(self._stream, "r+")
            self._open = True

    @property
    def path(self) -> Path:
        """The target; while the run goes on, its states are in NAME.part beside it."""
        return self._target.path

    # ------------------------------------------------------------------ what grows

    def append(self, t: float, d: np.ndarray, history: Mapping[str, float] | None = None,
               probes: Mapping[str, Mapping[str, float]] | None = None,
               v: np.ndarray | None = None, a: np.ndarray | None = None) -> None:
        """Store one state: displacements ``d`` (nq,) of the nodal coordinates at ``t``.

        ``t`` is the load factor in static cases and the time in dynamic ones; ``history`` and
        ``probes`` are logged as by ``log``; ``v`` and ``a`` (nq,) are time derivatives of d.
        """
        with self._disk_errors():
            self._field("t").append(float(t))
            self._field("history_row").append(self._logged if history is not None else -1)
            for name, row in (("d", d), ("v", v), ("a", a)):
                if row is not None:
                    self._store(name, row)
            self._states += 1
            self._log(history, probes, t)
            self._flush_when_due()

    def log(self, history: Mapping[str, float], *, t: float | None = None,
            probes: Mapping[str, Mapping[str, float]] | None = None) -> None:
        """Record a step that is not stored as a state; ``probes`` then need its ``t``."""
        with self._disk_errors():
            self._log(history, probes, t)
            self._flush_when_due()

    def _store(self, name: str, row: np.ndarray) -> None:
        if np.shape(row) != (self._nq,):
            raise ResultsError(f"a state of {np.shape(row)} does not fit {self._nq} coordinates")
        field = self._field(name)
        field.pad_to(self._states)
        if self._nq * 8 >= CHUNK_BYTES:
            field.write_through(row)
        else:
            field.append(row)

    def _field(self, name: str) -> Series:
        if name not in self._fields:
            dynamic = self._header.get("solver") == "dynamic"
            group = self._file.require_group("states")
            units, time_unit = coordinate_units(self._units), self._units.time
            labels = {
                "t": (time_unit, "time") if dynamic else ("1", "load factor"),
                "history_row": ("1", "row of /history of this state, -1 where it has none"),
                "d": (units, "displacements of the nodal coordinates: they are e0 + d"),
                "v": (f"({units})/{time_unit}", "rates of the nodal coordinates"),
                "a": (f"({units})/{time_unit}^2", "second rates of the nodal coordinates"),
            }[name]
            width = self._nq if name in ("d", "v", "a") else 0
            self._fields[name] = Series(group, name, *labels, width=width,
                                        integer=name == "history_row")
        return self._fields[name]

    def _log(self, history: Mapping[str, float] | None,
             probes: Mapping[str, Mapping[str, float]] | None, t: float | None) -> None:
        if history is not None:
            for name, value in history.items():
                self._history_column(name).append(value)
            self._logged += 1
            for series in self._history.values():
                series.pad_to(self._logged)
        if probes:
            if t is None:
                raise ResultsError("probe values need the time or load factor that they belong to")
            for probe, values in probes.items():
                self._probe_column(probe, "t").append(float(t))
                for quantity, value in values.items():
                    self._probe_column(probe, quantity).append(value)
            self._probed += 1
            for (_, quantity), series in self._probes.items():
                if quantity == "t" and len(series) < self._probed:
                    series.append(float(t))
                series.pad_to(self._probed)

    def _history_column(self, name: str) -> Series:
        if name not in self._history:
            column = self._columns.get(name) or known_column("history", name)
            self._history[name] = self._series("history", column, self._logged)
        return self._history[name]

    def _probe_column(self, probe: str, quantity: str) -> Series:
        key = (probe, quantity)
        if key not in self._probes:
            role = "history" if quantity == "t" else "probe"
            column = self._columns.get(quantity) or known_column(role, quantity)
            if quantity == "t" and self._header.get("solver") != "dynamic":
                column = Column("t", "1", "load factor")
            self._probes[key] = self._series(f"probes/{escape(probe)}", column, self._probed)
        return self._probes[key]

    def _series(self, place: str, column: Column, length: int) -> Series:
        group = self._file
        for part in place.split("/"):
            group = group[part] if part in group else group.create_group(part, track_order=True)
        series = Series(group, escape(column.name), self._units.fill(column.units),
                        column.description, integer=column.integer)
        series.pad_to(length)
        return series

    # ------------------------------------------------------------------ what is written once

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
        """Write any further dataset, e.g. mode shapes, at ``path`` below /arrays.

        ``up_to_sign``: each row is defined up to its sign only, and is compared so.
        """
        with self._disk_errors():
            group = self._file.require_group("arrays")
            dataset = write_fixed(group, path.strip("/"), np.asarray(data),
                                  self._units.fill(units), description)
            dataset.attrs["up_to_sign"] = up_to_sign

    # ------------------------------------------------------------------ the end

    def _all_series(self) -> Iterator[Series]:
        yield from self._fields.values()
        yield from self._history.values()
        yield from self._probes.values()

    def _flush_when_due(self) -> None:
        full = sum(s.buffered_bytes for s in self._fields.values()) > BUFFER_BYTES
        if full or time.monotonic() - self._last_flush >= FLUSH_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Make everything so far readable in NAME.part, whatever happens to this process."""
        with self._disk_errors():
            self._settle(Series.spill)
            self._file.flush()
            self._stream.commit()
            self._committed = self._states
            self._last_flush = time.monotonic()

    def _settle(self, action: Callable[[Series], None]) -> None:
        for series in self._all_series():
            action(series)
        counts = np.array([self._states, self._logged, self._probed], np.int64)
        self._file.attrs.modify("committed", counts)

    def finish(self, summary: Mapping[str, Any] | None = None, status: str = "converged") -> Path:
        """Close the file and return where it is: the target if ``converged``, else NAME.part.

        ``summary`` is the object that ``--json`` prints; ``output`` in it is set to that place. A
        failed or interrupted run without a state leaves nothing behind.
        """
        if status not in STATUSES:
            raise ResultsError(f"unknown status '{status}' (known: {', '.join(STATUSES)})")
        done = status == "converged"
        with self._disk_errors():
            place = self._target.path if done else self._target.part
            text = json.dumps({**dict(summary or {}), "output": str(place)}, default=plain)
            self._settle(Series.close)
            write_texts(self._file, "summary", text, "none",
                        "the object that --json prints, as JSON text")
            self._file.attrs["wall_time_s"] = time.monotonic() - self._started
            set_text(self._file, "status", status)
            self._file.close()
            self._open = False
            self._stream.commit()
            if done:
                self._put_in_place()
            elif self._states:
                self._target.keep()
            else:
                self._target.discard()
            return place

    def _put_in_place(self) -> None:
        try:
            self._target.replace()
        except (OSError, ResultsError) as error:
            self._target.release()
            cause = getattr(error, "strerror", None) or str(error)
            raise ResultsError(f"{cause}; the complete result stays in '{self._target.part}'"
                               ) from error

    def discard(self) -> None:
        """Give up: remove the unfinished file; an earlier result stays."""
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
            with _uninterrupted():
                yield
        except (OSError, RuntimeError) as error:  # h5py reports disk errors as either
            self._abandon()
            cause = getattr(error, "strerror", None) or str(error)
            raise ResultsError(f"cannot write '{self._target.path}': {cause}") from error
        except ResultsError:
            if begin:
                self._abandon()
            raise

    def _abandon(self) -> None:
        """After a disk error: keep what earlier flushes made readable, drop what never was."""
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
        if not self._states:
            self.discard()
            return
        interrupted = not isinstance(value, Exception)
        reason = str(value) or type(value).__name__ if value else "left before it was finished"
        self.finish({"reason": reason}, "interrupted" if interrupted else "failed")


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Let Ctrl-C and termination wait until HDF5 has finished writing: it cannot be left midway."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _numbers(values: Sequence[Any]) -> np.ndarray:
    """Return a column as integers where all are, else as doubles with NaN for None."""
    if all(isinstance(v, (int, np.integer)) for v in values):
        return np.asarray(values, np.int64)
    return np.asarray([np.nan if v is None else v for v in values], float)
