"""Tendons: closed forms, equilibrium of eyelets, elastic tendons and springs, and an arm of vertebrae in motion."""

from __future__ import annotations

from typing import Any

import helpers
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ancf2d
from ancf2d.errors import CaseError, ComputationError
from ancf2d.interactions.tendon_laws import taut
from ancf2d.model.points import point_ref
from ancf2d.solvers.section_forces import SectionForces

E, H, B, L = 1e7, 0.1, 0.1, 2.0
EA, EI = E * H * B, E * B * H**3 / 12
CLAMP = [{"name": "wall", "type": "clamp", "at": "a@0"}]


def beam(kind: str = "reissner3", count: int = 16, **more: Any) -> dict[str, Any]:
    return {"geometry": {"type": "line", "start": [0, 0], "end": [L, 0]}, "section": {"height": H, "width": B},
            "material": {"E": E, "nu": 0.0, "rho": 1000.0}, "element": {"type": kind, "count": count, **more}}


def solve(body: dict[str, Any], loads: list[dict[str, Any]], solver: Any = "static", **scene: Any) -> helpers.Solution:
    return helpers.solved({"a": body}, solver, bc=CLAMP, loads=loads, **scene)


@pytest.mark.parametrize(("kind", "more", "near"), [
    ("reissner3", {}, 5e-5), ("cable", {}, 5e-5), ("omar", {"formulation": "structural"}, 5e-3)])
@pytest.mark.parametrize("y", [0.04, -0.02])
def test_a_guided_tendon_bends_into_a_circle(kind: str, more: dict[str, Any], near: float, y: float) -> None:
    """N = -T along the tendon and M = T y all along: strain -T/EA, curvature T y/EI, for any rotation."""
    tension = EI * np.pi / 4 / abs(y)
    found = solve(beam(kind, 16, **more), [{"type": "tendon", "on": "a", "y": y, "tension": tension}])
    bend, stretch = tension * y / EI, 1 - tension / EA
    angle = bend * L
    exact = stretch / bend * np.array([np.sin(angle), 1 - np.cos(angle)])
    np.testing.assert_allclose(found.r("a@1"), exact, atol=near)
    assert found.theta("a@1") == pytest.approx(angle, abs=near)
    for reaction in found.reactions()["wall"].values():
        assert reaction == pytest.approx(0.0, abs=1e-6)


def test_a_sloping_guide_pulls_on_its_end() -> None:
    """Small: M = T y cos(slope), so the tip turns by the integral of M/EI; also for a table with a kink."""
    tension = 1e-3
    steep = 0.35 * 0.015 / np.hypot(1, 0.03 / (0.35 * L))
    for y, mean in (("0.04*(1 - s)", 0.02 / np.hypot(1, 0.04 / L)),
                    ({"s": [0, 0.35, 1], "value": [0.0, 0.03, 0.03]}, steep + 0.65 * 0.03)):
        for kind in ("reissner3", "omar"):
            found = solve(beam(kind, 8), [{"type": "tendon", "on": "a", "y": y, "tension": tension}], "linear_static")
            assert found.theta("a@1") == pytest.approx(tension * mean * L / EI, rel=2e-4 if kind == "omar" else 1e-6)


@pytest.mark.parametrize("elastic", [False, True])
@pytest.mark.parametrize(("kind", "more"), [
    ("reissner3", {}), ("cable", {}), ("vallejo", {"formulation": "structural"})])
def test_sections_balance_a_guided_tendon(kind: str, more: dict[str, Any], elastic: bool) -> None:
    """At nodes and between, every section balances the tendon: N = -T cos, Q = -T sin of its slope, M = T y cos."""
    if kind == "cable" and elastic:
        pytest.skip("the curve guides elastic tendons on its axis only")
    y = 0.03 if kind == "cable" else "0.04*(1 - s)"
    load = {"type": "tendon", "on": "a", "y": y, **({"stiffness": 1e4, "slack": -0.01} if elastic else {"tension": 50})}
    # far from the reference its slope is that to the section, but for its own small shear and stretch
    found = solve(beam(kind, 8, **more), [load], "static" if elastic else "linear_static")
    (guide,) = found.model.loads.guides
    T = guide.tension(found.d[:found.model.n_q], 1.0)
    forces = SectionForces(found.model, found.model.meshes["a"], np.array([0.0, 0.3, 0.5, 0.9]))(found.state)
    s = (np.arange(8)[:, None] + [0.0, 0.3, 0.5, 0.9]) / 8
    slope = 0.0 if kind == "cable" else np.arctan(-0.04 / L)
    offset = np.full_like(s, y) if kind == "cable" else 0.04 * (1 - s)
    expected = [np.full_like(s, -T * np.cos(slope)), np.full_like(s, -T * np.sin(slope)), T * np.cos(slope) * offset]
    np.testing.assert_allclose(forces, np.stack(expected, axis=-1), atol=(1e-3 if elastic else 1e-8) * T)


def test_sections_of_a_bent_beam_balance_a_sloping_guide() -> None:
    """As above, with the direction of the tendon from differences of r + y n along the bent beam."""
    T, xi, h = 1500.0, np.array([0.3, 0.5, 0.8]), 1e-5
    found = solve(beam(), [{"type": "tendon", "on": "a", "y": "0.04*(1 - s)", "tension": T}])
    forces = SectionForces(found.model, found.model.meshes["a"], xi)(found.state)

    def axes(s: float) -> np.ndarray:
        c, sn = np.cos(found.theta(f"a@{s!r}")), np.sin(found.theta(f"a@{s!r}"))
        return np.array([[c, sn], [-sn, c]])

    def guide(s: float) -> np.ndarray:
        return found.r(f"a@{s!r}") + 0.04 * (1 - s) * axes(s)[1]
    for e, k in np.ndindex(16, 3):
        s = float((e + xi[k]) / 16)
        way = axes(s) @ (guide(s + h) - guide(s - h))
        N, Q = -T * way / np.linalg.norm(way)
        assert forces[e, k] == pytest.approx([N, Q, -0.04 * (1 - s) * N], rel=1e-6, abs=1e-7 * T)


EYELETS = [{"at": "a@0.2", "y": 0.05}, {"at": "a@0.5", "y": 0.03}, {"at": "a@0.9", "y": 0.06}]


@pytest.mark.parametrize("kind", ["reissner3", "cable", "vallejo"])
def test_eyelets_are_in_equilibrium(kind: str) -> None:
    """The wall carries the pull of the tendon at the ground eyelets of its ends, and nothing else."""
    tension = 400.0
    ends = np.array([[-0.3, 0.2], [1.5, 1.2]])
    load = {"type": "tendon", "through": [ends[0].tolist(), *EYELETS, ends[1].tolist()], "tension": tension}
    found = solve(beam(kind), [load])
    places = [found.r(e["at"]) for e in EYELETS]
    turned = []
    for place, e in zip(places, EYELETS, strict=True):
        angle = found.theta(e["at"])
        turned.append(place + e["y"] * np.array([-np.sin(angle), np.cos(angle)]))
    # ANCF sections stretch across: their eyelets are a little nearer
    slack = 1e-9 if kind != "vallejo" else 2e-2
    pulls = [tension * (end - at) / np.linalg.norm(end - at)
             for end, at in ((ends[0], turned[0]), (ends[1], turned[-1]))]
    wall = found.reactions()["wall"]
    np.testing.assert_allclose([wall["fx"], wall["fy"]], -sum(pulls), atol=tension * slack)
    moment = sum(end[0] * p[1] - end[1] * p[0] for end, p in zip(ends, pulls, strict=True))
    assert wall["m"] == pytest.approx(-moment, abs=tension * slack)


TWO = [{"at": "a@0.45", "y": 0.06}, {"at": "a@0.55", "y": -0.04}]
GROUND = np.array([[0.3, 0.8], [1.6, -0.9]])


@pytest.mark.parametrize(("kind", "pull"), [
    ("reissner3", {"tension": 300.0}), ("cable", {"stiffness": 500.0, "slack": -0.8}), ("vallejo", {"tension": 300.0})])
def test_sections_near_two_eyelets_within_an_element_balance_the_part_beyond(kind: str, pull: dict[str, float]) -> None:
    """Far from the reference: before, between and behind them, by hand from the positions of the eyelets."""
    load = {"type": "tendon", "through": [GROUND[0].tolist(), *TWO, GROUND[1].tolist()], **pull}
    found = solve(beam(kind, 3, nodes="regular"), [load])
    way = np.array([GROUND[0], *(eyelet(found, e) for e in TWO), GROUND[1]])
    steps = np.diff(way, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    rest = np.array([GROUND[0], [0.9, 0.06], [1.1, -0.04], GROUND[1]])
    l0 = np.linalg.norm(np.diff(rest, axis=0), axis=1).sum() + pull.get("slack", 0.0)
    T = pull.get("tension", pull.get("stiffness", 0.0) * (lengths.sum() - l0) / l0)
    forces = np.diff(T * steps / lengths[:, None], axis=0)
    assert abs(found.theta("a@0.5")) > 0.05
    sections = SectionForces(found.model, found.model.meshes["a"], np.array([0.25, 0.5, 0.75]))(found.state)[1]
    for k, found_here in enumerate(sections):
        at, angle = (read(f"a@{(1.25 + 0.25 * k) / 3!r}") for read in (found.r, found.theta))
        total, arms = forces[k:].sum(axis=0), way[1 + k:-1] - at
        moment = sum(a[0] * f[1] - a[1] * f[0] for a, f in zip(arms, forces[k:], strict=True))
        c, s = np.cos(angle), np.sin(angle)
        by_hand = [c * total[0] + s * total[1], c * total[1] - s * total[0], moment]
        np.testing.assert_allclose(found_here, by_hand, atol=1e-7 * T)


def eyelet(found: helpers.Solution, e: dict[str, Any]) -> Any:
    """Return the position of an eyelet off the axis."""
    mesh, s = found.model.meshes["a"], float(e["at"][2:])
    if mesh.plan.element.section_kind == "interpolated":
        return np.array([w @ (found.model.e0 + found.d[:found.model.n_q])[c]
                         for c, w in point_ref(mesh, s, e["y"]).position()])
    angle = found.theta(e["at"])
    return found.r(e["at"]) + e["y"] * np.array([-np.sin(angle), np.cos(angle)])


def test_a_guide_that_ends_within_elements_of_a_curve_bends_only_the_part_between() -> None:
    """Small: N = 0 but M = T y of the end moments, which are the whole effect of a guide off the axis of a curve."""
    load = {"type": "tendon", "on": "a", "y": 0.03, "from": 0.25, "to": 0.75, "tension": 50}
    found = solve(beam("cable", 2, nodes="regular"), [load], "linear_static")
    forces = SectionForces(found.model, found.model.meshes["a"], np.array([0.2, 0.45, 0.55, 0.8]))(found.state)
    bent = np.array([[0.0, 0, 1, 1], [1, 1, 0, 0]])
    zero = np.zeros_like(bent)
    np.testing.assert_allclose(forces, np.stack([-50 * bent, zero, 1.5 * bent], axis=-1), atol=1e-8)


def test_section_forces_of_linear_statics_are_linear() -> None:
    """With a tendon through an element whose length is not linear in the displacements."""
    loads = [{"type": "tendon", "through": [[0.0, 0.5], TWO[0], [1.5, 0.8]], "stiffness": 1e4}]
    xi, found = np.array([0.1, 0.5, 0.7]), []
    for push in (-1.0, -1000.0):
        one = solve(beam("reissner3", 3, nodes="regular"),
                    [*loads, {"type": "force", "at": "a@1", "value": [0, push]}], "linear_static")
        found.append(SectionForces(one.model, one.model.meshes["a"], xi)(one.state) / push)
    np.testing.assert_allclose(found[1], found[0], atol=1e-9)


@pytest.mark.parametrize("where", [{"on": "a", "y": 0.03}, {"through": EYELETS}])
def test_an_elastic_tendon_equals_one_of_its_current_tension(where: dict[str, Any]) -> None:
    stiffness, slack = 4e4, -0.05
    body = beam(count=8)
    elastic = solve(body, [{"type": "tendon", "stiffness": stiffness, "slack": slack, **where}])
    (spring,) = elastic.model.springs
    u = spring.G @ elastic.d[spring.coordinates]
    _, tension, _ = taut(spring.p0, u, 1.0, spring.par, int(spring.par[3]))
    assert tension > 100.0
    given = solve(body, [{"type": "tendon", "tension": tension, **where}])
    np.testing.assert_allclose(elastic.d, given.d, atol=1e-8)


def test_an_elastic_tendon_never_pushes() -> None:
    body, force = beam(count=4), {"type": "force", "at": "a@1", "value": [0, 50]}
    alone = solve(body, [force])
    tendon = {"type": "tendon", "through": [[L, 1.0], "a@1"], "stiffness": 1e5}
    np.testing.assert_allclose(solve(body, [force, tendon]).d, alone.d, atol=1e-10)
    held = solve(body, [{**force, "value": [0, -50]}, tendon])
    assert abs(held.u("a@1")[1]) < 0.01 * abs(alone.u("a@1")[1])


# a rope that is let out is slack in the reference, which only Newton's method leaves: the load falls until it is tight
@pytest.mark.parametrize(("solver", "slack"), [
    *((solver, slack) for slack in (0.0, -1.0) for solver in (
        "linear_static", "static", {"type": "static", "method": "arc_length"},
        {"type": "eigen", "modes": 1, "about": "static"})),
    ("static", 0.1), ({"type": "eigen", "modes": 1, "about": "static"}, 0.1)])
def test_a_load_hangs_on_a_wound_up_rope(solver: Any, slack: float) -> None:
    """T = m g and l = l0 (1 + T/EA), with l0 = 5 m + slack; the load vibrates with omega^2 = EA/(l0 m)."""
    mass, stiffness, l0 = 40.0, 1e5, 5.0 + slack
    load = {"geometry": {"type": "line", "start": [2, -3], "end": [2, -3.2]},
            "element": {"type": "rigid", "mass": mass, "inertia": 1.0}}
    found = helpers.solved({"load": load}, solver, bc=[{"type": "roller", "at": f"load@{s}", "fixed": "x"}
                                                       for s in (0, 1)],
                           loads=[{"type": "gravity", "value": [0, -9.81]},
                                  {"type": "tendon", "through": [[0, 0], [2, 0], "load@0"], "stiffness": stiffness,
                                   "slack": slack}])
    assert found.r("load@0")[1] == pytest.approx(2.0 - l0 * (1 + mass * 9.81 / stiffness), rel=1e-9)
    if solver not in ("linear_static", "static") and solver["type"] == "eigen":
        omega = found.state.report["frequencies"][0]["omega"]
        assert omega == pytest.approx(np.sqrt(stiffness / l0 / mass), rel=1e-9)


@pytest.mark.parametrize("method", ["radau5", "generalized_alpha", "energy_momentum"])
def test_winding_up_a_rope_does_work_without_loss(method: str) -> None:
    """m v' = T - m g with T = EA (l - l0)/l0; winding at the rate l0' does the work -l0' T (1 + (l - l0)/2 l0)."""
    mass, stiffness, rate = 40.0, 1e4, 0.5
    load = {"geometry": {"type": "line", "start": [0, 0], "end": [0, -0.2]},
            "element": {"type": "rigid", "mass": mass, "inertia": 1.0}}
    case = {"bodies": {"load": load},
            "boundary_conditions": [{"type": "roller", "at": f"load@{s}", "fixed": "x"} for s in (0, 1)],
            "loads": [{"type": "gravity", "value": [0, -9.81]},
                      {"type": "tendon", "through": [[0, 5], "load@0"], "stiffness": stiffness, "slack": -rate,
                       "amplitude": {"type": "ramp", "t1": 1}}],
            "solver": {"type": "dynamic", "t_end": 1, "method": method, "dt": 2e-3, "estimate": False}}
    found = ancf2d.solve(case)

    def rates(t: float, y: Any) -> list[float]:
        l0 = 5.0 - rate * t
        stretch = 5.0 - y[0] - l0
        T = max(stiffness * stretch / l0, 0.0)
        return [y[1], T / mass - 9.81, T * rate * (1.0 + 0.5 * stretch / l0)]

    exact = solve_ivp(rates, (0, 1), [0, 0, 0], rtol=1e-10, atol=1e-10).y[2, -1]
    assert found.energies["work"][-1] == pytest.approx(exact, rel=1e-5 if method == "radau5" else 1e-3)
    np.testing.assert_allclose(found.energies["dissipated"], 0.0, atol=1e-12 * exact)


def test_a_boom_with_a_wound_up_stay_stands_up() -> None:
    """The stay is wound up before the load acts, which lifts the boom at once, up to its equilibrium."""
    boom = {"geometry": {"type": "line", "start": [0, 0], "end": [4, 0]}, "section": {"height": 0.1, "width": 0.5},
            "material": {"E": 1e10, "nu": 0.3, "rho": 500}, "element": {"type": "reissner3", "count": 4}}
    stay = {"type": "tendon", "through": [[0, 3], "a@0.75"], "stiffness": 2e5, "slack": -0.01,
            "amplitude": {"type": "constant"}}
    found = helpers.solved({"a": boom}, "static", bc=[{"type": "pin", "at": "a@0"}],
                           loads=[{"type": "gravity", "value": [0, -9.81]}, stay,
                                  {"type": "force", "at": "a@1", "value": [0, 2000]}])
    assert found.theta("a@1") == pytest.approx(np.pi / 2, abs=1e-9)
    assert any("tendons tighten" in warning for warning in found.state.warnings)


def test_a_slack_tendon_that_is_the_only_support_is_named() -> None:
    tendon = {"type": "tendon", "through": [[0, 1], "a@0"], "stiffness": 1e5, "slack": 0.1,
              "amplitude": {"type": "constant"}}
    with pytest.raises(CaseError, match=r"'a' is free to move along \(0, 1\).*loads.0: inactive in the reference"):
        helpers.solved({"a": beam(count=2)}, "static", loads=[tendon],
                       bc=[{"type": "prescribed", "at": "a@0", "x": 0, "angle": 0}])


@pytest.mark.parametrize(("up", "slack", "said"), [
    (-1.0, 0.0, None), (1.0, 0.0, "loads.1 would push"), (0.1, -1e-2, None),
    (-1.0, 1e-6, "loads.1 hangs loose in the reference and then pulls"), (1.0, 1e-6, None)])
def test_linear_statics_refuse_tendons_that_go_loose_or_taut(up: float, slack: float, said: str | None) -> None:
    """A tendon from the tip straight up, next to a spring of the same stiffness, which may push."""
    loads = [{"type": "force", "at": "a@1", "value": [0, up]},
             {"type": "tendon", "through": ["a@1", [L, L]], "stiffness": 1e3, "slack": slack}]
    if said is not None:
        with pytest.raises(ComputationError, match=said):
            solve(beam(count=4), loads, "linear_static")
        return
    lift = (-1e3 * slack / (L + slack) if slack < 0.0 else 0.0) + up
    springs = [{"type": "translational", "between": ["a@1", [L, L]], "stiffness": 1e3 / (L + slack)}]
    other = solve(beam(count=4), [{"type": "force", "at": "a@1", "value": [0, lift]}], "linear_static",
                  springs=springs if slack <= 0.0 else [])
    assert solve(beam(count=4), loads, "linear_static").u("a@1")[1] == pytest.approx(other.u("a@1")[1], rel=1e-9)


@pytest.mark.parametrize(("slack", "said"), [(-1e-4, True), (0.0, False)])
def test_linear_statics_warn_that_section_forces_miss_the_rotation_of_pretension(slack: float, said: bool) -> None:
    load = {"type": "tendon", "on": "a", "y": 0.01, "stiffness": 10.0, "slack": slack}
    found = solve(beam("reissner3", 2), [load, {"type": "force", "at": "a@1", "value": [1e-3, 0]}], "linear_static")
    assert any("tendon's pretension" in w for w in found.state.warnings) == said


def test_an_elastic_tendon_stiffens_modes_like_a_spring() -> None:
    tendon = {"type": "tendon", "through": ["a@1", [L, 1.5]], "stiffness": 1e4, "slack": 0.0}
    spring = {"type": "translational", "between": ["a@1", [L, 1.5]], "stiffness": 1e4 / 1.5}
    for more in ({}, {"about": "static"}):
        eigen = {"type": "eigen", "modes": 3, **more}
        found, expected = (s.state.report["frequencies"] for s in (
            solve(beam(count=6), [tendon], eigen), solve(beam(count=6), [], eigen, springs=[spring])))
        assert [f["omega"] for f in found] == pytest.approx([f["omega"] for f in expected], rel=1e-9)


def test_a_column_buckles_under_a_tendon_to_its_base_but_not_under_one_along_its_axis() -> None:
    """A force that points to the base: pi^2 EI/L^2 (Timoshenko & Gere 1961), four times that of a dead one."""
    slender = {**beam("cable", 12), "section": {"height": 0.01, "width": B}}
    critical = np.pi**2 * E * B * 1e-6 / 12 / L**2
    solver = {"type": "buckling", "modes": 1}
    loads = [{"type": "tendon", "through": [[0, 0], "a@1"], "tension": 1.0}]
    found = solve(slender, loads, solver).state.report
    assert found["load_factors"][0] == pytest.approx(critical, rel=1e-4)


def test_impossible_tendons_are_refused() -> None:
    for load, said in (
            ({"tension": 1}, "either on or through"), ({"on": "a"}, "either tension or stiffness"),
            ({"on": "a", "tension": 1, "slack": 0.1}, "no unstretched length"),
            ({"on": "a", "tension": 1, "friction": 0.3}, "without friction"),
            ({"through": ["a@1"], "tension": 1}, "at least two eyelets"),
            ({"through": ["a@1", "a@1"], "tension": 1}, "are the same"),
            ({"through": ["a@1", {"at": "b@0", "y": 0.1}], "tension": 1}, "'b'"),
            ({"on": "b", "tension": 1}, "'b'")):
        with pytest.raises(CaseError) as caught:
            helpers.build({"a": beam()}, bc=CLAMP, loads=[{"type": "tendon", **load}])
        assert said in str(caught.value)
    rigid = {"geometry": beam()["geometry"], "element": {"type": "rigid", "mass": 1, "inertia": 1}}
    with pytest.raises(CaseError, match="a is rigid: a tendon along it has no effect"):
        helpers.build({"a": rigid}, bc=CLAMP, loads=[{"type": "tendon", "on": "a", "tension": 1}])
    with pytest.raises(CaseError, match="can guide a tendon off its axis only with given tension"):
        helpers.build({"a": beam("cable")}, bc=CLAMP,
                      loads=[{"type": "tendon", "on": "a", "y": 0.01, "stiffness": 1e3}])


def test_too_many_elements_along_an_elastic_tendon_are_refused() -> None:
    load = {"type": "tendon", "on": "a", "y": 0.01, "stiffness": 1e3, "slack": -1e-3}
    assert solve(beam(count=42), [load], "linear_static").theta("a@1") > 0
    with pytest.raises(CaseError, match="43 elements are too many") as error:
        solve(beam(count=43), [load], "linear_static")
    assert error.value.problems[0].expected == "at most 42"


INPUTS: dict[str, dict[str, Any]] = {
    "given": {"on": "a", "y": "0.04*(1 - 0.5*s)", "to": 0.8, "tension": 30.0},
    "wound": {"on": "a", "y": "0.04*(1 - 0.5*s)", "stiffness": 3e4, "slack": -0.02},
    "laced": {"through": [[0.0, -0.3], {"at": "a@0.5", "y": -0.06}, "a@1"], "stiffness": 3e4, "slack": 0.01}}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), [("wound", "reissner3"), ("laced", "reissner3"), ("given", "vallejo")])
def test_tendons_as_inputs_are_derivatives_of_statics(name: str, kind: str) -> None:
    """At frequency 0, about a loaded state: motions, N, Q and M against differences of equilibria; tension or slack."""
    load = {"type": "tendon", "name": "t", **INPUTS[name]}
    # other tendons, and what pulls at them all, act in the state
    others = [{"type": "tendon", **one} for other, one in INPUTS.items() if other != name]
    push = {"type": "force", "at": "a@1", "value": [300.0, -5.0]}
    scene: dict[str, Any] = {"bodies": {"a": beam(kind, 3)}, "boundary_conditions": CLAMP, "output": {
        "probes": {"p": "a@0.43", "q": "a@0.9"}, "fields": ["N", "Q", "M"]}}
    response = ancf2d.solve({**scene, "loads": [load, *others, push], "solver": {
        "type": "frequency_response", "frequencies": [0], "inputs": ["t"], "about": "static"}},
                            states=False).summary["response"]["t"]
    ends, h = [], 0.01
    for share in (h, 0.0, -h):
        loads = [{**load, "amplitude": {"type": "ramp", "scale": share}}, *others, push]
        ends.append(ancf2d.solve({**scene, "loads": loads, "solver": {"type": "static", "steps": 3}},
                                 states=False).summary["probes"])
    for probe, found in response.items():
        for q in ("ux", "uy", "theta", "N", "Q", "M"):
            plus, middle, minus = (end[probe][q] for end in ends)
            slope, bend = (plus - minus) / (2 * h), abs(plus - 2 * middle + minus) / h
            assert found[q]["re"][0] == pytest.approx(slope, rel=3e-4, abs=0.05 * bend), (probe, q)
