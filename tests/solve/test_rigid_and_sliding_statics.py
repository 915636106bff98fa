"""Rigid levers, cranks and sliders in equilibrium, compared with calculations by hand."""

from __future__ import annotations

import helpers
import numpy as np
import pytest

from ancf2d.errors import ComputationError
from ancf2d.solvers.ldl import SymmetricFronts
from ancf2d.solvers.linear import GeneralSparse, make_matrix

SECTION = {"height": 0.05, "width": 0.05}
EI = 2.07e11 * 0.05**4 / 12


def rigid(geometry):
    return {"geometry": geometry, "element": {"type": "rigid"}}


def beam(geometry, name="reissner3", count=4):
    return helpers.body(geometry, helpers.element(name, count), SECTION, helpers.STEEL)


def test_a_lever_on_a_spring_balances_moments_in_large_rotation():
    """Pinned at a quarter, a force at the short arm and a spring at the long one: moments about the pin by hand."""
    load = {"type": "force", "at": "lever@0", "value": [3.0, 40.0]}
    spring = {"type": "translational", "between": ["lever@1", [2.0, 1.0]], "stiffness": 30.0}
    sol = helpers.solved({"lever": rigid(helpers.line(2.0))}, bc=[{"name": "p", "type": "pin", "at": "lever@0.25"}],
                         springs=[spring], loads=[load])
    phi = sol.theta("lever@0.7")
    n = np.array([np.cos(phi), np.sin(phi)])
    ends = np.array([[0.5, 0.0]]) + np.outer([-0.5, 1.5], n)
    np.testing.assert_allclose([sol.r("lever@0"), sol.r("lever@1")], ends, atol=1e-9)
    pull = np.array([2.0, 1.0]) - ends[1]
    force = 30.0 * (np.hypot(*pull) - 1.0) * pull / np.hypot(*pull)
    moment = (-0.5 * n[0]) * 40.0 - (-0.5 * n[1]) * 3.0 + 1.5 * (n[0] * force[1] - n[1] * force[0])
    assert moment == pytest.approx(0, abs=1e-6)
    assert abs(phi) > 0.2
    reaction = sol.reactions()["p"]
    np.testing.assert_allclose([reaction["fx"], reaction["fy"]], -force - [3.0, 40.0], atol=1e-6)


@pytest.mark.parametrize("name", ["vallejo", "cable", "reissner3", "omar", "2d3n-nu"])
def test_a_rigid_arm_on_a_beam_bends_it_by_its_moment(name):
    """Linear theory: slope M L/EI and deflection M L^2/(2 EI) at the tip; the arm rotates with the beam's section."""
    arm = rigid(helpers.line(0.5, np.pi / 2, (1.0, 0.0)))
    sol = helpers.solved({"beam": beam(helpers.line(1.0), name), "arm": arm}, "linear_static",
                         bc=[{"name": "wall", "type": "clamp", "at": "beam@0"}],
                         joints=[{"type": "weld", "between": ["beam@1", "arm@0"]}],
                         loads=[{"type": "force", "at": "arm@1", "value": [100.0, 0.0]}])
    slope = -50.0 / EI
    assert sol.theta("beam@1") == pytest.approx(slope, rel=2e-3)
    assert sol.theta("arm@0.5") == pytest.approx(sol.theta("beam@1"), rel=1e-9)
    assert sol.u("beam@1")[1] == pytest.approx(0.5 * slope, rel=2e-3)
    assert sol.u("arm@1")[0] == pytest.approx(-0.5 * slope + 100.0 / (2.07e11 * 0.0025), rel=2e-3)
    assert sol.reactions()["wall"]["m"] == pytest.approx(50.0, rel=1e-9)


def test_a_bent_rigid_body_keeps_its_angle():
    """A beam whose tip carries a rigid elbow: the elbow's end moves rigidly with its start."""
    elbow = rigid({"type": "polyline", "points": [[1, 0], [1.5, 0], [1.5, 0.7]]})
    sol = helpers.solved({"beam": beam(helpers.line(1.0)), "elbow": elbow}, bc=[{"type": "clamp", "at": "beam@0"}],
                         joints=[{"type": "weld", "between": ["beam@1", "elbow@0"]}],
                         loads=[{"type": "force", "at": "elbow@1", "value": [2e4, 3e4]}])
    phi = sol.theta("beam@1")
    assert abs(phi) > 0.1
    c, s = np.cos(phi), np.sin(phi)
    np.testing.assert_allclose(sol.r("elbow@1") - sol.r("beam@1"), [0.5 * c - 0.7 * s, 0.5 * s + 0.7 * c], atol=1e-9)
    assert sol.theta("elbow@0.9") == pytest.approx(phi, abs=1e-9)


def test_a_rigid_crank_drives_a_slider_by_its_prescribed_angle():
    """Crank of 0.3 m, rod of 0.5 m, both rigid: x = 0.3 cos a + sqrt(0.25 - 0.09 sin^2 a)."""
    start = 0.4
    knee = (0.3 * np.cos(start), 0.3 * np.sin(start))
    end = knee[0] + np.sqrt(0.25 - knee[1] ** 2)
    rod = {"type": "line", "start": list(knee), "end": [end, 0.0]}
    sol = helpers.solved(
        {"crank": rigid(helpers.line(0.3, start)), "rod": rigid(rod)},
        bc=[{"name": "axle", "type": "pin", "at": "crank@0"}, {"type": "prescribed", "at": "crank@0", "angle": 2.0}],
        joints=[{"type": "pin", "between": ["crank@1", "rod@0"]},
                {"type": "slider", "at": "rod@1", "through": [0, 0], "along": [1, 0]}],
        loads=[{"type": "force", "at": "rod@1", "value": [-10.0, 0.0]}],
    )
    a = start + 2.0
    x = 0.3 * np.cos(a) + np.sqrt(0.25 - 0.09 * np.sin(a) ** 2)
    np.testing.assert_allclose(sol.r("rod@1"), [x, 0.0], atol=1e-9)
    assert sol.theta("crank@1") == pytest.approx(2.0, abs=1e-9)


@pytest.mark.parametrize("name", helpers.KINDS.values())
def test_a_beam_on_an_inclined_slider_moves_only_along_the_line(name):
    """The slider's force is normal to its line: with a cantilever under F, it follows from the ratio of stiffnesses."""
    load = {"type": "force", "at": "beam@1", "value": [0.0, -100.0]}
    sol = helpers.solved({"beam": beam(helpers.line(1.0), name)}, "linear_static",
                         bc=[{"name": "wall", "type": "clamp", "at": "beam@0"}],
                         joints=[{"type": "slider", "at": "beam@1", "through": [1, 0], "along": [1, 1]}], loads=[load])
    u = sol.u("beam@1")
    assert u[0] == pytest.approx(u[1], rel=1e-9)
    # along the line: (EA/L + 3 EI/L^3) u = -F, with shear a correction of (h/L)^2
    assert u[1] == pytest.approx(-100.0 / (2.07e11 * 0.0025 + 3 * EI), rel=1e-3)


@pytest.mark.slow_rows("follower_force")
@pytest.mark.parametrize("kind", ["force", "follower_force"])
def test_a_wide_net_of_rigid_bars(kind):
    """Bars between distant nodes make the band wide; a follower load needs sparse factors with row exchanges."""
    bodies, n = {"beam": beam(helpers.line(1.0), count=60)}, 30
    joints, springs = [], []
    for k in range(n):
        s = k / n
        bodies[f"bar{k}"] = rigid(helpers.line(0.2, np.pi / 2, (s, 0.0)))
        joints.append({"type": "pin", "between": [f"beam@{s}", f"bar{k}@0"]})
        springs.append({"type": "translational", "between": [f"bar{k}@1", [s - 0.5, 0.2]], "stiffness": 1e3})
        springs += [{"type": "translational", "between": [f"bar{k}@1", f"bar{m}@1"], "stiffness": 1e3}
                    for m in ((7 * k + 5) % n, (k + n // 2) % n) if m != k]
    sol = helpers.solved(bodies, bc=[{"type": "clamp", "at": "beam@0"}], joints=joints, springs=springs,
                         loads=[{"type": kind, "at": "bar7@1", "value": [10.0, 10.0]}])
    matrix = make_matrix(sol.model)
    if kind == "force":
        assert isinstance(matrix, SymmetricFronts)
    else:
        assert isinstance(matrix, GeneralSparse)
        assert matrix.exchange
    for k in range(n):
        assert np.hypot(*(sol.r(f"bar{k}@1") - sol.r(f"bar{k}@0"))) == pytest.approx(0.2, rel=1e-9)
    assert abs(sol.theta("bar7@0")) > 1e-3


def test_sparse_factors_exchange_rows_on_request():
    matrix = GeneralSparse(2, np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1]), exchange=True)
    matrix.values[:] = [1e-17, 1.0, 1.0, 1e-17]
    assert matrix.factor().bad == -1
    np.testing.assert_allclose(matrix.solve(np.ones(2)), [1.0, 1.0], rtol=1e-14)


@pytest.mark.parametrize("solver", ["linear_static", "static"])
def test_the_reactions_of_a_clamped_rigid_bar(solver):
    """The bar of each random scene is at rest: the clamp has the force and its moment, and nothing else."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        p, q, F = rng.normal(size=2), rng.normal(size=2), rng.normal(size=2) * 10 ** rng.uniform(-3, 6)
        hold, at = rng.uniform(size=2).round(2)
        sol = helpers.solved({"bar": rigid({"type": "line", "start": p, "end": q})}, solver,
                             bc=[{"name": "w", "type": "clamp", "at": f"bar@{hold}"}],
                             loads=[{"type": "force", "at": f"bar@{at}", "value": F}])
        arm = (at - hold) * (q - p)
        found = sol.reactions()["w"]
        assert [found["fx"], found["fy"]] == pytest.approx(list(-F), rel=1e-12)
        assert found["m"] == pytest.approx(arm[1] * F[0] - arm[0] * F[1], abs=1e-12 * np.abs(F).max())


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("solver", ["linear_static", "static"])
def test_forces_of_rigid_bars_follow_from_balance(solver, size):
    """Two bars between two pins on the ground and a loaded one: no stiffness anywhere, forces along the bars."""
    feet, top = size * np.array([[0.0, 0.0], [2.0, 0.1]]), size * np.array([1.1, 0.7])
    F = np.array([3.0, 4.0])
    bars = {k: rigid({"type": "line", "start": foot, "end": top}) for k, foot in zip("ab", feet, strict=True)}
    sol = helpers.solved(bars, solver, bc=[{"name": k, "type": "pin", "at": f"{k}@0"} for k in "ab"],
                         joints=[{"type": "pin", "between": ["a@1", "b@1"]}],
                         loads=[{"type": "force", "at": "a@1", "value": F}])
    along = np.linalg.solve((top - feet).T, -F)
    for k, foot, force in zip("ab", feet, along, strict=True):
        reaction = sol.reactions()[k]
        np.testing.assert_allclose([reaction["fx"], reaction["fy"]], force * (top - foot), rtol=1e-12)
    assert not sol.u("a@1").any()
    assert not sol.state.warnings


def test_a_rigid_column_on_a_torsion_spring_buckles_at_spring_over_length():
    """Inertia without row exchanges: one negative pivot once the load exceeds k/L = 1.571 of 2 N."""
    solver = {"type": "static", "steps": 10}
    hinge = {"type": "rotational", "between": ["bar@0", [0, 0]], "stiffness": 3.1415}
    sol = helpers.solved({"bar": rigid(helpers.line(2.0, 0.7))}, solver, bc=[{"type": "pin", "at": "bar@0"}],
                         springs=[hinge],
                         loads=[{"type": "force", "at": "bar@1", "value": [-2.0 * np.cos(0.7), -2.0 * np.sin(0.7)]}])
    passed = [s.t for s in sol.states if s.history["negative_pivots"] == 1]
    assert min(passed) == pytest.approx(3.1415 / 4, rel=1e-3)
    assert sum("unstable" in w for s in sol.states for w in s.warnings) == 1
    assert not any(s.warnings for s in sol.states if s.t < 0.7)


@helpers.covering(steps=[1, 7, 50], angle=[3.0, -20.0], force=[(0.0, 0.0), (3.0, -4.0)])
def test_a_rigid_bar_turns_by_its_prescribed_angle_in_any_number_of_steps(steps, angle, force):
    """Without loads there is neither stiffness nor force, and round-off is not taken for either."""
    length, start = 1e-3, 0.7
    sol = helpers.solved({"bar": rigid(helpers.line(length, start))}, {"type": "static", "steps": steps},
                         bc=[{"name": "p", "type": "pin", "at": "bar@0"},
                             {"name": "m", "type": "prescribed", "at": "bar@0", "angle": angle}],
                         loads=[{"type": "force", "at": "bar@1", "value": list(force)}] if any(force) else [])
    tip = length * np.array([np.cos(start + angle), np.sin(start + angle)])
    np.testing.assert_allclose(sol.r("bar@1"), tip, atol=1e-12 * length)
    found = sol.reactions()
    assert found["m"]["m"] == pytest.approx(tip[1] * force[0] - tip[0] * force[1], abs=1e-9 * length)
    np.testing.assert_allclose([found["p"]["fx"], found["p"]["fy"]], -np.array(force), atol=1e-9)


@pytest.mark.parametrize("other", ["on a spring", "elastic"])
def test_a_rigid_bar_turns_by_its_prescribed_angle_next_to_a_body_at_rest(other):
    """No force acts on either: round-off of the constraint forces is not an imbalance."""
    bodies = {"bar": rigid(helpers.line(1.0)), "other": beam(helpers.line(1.0, 0.0, (5.0, 0.0)))}
    springs = []
    if other == "on a spring":
        bodies["other"] = rigid(helpers.line(1.0, 0.0, (5.0, 0.0)))
        springs.append({"type": "rotational", "between": ["other@0", [5.0, 0.0]], "stiffness": 3.0})
    for angle in (0.5, 3.0):
        sol = helpers.solved(bodies, bc=[{"type": "pin", "at": "bar@0"},
                                         {"type": "prescribed", "at": "bar@0", "angle": angle},
                                         {"type": "pin" if springs else "clamp", "at": "other@0"}], springs=springs)
        np.testing.assert_allclose(sol.r("bar@1"), [np.cos(angle), np.sin(angle)], atol=1e-12)
        np.testing.assert_allclose(sol.r("other@1"), [6.0, 0.0], atol=1e-12)


def rigid_column(load, **solver):
    """A column of 1 m on a torsion spring of 3 N m: critical at 3 N."""
    return helpers.solved({"bar": rigid(helpers.line(1.0))}, {"type": "static", **solver},
                          bc=[{"type": "pin", "at": "bar@0"}],
                          springs=[{"type": "rotational", "between": ["bar@0", [0, 0]], "stiffness": 3.0}],
                          loads=[{"type": "force", "at": "bar@1", "value": [-load, 0.0]}])


@pytest.mark.parametrize("steps", [1, 4, 10])
def test_steps_avoid_a_critical_load(steps):
    """Steps of a quarter and halves of a tenth would end exactly at 3/4 of the load; one step passes it at once."""
    states = rigid_column(4.0, steps=steps).states
    assert min(s.t for s in states if s.history["negative_pivots"] == 1) == pytest.approx(0.75, rel=1e-3)
    assert sum("unstable" in w for s in states for w in s.warnings) == 1
    assert not any(s.warnings for s in states if s.t < 0.75)


@pytest.mark.parametrize("steps", [1, 10])
def test_a_path_that_ends_at_a_critical_load_names_it(steps):
    with pytest.raises(ComputationError, match=r"load factor 1 is critical"):
        rigid_column(3.0, steps=steps)


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_rigid_columns_on_torsion_springs_buckle_at_the_loads_of_their_stiffness(angle):
    """One bar of 2 m: k/L. Two of 1 m, k = 1 at foot and knee: the eigenvalues of [[2, -1], [-1, 1]]."""
    c, s = np.cos(angle), np.sin(angle)
    foot = [{"type": "pin", "at": "a@0"}]

    def factors(bodies, springs, at, joints):
        load = {"type": "force", "at": at, "value": [-c, -s]}
        return helpers.solved(bodies, {"type": "buckling", "modes": len(bodies)}, bc=foot, springs=springs,
                              joints=joints, loads=[load]).state.report["load_factors"]

    hinge = {"type": "rotational", "between": ["a@0", [0, 0]], "stiffness": 1.0}
    one = factors({"a": rigid(helpers.line(2.0, angle))}, [hinge], "a@1", [])
    np.testing.assert_allclose(one, [0.5], rtol=1e-12)
    knee = {"type": "rotational", "between": ["a@1", "b@0"], "stiffness": 1.0}
    two = factors({"a": rigid(helpers.line(1.0, angle)), "b": rigid(helpers.line(1.0, angle, (c, s)))}, [hinge, knee],
                  "b@1", [{"type": "pin", "between": ["a@1", "b@0"]}])
    np.testing.assert_allclose(two, np.linalg.eigvalsh([[2.0, -1.0], [-1.0, 1.0]]), rtol=1e-12)


@pytest.mark.parametrize("angle", np.linspace(0, 1.5, 7))
def test_a_fixed_rigid_body_next_to_a_flexible_one_passes_its_loads_to_its_supports(angle):
    """Nothing moves, and round-off over a soft spring is not motion: reactions must not follow from it."""
    def at(x, y):
        return [x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)]

    def between(start, end):
        return {"type": "line", "start": at(*start), "end": at(*end)}

    bodies = {"b": rigid(between([-0.5135, 0.7746], [0.4091, 1.3714])),
              "d": rigid(between([0.4091, 1.3714], [0.4091, 3.0723])), "c": beam(between([0.57, -0.36], [-0.75, 0.64]))}
    sol = helpers.solved(
        bodies, solver={"type": "linear_static"},
        bc=[{"name": "pin", "type": "pin", "at": "b@0"}, {"type": "pin", "at": "c@0"},
            {"name": "roller", "type": "roller", "at": "b@0.25", "normal": at(0.6041, -0.6685)}],
        joints=[{"type": "weld", "between": ["b@1", "d@0"]}],
        springs=[{"type": "rotational", "between": [[0, 0], "b@1"], "stiffness": 105.7},
                 {"type": "rotational", "between": [[0, 0], "c@1"], "stiffness": 13.0}],
        loads=[{"type": "moment", "at": "b@1", "value": 6.627},
               {"type": "force", "at": "d@0", "value": at(72.34, 7.9)}])
    held = np.sum([[sol.reactions()[name][k] for k in ("fx", "fy")] for name in ("pin", "roller")], axis=0)
    np.testing.assert_allclose(held, at(-72.34, -7.9), atol=1e-9)
