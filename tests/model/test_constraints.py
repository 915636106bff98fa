"""Nonlinear constraints: gradient, Hessian, and the motions they allow."""

import helpers
import numpy as np
import pytest

from ancf2d.errors import CaseError
from ancf2d.model.constraints import Equations, align, prescribe_rotation
from ancf2d.model.point_tables import batches
from ancf2d.model.points import point_ref

TURN = 0.7


def two(first: str, second: str, geometry: str = "line"):
    """Return a model of two bodies welded at an angle."""
    a = helpers.body(
        helpers.line(1.0)
        if geometry == "line"
        else {"type": "arc", "center": [1.0, 2.0], "radius": 2.0, "from": -2.0, "to": -np.pi / 2},
        helpers.element(first, 2),
    )
    b = helpers.body(helpers.line(1.2, TURN, (1.0, 0.0)), helpers.element(second, 2))
    return helpers.build(
        {"a": a, "b": b},
        bc=[{"type": "clamp", "at": "a@0"}],
        joints=[{"name": "elbow", "type": "weld", "between": ["a@1", "b@0"]}],
    )


def turned_clamp(name: str, s: float):
    return helpers.build(
        {"a": helpers.body(helpers.ARC, helpers.element(name, 2))},
        bc=[{"type": "pin", "at": "a@0"}, {"type": "prescribed", "at": f"a@{s}", "angle": 0.9}],
    )


CASES = {
    "aligned r_y and r_y": lambda: two("vallejo", "omar"),
    "aligned r_y and r_x": lambda: two("vallejo", "cable"),
    "aligned on an arc": lambda: two("vallejo", "omar", "arc"),
    "r_y at theta": lambda: two("vallejo", "reissner3"),
    "theta and r_x": lambda: two("reissner2", "cable"),
    "prescribed r_y": lambda: turned_clamp("vallejo", 0.0),
    "prescribed r_y between nodes": lambda: turned_clamp("omar", 0.31),
    "prescribed r_x": lambda: turned_clamp("cable", 0.0),
}


@pytest.mark.parametrize("case", CASES)
def test_gradient_and_hessian_are_derivatives(case):
    model = CASES[case]()
    (constraint,) = model.constraints
    d, t, h = helpers.random_state(model, 0.1)[: model.n_q], 0.7, 1e-6
    _, G, H = helpers.constraint_at(constraint, d, t)
    np.testing.assert_allclose(H, H.T, atol=1e-15)
    assert G.any()
    for k, c in enumerate(constraint.dofs):
        step = np.zeros(model.n_q)
        step[c] = h
        up, down = (helpers.constraint_at(constraint, x, t) for x in (d + step, d - step))
        assert G[k] == pytest.approx((up[0] - down[0]) / (2 * h), abs=1e-8)
        np.testing.assert_allclose(H[:, k], (up[1] - down[1]) / (2 * h), atol=1e-8)


@pytest.mark.parametrize("case", CASES)
def test_constraints_evaluated_together_agree_with_single_ones(case):
    model = CASES[case]()
    rng = np.random.default_rng(8)
    alike = [c for c in model.constraints if len(c.dofs) == len(model.constraints[0].dofs)] * 2
    d, t = 0.1 * rng.normal(size=model.n_q + len(model.constraints)), 0.7
    (batch,) = batches(alike)
    _, Q, K, _ = batch.matrices(d, t)
    for c, q, k in zip(alike, Q, K, strict=True):
        g, G, H = helpers.constraint_at(c, d[:model.n_q], t)
        expected = d[c.multiplier] * np.block([[H, np.zeros((len(G), 1))], [np.zeros((1, len(G) + 1))]])
        expected[-1, :-1] = expected[:-1, -1] = G
        np.testing.assert_allclose(q, np.append(d[c.multiplier] * G, g), atol=1e-14)
        np.testing.assert_allclose(k, expected, atol=1e-14)


@pytest.mark.parametrize("case", [c for c in CASES if "prescribed" not in c])
def test_a_weld_is_met_in_the_reference_and_after_any_rigid_motion(case):
    model = CASES[case]()
    (constraint,) = model.constraints
    assert constraint.holds == "relative rotation"
    for angle in (0.0, 1.0, -2.5, 8.0):
        d = helpers.rotate(np.zeros(model.n_q), model, angle, (0.3, 0.2))
        assert helpers.constraint_at(constraint, d, 1.0)[0] == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize("case", [c for c in CASES if "prescribed" in c])
def test_a_prescribed_angle_is_met_by_the_turned_body(case):
    model = CASES[case]()
    (constraint,) = model.constraints
    assert constraint.holds == "rotation"
    for t in (0.0, 0.3, 1.0):
        d = helpers.rotate(np.zeros(model.n_q), model, 0.9 * t)
        assert helpers.constraint_at(constraint, d, t)[0] == pytest.approx(0, abs=1e-14)
    assert abs(helpers.constraint_at(constraint, np.zeros(model.n_q), 1.0)[0]) > 0.5


@helpers.covering({"first": helpers.FEW_TYPES}, first=helpers.SMALL_TYPES, at=[0.0, 0.31, 0.5, 1.0])
def test_the_reference_meets_every_weld_and_prescribed_angle_between_the_nodes_of_arcs_too(first, at):
    for second in helpers.KINDS.values():
        arc = {"type": "arc", "center": [0.0, 0.0], "radius": 1.0, "from": 0.3, "to": 2.8}
        angle = 0.3 + 2.5 * at
        b = helpers.body(helpers.line(1.2, TURN, (np.cos(angle), np.sin(angle))), helpers.element(second, 1))
        bodies = {"a": helpers.body(arc, helpers.element(first, 3)), "b": b}
        reference = helpers.build(bodies, bc=[{"type": "clamp", "at": "a@0"}, {"type": "clamp", "at": "b@1"}])
        out = Equations()
        a, b = (point_ref(reference.meshes[n], s) for n, s in (("a", at), ("b", 0.0)))
        align(a, b, "weld", out)
        prescribe_rotation(a, lambda t: t, "turn", out)
        for constraint in out.constraints:
            assert helpers.constraint_at(constraint, np.zeros(reference.n_q), 0.0)[0] == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize("angle", [0.3, -2.0, 3.1])
@helpers.every_small_type
def test_corners_and_welds_allow_rigid_motion(name, angle):
    """A corner shares position and section rotation; a straight continuation shares the whole node."""
    corner = {"type": "polyline", "points": [[0, 0], [1, 0], [1.5, 0.8]]}
    straight_on = {"type": "line", "start": [2.0, 1.6], "end": [1.5, 0.8]}
    model = helpers.build(
        {"a": helpers.body(corner, helpers.element(name, 4)), "b": helpers.body(straight_on, helpers.element(name, 1))},
        bc=[{"type": "clamp", "at": "a@0"}],
        joints=[{"name": "middle", "type": "weld", "between": ["a@1", "b@1"]}],
    )
    d = helpers.rotate(np.zeros(model.n_q), model, angle, (0.3, 0.2))
    at_corner = [r for r in model.rows if r.owner.startswith("corner")]
    shared = [r for r in model.rows if r.owner == "middle"]
    assert len(at_corner) + len(model.constraints) == 3
    assert len(shared) == len(model.meshes["a"].node_dofs(0, 0))
    for row in at_corner + shared:
        assert row.coefs @ d[row.coords] == pytest.approx(0, abs=1e-13)
    for c in model.constraints:
        assert helpers.constraint_at(c, d, 0.0)[0] == pytest.approx(0, abs=1e-13)


def multipliers(first, second, *more):
    """Return the number of multipliers of the welds of two bodies at (1, 0), and of others."""
    bodies = {"a": first, "b": second, **{f"c{k}": b for k, b in enumerate(more)}}
    joints = [{"type": "weld", "between": ["a@1", "b@0"]}]
    joints += [{"type": "weld", "between": ["b@0", f"c{k}@0"]} for k in range(len(more))]
    return len(helpers.build(bodies, bc=[{"type": "clamp", "at": "a@0"}], joints=joints).constraints)


def test_coordinates_are_shared_where_one_beam_continues_another():
    """Of the same kind and direction, with nothing else welded there; strains are continuous where curvature jumps."""
    def straight(angle=0.0, **section):
        return helpers.body(helpers.line(1.0, angle, (1.0, 0.0)), helpers.element("cable", 2),
                            {**helpers.SECTION, **section})

    def arc(radius):
        geometry = {"type": "arc", "center": [1.0, radius], "radius": radius, "from": -np.pi / 2, "to": 0.0}
        return helpers.body(geometry, helpers.element("cable", 2))

    first = helpers.body(helpers.line(1.0), helpers.element("cable", 2))
    before = helpers.body({"type": "arc", "center": [1.0, 2.0], "radius": 2.0, "from": -2.0, "to": -np.pi / 2},
                          helpers.element("cable", 2))
    assert multipliers(first, straight()) == 0
    assert multipliers(before, arc(2.0)) == 0
    assert multipliers(first, straight(0.5)) == 1
    assert multipliers(first, straight(height=0.31)) == 1
    assert multipliers(before, arc(1.0)) == 0
    assert multipliers(first, straight(), straight(1.0)) == 2
    assert multipliers(first, helpers.body(helpers.line(1.0, np.pi, (1.0, 0.0)), helpers.element("cable", 2))) == 1


def test_sections_with_theta_need_no_multiplier():
    assert not two("reissner2", "reissner3").constraints


@pytest.mark.parametrize("name", helpers.KINDS.values())
def test_a_rotation_constrained_twice_has_at_most_one_multiplier(name):
    """A ring of welds at one point, and a weld between clamped sections: the second is no equation of its own."""
    ring = {k: helpers.body(helpers.line(1.0, a), helpers.element(name, 2)) for a, k in enumerate("abc")}
    welds = [{"type": "weld", "between": [f"{p}@0", f"{q}@0"]} for p, q in ("ab", "bc", "ca")]
    model = helpers.build(ring, bc=[{"type": "clamp", "at": "a@1"}], joints=welds)
    assert len(model.constraints) == (0 if name == "reissner3" else 2)
    clamps = [{"type": "clamp", "at": f"{k}@0", "hold": "section"} for k in "ab"]
    model = helpers.build(ring, bc=clamps, joints=welds[:2])
    assert len(model.constraints) == (0 if name == "reissner3" else 1)
    assert any("redundant" in w and "relative rotation" in w for w in model.warnings)


def test_a_fixed_rotation_cannot_be_prescribed_to_move():
    body = {"a": helpers.body(helpers.line(1.0), helpers.element("vallejo", 2))}
    with pytest.raises(CaseError, match="turn: another support already holds the rotation"):
        helpers.build(body, bc=[{"type": "clamp", "at": "a@0"},
                                {"name": "turn", "type": "prescribed", "at": "a@0", "angle": 0.1}])


def test_joints_close_gaps_that_are_small_relative_to_their_bodies():
    """A distant body makes the scene large, but not the gap that may be closed."""
    near = [helpers.body(helpers.line(1.0, 0.0, (x, 0.0)), helpers.element("cable", 1)) for x in (0.0, 1.5)]
    far = helpers.body(helpers.line(1.0, 0.0, (1e6, 0.0)), helpers.element("cable", 1))
    scene = {"bodies": dict(zip("abc", [*near, far], strict=True)),
             "bc": [{"type": "clamp", "at": "a@0"}, {"type": "clamp", "at": "c@0"}]}
    along = {"through": [3.0, 0.5], "along": [1.0, 0.0]}
    for joint in ({"type": "weld", "between": ["a@1", "b@0"]}, {"type": "pin", "between": ["a@1", "b@0"]},
                  {"type": "slider", "at": "b@0", **along}, {"type": "prismatic", "point": "b@0", "on": "a"}):
        with pytest.raises(CaseError, match=r"0\.5 away from"):
            helpers.build(**scene, joints=[joint])


@pytest.mark.parametrize("kind", ["pin", "weld"])
def test_a_body_cannot_be_joined_with_itself_at_one_point(kind):
    body = {"b": helpers.body(helpers.line(1.0), helpers.element("vallejo", 3))}
    with pytest.raises(CaseError, match="another point of the same body"):
        helpers.build(body, bc=[{"type": "clamp", "at": "b@0"}],
                      joints=[{"type": kind, "between": ["b@0.3", "b@0.3000000001"]}])
