"""Distances between the axes of the same bodies in different files: correct, over S, refused if meaningless."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from synthetic import BODIES, HEADER, bent_beam, coordinates, hermite, mechanism

from ancf2d.errors import ResultsError
from ancf2d.plot import data_csv, draw
from ancf2d.results import Results, ResultWriter, open_results

LENGTH = 2.0


def beam(folder: Path, name: str, kind: str = "tangent", **options: object) -> Results:
    return open_results(bent_beam(folder / f"{name}.h5", kind, length=LENGTH, **options))


def circle(s: np.ndarray, angle: float) -> np.ndarray:
    """Points of the beam bent into a circle, at fractions s of its length."""
    return LENGTH / angle * np.stack([np.sin(angle * s), 1 - np.cos(angle * s)], 1)


def arch(path: Path, kind: str, ne: int, curvature: float) -> Results:
    """A body that is an arc in its reference, unloaded."""
    e0 = coordinates(kind, np.linspace(0, LENGTH, ne + 1), curvature)
    with ResultWriter(path, HEADER, [BODIES[kind]("beam", ne, LENGTH, 0.1)], e0) as w:
        w.append(1.0, np.zeros_like(e0), {"step": 1})
        w.finish({"status": "converged"})
    return open_results(path)


def read(path: Path) -> tuple[list[str], list[list[str]]]:
    with path.open(newline="") as stream:
        header, *rows = csv.reader(stream)
    return header, rows


def refusal(*results: Results, **options: object) -> str:
    with pytest.raises(ResultsError) as caught:
        draw(list(results), "difference", **options)
    return str(caught.value)


def test_the_axis_between_the_samples_is_that_of_the_shape_functions(tmp_path: Path) -> None:
    results = beam(tmp_path, "a", ne=3, angle=2.0)
    s = np.linspace(0, 1, 50)
    ie = np.minimum((3 * s).astype(int), 2)
    expected = np.empty((50, 2))
    for k, (i, xi) in enumerate(zip(ie, 3 * s - ie, strict=True)):
        shape, _ = hermite(np.array([xi]), LENGTH / 3)
        expected[k] = shape[0] @ results.d(-1)[results.body("beam").dofs[i]].reshape(4, 2)
    np.testing.assert_allclose(results.displacement("beam", s), expected, rtol=0, atol=1e-14)
    line = np.stack([LENGTH * s, 0 * s], 1)
    np.testing.assert_allclose(results.reference("beam", s), line, rtol=0, atol=1e-14)


@pytest.mark.parametrize("kind", ["tangent", "interpolated", "theta"])
def test_the_distance_of_two_circles_for_any_meshes_and_element_types(tmp_path: Path, kind: str) -> None:
    one = beam(tmp_path, "one", kind, ne=300, angle=1.01)
    two = beam(tmp_path, "two", ne=40, angle=1.0)
    (axes,) = draw([one, two], "difference").axes
    s, apart = axes.lines[0].get_xydata().T
    exact = np.linalg.norm(circle(s, 1.01) - circle(s, 1.0), axis=1)
    far = s > 0.3
    # the chords of 300 elements leave the circle by L angle/(8 n^2)
    np.testing.assert_allclose(apart[far], exact[far], rtol=0, atol=4e-6)
    assert apart[-1] == pytest.approx(exact[-1], rel=1e-9)
    assert {0.0, 0.25, 1.0} <= set(s)
    assert np.isin(one.body("beam").arclength, s).all()


def test_a_coarse_mesh_is_also_compared_within_its_elements(tmp_path: Path) -> None:
    one, two = beam(tmp_path, "one", "theta", ne=1, angle=1.0), beam(tmp_path, "two", ne=1, angle=1.0)
    s, apart = draw([one, two], "difference").axes[0].lines[0].get_xydata().T
    assert len(s) == 101
    middle = two.displacement("beam", np.array([0.5])) - one.displacement("beam", np.array([0.5]))
    assert apart[50] == pytest.approx(np.linalg.norm(middle), rel=1e-12)
    assert apart[50] > 0.1


def test_axes_and_legend_name_units_files_types_and_the_reference(tmp_path: Path) -> None:
    header = {"units": {"length": "mm", "force": "N", "time": "s"}}
    one, two, three = (beam(tmp_path, name, kind, angle=angle, header=header) for name, kind, angle in
                       (("coarse", "theta", 1.0), ("fine_2d2n", "interpolated", 1.1), ("last", "tangent", 1.2)))
    figure = draw([one, two, three], "difference")
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("S, fraction of the arc length", "distance between the axes [mm]")
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "log")
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["coarse (reissner2)", "fine_2d2n"]
    assert axes.get_title(loc="left").endswith("load factor 1, against last (cable)")
    for name in ("coarse", "coarse.h5", str(one.path), "coarse (reissner2)"):
        figure = draw([one, two, three], "difference", reference=name)
        assert [t.get_text() for t in figure.legends[0].get_texts()] == ["fine_2d2n", "last (cable)"]
    assert "none of the files is known by the name 'course'" in refusal(one, two, reference="course")
    assert "several of the files are known by the name 'coarse'" in refusal(one, one, two, reference="coarse")


def test_every_body_is_compared(tmp_path: Path) -> None:
    one, two = (open_results(mechanism(tmp_path / f"{n}.h5", steps)) for n, steps in (("one", 40), ("two", 20)))
    header, rows = read(data_csv([one, two], tmp_path / "a.csv", "difference", state=0))
    assert header == ["curve", "S, fraction of the arc length", "distance between the axes [m]"]
    assert {row[0] for row in rows} == {"one: crank", "one: rod"}
    # state 10 of one is at t = 0.25, of two at t = 0.5
    assert "not at the same time in state 10: 0.25 and 0.5" in refusal(one, two, state=10)
    assert "has no state 21: it holds 21" in refusal(one, two, state=21)


def test_the_data_are_the_distances_at_full_precision_and_round_off_is_not_drawn(tmp_path: Path) -> None:
    one, two = beam(tmp_path, "one", angle=1.0), beam(tmp_path, "two", angle=1.1)
    _, rows = read(data_csv([one, two], tmp_path / "a.csv", "difference"))
    s, apart = np.array([row[1:] for row in rows], float).T
    np.testing.assert_array_equal(apart, np.linalg.norm(one.displacement("beam", s) - two.displacement("beam", s),
                                                        axis=1))
    assert s[0] == 0.0
    assert apart[0] < 1e-16
    (line,) = draw([one, two], "difference").axes[0].lines
    assert np.isnan(line.get_ydata()[0])


def test_agreeing_files_are_reported(tmp_path: Path) -> None:
    one, two = (beam(tmp_path, name, angle=1.0) for name in ("one", "two"))
    figure = draw([one, two], "difference")
    assert figure.legends[0].get_texts()[0].get_text() == "one, agrees to round-off"
    assert figure.axes[0].get_yscale() == "linear"  # a logarithmic one would be empty
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_ydata(), 0.0)


def test_incomparable_files_are_refused(tmp_path: Path) -> None:
    one = beam(tmp_path, "one")
    assert "needs two result files" in refusal(one)
    other = open_results(mechanism(tmp_path / "other.h5"))
    assert "have different bodies: beam and crank, rod" in refusal(one, other)
    longer = open_results(bent_beam(tmp_path / "longer.h5", length=2.1))
    assert "geometry of 'beam' differs" in refusal(one, longer)
    assert "it is 2 and 2.1 m long" in refusal(one, longer)
    millimetres = beam(tmp_path, "mm", header={"units": {"length": "mm", "force": "N", "time": "s"}})
    assert "different units of length: m and mm" in refusal(one, millimetres)
    dynamic = beam(tmp_path, "dynamic", header={"solver": "dynamic"})
    assert "one holds states over time" in refusal(one, dynamic)
    assert "not at the same load factor in state 1: 0.2 and 0.1" in refusal(one, beam(tmp_path, "ten", steps=10),
                                                                           state=1)


def test_a_curved_reference_may_have_another_mesh_but_not_another_shape(tmp_path: Path) -> None:
    fine, coarse = arch(tmp_path / "fine.h5", "theta", 12, 0.7), arch(tmp_path / "coarse.h5", "theta", 5, 0.7)
    hermitian = arch(tmp_path / "hermitian.h5", "tangent", 7, 0.7)
    figure = draw([fine, hermitian, coarse], "difference")
    assert all("agrees" in t.get_text() for t in figure.legends[0].get_texts())
    bent = arch(tmp_path / "bent.h5", "theta", 7, -0.7)
    assert "geometry of 'beam' differs" in refusal(fine, bent)
    # the same ends and length, but on the other side of the chord
    turned = tmp_path / "turned.h5"
    e0 = coordinates("theta", np.linspace(0, LENGTH, 8), -0.7).reshape(-1, 3)
    cos, sin = np.cos(1.4), np.sin(1.4)
    e0 = np.column_stack([e0[:, :2] @ np.array([[cos, sin], [-sin, cos]]), e0[:, 2] + 1.4])
    with ResultWriter(turned, HEADER, [BODIES["theta"]("beam", 7, LENGTH, 0.1)], e0.ravel()) as w:
        w.append(1.0, np.zeros(24), {"step": 1})
        w.finish({"status": "converged"})
    other = open_results(turned)
    np.testing.assert_allclose(other.reference("beam", np.array([0.0, 1.0])),
                               fine.reference("beam", np.array([0.0, 1.0])), atol=1e-12)
    assert "geometry of 'beam' differs" in refusal(fine, other)
