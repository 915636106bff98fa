"""Figures of snapshots, phase portraits, trajectories, paths, and work-precision show the computed values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Polygon
from synthetic import HEADER, coordinates, mechanism, table_file, tangent_body

from ancf2d.errors import ResultsError
from ancf2d.plot import draw
from ancf2d.plot.convergence import pareto
from ancf2d.plot.kinds import build
from ancf2d.results import ResultWriter, open_results

# ---------------------------------------------------------------------- snapshots, phase, trajectory


def test_snapshots_are_the_nearest_states(tmp_path: Path) -> None:
    with open_results(mechanism(tmp_path / "a.h5")) as results:
        picture = build(results, "snapshots", at="0, 0.26, 1")
        assert [m.t for m in picture.moments] == pytest.approx([0, 0.25, 1])
        assert picture.header()[1] == "time [s]"
        np.testing.assert_allclose(picture.moments[1].bodies["rod"].axis,
                                   results.faces("rod", 10)["axis"].reshape(-1, 2))
        assert [m.t for m in build(results, "snapshots", count=5).moments] == pytest.approx(np.linspace(0, 1, 5))
        outlines = [p for p in draw(results, "snapshots", count=3).axes[0].patches if isinstance(p, Polygon)]
        shades = [sum(p.get_edgecolor()[:3]) for p in outlines[::2]]
        assert shades == sorted(shades, reverse=True)  # later is darker, also in grey
        _, bar = draw(results, "snapshots", at="0, 0.25, 1").axes
        assert [t.get_text() for t in bar.get_xticklabels()] == ["0", "0.25", "1"]
        assert bar.get_xlabel() == "time [s]"
        with pytest.raises(ResultsError, match="states from 0 to 1, none at 2"):
            build(results, "snapshots", at="2")
        with pytest.raises(ResultsError, match="numbers separated by commas"):
            build(results, "snapshots", at="now")


def swinging(path: Path) -> Path:
    """Write a probe that swings as sin 3 t, with its rate."""
    e0 = coordinates("tangent", np.array([0.0, 1.0]), 0.0)
    with ResultWriter(path, {**HEADER, "solver": "dynamic"}, [tangent_body("b", 1, 1.0, 0.1)], e0) as w:
        for t in np.linspace(0, 1, 21):
            x, v = np.sin(3 * t), 3 * np.cos(3 * t)
            w.append(t, 0 * e0, None, {"p": {"x": x, "y": 2 * x, "ux": x, "uy": 0.0, "theta": 0.1 * x, "vx": v,
                                             "vy": 0.0, "omega": 0.1 * v}})
        return w.finish({})


def test_a_harmonic_motion_is_an_ellipse_in_its_phase_plane(tmp_path: Path) -> None:
    with open_results(swinging(tmp_path / "a.h5")) as results:
        panels = build(results, "phase").panels
        assert [p.x[0] for p in panels] == ["displacement ux", "rotation"]  # uy does not move
        curve, start, end = panels[0].curves
        np.testing.assert_allclose(curve.x**2 + (curve.y / 3) ** 2, 1.0, rtol=1e-12)
        assert (start.x.tolist(), start.y.tolist()) == ([0.0], [3.0])
        assert (end.x[0], end.y[0]) == (curve.x[-1], curve.y[-1])
        with pytest.raises(ResultsError, match="against their rates, not 'x'"):
            build(results, "phase", quantity="x")
        figure = draw(results, "phase")
        assert [t.get_text() for t in figure.legends[0].get_texts()] == ["p", "start", "end"]


def test_a_trajectory_has_one_scale_in_both_directions(tmp_path: Path) -> None:
    with open_results(swinging(tmp_path / "a.h5")) as results:
        curve = build(results, "trajectory").panels[0].curves[0]
        np.testing.assert_allclose(curve.y, 2 * curve.x)
        path, start, end = build(results, "trajectory").panels[0].curves
        assert (start.x[0], end.x[0]) == (path.x[0], path.x[-1])
        shown = draw(results, "trajectory").legends[0].get_texts()
        assert [t.get_text() for t in shown] == ["p", "start", "end"]
        assert draw(results, "trajectory").axes[0].get_aspect() == 1.0
        # a table has each state once, and a column for each quantity on an axis
        np.testing.assert_array_equal([row[1:] for row in build(results, "trajectory").rows()],
                                      np.column_stack([curve.x, curve.y]))
        phase = build(results, "phase")
        assert phase.header() == ["curve", "displacement ux [m]", "velocity vx [m/s]", "rotation [rad]",
                                  "angular velocity [rad/s]"]
        rows = list(phase.rows())
        assert len(rows) == 2 * len(curve.x)
        assert [tuple(row[3:]) for row in rows[:2]] == 2 * [("", "")]


def test_limit_points_are_marked_on_the_path(tmp_path: Path) -> None:
    e0 = coordinates("tangent", np.array([0.0, 1.0]), 0.0)
    limits = [{"factor": 2.5, "probes": {"p": {"uy": -0.3, "ux": 0.0}}}]
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("b", 1, 1.0, 0.1)], e0) as w:
        for factor, uy in ((0.0, 0.0), (2.4, -0.2), (2.0, -0.5)):
            w.append(factor, 0 * e0, {"step": 1, "factor": factor, "iterations": 2}, {"p": {"ux": 0.0, "uy": uy}})
        w.finish({"limit_points": limits})
    with open_results(tmp_path / "a.h5") as results:
        (panel,) = build(results, "load_deflection").panels
        assert [c.name for c in panel.curves] == ["p uy", "limit points"]
        assert panel.curves[1].texts == ["1"]
        assert (panel.curves[1].x.tolist(), panel.curves[1].y.tolist()) == ([-0.3], [2.5])


# ---------------------------------------------------------------------- work and precision


def test_the_front_is_unbeaten_in_time_and_error() -> None:
    work, error = np.array([1.0, 2.0, 3.0, 2.5, 0.5]), np.array([1e-2, 1e-3, 1e-3, 1e-4, 1e-1])
    assert pareto(work, error).tolist() == [4, 0, 1, 3]


def test_work_and_precision_of_a_convergence_table(tmp_path: Path) -> None:
    with open_results(table_file(tmp_path / "a.h5", {"2d2n": 2, "reissner3": 4})) as results:
        picture = build(results, "work_precision")
        assert [c.name for c in picture.panels[0].curves] == ["2d2n", "reissner3", "best for their time"]
        assert picture.panels[0].curves[2].y.tolist() == [0.5 * 16.0**-4]
        axes = draw(results, "work_precision").axes[0]
        assert (axes.get_xscale(), axes.get_yscale(), axes.get_xlabel()) == ("log", "log", "wall time [ms]")
