"""Figures of modes: the modes drawn, their amplitude, their titles, and undistorted sections."""

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from ancf2d.errors import ResultsError
from ancf2d.plot import default_kind, draw
from ancf2d.plot.kinds import build
from ancf2d.results import Results, open_results
from ancf2d.study.run import load, run_case

CASES = Path(__file__).parents[2] / "cases"


@pytest.fixture(scope="module")
def modes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Results]:
    path = tmp_path_factory.mktemp("modes") / "m.h5"
    run_case(load(CASES / "paper" / "table3_2d2n.yaml", ["solver.modes=16"]), str(path))
    with open_results(path) as results:
        yield results


@pytest.fixture(scope="module")
def buckled(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Results]:
    path = tmp_path_factory.mktemp("modes") / "b.h5"
    run_case(load(CASES / "buckling" / "euler_pinned.yaml"), str(path))
    with open_results(path) as results:
        yield results


def test_an_eigen_file_is_drawn_as_modes(modes: Results) -> None:
    assert default_kind(modes) == "modes"
    labels = [m.label for m in build(modes).modes]
    assert len(labels) == 12
    assert labels[0] == f"bending 1: {93.4003 / (2 * np.pi):.5g} Hz (93.4003 rad/s)"
    assert labels[7].startswith(f"spurious 1: {1222.07 / (2 * np.pi):.4g}")


def test_some_modes_can_be_chosen(modes: Results) -> None:
    assert [m.number for m in build(modes, "modes", first=5, count=3).modes] == [5, 6, 7]
    with pytest.raises(ResultsError, match="modes 1 to 16"):
        build(modes, "modes", first=17)


def test_bending_keeps_the_ends_and_moves_the_middle_by_the_requested_share(modes: Results) -> None:
    body = build(modes, "modes", count=1).modes[0].bodies[0]
    moved = body.moved["axis"] - body.reference["axis"]
    np.testing.assert_allclose(moved[[0, -1], 1], 0.0, atol=1e-9)
    everything = np.concatenate([body.moved[k] - body.reference[k] for k in ("axis", "top", "bottom")])
    assert np.linalg.norm(everything, axis=1).max() == pytest.approx(0.12 * np.hypot(2.0, 0.4), rel=1e-3)


def test_neighbours_share_faces_in_bending_and_part_in_the_spurious_branch(modes: Results) -> None:
    def gap(k: int) -> float:
        pieces = build(modes, "modes", first=k, count=1).modes[0].bodies[0].pieces
        half = len(pieces[0]) // 2 - 1
        return max(float(np.linalg.norm(a[half - 1] - b[0])) for a, b in itertools.pairwise(pieces))

    assert gap(1) < 1e-3
    assert gap(9) > 0.05


def test_sections_are_drawn_through_the_axis(modes: Results) -> None:
    body = build(modes, "modes", count=1).modes[0].bodies[0]
    assert body.sections.shape == (16 * 2 + 16, 3, 2)
    np.testing.assert_allclose(body.sections[0], [body.moved[k][0] for k in ("bottom", "axis", "top")])


def test_buckling_shapes_show_their_factors(buckled: Results) -> None:
    assert [m.label for m in build(buckled).modes] == ["load factor 164.493", "load factor 657.971"]


def test_the_figure_can_be_drawn_and_its_data_listed(modes: Results) -> None:
    figure = draw(modes, "modes", count=5)
    assert sum(bool(a.get_title()) or bool(a.get_title(loc="left")) for a in figure.axes) == 5
    picture = build(modes, "modes", count=1)
    rows = list(picture.rows())
    assert len(rows) == len(picture.modes[0].bodies[0].moved["axis"])
    assert len(rows[0]) == len(picture.header())


def test_a_long_title_is_broken_into_lines_that_fit(tmp_path: Path) -> None:
    title = "two girders of ten kilometres each, welded to each other in the middle, and pressed by " * 2
    run_case(load(CASES / "buckling" / "euler_pinned.yaml", [f"title={title}"]), str(tmp_path / "b.h5"))
    with open_results(tmp_path / "b.h5") as results:
        figure = draw(results, "modes", count=1)
        figure.canvas.draw()
        (heading,) = [text for text in figure.texts if text.get_text().startswith("two girders")]
        place, page = heading.get_window_extent(), figure.bbox
        first = figure.axes[0].title.get_window_extent()
        assert page.x0 <= place.x0 < place.x1 <= page.x1
        assert first.y1 <= place.y0 < place.y1 <= page.y1


def test_titles_of_modes_stay_in_their_columns_and_break_between_quantities(modes: Results) -> None:
    picture = build(modes, "modes", count=2)
    for mode in picture.modes:
        mode.label = "bending 1: 4.6515e+06 Hz (2.92262e+07 rad/s), decays with 2.0835e+05 1/s, ratio 0.5805"
    figure = Figure(figsize=picture.size, layout="constrained")
    picture.render(figure)
    figure.draw_without_rendering()
    first, second = (axes.title for axes in figure.axes[:2])
    assert first.get_text() == ("bending 1: 4.6515e+06 Hz (2.92262e+07 rad/s),\n"
                                "decays with 2.0835e+05 1/s, ratio 0.5805")
    assert first.get_window_extent().x1 < second.get_window_extent().x0
