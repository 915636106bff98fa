"""All combinations of some values of a case: rows, results by content, reused and recomputed results."""

from __future__ import annotations

import gc
import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from jobs import BEAM, GOAL

from ancf2d.case.axes import combinations, read_axes
from ancf2d.errors import CaseError, ResultsError
from ancf2d.results import open_results, part_path
from ancf2d.results.records import short_names
from ancf2d.results.target import Target
from ancf2d.study import digests, sweep_runs, warmup
from ancf2d.study.pool import ALONE
from ancf2d.study.run import run_case
from ancf2d.study.sweep import plan, run_sweep
from ancf2d.study.sweep_table import Sweep, shown, write_csv

# uy = F L^3/(3 E I) of the tip, exactly, in linear statics


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "beam.yaml").write_text(BEAM + GOAL)
    return tmp_path


def swept(*over: str, overrides: tuple[str, ...] = (), force: bool = False, keep: bool = False,
          pair: bool = False) -> Sweep:
    found = plan("beam.yaml", read_axes(over, pair), overrides, Path("out"), ALONE, "ancf2d sweep", force,
                 paired=pair, keep=keep)
    run_sweep(found, ALONE)
    return found


# ---------------------------------------------------------------------------- values

@pytest.mark.parametrize(("text", "values"), [
    ("a=1,2,1e3", [1, 2, 1000.0]), ("a=[2,2],[3,2]", [[2, 2], [3, 2]]), ("a=[1,2]", [[1, 2]]),
    ("a={type: cable, count: 2},{type: ancf, order: [2, 1]}",
     [{"type": "cable", "count": 2}, {"type": "ancf", "order": [2, 1]}]),
    ("a='x,y',\"z\"", ["x,y", "z"]), ("a=beam@0.5,null,true", ["beam@0.5", None, True]), ("a=1,1.0,1e0", [1.0]),
    ("a= 1 , 2 ", [1, 2])])
def test_values_are_read_as_yaml(text: str, values: list[Any]) -> None:
    axis, = read_axes([text])
    assert (axis.path, list(axis.values)) == ("a", values)


def test_combinations_change_the_last_axis_fastest() -> None:
    assert list(combinations(read_axes(["a=1,2", "b=x,y"]))) == [(1, "x"), (1, "y"), (2, "x"), (2, "y")]


def test_all_problems_of_the_axes_are_reported_at_once() -> None:
    with pytest.raises(CaseError) as found:
        read_axes(["a", "b=", "c=[1,2", "d=1,,2", "e=1,*x", "f=1", "f=2", "=3"])
    assert [p.file for p in found.value.problems] == sorted(
        f"--over {t}" for t in ("a", "b=", "c=[1,2", "d=1,,2", "e=1,*x", "f=2", "=3"))


def test_too_many_combinations_are_reported_before_they_are_made() -> None:
    many = ",".join(map(str, range(1000)))
    with pytest.raises(CaseError, match="1000000 combinations"):
        read_axes([f"a={many}", f"b={many}"])


# ---------------------------------------------------------------------------- rows

def test_every_combination_is_a_row_with_its_exact_answer() -> None:
    found = swept("loads.tip.value=[0,-3],[0,-6]", "bodies.beam.section.EI=1e3,2e3", keep=True)
    assert [row.status for row in found.rows] == ["converged"] * 4
    assert [row.goal for row in found.rows] == pytest.approx([-8e-3, -4e-3, -16e-3, -8e-3], rel=1e-9)
    assert found.rows[2].set == {"loads.tip.value": [0, -6], "bodies.beam.section.EI": 1000.0}
    for row in found.rows:
        assert row.output is not None
        with open_results(row.output) as r:
            assert r.summary["probes"]["tip"]["uy"] == row.goal
    assert found.as_json()["status"] == "converged"
    assert found.as_json()["rows"][0]["goal"] == found.rows[0].goal


def test_without_a_goal_a_row_has_probes_modes_or_load_factors(folder: Path) -> None:
    (folder / "beam.yaml").write_text(BEAM)
    assert list(swept("bodies.beam.element.count=2").rows[0].values) == ["tip.ux", "tip.uy"]
    modes = swept("solver={type: eigen, modes: 2}").rows[0].values
    assert list(modes) == ["omega 1", "omega 2"]
    # (1.8751/L)^2 sqrt(EI/rhoA)
    assert modes["omega 1"] == pytest.approx((1.8751041 / 2)**2 * 1e3**0.5, rel=1e-2)
    assert list(swept("solver={type: buckling, modes: 1}", overrides=("loads.tip.value=[-1, 0]",)).rows[0].values) == [
        "load factor 1"]


@pytest.mark.parametrize(("goal", "value"), [
    ("{probe: tip, quantity: theta}", -6e-3), ("{reaction: root, quantity: m}", 6.0),
    ("{quantity: strain_energy}", 0.012)])
def test_rows_have_the_value_of_any_goal(folder: Path, goal: str, value: float) -> None:
    """Rows of other goals omit reactions and energies: F L^2/(2 EI), F L and F^2 L^3/(6 EI)."""
    (folder / "beam.yaml").write_text(f"{BEAM}goal: {goal}\n")
    rows = swept("bodies.beam.element.count=1,2").rows
    assert [row.goal for row in rows] == pytest.approx([value] * 2, rel=1e-9)


def test_refusals_and_failures_are_rows() -> None:
    found = swept("bodies.beam.section.EI=1e3,-1", "solver={type: linear_static},{type: static, max_iterations: 1}",
                  overrides=("loads.tip.value=[0, -1e5]",))
    assert [row.status for row in found.rows] == ["converged", "failed", "refused", "refused"]
    assert "must be > 0" in found.rows[2].reason
    assert found.rows[1].reason
    assert found.as_json()["status"] == "failed"
    # seen only when the model is built
    loose = swept("boundary_conditions.root.type=clamp,pin")
    assert [row.status for row in loose.rows] == ["converged", "refused"]
    assert "free to turn" in loose.rows[1].reason


def test_internal_errors_cost_one_row(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("no")
    monkeypatch.setattr(sweep_runs, "run_case", broken)
    row, = swept("bodies.beam.element.count=2").rows
    assert (row.status, row.reason) == ("failed", "internal error, please report: ZeroDivisionError: no")


def test_garbage_collection_skips_earlier_objects(monkeypatch: pytest.MonkeyPatch) -> None:
    run, frozen = sweep_runs.run_case, list[int]()

    def watched(*given: Any, **options: Any) -> Any:
        frozen.append(gc.get_freeze_count())
        return run(*given, **options)
    monkeypatch.setattr(sweep_runs, "run_case", watched)
    swept("bodies.beam.element.count=2,4")
    assert len(frozen) == 2
    assert min(frozen) > 10_000
    assert gc.get_freeze_count() == 0


@pytest.mark.parametrize(("at_start", "left"), [(True, False), (False, True)])
def test_objects_frozen_earlier_stay_frozen(at_start: bool, left: bool,
                                            monkeypatch: pytest.MonkeyPatch) -> None:
    """Python 3.12 starts with some frozen objects, which are no reason to leave all others frozen."""
    gc.freeze()
    monkeypatch.setattr(warmup, "FROZEN", gc.get_freeze_count() if at_start else 0)
    try:
        with warmup.objects_frozen():
            pass
        assert (gc.get_freeze_count() > 0) == left
    finally:
        gc.unfreeze()


def test_unknown_paths_are_reported_at_once_and_nothing_is_computed() -> None:
    with pytest.raises(CaseError) as found:
        swept("bodies.beam.elemnt.count=4,8", "bodies.beam.section.EJ=1,2", "loads.3.value=[0,1]")
    assert sorted(p.file for p in found.value.problems) == [
        "--over bodies.beam.elemnt.count=4,8", "--over bodies.beam.section.EJ=1,2", "--over loads.3.value=[0,1]"]
    assert not Path("out").exists()


def test_a_case_completed_by_the_axes_is_valid(folder: Path) -> None:
    (folder / "beam.yaml").write_text(BEAM.replace(", count: 2", ""))
    assert [row.status for row in swept("bodies.beam.element.count=1,2").rows] == ["converged"] * 2


@pytest.mark.parametrize(("over", "given", "told"), [
    (["loads.0.value.1=-1,-2"], ["loads.tip.value.1=-3"], "--set loads.tip.value.1=-3"),
    (["loads.tip.value=[0,-1],[0,-2]"], ["loads.0.value.1=-3"], "--set loads.0.value.1=-3"),
    (["bodies.beam.element.count=2,4", "bodies.beam.element={type: cable}"], [],
     "--over bodies.beam.element.count=2,4"),
    (["loads=[],[]"], ["loads+={type: force, at: beam@1, value: [0, 1]}"],
     "--set loads+={type: force, at: beam@1, value: [0, 1]}")])
def test_a_value_that_an_axis_overwrites_is_refused(over: list[str], given: list[str], told: str) -> None:
    with pytest.raises(CaseError, match="overwrites this value in every row") as found:
        swept(*over, overrides=tuple(given))
    assert [p.file for p in found.value.problems] == [told]


def test_an_axis_within_a_value_that_is_set_varies_it() -> None:
    found = swept("bodies.beam.section.EI=1e3,2e3", overrides=("bodies.beam.section={EA: 1e7, EI: 1, kGA: 1e7}",))
    assert [row.status for row in found.rows] == ["converged"] * 2
    assert found.rows[0].goal != found.rows[1].goal


def test_a_file_in_place_of_the_folder_is_reported(folder: Path) -> None:
    (folder / "out").write_text("mine")
    with pytest.raises(ResultsError, match="cannot make the folder 'out'"):
        swept("bodies.beam.element.count=1")


# ---------------------------------------------------------------------------- results by content

def runs(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return a list that grows with the output of every run."""
    found: list[str] = []
    run_case = sweep_runs.run_case

    def counted(loaded: Any, out: str | None = None, **options: Any) -> Any:
        found.append(out or "")
        return run_case(loaded, out, **options)
    monkeypatch.setattr(sweep_runs, "run_case", counted)
    return found


def test_existing_results_are_reused(monkeypatch: pytest.MonkeyPatch) -> None:
    count = runs(monkeypatch)
    first = swept("bodies.beam.element.count=1,2")
    again = swept("bodies.beam.element.count=2,3,1")
    assert len(count) == 3
    assert [row.reused for row in again.rows] == [True, False, True]
    assert again.rows[0].goal == first.rows[1].goal
    assert again.rows[0].wall_s == first.rows[1].wall_s
    swept("bodies.beam.element.count=1,2", force=True)
    assert len(count) == 5


def test_equal_cases_are_run_once(monkeypatch: pytest.MonkeyPatch) -> None:
    count = runs(monkeypatch)
    found = swept("loads.tip.value=[0,-3],[0.0,-3.0]", "title=A")
    assert len(count) == 1
    assert [row.status for row in found.rows] == ["converged"] * len(found.rows)


def test_another_case_program_or_file_is_recomputed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    count = runs(monkeypatch)
    swept("bodies.beam.element.count=1")
    swept("bodies.beam.element.count=1", overrides=("bodies.beam.section.EI=2e3",))
    assert len(count) == 2
    monkeypatch.setattr(digests, "program", lambda: "another")
    swept("bodies.beam.element.count=1")
    assert len(count) == 3
    text = "name: mine\nbasis: ['1', 'x', 'x^2', 'x^3']\nnodes: [{at: 0, coordinates: [r, r_x]}, {at: 1, "
    (folder / "own.yaml").write_text(text + "coordinates: [r, r_x]}]\n")
    own = "bodies.beam.element={definition: own.yaml, count: 2}"
    swept(own)
    swept(own)
    assert len(count) == 4
    (folder / "own.yaml").write_text(text + "coordinates: [r, r_x]}]\nquadrature: [6, 1]\n")
    swept(own)
    assert len(count) == 5


@pytest.mark.slow
def test_a_file_that_does_not_match_its_name_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    one, two = swept("bodies.beam.element.count=1,2", keep=True).rows
    assert one.output is not None
    assert two.output is not None
    Path(one.output).write_bytes(Path(two.output).read_bytes())
    again = swept("bodies.beam.element.count=1", keep=True).rows[0]
    assert (again.reused, again.elements) == (False, 1)
    whole = Path(one.output).read_bytes()
    for size in (len(whole) - 100, len(whole) // 2, 100, 8, 0):
        Path(one.output).write_bytes(whole[:size])
        row = swept("bodies.beam.element.count=1", keep=True).rows[0]
        assert (row.reused, row.status) == (False, "converged")
    Path(one.output).write_text("mine")
    row = swept("bodies.beam.element.count=1", keep=True).rows[0]
    # what ancf2d did not write is replaced by force only
    assert (row.status, "--force" in row.reason) == ("failed", True)
    assert swept("bodies.beam.element.count=1", force=True, keep=True).rows[0].status == "converged"


def test_the_state_that_a_motion_starts_from_is_part_of_its_name(folder: Path) -> None:
    motion = {"overrides": ("solver={type: dynamic, t_end: 1e-3, dt: 1e-3}", "initial={from: start.h5}")}
    (folder / "beam.yaml").write_text(BEAM)
    names = []
    for load in (-3, -4):
        row = swept(f"loads.tip.value=[0,{load}]", keep=True).rows[0]
        (folder / "start.h5").write_bytes(Path(str(row.output)).read_bytes())
        found = swept("bodies.beam.element.count=2", keep=True, **motion).rows[0]  # type: ignore[arg-type]
        assert found.status == "converged", found.reason
        names.append(found.output)
    assert names[0] != names[1]


def test_a_worker_without_the_folder_of_result_files_says_so() -> None:
    """As on another machine without a shared folder."""
    job, = plan("beam.yaml", read_axes(["bodies.beam.element.count=1"]), (), Path("out"), ALONE, keep=True).jobs
    told = sweep_runs.solve_job(replace(job, output=str(Path("elsewhere", "runs", "row.h5"))))
    assert told["status"] == "failed"
    assert "there is no folder 'elsewhere" in told["reason"]
    assert "need a shared folder" in told["reason"]


# ---------------------------------------------------------------------------- tables

def test_columns_have_the_shortest_distinct_names() -> None:
    assert short_names(["bodies.a.element.count", "loads.0.value"]) == ["count", "value"]
    assert short_names(["bodies.a.element.count", "bodies.b.element.count", "title"]) == [
        "a.element.count", "b.element.count", "title"]
    assert short_names(["bodies.a.section.height", "bodies.a.section.width"]) == ["height", "width"]
    assert short_names(["loads.tip.value.1", "loads.0.value.0"]) == ["value.1", "value.0"]


def test_reasons_suggest_the_intended_name() -> None:
    row = swept("bodies.beam.element.type=cable,cabel").rows[1]
    assert row.reason == "bodies.beam.element.type: 'cabel' is not known; did you mean 'cable'?"


def test_values_are_shown_as_they_are_read() -> None:
    assert [shown(v) for v in ("2d2n", 1000.0, [2, 1.5], True, None)] == ["2d2n", "1000", "[2, 1.5]", "true", "null"]


def test_csv_has_a_line_per_row_at_full_precision(folder: Path) -> None:
    found = swept("bodies.beam.section.EI=1e3,-1", "loads.tip.value=[0,-3]")
    write_csv(found, "table.csv")
    head, one, two = (folder / "table.csv").read_text().splitlines()
    assert head == "bodies.beam.section.EI,loads.tip.value,status,tip uy,elements,dofs,wall_s,estimate,output,reason"
    assert one.startswith(f'1000,"[0, -3]",converged,{found.rows[0].goal!r},2,12,')
    assert two.startswith('-1,"[0, -3]",refused,,,,,,,"bodies.beam.section.EI must be > 0')
    assert sorted(p.name for p in folder.iterdir()) == ["beam.yaml", "out", "table.csv"]


@pytest.mark.parametrize("finished", [False, True])
def test_a_sweep_waits_for_a_result_that_another_run_writes(monkeypatch: pytest.MonkeyPatch, finished: bool) -> None:
    """If that run ends without a result, the case is run here; otherwise its result is used."""
    count = runs(monkeypatch)
    found = plan("beam.yaml", read_axes(["bodies.beam.element.count=2"]), (), Path("out"), ALONE, keep=True)
    job, = found.jobs
    assert job is not None
    Path("out/runs").mkdir(parents=True)
    other = Target(job.output)
    other.publish(b"another run")
    monkeypatch.setattr(sweep_runs, "TURN_SECONDS", 1.0)
    with ThreadPoolExecutor() as pool:
        ours = pool.submit(sweep_runs.solve_job, job)
        time.sleep(0.3)
        assert not ours.done()
        begun = len(count)
        if finished:
            run_case(job.load(), "other.h5")
            os.replace("other.h5", job.output)
        other.discard()
        assert ours.result(60)["status"] == "converged"
    assert (len(count) == begun) is finished
    assert not part_path(job.output).exists()
