"""Bifurcations on a path: reported, passed straight on, or followed onto branches."""

from __future__ import annotations

import math

import helpers
import numpy as np
import pytest
from helpers import path, reaches

from ancf2d.errors import CaseError


def column(lateral, solver, count=16, kind="force"):
    beam = {"column": helpers.body(helpers.line(1.0, math.pi / 2), helpers.element("reissner3", count),
                                   {"EA": 1e6, "kGA": 1e6, "EI": 1.0})}
    sideways = [lateral, 0] if kind == "force" else [0, -lateral]
    loads = [{"type": "force", "at": "column@1", "value": [0, -1]},
             {"type": kind, "at": "column@1", "value": sideways, "amplitude": {"type": "constant"}}]
    return helpers.solved(beam, solver, bc=[{"type": "clamp", "at": "column@0"}], loads=loads,
                          output={"probes": {"top": "column@1"}})


def test_bifurcation_of_a_perfect_column_is_reported_and_the_straight_path_kept():
    out = column(0.0, path({"load_factor": 30}))
    found = out.state.report["bifurcations"]
    euler = [math.pi**2 / 4, 9 * math.pi**2 / 4]
    np.testing.assert_allclose([b["factor"] for b in found], euler, rtol=3e-4)
    assert [b["negative_pivots"] for b in found] == [[0, 1], [1, 2]]
    assert all("straight on" in b["direction"] for b in found)
    np.testing.assert_allclose([b["probes"]["top"]["uy"] for b in found], -1e-6 * np.array(euler), rtol=3e-4)
    assert sum("bifurcation" in w for s in out.states for w in s.warnings) == 2
    assert out.state.report["limit_points"] == []
    np.testing.assert_allclose(out.u("column@1"), [0, -30e-6], atol=1e-9)


@pytest.mark.parametrize("kind", ["force", "follower_force"])
@pytest.mark.parametrize("lateral", [1e-2, 1e-5, 1e-8])
def test_a_tiny_imperfection_leads_onto_the_bent_branch_for_any_first_step(lateral, kind):
    """The first step would end far beyond the buckling load, where Newton's method would find the straight state."""
    out = column(lateral, path(reaches("top", "theta", -math.pi / 2)), kind=kind)
    k = math.sin(math.pi / 4)
    from scipy.special import ellipk

    assert out.state.t == pytest.approx(ellipk(k * k) ** 2, rel=1e-4 + 2 * lateral)
    assert out.state.report["bifurcations"] == []
    assert (np.diff([s.t for s in out.states]) > 0).all()


def test_sway_of_a_symmetric_arch_is_a_bifurcation_and_its_snap_through_a_limit_point():
    arc = {"type": "arc", "center": [0, -100], "radius": 100, "from": math.pi / 2 + 0.25, "to": math.pi / 2 - 0.25}
    body = helpers.body(arc, helpers.element("reissner3", 16), {"height": 2, "width": 1}, {"E": 1e6, "nu": 0.3})
    bc = [{"type": "pin", "at": "arch@0"}, {"type": "pin", "at": "arch@1"}]
    out = helpers.solved({"arch": body}, path({"limit_points": 2}), bc=bc, output={"probes": {"apex": "arch@0.5"}},
                         loads=[{"type": "force", "at": "arch@0.5", "value": [0, -1]}])
    report = out.state.report
    assert [b["negative_pivots"] for b in report["bifurcations"]] == [[0, 1]]
    assert report["bifurcations"][0]["factor"] < report["limit_points"][0]["factor"]
    for state in out.states:
        assert state.d[out.point("arch@0.5").dofs()[0]] == pytest.approx(0, abs=1e-7)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("at", [1, 2])
def test_a_perfect_column_leaves_its_straight_path_onto_the_elastica(at, direction):
    """A cantilever in its n-th mode is 2 n - 1 quarter waves of the same curve, by elliptic integrals (Timoshenko)."""
    from scipy.special import ellipe, ellipk

    # with one quarter wave more than whole ones the end turns one way, with three the other
    turn = math.pi / 3 * direction * (-1 if at == 1 else 1)
    out = column(0.0, path(reaches("top", "theta", turn), branch={"at": at, "direction": direction}))
    k = math.sin(math.pi / 6)
    K, waves = ellipk(k * k), 2 * at - 1
    x, y = out.u("column@1")
    assert out.state.t == pytest.approx((waves * K) ** 2, rel=2e-5 * waves**4)
    assert abs(x) == pytest.approx(2 * k / K / waves, rel=1e-4 * waves**2)
    assert y == pytest.approx(2 * ellipe(k * k) / K - 2, rel=1e-4 * waves**2)
    assert at == 2 or x * direction > 0
    found = out.state.report["bifurcations"]
    assert len(found) == at
    assert found[-1]["factor"] == pytest.approx((waves * math.pi / 2) ** 2, rel=1e-4 * waves**2)
    assert found[-1]["branch_negative_pivots"] == at - 1
    (said,) = [w for s in out.states for w in s.warnings if "onto a branch, which" in w]
    assert ("is stable" if at == 1 else "is unstable there (negative pivots: 1)") in said


def test_the_branches_of_a_symmetric_arch_sway_to_either_side_and_fall():
    """The load falls along both branches, which are unstable and mirror images of each other."""
    arc = {"type": "arc", "center": [0, -100], "radius": 100, "from": math.pi / 2 + 0.25, "to": math.pi / 2 - 0.25}
    body = helpers.body(arc, helpers.element("reissner3", 16), {"height": 2, "width": 1}, {"E": 1e6, "nu": 0.3})
    bc = [{"type": "pin", "at": "arch@0"}, {"type": "pin", "at": "arch@1"}]
    left, right = (helpers.solved({"arch": body}, path(reaches("apex", "uy", -2.5), branch={"direction": side}), bc=bc,
                                  output={"probes": {"apex": "arch@0.5"}},
                                  loads=[{"type": "force", "at": "arch@0.5", "value": [0, -1]}]) for side in (1, -1))
    for s in (0.25, 0.5, 0.75):
        np.testing.assert_allclose(left.u(f"arch@{s}"), right.u(f"arch@{1 - s}") * [-1, 1], rtol=1e-6)
    assert abs(left.u("arch@0.25")[1] - left.u("arch@0.75")[1]) > 0.5
    for out in (left, right):
        (critical,) = out.state.report["bifurcations"]
        assert critical["branch_negative_pivots"] == 1
        assert out.state.t < critical["factor"]


def test_a_missing_branch_is_reported():
    out = column(0.0, path({"load_factor": 1}, branch={"at": 1, "direction": 1}))
    assert any("the path ends before its bifurcation 1 (it met 0)" in w for w in out.state.warnings)
    with pytest.raises(CaseError, match="method newton cannot follow branches"):
        column(0.0, {"type": "static", "branch": {"at": 1}})
    with pytest.raises(CaseError, match=r"direction must be .*1 or -1"):
        column(0.0, path({"load_factor": 1}, branch={"at": 1, "direction": 0}))
