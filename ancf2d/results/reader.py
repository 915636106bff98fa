"""Reads a result file: a read-only view, checked, with data loaded on demand."""

from __future__ import annotations

import os
import weakref
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.results import safe
from ancf2d.results.checkpoint import Checkpoint, checkpoint_of
from ancf2d.results.geometry import axis_values, body_faces, body_levels, body_nodes
from ancf2d.results.notebooks import as_html, one_line, to_xarray
from ancf2d.results.records import OVER_TIME, BodyRecord, FieldRecord, Units
from ancf2d.results.series import StateRows, Table, read_columns, read_tables


def _close(file: h5py.File, then: Callable[[], None]) -> None:
    file.close()
    then()


class Results(AbstractContextManager["Results"]):
    """An open result file, whose states are read on demand: one by one, in blocks or all at once.

    If a run is still writing the file, this shows the contents at the time of opening. Nodal coordinates of state i are
    ``e(i) = e0 + d(i)``; i counts from 0, negative from the end. Reading raises ResultsError if the file is damaged or
    inconsistent.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.called = f"'{self.path}'"  # in messages
        self._rows: dict[str, StateRows | None] = {}
        self._file = safe.open_file(self.path)
        try:
            with safe.damage(self.path):
                self._read_head()
        except ResultsError:
            self._file.close()
            raise

    def _read_head(self) -> None:
        self.attrs: dict[str, Any] = safe.attributes(self._file)
        counts = self.attrs.get("committed")
        if not (isinstance(counts, list) and len(counts) == 3
                and all(isinstance(n, int) and n >= 0 for n in counts)):
            raise ValueError("the counts of stored rows are missing")
        self.nt, self._history_rows, self._probe_rows = counts
        self._mesh = safe.child(self._file, "mesh", h5py.Group)
        if self._mesh is None:
            raise ValueError("the mesh is missing")
        self._reference = safe.child(self._mesh, "e0", h5py.Dataset)
        if self._reference is None or self._reference.ndim != 1:
            raise ValueError("the nodal coordinates are missing")
        self.nq: int = self._reference.shape[0]
        self._states = safe.child(self._file, "states", h5py.Group)
        if self.nt:
            self._times = None if self._states is None else safe.child(self._states, "t", h5py.Dataset)
            if self._times is None or self._times.ndim != 1:
                raise ValueError("the states are missing")
            if len(self._times) < self.nt:
                raise ValueError(f"it has {len(self._times)} states where {self.nt} were stored")

    def _attr(self, name: str) -> str:
        return str(self.attrs.get(name, ""))

    @property
    def status(self) -> str:
        """One of converged, failed, interrupted, running (still going, or killed)."""
        return self._attr("status")

    @property
    def title(self) -> str:
        """The title of the case."""
        return self._attr("title")

    @property
    def solver(self) -> str:
        """The type of the solver."""
        return self._attr("solver")

    @property
    def over_time(self) -> bool:
        """Whether the states belong to times, not to load factors."""
        return self.solver in OVER_TIME

    @cached_property
    def units(self) -> Units:
        """Labels of length, force and time."""
        return Units(*(self._attr(f"units_{k}") or getattr(Units, k) for k in ("length", "force", "time")))

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The JSON object that the run prints with ``--json``; empty while it is unfinished."""
        with safe.damage(self.path):
            return safe.json_object(safe.text(self._file, "summary"))

    def _case(self, name: str) -> str:
        with safe.damage(self.path):
            return safe.text(safe.child(self._file, "case", h5py.Group), name)

    @property
    def case_text(self) -> str:
        """The case as given."""
        return self._case("text")

    @property
    def case_completed(self) -> str:
        """The case with defaults and overrides."""
        return self._case("completed")

    @property
    def overrides(self) -> list[str]:
        """The ``--set`` options of the run."""
        with safe.damage(self.path):
            return safe.strings(safe.child(self._file, "case", h5py.Group), "overrides")

    @cached_property
    def e0(self) -> np.ndarray:
        """Reference nodal coordinates (nq,)."""
        with safe.damage(self.path):
            return safe.values(self._reference, 1)

    @cached_property
    def t(self) -> np.ndarray:
        """Load factor or time of each stored state (nt,)."""
        with safe.damage(self.path):
            return safe.values(self._times, 1)[:self.nt] if self.nt else np.empty(0)

    def _state_rows(self, name: str) -> StateRows | None:
        if name not in self._rows:
            dataset = None if self._states is None else safe.child(self._states, name, h5py.Dataset)
            self._rows[name] = None if dataset is None else StateRows(dataset, (self.nq,))
        return self._rows[name]

    def holds(self, name: str) -> bool:
        """Return whether every stored state has ``name``: d, v or a."""
        with safe.damage(self.path):
            rows = self._state_rows(name)
            return rows is not None and len(rows) >= self.nt

    def _number(self, i: int) -> int:
        """Return the number from 0 of state i. Raises ResultsError if there is no such state."""
        if not -self.nt <= i < self.nt:
            raise ResultsError(f"{self.called} has no state {i}: it holds {self.nt}")
        return int(i) % self.nt

    def _row(self, name: str, i: int) -> np.ndarray:
        number = self._number(i)
        with safe.damage(self.path):
            rows = self._state_rows(name)
            if rows is None or len(rows) <= number:
                raise ResultsError(f"{self.called} does not hold {name} of state {i}")
            return rows.row(number)

    def _all_rows(self, name: str) -> StateRows:
        if not (self.nt and self.holds(name)):
            raise ResultsError(f"{self.called} does not hold {name} of its states")
        rows = self._state_rows(name)
        assert rows is not None
        return rows

    def rows(self, name: str) -> np.ndarray:
        """Return ``name`` (d, v or a) of all states at once (nt, nq). Raises ResultsError if it was not stored."""
        rows = self._all_rows(name)
        with safe.damage(self.path):
            return rows.block(0, self.nt)

    def blocks(self, name: str) -> Iterator[np.ndarray]:
        """Yield ``name`` (d, v or a) of all states in blocks of consecutive states (n, nq).

        Files with equal numbers of states and coordinates have equal blocks. Raises ResultsError if it was not stored.
        """
        return self._blocks(self._all_rows(name))

    def _blocks(self, rows: StateRows) -> Iterator[np.ndarray]:
        for first, stop in rows.bounds(self.nt):
            with safe.damage(self.path):
                block = rows.block(first, stop)
            yield block

    def d(self, i: int) -> np.ndarray:
        """Return the displacements (nq,) of the nodal coordinates in state i."""
        return self._row("d", i)

    def e(self, i: int) -> np.ndarray:
        """Return the nodal coordinates (nq,) of state i."""
        e = self.d(i)
        e += self.e0
        return e

    def v(self, i: int) -> np.ndarray:
        """Return the rates (nq,) of the nodal coordinates in state i. Raises ResultsError if not stored."""
        return self._row("v", i)

    def a(self, i: int) -> np.ndarray:
        """Return the second rates (nq,) of the nodal coordinates in state i. Raises ResultsError if not stored."""
        return self._row("a", i)

    def turned(self, i: int) -> np.ndarray | None:
        """Return the rotations (bodies,) at S = 0 of each body in state i, through full turns; None if not stored."""
        number = self._number(i)
        with safe.damage(self.path):
            dataset = safe.child(self._states, "turned", h5py.Dataset)
            if dataset is None or len(dataset) <= number:
                return None
            return StateRows(dataset, (len(self.bodies),)).row(number)

    @cached_property
    def bodies(self) -> dict[str, BodyRecord]:
        """The bodies by name, in the order of the case."""
        with safe.damage(self.path):
            found = safe.groups(safe.child(self._mesh, "bodies", h5py.Group))
            try:
                return {name: self._body(name, group) for name, group in found.items()}
            except ResultsError as error:
                raise ValueError(str(error)) from error

    def _body(self, name: str, group: h5py.Group) -> BodyRecord:
        fields: dict[str, Any] = {"name": name}
        for key in ("element_type", "formulation", "section_kind"):
            fields[key] = str(safe.attribute(group, key, ""))
        for key in ("height", "width"):
            fields[key] = float(safe.attribute(group, key, np.nan))
        for key, ndim in (("dofs", 2), ("nodes", 2), ("node_shape", 1), ("classes", 1),
                          ("lengths", 1), ("sample_xi", 1), ("sample_S", 4), ("sample_S_x", 3),
                          ("arclength", 1)):
            fields[key] = safe.numbers(group, key, ndim)
        for key, ndim in (("heights", 2), ("levels", 1)):
            fields[key] = safe.numbers(group, key, ndim) if key in group else None
        fields["coordinate_names"] = tuple(safe.strings(group, "coordinate_names"))
        record = BodyRecord(**fields)
        record.check(self.nq)
        return record

    def body(self, name: str) -> BodyRecord:
        """Return a body by name. Raises ResultsError, which lists the known names, if there is none."""
        if name not in self.bodies:
            raise ResultsError(f"{self.called} has no body '{name}' (bodies: "
                               f"{', '.join(self.bodies)})")
        return self.bodies[name]

    def _scaled(self, i: int | None, scale: float) -> np.ndarray:
        if i is None:
            return self.e0
        d = self.d(i)
        if scale != 1.0:
            d *= scale
        d += self.e0
        return d

    def faces(self, body: str, i: int | None = -1, *, scale: float = 1.0,
              elements: slice | np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Return axis, top and bottom points (ne, ns, 2) of a body in state i (None: reference).

        Displacements are magnified by ``scale``; ``elements`` selects some of the elements.
        """
        return body_faces(self.body(body), self._scaled(i, scale), elements)

    def levels(self, body: str, i: int | None = -1, *, scale: float = 1.0,
               elements: slice | np.ndarray | None = None) -> np.ndarray:
        """Return points (3 + k, ne, ns, 2) on bottom, axis, top and k interfaces of layers; options as in ``faces``."""
        return body_levels(self.body(body), self._scaled(i, scale), elements)

    def displacement(self, body: str, s: np.ndarray, i: int = -1) -> np.ndarray:
        """Return the displacements (n, 2) of the axis at fractions s (n,) of a body's arc length in state i."""
        return axis_values(self.body(body), self.d(i), np.asarray(s, float))

    def reference(self, body: str, s: np.ndarray) -> np.ndarray:
        """Return the reference axis (n, 2) at fractions s (n,) of a body's arc length."""
        return axis_values(self.body(body), self.e0, np.asarray(s, float))

    def nodes(self, body: str, i: int | None = -1, *, scale: float = 1.0) -> np.ndarray:
        """Return the node positions (n, 2) of a body in state i (None: reference)."""
        return body_nodes(self.body(body), self._scaled(i, scale))

    @cached_property
    def _stored_fields(self) -> dict[str, dict[str, tuple[FieldRecord, StateRows]]]:
        with safe.damage(self.path):
            found = safe.groups(safe.child(self._file, "fields", h5py.Group))
            return {body: {name: self._field(record, name, g, values)
                           for name, g in safe.groups(found[body]).items()
                           if (values := safe.child(g, "values", h5py.Dataset)) is not None}
                    for body, record in self.bodies.items() if body in found}

    @staticmethod
    def _field(body: BodyRecord, name: str, group: h5py.Group, values: h5py.Dataset) -> tuple[FieldRecord, StateRows]:
        record = FieldRecord(body.name, name, tuple(safe.strings(group, "components")),
                             str(safe.attribute(group, "units", "1")), str(safe.attribute(group, "description", "")),
                             safe.stations(group, len(body.dofs)), safe.numbers(group, "eta", 1))
        return record, StateRows(values, (len(body.dofs), *record.stations, len(record.components)))

    @cached_property
    def fields(self) -> dict[str, dict[str, FieldRecord]]:
        """The fields stored over the bodies: ``fields[body][name]``, in the units of the file."""
        return {body: {name: one for name, (one, _) in found.items()} for body, found in self._stored_fields.items()}

    def refused(self, field: str) -> str:
        """Return why the case cannot store a field; empty if it can or if this is unknown."""
        return ""

    def _field_rows(self, body: str, name: str) -> StateRows:
        found = self._stored_fields.get(body, {}).get(name)
        if found is None:
            raise ResultsError(f"{self.called} has no field '{name}' of body '{body}'")
        return found[1]

    def field(self, body: str, name: str, i: int = -1) -> np.ndarray:
        """Return the values (ne, nx, ny, components) of a field over a body in state i; see ``fields``."""
        rows, number = self._field_rows(body, name), self._number(i)
        with safe.damage(self.path):
            return rows.row(number)

    def field_blocks(self, body: str, name: str) -> Iterator[np.ndarray]:
        """Yield a field in blocks of consecutive states (n, ne, nx, ny, components); see ``blocks``."""
        return self._blocks(self._field_rows(body, name))

    @cached_property
    def history(self) -> Table:
        """Solver statistics by name, one value per step."""
        with safe.damage(self.path):
            return read_columns(safe.child(self._file, "history", h5py.Group), self._history_rows)

    @cached_property
    def energies(self) -> Table:
        """Energies by name, one value per stored state (dynamic runs)."""
        with safe.damage(self.path):
            return read_columns(safe.child(self._file, "energies", h5py.Group), self.nt)

    @cached_property
    def checkpoint(self) -> Checkpoint | None:
        """The checkpoint of an unfinished run, from which it can be resumed; None if it has none."""
        with safe.damage(self.path):
            return checkpoint_of(self._file)

    @cached_property
    def _all_probes(self) -> dict[str, Table]:
        with safe.damage(self.path):
            found = safe.groups(safe.child(self._file, "probes", h5py.Group))
            return {name: read_columns(g, self._probe_rows) for name, g in found.items()}

    @cached_property
    def probes(self) -> dict[str, Table]:
        """Probe quantities: ``probes[name][quantity]`` is an array along ``probe_t``."""
        probes = {}
        for name, columns in self._all_probes.items():
            probes[name] = Table()
            probes[name].update({k: v for k, v in columns.items() if k != "t"})
            probes[name].units = columns.units
        return probes

    @cached_property
    def probe_t(self) -> np.ndarray:
        """Load factor or time of each reading of the probes."""
        return next((p["t"] for p in self._all_probes.values() if "t" in p), np.empty(0))

    @cached_property
    def tables(self) -> dict[str, Table]:
        """The tables by name, such as ``convergence``."""
        with safe.damage(self.path):
            return read_tables(safe.groups(safe.child(self._file, "tables", h5py.Group)))

    @cached_property
    def arrays(self) -> dict[str, h5py.Dataset]:
        """Further numeric datasets below /arrays by their path; read them with ``array``."""
        with safe.damage(self.path):
            return safe.datasets(safe.child(self._file, "arrays", h5py.Group))

    def array(self, path: str) -> np.ndarray:
        """Return one of ``arrays`` as a NumPy array. Raises ResultsError if there is none at this path."""
        if path not in self.arrays:
            raise ResultsError(f"{self.called} has no array '{path}' (arrays: {', '.join(self.arrays) or 'none'})")
        with safe.damage(self.path):
            dataset = self.arrays[path]
            return safe.values(dataset, dataset.ndim)

    __repr__, _repr_html_, to_xarray = one_line, as_html, to_xarray

    def release(self, then: Callable[[], None]) -> None:
        """Close the file and call ``then`` as soon as these results are garbage-collected."""
        weakref.finalize(self, _close, self._file, then)

    def close(self) -> None:
        """Close the file; nothing can be read from it afterwards."""
        self._file.close()

    def __exit__(self, *_: object) -> None:
        self.close()


# raises ResultsError, which explains the problem of a file and what to do
open_results = Results
