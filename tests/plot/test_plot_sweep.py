"""Figures of sweeps: lines of rows, histograms of all samples, bars of shares."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ancf2d.errors import ResultsError
from ancf2d.plot import default_kind, draw
from ancf2d.plot.kinds import build
from ancf2d.results import Column, Results, ResultWriter, open_results

SAID = {"goal": {"shares": {"b.h": 0.25, "b.E": 0.7}, "share_errors": {"b.h": 0.02, "b.E": 0.05}}}


def swept(path: Path, columns: dict[str, list[Any]], paths: list[str], **summary: Any) -> Results:
    with ResultWriter(path, {"title": "Swept"}, [], np.zeros(0), columns=[Column("tip uy", "m", "goal")]) as writer:
        writer.table("sweep", columns, {"paths": json.dumps(paths), "values": '["tip uy"]',
                                        "sampled": "statistics" in summary})
        writer.finish(summary)
    return open_results(path)


@pytest.fixture
def combined(tmp_path: Path) -> Results:
    """y = h E for three h and two E, out of order, one row failed."""
    rows = [(h, E) for h in (3.0, 1.0, 2.0) for E in (1.0, 2.0)]
    y = [None if row == (2.0, 2.0) else row[0] * row[1] for row in rows]
    return swept(tmp_path / "s.h5", {"b.h": [r[0] for r in rows], "b.E": [r[1] for r in rows], "tip uy": y},
                 ["b.h", "b.E"])


def test_lines_are_the_combinations_of_all_other_values(combined: Results) -> None:
    assert default_kind(combined) == "sweep"
    lines = {c.name: c for c in build(combined).panels[0].curves}  # type: ignore[attr-defined]
    assert list(lines) == ["E = 1", "E = 2"]
    np.testing.assert_array_equal(lines["E = 1"].y, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(lines["E = 2"].x, [1.0, 3.0])
    other = build(combined, "sweep", over="E").panels[0]  # type: ignore[attr-defined]
    assert [c.name for c in other.curves] == ["h = 3", "h = 1", "h = 2"]
    with pytest.raises(ResultsError, match="does not vary the number 'nu'"):
        build(combined, "sweep", over="nu")
    with pytest.raises(ResultsError, match="no samples"):
        build(combined, "histogram")
    axes = draw(combined).axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("b.h", "tip uy [m]")


def test_keys_with_equal_ends_have_distinct_labels(tmp_path: Path) -> None:
    columns = {"loads.0.tension": [1.0, 2.0, 1.0, 2.0], "loads.1.tension": [3.0, 3.0, 4.0, 4.0], "tip uy": [0.0] * 4}
    results = swept(tmp_path / "s.h5", columns, ["loads.0.tension", "loads.1.tension"])
    panel, = build(results, "sweep", over="0.tension").panels  # type: ignore[attr-defined]
    assert [c.name for c in panel.curves] == ["loads.1.tension = 3", "loads.1.tension = 4"]


@pytest.mark.parametrize(("what", "label"), [("tip.uy", "tip.uy"), ("(tip.uy - 0.15)^2 + (tip.ux + 0.05)^2",
                                                                    "minimised")])
def test_the_objective_labels_its_axis_if_it_fits(tmp_path: Path, what: str, label: str) -> None:
    with ResultWriter(tmp_path / "o.h5", {"title": "Best"}, [], np.zeros(0)) as writer:
        writer.table("optimisation", {"evaluation": [1.0, 2.0], "minimised": [3.0, 2.0], "missed": [0.0, 0.0],
                                      "b.h": [0.1, 0.2]}, {"minimise": what})
        writer.finish({})
    with open_results(tmp_path / "o.h5") as results:
        figure = draw(results)
    assert figure.axes[0].get_ylabel() == label
    assert figure.legends[0].get_texts()[0].get_text() == what


def test_paired_lists_make_one_line(tmp_path: Path) -> None:
    pairs = swept(tmp_path / "p.h5", {"b.h": [1.0, 2.0, 3.0], "b.E": [5.0, 4.0, 5.0], "tip uy": [1.0, 2.0, 3.0]},
                  ["b.h", "b.E"])
    line, = build(pairs).panels[0].curves  # type: ignore[attr-defined]
    np.testing.assert_array_equal(line.y, [1.0, 2.0, 3.0])


def test_histograms_count_all_samples_and_bars_are_the_shares(tmp_path: Path) -> None:
    y = np.random.default_rng(0).normal(size=200)
    drawn = swept(tmp_path / "d.h5", {"b.h": list(y), "b.E": list(y), "tip uy": list(2.0 * y)}, ["b.h", "b.E"],
                  statistics=SAID)
    assert default_kind(drawn) == "histogram"
    curve, = build(drawn).panels[0].curves  # type: ignore[attr-defined]
    assert curve.y.sum() == 200
    assert (curve.x[0], curve.x[-1]) == (2.0 * y.min(), 2.0 * y.max())
    assert list(build(drawn, "shares").rows()) == [("tip uy", "b.E", 0.7, 0.05), ("tip uy", "b.h", 0.25, 0.02)]
    bars = [bar.get_width() for bar in draw(drawn, "shares").axes[0].patches]
    assert bars == [0.7, 0.25]
