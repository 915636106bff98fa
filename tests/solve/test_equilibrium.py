"""Large displacements: reactions balance the loads, in force and in moment about the moved points."""

from dataclasses import replace

import helpers
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.errors import ComputationError

EI = 5.0 * 0.2 * 0.3**3 / 12
small = st.floats(-1, 1)


@pytest.mark.parametrize(("name", "formulation"), helpers.chosen(helpers.DEFAULTS, helpers.FEW_VARIANTS))
@settings(max_examples=4, deadline=None)
@given(fx=small, fy=small, m=small, q=small, follower=small)
def test_total_load_equals_reactions_at_large_displacement(name, formulation, fx, fy, m, q, follower):
    geometry = helpers.ARC
    loads = [
        {"type": "force", "at": "beam@1", "value": [0.8 * EI * fx, 0.8 * EI * fy]},
        {"type": "moment", "at": "beam@1", "value": 0.5 * EI * m},
        {"type": "distributed", "on": "beam", "value": [0.0, EI * q]},
        {"type": "follower_force", "at": "beam@1", "value": [0.0, 0.3 * EI * follower]},
    ]
    bodies = {"beam": helpers.body(geometry, helpers.element(name, 4, formulation))}
    out = helpers.solved(
        bodies, {"type": "static", "steps": 2}, loads=loads, bc=[{"name": "wall", "type": "clamp", "at": "beam@0"}]
    )
    wall, model = out.reactions()["wall"], out.model
    d = out.d[: model.n_q]
    # what the follower force has become, from the forces themselves: its direction is tested where it is made
    Q = np.zeros(model.n_q)
    for patch in model.loads.patches:
        if not patch.symmetric:
            _, forces, _, dofs = helpers.patch_at(model, patch, d, 1.0)
            np.subtract.at(Q, dofs, forces)
    kinds = model.meshes["beam"].kinds
    applied = np.array([Q[kinds == 0].sum(), Q[kinds == 1].sum()])
    assert np.hypot(*applied) == pytest.approx(0.3 * EI * abs(follower), abs=1e-12)
    # a distributed load is per reference length of the arc
    applied += [0.8 * EI * fx, 0.8 * EI * fy + EI * q * 1.2 * 1.2]
    np.testing.assert_allclose([wall["fx"], wall["fy"]], -applied, atol=1e-7 * EI)


@pytest.mark.parametrize("name", helpers.KINDS.values())
@settings(max_examples=6, deadline=None)
@given(fx=small, fy=small, m=small, s=st.floats(0.3, 1.0))
def test_moment_about_the_support_is_that_of_the_moved_loads(name, fx, fy, m, s):
    F, M = np.array([EI * fx, EI * fy]), 0.5 * EI * m
    loads = [{"type": "force", "at": f"beam@{s}", "value": F.tolist()}, {"type": "moment", "at": "beam@1", "value": M}]
    bodies = {"beam": helpers.body(helpers.line(1.2, 0.3), helpers.element(name, 5))}
    out = helpers.solved(bodies, loads=loads, bc=[{"name": "wall", "type": "clamp", "at": "beam@0"}])
    wall, r = out.reactions()["wall"], out.r(f"beam@{s}")
    assert wall["m"] == pytest.approx(-M - (r[0] * F[1] - r[1] * F[0]), abs=1e-7 * EI)
    np.testing.assert_allclose([wall["fx"], wall["fy"]], -F, atol=1e-7 * EI)


@helpers.every_small_type
def test_three_supports_share_the_load_in_equilibrium(name):
    bodies = {"beam": helpers.body(helpers.line(2.0, 0.3), helpers.element(name, 6))}
    bc = [
        {"name": "a", "type": "pin", "at": "beam@0"},
        {"name": "b", "type": "roller", "at": "beam@0.42", "normal": [1, 3]},
        {"name": "c", "type": "roller", "at": "beam@1", "fixed": "y"},
    ]
    F = np.array([0.3, -0.5]) * EI
    for solver in ("linear_static", "static"):
        out = helpers.solved(bodies, solver, bc=bc, loads=[{"type": "force", "at": "beam@0.7", "value": F.tolist()}])
        r = out.reactions()
        np.testing.assert_allclose([sum(v[k] for v in r.values()) for k in ("fx", "fy")], -F, atol=1e-9 * EI)
        assert r["b"]["fx"] * 3 == pytest.approx(r["b"]["fy"], rel=1e-9)
        assert r["c"]["fx"] == pytest.approx(0, abs=1e-12 * EI)
        # moment about the origin, of points where they are (linear theory: where they were)
        places = {"a": 0, "b": 0.42, "c": 1, "load": 0.7}
        where = {k: 2 * s * np.array([np.cos(0.3), np.sin(0.3)]) for k, s in places.items()}
        if solver == "static":
            where = {k: out.r(f"beam@{s}") for k, s in places.items()}
        total = where["load"][0] * F[1] - where["load"][1] * F[0]
        total += sum(where[k][0] * r[k]["fy"] - where[k][1] * r[k]["fx"] + r[k]["m"] for k in "abc")
        assert total == pytest.approx(0, abs=1e-8 * EI)


@pytest.mark.parametrize("name", helpers.KINDS.values())
def test_section_forces_are_those_of_the_free_body_beyond(name):
    """N, Q, M of a cantilever under a tip force: the force in the section's axes and its moment about the point."""
    F = np.array([0.4, -0.6]) * EI
    bodies = {"beam": helpers.body(helpers.line(1.2), helpers.element(name, 6))}
    for solver in ("linear_static", "static"):
        out = helpers.solved(bodies, solver, bc=[{"type": "clamp", "at": "beam@0"}], loads=helpers.tip(*F))
        for s in (0.0, 0.25, 0.5, 0.9):
            N, Q, M = helpers.section_forces(out.model, out.state, out.point(f"beam@{s}"))
            linear = solver == "linear_static"
            angle = 0.0 if linear else out.theta(f"beam@{s}")
            arm = np.array([1.2 * (1 - s), 0.0]) if linear else out.r("beam@1") - out.r(f"beam@{s}")
            c, si = np.cos(angle), np.sin(angle)
            expected = [c * F[0] + si * F[1], -si * F[0] + c * F[1], arm[0] * F[1] - arm[1] * F[0]]
            np.testing.assert_allclose([N, Q, M], expected, atol=1e-7 * EI)


def test_section_forces_have_no_jump_within_elements_out_of_balance():
    """Between nodes no load acts on a body, so N, Q, M are smooth there, whatever the residual."""
    bodies = {"beam": helpers.body(helpers.line(1.2), helpers.element("reissner3", 1))}
    out = helpers.solved(bodies, bc=[{"type": "clamp", "at": "beam@0"}], loads=helpers.tip(0.4 * EI, -0.6 * EI))
    off = replace(out.state, d=out.d + 0.01 * np.random.default_rng(0).standard_normal(len(out.d)))
    before, middle, behind = (np.array(helpers.section_forces(out.model, off, out.point(f"beam@{s}")))
                              for s in (0.4999, 0.5, 0.5001))
    np.testing.assert_allclose(before + behind, 2.0 * middle, rtol=1e-5)


@pytest.mark.parametrize("solver", ["linear_static", "static", {"type": "static", "method": "arc_length"}, "buckling"])
@pytest.mark.parametrize("angle", np.arange(8) * 0.3)
def test_zero_energy_modes_are_refused_in_any_orientation(angle, solver):
    """2 x 2 Gauss points have such modes; a round-off stiffness is no stiffness, whether or not a load excites them."""
    across = np.array([-np.sin(angle), np.cos(angle)])
    end = 6.0 * np.array([np.cos(angle), np.sin(angle)])
    bar = {"geometry": helpers.line(6.0, angle), "section": {"EA": 387103.6, "kGA": 101066.6, "EI": 8471.3},
           "element": {"type": "omar", "count": 3, "preset": "paper"}}
    spring = {"type": "translational", "between": ["d@1", end + 5.0 * across], "stiffness": 88.0}
    pull = {"type": "force", "at": "d@1", "value": across}
    with pytest.raises(ComputationError, match="has no stiffness"):
        helpers.solved({"d": bar}, solver, bc=[{"type": "pin", "at": "d@0"}], springs=[spring], loads=[pull])
