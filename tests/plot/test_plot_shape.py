"""Deformed shapes: sections to scale, magnified, several states, bodies and files."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from synthetic import bent_beam, legend_texts, mechanism, opened, table_file

from ancf2d.errors import ResultsError
from ancf2d.plot import (
    draw,
)
from ancf2d.plot.body import nice


def bodies(figure: Figure) -> dict[str, np.ndarray]:
    """Outlines of the deformed bodies by name."""
    patches = [p for p in figure.axes[0].patches if p.get_label()[:1] != "_" and p.get_label()]
    return {p.get_label(): p.get_xy() for p in patches if isinstance(p, Polygon)}


@pytest.mark.slow_rows("theta")
@pytest.mark.parametrize("kind", ["tangent", "interpolated", "theta"])
def test_the_section_is_drawn_to_scale(tmp_path: Path, kind: str) -> None:
    results = opened(bent_beam(tmp_path / "a.h5", kind, ne=6, height=0.2, angle=1.0))
    figure = draw(results, "shape")
    outline = bodies(figure)["beam"]
    n = len(outline) // 2
    faces = results.faces("beam")
    np.testing.assert_array_equal(outline[:n], faces["bottom"].reshape(-1, 2))
    np.testing.assert_array_equal(outline[n:2 * n], faces["top"].reshape(-1, 2)[::-1])
    end = outline[n - 1] - outline[n]  # both faces of the free end
    assert np.hypot(*end) == pytest.approx(0.2, rel=1e-12)
    assert figure.axes[0].get_aspect() == 1.0


def test_everything_drawn_lies_within_the_axes_and_units_are_named(tmp_path: Path) -> None:
    header = {"units": {"length": "mm", "force": "N", "time": "s"}}
    figure = draw(opened(bent_beam(tmp_path / "a.h5", angle=6.0, header=header)), "shape")
    figure.draw_without_rendering()
    axes = figure.axes[0]
    for patch in axes.patches:
        low, high = patch.get_xy().min(axis=0), patch.get_xy().max(axis=0)
        assert axes.get_xlim()[0] < low[0] <= high[0] < axes.get_xlim()[1]
        assert axes.get_ylim()[0] < low[1] <= high[1] < axes.get_ylim()[1]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [mm]", "y [mm]")
    assert legend_texts(figure) == ["beam", "nodes", "reference"]


def test_many_bodies_share_a_colour_and_an_entry_in_the_legend(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ancf2d.plot.shape.MAX_ENTRIES", 0)
    a, b = (opened(bent_beam(tmp_path / f"{name}.h5")) for name in "ab")
    figure = draw(a, "shape")
    assert legend_texts(figure) == ["1 bodies", "reference"]
    assert list(bodies(figure)) == ["beam"]
    assert legend_texts(draw({"ours": a, "theirs": b}, "shape")) == ["ours: 1 bodies", "theirs: 1 bodies", "reference"]


def test_labels_of_axes_of_one_scale_are_not_cut(tmp_path: Path) -> None:
    for length in (0.325, 0.675):
        figure = draw(opened(bent_beam(tmp_path / "a.h5", angle=0.7, length=length, height=0.02)), "shape")
        figure.draw_without_rendering()
        assert figure.axes[0].yaxis.label.get_window_extent().x0 > 0.0


def test_nodes_are_marked_where_they_are(tmp_path: Path) -> None:
    results = opened(bent_beam(tmp_path / "a.h5", ne=4))
    (line,) = draw(results, "shape").axes[0].lines
    np.testing.assert_array_equal(line.get_xydata(), results.nodes("beam"))


@pytest.mark.parametrize(("angle", "note", "scale"), [
    (1.0, "load factor 1", 1.0), (0.9e-4, "displacements magnified 2000 times", 2000.0),
    (0.9e-9, "displacements magnified 2e+08 times", 2e8), (0.0, "load factor 1", 1.0)])
def test_an_invisible_deflection_is_magnified_with_a_note_in_the_title(
        tmp_path: Path, angle: float, note: str, scale: float) -> None:
    results = opened(bent_beam(tmp_path / "a.h5", angle=angle))
    figure = draw(results, "shape")
    title = figure.axes[0].get_title(loc="left")
    assert title.startswith("Cantilever with a tip load\n")
    assert title.endswith(note)
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_xydata(),
                                  results.nodes("beam", scale=scale))


def test_a_chosen_magnification_is_used_and_noted(tmp_path: Path) -> None:
    results = opened(bent_beam(tmp_path / "a.h5", angle=0.1))
    figure = draw(results, "shape", scale=3)
    assert "magnified 3 times" in figure.axes[0].get_title(loc="left")
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_xydata(),
                                  results.nodes("beam", scale=3.0))
    for wrong in (0, -1, "huge", float("nan")):
        with pytest.raises(ResultsError, match="positive number or 'auto'"):
            draw(results, "shape", scale=wrong)


def test_magnifications_are_1_2_or_5_times_a_power_of_ten() -> None:
    values = [0.99, 1.0, 1.99, 2.0, 4.9, 5.0, 9.99, 1234.0, 3e-7]
    np.testing.assert_allclose([nice(v) for v in values],
                               [0.5, 1, 1, 2, 2, 5, 5, 1000, 2e-7], rtol=1e-12)


def test_any_state_can_be_drawn(tmp_path: Path) -> None:
    results = opened(mechanism(tmp_path / "a.h5"))
    figure = draw(results, "shape", state=20)
    assert figure.axes[0].get_title(loc="left") == "Crank and rod\nt = 0.5 s"
    assert list(bodies(figure)) == ["crank", "rod"]
    with pytest.raises(ResultsError, match="no state 41: it holds 41"):
        draw(results, "shape", state=41)


def test_a_body_of_very_many_elements_is_thinned_but_keeps_its_ends(tmp_path: Path) -> None:
    results = opened(bent_beam(tmp_path / "a.h5", ne=5000, steps=1))
    figure = draw(results, "shape")
    outline, faces = bodies(figure)["beam"], results.faces("beam")
    assert 2000 < len(outline) < 10_000
    np.testing.assert_array_equal(outline[0], faces["bottom"][0, 0])
    np.testing.assert_array_equal(outline[len(outline) // 2 - 1], faces["bottom"][-1, -1])
    assert "nodes" not in legend_texts(figure)


def test_files_are_overlaid_under_their_names(tmp_path: Path) -> None:
    a, b = (opened(bent_beam(tmp_path / f"{n}.h5", k)) for n, k in
            (("fine", "tangent"), ("coarse", "theta")))
    assert list(bodies(draw([a, b], "shape"))) == ["fine (cable)", "coarse (reissner2)"]
    same = opened(bent_beam(tmp_path / "same.h5"))
    assert list(bodies(draw([a, same], "shape"))) == ["fine", "same"]
    assert list(bodies(draw({"one": a, "two": b}, "shape"))) == ["one", "two"]
    figure = draw([a, b], "load_deflection", quantity="uy")
    assert legend_texts(figure) == ["fine (cable): tip uy", "coarse (reissner2): tip uy"]
    (tmp_path / "sub").mkdir()
    c = opened(bent_beam(tmp_path / "sub" / "fine.h5"))
    assert list(bodies(draw([a, c], "shape"))) == [str(a.path), str(c.path)]


def test_the_title_of_several_files_is_their_common_part(tmp_path: Path) -> None:
    def title(*titles: str) -> str:
        files = [opened(bent_beam(tmp_path / f"{i}.h5", header={"title": t}, steps=1)) for i, t in enumerate(titles)]
        return draw(files, "load_deflection").axes[0].get_title(loc="left")

    assert title("Beam, linear: 2d2n") == "Beam, linear: 2d2n"
    assert title("Beam, linear: 2d2n", "Beam, linear: 2d2n") == "Beam, linear: 2d2n"
    assert title("Beam, linear: 2d2n", "Beam, linear: 2d3n") == "Beam, linear"
    assert title("Beam, linear: 2d2n", "Beam") == "Beam"
    assert title("Beam", "Frame") == ""
    files = [opened(bent_beam(tmp_path / f"{i}.h5", steps=1)) for i in range(2)]
    assert draw(files, "load_deflection", title="Own").axes[0].get_title(loc="left") == "Own"


def test_coinciding_outlines_are_all_visible(tmp_path: Path) -> None:
    figure = draw([opened(bent_beam(tmp_path / f"{i}.h5")) for i in range(5)], "shape")
    widths = [p.get_linewidth() for p in figure.axes[0].patches if p.get_label() in list("01234")]
    assert len(widths) == 5
    assert all(a > b for a, b in pairwise(widths))


def test_a_file_without_states_shows_its_reference(tmp_path: Path) -> None:
    figure = draw(opened(table_file(tmp_path / "a.h5", {"cable": 4.0})), "shape")
    assert "no states" in figure.axes[0].get_title(loc="left")
    assert legend_texts(figure) == ["reference"]
