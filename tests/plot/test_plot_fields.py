"""Figures of fields, section forces, snapshots, phase portraits and trajectories show what was computed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.patches import Polygon
from synthetic import bent_beam, mechanism

from ancf2d.errors import ResultsError
from ancf2d.plot import draw
from ancf2d.plot.kinds import build
from ancf2d.results import Results, ResultWriter, open_results
from ancf2d.study.run import load_case, run_case, vocabulary

L, H, B, F = 2.0, 0.4, 0.1, -1000.0
I, A = B * H**3 / 12, B * H
CASE = """
title: Cantilever
bodies:
  beam:
    geometry: {type: line, start: [0, 0], end: [2, 0]}
    section: {height: 0.4, width: 0.1}
    material: {E: 2.07e11, nu: 0.3}
    element: {type: reissner3, count: 4}
boundary_conditions: [{name: wall, type: clamp, at: beam@0, hold: section}]
loads: [{type: force, at: beam@1, value: [0, -1000]}]
solver: {type: linear_static}
output: {fields: [energy, stress, N, Q, M]}
"""


@pytest.fixture(scope="module")
def bent(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Results]:
    folder = tmp_path_factory.mktemp("fields")
    (folder / "a.yaml").write_text(CASE)
    run_case(load_case(folder / "a.yaml", (), vocabulary()), str(folder / "a.h5"))
    with open_results(folder / "a.h5") as results:
        yield results


# ---------------------------------------------------------------------- fields


def test_colours_are_the_bending_stress_at_each_point(bent: Results) -> None:
    picture = build(bent, "fields", scale=1, unrolled=False)
    (surface,) = picture.surfaces
    x, y = surface.s[..., None], np.linspace(-H / 2, H / 2, 9)
    np.testing.assert_allclose(surface.values, -F * (L - x) * y / I, atol=1e-6 * abs(F) * L * H / I)
    np.testing.assert_allclose(surface.points[..., 0], np.broadcast_to(x, surface.values.shape), atol=1e-5)
    np.testing.assert_allclose(surface.points[..., 1], np.broadcast_to(y, surface.values.shape), atol=1e-4)
    top = abs(F) * L * H / 2 / I
    np.testing.assert_allclose(picture.range(), (-top, top), rtol=1e-6)


def test_the_parabola_of_shear_is_drawn_between_its_stations(bent: Results) -> None:
    (surface,) = build(bent, "fields", component="xy").surfaces
    expected = 1.5 * F / A * (1 - np.linspace(-1, 1, 9) ** 2)
    np.testing.assert_allclose(surface.values[2, 7], expected, atol=1e-6 * abs(F) / A)


def test_von_mises_stress_on_the_axis_is_that_of_shear(bent: Results) -> None:
    (surface,) = build(bent, "fields", component="mises").surfaces
    np.testing.assert_allclose(surface.values[..., 4], np.sqrt(3) * 1.5 * abs(F) / A, rtol=1e-5)


@pytest.mark.parametrize(("options", "y_label"), [({"unrolled": True}, "y, across [m]"), ({}, "y [m]")])
def test_a_field_is_labelled_with_its_units(bent: Results, options: dict[str, bool], y_label: str) -> None:
    figure = draw(bent, "fields", **options)
    axes, bar = figure.axes
    assert bar.get_xlabel() == "stress along the axis, σ_xx [N/m²]"
    assert axes.get_ylabel() == y_label
    (mesh,) = [c for c in axes.collections if isinstance(c, QuadMesh)]
    assert mesh.get_array().shape == (4 * 21, 9)


def test_rows_are_the_drawn_values(bent: Results) -> None:
    picture = build(bent, "fields", scale=1)
    rows = list(picture.rows())
    assert len(rows) == 4 * 21 * 9
    assert picture.header() == ["body", "element", "s [m]", "x [m]", "y [m]", "stress along the axis, σ_xx [N/m^2]"]
    assert rows[-1][2] == pytest.approx(L)


@pytest.mark.parametrize(("options", "words"), [
    ({"field": "strain"}, "no field 'strain' .it has energy, stress; name those to store under output"),
    ({"field": "M"}, "along the axis only; draw it as section_forces"),
    ({"component": "zz"}, "no component 'zz' .it has xx, yy, xy, mises"), ({"state": 5}, "no state 5: it holds")])
def test_wrong_fields_are_explained(bent: Results, options: dict[str, object], words: str) -> None:
    with pytest.raises(ResultsError, match=words):
        build(bent, "fields", **options)


def test_a_file_without_fields_says_how_to_store_them(tmp_path: Path) -> None:
    with open_results(bent_beam(tmp_path / "a.h5")) as results:
        for kind, what in (("fields", "fields: .stress."), ("section_forces", "fields: .N, Q, M.")):
            with pytest.raises(ResultsError, match=what):
                build(results, kind)


# ---------------------------------------------------------------------- section forces


def test_section_forces_of_a_cantilever_and_no_noise(bent: Results) -> None:
    N, Q, M = build(bent, "section_forces").panels
    s = M.curves[0].x
    assert s[-1] == pytest.approx(L)
    np.testing.assert_allclose(M.curves[0].y, F * (L - s), atol=1e-6 * abs(F))
    np.testing.assert_allclose(Q.curves[0].y, F, rtol=1e-6)
    assert not N.curves[0].y.any()
    assert (M.y, N.y) == (("bending moment M", "N*m"), ("axial force N", "N"))
    assert [p.y[0] for p in build(bent, "section_forces", quantity="M").panels] == ["bending moment M"]
    with pytest.raises(ResultsError, match="draws N, Q, M, not 'T'"):
        build(bent, "section_forces", quantity="T")


# ---------------------------------------------------------------------- snapshots, phase, trajectory


def test_snapshots_are_the_nearest_states(tmp_path: Path) -> None:
    with open_results(mechanism(tmp_path / "a.h5")) as results:
        picture = build(results, "snapshots", at="0, 0.26, 1")
        assert [m.t for m in picture.moments] == pytest.approx([0, 0.25, 1])
        np.testing.assert_allclose(picture.moments[1].bodies["rod"].axis,
                                   results.faces("rod", 10)["axis"].reshape(-1, 2))
        assert [m.t for m in build(results, "snapshots", count=5).moments] == pytest.approx(np.linspace(0, 1, 5))
        outlines = [p for p in draw(results, "snapshots", count=3).axes[0].patches if isinstance(p, Polygon)]
        shades = [sum(p.get_edgecolor()[:3]) for p in outlines[::2]]
        assert shades == sorted(shades, reverse=True)  # later is darker, also in grey
        with pytest.raises(ResultsError, match="states from 0 to 1, none at 2"):
            build(results, "snapshots", at="2")
        with pytest.raises(ResultsError, match="numbers separated by commas"):
            build(results, "snapshots", at="now")


def swinging(path: Path) -> Path:
    """Write a probe that swings as sin 3 t, with its rate."""
    from synthetic import HEADER, coordinates, tangent_body

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
        curve, start = panels[0].curves
        np.testing.assert_allclose(curve.x**2 + (curve.y / 3) ** 2, 1.0, rtol=1e-12)
        assert (start.x.tolist(), start.y.tolist()) == ([0.0], [3.0])
        with pytest.raises(ResultsError, match="against their rates, not 'x'"):
            build(results, "phase", quantity="x")
        figure = draw(results, "phase")
        assert [t.get_text() for t in figure.legends[0].get_texts()] == ["p"]


def test_a_trajectory_has_one_scale_in_both_directions(tmp_path: Path) -> None:
    with open_results(swinging(tmp_path / "a.h5")) as results:
        curve = build(results, "trajectory").panels[0].curves[0]
        np.testing.assert_allclose(curve.y, 2 * curve.x)
        assert draw(results, "trajectory").axes[0].get_aspect() == 1.0


def test_limit_points_are_marked_on_the_path(tmp_path: Path) -> None:
    from synthetic import HEADER, coordinates, tangent_body

    e0 = coordinates("tangent", np.array([0.0, 1.0]), 0.0)
    limits = [{"factor": 2.5, "probes": {"p": {"uy": -0.3, "ux": 0.0}}}]
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("b", 1, 1.0, 0.1)], e0) as w:
        for factor, uy in ((0.0, 0.0), (2.4, -0.2), (2.0, -0.5)):
            w.append(factor, 0 * e0, {"step": 1, "factor": factor, "iterations": 2}, {"p": {"ux": 0.0, "uy": uy}})
        w.finish({"limit_points": limits})
    with open_results(tmp_path / "a.h5") as results:
        (panel,) = build(results, "load_deflection").panels
        assert [c.name for c in panel.curves] == ["p uy", "limit points"]
        assert (panel.curves[1].x.tolist(), panel.curves[1].y.tolist()) == ([-0.3], [2.5])


# ---------------------------------------------------------------------- work and precision


def test_the_front_is_what_nothing_beats_in_time_and_error() -> None:
    from ancf2d.plot.convergence import pareto

    work, error = np.array([1.0, 2.0, 3.0, 2.5, 0.5]), np.array([1e-2, 1e-3, 1e-3, 1e-4, 1e-1])
    assert pareto(work, error).tolist() == [4, 0, 1, 3]


def test_work_and_precision_of_a_convergence_table(tmp_path: Path) -> None:
    from synthetic import table_file

    with open_results(table_file(tmp_path / "a.h5", {"2d2n": 2, "reissner3": 4})) as results:
        picture = build(results, "work_precision")
        assert [c.name for c in picture.panels[0].curves] == ["2d2n", "reissner3", "best for their time"]
        assert picture.panels[0].curves[2].y.tolist() == [0.5 * 16.0**-4]
        axes = draw(results, "work_precision").axes[0]
        assert (axes.get_xscale(), axes.get_yscale(), axes.get_xlabel()) == ("log", "log", "wall time [s]")


def test_an_energy_density_is_never_drawn_negative(bent: Results) -> None:
    picture = build(bent, "fields", field="energy")
    stored = bent.field("beam", "energy")
    assert picture.range() == pytest.approx((stored.min(), stored.max()))
    assert stored.min() >= 0.0
