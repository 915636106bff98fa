"""Stored data: states to the last bit, with names, units and order, in few bytes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from synthetic import HEADER, bent_beam, coordinates, tangent_body

from ancf2d.errors import ResultsError
from ancf2d.results import BodyRecord, Column, ResultWriter, open_results
from ancf2d.results import layout as growth_module
from ancf2d.results import series as series_module
from ancf2d.results import writer as writer_module
from ancf2d.results.journal import JournaledFile

HERE = Path(__file__).parent


def start(path: Path, ne: int = 2, **options: object) -> ResultWriter:
    e0 = coordinates("tangent", np.linspace(0, 1, ne + 1), 0.0)
    return ResultWriter(path, HEADER, [tangent_body("beam", ne, 1.0, 0.1)], e0, **options)


def test_states_read_back_bitwise(tmp_path: Path) -> None:
    states = np.random.default_rng(1).normal(size=(7, 12))
    with start(tmp_path / "a.h5") as w:
        for i, d in enumerate(states):
            w.append(i / 7, d, {"step": i}, {"p": {"x": d[0]}}, v=2 * d, a=3 * d)
        w.finish({"status": "converged"})
    with open_results(tmp_path / "a.h5") as r:
        np.testing.assert_array_equal([r.d(i) for i in range(7)], states)
        np.testing.assert_array_equal(r.v(-1), 2 * states[-1])
        np.testing.assert_array_equal(r.a(3), 3 * states[3])
        np.testing.assert_array_equal(r.e(2), r.e0 + states[2])
        np.testing.assert_array_equal(r.t, np.arange(7) / 7)
        np.testing.assert_array_equal(r.probes["p"]["x"], states[:, 0])
        assert r.history["step"].dtype == np.int64


def test_the_buffer_passed_in_may_be_reused(tmp_path: Path) -> None:
    d = np.zeros(12)
    with start(tmp_path / "a.h5") as w:
        for i in range(3):
            d[:] = i
            w.append(i, d)
        w.finish()
    with open_results(tmp_path / "a.h5") as r:
        assert [r.d(i)[0] for i in range(3)] == [0, 1, 2]


@pytest.mark.parametrize("flush", [0.0, 1e9], ids=["growing on disk", "exact at the end"])
def test_every_dataset_has_units_and_a_description(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                   flush: float) -> None:
    monkeypatch.setattr(writer_module, "FLUSH_SECONDS", flush)
    with start(tmp_path / "a.h5", columns=[Column("gap", "{L}", "opening")]) as w:
        w.append(0.5, np.zeros(12), {"step": 1, "energy": 2.0, "gap": 0.1},
                 {"tip": {"uy": 1.0, "M": 2.0}})
        w.table("convergence", {"element": ["cable"], "error": [0.1]})
        w.array("modes/shapes", np.eye(3), "{L}", "mode shapes")
        w.finish({})
    found = {}

    def collect(name: str, node: object) -> None:
        if isinstance(node, h5py.Dataset):
            found[name] = (node.attrs["units"], node.attrs["description"])

    with h5py.File(tmp_path / "a.h5") as f:
        f.visititems(collect)
        assert f.attrs["format"] == "ancf2d-results"
        assert f.attrs["format_version"] == 1
    assert all(units and text for units, text in found.values()), found
    units = {name: u for name, (u, _) in found.items()}
    assert units["probes/tip/uy"] == "m"
    assert units["probes/tip/M"] == "N*m"
    assert units["history/energy"] == "N*m"
    assert units["history/gap"] == "m"
    assert units["arrays/modes/shapes"] == "m"


def test_units_follow_the_header(tmp_path: Path) -> None:
    header = {"units": {"length": "mm", "force": "kN", "time": "ms"}, "solver": "dynamic"}
    path = bent_beam(tmp_path / "a.h5", header=header)
    with open_results(path) as r:
        assert r.units.length == "mm"
        assert r.probes["tip"].units["ux"] == "mm"
        assert r.probes["tip"].units["t"] == "ms"
        assert r.history.units["energy"] == "kN*mm"


def test_steps_between_states_reach_the_history_only(tmp_path: Path) -> None:
    with start(tmp_path / "a.h5") as w:
        w.log({"step": 1, "factor": 0.5}, t=0.5, probes={"p": {"x": 1.0}})
        w.append(1.0, np.zeros(12), {"step": 2, "factor": 1.0, "late": 7.0}, {"p": {"x": 2.0}})
        w.finish()
    with open_results(tmp_path / "a.h5") as r:
        assert r.nt == 1
        assert list(r.history["step"]) == [1, 2]
        np.testing.assert_array_equal(r.history["late"], [np.nan, 7.0])
        np.testing.assert_array_equal(r.probe_t, [0.5, 1.0])
        np.testing.assert_array_equal(r.probes["p"]["x"], [1.0, 2.0])


def test_rates_that_appear_late_are_nan_until_then(tmp_path: Path) -> None:
    with start(tmp_path / "a.h5") as w:
        w.append(0, np.zeros(12))
        w.append(1, np.zeros(12), v=np.ones(12))
        w.finish()
    with open_results(tmp_path / "a.h5") as r:
        assert np.isnan(r.v(0)).all()
        np.testing.assert_array_equal(r.v(1), 1.0)


def test_a_probe_that_appears_late_is_nan_until_then(tmp_path: Path,
                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_module, "FLUSH_SECONDS", 0.0)
    with start(tmp_path / "a.h5") as w:
        for i in range(3):
            w.append(i, np.zeros(12), {}, {"p": {"x": 1.0}} | ({"q": {"x": 5.0}} if i else {}))
        w.finish()
    with open_results(tmp_path / "a.h5") as r:
        np.testing.assert_array_equal(r.probes["q"]["x"], [np.nan, 5.0, 5.0])


def test_many_probes_keep_no_dataset_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """HDF5 holds 30 to 90 kB per open dataset: 20 000 probes would take more than 4 GB."""
    monkeypatch.setattr(writer_module, "FLUSH_SECONDS", 0.0)
    with start(tmp_path / "a.h5") as w:
        for i in range(2):
            w.append(i, np.zeros(12), {}, {f"p{k}": {"x": k + i} for k in range(20)})
            assert h5py.h5f.get_obj_count(w._file.id, h5py.h5f.OBJ_DATASET) == 0
        w.finish()
    with open_results(tmp_path / "a.h5") as r:
        np.testing.assert_array_equal(r.probes["p7"]["x"], [7.0, 8.0])


def test_slow_flushes_are_made_less_often(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr(writer_module.time, "monotonic", lambda: clock[0])
    flushed, commit = [], JournaledFile.commit

    def slow(stream: JournaledFile) -> None:
        flushed.append(clock[0])
        clock[0] += 4.0
        commit(stream)

    monkeypatch.setattr(JournaledFile, "commit", slow)
    with start(tmp_path / "a.h5") as w:
        for _ in range(200):
            clock[0] += 0.5
            w.append(clock[0], np.zeros(12))
        w.finish()
    assert flushed[0] == 1.0
    assert 4.0 * len(flushed) < 0.25 * clock[0]
    assert len(flushed) > 3


@pytest.mark.parametrize("name", ["a/b", ".", "..", "50%", "größe", "a%2Fb"])
def test_any_name_of_a_body_or_probe_survives(tmp_path: Path, name: str) -> None:
    e0 = coordinates("tangent", np.linspace(0, 1, 2), 0.0)
    with ResultWriter(tmp_path / "a.h5", {}, [tangent_body(name, 1, 1.0, 0.1)], e0) as w:
        w.append(0, 0 * e0, {}, {name: {"x": 1.0}})
        w.finish()
    with open_results(tmp_path / "a.h5") as r:
        assert list(r.bodies) == [name]
        assert list(r.probes) == [name]


def test_order_of_bodies_and_probes_is_kept(tmp_path: Path) -> None:
    names = ["rod", "crank", "a", "b10", "b9"]
    e0 = coordinates("tangent", np.linspace(0, 1, 2), 0.0)
    with ResultWriter(tmp_path / "a.h5", {}, [tangent_body(n, 1, 1.0, 0.1) for n in names],
                      e0) as w:
        w.append(0, 0 * e0, {}, {n: {"x": 1.0, "a": 2.0} for n in names})
        w.finish()
    with open_results(tmp_path / "a.h5") as r:
        assert list(r.bodies) == names
        assert list(r.probes) == names
        assert list(r.probes["rod"]) == ["x", "a"]


def test_small_files_stay_small_and_meshes_are_compressed(tmp_path: Path) -> None:
    assert bent_beam(tmp_path / "a.h5").stat().st_size < 40_000
    ne = 20_000
    e0 = coordinates("tangent", np.linspace(0, 1, ne + 1), 0.0)
    with ResultWriter(tmp_path / "b.h5", {}, [tangent_body("b", ne, 1.0, 0.1)], e0) as w:
        w.append(0, e0)
        w.finish()
    assert (tmp_path / "b.h5").stat().st_size < 2 * e0.nbytes
    with open_results(tmp_path / "b.h5") as r:
        np.testing.assert_array_equal(r.bodies["b"].dofs, tangent_body("b", ne, 1.0, 0.1).dofs)


def test_large_states_are_written_through_without_buffering(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(growth_module, "CHUNK_BYTES", 1 << 10)
    monkeypatch.setattr(series_module, "CHUNK_BYTES", 1 << 10)
    monkeypatch.setattr(series_module.Series, "append", _only_scalars(series_module.Series.append))
    with start(tmp_path / "a.h5", ne=100) as w:
        for i in range(3):
            w.append(i, np.arange(404.0) + i)
        w.finish()
    with open_results(tmp_path / "a.h5") as r:
        np.testing.assert_array_equal(r.d(2), np.arange(404.0) + 2)


def _only_scalars(append: object) -> object:
    def checked(self: object, row: object) -> None:
        assert np.ndim(row) == 0, "a large row was buffered"
        append(self, row)  # type: ignore[operator]
    return checked


def test_a_state_of_wrong_size_is_refused(tmp_path: Path) -> None:
    with start(tmp_path / "a.h5") as w, pytest.raises(ResultsError, match=r"shape \(11,\), not \(12,\)"):
        w.append(0, np.zeros(11))


def test_a_body_that_points_outside_the_coordinates_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match="dofs points outside"):
        ResultWriter(tmp_path / "a.h5", {}, [tangent_body("b", 3, 1.0, 0.1)], np.zeros(8))
    assert os.listdir(tmp_path) == []


def test_importing_results_does_not_import_matplotlib_or_numba() -> None:
    code = "import sys, ancf2d.results; print({'matplotlib', 'numba', 'scipy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                          cwd=HERE.parents[1])
    assert done.stdout.strip() == "set()"


def test_a_body_record_with_wrong_shapes_is_refused() -> None:
    body = tangent_body("b", 2, 1.0, 0.1)
    fields = {**body.__dict__, "arclength": np.zeros(2)}
    with pytest.raises(ResultsError, match="arclength has shape"):
        BodyRecord(**fields).check(12)
