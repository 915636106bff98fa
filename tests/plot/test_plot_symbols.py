"""Symbols of supports, loads and gravity where and when they act."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from synthetic import HEADER, coordinates, tangent_body

from ancf2d.plot import draw
from ancf2d.plot.kinds import build
from ancf2d.results import ResultWriter, open_results
from ancf2d.view import make_page

EVERYTHING = """
bodies:
  a: {geometry: {type: line, start: [0, 0], end: [2, 0]}}
boundary_conditions: [{type: pin, at: a@0}, {type: roller, fixed: x, at: a@1}, {type: clamp, at: a@1}]
joints: [{type: pin, between: [a@0.5, b@0]}, {type: weld, between: [a@0.5, b@0]},
         {type: slider, at: a@0.5, through: [0, 0], along: [0, 1]}]
springs: [{type: translational, between: [a@1, [2, 1]], stiffness: 1}, {type: rotational, between: [a@1, [0, 0]]}]
masses: [{at: a@0.25, mass: 1}]
loads: [{type: force, at: a@1, value: [3e7, 0]}, {type: moment, at: a@1, value: -2},
        {type: distributed, on: a, value: [0, -1], from: 0.5}, {type: gravity, value: [0, -9.81]},
        {type: force, at: a@1, value: [0, t]}, {type: force, at: nobody@1, value: [1, 0]}]
"""


def test_every_support_and_load_has_its_symbol(tmp_path: Path) -> None:
    body = tangent_body("a", 1, 2.0, 0.1)
    e0 = coordinates("tangent", np.array([0.0, 2.0]), 0.0)
    with ResultWriter(tmp_path / "a.h5", {**HEADER, "case_completed": EVERYTHING}, [body], e0) as w:
        w.append(0.0, 0 * e0, {}, {})
        w.finish({"status": "converged"})
    with open_results(tmp_path / "a.h5") as results:
        found = build(results, "shape").symbols
        draw(results, "shape")
    assert [s.kind for s in found] == ["pin", "roller", "clamp", "spring", "coil", "hinge", "slider", "mass", "force",
                                       "moment back", *["small force"] * 9, "gravity"]
    angles = {s.kind: s.angle % (2 * np.pi) for s in found}
    expected = {"roller": 1.5 * np.pi, "clamp": np.pi, "slider": np.pi / 2, "force": 0.0, "small force": 1.5 * np.pi,
                "gravity": 1.5 * np.pi}
    assert {k: angles[k] for k in expected} == pytest.approx(expected, abs=1e-6)
    np.testing.assert_allclose([s.points[0, 0] for s in found if s.kind == "small force"], np.linspace(1, 2, 9))
    np.testing.assert_allclose(next(s.points for s in found if s.kind == "spring"), [[2, 0], [2, 1]])


SWITCHED = """
boundary_conditions: [{type: pin, at: a@0, active: {to: 1}}, {name: hook, type: clamp, at: a@1, active: {after: t > 9}}]
springs: [{type: translational, between: [a@1, [2, 1]], active: {from: 1, until: a > 1}}]
loads: [{type: force, at: a@1, value: [1, 0], active: {after: b > 1, until: b > 2}}, {type: moment, at: a@1, value: 2}]
"""


def test_inactive_items_are_not_drawn(tmp_path: Path) -> None:
    """Times are those of the case, those of conditions of the events; the page has all of them."""
    body = tangent_body("a", 1, 2.0, 0.1)
    e0 = coordinates("tangent", np.array([0.0, 2.0]), 0.0)
    events = [{"t": 0.5, "what": "loads.0 begins"}, {"t": 1.5, "what": "loads.0 ends"},
              {"t": 2.0, "what": "springs.0 ends"}]
    with ResultWriter(tmp_path / "a.h5", {**HEADER, "case_completed": SWITCHED}, [body], e0) as w:
        for t in (0.0, 0.5, 1.0, 1.5, 2.0):
            w.append(t, 0 * e0, {}, {})
        w.finish({"status": "converged", "events": events})
    with open_results(tmp_path / "a.h5") as results:
        found = [[s.kind for s in build(results, "shape", state=k).symbols] for k in range(5)]
        listed = json.loads(re.findall(r'id="data">(.*?)</script>', make_page(results).html, re.S)[0])["symbols"]
    assert found == [["pin", "moment"], ["pin", "force", "moment"], ["spring", "force", "moment"], ["spring", "moment"],
                     ["moment"]]
    assert {s["kind"]: s["acts"] for s in listed} == {
        "pin": [None, 1], "spring": [1, 2], "force": [0.5, 1.5], "moment": [None, None]}


def test_gravity_is_drawn_outside_the_axes_and_within_the_figure(tmp_path: Path) -> None:
    body = tangent_body("a", 1, 2.0, 0.1)
    e0 = coordinates("tangent", np.array([0.0, 2.0]), 0.0)
    case = "loads: [{type: gravity, value: [0, -9.81]}, {type: gravity, value: [1, 0]}]"
    with ResultWriter(tmp_path / "a.h5", {**HEADER, "case_completed": case}, [body], e0) as w:
        w.append(0.0, 0 * e0, {}, {})
        w.finish({"status": "converged"})
    with open_results(tmp_path / "a.h5") as results:
        figure = draw(results, "shape")
    figure.canvas.draw()
    (axes,) = figure.axes
    letters = [t for t in axes.texts if t.get_text() == "g"]
    assert len(letters) == 2
    arrows = [line for line in axes.lines if line.get_clip_on() is False]
    boxes = [letter.get_window_extent() for letter in letters]
    tips = [arrow.get_transform().transform(arrow.get_xydata()) for arrow in arrows]
    tails = [tip - 20 * figure.dpi / 72 * np.array(way) for tip, way in zip(tips, ((0, -1), (1, 0)), strict=True)]
    places = np.concatenate([*(box.get_points() for box in boxes), *tips, *tails])
    assert places[:, 0].min() >= axes.bbox.x1
    assert np.all((places >= 0) & (places <= figure.bbox.max))
    assert not boxes[0].overlaps(boxes[1])
