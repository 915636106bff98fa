"""Contents of the figures: the right data, labelled with units; available figures, and their style."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from PIL import Image
from synthetic import HEADER, bent_beam, coordinates, legend_texts, mechanism, opened, table_file, tangent_body

from ancf2d.errors import ResultsError
from ancf2d.plot import (
    KINDS,
    Curve,
    Curves,
    Look,
    Panel,
    Source,
    animate,
    default_kind,
    draw,
    list_kinds,
    rendered,
    save,
)
from ancf2d.plot.convergence import observed_order
from ancf2d.plot.style import MAX_ENTRIES
from ancf2d.results import ResultWriter, write_tables

# ---------------------------------------------------------------------- lines


def test_load_deflection_shows_the_factor_over_the_displacements(tmp_path: Path) -> None:
    results = opened(bent_beam(tmp_path / "a.h5"))
    figure = draw(results, "load_deflection")
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("displacement [m]", "load factor")
    lines = {line.get_label(): line.get_xydata() for line in axes.lines}
    assert list(lines) == ["tip ux", "tip uy"]
    np.testing.assert_array_equal(lines["tip uy"][:, 0], results.probes["tip"]["uy"])
    np.testing.assert_array_equal(lines["tip uy"][:, 1], results.probe_t)


def test_a_quantity_of_round_off_is_drawn_only_on_request(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    e0 = np.zeros(8)
    with ResultWriter(path, HEADER, [tangent_body("beam", 1, 1.0, 0.1)], e0) as w:
        for t in (0.0, 0.5, 1.0):
            w.append(t, e0, {}, {"mid": {"ux": 1e-17 * t, "uy": -1e-3 * t}})
        w.finish()
    results = opened(path)
    assert legend_texts(draw(results, "load_deflection")) == ["mid uy"]
    assert legend_texts(draw(results, "load_deflection", quantity="ux")) == ["mid ux"]


def test_probes_without_displacements_are_drawn_on_request(tmp_path: Path) -> None:
    """Controllers show their outputs; reactions, named or alone, show all components."""
    force, motor, e0 = {"fx": 2.0, "fy": 3.0}, {"output": 0.5, "x": 2.0}, np.zeros(8)

    def path(name: str, probes: dict) -> Path:
        with ResultWriter(tmp_path / name, HEADER, [tangent_body("beam", 1, 1.0, 0.1)], e0) as w:
            for t in (0.0, 0.5, 1.0):
                w.append(t, e0, {}, probes)
            w.finish()
        return tmp_path / name

    results = opened(path("a.h5", {"mid": {"x": 1.0, "uy": -1e-3}, "motor": motor, "left": force}))
    assert legend_texts(draw(results, "history")) == ["mid uy", "motor output"]
    assert legend_texts(draw(results, "history", probe=["motor"])) == ["motor output"]
    assert legend_texts(draw(results, "history", probe=["left", "mid"])) == ["left fx", "left fy", "mid uy"]
    assert legend_texts(draw(results, "load_deflection", probe=["left"])) == ["left fx", "left fy"]
    assert legend_texts(draw(opened(path("b.h5", {"left": force})), "history")) == ["left fx", "left fy"]


@pytest.mark.parametrize("accuracy", [{}, {"value": 1.5, "estimate": 0.1}, {"value": 2.0, "estimate": 0.1}])
def test_goals_over_windows_are_drawn_with_their_error(tmp_path: Path, accuracy: dict) -> None:
    """The estimated error of the goal, or else that of the stored times."""
    window = {"of": "mid uy", "from": 0.2, "to": 0.8, "value": 1.5, "sampling": 0.3}
    other, e0 = {**window, "of": "tip uy"}, np.zeros(8)
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("beam", 1, 1.0, 0.1)], e0) as w:
        for t in (0.0, 0.5, 1.0):
            w.append(t, e0, {}, {"mid": {"uy": 2 * t}})
        w.finish({"windows": {"mean": window, "not drawn": other}, "accuracy": accuracy})
    error = 0.15 if accuracy.get("value") == 1.5 else 0.3
    (axes,) = draw(opened(tmp_path / "a.h5"), "history").axes
    assert [line.get_label() for line in axes.lines] == ["mid uy", f"mean: 1.5 within {error:g}"]
    x, y = axes.lines[1].get_xydata().reshape(3, 3, 2).transpose(2, 0, 1)
    np.testing.assert_array_equal(x[:, :2], [[0.2, 0.8]] * 3)
    np.testing.assert_allclose(y, np.outer([1.5, 1.5 - error, 1.5 + error], np.ones(3)))


@pytest.mark.parametrize("count", [2, 100])
def test_events_are_vertical_lines_unless_there_are_very_many(tmp_path: Path, count: int) -> None:
    times, e0 = np.linspace(0.2, 0.8, count), np.zeros(8)
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("beam", 1, 1.0, 0.1)], e0) as w:
        for t in (0.0, 1.0):
            w.append(t, e0, {}, {"mid": {"uy": 2 * t}})
        w.finish({"events": [{"t": t, "what": "latch ends"} for t in times.tolist()]})
    (axes,) = draw(opened(tmp_path / "a.h5"), "history").axes
    lines = [line.get_xydata() for line in axes.lines if line.get_label() == "events"]
    assert len(lines) == (count == 2)
    for drawn in lines:
        np.testing.assert_allclose(drawn.reshape(2, 3, 2)[:, :2], [[[0.2, 0.0], [0.2, 2.0]], [[0.8, 0.0], [0.8, 2.0]]])


@pytest.mark.parametrize("count", [2, 100])
def test_impacts_are_vertical_lines_at_the_strongest(tmp_path: Path, count: int) -> None:
    """Here the last ones are the strongest."""
    times, e0 = np.linspace(0.2, 0.8, count), np.zeros(8)
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("beam", 1, 1.0, 0.1)], e0) as w:
        for t in (0.0, 1.0):
            w.append(t, e0, {}, {"mid": {"uy": 2 * t}})
        w.table("impacts", {"t": times.tolist(), "impulse": times.tolist()})
        w.finish({"impacts": {"count": count}})
    (axes,) = draw(opened(tmp_path / "a.h5"), "history").axes
    (drawn,) = [line.get_xydata() for line in axes.lines if line.get_label() == "impacts"]
    x = drawn.reshape(-1, 3, 2)[:, :2]
    np.testing.assert_allclose(x[:, 0, 0], times[-40:])
    np.testing.assert_allclose(x[:, :, 1], [[0.0, 2.0]] * len(x))


def test_history_has_a_panel_for_each_unit(tmp_path: Path) -> None:
    results = opened(mechanism(tmp_path / "a.h5"))
    figure = draw(results, "history")
    first, second = figure.axes
    assert (first.get_ylabel(), second.get_ylabel()) == ("displacement [m]", "rotation [rad]")
    assert second.get_xlabel() == "time [s]"
    assert [line.get_label() for line in second.lines] == ["end theta", "pin theta"]
    np.testing.assert_array_equal(second.lines[1].get_ydata(), results.probes["pin"]["theta"])
    (only,) = draw(results, "history", probe="pin", quantity=["uy"]).axes
    assert [line.get_label() for line in only.lines] == ["pin uy"]


def test_lines_never_differ_only_in_colour(tmp_path: Path) -> None:
    figure = draw(opened(mechanism(tmp_path / "a.h5")), "history")
    lines = [line for axes in figure.axes for line in axes.lines]
    looks = {(line.get_marker(), str(line.get_linestyle()), str(line._dash_pattern))
             for line in lines}
    assert len(looks) == len(lines) == 6


def test_convergence_shows_the_errors_and_the_observed_orders(tmp_path: Path) -> None:
    results = opened(table_file(tmp_path / "a.h5", {"2d2n": 2.0, "cable": 4.0}))
    figure = draw(results, "convergence")
    (axes,) = figure.axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert legend_texts(figure) == ["2d2n, order 2.0", "cable, order 4.0"]
    np.testing.assert_allclose(axes.lines[1].get_ydata(), 0.5 * np.array([2., 4, 8, 16]) ** -4,
                               rtol=1e-12)
    figure = draw(results, "convergence", against="dofs")
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_xdata(), [12, 24, 48, 96])
    assert figure.axes[0].get_xlabel() == "nodal coordinates"


def test_an_error_of_zero_is_drawn_and_noted(tmp_path: Path) -> None:
    results = opened(table_file(tmp_path / "a.h5", {"exact": 2000.0}, (1, 2, 4)))
    figure = draw(results, "convergence")
    assert "errors of zero are drawn at 1e-16" in figure.axes[0].get_title(loc="left")
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_ydata(), [0.5, 1e-16, 1e-16])
    assert legend_texts(figure) == ["exact, order undefined"]


def test_the_goal_itself_over_the_meshes(tmp_path: Path) -> None:
    results = opened(table_file(tmp_path / "a.h5", {"2d2n": 2.0, "cable": 4.0}))
    (axes,) = draw(results, "convergence", values=True).axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "linear")
    assert axes.get_ylabel() == "tip uy"
    np.testing.assert_allclose(axes.lines[0].get_ydata(), 1 + 0.5 * np.array([2., 4, 8, 16]) ** -2, rtol=1e-12)
    assert axes.lines[0].get_label() == "2d2n"


def test_files_with_one_type_each_are_labelled_by_their_names(tmp_path: Path) -> None:
    a, b = (opened(table_file(tmp_path / f"{n}.h5", {e: p})) for n, e, p in
            (("a", "2d2n", 2.0), ("b", "cable", 4.0)))
    assert legend_texts(draw([a, b])) == ["a (2d2n), order 2.0", "b (cable), order 4.0"]
    assert legend_texts(draw({"ours": a, "theirs": b})) == ["ours, order 2.0", "theirs, order 4.0"]
    both = opened(table_file(tmp_path / "both.h5", {"2d2n": 2.0, "cable": 4.0}))
    assert legend_texts(draw({"a": a, "both": both}))[1:] == ["both: 2d2n, order 2.0", "both: cable, order 4.0"]


@pytest.mark.parametrize(("reference", "said"), [
    ("auto", "errors against each type's own limit"), (-0.5, "errors against -0.5")])
def test_a_convergence_figure_names_the_reference_of_its_errors(tmp_path: Path, reference: object, said: str) -> None:
    path = tmp_path / "a.h5"
    with ResultWriter(path, HEADER, [], np.zeros(0)) as w:
        w.table("convergence", {"element": ["cable"] * 2, "elements": [1, 2], "error": [1.0, 0.5]},
                {"goal": "tip uy", "reference": reference})
        w.finish()
    (axes,) = draw(opened(path)).axes
    assert axes.get_title(loc="left").endswith(said)
    assert axes.get_ylabel() == "relative error of tip uy"


@pytest.mark.parametrize(("errors", "order"), [
    ([1.0, 0.25, 0.0625], 2.0), ([0.5, 1.0, 0.125, 0.015625], 3.0),
    ([1.0, 1e-2, 1e-4, 3e-16], np.log2(100)), ([1e-15, 2e-15, 1e-15], np.nan), ([0.1], np.nan),
    ([1.0, 0.5, 0.6, 0.1], 1.0),
    # an error that stays as it is has no order, unless it is round-off; a slow start is no end
    ([3e-2, 3e-2, 3e-2], np.nan), ([3e-2, 3e-2 - 1e-5, 3e-2 - 2e-5], np.nan), ([0.1, 0.05, 0.0499, 0.0499], np.nan),
    ([1.0, 1e-2, 1e-9, 0.99e-9], np.log2(1e7)), ([1.0, 0.99, 0.5, 0.125], 2.0)])
def test_the_observed_order_is_that_of_the_last_refinement_before_round_off(
        errors: list[float], order: float) -> None:
    n = 2.0 ** np.arange(len(errors))
    assert observed_order(n, np.array(errors)) == pytest.approx(order, nan_ok=True)


def test_formulations_of_one_type_are_distinguished(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with ResultWriter(path, HEADER, [tangent_body("beam", 1, 1.0, 0.1)], np.zeros(8)) as w:
        w.table("convergence", {"element": ["2d2n"] * 4, "formulation": ["a", "b"] * 2,
                                "elements": [1, 1, 2, 2], "error": [1.0, 1.0, 0.5, 0.25]})
        w.finish()
    assert legend_texts(draw(opened(path))) == ["2d2n (a), order 1.0", "2d2n (b), order 2.0"]


# ---------------------------------------------------------------------- choosing


def test_a_sensible_kind_is_chosen(tmp_path: Path) -> None:
    assert default_kind(opened(bent_beam(tmp_path / "a.h5"))) == "shape"
    assert default_kind(opened(mechanism(tmp_path / "b.h5"))) == "history"
    assert default_kind(opened(table_file(tmp_path / "c.h5", {"cable": 4.0}))) == "convergence"


def test_the_list_says_which_data_a_file_lacks(tmp_path: Path) -> None:
    found = {k.name: k for k in list_kinds(opened(mechanism(tmp_path / "a.h5")))}
    assert list(found) == list(KINDS)
    assert found["shape"].missing == found["history"].missing == ""
    assert "not over a load factor" in found["load_deflection"].missing
    assert "no convergence table" in found["convergence"].missing
    assert found["shape"].options == ("scale", "state", "symbols")
    assert all(k.doc for k in found.values())


def test_a_difference_is_listed_with_files_to_compare(tmp_path: Path) -> None:
    results = opened(bent_beam(tmp_path / "a.h5"))
    one, two = ({k.name: k.missing for k in list_kinds(results, files)} for files in (1, 2))
    assert one["difference"] == "it compares at least 2 files"
    assert two == {**one, "difference": ""}


@pytest.mark.parametrize(("value", "told"), [(0.0, True), (2.0, False)])
def test_a_tornado_names_the_change_of_numbers_that_are_zero(tmp_path: Path, value: float, told: bool) -> None:
    path = tmp_path / "s.h5"
    table = {"path": ["a", "b"], "value": [3.0, value], "derivative": [1.0, -1.0], "influence": [3.0, 2.0]}
    write_tables(path, HEADER, {"sensitivity": (table, {})}, (), {})
    figure = draw(opened(path), "tornado")
    assert ("where it is 0: +1% of the largest" in figure.axes[0].get_title("left")) == told


@pytest.mark.slow
def test_every_kind_that_a_file_supports_can_be_drawn(tmp_path: Path) -> None:
    drawn = set()
    for path in (bent_beam(tmp_path / "a.h5", finish=False), mechanism(tmp_path / "b.h5"),
                 table_file(tmp_path / "c.h5", {"cable": 4.0}), bent_beam(tmp_path / "d.h5")):
        results = opened(path)
        for kind in list_kinds(results, 2):
            if not kind.missing and (kind.name not in drawn or path.stem == "b"):
                files = [results, results] if kind.name == "difference" else results
                draw(files, kind.name).draw_without_rendering()
                drawn.add(kind.name)
    assert {"shape", "history", "convergence", "difference"} <= drawn


def test_figures_of_one_file_refuse_several(tmp_path: Path) -> None:
    fit = tmp_path / "fit.h5"
    table = {"t": [0.0, 1.0], "data tip.uy": [0.0, 1.0], "model tip.uy": [0.0, 0.9]}
    write_tables(fit, HEADER, {"fitted": (table, {})}, (), {})
    with pytest.raises(ResultsError, match="fit is drawn from one file at a time, not from 2"):
        draw([opened(fit), opened(fit)], "fit")


def test_wrong_names_are_answered_with_the_nearest(tmp_path: Path) -> None:
    results = opened(bent_beam(tmp_path / "a.h5"))
    with pytest.raises(ResultsError, match=r"unknown kind of figure 'shap'.*did you mean 'shape'"):
        draw(results, "shap")
    with pytest.raises(ResultsError, match=r"a\.h5' as convergence: it holds no convergence"):
        draw(results, "convergence")
    with pytest.raises(ResultsError, match=r"no option 'scal'.*did you mean 'scale'"):
        draw(results, "shape", scal=2)
    with pytest.raises(ResultsError, match=r"no probe 'tap'.*did you mean 'tip'"):
        draw(results, "history", probe="tap")
    with pytest.raises(ResultsError, match=r"no probe quantity 'thea'.*did you mean 'theta'"):
        draw(results, "history", quantity="thea")
    with pytest.raises(ResultsError, match="no result file to draw"):
        draw([])


def test_a_title_with_dollar_signs_and_braces_is_shown_as_it_is(tmp_path: Path) -> None:
    text = r"cost $\frac{1$ of the $beam_{$"
    results = opened(bent_beam(tmp_path / "a.h5", header={"title": text}))
    figure = draw({"$x_{$": results, "b": results}, "shape")
    figure.draw_without_rendering()
    assert figure.axes[0].get_title(loc="left").startswith(text)


# ---------------------------------------------------------------------- looks


def test_triangles_show_the_order_and_lines_without_one_say_so(tmp_path: Path) -> None:
    """The long side of a triangle is parallel to the line above it: its errors fall with that power."""
    table_file(tmp_path / "a.h5", {"2d2n": 2, "reissner3": 4})
    with opened(tmp_path / "a.h5") as results:
        (panel,) = KINDS["convergence"].build([Source("", results)]).panels
        figure = draw(results, "convergence")
    assert [t.order for t in panel.triangles] == [2, 4]
    for k, (triangle, curve) in enumerate(zip(panel.triangles, panel.curves, strict=True)):
        assert triangle.x == (curve.x[2 - k], curve.x[3 - k])
        assert triangle.y == curve.y[2 - k]
    corner, right = figure.axes[0].patches[1].get_xy()[:2]
    assert np.log(corner[1] / right[1]) / np.log(right[0] / corner[0]) == pytest.approx(4)
    with h5py.File(tmp_path / "a.h5", "r+") as f:
        summary = json.loads(f["summary"][()])
        summary["elements"] = [{"element": "2d2n", "formulation": "default", "asymptotic": False},
                               {"element": "reissner3", "formulation": "default", "asymptotic": True}]
        del f["summary"]
        f["summary"] = np.bytes_(json.dumps(summary))
    assert legend_texts(draw(opened(tmp_path / "a.h5"), "convergence")) == [
        "2d2n, order 2.0, not asymptotic", "reissner3, order 4.0"]


def test_short_steps_on_a_logarithmic_axis_have_few_labels() -> None:
    curve = Curve("a", np.linspace(0, 1, 9), np.geomspace(1e-6, 1e-2, 9))
    axes = rendered(Curves("", "", [Panel(("time", "s"), ("step size", "s"), [curve], log=True)])).axes[0]
    assert axes.get_ylabel() == "step size [ms]"
    assert not [t.get_text() for t in axes.get_yticklabels(minor=True) if t.get_text()]


@pytest.mark.parametrize(("last", "unit", "factor"), [(2.0, "s", 1), (0.05, "ms", 1e3), (2e-5, "µs", 1e6),
                                                      (2e-8, "ns", 1e9)])
def test_short_times_have_a_smaller_unit(last: float, unit: str, factor: float) -> None:
    times = np.linspace(0, last, 5)
    figure = rendered(Curves("", "", [Panel(("time", "s"), ("uy", "m"), [Curve("a", times, times)])]))
    axes = figure.axes[0]
    assert axes.get_xlabel() == f"time [{unit}]"
    assert axes.get_ylabel() == "uy [m]"
    if factor == 1:
        return
    ticks = [(v, t.get_text()) for v, t in zip(axes.get_xticks(), axes.get_xticklabels(), strict=True)]
    assert [float(text) for _, text in ticks] == pytest.approx([v * factor for v, _ in ticks])
    assert max(abs(float(text)) for _, text in ticks) >= 1


@pytest.mark.parametrize(("value", "whole"), [(2.0, True), (0.02, False)])
def test_nearly_equal_values_have_distinct_tick_labels(value: float, whole: bool) -> None:
    t = np.linspace(0, 1, 9)
    curve = Curve("a", t, value * (1 + 1e-15 * np.cos(30 * t)))
    axes = rendered(Curves("", "", [Panel(("time", "s"), ("dt", "s"), [curve], whole=whole)])).axes[0]
    ticks = [label.get_text() for label in axes.get_yticklabels()]
    assert len(set(ticks)) == len(ticks) >= 3
    assert not whole or all("." not in text for text in ticks)


def test_a_legend_of_very_many_lines_leaves_room_for_them() -> None:
    x = np.linspace(0, 1, 5)
    figure = rendered(Curves("", "", [Panel(("x", ""), ("y", ""), [Curve(f"part {k}", x, k * x) for k in range(100)])]))
    assert legend_texts(figure)[-1] == f"and {101 - MAX_ENTRIES} more"
    assert len(legend_texts(figure)) == MAX_ENTRIES
    assert figure.axes[0].get_position().height > 0.4


def test_long_lines_keep_a_few_markers() -> None:
    """So lines differ in grey too; each begins with another point."""
    t = np.linspace(0, 1, 1000)
    lines = rendered(Curves("", "", [Panel(("x", ""), ("y", ""), [Curve("a", t, t), Curve("b", t, t)])])).axes[0].lines
    marked = [line.get_markevery() for line in lines]
    assert [len(t[first::each]) for first, each in marked] == [pytest.approx(12, abs=1)] * 2
    assert marked[0] != marked[1]


def test_more_than_seven_bodies_have_distinct_styles(tmp_path: Path) -> None:
    bodies = [tangent_body(f"b{k}", 1, 1.0, 0.1, first=8 * k) for k in range(10)]
    e0 = np.concatenate([coordinates("tangent", np.array([k, k + 1.0]), 0.0) for k in range(10)])
    with ResultWriter(tmp_path / "a.h5", HEADER, bodies, e0) as w:
        w.append(0.0, 0 * e0, {}, {})
        w.finish({"status": "converged"})
    drawn = [p for p in draw(opened(tmp_path / "a.h5"), "shape").axes[0].patches if p.get_label() in
             {f"b{k}" for k in range(10)}]
    looks = {(p.get_edgecolor(), p.get_hatch(), str(p.get_linestyle())) for p in drawn}
    assert len(drawn) == len(looks) == 10


def test_size_font_and_resolution_are_those_requested(tmp_path: Path) -> None:
    sheet = tmp_path / "mine.mplstyle"
    sheet.write_text("axes.facecolor: 123456\n")
    look = Look(size=(5.0, 3.0), font_size=14, dpi=50, sheet=str(sheet))
    with opened(bent_beam(tmp_path / "a.h5")) as results:
        figure = draw(results, "history", look=look)
        assert figure.axes[0].get_facecolor()[:3] == pytest.approx((0x12 / 255, 0x34 / 255, 0x56 / 255))
        assert figure.axes[0].xaxis.label.get_fontsize() == 14
        with Image.open(save(figure, tmp_path / "a.png", look=look)) as image:
            assert image.size == (250, 150)
        with pytest.raises(ResultsError, match="neither a style file"):
            draw(results, "history", look=Look(sheet="none.mplstyle"))
        with Image.open(animate(results, tmp_path / "a.gif", "shape", length=2, look=look)) as image:
            assert image.size == (250, 150)
