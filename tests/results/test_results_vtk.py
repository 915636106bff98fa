"""Exported bodies read with VTK, on which ParaView is based."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic import BODIES, HEADER, bent_beam, mechanism

from ancf2d.results import ResultWriter, open_results
from ancf2d.results.export import export

hdf = pytest.importorskip("vtkmodules.vtkIOHDF")
from vtkmodules.util.numpy_support import vtk_to_numpy  # noqa: E402
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline  # noqa: E402

pytestmark = pytest.mark.slow


class Read:
    """A file read with VTK."""

    def __init__(self, path: Path) -> None:
        self.reader = hdf.vtkHDFReader()
        assert self.reader.CanReadFile(str(path))
        self.reader.SetFileName(str(path))
        self.reader.UpdateInformation()
        information = self.reader.GetOutputInformation(0)
        self.times = information.Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())

    def at(self, time: float) -> Any:
        self.reader.UpdateTimeStep(time)
        return self.reader.GetOutput()


def points(grid: Any) -> np.ndarray:
    return vtk_to_numpy(grid.GetPoints().GetData())


def array(data: Any, name: str) -> np.ndarray:
    return vtk_to_numpy(data.GetArray(name))


def cells(grid: Any, kind: int) -> list[np.ndarray]:
    """Return the points (n, 3) of every cell of a kind."""
    at, out = points(grid), []
    for k in range(grid.GetNumberOfCells()):
        if grid.GetCellType(k) == kind:
            ids = grid.GetCell(k).GetPointIds()
            out.append(at[[ids.GetId(i) for i in range(ids.GetNumberOfIds())]])
    return out


def area(corners: np.ndarray) -> float:
    x, y = corners[:, 0], corners[:, 1]
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@pytest.mark.parametrize("kind", BODIES)
def test_every_step_is_the_body_of_that_state(tmp_path: Path, kind: str) -> None:
    source = bent_beam(tmp_path / "a.h5", kind, ne=8, length=2.0, height=0.1, angle=1.0, steps=4)
    export(source, tmp_path / "a.vtkhdf")
    read = Read(tmp_path / "a.vtkhdf")
    assert read.times == pytest.approx([0, 0.25, 0.5, 0.75, 1])
    reference = points(read.at(0.0)).copy()
    with open_results(source) as r:
        for i, t in enumerate(read.times):
            grid = read.at(t)
            faces = r.faces("beam", i)
            wanted = np.stack([faces[name] for name in ("bottom", "axis", "top")], 1).reshape(-1, 2)
            np.testing.assert_allclose(points(grid)[:, :2], wanted, rtol=0, atol=1e-15)
            assert not points(grid)[:, 2].any()
            np.testing.assert_allclose(array(grid.GetPointData(), "displacement"), points(grid) - reference, atol=1e-15)


@pytest.mark.parametrize("kind", BODIES)
def test_quadrilaterals_fill_the_section_and_a_polyline_is_the_axis(tmp_path: Path, kind: str) -> None:
    """Of a straight body: areas add up to L h, all with one orientation; the axis has the length of the body."""
    export(bent_beam(tmp_path / "a.h5", kind, ne=8, length=2.0, height=0.1), tmp_path / "a.vtkhdf")
    read = Read(tmp_path / "a.vtkhdf")
    grid = read.at(0.0)
    areas = [area(c) for c in cells(grid, 9)]
    assert min(areas) > 0
    assert sum(areas) == pytest.approx(0.2, rel=1e-12)
    axis, = cells(grid, 4)
    assert np.linalg.norm(np.diff(axis, axis=0), axis=1).sum() == pytest.approx(2.0, rel=1e-12)
    centreline = array(grid.GetCellData(), "centreline")
    assert (centreline == 1).sum() == 1
    assert len(centreline) == len(areas) + 1
    # bent to an arc, the axis keeps its length
    bent, = cells(read.at(1.0), 4)
    assert np.linalg.norm(np.diff(bent, axis=0), axis=1).sum() == pytest.approx(2.0, rel=2e-3)


def test_several_bodies_are_distinguished(tmp_path: Path) -> None:
    source = mechanism(tmp_path / "a.h5", steps=5)
    export(source, tmp_path / "a.vtkhdf")
    read = Read(tmp_path / "a.vtkhdf")
    grid = read.at(read.times[-1])
    numbers, at = array(grid.GetPointData(), "body"), points(grid)
    with open_results(source) as r:
        for number, name in enumerate(r.bodies):
            wanted = np.stack([r.faces(name, -1)[f] for f in ("bottom", "axis", "top")], 1).reshape(-1, 2)
            np.testing.assert_allclose(at[numbers == number][:, :2], wanted, rtol=0, atol=1e-15)
    assert set(array(grid.GetCellData(), "body")) == {0, 1}
    assert len(cells(grid, 4)) == 2


def test_a_single_state_is_read_too(tmp_path: Path) -> None:
    source = bent_beam(tmp_path / "a.h5", steps=1)
    with open_results(source) as r:
        only = r.d(-1)
        record, e0 = r.bodies["beam"], r.e0
    with ResultWriter(tmp_path / "b.h5", HEADER, [record], e0) as w:
        w.append(1.0, only)
        w.finish()
    export(tmp_path / "b.h5", tmp_path / "b.vtkhdf")
    grid = Read(tmp_path / "b.vtkhdf").at(0.0)
    with open_results(source) as r:
        assert points(grid)[:, :2].max(axis=0) == pytest.approx(
            np.max([f.reshape(-1, 2).max(axis=0) for f in r.faces("beam", -1).values()], axis=0))
