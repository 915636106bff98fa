"""Export of bodies for ParaView: VTKHDF 2.0, one unstructured grid with a step per stored state.

Each body is contained twice: as quadrilaterals over its true section, from the element's own shape functions, and as
its axis, one polyline. The cell field ``centreline`` is 1 for the axis; ``body`` is the number of the body (-1: the
surface of an obstacle, as lines; -2: a tendon, as a line). A grid with both kinds of cells is read, with its steps, by
every program that reads the format; collections of grids are not.

Source: VTKHDF format specification, docs.vtk.org.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.results import safe
from ancf2d.results.export import Done
from ancf2d.results.geometry import (
    body_levels,
    body_rates,
    linear_weights,
    station_weights,
    weights_along,
)
from ancf2d.results.journal import JournaledFile
from ancf2d.results.obstacles import obstacles_of
from ancf2d.results.reader import Results
from ancf2d.results.records import BodyRecord, FieldRecord
from ancf2d.results.symbols import tendons_of
from ancf2d.results.target import MARK

QUAD, POLYLINE = 9, 4  # VTK's numbers of these cells
OBSTACLE, TENDON = -1, -2  # numbers instead of that of a body
SIDE = 1e-8  # distance from an interface between layers at which fields are taken, relative to half the height
MOST_CELLS = 2_000  # along all elements together, but at least one for each element
CHUNK = 1 << 14  # points
AT_ONCE = 1 << 13  # points written in one call, so that states of small grids are written together
# number of states that determine the visible part of a half plane; margin around the bodies, relative to their extent
LOOKS, BESIDE = 16, 0.25
CACHE = 1 << 20  # bytes of each dataset: one or two chunks, which are filled one after the other
COMPRESSED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
MODES = "modes/shapes"
_SUMS = "...ai,bj,...ijc->...bac"


@dataclass
class Part:
    """One body in the grid: its points are elements x levels x columns (samples along), from ``first`` on.

    ``levels`` are indices of ``body_levels``, ``eta`` the places of the fields on them. Bodies of layers have both
    faces of each layer, since stresses jump between layers. Cells are between the ``pairs`` of levels.
    """

    number: int
    body: BodyRecord
    levels: tuple[int, ...]
    eta: np.ndarray
    pairs: tuple[tuple[int, int], ...]
    columns: np.ndarray
    first: int

    @property
    def shape(self) -> tuple[int, int, int]:
        """The numbers of elements, levels and columns."""
        return len(self.body.dofs), len(self.levels), len(self.columns)

    @property
    def points(self) -> int:
        """The number of points."""
        return int(np.prod(self.shape))

    def take(self, levels: np.ndarray) -> np.ndarray:
        """Return the part's points (points, 3) from the result of ``body_levels``."""
        out = np.zeros((*self.shape, 3))
        for k, level in enumerate(self.levels):
            out[:, k, :, :2] = levels[level][:, self.columns]
        return out.reshape(-1, 3)

    def cells(self) -> Iterator[tuple[int, np.ndarray]]:
        """Yield kind and point numbers (cells, n) of the quadrilaterals, then of the axis."""
        at = self.first + np.arange(self.points).reshape(self.shape)
        if self.pairs:
            low, high = (at[:, [pair[k] for pair in self.pairs]] for k in (0, 1))
            corners = (low[..., :-1], low[..., 1:], high[..., 1:], high[..., :-1])
            yield QUAD, np.stack(corners, -1).reshape(-1, 4)
        axis = at[:, self.levels.index(1)]
        # neighbouring elements share their end point
        yield POLYLINE, np.append(axis[0, 0], axis[:, 1:])[None]


class Interpolation:
    """Interpolates a field from its stations to the points of a part: by polynomials, linearly across layers."""

    def __init__(self, part: Part, record: FieldRecord) -> None:
        self._part, self._record = part, record

    @cached_property
    def _factors(self) -> tuple[np.ndarray, np.ndarray, Any]:
        """The weights along and across, and the order of summation over them."""
        part, record = self._part, self._record
        along = weights_along(record, part.body.sample_xi[part.columns], np.arange(len(part.body.dofs)))
        layered = part.body.levels is not None and len(record.eta) > 1
        across = (linear_weights(record.eta, part.eta) if layered or len(record.eta) == 1 else
                  station_weights(0.5 * (1.0 + record.eta), 0.5 * (1.0 + part.eta)))
        shape = len(part.body.dofs), *record.stations, len(record.components)
        order, _ = np.einsum_path(_SUMS, along, across, np.broadcast_to(0.0, shape), optimize=True)
        return along, across, order

    def of(self, values: np.ndarray) -> np.ndarray:
        """Return the field (points, components) whose values at the stations are (ne, nx, ny, components).

        Raises ValueError if stations coincide.
        """
        # only once there are values: if these fit the stations, the weights are bounded by the size of the file
        along, across, order = self._factors
        return np.einsum(_SUMS, along, across, values, optimize=order).reshape(self._part.points, -1)


def make_parts(results: Results) -> list[Part]:
    """Return the bodies of a result file as parts of one grid. Raises ResultsError if it has none."""
    bodies = list(results.bodies.values())
    if not bodies:
        raise ResultsError(f"{results.called} holds no bodies to draw")
    elements, parts, first = sum(len(b.dofs) for b in bodies), [], 0
    for number, body in enumerate(bodies):
        last = len(body.sample_xi) - 1
        steps = (n for n in range(1, last + 1) if last % n == 0)
        step = next((n for n in steps if elements * (last // n) <= MOST_CELLS), last)
        part = Part(number, body, *_across(body), np.arange(0, last + 1, step), first)
        parts.append(part)
        first += part.points
    return parts


def _across(body: BodyRecord) -> tuple[tuple[int, ...], np.ndarray, tuple[tuple[int, int], ...]]:
    """Return levels, eta and pairs of a part."""
    if body.levels is None:
        thick = np.isfinite(body.height) and body.height > 0
        return ((0, 1, 2), np.linspace(-1, 1, 3), ((0, 1), (1, 2))) if thick else ((1,), np.zeros(1), ())
    ends = [0, *range(3, len(body.levels)), 2]
    layers = list(pairwise(ends))
    levels, eta = [k for pair in layers for k in pair], body.levels * (2.0 / body.height)
    sides = [value for low, high in layers for value in (eta[low] + SIDE, eta[high] - SIDE)]
    return ((*levels, 1), np.array([*sides, 0.0]), tuple((2 * k, 2 * k + 1) for k in range(len(layers))))


def write(results: Results, path: Path, done: Done) -> None:
    """Write the grid of all bodies, state by state: points, displacement, velocity if stored, fields, modes."""
    parts = make_parts(results)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        stream = JournaledFile(descriptor)  # plain HDF5 does not survive a full disk
        _fill(stream, results, parts, done)
        stream.commit()
    finally:
        os.close(descriptor)


def _fill(stream: JournaledFile, results: Results, parts: list[Part], done: Done) -> None:
    """Write the grid to an empty file. Raises OSError if the disk is full."""
    with h5py.File(stream, "w", rdcc_nbytes=CACHE) as file:
        # outside of the grid: readers of the format accept different texts, and some crash
        file.attrs["made_by"] = np.bytes_(MARK)
        file.attrs["bodies"] = [part.body.name for part in parts]
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0], np.int64)
        root.attrs.create("Type", b"UnstructuredGrid", dtype=h5py.string_dtype("ascii", len(b"UnstructuredGrid")))
        grid = _Grid(results, root, parts)
        grid.write_cells()
        grid.write_modes()
        at_once = max(1, AT_ONCE // grid.n)
        for first in range(0, grid.steps, at_once):
            stop = min(first + at_once, grid.steps)
            grid.write_states(first, stop)
            stream.check()
            done(stop / grid.steps)
        grid.write_steps()


class _Grid:
    """The datasets of one grid; those that are constant over the steps are written once."""

    def __init__(self, results: Results, root: h5py.Group, parts: list[Part]) -> None:
        self.results, self.root, self.parts = results, root, parts
        self.steps = max(results.nt, 1)
        # visible parts and lines of obstacles and tendons, which follow after the bodies
        self.shown = self._shown_parts()
        self.lines = self._lines(None)
        self.of_bodies = sum(p.points for p in parts)
        self.n = self.of_bodies + sum(len(line) for _, line in self.lines)
        self.moves = results.nt > 0 and results.holds("v")
        self.reference = self._points(results.e0, None)
        self.point_data, self.cell_data = root.create_group("PointData"), root.create_group("CellData")
        self.constant = ["body"]
        self.fields = list(self._fields()) if results.nt else []
        self.points = self._growing(root, "Points", (3,))
        names = dict.fromkeys(name for *_, columns in self.fields for name in columns)
        self.growing = {name: self._growing(self.point_data, name, (3,))
                        for name in ("displacement", *(["velocity"] if self.moves else []))}
        self.growing.update({name: self._growing(self.point_data, name, ()) for name in names})

    def _fields(self) -> Iterator[tuple[Part, str, Interpolation, list[str]]]:
        """Yield part, field, interpolation and names of components: ``stress_xx``, or ``M`` if it is the only one."""
        for part in self.parts:
            for field, record in self.results.fields.get(part.body.name, {}).items():
                names = [field if len(record.components) == 1 else f"{field}_{c}" for c in record.components]
                yield part, field, Interpolation(part, record), names

    def _growing(self, group: h5py.Group, name: str, width: tuple[int, ...]) -> h5py.Dataset:
        shape = (self.steps * self.n, *width)
        return group.create_dataset(name, shape, np.float64, chunks=(min(self.n, CHUNK), *width), **COMPRESSED)

    def _shown_parts(self) -> dict[str, np.ndarray]:
        """Return the part of each endless line next to the bodies, as fractions from its start (0) to its end (1)."""
        endless = [solid for solid in obstacles_of(self.results, None, 1.0) if solid.endless]
        if not endless:
            return {}
        states = np.unique(np.linspace(0, self.results.nt - 1, min(self.results.nt, LOOKS)).astype(int)).tolist()
        low, high = np.full(2, np.inf), np.full(2, -np.inf)
        for e in (self.results.e0 if i is None else self.results.e(i) for i in (None, *states)):
            for part in self.parts:
                places = part.take(body_levels(part.body, e))[:, :2]
                low, high = np.fmin(low, places.min(axis=0)), np.fmax(high, places.max(axis=0))
        corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
        out = {}
        for solid in endless:
            start, way = solid.lines[0][0], solid.lines[0][1] - solid.lines[0][0]
            s = (corners - start) @ way / (way @ way)
            room = BESIDE * float((high - low).max()) / float(np.linalg.norm(way))
            out[solid.name] = np.clip([s.min() - room, s.max() + room], 0.0, 1.0)
        return out

    def _lines(self, state: int | None) -> list[tuple[int, np.ndarray]]:
        solids = obstacles_of(self.results, state, 1.0)
        shown = ((solid.name, line) for solid in solids for line in solid.lines)
        return [*((OBSTACLE, line[0] + np.outer(self.shown[name], line[-1] - line[0]) if name in self.shown else line)
                  for name, line in shown),
                *((TENDON, line) for line in tendons_of(self.results, state))]

    def _points(self, e: np.ndarray, state: int | None) -> np.ndarray:
        lines = [np.pad(line, ((0, 0), (0, 1))) for _, line in self._lines(state)]
        return np.vstack([*(p.take(body_levels(p.body, e)) for p in self.parts), *lines])

    def _rates(self, e: np.ndarray, v: np.ndarray) -> np.ndarray:
        rest = np.full((self.n - self.of_bodies, 3), np.nan)
        return np.vstack([*(p.take(body_rates(p.body, e, v)) for p in self.parts), rest])

    def write_cells(self) -> None:
        """Write the cells, and the body of each point and cell."""
        cells = [(p.number, kind, points) for p in self.parts for kind, points in p.cells()]
        first, numbers = self.of_bodies, np.full(self.n, OBSTACLE)
        for number, line in self.lines:
            cells.append((number, POLYLINE, np.arange(first, first + len(line))[None]))
            numbers[first:first + len(line)] = number
            first += len(line)
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
                    np.repeat([kind == POLYLINE and number >= 0 for number, kind, _ in cells],
                              counts).astype(np.uint8))
        for p in self.parts:
            numbers[p.first:p.first + p.points] = p.number
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

    def write_states(self, first: int, stop: int) -> None:
        """Write points and point fields of the states from ``first`` up to ``stop``."""
        found = [self._state(i) for i in range(first, stop)]
        rows = slice(first * self.n, stop * self.n)
        self.points[rows] = np.concatenate([points for points, _ in found])
        for name, dataset in self.growing.items():
            dataset[rows] = np.concatenate([values[name] for _, values in found])

    def _state(self, i: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return the points of a state and their fields by name, NaN on bodies without a field."""
        results = self.results
        e = results.e(i) if results.nt else results.e0
        points = self._points(e, i if results.nt else None)
        values = {name: np.full(self.n, np.nan) for name in self.growing}
        values["displacement"] = points - self.reference
        if self.moves:
            values["velocity"] = self._rates(e, results.v(i))
        for part, field, interpolation, names in self.fields:
            stored = results.field(part.body.name, field, i)
            with safe.damage(results.path):
                found = interpolation.of(stored)
            for column, name in zip(found.T, names, strict=True):
                values[name][part.first:part.first + part.points] = column
        return points, values

    def write_steps(self) -> None:
        """Write the offset of each step in the datasets; cells and constant fields are shared by all steps."""
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
