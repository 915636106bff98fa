"""Error of contact due to an obstacle between contact points: closed forms, and warnings of runs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import ancf2d
from ancf2d.interactions.contact_curves import layer_rule
from ancf2d.solvers.between_contact_points import ErrorsBetweenPoints
from ancf2d.solvers.state import State

LAW = {"stiffness": 1e7}
DISC = {"type": "circle", "center": [0.6, -1.0101], "radius": 1.0}
SMALL = {"type": "circle", "center": [0.6, -0.0301], "radius": 0.02}
CORNER = {"type": "polyline", "points": [[0.3, -0.3], [0.6, -0.0101], [0.9, -0.3]]}


def rod(element: dict[str, Any], y: float = 0.0) -> dict[str, Any]:
    """Return a rod of length 1 and height 0.02, its axis at y."""
    return {"geometry": {"type": "line", "start": [0, y], "end": [1, y]}, "element": element,
            "section": {"height": 0.02, "width": 0.03}, "material": {"E": 7e9, "nu": 0.3, "rho": 2700}}


def pressed(obstacle: dict[str, Any], count: int, solver: dict[str, Any]) -> ancf2d.Solution:
    """Return a cantilever whose tip is moved down onto an obstacle at 0.6 of its length."""
    return ancf2d.solve({
        "bodies": {"rod": rod({"type": "reissner3", "count": count})}, "obstacles": {"it": obstacle},
        "boundary_conditions": [{"type": "clamp", "at": "rod@0"}, {"type": "prescribed", "at": "rod@1", "uy": -0.05}],
        "contacts": [{"between": ["rod", "it"], "law": LAW}], "solver": solver}, states=False)


@pytest.mark.parametrize(("x", "depth"), [(0.5, 0.004), (0.34, 0.004), (0.93, 0.001), (1.0, 0.001), (1.02, 0.001)])
def test_the_error_of_a_straight_rod_in_a_disc_is_that_of_its_points(x: float, depth: float) -> None:
    """The depth at s from the middle is R - sqrt((R - D)^2 + s^2), whose integral has a closed form.

    A disc beyond the end of the rod is deepest there.
    """
    R = 0.5
    solved = ancf2d.solve({
        "bodies": {"rod": rod({"type": "rigid"}, R + 0.01 - depth)},
        "obstacles": {"disc": {"type": "circle", "center": [x, 0.0], "radius": R}},
        "contacts": [{"between": ["rod", "disc"], "law": LAW}],
        "solver": {"type": "dynamic", "t_end": 1e-9, "dt": 1e-9, "estimate": False}}, states=False)
    between = ErrorsBetweenPoints(solved.model)
    zero = np.zeros(len(solved.model.numbering.place))
    between.check(State(0.0, zero, zero, zero, 0.0))
    h = R - depth
    a = math.sqrt(R * R - h * h)

    def integral(s: float) -> float:
        s = min(max(s, -a), a)
        return R * s - 0.5 * (s * math.hypot(h, s) + h * h * math.asinh(s / h))

    s, w = layer_rule(solved.model.meshes["rod"], 0)
    summed = w @ np.maximum(R - np.hypot(h, s - x), 0.0)
    depth = R - math.hypot(h, max(x - 1.0, 0.0))
    yields = depth * (summed / (integral(1.0 - x) - integral(-x))) ** (2.0 / 3.0)
    assert between.worst[1:3] == pytest.approx([depth, yields], rel=5e-3)


@pytest.mark.parametrize("solver", [{"type": "static"}, {"type": "static", "method": "arc_length"},
                                    {"type": "quasi_static", "t_end": 1.0}],
                         ids=["static", "path", "quasi_static"])
@pytest.mark.parametrize(("obstacle", "count", "told"), [(DISC, 16, False), (SMALL, 8, True), (CORNER, 8, True),
                                                         (CORNER, 64, False)],
                         ids=["disc", "small", "corner", "fine"])
def test_equilibria_report_an_obstacle_between_the_points_of_a_layer(
        obstacle: dict[str, Any], count: int, told: bool, solver: dict[str, Any]) -> None:
    if count == 64 and "method" in solver:
        pytest.skip("the same states, more slowly")
    warnings = pressed(obstacle, count, solver).warnings
    assert sum("deep in it between its contact points" in w for w in warnings) == told, warnings


@pytest.mark.parametrize(("x", "passes"), [(0.5, True), (1.0, False)])
def test_an_obstacle_that_all_points_of_an_axis_miss_is_reported(x: float, passes: bool) -> None:
    """A pinned rod falls through a disc between its points at S = 0.38 and 0.62, but not through one at its end."""
    solved = ancf2d.solve({
        "bodies": {"rod": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                           "element": {"type": "rigid", "mass": 1.0, "inertia": 0.1}}},
        "boundary_conditions": [{"type": "pin", "at": "rod@0"}], "loads": [{"type": "gravity", "value": [0, -9.81]}],
        "obstacles": {"disc": {"type": "circle", "center": [x, -0.3], "radius": 0.05}},
        "contacts": [{"between": ["rod", "disc"], "side": "axis", "law": LAW}],
        "solver": {"type": "dynamic", "t_end": 0.4, "tolerance": 1e-5}}, states=False)
    told = [w for w in solved.warnings if "deep in disc between its contact points, none of which touches it" in w]
    assert bool(told) == passes


def test_without_a_warning_forces_are_those_of_a_fine_mesh() -> None:
    coarse, fine = (pressed(DISC, count, {"type": "static"}).summary["contacts"][0]["force"][1] for count in (16, 64))
    assert coarse == pytest.approx(fine, rel=1e-3)


def upright(element: dict[str, Any], x: float, y: float, length: float) -> dict[str, Any]:
    """Return a vertical rod with its end at (x, y)."""
    return {**rod(element), "geometry": {"type": "line", "start": [x, y + length], "end": [x, y]}}


@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize("x", [0.5, 0.725], ids=["between", "at a point"])
def test_the_error_of_the_end_of_a_rod_in_another_is_that_of_the_points_of_both(x: float, flipped: bool) -> None:
    """The end bears k h D/2 at its own points; the points of the other rod bear their weight times k D/2."""
    h, depth = 0.02, 2e-4
    names = ["post", "rod"][::-1 if flipped else 1]
    solved = ancf2d.solve({
        "bodies": {"rod": rod({"type": "rigid"}), "post": upright({"type": "rigid"}, x, 0.01 - depth, 0.3)},
        "contacts": [{"between": names, "law": LAW}],
        "solver": {"type": "dynamic", "t_end": 1e-9, "dt": 1e-9, "estimate": False}}, states=False)
    between = ErrorsBetweenPoints(solved.model)
    zero = np.zeros(len(solved.model.numbering.place))
    between.check(State(0.0, zero, zero, zero, 0.0))
    s, w = layer_rule(solved.model.meshes["rod"], 0)
    weight = w @ (np.abs(s - x) < 0.5 * h)
    assert between.worst[1:3] == pytest.approx([depth, depth * (0.5 + 0.5 * weight / h) ** (2.0 / 3.0)], rel=1e-2)


def short_post(count: int, flipped: bool = False) -> ancf2d.Solution:
    """Return a short cantilever with the end of an upright post pressed on it."""
    element = {"type": "reissner3", "count": count}
    beam = {**rod(element), "geometry": {"type": "line", "start": [0, 0], "end": [0.2, 0]}}
    bodies = {"rod": beam, "post": upright(element, 0.11, 0.01, 0.2)}
    names = list(bodies)[::-1 if flipped else 1]
    return ancf2d.solve({
        "bodies": {name: bodies[name] for name in names},
        "boundary_conditions": [{"type": "clamp", "at": "rod@0"},
                                {"type": "prescribed", "at": "post@0", "ux": 0.0, "uy": -0.01, "angle": 0.0}],
        "contacts": [{"between": names, "law": {"stiffness": 1e8}}], "solver": {"type": "static"}}, states=False)


def test_equilibria_of_two_bodies_report_an_overlap_between_their_points() -> None:
    """The reported error is the error of the force, in either order of the bodies."""
    solved = short_post(1), short_post(1, True), short_post(6), short_post(8)
    force = [abs(each.summary["contacts"][0]["force"][1]) for each in solved]
    off = [each.summary["contact_error"] for each in solved]
    told = [sum("do not see all of the layer" in w for w in each.warnings) for each in solved]
    assert force[0] == pytest.approx(force[1], rel=1e-9)
    assert off[0] == pytest.approx(off[1], rel=1e-6)
    assert force[2] == pytest.approx(force[3], rel=1e-3)
    assert off[0] == pytest.approx(1.0 - force[0] / force[3], rel=0.3)
    assert off[2:] == [0.0, 0.0]
    assert told == [1, 1, 0, 0]
