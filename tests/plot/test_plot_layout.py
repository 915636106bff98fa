"""No part of a figure overlaps another or is cut off: diagrams, corners, numbers beside axes, legends."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from synthetic import HEADER, coordinates, tangent_body

from ancf2d.case import load_case_text
from ancf2d.plot import Curve, Curves, Look, Panel, draw, rendered
from ancf2d.plot.kinds import build
from ancf2d.plot.modes import _label
from ancf2d.plot.output import _drawn, _lay_out
from ancf2d.plot.style import style
from ancf2d.results import Results, ResultWriter, open_results, write_tables
from ancf2d.study.run import run_case

FRAME = """
bodies:
  frame:
    geometry: {type: polyline, points: [[0, 0], [0, 1], [1, 1]]}
    section: {height: 0.05, width: 0.03}
    material: {E: 2.0e11, nu: 0.3, yield: 250e6, hardening: {isotropic: 1e9}}
    element: {type: reissner2, count: 4}
boundary_conditions: [{type: clamp, at: frame@0}]
loads: [{type: force, at: frame@1, value: [0, -100]}]
solver: {type: static}
output: {fields: [M, stress]}
"""


@pytest.fixture(scope="module")
def frame(tmp_path_factory: pytest.TempPathFactory) -> Results:
    path = str(tmp_path_factory.mktemp("frame") / "a.h5")
    run_case(load_case_text(FRAME), path)
    return open_results(path)


def test_a_diagram_of_moments_is_within_its_axes(frame: Results) -> None:
    """M is on the tension side: left of the column, above the arm, where nothing else is drawn."""
    axes, = draw(frame, "section_forces", symbols=False).axes
    drawn = np.vstack([line.get_xydata() for line in axes.lines])
    for values, (low, high) in zip(drawn.T, (axes.get_xlim(), axes.get_ylim()), strict=True):
        assert low < values.min()
        assert values.max() < high
    assert drawn[:, 0].min() < -0.2


def test_a_diagram_of_values_within_elements_follows_the_corners_of_the_axis(frame: Results) -> None:
    """With fibres, M is known at one point per element; the axis is drawn from end to end."""
    picture = build(frame, "section_forces")
    (d,), = picture.found.values()
    assert np.abs(d.whole - [0.0, 1.0]).sum(axis=1).min() < 1e-9
    np.testing.assert_allclose([d.whole[0], d.whole[-1]], [[0, 0], [1, 1]], atol=1e-12)
    corner = np.flatnonzero(np.abs(d.axis - [0.0, 1.0]).sum(axis=1) < 1e-9)
    np.testing.assert_allclose(d.normals[corner], [[-1, 0], [0, 1]], atol=1e-9)
    assert d.s[d.known].tolist() == pytest.approx([0.25, 0.75, 1.25, 1.75])
    assert d.values[d.known].tolist() == pytest.approx(frame.field("frame", "M")[:, 0, 0, 0].tolist())
    assert [row[2] for row in picture.rows()] == pytest.approx([0.25, 0.75, 1.25, 1.75])
    unrolled, = build(frame, "section_forces", unrolled=True).panels
    assert unrolled.curves[0].x.tolist() == pytest.approx([0.25, 0.75, 1.25, 1.75])


def test_bodies_without_the_field_are_drawn_as_outlines(tmp_path: Path) -> None:
    text = FRAME.replace("boundary_conditions: [{type: clamp, at: frame@0}]", """
  base: {geometry: {type: line, start: [0, -0.5], end: [0, 0]}, section: {height: 0.1, width: 0.1},
         material: {E: 1, nu: 0.3}, element: {type: rigid}}
boundary_conditions: [{type: clamp, at: base@0}]
joints: [{type: weld, between: [base@1, frame@0]}]""")
    run_case(load_case_text(text), str(tmp_path / "a.h5"))
    with open_results(tmp_path / "a.h5") as results:
        picture = build(results, "fields", unrolled=False)
        assert [s.name for s in picture.surfaces] == ["frame"]
        assert np.abs(picture.others[0].boundary - [0.05, -0.5]).sum(axis=1).min() < 1e-9
        assert picture.bounds()[0, 1] == pytest.approx(-0.5, abs=1e-2)


def test_numbers_beside_a_narrow_axis_do_not_touch() -> None:
    x = np.linspace(-0.112, 0.027, 9)
    figure = rendered(Curves("", "", [Panel(("x", "m"), ("y", "m"), [Curve("c", x, x)]) for _ in range(3)], share=""))
    figure.canvas.draw()
    for axes in figure.axes:
        shown = [t.get_window_extent() for t in axes.get_xticklabels() if t.get_text()]
        inside = [b for b in shown if axes.bbox.x0 - 1 <= 0.5 * (b.x0 + b.x1) <= axes.bbox.x1 + 1]
        assert len(inside) >= 3
        assert all(a.x1 < b.x0 for a, b in pairwise(inside))


def test_numbers_stay_within_the_frames_of_an_animation(frame: Results) -> None:
    """Axes with equal scales show more in more room, so their numbers change once they are placed."""
    picture = build(frame, "fields", unrolled=False)
    picture.box = np.array([[-0.0172, -0.1], [1.24, 1.46]])
    with style(Look()):
        figure = Figure(figsize=picture.size)
        FigureCanvasAgg(figure)
        _drawn(figure, picture, _lay_out(figure, picture))
        figure.canvas.draw()
    for axes in figure.axes:
        boxes = [t.get_window_extent() for t in axes.get_xticklabels() if t.get_text()]
        inside = [b for b in boxes if axes.bbox.x0 <= 0.5 * (b.x0 + b.x1) <= axes.bbox.x1]
        assert len(inside) > 4
        assert max(b.x1 for b in inside) <= figure.bbox.x1 + 0.5


def test_a_probe_of_any_name_has_a_legend_next_to_those_of_the_marks(tmp_path: Path) -> None:
    e0 = coordinates("tangent", np.array([0.0, 1.0]), 0.0)
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("b", 1, 1.0, 0.1)], e0) as w:
        for t in (0.0, 0.5, 1.0):
            w.append(t, 0 * e0, {}, {"end": {"x": t, "y": t * t}})
        w.finish()
    with open_results(tmp_path / "a.h5") as results:
        legend = draw(results, "trajectory").legends[0]
    assert [t.get_text() for t in legend.get_texts()] == ["end", "start", "end"]


def test_bifurcations_are_marked_on_the_path(tmp_path: Path) -> None:
    e0 = coordinates("tangent", np.array([0.0, 1.0]), 0.0)
    found = {"bifurcations": [{"factor": 1.5, "probes": {"p": {"uy": -0.1, "ux": 0.0}}}],
             "limit_points": [{"factor": 2.5, "probes": {"p": {"uy": -0.3, "ux": 0.0}}}]}
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("b", 1, 1.0, 0.1)], e0) as w:
        for factor, uy in ((0.0, 0.0), (2.4, -0.2), (2.0, -0.5)):
            w.append(factor, 0 * e0, {"step": 1, "factor": factor, "iterations": 2}, {"p": {"ux": 0.0, "uy": uy}})
        w.finish(found)
    with open_results(tmp_path / "a.h5") as results:
        (panel,) = build(results, "load_deflection").panels
        lines = draw(results, "load_deflection").axes[0].lines
    assert [c.name for c in panel.curves] == ["p uy", "limit points", "bifurcations"]
    assert (panel.curves[2].x.tolist(), panel.curves[2].y.tolist()) == ([-0.1], [1.5])
    assert lines[1].get_marker() != lines[2].get_marker()


def test_a_shape_at_the_onset_of_flutter_says_so_with_its_frequency(tmp_path: Path) -> None:
    table = {"load_factor": [20.05, 31.0], "omega": [11.02, 0.0], "instability": ["flutter", "divergence"]}
    write_tables(tmp_path / "a.h5", HEADER, {"modes": (table, {})}, (), {})
    with open_results(tmp_path / "a.h5") as results:
        assert [_label(results, k)[0] for k in (0, 1)] == [
            "load factor 20.05, flutter at 11.02 rad/s", "load factor 31, divergence"]


@pytest.mark.parametrize(("solver", "factor", "note"), [
    ("eigen", 0.0, "about the reference"), ("eigen", 1.0, "load factor 1"), ("static", 0.0, "load factor 0")])
def test_a_shape_of_small_motions_names_their_state(tmp_path: Path, solver: str, factor: float, note: str,
                                                    ) -> None:
    e0 = coordinates("tangent", np.array([0.0, 1.0]), 0.0)
    with ResultWriter(tmp_path / "a.h5", {**HEADER, "solver": solver}, [tangent_body("b", 1, 1.0, 0.1)], e0) as w:
        w.append(factor, 0 * e0, {})
        w.finish()
    with open_results(tmp_path / "a.h5") as results:
        assert build(results, "shape").note == note
