"""sweep.h5: all rows in one file, identical to single runs, and the remains of an interrupted sweep."""

from __future__ import annotations

import json
import math
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jobs import BEAM, GOAL

from ancf2d.case.axes import read_axes, read_distributions
from ancf2d.errors import CaseError, ResultsError
from ancf2d.results import checkpoint, open_results
from ancf2d.results.compare import compare_results
from ancf2d.solvers.motion import stepping
from ancf2d.study import sweep_runs, sweep_table
from ancf2d.study.pool import ALONE
from ancf2d.study.run import load, run_case
from ancf2d.study.samples import design
from ancf2d.study.sweep import plan, run_sweep
from ancf2d.study.sweep_table import Sweep

# uy = F L^3/(3 E I) of the tip, exactly, in linear statics
EI, F = "bodies.beam.section.EI", "loads.tip.value"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "beam.yaml").write_text(BEAM + GOAL)
    return tmp_path


def swept(*over: str, force: bool = False, **options: Any) -> Sweep:
    axes = read_axes(over, options.get("paired", False))
    found = plan("beam.yaml", axes, options.pop("overrides", ()), Path("out"), ALONE, "ancf2d sweep", force, **options)
    run_sweep(found, ALONE)
    return found


@pytest.mark.parametrize(("text", "values"), [
    ("a=0.1:0.5:5", [0.1, 0.2, 0.3, 0.4, 0.5]), ("a=4:16:4", [4, 8, 12, 16]), ("a=3:1:3", [3, 2, 1]),
    ("a=-0.1:0.05:4", [-0.1, -0.05, 0.0, 0.05]), ("a=log:1e-20:1:5", [1e-20, 1e-15, 1e-10, 1e-5, 1.0]),
    ("a=log:0.01:100:5", [0.01, 0.1, 1.0, 10.0, 100.0]), ("a=7,1:2:2", [7, 1, 2]), ("a='1:2:3'", ["1:2:3"])])
def test_ranges(text: str, values: list[Any]) -> None:
    axis, = read_axes([text])
    assert list(axis.values) == values
    assert [type(v) for v in axis.values] == [type(v) for v in values]


def test_wrong_ranges_and_distributions_are_reported_together() -> None:
    wrong = ["a=1:2", "b=1:2:1", "c=log:0:1:3", "d=1:x:3", "e=1:2:3:4", "f=log:1:2:2.5"]
    with pytest.raises(CaseError) as found:
        read_axes(wrong)
    assert [p.file for p in found.value.problems] == [f"--over {t}" for t in wrong]
    wrong = ["a", "b~normal(1, 0)", "c~uniform(2, 1)", "d~beta(1, 2)", "e~normal(1)", "~normal(0, 1)",
             "f~lognormal(0, x)", "h~lognormal(2e11, 1e10)"]
    with pytest.raises(CaseError) as found:
        read_distributions([*wrong, "g~normal(0, 1)", "g~normal(0, 2)"])
    assert sorted(p.file for p in found.value.problems) == sorted(
        f"--sample {t}" for t in [*wrong, "g~normal(0, 2)"])
    (said,) = [p for p in found.value.problems if "h~" in p.file]
    assert "of the natural logarithm; that of 2e+11 is 26.02" in said.expected


def test_paired_lists_run_together() -> None:
    found = swept(f"{EI}=1e3,2e3,1e3", f"{F}=[0,-3],[0,-6],[0,-12]", paired=True)
    assert [row.goal for row in found.rows] == pytest.approx([-8e-3, -8e-3, -32e-3], rel=1e-9)
    with pytest.raises(CaseError) as told:
        read_axes(["a=1,2,3", "b=2:6:5", "c=7,8,9", "d=1"], pair=True)
    assert [p.sentence for p in told.value.problems] == [
        f"'{name}' has a list of {count}, 'a' a list of 3; expected lists of one length with --pair"
        for name, count in (("b", 5), ("d", 1))]


def test_all_rows_are_in_one_file_and_identical_to_single_runs() -> None:
    found = swept(f"{EI}=1e3,-1,2e3", f"{F}=[0,-3],[0,-6]")
    assert sorted(os.listdir("out")) == ["sweep.h5"]
    with open_results("out/sweep.h5") as results:
        table = results.tables["sweep"]
        assert list(table["status"]) == ["converged"] * 2 + ["refused"] * 2 + ["converged"] * 2
        np.testing.assert_array_equal(table[EI], [1e3, 1e3, -1.0, -1.0, 2e3, 2e3])
        assert list(table[F]) == ["[0, -3]", "[0, -6]"] * 3
        assert "must be > 0" in table["reason"][2]
        values = table["tip uy"]
        assert "rows" not in results.summary
    alone = [run_case(load("beam.yaml", [f"{EI}={e}", f"{F}={f}"])).summary["probes"]["tip"]["uy"]
             for e in ("1e3", "2e3") for f in ("[0,-3]", "[0,-6]")]
    np.testing.assert_array_equal(values[np.isfinite(values)], alone)
    assert [row.goal for row in found.rows if row.status == "converged"] == alone


def test_units_and_descriptions_stand_beside_all_columns() -> None:
    import h5py

    swept(f"{EI}=1e3,2e3", overrides=("units={length: mm, force: kN, time: ms}",))
    with h5py.File("out/sweep.h5") as file:
        columns = file["tables/sweep"]
        assert columns["tip uy"].attrs["units"] == "mm"
        assert all({"units", "description"} <= set(c.attrs) for c in columns.values())


# ---------------------------------------------------------------------------- what is left

def count_runs(monkeypatch: pytest.MonkeyPatch, after: int = 99) -> list[Any]:
    """Return a list that grows with every run; the run after ``after`` is interrupted."""
    runs: list[Any] = []
    real = sweep_runs.run_case

    def counted(loaded: Any, *more: Any, **options: Any) -> Any:
        if len(runs) == after:
            raise KeyboardInterrupt
        runs.append(loaded)
        return real(loaded, *more, **options)
    monkeypatch.setattr(sweep_runs, "run_case", counted)
    return runs


def test_an_interrupted_sweep_resumes_from_its_file(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        count_runs(patch, after=2)
        with pytest.raises(KeyboardInterrupt):
            swept(f"{EI}=1e3:4e3:4")
    assert sorted(os.listdir("out")) == ["sweep.h5"]
    runs = count_runs(monkeypatch)
    found = swept(f"{EI}=1e3:4e3:4")
    assert [row.reused for row in found.rows] == [True, True, False, False]
    assert len(runs) == 2
    # computed again, the rows take other times; they agree all the same
    shutil.copy("out/sweep.h5", "before.h5")
    swept(f"{EI}=1e3:4e3:4", force=True)
    assert compare_results("before.h5", "out/sweep.h5", rtol=0.0) == []
    # rows of earlier sweeps are known too
    assert [row.reused for row in swept(f"{EI}=5e3,4e3,1e3").rows] == [False, True, True]


def test_a_killed_sweep_resumes_from_its_list(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kill leaves the list as after the last row, or with an incomplete line."""
    kept: list[bytes] = []

    def killed(ledger: sweep_table.Ledger, sweep: Sweep) -> None:
        kept.append(ledger.list.read_bytes())
        ledger._stream.close()
    with monkeypatch.context() as patch:
        patch.setattr(sweep_table.Ledger, "close", killed)
        swept(f"{EI}=1e3:3e3:3")
    assert not Path("out/sweep.h5").exists()
    for lost, text in enumerate((kept[0], kept[0][:-20])):
        Path("out/sweep.rows").write_bytes(text)
        assert [row.reused for row in swept(f"{EI}=1e3:3e3:3").rows] == [True, True, not lost]
        os.unlink("out/sweep.h5")
    head, rest = kept[0].split(b"\n", 1)
    other = {name: "another program" for name in json.loads(head)}
    Path("out/sweep.rows").write_bytes(json.dumps(other).encode() + b"\n" + rest)
    assert not any(row.reused for row in swept(f"{EI}=1e3:3e3:3").rows)


def test_a_sweep_that_begins_keeps_the_rows_of_one_that_was_ended() -> None:
    """A kill before the first new row must not lose them; only an incomplete line is cut off."""
    Path("out").mkdir()
    lines = b"".join(json.dumps(line).encode() + b"\n" for line in (
        {sweep_table.MARK: sweep_table.program()}, {"name": "a", "row": {"goal": 1.0}}))
    Path("out/sweep.rows").write_bytes(lines + b'{"name": "b"')
    ledger = sweep_table.Ledger(Path("out"))
    with ledger._stream:
        assert ledger.known == {"a": {"goal": 1.0}}
        assert Path("out/sweep.rows").read_bytes() == lines
        ledger.store("c", {"goal": 2.0})
        assert Path("out/sweep.rows").read_bytes().startswith(lines + b'{"name": "c"')


@pytest.mark.parametrize("name", ["sweep.h5", "sweep.rows"])
def test_files_of_other_programs_are_replaced_only_with_force(name: str) -> None:
    Path("out").mkdir()
    Path("out", name).write_text("mine")
    with pytest.raises(ResultsError, match="not made by ancf2d"):
        swept(f"{EI}=1e3,2e3")
    assert Path("out", name).read_text() == "mine"
    assert swept(f"{EI}=1e3,2e3", force=True).as_json()["status"] == "converged"


def test_a_damaged_file_costs_only_its_rows() -> None:
    swept(f"{EI}=1e3,2e3")
    whole = Path("out/sweep.h5").read_bytes()
    Path("out/sweep.h5").write_bytes(whole[:len(whole) // 2])
    assert [row.reused for row in swept(f"{EI}=1e3,2e3", force=True).rows] == [False, False]
    assert [row.reused for row in swept(f"{EI}=1e3,2e3").rows] == [True, True]


@pytest.mark.slow
def test_a_motion_without_a_file_resumes_from_its_checkpoint(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The result is that of an uninterrupted motion, bit for bit."""
    motion = ("solver={type: dynamic, t_end: 1, dt: 2e-3, estimate: false}", "output.every=1")
    whole = swept(f"{EI}=1e3", overrides=motion).rows[0]
    os.unlink("out/sweep.h5")
    monkeypatch.setattr(checkpoint, "EVERY_SECONDS", 0.0)
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 0.0)  # the solver comes back often
    times: list[float] = []

    class Stopped(checkpoint.CheckpointKeeper):
        def keep(self, found: checkpoint.Checkpoint | None) -> None:
            self._due = 0.0 if self.resumed is None else math.inf
            super().keep(found)
            if found is not None:
                times.append(found.t)
                if found.t < 0.9 and self.resumed is None:
                    raise KeyboardInterrupt

    monkeypatch.setattr(checkpoint, "CheckpointKeeper", Stopped)
    with pytest.raises(KeyboardInterrupt):
        swept(f"{EI}=1e3", overrides=motion)
    assert len(list(Path("out").glob("*.checkpoint"))) == 1
    stopped = len(times)
    again = swept(f"{EI}=1e3", overrides=motion).rows[0]
    assert times[stopped] > times[stopped - 1] > 0.0
    assert (again.status, again.reused, again.goal) == ("converged", False, whole.goal)
    assert os.listdir("out") == ["sweep.h5"]


# ---------------------------------------------------------------------------- samples

def test_samples_of_a_closed_form_have_its_moments() -> None:
    """uy = -8 F / (3 EI): ln uy is a sum, so a lognormal EI and F give the moments of a lognormal."""
    laws = read_distributions([f"{EI}~lognormal(6.9, 0.1)", f"{F}.1~uniform(-4, -2)"])
    drawn = design(laws, 64, seed=1)
    found = swept(samples=drawn)
    assert [row.status for row in found.rows] == ["converged"] * 64
    exact = [8.0 * row.set[f"{F}.1"] / (3.0 * row.set[EI]) for row in found.rows]
    assert [row.goal for row in found.rows] == pytest.approx(exact, rel=1e-9)
    said = found.as_json()["statistics"]["goal"]
    assert said["mean"] == pytest.approx(np.mean(exact), rel=1e-9)
    assert said["sd"] == pytest.approx(np.std(exact, ddof=1), rel=1e-9)
    # var(1/EI)/E^2 = exp(s^2) - 1 of the lognormal, var(F)/E^2 = (2^2/12)/9 of the uniform law; product of both
    a, b = np.expm1(0.01), 4.0 / 12.0 / 9.0
    whole = (1.0 + a) * (1.0 + b) - 1.0
    shares, errors = said["shares"], said["share_errors"]
    assert shares[EI] == pytest.approx(a / whole, abs=0.06)
    assert shares[f"{F}.1"] == pytest.approx(b / whole, abs=0.12)
    assert max(errors.values()) < 0.3
    with open_results("out/sweep.h5") as results:
        assert results.summary["statistics"]["goal"]["shares"] == shares
