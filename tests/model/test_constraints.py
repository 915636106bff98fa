"""Nonlinear constraints: gradient, Hessian, and which motions they allow."""

import helpers
import numpy as np
import pytest

from ancf2d.model.constraints import Equations, align, prescribe_rotation
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
    _, G, H = constraint.evaluate(model.e0 + d, d, t)
    np.testing.assert_allclose(H, H.T, atol=1e-15)
    assert G.any()
    for k, c in enumerate(constraint.dofs):
        step = np.zeros(model.n_q)
        step[c] = h
        up, down = (constraint.evaluate(model.e0 + x, x, t) for x in (d + step, d - step))
        assert G[k] == pytest.approx((up[0] - down[0]) / (2 * h), abs=1e-8)
        np.testing.assert_allclose(H[:, k], (up[1] - down[1]) / (2 * h), atol=1e-8)


@pytest.mark.parametrize("case", [c for c in CASES if "prescribed" not in c])
def test_a_weld_is_met_in_the_reference_and_after_any_rigid_motion(case):
    model = CASES[case]()
    (constraint,) = model.constraints
    assert constraint.holds == "relative rotation"
    for angle in (0.0, 1.0, -2.5, 8.0):
        d = helpers.rotate(np.zeros(model.n_q), model, angle, (0.3, 0.2))
        assert constraint.evaluate(model.e0 + d, d, 1.0)[0] == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize("case", [c for c in CASES if "prescribed" in c])
def test_a_prescribed_angle_is_met_by_the_turned_body(case):
    model = CASES[case]()
    (constraint,) = model.constraints
    assert constraint.holds == "rotation"
    for t in (0.0, 0.3, 1.0):
        d = helpers.rotate(np.zeros(model.n_q), model, 0.9 * t)
        assert constraint.evaluate(model.e0 + d, d, t)[0] == pytest.approx(0, abs=1e-14)
    assert abs(constraint.evaluate(model.e0, np.zeros(model.n_q), 1.0)[0]) > 0.5


@pytest.mark.parametrize("at", [0.0, 0.31, 0.5, 1.0])
@pytest.mark.parametrize("first", helpers.SMALL_TYPES)
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
            assert constraint.evaluate(reference.e0, np.zeros(reference.n_q), 0.0)[0] == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize("angle", [0.3, -2.0, 3.1])
@pytest.mark.parametrize("name", helpers.SMALL_TYPES)
def test_shared_nodes_at_corners_go_along_with_rigid_motion(name, angle):
    """Gradients are shared turned by the angle of the corner: as they stand they would tie it to the world."""
    corner = {"type": "polyline", "points": [[0, 0], [1, 0], [1.5, 0.8]]}
    b = helpers.body(helpers.line(0.6, -0.4, (1.5, 0.8)), helpers.element(name, 1))
    model = helpers.build(
        {"a": helpers.body(corner, helpers.element(name, 4)), "b": b},
        bc=[{"type": "clamp", "at": "a@0"}],
        joints=[{"name": "elbow", "type": "weld", "between": ["a@1", "b@0"]}],
    )
    d = helpers.rotate(np.zeros(model.n_q), model, angle, (0.3, 0.2))
    shared = [r for r in model.rows if r.owner == "elbow" or r.owner.startswith("corner")]
    assert len(shared) == 2 * len(model.meshes["a"].node_dofs(0, 0))
    for row in shared:
        assert row.coefs @ d[row.coords] == pytest.approx(0, abs=1e-13)


def test_equal_kinds_need_no_multiplier():
    assert not two("reissner2", "reissner3").constraints
    assert not two("vallejo", "vallejo").constraints
    assert not two("cable", "cable").constraints
