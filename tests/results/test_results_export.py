"""Results in other formats: complete, with the contents of the result file, or not written at all."""

from __future__ import annotations

import csv
import json
import re
import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest
from synthetic import BODIES, HEADER, bent_beam, coordinates, mechanism, table_file, tangent_body, theta_body

from ancf2d.case import load_case_text
from ancf2d.errors import ResultsError
from ancf2d.results import FieldRecord, ResultWriter, open_results
from ancf2d.results.export import FORMATS, export, format_of, plain, vtkhdf
from ancf2d.study.run import run_case

KINDS = pytest.mark.parametrize("kind", BODIES)
OMEGA = 3.0


def turning(path: Path, kind: str, steps: int = 4) -> Path:
    """Write a straight body that rotates about the origin with OMEGA, with its velocities."""
    x = np.linspace(0, 2, 5)
    e0 = coordinates(kind, x, 0.0)
    with ResultWriter(path, {**HEADER, "solver": "dynamic"}, [BODIES[kind]("rod", 4, 2.0, 0.3)], e0) as w:
        for t in np.linspace(0, 1, steps + 1):
            a = OMEGA * t
            cos, sin = np.cos(a) + 0 * x, np.sin(a) + 0 * x
            columns = {"tangent": (x * cos, x * sin, cos, sin), "interpolated": (x * cos, x * sin, -sin, cos),
                       "theta": (x * cos, x * sin, a + 0 * x)}[kind]
            rates = {"tangent": (-x * sin, x * cos, -sin, cos), "interpolated": (-x * sin, x * cos, -cos, -sin),
                     "theta": (-x * sin, x * cos, 1 + 0 * x)}[kind]
            w.append(t, np.stack(columns, 1).ravel() - e0, v=OMEGA * np.stack(rates, 1).ravel())
        return w.finish()


def linear_model(path: Path) -> Path:
    """Write a linear model of one state."""
    with ResultWriter(path, HEADER, [], np.zeros(0)) as w:
        for name in "ABCD":
            w.array(f"state_space/{name}", np.ones((1, 1)), "1", name)
        for name in ("input", "output", "state"):
            w.table(f"{name}s", {name: ["one"]})
        return w.finish()


def grid(path: Path) -> h5py.Group:
    return h5py.File(path, "r")["VTKHDF"]


# ---------------------------------------------------------------------------- files

def test_every_format_is_recognised_by_its_suffix() -> None:
    assert [format_of(f"a{suffix.upper()}").suffix for suffix in FORMATS] == list(FORMATS)
    for path, said in (("a.xdmf", f"unknown suffix '.xdmf' (known: {', '.join(FORMATS)})"), ("a", "no suffix")):
        with pytest.raises(ResultsError, match=re.escape(said)):
            format_of(path)


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_file_is_replaced_only_with_force_and_only_by_a_complete_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                                       suffix: str) -> None:
    make = linear_model if suffix in (".npz", ".mat") else bent_beam
    source, path = make(tmp_path / "a.h5"), tmp_path / f"b{suffix}"
    path.write_text("mine")
    with pytest.raises(ResultsError, match=r"was not made by ancf2d; .* replace it with --force"):
        export(source, path)

    def cut_off(self: object, results: object, file: Path, done: object) -> None:
        file.write_text("half")
        raise OSError(28, "No space left on device")
    with monkeypatch.context() as patch:
        patch.setattr("ancf2d.results.export.Format.write", cut_off)
        with pytest.raises(ResultsError, match="No space left on device"):
            export(source, path, force=True)
    assert path.read_text() == "mine"
    shares: list[float] = []
    export(source, path, True, shares.append)
    assert path.read_bytes() != b"mine"
    assert shares[-1] == 1.0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.h5", path.name]


def test_results_that_a_format_cannot_hold_are_explained(tmp_path: Path) -> None:
    source = bent_beam(tmp_path / "a.h5")
    with pytest.raises(ResultsError, match=r"the folder '.*none' does not exist"):
        export(source, tmp_path / "none" / "a.csv")
    source.rename(tmp_path / "a.json")
    with pytest.raises(ResultsError, match="is an input of this command"):
        export(tmp_path / "a.json", tmp_path / "a.json", force=True)
    table = tmp_path / "t.h5"
    with ResultWriter(table, HEADER, [], np.zeros(0)) as w:
        w.finish()
    with pytest.raises(ResultsError, match="holds no bodies"):
        export(table, tmp_path / "t.vtkhdf")
    with pytest.raises(ResultsError, match="holds no values of probes"):
        export(table, tmp_path / "t.csv")
    for suffix in (".npz", ".mat"):
        with pytest.raises(ResultsError, match="holds no linear model; solver state_space makes one"):
            export(table, tmp_path / f"t{suffix}")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.json", "t.h5"]


# ---------------------------------------------------------------------------- CSV and JSON

@pytest.mark.parametrize(("make", "time"), [(bent_beam, "factor"), (mechanism, "t")])
def test_csv_of_probes_holds_the_numbers_bit_for_bit(tmp_path: Path, make, time: str) -> None:
    source = make(tmp_path / "a.h5")
    export(source, tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(newline="") as stream:
        rows = list(csv.reader(stream))
    with open_results(source) as r:
        assert rows[0] == [time, *(f"{name}.{q}" for name, table in r.probes.items() for q in table)]
        wanted = np.array([r.probe_t, *(v for table in r.probes.values() for v in table.values())])
    np.testing.assert_array_equal(np.array(rows[1:], float).T, wanted)


def test_json_contains_all_small_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = bent_beam(tmp_path / "a.h5")
    export(source, tmp_path / "a.json")

    def no_constant(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")
    found = json.loads((tmp_path / "a.json").read_text(), parse_constant=no_constant)
    with open_results(source) as r:
        assert found["probes"]["factor"] == r.probe_t.tolist()
        assert found["probes"]["tip"]["uy"] == r.probes["tip"]["uy"].tolist()
        assert found["history"]["iterations"] == r.history["iterations"].tolist()
        assert found["summary"] == r.summary
        assert found["case_completed"] == r.case_completed
    assert found["left_out"] == []
    monkeypatch.setattr(plain, "MOST", 5)
    export(source, tmp_path / "a.json", force=True)
    found = json.loads((tmp_path / "a.json").read_text())
    assert found["left_out"] == ["states", "probes", "probe tip", "history"]
    assert found["probes"] == {"tip": {}}


def test_json_holds_tables(tmp_path: Path) -> None:
    export(table_file(tmp_path / "t.h5", {"2d2n": 2.0}), tmp_path / "t.json")
    table = json.loads((tmp_path / "t.json").read_text())["tables"]["convergence"]["rows"]
    assert table["elements"] == [2, 4, 8, 16]
    assert None in table["order"]


# ---------------------------------------------------------------------------- VTKHDF

@KINDS
def test_velocity_of_every_point_is_that_of_the_section(tmp_path: Path, kind: str) -> None:
    """A rigid rotation: v = OMEGA (-y, x) on axis and faces, for any element type."""
    export(turning(tmp_path / "a.h5", kind), tmp_path / "a.vtkhdf")
    g = grid(tmp_path / "a.vtkhdf")
    x, v = g["Points"][()], g["PointData/velocity"][()]
    np.testing.assert_allclose(v, OMEGA * np.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], 1), rtol=0, atol=1e-13)
    n = g["NumberOfPoints"][0]
    u = g["PointData/displacement"][()].reshape(-1, n, 3)
    np.testing.assert_allclose(u, x.reshape(-1, n, 3) - x[:n], rtol=0, atol=1e-15)


def test_meshes_of_many_elements_have_fewer_samples_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = bent_beam(tmp_path / "a.h5", ne=6)
    for most, along in ((48, 8), (47, 4), (12, 2), (11, 1), (1, 1)):
        monkeypatch.setattr(vtkhdf, "MOST_CELLS", most)
        export(source, tmp_path / "a.vtkhdf", force=True)
        assert grid(tmp_path / "a.vtkhdf")["NumberOfPoints"][0] == 6 * 3 * (along + 1)
        assert grid(tmp_path / "a.vtkhdf")["NumberOfCells"][0] == 6 * 2 * along + 1


@pytest.mark.parametrize(("states", "shares"), [(0, [0.2, 0.4, 0.6, 0.8, 1.0]), (2, [0.4, 0.8, 1.0]), (5, [1.0])])
def test_states_are_in_order_for_any_block_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                states: int, shares: list[float]) -> None:
    source, told = turning(tmp_path / "a.h5", "tangent"), []
    with open_results(source) as r:
        faces = [np.stack([r.faces("rod", i)[f] for f in ("bottom", "axis", "top")], 1) for i in range(5)]
    monkeypatch.setattr(vtkhdf, "AT_ONCE", states * faces[0].size // 2)
    export(source, tmp_path / "a.vtkhdf", done=told.append)
    assert told == shares
    np.testing.assert_array_equal(grid(tmp_path / "a.vtkhdf")["Points"][:, :2], np.reshape(faces, (-1, 2)))


def test_a_body_without_height_is_its_axis(tmp_path: Path) -> None:
    export(bent_beam(tmp_path / "a.h5", height=float("nan")), tmp_path / "a.vtkhdf")
    g = grid(tmp_path / "a.vtkhdf")
    assert g["Types"][()].tolist() == [vtkhdf.POLYLINE]
    assert np.isfinite(g["Points"][()]).all()


def test_fields_are_the_polynomials_through_their_stations(tmp_path: Path) -> None:
    """Cubic along and quadratic across: exact between the stations; NaN on a body without the field."""
    bodies = [tangent_body("one", 3, 3.0, 0.2), theta_body("two", 1, 1.0, 0.2, first=16)]
    e0 = np.concatenate([coordinates(kind, np.arange(n + 1.0), 0) for kind, n in (("tangent", 3), ("theta", 1))])
    xi, eta = np.linspace(0, 1, 4), np.array([-0.7, 0.1, 0.9])
    records = [FieldRecord("one", "stress", ("xx", "xy"), "{F}", "", xi, eta),
               FieldRecord("one", "M", ("M",), "{F}*{L}", "", xi, np.zeros(1))]

    def f(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return x**3 - 2 * x + 3 * y**2 * x - y

    at = np.arange(3)[:, None, None] + xi[:, None]
    stress = np.stack([f(at, eta), -f(at, eta)], -1)
    with ResultWriter(tmp_path / "a.h5", HEADER, bodies, e0, fields=records) as w:
        w.append(1.0, 0 * e0, fields={("one", "stress"): stress, ("one", "M"): f(at, np.zeros(1))[..., None]})
        w.finish()
    export(tmp_path / "a.h5", tmp_path / "a.vtkhdf")
    g = grid(tmp_path / "a.vtkhdf")
    one = g["PointData/body"][()] == 0
    x, y = g["Points"][one, 0], g["Points"][one, 1] / 0.1
    np.testing.assert_allclose(g["PointData/stress_xx"][one], f(x, y), atol=1e-12)
    np.testing.assert_allclose(g["PointData/stress_xy"][one], -f(x, y), atol=1e-12)
    np.testing.assert_allclose(g["PointData/M"][one], f(x, 0 * y), atol=1e-12)
    assert np.isnan(g["PointData/stress_xx"][()][~one]).all()


@pytest.mark.parametrize("stations", [np.array([0.0, 0.5, 0.5]), np.empty(0)], ids=["two in one place", "none"])
def test_stations_without_an_interpolant_are_damage(tmp_path: Path, stations: np.ndarray) -> None:
    e0 = coordinates("tangent", np.arange(3.0), 0.0)
    record = FieldRecord("rod", "M", ("M",), "{F}*{L}", "", np.linspace(0, 1, 3), np.zeros(1))
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("rod", 2, 2.0, 0.1)], e0, fields=[record]) as w:
        w.append(1.0, 0 * e0, fields={("rod", "M"): np.zeros((2, 3, 1, 1))})
        w.finish()
    with h5py.File(tmp_path / "a.h5", "r+") as f:
        del f["fields/rod/M/xi"]
        f["fields/rod/M/xi"] = stations
    with pytest.raises(ResultsError, match="is damaged"):
        export(tmp_path / "a.h5", tmp_path / "a.vtkhdf")
    assert not (tmp_path / "a.vtkhdf").exists()


def test_modes_are_displacements_from_the_state(tmp_path: Path) -> None:
    """A rotation of the whole body as a mode: faces move along the axis, the axis transversely."""
    x = np.linspace(0, 2, 5)
    e0 = coordinates("theta", x, 0.0)
    turn, shift = np.stack([0 * x, x, 1 + 0 * x], 1).ravel(), np.tile([1.0, 0.0, 0.0], 5)
    with ResultWriter(tmp_path / "a.h5", {**HEADER, "solver": "eigen"}, [theta_body("b", 4, 2.0, 0.3)], e0) as w:
        w.array("modes/shapes", np.stack([turn, shift]), "1", "mode shapes", up_to_sign=True)
        w.append(0.0, 0 * e0)
        w.finish()
    export(tmp_path / "a.h5", tmp_path / "a.vtkhdf")
    g = grid(tmp_path / "a.vtkhdf")
    points = g["Points"][()]
    np.testing.assert_allclose(g["PointData/mode_1"][()], np.stack([-points[:, 1], points[:, 0], 0 * points[:, 0]], 1),
                               atol=1e-14)
    np.testing.assert_allclose(g["PointData/mode_2"][()], np.tile([1.0, 0, 0], (len(points), 1)), atol=1e-14)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_states(tmp_path: Path) -> None:
    peaks = []
    for steps in (5, 60):
        source = bent_beam(tmp_path / f"{steps}.h5", ne=300, steps=steps)
        tracemalloc.start()
        export(source, tmp_path / f"{steps}.vtkhdf")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    one_state = 8 * 3 * int(grid(tmp_path / "60.vtkhdf")["NumberOfPoints"][0])
    assert peaks[1] < peaks[0] + 2 * one_state


def test_an_unfinished_file_is_exported_up_to_its_last_state(tmp_path: Path) -> None:
    bent_beam(tmp_path / "a.h5", finish=False)
    for suffix in set(FORMATS) - {".npz", ".mat"}:
        export(tmp_path / "a.h5.part", tmp_path / f"a{suffix}")
    assert grid(tmp_path / "a.vtkhdf")["Steps"].attrs["NSteps"] == 6


def test_a_half_plane_is_cut_to_the_size_of_the_bodies(tmp_path: Path) -> None:
    """Viewers fit all points into the window: an endless line would hide the bodies."""
    text = """
bodies:
  b: {geometry: {type: line, start: [2, 0], end: [3, 0]}, section: {EA: 1e4, kGA: 1e4, EI: 1},
      element: {type: cable, count: 2}}
boundary_conditions: [{type: clamp, at: b@0}]
loads: [{type: force, at: b@1, value: [0, 0.1]}]
obstacles: {slope: {type: half_plane, through: [0, -1], normal: [-3, 4]}}
solver: {type: static}
"""
    run_case(load_case_text(text), str(tmp_path / "a.h5"))
    export(tmp_path / "a.h5", tmp_path / "a.vtkhdf")
    with h5py.File(tmp_path / "a.vtkhdf") as file:
        grid = file["VTKHDF"]
        numbers = grid["PointData/body"][:]
        line = grid["Points"][:len(numbers)][numbers == -1][:, :2]
    np.testing.assert_allclose((line - [0, -1]) @ [-3, 4], 0.0, atol=1e-9)  # on the slope
    # from a quarter of the beam's length before the shadow of its first point to as much beyond that of its end
    along = (line - [0, -1]) @ [0.8, 0.6]
    assert along.min() == pytest.approx(0.8 * 2 + 0.6 - 0.25, abs=0.15)
    assert along.max() == pytest.approx(0.8 * 3 + 0.6 + 0.25, abs=0.15)
