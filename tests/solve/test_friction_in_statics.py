"""Friction with obstacles along a path of loads, or over time: sticking, sliding, and refusals."""

from __future__ import annotations

import math
from collections.abc import Callable

import helpers
import numpy as np
import pytest
from helpers import section_forces
from scipy.integrate import quad
from scipy.optimize import brentq
from test_contact_statics import CLAMP, STIFF, fields_of, strip

from ancf2d.case import Point
from ancf2d.elements.contact_geometry import FRICTION, SLIP_STATUS, STATUS, STICK, STICKS
from ancf2d.errors import CaseError
from ancf2d.solvers.active_set import PENETRATION, overlap
from ancf2d.solvers.contact import contact_report
from ancf2d.solvers.registry import solve
from ancf2d.solvers.statics.quasi_static import Course


def test_friction_holds_a_strip_on_the_floor_up_to_its_limit() -> None:
    """It slides until a spring bears the load above Coulomb's limit."""
    bodies = {"beam": helpers.body(helpers.line(1.0), helpers.element("reissner3", 4), {**STIFF, "EA": 1e4})}
    weight = {"type": "table", "t": [0, 0.2], "value": [0, 1]}
    pull = {"type": "table", "t": [0.2, 1], "value": [0, 1]}
    law = {"stiffness": 1e5}
    solution = helpers.Solution(helpers.build(
        bodies, contacts=[{"between": ["beam", "floor"], "side": "axis", "friction": 0.3, "law": law}],
        obstacles={"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}},
        springs=[{"type": "translational", "between": ["beam@1", [2, 0]], "stiffness": 100},
                 # what nothing holds before the strip lies on the floor
                 {"type": "translational", "between": ["beam@0.5", [0.5, 1]], "stiffness": 1e-3}],
        loads=[{"type": "gravity", "value": [0, -10], "amplitude": weight},
               {"type": "force", "at": "beam@1", "value": [-4, 0], "amplitude": pull}]))
    (report,) = contact_report(solution.model, solution.state)
    np.testing.assert_allclose(report["force"], [0.3 * 10.0, 10.0], rtol=1e-4)
    assert solution.u("beam@1")[0] == pytest.approx(-(4.0 - 3.0) / 100.0, rel=1e-3)
    # section forces beside a layer, which has no ends that they would know of; to half of what the last element rubs
    N, _, _ = section_forces(solution.model, solution.state, solution.model.point(Point("beam", 1.0)))
    assert pytest.approx(-3.0, abs=0.5 * 3.0 * 0.25) == N


@pytest.mark.slow_rows("solver1")
@pytest.mark.parametrize("solver", ["static", {"type": "quasi_static", "t_end": 1, "tolerance": 1e-3}])
def test_friction_without_a_law_holds_up_to_its_limit_and_along_the_path(solver) -> None:
    """A heavy strip is pushed over the floor and back: a spring bears the load above Coulomb's limit, either way."""
    bodies = {"beam": helpers.body(helpers.line(1.0), helpers.element("reissner3", 4), {**STIFF, "EA": 1e4})}
    weight = {"type": "table", "t": [0, 0.2], "value": [0, 1]}
    push = {"type": "table", "t": [0.2, 0.6, 1], "value": [0, 1, -1]}
    model = helpers.build(
        bodies, solver, contacts=[{"between": ["beam", "floor"], "side": "axis", "friction": 0.3}],
        obstacles={"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}},
        springs=[{"type": "translational", "between": ["beam@1", [2, 0]], "stiffness": 100}],
        loads=[{"type": "gravity", "value": [0, -10], "amplitude": weight},
               {"type": "force", "at": "beam@1", "value": [-4, 0], "amplitude": push}])
    coords, weights = helpers.point_ref(model.meshes["beam"], 1.0).position()[0]
    for state in solve(model):
        (report,) = contact_report(model, state)
        u = float(weights @ state.d[coords])
        assert report["force"][1] == pytest.approx(10.0 * min(state.t / 0.2, 1.0), rel=1e-9)
        assert abs(report["force"][0]) <= 0.3 * 10.0 * (1.0 + 1e-8)
        # sideways, what acts is in balance
        acts = 0.0 if state.t < 0.2 else -4.0 * (1.0 - abs(state.t - 0.6) / 0.2 if state.t > 0.6 else
                                                  (state.t - 0.2) / 0.4)
        assert report["force"][0] == pytest.approx(100.0 * u - acts, abs=1e-8)
        if state.t == pytest.approx(0.6):
            assert u == pytest.approx(-0.01, rel=1e-6)
        if 0.6 < state.t < 0.9 + 1e-9:
            # sticks on the way back, but for its own strain
            assert -0.01 < u < -0.0095
        elif state.t > 0.9:
            assert u == pytest.approx(0.01 * (acts - 3.0), rel=1e-6)
    assert u == pytest.approx(0.01, rel=1e-6)
    _, sums = fields_of(model, state)
    np.testing.assert_allclose([sums["pressure"][0], sums["traction"][0]], [10.0, report["force"][0]], rtol=1e-8)


def test_a_rejected_step_over_time_leaves_no_trace() -> None:
    """Neither in the anchors of friction nor in the memory of the material: a creeping strip slides on a floor."""
    model = helpers.build(
        {"beam": helpers.body(helpers.line(1.0), helpers.element("reissner3", 4), {"height": 0.05, "width": 0.05},
                              {"E": 1e6, "nu": 0.3, "rho": 400.0, "viscoelastic": [{"modulus": 0.5, "time": 0.2}]})},
        {"type": "quasi_static", "t_end": 1.0, "tolerance": 1e-3}, bc=[CLAMP],
        contacts=[{"between": ["beam", "floor"], "side": "axis", "friction": 0.3}],
        obstacles={"floor": {"type": "half_plane", "through": [0, -1e-3], "normal": [0, 1]}},
        loads=[{"type": "gravity", "value": [0, -10]},
               {"type": "force", "at": "beam@1", "value": [20, 0], "amplitude": {"type": "ramp", "t1": 1.0}}])
    course = Course(model, model.case.solver)
    states = course.states()
    while course.t < 0.05:
        next(states)
    kept, before = course._keep(), course.checkpoint()
    halves, whole = course._tried(0.02)
    assert whole is not None
    assert course._error(whole, halves, 1e-3) > 0.0
    tried = course.checkpoint()
    assert {name.split("/")[0] for name in before if not np.array_equal(before[name], tried[name])} >= {
        "contact", "states", "accepted"}
    course._restore(kept)
    for name, found in course.checkpoint().items():
        np.testing.assert_array_equal(found, before[name], err_msg=name)


def block_on_incline(kind: str, mu: float, metre: float = 1.0, mass: float = 1.0):
    """Return a solved block of 8 kg on a slope of 0.3 rad, on a spring of 100 N/m, in units of so many m and kg."""
    slope, size = 0.3, 9.81 / metre
    block = {"geometry": helpers.line(0.4 / metre, start=(0, 0.1 / metre)), "element": {"type": kind, "count": 2},
             "section": {"height": 0.2 / metre, "width": 0.1 / metre},
             "material": {"E": 1e8 * metre / mass, "nu": 0.3, "rho": 1000 * metre**3 / mass}}
    if kind == "rigid":
        block["element"] = {"type": "rigid"}
    return helpers.Solution(helpers.build(
        {"block": block}, contacts=[{"between": ["block", "slope"], "friction": mu}],
        obstacles={"slope": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}},
        springs=[{"type": "translational", "between": ["block@0", [-1 / metre, 0.1 / metre]], "stiffness": 100 / mass}],
        loads=[{"type": "gravity", "value": [size * math.sin(slope), -size * math.cos(slope)]}]))


WEIGHT_DOWN, WEIGHT_ALONG = 8.0 * 9.81 * math.cos(0.3), 8.0 * 9.81 * math.sin(0.3)


@pytest.mark.parametrize(("kind", "mu"), [("rigid", 0.5), ("reissner3", 0.5), ("reissner3", 0.2)])
def test_a_block_on_an_incline_sticks_or_slides(kind: str, mu: float) -> None:
    """It slides on a slope above the friction angle, until a spring bears the rest."""
    solution, k = block_on_incline(kind, mu), 100.0
    (report,) = contact_report(solution.model, solution.state)
    held = min(mu * WEIGHT_DOWN, WEIGHT_ALONG)
    assert report["force"] == pytest.approx([-held, WEIGHT_DOWN], rel=1e-4)
    assert solution.u("block@0")[0] == pytest.approx((WEIGHT_ALONG - held) / k, rel=1e-4, abs=1e-5)


@pytest.mark.parametrize("mu", [0.2, 0.5])
def test_the_friction_of_a_rigid_block_scales_with_units_and_forces(mu: float) -> None:
    """In m/kg/N and mm/t/N, and with weights of 1e-6 N and 1e9 N, it is in the same state."""
    share, places = min(mu * WEIGHT_DOWN, WEIGHT_ALONG), []
    # units of length [m] and mass [kg]
    for metre, mass in ((1.0, 1.0), (1e-3, 1e3), (1.0, 78.48e6), (1.0, 78.48e-9)):
        solution = block_on_incline("rigid", mu, metre, mass)
        (report,) = contact_report(solution.model, solution.state)
        np.testing.assert_allclose(np.array(report["force"]) * mass * metre, [-share, WEIGHT_DOWN], rtol=1e-5)
        places.append(solution.u("block@0") * metre)
    np.testing.assert_allclose(places, [places[0]] * len(places), rtol=1e-6, atol=2e-7)
    slipped = (WEIGHT_ALONG - share) / 100.0
    np.testing.assert_allclose(places[0], [slipped, 0.0], rtol=1e-6, atol=2e-6)


def test_friction_without_a_law_is_refused_without_a_path_of_loads() -> None:
    for solver in ({"type": "eigen", "modes": 1}, {"type": "static", "method": "arc_length",
                                                   "until": {"load_factor": 1}}):
        with pytest.raises(CaseError, match="without a contact law, friction"):
            strip(4, 0.2, bc=[CLAMP], obstacles={"solid": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}},
                  solver=solver)


@pytest.mark.parametrize(("kind", "count"), [("cable", 20), pytest.param("reissner3", 40, marks=pytest.mark.slow)])
def test_a_belt_that_starts_inside_its_drum_slips_at_the_ratio_of_euler_and_eytelwein(kind: str, count: int) -> None:
    """The drum is larger than the belt by 1e-6 m: gaps of the first state are closed at once, not kept and released."""
    drum = {"type": "table", "t": [0, 0.2, 1], "value": [0, 0, -0.4]}
    model = helpers.build(
        {"belt": {"geometry": {"type": "path", "start": [-0.05, -0.1], "heading": math.pi / 2,
                               "pieces": [{"line": 0.1}, {"arc": 0.05, "angle": -math.pi}, {"line": 0.1}]},
                  "section": {"height": 0.001, "width": 0.02}, "material": {"E": 1e8, "nu": 0.4},
                  "element": {"type": kind, "count": count}}},
        {"type": "static", "steps": 20},
        bc=[{"type": "pin", "at": "belt@0"}, {"type": "roller", "at": "belt@1", "fixed": "x"}],
        contacts=[{"between": ["belt", "drum"], "side": "axis", "friction": 0.3}],
        obstacles={"drum": {"type": "circle", "center": [0, 0], "radius": 0.050001, "motion": {"angle": drum}}},
        loads=[{"type": "force", "at": "belt@1", "value": [0, -10],
                "amplitude": {"type": "table", "t": [0, 0.2], "value": [0, 1]}}])
    solution = helpers.Solution(model)
    (report,) = contact_report(solution.model, solution.state)
    assert report["force"][1] == pytest.approx(10.0 * (1.0 + math.exp(0.3 * math.pi)), rel=1e-2)


def _obeys_coulomb(model, before, state) -> None:
    """Check that points without a law only press, no body penetrates, and friction obeys Coulomb's law."""
    assert overlap(model, state.d, state.t) <= 2.0 * PENETRATION * model.extent
    for one in model.contact_tables:
        held = [k for k, point in enumerate(one.points) if point.mem[STATUS] > 0.0]
        was, now = one.gaps_and_places(before.d, before.t)[1], one.gaps_and_places(state.d, state.t)[1]
        force = np.array([-state.d[one.points[k].multiplier] for k in held])
        assert np.all(force >= -1e-8 * np.abs(force).max(initial=0.0))
        for k, N in zip(held, force, strict=True):
            point = one.points[k]
            if point.mem[SLIP_STATUS] == STICKS:
                T = point.par[STICK] * one.slip(k, now[k], one.anchor(k))
                assert abs(T) <= point.par[FRICTION] * N + 1e-8 * force.max()
            else:
                assert one.slip(k, now[k], was[k]) * point.mem[SLIP_STATUS] <= 1e-12 * model.extent


def ring(kind: str, friction: float, ends: str, pressed: float, count: int = 24, steps: int = 3,
         above: float | None = None):
    """Return a ring between plates, of which the upper one moves down by a share of its radius.

    Their friction is the same, unless that ``above`` is given.
    """
    R = 0.1
    below, above = ({"friction": mu, "side": "axis"} for mu in (friction, friction if above is None else above))
    return helpers.build(
        {"ring": helpers.body(
            {"type": "arc", "center": [0, R], "radius": R, "from": -0.5 * math.pi, "to": 1.5 * math.pi},
            helpers.element(kind, count), {"height": 0.002, "width": 0.02}, {"E": 2e9, "nu": 0.3})},
        {"type": "static", "steps": steps},
        contacts=[{"between": ["ring", "floor"], **below}, {"between": ["ring", "plate"], **above}],
        obstacles={"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]},
                   "plate": {"type": "half_plane", "through": [0, 2 * R], "normal": [0, -1],
                             "motion": {"y": {"type": "ramp", "scale": -pressed * R}}}},
        boundary_conditions=[{"at": f"ring@{s}", "type": "fix", "coordinates": ["x"]}
                             for s in {"held": [0], "held twice": [0, 0.5]}.get(ends, [])],
        joints=[{"type": "weld", "between": ["ring@0", "ring@1"]}] if ends == "welded" else [])


@pytest.mark.parametrize(("kind", "friction", "ends"), [
    ("cable", 0.3, "held"), *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        ("reissner3", 0.3, "held"), ("vallejo", 0.05, "held"), ("cable", 1.0, "welded"),
        ("reissner3", 0.3, "welded"), ("reissner3", 0.3, "free")))])
def test_a_ring_that_is_pressed_flat_between_rough_plates_obeys_coulomb(kind: str, friction: float, ends: str) -> None:
    """With one end fixed, both welded, or held by friction: it rolls out on plates, and slides here and there.

    A force on an open point pulls it into a plate where friction goes on in one direction.
    """
    model = ring(kind, friction, ends, 0.21)
    before = None
    for state in solve(model):
        if before is not None:
            _obeys_coulomb(model, before, state)
        before = state
    (below, above) = contact_report(model, state)
    assert below["force"][1] == pytest.approx(-above["force"][1], rel=1e-6)
    assert below["force"][1] > 0.1


def test_a_ring_between_a_rough_and_a_smooth_plate_obeys_coulomb() -> None:
    model = ring("cable", 0.3, "held twice", 0.21, above=0.0)
    first, *_, state = solve(model)
    _obeys_coulomb(model, first, state)
    below, above = contact_report(model, state)
    assert below["force"][1] == pytest.approx(-above["force"][1], rel=1e-6)
    assert below["force"][1] > 0.1
    assert above["force"][0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_a_rough_ring_pressed_to_half_its_height_bears_the_force_of_an_elastica() -> None:
    """Of an inextensible quarter that lies flat up to a = pi R/2 - l and is free beyond: EI k^2/2 = V sin(theta)."""
    EI, half, R = 2e9 * 0.02 * 0.002**3 / 12.0, 0.05, 0.1

    def along(V: float, share: Callable[[float], float]) -> float:
        """Return the integral of share(theta)/k dtheta up to the vertical, by theta = q^2."""
        return float(quad(lambda q: 2.0 * q * share(q * q) / math.sqrt(2.0 * V / EI * math.sin(q * q)), 1e-12,
                          math.sqrt(0.5 * math.pi))[0])

    V = float(brentq(lambda V: along(V, math.sin) - half, 1e-2, 1e2))
    wide = 0.5 * math.pi * R - along(V, lambda theta: 1.0) + along(V, math.cos)
    model = ring("cable", 0.3, "welded", 1.0, count=48, steps=20)
    *_, state = solve(model)
    below, above = contact_report(model, state)
    assert below["force"][1] == pytest.approx(2.0 * V, rel=1e-3)
    assert above["force"][1] == pytest.approx(-2.0 * V, rel=1e-3)
    coords, weights = helpers.point_ref(model.meshes["ring"], 0.25).position()[0]
    assert R + float(weights @ state.d[coords]) == pytest.approx(wide, rel=3e-4)


@pytest.mark.parametrize("name", helpers.chosen(["cable", "reissner3", "vallejo"], ["cable"]))
def test_a_rod_bent_over_a_rough_drum_depends_on_neither_load_steps_nor_mesh(name: str) -> None:
    """It touches at one point, which moves along it as it rolls on and slides: its friction is that of sliding.

    Where the place stood still for a while, or two points bore the force in turn, the force along would be 11 % off
    with 160 steps, and 2 % with 10.
    """
    found = []
    for count, steps in ((8, 10), (8, 80), (16, 10)):
        body = {"geometry": helpers.line(1.0), "element": helpers.element(name, count),
                "section": {"height": 0.02, "width": 0.03}, "material": {"E": 7e9, "nu": 0.3, "rho": 2700}}
        solution = helpers.solved(
            {"beam": body}, {"type": "static", "steps": steps},
            bc=[{"type": "clamp", "at": "beam@0"}, {"type": "prescribed", "at": "beam@1", "uy": -0.1}],
            obstacles={"drum": {"type": "circle", "center": [0.5, -0.5], "radius": 0.5}},
            contacts=[{"between": ["beam", "drum"], "side": "axis", "friction": 0.3}])
        (report,) = contact_report(solution.model, solution.state)
        x = (report["from"] - 0.5) / 0.5
        assert report["from"] == report["to"]
        found.append(report["force"])
        # the normal leans as the place is beside the top of the drum, the friction pulls across it: tan phi = 0.3
        lean = math.atan2(*report["force"])
        assert lean == pytest.approx(math.asin(x) + math.atan(0.3), abs=5e-3)
    assert found[1] == pytest.approx(found[0], rel=1e-4)
    assert found[2] == pytest.approx(found[0], rel=1e-3)
