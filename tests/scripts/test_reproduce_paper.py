"""The paper's tables, entry by entry: any verdict other than the documented one is an error."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

SCRIPTS = Path(__file__).parents[2] / "scripts"


@pytest.fixture
def reproduce():
    from scripts import reproduce_paper

    return reproduce_paper


def test_every_entry_has_its_documented_verdict(reproduce) -> None:
    for table in reproduce.TABLES.values():
        for verdict in reproduce.examine(table):
            assert verdict["documented"], verdict
            assert verdict["same"] or verdict["why"], verdict


def test_entries_that_agree_to_all_printed_digits(reproduce) -> None:
    same = {name: sum(e.computed is None for e in table.entries) for name, table in reproduce.TABLES.items()}
    assert same == {"1": 21, "2": 4}
    assert {name: len(table.entries) for name, table in reproduce.TABLES.items()} == {"1": 30, "2": 10}


def test_one_unit_in_the_last_printed_digit_is_a_difference(reproduce) -> None:
    entry = reproduce.TABLES["1"].entries[0]
    assert reproduce.judge(entry, -0.0736254)["same"]
    off = reproduce.judge(entry, -0.0736256)
    assert not off["same"]
    assert not off["documented"]
    assert off["verdict"] == "differs: computed -0.073626, printed -0.073625"


def test_an_entry_that_should_differ_and_does_not_is_not_as_documented(reproduce) -> None:
    entry = next(e for e in reproduce.TABLES["2"].entries if e.computed)
    assert reproduce.judge(entry, float(entry.computed))["documented"]
    assert not reproduce.judge(entry, float(entry.printed))["documented"]


def test_a_lost_minus_sign_is_no_difference_only_where_the_paper_lost_it(reproduce) -> None:
    kept, lost = (next(e for e in reproduce.TABLES["1"].entries if e.column == c and e.computed is None)
                  for c in ("2d2n", "omar"))
    assert reproduce.judge(lost, -float(lost.printed))["same"]
    assert not reproduce.judge(kept, -float(kept.printed))["same"]


def test_an_undocumented_verdict_is_an_error(reproduce, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr(reproduce, "probes", lambda case, overrides: {"mid": {"uy": -1e-4}})
    assert reproduce.main(["--table", "1"]) == 1
    assert "NOT AS DOCUMENTED" in capsys.readouterr().out


def test_command_line() -> None:
    done = subprocess.run([sys.executable, SCRIPTS / "reproduce_paper.py", "--table", "2", "--json"],
                          capture_output=True, text=True, timeout=120, check=True)
    tables = json.loads(done.stdout)["tables"]
    assert list(tables) == ["2"]
    assert tables["2"]["entries"][3]["printed"] == "-0.68070"
    assert tables["2"]["entries"][3]["same"]


def test_figures_from_the_command_line(reproduce, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr(reproduce, "draw_figures", lambda folder: [folder / "figure4.png"])
    assert reproduce.main(["--figures", str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"wrote {tmp_path / 'figure4.png'}\n"
    for more in (["--table", "1"], ["--report", "a.html"], ["--json"]):
        with pytest.raises(SystemExit):
            reproduce.main(["--figures", str(tmp_path), *more])


@pytest.mark.parametrize(("documented", "code"), [(True, 0), (False, 1)])
def test_the_report_names_undocumented_verdicts(reproduce, tmp_path: Path, documented: bool,
                                                code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    from scripts import paper_report

    monkeypatch.setattr(paper_report, "page", lambda shop, examine: ("<p>page</p>", documented))
    assert reproduce.main(["--report", str(tmp_path / "a.html")]) == code
    assert (tmp_path / "a.html").read_text(encoding="utf-8") == "<p>page</p>"


@pytest.mark.parametrize("place", ["missing/a.html", "."])
def test_a_report_that_cannot_be_written_is_refused_at_once(reproduce, tmp_path: Path, place: str, capsys) -> None:
    with pytest.raises(SystemExit) as stop:
        reproduce.main(["--report", str(tmp_path / place)])
    assert stop.value.code == 2
    assert "cannot write" in capsys.readouterr().err
