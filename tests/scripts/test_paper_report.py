"""The report on the paper's tables and figures: complete, self-contained, with the right verdicts."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytestmark = pytest.mark.slow

FIGURES = [f"Figure {n}" for n in (3, 4, 5, 7, 8, 9, 10, 11, 12, 13, 14, 15, 17, 18, 19)]
# of how long motions last: enough for some stored states
SHORT = 0.01


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Table 3 on its coarsest mesh only."""
    from scripts import table3

    monkeypatch.setattr(table3, "PRINTED", {k: v for k, v in table3.PRINTED.items() if k[1] == 16})


def test_differences_are_in_printed_digits() -> None:
    from scripts.paper_report import difference

    assert difference("-0.68367", "-0.68185") == "+0.00182"
    assert difference("332.24", "332.23") == "-0.01"
    assert difference("93.40", "93.40") == ""
    assert difference("0.067056", "-0.067059", sign_lost=True) == "+0.000003"


def test_a_table_marks_differences_and_undocumented_verdicts() -> None:
    from scripts import reproduce_paper
    from scripts.paper_report import static_table

    verdicts = [reproduce_paper.judge(e, float(e.computed or e.printed)) for e in reproduce_paper.TABLES["2"].entries]
    html, count = static_table("2", verdicts)
    assert (count.same, count.whole, count.documented) == (4, 10, True)
    assert html.count("differs</span> [1]") == 2
    assert "not as documented" not in html
    wrong = [{**verdicts[2], "documented": False}, *verdicts[1:]]
    html, count = static_table("2", wrong)
    assert not count.documented
    assert html.count("not as documented") == 1


def test_motions_at_other_times_are_not_compared() -> None:
    from scripts.paper_motion import Path2, distance

    t = np.linspace(0.0, 1.0, 3)
    a = Path2(t, np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 4.0]]))
    b = Path2(t, np.array([[0.0, 0.0], [1.0, 2.0], [0.0, 0.0]]))
    assert distance(a, b).tolist() == [0.0, 2.0, 5.0]
    assert distance(a, b, (1,)).tolist() == [0.0, 2.0, 4.0]
    assert a.size == 5.0
    with pytest.raises(ValueError, match="different times"):
        distance(a, Path2(2 * t, b.r))


def test_the_papers_elements_have_its_shear_factor_by_default() -> None:
    from scripts.paper_motion import paper_run

    assert paper_run("pendulum2", "2d3n", 8).overrides == ("bodies.rod.element={type: 2d3n, count: 8, preset: paper}",)
    run = paper_run("slider_crank", "2d3n", 4, preset=False)
    assert run.case == "slider_crank_2d2n_8"
    assert run.overrides == ("bodies.crank.element={type: 2d3n, count: 2}", "bodies.rod.element={type: 2d3n, count: 4}")


def test_captions_say_whether_a_claim_is_confirmed(tmp_path: Path) -> None:
    from scripts.paper_figures import Drawn
    from scripts.paper_report import figure_html

    file = tmp_path / "a.png"
    file.write_bytes(b"picture")
    html = figure_html(Drawn("Figure 7", "tip & time", file, "All agree.", "1 mm apart.", False, "2d2n does"))
    assert "tip &amp; time" in html
    assert 'src="data:image/png;base64,cGljdHVyZQ=="' in html
    assert "Not borne out</span>: 2d2n does." in html


@pytest.mark.slow
def test_the_page_is_complete_and_self_contained(quick: None, tmp_path: Path) -> None:
    from scripts import reproduce_paper
    from scripts.paper_figures import Workshop
    from scripts.paper_report import page

    told: list[str] = []
    shop = Workshop(tmp_path, meshes=(2, 4), elements=4, share=SHORT, suffix="svg", told=told.append)
    text, documented = page(shop, reproduce_paper.examine)
    assert documented
    assert told
    for number in (1, 2, 3):
        assert len(re.findall(f'<h2 id="table{number}"', text)) == 1
    captions = re.findall(r"<figcaption><p><b>([\w ]+)</b>", text)
    assert list(dict.fromkeys(captions)) == ["Table 4", *FIGURES]
    for printed in ("-0.073625", "-0.68367", "1355.48", "332.24"):
        assert f'<td class="n">{printed}</td>' in text
    outside = [a for a in re.findall(r'(?:src|href)="([^"]+)"', text) if not a.startswith(("data:", "#"))]
    assert outside == []
    assert "not as documented" not in text
    check_static_figures(tmp_path)


def check_static_figures(folder: Path) -> None:
    """Figures 3 to 5 are drawn from the paper's cases, with the requested meshes."""
    from ancf2d.results import open_results

    for name in ("figure3_ux", "figure3_uy", "figure4", "figure5_linear", "figure5_nonlinear"):
        assert (folder / f"{name}.svg").read_bytes().startswith(b"<?xml")
    for name, solver in (("linear", "linear_static"), ("nonlinear", "static")):
        with open_results(folder / f"{name}_2d2n.h5") as results:
            assert results.solver == solver
            assert (results.body("beam").element_type, len(results.body("beam").dofs)) == ("2d2n", 4)
    with open_results(folder / "figure3_ux_beam189.h5") as results:
        table = results.tables["convergence"]
        assert (list(table["elements"]), set(table["element"])) == ([2, 4], {"reissner3"})
        assert table.attrs["goal"] == "tip ux"


def test_a_wrong_frequency_is_not_as_documented(monkeypatch: pytest.MonkeyPatch) -> None:
    from scripts import table3
    from scripts.paper_report import modes_table

    row = SimpleNamespace(name="bending 1", printed="93.40", omega=93.4, same=True, kind="bending 1", remark="")
    monkeypatch.setattr(table3, "analytic", lambda: [("bending 2", "332.24", 332.2345)])
    monkeypatch.setattr(table3, "paper", lambda: {"2d2n": [row]})
    html, count = modes_table()
    assert (count.same, count.whole, count.documented) == (1, 2, True)
    assert "332.2345" in html
    monkeypatch.setattr(table3, "paper", lambda: {"2d2n": [row, SimpleNamespace(**{**vars(row), "same": False})]})
    assert not modes_table()[1].documented
