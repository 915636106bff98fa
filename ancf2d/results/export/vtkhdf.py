"""Bodies for ParaView: VTKHDF 2.0, one unstructured grid with a step per stored state.

Each body is there twice: as quadrilaterals over its true section, from the element's own shape functions, and as its
axis, one polyline; the cell field ``centreline`` tells them apart, ``body`` which body it is. A grid of both kinds of
cells is read by every program that reads the format, with its steps; collections of grids are not.

Source: VTKHDF format specification, docs.vtk.org.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.polynomial.legendre import legvander

from ancf2d.errors import ResultsError
from ancf2d.results.export import Done
from ancf2d.results.geometry import body_faces, body_rates
from ancf2d.results.journal import JournaledFile
from ancf2d.results.reader import Results
from ancf2d.results.records import BodyRecord, FieldRecord

QUAD, POLYLINE = 9, 4  # VTK's numbers of these cells
FACES = ("bottom", "axis", "top")
MOST_CELLS = 2_000  # along all elements together, as long as every element has one
CHUNK = 1 << 14  # points
COMPRESSED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
MODES = "modes/shapes"


@dataclass
class Part:
    """One body in the grid: its points are elements x levels (faces) x columns (samples along), from ``first`` on."""

    number: int
    body: BodyRecord
    levels: tuple[int, ...]
    columns: np.ndarray
    first: int

    @property
    def shape(self) -> tuple[int, int, int]:
        """Elements, levels, columns."""
        return len(self.body.dofs), len(self.levels), len(self.columns)

    @property
    def points(self) -> int:
        """Number of points."""
        return int(np.prod(self.shape))

    def take(self, faces: dict[str, np.ndarray]) -> np.ndarray:
        """Return what ``body_faces`` tells of the part's points (points, 3)."""
        out = np.zeros((*self.shape, 3))
        for k, level in enumerate(self.levels):
            out[:, k, :, :2] = faces[FACES[level]][:, self.columns]
        return out.reshape(-1, 3)

    def cells(self) -> Iterator[tuple[int, np.ndarray]]:
        """Yield kind and points (cells, n) of the quadrilaterals, then of the axis."""
        at = self.first + np.arange(self.points).reshape(self.shape)
        if len(self.levels) > 1:
            low, high = at[:, :-1], at[:, 1:]
            corners = (low[..., :-1], low[..., 1:], high[..., 1:], high[..., :-1])
            yield QUAD, np.stack(corners, -1).reshape(-1, 4)
        axis = at[:, self.levels.index(1)]
        # elements meet: the end of one is the beginning of the next
        yield POLYLINE, np.append(axis[0, 0], axis[:, 1:])[None]

    def interpolated(self, record: FieldRecord, values: np.ndarray) -> np.ndarray:
        """Return a field (ne, nx, ny, components) at the part's points: the polynomial through its stations."""
        along = _weights(2 * record.xi - 1, 2 * self.body.sample_xi[self.columns] - 1)
        across = _weights(record.eta, np.array(self.levels) - 1.0)
        return np.einsum("ai,bj,eijc->ebac", along, across, values, optimize=True).reshape(self.points, -1)


def _weights(stations: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return weights (len(at), n) of the polynomial through n values at ``stations`` in [-1, 1]."""
    degree = len(stations) - 1
    return legvander(at, degree) @ np.linalg.inv(legvander(stations, degree))


def make_parts(results: Results) -> list[Part]:
    """Return the bodies of a result file as parts of one grid. Raises ResultsError where there is none."""
    bodies = list(results.bodies.values())
    if not bodies:
        raise ResultsError(f"'{results.path}' holds no bodies to draw")
    elements, parts, first = sum(len(b.dofs) for b in bodies), [], 0
    for number, body in enumerate(bodies):
        last = len(body.sample_xi) - 1
        steps = (n for n in range(1, last + 1) if last % n == 0)
        step = next((n for n in steps if elements * (last // n) <= MOST_CELLS), last)
        thick = np.isfinite(body.height) and body.height > 0
        part = Part(number, body, (0, 1, 2) if thick else (1,), np.arange(0, last + 1, step), first)
        parts.append(part)
        first += part.points
    return parts


def write(results: Results, path: Path, done: Done) -> None:
    """Write the grid of all bodies, state by state: points, displacement, velocity where stored, fields, modes."""
    parts = make_parts(results)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        stream = JournaledFile(descriptor)  # HDF5 by itself does not survive a full disk
        _fill(stream, results, parts, done)
        stream.commit()
    finally:
        os.close(descriptor)


def _fill(stream: JournaledFile, results: Results, parts: list[Part], done: Done) -> None:
    """Write the grid to an empty file. Raises OSError where the disk takes no more."""
    with h5py.File(stream, "w") as file:
        # outside of the grid: readers of the format differ in the texts that they can read, and some crash
        file.attrs["bodies"] = [part.body.name for part in parts]
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0], np.int64)
        root.attrs.create("Type", b"UnstructuredGrid", dtype=h5py.string_dtype("ascii", len(b"UnstructuredGrid")))
        grid = _Grid(results, root, parts)
        grid.write_cells()
        grid.write_modes()
        for i in range(grid.steps):
            grid.write_state(i)
            stream.check()
            done((i + 1) / grid.steps)
        grid.write_steps()


class _Grid:
    """The datasets of one grid; what does not change with the steps is written once."""

    def __init__(self, results: Results, root: h5py.Group, parts: list[Part]) -> None:
        self.results, self.root, self.parts = results, root, parts
        self.steps = max(results.nt, 1)
        self.n = sum(p.points for p in parts)
        self.moves = results.nt > 0 and results.holds("v")
        self.reference = self._points(results.e0)
        self.point_data, self.cell_data = root.create_group("PointData"), root.create_group("CellData")
        self.constant = ["body"]
        self.fields = self._fields() if results.nt else {}
        self._growing(root, "Points", (3,))
        for name in ("displacement", *(["velocity"] if self.moves else [])):
            self._growing(self.point_data, name, (3,))
        for name in self.fields:
            self._growing(self.point_data, name, ())
        self.growing = list(self.point_data)

    def _fields(self) -> dict[str, tuple[str, str]]:
        """Return field and component of each stored number: ``stress_xx``, or ``M`` where there is one component."""
        return {field if len(record.components) == 1 else f"{field}_{component}": (field, component)
                for fields in self.results.fields.values() for field, record in fields.items()
                for component in record.components}

    def _growing(self, group: h5py.Group, name: str, width: tuple[int, ...]) -> None:
        shape = (self.steps * self.n, *width)
        group.create_dataset(name, shape, np.float64, chunks=(min(self.n, CHUNK), *width), **COMPRESSED)

    def _points(self, e: np.ndarray) -> np.ndarray:
        return np.vstack([p.take(body_faces(p.body, e)) for p in self.parts])

    def _rates(self, e: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.vstack([p.take(body_rates(p.body, e, v)) for p in self.parts])

    def write_cells(self) -> None:
        """Write cells, and which body points and cells belong to."""
        cells = [(p.number, kind, points) for p in self.parts for kind, points in p.cells()]
        ids = np.concatenate([points.ravel() for _, _, points in cells])
        sizes = np.concatenate([np.full(len(points), points.shape[1]) for _, _, points in cells])
        counts = [len(points) for _, _, points in cells]
        for name, value in (("NumberOfPoints", self.n), ("NumberOfCells", len(sizes)),
                            ("NumberOfConnectivityIds", len(ids))):
            self.root[name] = np.full(1, value, np.int64)
        self._fixed(self.root, "Connectivity", ids.astype(np.int64))
        self._fixed(self.root, "Offsets", np.append(0, np.cumsum(sizes)).astype(np.int64))
        self._fixed(self.root, "Types", np.repeat([kind for _, kind, _ in cells], counts).astype(np.uint8))
        self._fixed(self.cell_data, "body", np.repeat([number for number, _, _ in cells], counts).astype(np.int32))
        self._fixed(self.cell_data, "centreline",
                    np.repeat([kind == POLYLINE for _, kind, _ in cells], counts).astype(np.uint8))
        numbers = np.repeat([p.number for p in self.parts], [p.points for p in self.parts])
        self._fixed(self.point_data, "body", numbers.astype(np.int32))

    @staticmethod
    def _fixed(group: h5py.Group, name: str, data: np.ndarray) -> None:
        group.create_dataset(name, data=data, chunks=(min(len(data), CHUNK),), **COMPRESSED)

    def write_modes(self) -> None:
        """Write modes of vibration or buckling as displacements from the last state."""
        if MODES not in self.results.arrays:
            return
        e = self.results.e(-1) if self.results.nt else self.results.e0
        for k, shape in enumerate(np.atleast_2d(self.results.array(MODES)), start=1):
            if np.isrealobj(shape) and shape.shape == e.shape:
                self.point_data[f"mode_{k}"] = self._rates(e, shape)
                self.constant.append(f"mode_{k}")

    def write_state(self, i: int) -> None:
        """Write points and point fields of one state."""
        results, rows = self.results, slice(i * self.n, (i + 1) * self.n)
        e = results.e(i) if results.nt else results.e0
        points = self._points(e)
        self.root["Points"][rows] = points
        self.point_data["displacement"][rows] = points - self.reference
        if self.moves:
            self.point_data["velocity"][rows] = self._rates(e, results.v(i))
        self._write_fields(i, rows)

    def _write_fields(self, i: int, rows: slice) -> None:
        """Write the fields of a state; on bodies without one they are not a number."""
        values = {name: np.full(self.n, np.nan) for name in self.fields}
        for p in self.parts:
            for field, record in self.results.fields.get(p.body.name, {}).items():
                found = p.interpolated(record, self.results.field(p.body.name, field, i))
                for name, (own, component) in self.fields.items():
                    if own == field and component in record.components:
                        values[name][p.first:p.first + p.points] = found[:, record.components.index(component)]
        for name, column in values.items():
            self.point_data[name][rows] = column

    def write_steps(self) -> None:
        """Write where each step begins in the datasets: those of cells and of constant fields have one for all."""
        steps = self.root.create_group("Steps")
        steps.attrs["NSteps"] = np.int64(self.steps)
        steps["Values"] = self.results.t if self.results.nt else np.zeros(1)
        begin, same = np.arange(self.steps, dtype=np.int64) * self.n, np.zeros(self.steps, np.int64)
        steps["PartOffsets"], steps["PointOffsets"] = same, begin
        steps["NumberOfParts"] = np.ones(self.steps, np.int64)
        steps["CellOffsets"], steps["ConnectivityIdOffsets"] = same[:, None], same[:, None]
        for name in self.growing:
            steps[f"PointDataOffsets/{name}"] = begin
        for name in self.constant:
            steps[f"PointDataOffsets/{name}"] = same
        for name in self.cell_data:
            steps[f"CellDataOffsets/{name}"] = same
