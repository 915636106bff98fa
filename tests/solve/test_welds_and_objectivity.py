"""Welds and joints, and the whole chain from case to answer in a turned world."""

import helpers
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.errors import CaseError

EI = 5.0 * 0.2 * 0.3**3 / 12
LOADS = [
    {"type": "force", "at": "b@1", "value": [0.1 * EI, -0.3 * EI]},
    {"type": "moment", "at": "b@1", "value": 0.1 * EI},
]
SOLVERS = ("linear_static", "static")


def turned(v, angle: float):
    c, s = np.cos(angle), np.sin(angle)
    return [float(c * v[0] - s * v[1]), float(s * v[0] + c * v[1])]


def cantilevered(name: str, formulation: str, geometry: dict, solver: str, count: int = 4):
    bodies = {"b": helpers.body(geometry, helpers.element(name, count, formulation))}
    return helpers.solved(bodies, solver, bc=[{"name": "w", "type": "clamp", "at": "b@0"}], loads=LOADS)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("name", "formulation"), helpers.SMALL_VARIANTS, ids=helpers.ids(helpers.SMALL_VARIANTS))
def test_a_polyline_without_a_turn_is_a_line(name, formulation, solver):
    angle = 0.4
    end = turned((1.2, 0.0), angle)
    line = cantilevered(name, formulation, {"type": "line", "start": [0, 0], "end": end}, solver)
    points = [[0, 0], [0.5 * v for v in end], end]
    poly = cantilevered(name, formulation, {"type": "polyline", "points": points}, solver)
    for s in (0.3, 0.5, 1.0):
        np.testing.assert_allclose(poly.u(f"b@{s}"), line.u(f"b@{s}"), atol=1e-11)
    assert poly.state.energy == pytest.approx(line.state.energy, rel=1e-10)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("name", "formulation"), helpers.SMALL_VARIANTS, ids=helpers.ids(helpers.SMALL_VARIANTS))
def test_two_welded_halves_are_one_body(name, formulation, solver):
    arc = {"type": "arc", "center": [0, 0], "radius": 1.0, "from": 0.2, "to": 1.4}
    one = cantilevered(name, formulation, arc, solver)
    spec = helpers.element(name, 2, formulation)
    halves = {"a": helpers.body({**arc, "to": 0.8}, spec), "b": helpers.body({**arc, "from": 0.8}, spec)}
    two = helpers.solved(
        halves,
        solver,
        bc=[{"name": "w", "type": "clamp", "at": "a@0"}],
        loads=LOADS,
        joints=[{"type": "weld", "between": ["a@1", "b@0"]}],
    )
    assert not two.model.constraints
    for s in (0.5, 1.0):
        np.testing.assert_allclose(two.u(f"b@{2 * s - 1}"), one.u(f"b@{s}"), atol=1e-11)
    assert two.state.energy == pytest.approx(one.state.energy, rel=1e-10)
    for k in ("fx", "fy", "m"):
        assert two.reactions()["w"][k] == pytest.approx(one.reactions()["w"][k], rel=1e-8)


@pytest.mark.parametrize("name", helpers.SMALL_TYPES)
def test_a_weld_at_a_corner_is_the_corner_of_a_polyline(name):
    corner = {"type": "polyline", "points": [[0, 0], [1, 0], [1.5, 0.8]]}
    out = helpers.solved(
        {"b": helpers.body(corner, helpers.element(name, 4))}, bc=[{"type": "clamp", "at": "b@0"}], loads=LOADS
    )
    mesh = out.model.meshes["b"]
    counts = [p.count for p in mesh.plan.pieces]
    bodies = {
        "a": helpers.body({"type": "line", "start": [0, 0], "end": [1, 0]}, helpers.element(name, counts[0])),
        "b": helpers.body({"type": "line", "start": [1, 0], "end": [1.5, 0.8]}, helpers.element(name, counts[1])),
    }
    two = helpers.solved(
        bodies, bc=[{"type": "clamp", "at": "a@0"}], loads=LOADS, joints=[{"type": "weld", "between": ["a@1", "b@0"]}]
    )
    np.testing.assert_allclose(two.u("b@1"), out.u("b@1"), atol=1e-11)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("name", "formulation"), helpers.SMALL_VARIANTS, ids=helpers.ids(helpers.SMALL_VARIANTS))
@settings(max_examples=3, deadline=None)
@given(angle=st.floats(-7, 7), x=st.floats(-5, 5), y=st.floats(-5, 5))
def test_the_answer_turns_with_the_scene(name, formulation, solver, angle, x, y):
    """A frame of an arc welded to a line, with an inclined roller, moved as a whole: the same deformation, moved."""

    def solve(a: float, shift):
        def at(p):
            return [v + w for v, w in zip(turned(p, a), shift, strict=True)]

        arc = {"type": "arc", "center": at((0, 0)), "radius": 1.0, "from": 0.3 + a, "to": 1.3 + a}
        end = (np.cos(1.3), np.sin(1.3))
        line = {"type": "line", "start": at(end), "end": at((end[0] + 0.3, end[1] + 0.9))}
        spec = helpers.element(name, 2, formulation)
        return helpers.solved(
            {"a": helpers.body(arc, spec), "b": helpers.body(line, spec)},
            {"type": solver},
            bc=[
                {"name": "w", "type": "clamp", "at": "a@0"},
                {"type": "roller", "at": "a@0.6", "normal": turned((1, 2), a)},
            ],
            joints=[{"type": "weld", "between": ["a@1", "b@0"]}],
            loads=[
                {"type": "force", "at": "b@1", "value": turned((0.2 * EI, -0.3 * EI), a)},
                {"type": "distributed", "on": "b", "value": turned((0.1 * EI, 0.0), a)},
                {"type": "moment", "at": "b@0.5", "value": 0.1 * EI},
            ],
        )

    here = BASE.setdefault((name, formulation, solver), solve(0.0, (0.0, 0.0)))
    there = solve(angle, (x, y))
    for at in ("a@0.5", "b@0", "b@1"):
        np.testing.assert_allclose(there.u(at), turned(here.u(at), angle), atol=1e-9)
        assert there.theta(at) == pytest.approx(here.theta(at), abs=1e-9)
    assert there.state.energy == pytest.approx(here.state.energy, rel=1e-9)
    assert there.reactions()["w"]["m"] == pytest.approx(here.reactions()["w"]["m"], abs=1e-8 * EI)


BASE: dict = {}

PAIRS = [
    ("vallejo", "reissner3"),
    ("cable", "2d3n"),
    ("cable", "reissner2"),
    ("omar", "vallejo"),
    ("ancf[2,2]", "ancf[3,3]"),
    ("li", "cable"),
    ("reissner2", "reissner3"),
    ("reissner3", "kerkkanen"),
]


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_mixed_welds_keep_the_angle_and_carry_the_moment(first, second):
    bodies = {
        "a": helpers.body(helpers.line(1.0, 0.2), helpers.element(first, 3)),
        "b": helpers.body(helpers.line(0.8, 1.4, (np.cos(0.2), np.sin(0.2))), helpers.element(second, 3)),
    }
    out = helpers.solved(
        bodies,
        bc=[{"name": "w", "type": "clamp", "at": "a@0"}],
        loads=LOADS,
        joints=[{"name": "elbow", "type": "weld", "between": ["a@1", "b@0"]}],
    )
    np.testing.assert_allclose(out.u("a@1"), out.u("b@0"), atol=1e-12)
    assert out.theta("a@1") == pytest.approx(out.theta("b@0"), abs=1e-9)
    assert abs(out.theta("a@1")) > 0.05
    F, r = [0.1 * EI, -0.3 * EI], out.r("b@1")
    assert out.reactions()["w"]["m"] == pytest.approx(-(r[0] * F[1] - r[1] * F[0]) - 0.1 * EI, rel=1e-7)


def test_mixed_welds_between_nodes_and_on_arcs_keep_the_angle():
    arc = {"type": "arc", "center": [0, 0], "radius": 1.0, "from": 0.0, "to": 2.0}
    at = 0.37
    place = (float(np.cos(2 * at)), float(np.sin(2 * at)))
    bodies = {
        "a": helpers.body(arc, helpers.element("vallejo", 8)),
        "b": helpers.body(helpers.line(0.5, 0.3, place), helpers.element("cable", 2)),
    }
    out = helpers.solved(
        bodies,
        bc=[{"type": "clamp", "at": "a@0"}],
        loads=LOADS,
        joints=[{"type": "weld", "between": [f"a@{at}", "b@0"]}],
    )
    np.testing.assert_allclose(out.u(f"a@{at}"), out.u("b@0"), atol=1e-12)
    assert out.theta(f"a@{at}") == pytest.approx(out.theta("b@0"), abs=1e-9)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", helpers.KINDS.values())
def test_pin_joints_share_the_position_and_leave_the_rotation(name, solver):
    bodies = {
        "a": helpers.body(helpers.line(1.0), helpers.element(name, 3)),
        "b": helpers.body(helpers.line(1.0, 0.0, (1.0, 0.0)), helpers.element(name, 3)),
    }
    out = helpers.solved(
        bodies,
        solver,
        bc=[{"name": "l", "type": "clamp", "at": "a@0"}, {"name": "r", "type": "roller", "at": "b@1", "fixed": "y"}],
        joints=[{"type": "pin", "between": ["a@1", "b@0"]}],
        loads=[{"type": "force", "at": "a@1", "value": [0, -0.3 * EI]}],
    )
    np.testing.assert_allclose(out.u("a@1"), out.u("b@0"), atol=1e-13)
    assert out.theta("a@1") < -0.05
    assert out.theta("b@0") > 0.05
    if solver == "linear_static":
        assert out.reactions()["r"]["fy"] == pytest.approx(0, abs=1e-12)
        assert out.reactions()["l"]["m"] == pytest.approx(0.3 * EI, rel=1e-9)


def test_a_joint_of_points_apart_is_refused():
    bodies = {
        "a": helpers.body(helpers.line(1.0), helpers.element("cable", 2)),
        "b": helpers.body(helpers.line(1.0, 0.0, (1.1, 0.0)), helpers.element("cable", 2)),
    }
    with pytest.raises(CaseError, match="away from"):
        helpers.build(bodies, bc=[{"type": "clamp", "at": "a@0"}], joints=[{"type": "pin", "between": ["a@1", "b@0"]}])


@pytest.mark.parametrize("name", helpers.KINDS.values())
def test_a_spring_shares_the_load_with_the_beam(name):
    bodies = {"b": helpers.body(helpers.line(1.0), helpers.element(name, 3))}
    clamp, load = [{"name": "w", "type": "clamp", "at": "b@0"}], [{"type": "force", "at": "b@1", "value": [0, -0.01]}]
    k = 0.3 * EI
    spring = {"type": "translational", "between": ["b@1", [1.0, -1.0]], "stiffness": k}
    free = helpers.solved(bodies, "linear_static", bc=clamp, loads=load)
    held = helpers.solved(bodies, "linear_static", bc=clamp, loads=load, springs=[spring])
    flexibility = free.u("b@1")[1] / -0.01
    assert held.u("b@1")[1] == pytest.approx(-0.01 / (1 / flexibility + k), rel=1e-9)
    assert held.reactions()["w"]["fy"] == pytest.approx(0.01 + k * held.u("b@1")[1], rel=1e-9)
