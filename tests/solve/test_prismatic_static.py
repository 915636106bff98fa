"""Equilibrium with a prismatic joint: an elastica whose load stays on a vertical line, and points off the axis."""

import helpers
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ancf2d.errors import CaseError, ComputationError
from ancf2d.model.points import dot, point_ref
from ancf2d.solvers.registry import solve

EI, X, V = 80.0, 1.3, 32.0
STIFF = {"EA": 1e7, "kGA": 1e7, "EI": EI}


def collar(rail="cable", count=8, load=V, x=X, length=2.0, **solver):
    """Return the model of a cantilever ``rail`` under a collar pressed down by a vertical bar, guided along x = X."""
    section = STIFF if rail.startswith("reissner") else {k: v for k, v in STIFF.items() if k != "kGA"}
    bodies = {
        "rail": helpers.body(helpers.line(length), helpers.element(rail, count), section),
        "bar": helpers.body(helpers.line(0.7, np.pi / 2, (x, 0.0)), helpers.element("reissner2", 1), STIFF),
    }
    guides = [{"type": "roller", "at": f"bar@{s}", "fixed": "x"} for s in (0, 1)]
    return helpers.build(
        bodies,
        {"type": "static", "steps": 6, **solver},
        bc=[{"name": "wall", "type": "clamp", "at": "rail@0"}, *guides],
        joints=[{"name": "collar", "type": "prismatic", "point": "bar@0", "on": "rail"}],
        loads=[{"type": "force", "at": "bar@1", "value": [0, -load]}],
    )


def place(model, d, at):
    """Return the position (2,) of BODY@S."""
    name, s = at.split("@")
    e = model.e0 + d[: model.n_q]
    return np.array([dot(c, e) for c in point_ref(model.meshes[name], float(s)).position()])


def elastica():
    """Return y of the loaded point, the angle there and its arc length: the load is normal to the beam."""

    def end_of(unknown, load):
        k, S, end = unknown
        fx, fy = load * np.tan(end), -load

        def rates(s, w):
            _, _, theta, k = w
            return [np.cos(theta), np.sin(theta), k, -(np.cos(theta) * fy - np.sin(theta) * fx) / EI]

        return solve_ivp(rates, (0, S), [0, 0, 0, k], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]

    def missing(unknown, load):
        x, _, theta, k = end_of(unknown, load)
        return [x - X, theta - unknown[2], k]

    found = np.array([0.0, X, 0.0])
    for load in np.linspace(0, V, 9)[1:]:
        for _ in range(8):
            J = np.array([missing(found + 1e-6 * e, load) for e in np.eye(3)]) - missing(found, load)
            found = found - np.linalg.solve(J.T / 1e-6, missing(found, load))
    assert np.abs(missing(found, V)).max() < 1e-10
    return end_of(found, V)[1], found[2], found[1]


@pytest.mark.parametrize("rail", ["cable", pytest.param("reissner3", marks=pytest.mark.slow)])
def test_a_load_that_slides_along_a_beam_stays_normal_to_it(rail):
    y, angle, S = elastica()
    assert y < -0.3
    assert S > X + 0.04
    model = collar(rail)
    (joint,) = model.constraints
    states = list(solve(model))
    np.testing.assert_allclose(place(model, states[-1].d, "bar@0"), [X, y], atol=1e-3 if rail == "cable" else 2e-4)
    assert states[-1].d[joint.multiplier] == pytest.approx(-V / np.cos(angle), rel=1e-3)
    # it has gone on to another element, and Newton's method has not minded
    assert joint.start[0, 0] == 5
    assert joint.table.memory[0, 0] == int(8 * S / 2.0)
    assert max(s.history["iterations"] for s in states) <= 6


def test_wide_models_have_the_same_joint():
    """Beyond 200 unknowns the matrix is sparse."""
    y, _, _ = elastica()
    model = collar("cable", 60)
    state = list(solve(model))[-1]
    assert model.numbering.n_unknowns > 200
    assert place(model, state.d, "bar@0")[1] == pytest.approx(y, abs=2e-5)


def test_a_point_that_leaves_over_the_end_is_named():
    with pytest.raises(ComputationError, match=r"collar: bar@0 has slid off the end of rail"):
        list(solve(collar(length=1.32)))


@pytest.mark.parametrize(("y", "refused"), [(1e-7, False), (1e-3, True)])
def test_a_point_off_the_axis_in_the_reference_is_refused(y, refused):
    bodies = {
        "rail": helpers.body(helpers.line(2.0), helpers.element("cable", 2)),
        "bar": helpers.body(helpers.line(0.5, np.pi / 2, (0.7, y)), helpers.element("cable", 1)),
    }
    scene = {
        "bc": [{"type": "clamp", "at": "rail@0"}, {"type": "clamp", "at": "bar@1"}],
        "joints": [{"type": "prismatic", "point": "bar@0", "on": "rail"}],
    }
    if not refused:
        model = helpers.build(bodies, **scene)
        ((gap, _, _),) = model.interactions.gradients(np.zeros(len(model.numbering.place)), 0.0)
        assert gap == 0.0
        return
    with pytest.raises(CaseError) as caught:
        helpers.build(bodies, **scene)
    (problem,) = caught.value.problems
    assert problem.message == "joints.0: bar@0 is at (0.7, 0.001), 0.001 away from the axis of rail"


def test_a_joint_fixes_one_direction_of_three():
    bodies = {
        "rail": helpers.body(helpers.line(2.0), helpers.element("cable", 2)),
        "bar": helpers.body(helpers.line(0.5, np.pi / 2, (0.7, 0.0)), helpers.element("cable", 1)),
    }
    with pytest.raises(CaseError) as caught:
        helpers.build(
            bodies,
            bc=[{"type": "clamp", "at": "rail@0"}],
            joints=[{"type": "prismatic", "point": "bar@0", "on": "rail"}],
        )
    messages = sorted(p.message for p in caught.value.problems)
    assert len(messages) == 2
    assert any("'bar' is free to move along (1, 0)" in m for m in messages)
    assert any("'bar' is free to turn about (0.7, " in m for m in messages)
