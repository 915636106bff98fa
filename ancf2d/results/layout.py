"""Contents of a result file: case, versions and mesh, which never change, and the growing states of a run."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from typing import Any

import h5py
import numpy as np

from ancf2d import __version__
from ancf2d.errors import ResultsError
from ancf2d.results.records import (
    FORMAT,
    FORMAT_VERSION,
    BodyRecord,
    Column,
    FieldRecord,
    Units,
    escape,
    known_column,
    unescape,
)
from ancf2d.results.series import CHUNK_BYTES, Series, set_text, write_fixed, write_texts

PACKAGES = ("numpy", "scipy", "numba", "h5py")
STATE_FIELDS = ("d", "v", "a")  # with nq numbers per state
BODIES = "turned"  # with one number per body and state


@cache
def versions() -> dict[str, str]:
    """Return the versions that a result depends on, read once and without importing the packages."""
    found = {"ancf2d": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def provenance(case_text: str) -> dict[str, str]:
    """Return the root attributes on when, where and with which versions a result was made."""
    found = {f"version_{name}": version for name, version in versions().items()}
    found["platform"] = platform.platform()
    found["created"] = datetime.now(UTC).isoformat(timespec="seconds")
    found["case_sha256"] = hashlib.sha256(case_text.encode("utf-8", "replace")).hexdigest()
    return found


def coordinate_units(units: Units) -> str:
    """Return the units of nodal coordinates; the names of the coordinates tell which unit applies."""
    length = units.length
    return f"{length}; slopes 1; angles rad; d^k r/dy^k {length}^(1-k)"


def write_head(file: h5py.File, header: Mapping[str, Any], units: Units) -> None:
    """Write the root attributes and the case."""
    case_text = header.get("case_text") or ""
    attributes = {
        "format": FORMAT, "format_version": FORMAT_VERSION, "status": "running",
        **{k: header.get(k) or "" for k in ("title", "solver", "case_name", "case_files", "command_line")},
        **{f"units_{k}": getattr(units, k) for k in ("length", "force", "time")},
        **provenance(case_text),
    }
    for name, value in attributes.items():
        if isinstance(value, str):
            set_text(file, name, value)
        else:
            file.attrs[name] = value
    # rows of states, history and probes that are known to be on disk
    file.attrs["committed"] = np.zeros(3, np.int64)
    case = file.create_group("case")
    completed = header.get("case_completed") or ""
    write_texts(case, "text", case_text, "none", "the case as given")
    write_texts(case, "completed", completed, "none",
                "the case as completed with defaults and overrides")
    overrides = [str(o) for o in header.get("overrides") or []]
    write_texts(case, "overrides", overrides, "none", "PATH=VALUE given on the command line")


def write_mesh(file: h5py.File, units: Units, bodies: Sequence[BodyRecord], e0: np.ndarray,
               names: Mapping[str, Sequence[str]]) -> None:
    """Write reference coordinates ``e0`` (nq,) and the bodies, after checking that they fit."""
    mesh = file.create_group("mesh")
    write_fixed(mesh, "e0", e0, coordinate_units(units), "nodal coordinates in the reference",
                compress=True)
    group = mesh.create_group("bodies", track_order=True)
    for body in bodies:
        body.check(len(e0))
        _write_body(group.create_group(escape(body.name)), body, units.length,
                    names.get(body.name, body.coordinate_names))


def write_fields(file: h5py.File, units: Units, fields: Sequence[FieldRecord]) -> None:
    """Write the constant data of the fields to /fields/BODY/NAME, before there is a state."""
    for field in fields:
        bodies = file.require_group("fields")
        group = bodies.require_group(escape(field.body)).create_group(field.name)
        set_text(group, "units", units.fill(field.units))
        set_text(group, "description", field.description)
        write_texts(group, "components", field.components, "none", "components, in the order of the last index")
        write_fixed(group, "xi", field.xi, "1", "stations along an element, 0 to 1" + (
            ", of each element" if field.xi.ndim > 1 else ""))
        write_fixed(group, "eta", field.eta, "1", "stations across it, y/(h/2)")


def _write_body(group: h5py.Group, body: BodyRecord, length: str, names: Sequence[str]) -> None:
    for name in ("name", "element_type", "formulation", "section_kind"):
        set_text(group, name, str(getattr(body, name)))
    for name in ("height", "width"):
        value = getattr(body, name)
        group.attrs[name] = np.nan if value is None else float(value)
        set_text(group, f"{name}_units", length)
    for name, units, text, kind in (
        ("dofs", "1", "columns of e0 and d for the coordinates of each element", int),
        ("nodes", "1", "global node numbers of each element", int),
        ("node_shape", "1", "shape function that is r at each node", int),
        ("classes", "1", "row of sample_S, sample_S_x and lengths of each element", int),
        ("lengths", length, "length of the elements of a class", float),
        ("sample_xi", "1", "sample points along an element, 0 to 1", float),
        ("sample_S", "1", "shape functions at bottom, axis, top and the lines between layers", float),
        ("sample_S_x", f"1/{length}", "dS/dx on the axis", float),
        ("arclength", "1", "S-coordinate of the element ends, 0 to 1", float),
        ("heights", length, "height of the sections at the sample points of each element, where it varies", float),
        ("levels", length, "y of bottom, axis, top and the lines between layers, where not -h/2, 0, h/2", float),
    ):
        value = getattr(body, name)
        if value is None:
            continue
        data = np.asarray(value, kind)
        if kind is int and (not data.size or data.max() < 2**31):
            data = data.astype(np.int32)
        write_fixed(group, name, data, units, text, compress=True)
    if names:
        write_texts(group, "coordinate_names", names, "none",
                    "names of one element's coordinates")


class Growth:
    """The growing columns of a result file, and the number of rows of each kind.

    There is one row of /states and /energies per stored state, one of /history per step and one of each of /probes per
    reading of the probes.
    """

    def __init__(self, file: h5py.File, nq: int, units: Units, dynamic: bool,
                 columns: Sequence[Column] = ()) -> None:
        self._file, self._units, self._dynamic = file, units, dynamic
        self._widths = dict.fromkeys(STATE_FIELDS, nq) | {BODIES: len(file["mesh/bodies"])}
        self._columns = {column.name: column for column in columns}
        self.states = self.logged = self.probed = 0
        self._groups: dict[str, h5py.Group] = {}
        self._fields: dict[str, Series] = {}
        self._over: dict[tuple[str, str], Series] = {}
        self._energies: dict[str, Series] = {}
        self._history: dict[str, Series] = {}
        self._probes: dict[tuple[str, str], Series] = {}

    @property
    def rows(self) -> tuple[int, int, int]:
        """The numbers of rows of states, history and probes."""
        return self.states, self.logged, self.probed

    @property
    def buffered_bytes(self) -> int:
        """The number of bytes that are not on disk yet."""
        return sum(series.buffered_bytes for series in self.all_series())

    @property
    def columns(self) -> int:
        """The number of columns."""
        return sum(1 for _ in self.all_series())

    def all_series(self) -> Iterator[Series]:
        """Yield every column."""
        for part in (self._fields, self._over, self._energies, self._history, self._probes):
            yield from part.values()

    # ------------------------------------------------------------------ states

    def state(self, t: float, history_row: int, arrays: Mapping[str, np.ndarray | None],
              energies: Mapping[str, float], fields: Mapping[tuple[str, str], np.ndarray]) -> None:
        """Add a state: ``arrays`` d, v, a (nq,), turned (bodies,) as far as known, ``fields`` by body and name."""
        self._field("t").append(float(t))
        self._field("history_row").append(history_row)
        for name, width in self._widths.items():
            row = arrays.get(name)
            if row is not None:
                self._store(name, row, width)
        for place, values in fields.items():
            self._field_over(place, np.size(values), self.states).append(np.ravel(values))
        for name, value in energies.items():
            self._column(self._energies, "energies", name, self.states).append(float(value))
        self.states += 1
        for series in self._energies.values():
            series.pad_to(self.states)

    def _store(self, name: str, row: np.ndarray, width: int) -> None:
        if np.shape(row) != (width,):
            raise ResultsError(f"'{name}' of a state has the shape {np.shape(row)}, not ({width},)")
        field = self._field(name)
        field.pad_to(self.states)
        if width * 8 >= CHUNK_BYTES:
            field.write_through(row)
        else:
            field.append(row)

    def _field(self, name: str) -> Series:
        if name not in self._fields:
            group = self._file.require_group("states")
            units, time_unit = coordinate_units(self._units), self._units.time
            labels = {
                "t": (time_unit, "time") if self._dynamic else ("1", "load factor"),
                "history_row": ("1", "row of /history of this state, -1 where it has none"),
                "d": (units, "displacements of the nodal coordinates: they are e0 + d"),
                "v": (f"({units})/{time_unit}", "rates of the nodal coordinates"),
                "a": (f"({units})/{time_unit}^2", "second rates of the nodal coordinates"),
                BODIES: ("rad", "rotation of the section at S = 0 of each body, counted through full turns"),
            }[name]
            self._fields[name] = Series(group, name, *labels, width=self._widths.get(name, 0),
                                        integer=name == "history_row")
        return self._fields[name]

    def _field_over(self, place: tuple[str, str], width: int, length: int) -> Series:
        if place not in self._over:
            group = self._file["fields"][escape(place[0])][place[1]]
            labels = (str(group.attrs["units"]), "values of each state (elements, xi, eta, components), in a row")
            self._over[place] = Series(group, "values", *labels, width=width)
            self._over[place].pad_to(length)
        return self._over[place]

    # ------------------------------------------------------------------ steps and probes

    def log(self, history: Mapping[str, float]) -> None:
        """Add one step to the history."""
        for name, value in history.items():
            self._column(self._history, "history", name, self.logged).append(value)
        self._logged_up_to(self.logged + 1)

    def log_block(self, columns: Mapping[str, np.ndarray]) -> None:
        """Add many steps to the history: columns (n,) of the same length."""
        lengths = {len(values) for values in columns.values()}
        if len(lengths) > 1:
            raise ResultsError(f"steps with columns of different lengths {sorted(lengths)}")
        for name, values in columns.items():
            self._column(self._history, "history", name, self.logged).extend(values)
        self._logged_up_to(self.logged + next(iter(lengths), 0))

    def _logged_up_to(self, rows: int) -> None:
        self.logged = rows
        for series in self._history.values():
            series.pad_to(rows)

    def probe(self, t: float, probes: Mapping[str, Mapping[str, float]]) -> None:
        """Add one row of probe quantities."""
        for probe, values in probes.items():
            self._probe_column(probe, "t").append(float(t))
            for quantity, value in values.items():
                self._probe_column(probe, quantity).append(value)
        self.probed += 1
        for (_, quantity), series in self._probes.items():
            if quantity == "t" and len(series) < self.probed:
                series.append(float(t))
            series.pad_to(self.probed)

    def _probe_column(self, probe: str, quantity: str) -> Series:
        key = (probe, quantity)
        if key not in self._probes:
            role = "history" if quantity == "t" else "probe"
            column = self._columns.get(quantity) or known_column(role, quantity)
            if quantity == "t" and not self._dynamic:
                column = Column("t", "1", "load factor")
            self._probes[key] = self._series(f"probes/{escape(probe)}", column)
            self._probes[key].pad_to(self.probed)
        return self._probes[key]

    def _column(self, found: dict[str, Series], place: str, name: str, length: int) -> Series:
        if name not in found:
            column = self._columns.get(name) or known_column("history", name)
            found[name] = self._series(place, column)
            found[name].pad_to(length)
        return found[name]

    def _series(self, place: str, column: Column) -> Series:
        return Series(self._group(place), escape(column.name), self._units.fill(column.units),
                      column.description, integer=column.integer)

    def _group(self, place: str) -> h5py.Group:
        if place not in self._groups:
            above, _, name = place.rpartition("/")
            parent = self._group(above) if above else self._file
            self._groups[place] = parent[name] if name in parent else parent.create_group(name, track_order=True)
        return self._groups[place]

    # ------------------------------------------------------------------ after an interruption

    def reopen(self, rows: Sequence[int]) -> None:
        """Reopen the columns of an earlier run, cut back to ``rows`` of states, history, probes."""
        self.states, self.logged, self.probed = rows
        for name in self._file.get("states", ()):
            self._field(name).reopen(self.states)
        for body, fields in self._file.get("fields", {}).items():
            for name, group in fields.items():
                if "values" in group:
                    self._field_over((unescape(body), name), group["values"].shape[1], 0).reopen(self.states)
        for key in self._file.get("energies", ()):
            self._column(self._energies, "energies", unescape(key), 0).reopen(self.states)
        for key in self._file.get("history", ()):
            self._column(self._history, "history", unescape(key), 0).reopen(self.logged)
        for probe, group in self._file.get("probes", {}).items():
            for key in group:
                self._reopen_probe(unescape(probe), unescape(key))

    def _reopen_probe(self, probe: str, quantity: str) -> None:
        rows, self.probed = self.probed, 0  # so that the new column is not padded before its rows are reopened
        self._probe_column(probe, quantity).reopen(rows)
        self.probed = rows
