"""Comparison of result files: round-off is ignored, real changes are found."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from synthetic import HEADER, bent_beam, coordinates, table_file, tangent_body

from ancf2d.errors import ResultsError
from ancf2d.results import (
    ResultWriter,
    compare_results,
    comparison_text,
    differences_json,
    left_out,
    open_results,
)
from ancf2d.results import series as series_module


def pair(tmp_path: Path) -> tuple[Path, Path]:
    return bent_beam(tmp_path / "a.h5"), bent_beam(tmp_path / "b.h5")


def change(path: Path, dataset: str, index: object, by: float) -> None:
    with h5py.File(path, "r+") as f:
        f[dataset][index] += by


def test_two_runs_of_one_case_agree(tmp_path: Path) -> None:
    a, b = pair(tmp_path)
    assert compare_results(a, b, rtol=0.0) == []
    assert comparison_text([], "a.h5", "b.h5") == "a.h5 and b.h5 agree"


def test_round_off_of_zero_entries_is_no_difference(tmp_path: Path) -> None:
    a, b = pair(tmp_path)
    change(b, "states/d", (5, 0), 1e-13)  # the fixed end
    change(b, "probes/tip/ux", 0, 1e-13)
    assert compare_results(a, b) == []
    assert len(compare_results(a, b, rtol=0.0)) == 2


@pytest.mark.parametrize(("dataset", "index"), [
    ("mesh/e0", 4), ("states/d", (3, 17)), pytest.param("states/d", (3, 18), marks=pytest.mark.slow), ("states/t", 2),
    pytest.param("probes/tip/uy", 4, marks=pytest.mark.slow), ("probes/tip/theta", 4),
    pytest.param("mesh/bodies/beam/lengths", 0, marks=pytest.mark.slow)])
def test_a_change_of_1e_7_is_located(tmp_path: Path, dataset: str, index: object) -> None:
    a, b = pair(tmp_path)
    change(b, dataset, index, 1e-7)
    (found,) = compare_results(a, b)
    assert found.dataset == f"/{dataset}"
    assert found.index == (index if isinstance(index, tuple) else (index,))
    assert found.absolute == pytest.approx(1e-7, rel=1e-6)
    assert found.relative == pytest.approx(1e-7 / found.scale, rel=1e-6)
    assert found.count == 1
    assert f"/{dataset}" in str(found)
    assert compare_results(a, b, rtol=1e-5) == []
    assert compare_results(a, b, atol=1e-6) == []


def test_slopes_are_not_judged_by_the_scale_of_positions(tmp_path: Path) -> None:
    a, b = (bent_beam(tmp_path / n, length=1e6, height=1.0) for n in ("a.h5", "b.h5"))
    change(b, "states/d", (5, 18), 1e-7)  # r_x of the tip, of order one
    assert [d.dataset for d in compare_results(a, b)] == ["/states/d"]
    change(b, "states/d", (5, 18), -1e-7)
    change(b, "states/d", (5, 16), 1e-7)  # x of the tip, of order 1e6
    assert compare_results(a, b) == []


def test_the_difference_names_the_time(tmp_path: Path) -> None:
    a, b = pair(tmp_path)
    change(b, "states/d", (3, 17), 1e-3)
    (found,) = compare_results(a, b)
    assert found.t == pytest.approx(0.6)
    assert "at t = 0.6" in str(found)
    assert "1 of 120 entries differ" in str(found)


def put(path: Path, values: dict[tuple[int, int], float]) -> None:
    with h5py.File(path, "r+") as f:
        for index, value in values.items():
            f["states/d"][index] = value


@pytest.mark.parametrize("numbers", [1, 50, 1 << 17])  # blocks of one state, of two, of all
def test_the_worst_entry_of_all_states_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, numbers: int) -> None:
    monkeypatch.setattr(series_module, "BLOCK", numbers)
    a, b = pair(tmp_path)
    # the first of two that are equally bad; one that is small beside the largest slope, which the last state has
    put(a, {(2, 17): 0.0, (4, 17): 0.0, (1, 18): 0.0, (5, 18): 64.0})
    put(b, {(2, 17): 0.5, (4, 17): 0.5, (1, 18): 1.0, (5, 18): 64.0})
    (found,) = compare_results(a, b)
    assert (found.index, found.a, found.b, found.t) == ((2, 17), 0.0, 0.5, 0.4)
    assert (found.absolute, found.count, found.total) == (0.5, 3, 120)
    assert found.relative == 0.5 / found.scale > 1 / 64
    put(a, {(2, 17): 0.5, (4, 17): 0.5})
    (found,) = compare_results(a, b)
    assert (found.index, found.scale, found.relative, found.count) == ((1, 18), 64.0, 1 / 64, 1)
    put(a, {(3, 4): np.nan, (5, 0): -np.inf, (0, 1): np.nan, (4, 2): np.inf})
    put(b, {(5, 0): np.inf, (0, 1): np.nan, (4, 2): np.inf})
    (found,) = compare_results(a, b)
    assert (found.index, found.relative, found.count) == ((3, 4), np.inf, 3)
    assert np.isnan(found.a)


def test_nan_equals_nan_and_nothing_else(tmp_path: Path) -> None:
    a, b = pair(tmp_path)
    change(b, "probes/tip/uy", 2, np.nan)
    (found,) = compare_results(a, b)
    assert (found.dataset, found.index) == ("/probes/tip/uy", (2,))
    assert found.absolute == np.inf
    change(a, "probes/tip/uy", 2, np.nan)
    assert compare_results(a, b) == []
    change(a, "probes/tip/uy", 3, np.inf)
    assert len(compare_results(a, b, rtol=1e9)) == 1


def test_shapes_and_missing_datasets_are_differences(tmp_path: Path) -> None:
    a = bent_beam(tmp_path / "a.h5")
    b = bent_beam(tmp_path / "b.h5", ne=5, steps=6)
    found = {d.dataset: d for d in compare_results(a, b, everything=True)}
    assert found["/mesh/e0"].what == "shapes (20,) and (24,) differ"
    assert found["/states/d"].what == "shapes (6, 20) and (7, 24) differ"
    assert "/probes" in found
    with h5py.File(b, "r+") as f:
        f.move("probes/tip", "probes/end")
    found = {d.dataset: d.what for d in compare_results(a, b)}
    assert found["/probes/tip"] == "only in the first"
    assert found["/probes/end"] == "only in the second"


def set_summary(path: Path, edit: dict[str, object]) -> None:
    with h5py.File(path, "r+") as f:
        summary = {**json.loads(f["summary"][()]), **edit}
        del f["summary"]
        f["summary"] = np.bytes_(json.dumps(summary))


@pytest.mark.parametrize(("edit", "seen"), [
    ({"wall_s": 9.0, "output": "x.h5", "case": "other"}, None),
    ({"status": "failed"}, "summary.status"),
    ({"energy": {"strain": 12.5001, "kinetic": 0.0, "potential": 0.0}}, "summary.energy.strain"),
    ({"energy": {"strain": 12.5, "kinetic": 1e-14, "potential": 0.0}}, None),
    ({"reactions": {"left": {"fx": 0.0, "fy": 2e-14, "m": -100.0}}}, "summary.reactions.left.fy"),
    ({"iterations": 16, "steps": None}, None), ({"extra": 1.0}, "summary.extra")])
def test_the_numbers_of_the_summary_are_compared(tmp_path: Path, edit: dict[str, object],
                                                 seen: str | None) -> None:
    a, b = pair(tmp_path)
    set_summary(b, edit)
    assert [d.dataset for d in compare_results(a, b)] == ([seen] if seen else [])


@pytest.mark.parametrize("name", ["iterations", "steps", "rejected"])
def test_counters_are_compared_only_with_everything(tmp_path: Path, name: str) -> None:
    a, b = pair(tmp_path)
    set_summary(a, {name: 3})
    set_summary(b, {name: 4})
    assert compare_results(a, b) == []
    assert [d.dataset for d in compare_results(a, b, everything=True)] == [f"summary.{name}"]


def test_states_at_common_times_are_compared(tmp_path: Path) -> None:
    """Load steps of 1/6 and of 1/9 share the thirds; a difference there is found at its own time."""
    a, b = (bent_beam(tmp_path / name, steps=steps) for name, steps in (("a.h5", 6), ("b.h5", 9)))
    with open_results(a) as one, open_results(b) as two:
        shown = [two.d(k) for k in (0, 3, 6, 9)]
        assert [np.allclose(one.d(2 * k), d, rtol=0, atol=1e-12) for k, d in enumerate(shown)] == [True] * 4
        assert left_out(one, two).startswith("4 of 7 and 10 states")
        assert left_out(one, one) == ""
    assert compare_results(a, b, rtol=1e-6) == []
    change(b, "states/d", (4, 17), 1.0)  # at 4/9, which the other file does not have
    assert compare_results(a, b, rtol=1e-6) == []
    change(b, "states/d", (6, 17), 1.0)
    (found,) = compare_results(a, b, rtol=1e-6)
    assert (found.index, found.t, found.total) == ((4, 17), pytest.approx(2 / 3), 80)
    assert {"/states/d", "/probes"} <= {d.dataset for d in compare_results(a, b, rtol=1e-6, everything=True)}


def test_tables_are_compared_without_wall_times(tmp_path: Path) -> None:
    a, b = (table_file(tmp_path / n, {"cable": 4.0, "2d2n": 2.0}) for n in ("a.h5", "b.h5"))
    change(b, "tables/convergence/wall_s", 1, 5.0)
    assert compare_results(a, b) == []
    change(b, "tables/convergence/error", 6, 1e-6)
    (found,) = compare_results(a, b)
    assert (found.dataset, found.index) == ("/tables/convergence/error", (6,))


def test_mode_shapes_are_compared_up_to_sign(tmp_path: Path) -> None:
    from synthetic import HEADER, coordinates, tangent_body

    from ancf2d.results import ResultWriter

    e0, modes = coordinates("tangent", np.linspace(0, 1, 2), 0.0), np.arange(1.0, 17).reshape(2, 8)
    for name, sign, free in (("a.h5", 1, True), ("b.h5", -1, True), ("c.h5", -1, False)):
        with ResultWriter(tmp_path / name, HEADER, [tangent_body("b", 1, 1.0, 0.1)], e0) as w:
            w.array("modes", modes * [[sign], [1]], "1", "mode shapes", up_to_sign=free)
            w.finish()
    assert compare_results(tmp_path / "a.h5", tmp_path / "b.h5") == []
    assert len(compare_results(tmp_path / "c.h5", tmp_path / "a.h5")) == 1


def test_differences_are_json(tmp_path: Path) -> None:
    a, b = pair(tmp_path)
    change(b, "states/d", (3, 17), 1e-3)
    (found,) = json.loads(json.dumps(differences_json(compare_results(a, b))))
    assert found["dataset"] == "/states/d"
    assert found["index"] == [3, 17]


def test_negative_tolerances_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match="negative"):
        compare_results(*pair(tmp_path), rtol=-1.0)


def test_round_off_in_one_component_of_the_momentum_is_no_difference(tmp_path: Path) -> None:
    for name, small, large in (("a", 1e-17, 2.0), ("b", 3e-17, 2.0), ("c", 1e-17, 2.0 + 1e-6)):
        w = ResultWriter(tmp_path / name, HEADER, [tangent_body("beam", 1, 1.0, 0.1)],
                         coordinates("tangent", np.array([0.0, 1.0]), 0.0))
        w.finish({"momentum": {"linear": [small, large], "angular": 1.0}})
    assert not compare_results(tmp_path / "a", tmp_path / "b")
    (found,) = compare_results(tmp_path / "a", tmp_path / "c")
    assert found.dataset == "summary.momentum.linear.1"
