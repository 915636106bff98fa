"""Welds and joints, and rotations of whole cases from input to result."""

import helpers
import numpy as np
import pytest

from ancf2d.errors import CaseError

EI = 5.0 * 0.2 * 0.3**3 / 12
LOADS = [
    {"type": "force", "at": "b@1", "value": [0.1 * EI, -0.3 * EI]},
    {"type": "moment", "at": "b@1", "value": 0.1 * EI},
]
SOLVERS = ("linear_static", "static")
EVERY = helpers.covering({"variant": helpers.FEW_VARIANTS}, variant=helpers.SMALL_VARIANTS, solver=SOLVERS)


def turned(v, angle: float):
    c, s = np.cos(angle), np.sin(angle)
    return [float(c * v[0] - s * v[1]), float(s * v[0] + c * v[1])]


def cantilevered(name: str, formulation: str, geometry: dict, solver: str, count: int = 4):
    bodies = {"b": helpers.body(geometry, helpers.element(name, count, formulation))}
    return helpers.solved(bodies, solver, bc=[{"name": "w", "type": "clamp", "at": "b@0"}], loads=LOADS)


@EVERY
def test_a_polyline_without_a_turn_is_a_line(name, formulation, solver):
    angle = 0.4
    end = turned((1.2, 0.0), angle)
    line = cantilevered(name, formulation, {"type": "line", "start": [0, 0], "end": end}, solver)
    points = [[0, 0], [0.5 * v for v in end], end]
    poly = cantilevered(name, formulation, {"type": "polyline", "points": points}, solver)
    for s in (0.3, 0.5, 1.0):
        np.testing.assert_allclose(poly.u(f"b@{s}"), line.u(f"b@{s}"), atol=1e-11)
    assert poly.state.energy == pytest.approx(line.state.energy, rel=1e-10)


@EVERY
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


@pytest.mark.parametrize("name", ["cable", "omar", "li", "patel", "vallejo"])
def test_two_halves_in_opposite_directions_are_one_body(name):
    """Welded end to end: derivatives of odd order change sign, those of even order do not."""
    def solve(bodies, **scene):
        return helpers.solved({k: helpers.body({"type": "line", "start": a, "end": b}, helpers.element(name, n))
                               for k, (a, b, n) in bodies.items()}, loads=LOADS, **scene)

    one = solve({"b": ([0.0, 0.0], [2.0, 0.6], 4)}, bc=[{"type": "clamp", "at": "b@0"}])
    two = solve({"a": ([1.0, 0.3], [0.0, 0.0], 2), "b": ([1.0, 0.3], [2.0, 0.6], 2)},
                bc=[{"type": "clamp", "at": "a@1"}], joints=[{"type": "weld", "between": ["b@0", "a@0"]}])
    assert not two.model.constraints
    np.testing.assert_allclose(two.u("b@1"), one.u("b@1"), atol=1e-11)
    np.testing.assert_allclose(two.u("b@0.5"), one.u("b@0.75"), atol=1e-11)


@pytest.mark.parametrize("name", ["cable", "omar"])
def test_each_member_of_a_star_has_its_own_axial_strain(name):
    """For members too thin to bend, K = EA/L sum t t^T at their joint, with one element each."""
    angles = (0.3, 2.1, 4.4)
    section = {"height": 1e-3, "width": 1.0}
    bodies = {f"b{k}": helpers.body(helpers.line(1.0, a), helpers.element(name, 1), section, {"E": 1e9, "nu": 0.0})
              for k, a in enumerate(angles)}
    sol = helpers.solved(bodies, "linear_static", bc=[{"type": "pin", "at": f"b{k}@1"} for k in range(3)],
                         joints=[{"type": "weld", "between": ["b0@0", "b1@0", "b2@0"]}],
                         loads=[{"type": "force", "at": "b0@0", "value": [100.0, 0.0]}])
    t = np.array([[np.cos(a), np.sin(a)] for a in angles])
    np.testing.assert_allclose(sol.u("b0@0"), np.linalg.solve(1e6 * t.T @ t, [100.0, 0.0]), rtol=1e-4)


def test_a_corner_keeps_the_axial_strain_of_each_piece():
    """The first of two pieces is pulled, the second is not: FL/EA with any number of elements."""
    bent = {"type": "polyline", "points": [[0, 0], [1, 0], [1, 1]]}
    sol = helpers.solved({"b": helpers.body(bent, helpers.element("cable", 2))}, "linear_static",
                         bc=[{"type": "clamp", "at": "b@0"}],
                         loads=[{"type": "force", "at": "b@0.5", "value": [0.1, 0]}])
    assert sol.u("b@0.5")[0] == pytest.approx(0.1 / (5.0 * 0.06), rel=1e-12)


UNLIKE = [("cable", "kerkkanen"), ("vallejo", "vallejo"), ("reissner3", "omar")]


@pytest.mark.slow_rows("cable-kerkkanen-buckling")
@helpers.covering(pair=UNLIKE, solver=["linear_static", "static", "eigen", "buckling"])
def test_a_weld_of_unlike_bodies_is_invariant_to_orientation_units_and_order(pair, solver):
    """The factors of a tangent with multipliers have the digits of one without."""
    first, second = pair
    # buckling has a straight column: factors of a state that bends before it buckles are left out
    straight = solver == "buckling"

    def solve(angle, size, names):
        ends = [size * np.array(turned(p, angle)) for p in ((0.0, 0.0), (1.0, 0.0), (2.0, 0.0 if straight else 0.3))]
        bodies = {k: helpers.body({"type": "line", "start": p, "end": q}, helpers.element(name, 3),
                                  {"height": h * size, "width": 0.1 * size}, {"E": 1e7, "nu": 0.3, "rho": 1e3})
                  for k, name, p, q, h in (("a", first, *ends[:2], 0.1), ("b", second, *ends[1:], 0.05))}
        F = size**2 * np.array(turned((-0.5, 0.0 if straight else -1.0), angle))
        force = [] if solver == "eigen" else [{"type": "force", "at": "b@1", "value": F}]
        more = {"modes": 1} if solver in ("eigen", "buckling") else {}
        sol = helpers.solved({k: bodies[k] for k in names}, {"type": solver, **more}, loads=force,
                             bc=[{"type": "clamp", "at": "a@0"}], joints=[{"type": "weld", "between": ["a@1", "b@0"]}])
        assert sol.model.constraints
        if solver == "eigen":
            return sol.state.report["frequencies"][0]["omega"] * size
        if solver == "buckling":
            return sol.state.report["load_factors"][0]
        return np.hypot(*sol.u("b@1")) / size

    expected = solve(0.0, 1.0, "ab")
    for k, angle in enumerate(np.random.default_rng(2).uniform(0.0, 6.3, 8)):
        found = solve(angle, (1e-3, 1e3)[k % 2], ("ab", "ba")[k // 2 % 2])
        # what is buckled is formed from differences
        assert found == pytest.approx(expected, rel=1e-8 if solver == "buckling" else 1e-11)


@pytest.mark.parametrize("name", ["vallejo", "cable"])
@pytest.mark.parametrize("angle", [0.0, 1.1])
def test_a_frame_with_two_welds_on_one_section_is_solved(name, angle):
    """Members of four heights around a triangle, and an arm: statics and modes have a solution."""
    members = {"a": ((0, 0), (1, 0), 0.02), "b": ((1, 0), (2, 0.3), 0.04), "d": ((1, 0), (1, 1), 0.05),
               "e": ((2, 0.3), (1, 1), 0.03)}
    bodies = {k: helpers.body({"type": "line", "start": turned(p, angle), "end": turned(q, angle)},
                              helpers.element(name, 2), {"height": h, "width": 0.1}, {"E": 1e9, "nu": 0.3, "rho": 1e3})
              for k, (p, q, h) in members.items()}
    welds = [["a@1", "b@0", "d@0"], ["b@1", "e@0"], ["e@1", "d@1"]]
    F = np.array(turned((0.01, -0.03), angle))
    scene = {"bc": [{"name": "w", "type": "clamp", "at": "e@1"}],
             "joints": [{"type": "weld", "between": b} for b in welds]}
    load = [{"type": "force", "at": "a@0", "value": F}]
    sol = helpers.solved(bodies, "static", loads=load, **scene)
    arm = sol.r("a@0") - sol.r("e@1")
    assert sol.reactions()["w"]["m"] == pytest.approx(-(arm[0] * F[1] - arm[1] * F[0]), rel=1e-8)
    linear = helpers.solved(bodies, "linear_static", loads=load, **scene)
    np.testing.assert_allclose(linear.u("a@0"), sol.u("a@0"), atol=1e-2 * np.hypot(*sol.u("a@0")))
    assert helpers.solved(bodies, {"type": "eigen", "modes": 2}, **scene).state.report["frequencies"][0]["omega"] > 1.0


@helpers.every_small_type
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


@EVERY
def test_the_answer_turns_with_the_scene(name, formulation, solver):
    """A frame of an arc welded to a line, with an inclined roller, moved as a whole: the same deformation, moved.

    Each element, formulation and solver by a random angle of its own, and to another place.
    """
    rng = np.random.default_rng(list(f"{name} {formulation} {solver}".encode()))
    angle, x, y = rng.uniform([-7, -5, -5], [7, 5, 5])

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

    here, there = solve(0.0, (0.0, 0.0)), solve(angle, (x, y))
    for at in ("a@0.5", "b@0", "b@1"):
        np.testing.assert_allclose(there.u(at), turned(here.u(at), angle), atol=1e-9)
        assert there.theta(at) == pytest.approx(here.theta(at), abs=1e-9)
    assert there.state.energy == pytest.approx(here.state.energy, rel=1e-9)
    assert there.reactions()["w"]["m"] == pytest.approx(here.reactions()["w"]["m"], abs=1e-8 * EI)


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
