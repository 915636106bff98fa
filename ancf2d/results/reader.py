"""Results in: a read-only view of one result file, checked and lazy."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.results import safe
from ancf2d.results.checkpoint import Checkpoint, checkpoint_of
from ancf2d.results.geometry import axis_values, body_faces, body_nodes
from ancf2d.results.records import BodyRecord, FieldRecord, Units, escape, unescape


class Table(dict[str, Any]):
    """Columns by name: arrays of numbers or lists of strings, with ``attrs`` and ``units``."""

    def __init__(self) -> None:
        super().__init__()
        self.attrs: dict[str, Any] = {}
        self.units: dict[str, str] = {}

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self.values()), ()))


class Results:
    """One open result file; states are read row by row when asked for.

    Of a file that a run is still writing it shows what was there when it was opened.
    Nodal coordinates of state i are ``e(i) = e0 + d(i)``; i counts from 0, negative from the end.
    Errors: ResultsError wherever the file is not what it says it is.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
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
        e0 = safe.child(self._mesh, "e0", h5py.Dataset)
        if e0 is None or e0.ndim != 1:
            raise ValueError("the nodal coordinates are missing")
        self.nq: int = e0.shape[0]
        self._states = safe.child(self._file, "states", h5py.Group)
        if self.nt and self._states is None:
            raise ValueError("the states are missing")

    # ------------------------------------------------------------------ about the run

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

    @cached_property
    def units(self) -> Units:
        """Labels of length, force and time."""
        return Units(*(self._attr(f"units_{k}") or getattr(Units, k)
                       for k in ("length", "force", "time")))

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The ``--json`` object of the run; empty while it is unfinished."""
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
        """The case as completed with defaults and overrides."""
        return self._case("completed")

    @property
    def overrides(self) -> list[str]:
        """The ``--set`` options of the run."""
        with safe.damage(self.path):
            return safe.strings(safe.child(self._file, "case", h5py.Group), "overrides")

    # ------------------------------------------------------------------ states

    @cached_property
    def e0(self) -> np.ndarray:
        """Reference nodal coordinates (nq,)."""
        with safe.damage(self.path):
            return safe.numbers(self._mesh, "e0", 1)

    @cached_property
    def t(self) -> np.ndarray:
        """Load factor or time of each stored state (nt,)."""
        with safe.damage(self.path):
            if not self.nt:
                return np.empty(0)
            return self._enough(safe.numbers(self._states, "t", 1), self.nt)

    @staticmethod
    def _enough(rows: np.ndarray, count: int) -> np.ndarray:
        if len(rows) < count:
            raise ValueError(f"{len(rows)} rows where {count} were stored")
        return rows[:count]

    def holds(self, name: str) -> bool:
        """Whether every stored state has ``name``: d, v or a."""
        with safe.damage(self.path):
            group = self._states
            dataset = None if group is None else safe.child(group, name, h5py.Dataset)
            return dataset is not None and len(dataset) >= self.nt

    def _row(self, name: str, i: int) -> np.ndarray:
        if not -self.nt <= i < self.nt:
            raise ResultsError(f"'{self.path}' has no state {i}: it holds {self.nt}")
        with safe.damage(self.path):
            dataset = safe.child(self._states, name, h5py.Dataset)
            if dataset is None or len(dataset) <= i % self.nt:
                raise ResultsError(f"'{self.path}' does not hold {name} of state {i}")
            if dataset.shape[1:] != (self.nq,):
                raise ValueError(f"/states/{name} has shape {dataset.shape}")
            return safe.numbers(self._states, name, 2, int(i) % self.nt)

    def rows(self, name: str) -> np.ndarray:
        """Return ``name`` (d, v or a) of all states at once (nt, nq); ResultsError where it was not stored."""
        if not (self.nt and self.holds(name)):
            raise ResultsError(f"'{self.path}' does not hold {name} of its states")
        with safe.damage(self.path):
            rows = self._enough(safe.numbers(self._states, name, 2), self.nt)
            if rows.shape[1] != self.nq:
                raise ValueError(f"/states/{name} has shape {rows.shape}")
            return rows

    def d(self, i: int) -> np.ndarray:
        """Displacements (nq,) of the nodal coordinates in state i."""
        return self._row("d", i)

    def e(self, i: int) -> np.ndarray:
        """Nodal coordinates (nq,) of state i."""
        e = self.d(i)
        e += self.e0
        return e

    def v(self, i: int) -> np.ndarray:
        """Rates (nq,) of the nodal coordinates in state i, where they were stored."""
        return self._row("v", i)

    def a(self, i: int) -> np.ndarray:
        """Second rates (nq,) of the nodal coordinates in state i, where they were stored."""
        return self._row("a", i)

    # ------------------------------------------------------------------ bodies

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
        fields["coordinate_names"] = tuple(safe.strings(group, "coordinate_names"))
        record = BodyRecord(**fields)
        record.check(self.nq)
        return record

    def body(self, name: str) -> BodyRecord:
        """Return a body by name, or raise ResultsError with the names that there are."""
        if name not in self.bodies:
            raise ResultsError(f"'{self.path}' has no body '{name}' (bodies: "
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

    def displacement(self, body: str, s: np.ndarray, i: int = -1) -> np.ndarray:
        """Return the displacements (n, 2) of the axis at fractions s (n,) of a body's arclength in state i."""
        return axis_values(self.body(body), self.d(i), np.asarray(s, float))

    def reference(self, body: str, s: np.ndarray) -> np.ndarray:
        """Return the reference axis (n, 2) at fractions s (n,) of a body's arclength."""
        return axis_values(self.body(body), self.e0, np.asarray(s, float))

    def nodes(self, body: str, i: int | None = -1, *, scale: float = 1.0) -> np.ndarray:
        """Return the node positions (n, 2) of a body in state i (None: reference)."""
        return body_nodes(self.body(body), self._scaled(i, scale))

    # ------------------------------------------------------------------ fields

    @cached_property
    def fields(self) -> dict[str, dict[str, FieldRecord]]:
        """The fields stored over the bodies: ``fields[body][name]``, in the units of the file."""
        with safe.damage(self.path):
            found = safe.groups(safe.child(self._file, "fields", h5py.Group))
            return {body: {name: self._field(body, name, g) for name, g in safe.groups(found[body]).items()
                           if safe.child(g, "values", h5py.Dataset) is not None}
                    for body in self.bodies if body in found}

    def _field(self, body: str, name: str, group: h5py.Group) -> FieldRecord:
        return FieldRecord(body, name, tuple(safe.strings(group, "components")),
                           str(safe.attribute(group, "units", "1")), str(safe.attribute(group, "description", "")),
                           safe.numbers(group, "xi", 1), safe.numbers(group, "eta", 1))

    def field(self, body: str, name: str, i: int = -1) -> np.ndarray:
        """Return the values (ne, nx, ny, components) of a field over a body in state i; see ``fields``."""
        record = self.fields.get(body, {}).get(name)
        if record is None:
            raise ResultsError(f"'{self.path}' has no field '{name}' of body '{body}'")
        if not -self.nt <= i < self.nt:
            raise ResultsError(f"'{self.path}' has no state {i}: it holds {self.nt}")
        with safe.damage(self.path):
            row = safe.numbers(self._file["fields"][escape(body)][name], "values", 2, int(i) % self.nt)
            return row.reshape(len(self.body(body).dofs), len(record.xi), len(record.eta), len(record.components))

    # ------------------------------------------------------------------ series and tables

    def _columns(self, group: h5py.Group | None, rows: int | None) -> Table:
        table = Table()
        for key in group or ():
            dataset = safe.child(group, key, h5py.Dataset)
            name = unescape(key)
            if dataset.dtype.kind == "S" and rows is None:  # texts stand in tables alone
                table[name] = safe.strings(group, key)
            else:
                values = safe.numbers(group, key, 1)
                table[name] = values if rows is None else self._enough(values, rows)
            table.units[name] = str(safe.attribute(dataset, "units", ""))
        return table

    @cached_property
    def history(self) -> Table:
        """Solver statistics by name, one value per step."""
        with safe.damage(self.path):
            group = safe.child(self._file, "history", h5py.Group)
            return self._columns(group, self._history_rows)

    @cached_property
    def energies(self) -> Table:
        """Energies by name, one value per stored state (dynamic runs)."""
        with safe.damage(self.path):
            return self._columns(safe.child(self._file, "energies", h5py.Group), self.nt)

    @cached_property
    def checkpoint(self) -> Checkpoint | None:
        """What the run can be resumed from, where it is unfinished and has got so far."""
        with safe.damage(self.path):
            return checkpoint_of(self._file)

    @cached_property
    def _all_probes(self) -> dict[str, Table]:
        with safe.damage(self.path):
            found = safe.groups(safe.child(self._file, "probes", h5py.Group))
            return {name: self._columns(g, self._probe_rows) for name, g in found.items()}

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
        """Load factor or time of the probes' values."""
        return next((p["t"] for p in self._all_probes.values() if "t" in p), np.empty(0))

    @cached_property
    def tables(self) -> dict[str, Table]:
        """The tables by name, such as ``convergence``."""
        with safe.damage(self.path):
            tables = {}
            found = safe.groups(safe.child(self._file, "tables", h5py.Group))
            for name, group in found.items():
                tables[name] = self._columns(group, None)
                tables[name].attrs = safe.attributes(group)
                if len({len(v) for v in tables[name].values()}) > 1:
                    raise ValueError(f"table '{name}' has columns of different lengths")
            return tables

    @cached_property
    def arrays(self) -> dict[str, h5py.Dataset]:
        """Further numeric datasets below /arrays by their path; read them with ``array``."""
        found: dict[str, h5py.Dataset] = {}

        def collect(group: h5py.Group | None, prefix: str, depth: int) -> None:
            for key in group or ():
                link = group.get(key, getclass=True)  # type: ignore[union-attr]
                if link is h5py.Group and depth < 8:
                    collect(safe.child(group, key, h5py.Group), f"{prefix}{key}/", depth + 1)
                elif link is h5py.Dataset:
                    found[prefix + key] = safe.child(group, key, h5py.Dataset)

        with safe.damage(self.path):
            collect(safe.child(self._file, "arrays", h5py.Group), "", 0)
        return found

    def array(self, path: str) -> np.ndarray:
        """Return one of ``arrays`` in full."""
        if path not in self.arrays:
            raise ResultsError(f"'{self.path}' has no array '{path}' "
                               f"(arrays: {', '.join(self.arrays) or 'none'})")
        with safe.damage(self.path):
            dataset = self.arrays[path]
            return safe.numbers(dataset.parent, dataset.name.rsplit("/", 1)[1], dataset.ndim)

    def close(self) -> None:
        """Close the file; whatever was not read by then cannot be read any more."""
        self._file.close()

    def __enter__(self) -> Results:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_results(path: str | os.PathLike[str]) -> Results:
    """Open a result file for reading; ResultsError says what is wrong with it and what to do."""
    return Results(path)
