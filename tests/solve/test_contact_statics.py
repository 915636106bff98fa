"""Statics with obstacles, compared with closed forms and shooting solutions."""

from __future__ import annotations

import math
import re
from pathlib import Path

import helpers
import numpy as np
import pytest
from instruments.references import contacts as reference
from instruments.references.statics import Beam

import ancf2d
from ancf2d.case import template
from ancf2d.errors import CaseError
from ancf2d.results import open_results
from ancf2d.results.obstacles import obstacles_of
from ancf2d.solvers.complementarity import lemke, lemke_from
from ancf2d.solvers.contact import contact_report, obstacle_reactions, touches
from ancf2d.solvers.fields import FieldReader
from ancf2d.solvers.registry import solve
from ancf2d.solvers.state_results import reactions
from ancf2d.solvers.statics import path
from ancf2d.study.run import run_case

STIFF = {"EA": 1e6, "EI": 1.0, "kGA": 1e6, "rhoA": 1.0, "rhoI": 1e-6}
CLAMP = {"name": "wall", "type": "clamp", "at": "beam@0"}


def strip(count, friction=0.0, solver="static", law=None, **scene):
    """Return the model of a thin strip from 0 to 1 along x with contact of its axis."""
    bodies = {"beam": helpers.body(helpers.line(1.0), helpers.element("cable", count), STIFF)}
    touch = {"name": "touch", "between": ["beam", "solid"], "side": "axis", "friction": friction}
    touch |= {"law": law} if law else {}
    return helpers.build(bodies, solver, contacts=[touch], **scene)


def check_balance(solution, dead):
    """Check that supports, obstacles and dead loads are in balance, and that no body penetrates."""
    model, state = solution.model, solution.state
    held = reactions(model, state)
    total = np.sum([[r["fx"], r["fy"]] for r in held.values()], axis=0)
    np.testing.assert_allclose(total, -np.asarray(dead), atol=1e-7 * max(1.0, np.abs(dead).max()))
    for touch in touches(model, state):
        assert np.nanmin(touch.gap) > -1e-8
        # the obstacle pushes
        assert (touch.force[touch.closed] @ np.array([0.0, 1.0]) > 0.0).all()


def fields_of(model, state, body="beam"):
    """Return the fields of contact along a body by name (ne, nx, faces), and the integral of each (faces,)."""
    names = ("pressure", "traction", "gap")
    reader = FieldReader(model, names)
    (at,) = [one for one in reader.bodies if one.body == body]
    found = {name: values[..., 0] for (owner, name), values in reader.read(state).items() if owner == body}
    lengths = model.meshes[body].lengths[:, None]
    return found, {k: (np.trapezoid(v, at.xi, axis=1) * lengths).sum(axis=0) for k, v in found.items()}


@pytest.mark.parametrize(("y", "heading", "first"), [(-0.5, 0.0, 0), (0.5, math.pi, 12)], ids=["at it", "across"])
def test_pressure_on_a_ring_does_not_depend_on_where_its_axis_closes(y: float, heading: float, first: int) -> None:
    """It carries the weight of the ring and is symmetric where the ring lies on the floor."""
    R, rho, h, w = 0.5, 1000.0, 0.02, 0.05
    path = {"type": "path", "start": [0, y], "heading": heading, "closed": True,
            "pieces": [{"arc": R, "angle": math.pi}, {"arc": R, "angle": math.pi}]}
    ring = {"geometry": path, "section": {"height": h, "width": w}, "material": {"E": 1e8, "nu": 0.3, "rho": rho},
            "element": {"type": "reissner3", "count": 24}}
    solution = helpers.solved(
        {"ring": ring}, "static", loads=[{"type": "gravity", "value": [0, -9.81]}],
        bc=[{"type": "roller", "at": f"ring@{s}", "fixed": "x"} for s in (0, 0.5)],
        obstacles={"floor": {"type": "half_plane", "through": [0, -R - 0.5 * h], "normal": [0, 1]}},
        contacts=[{"between": ["ring", "floor"], "law": {"stiffness": 1e6}}])
    fields, total = fields_of(solution.model, solution.state, "ring")
    assert total["pressure"] == pytest.approx([rho * h * w * 2 * math.pi * R * 9.81, 0.0], rel=1e-4)
    lower = fields["pressure"][:, :, 0]
    assert lower[first, 0] > 400.0
    np.testing.assert_allclose(lower[first], lower[first - 1, ::-1], rtol=1e-6)


def test_a_strip_wraps_around_a_drum() -> None:
    """It lies on the drum up to the lift-off, where a concentrated force acts."""
    exact = reference.strip_on_drum(1.0, 1.0, 2.0, 0.9)
    solution = helpers.Solution(strip(
        16, bc=[CLAMP], loads=[{"type": "force", "at": "beam@1", "value": [0, -0.9]}],
        obstacles={"solid": {"type": "circle", "center": [0, -2], "radius": 2}}))
    np.testing.assert_allclose(solution.r("beam@1"), exact.tip, rtol=1e-4)
    check_balance(solution, [0, -0.9])
    (report,) = contact_report(solution.model, solution.state)
    assert report["to"] == pytest.approx(2.0 * exact.angle, abs=2e-3)
    # without friction all forces go through the centre of the drum
    assert obstacle_reactions(solution.model, solution.state)["solid"]["m"] == pytest.approx(0.0, abs=1e-9)
    fx, fy = report["force"]
    assert report["moment"] == pytest.approx(2.0 * fx, abs=1e-9)
    assert fy == pytest.approx(0.9, rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_strip_whose_clamped_face_touches_the_drum_wraps_around_it(friction: float) -> None:
    """The corner at the clamp touches and cannot move; the axis bends around a drum larger by half a height."""
    exact = reference.strip_on_drum(2e9 * 0.05 * 0.01**3 / 12.0, 1.0, 0.505, 60.0)
    body = helpers.body(helpers.line(1.0), helpers.element("cable", 20), {"height": 0.01, "width": 0.05})
    solution = helpers.Solution(helpers.build(
        {"beam": {**body, "material": {"E": 2e9, "nu": 0.3}}}, {"type": "static", "steps": 10}, bc=[CLAMP],
        loads=[{"type": "force", "at": "beam@1", "value": [0, -60]}],
        obstacles={"drum": {"type": "circle", "center": [0, -0.505], "radius": 0.5}},
        contacts=[{"name": "grip", "between": ["beam", "drum"], "friction": friction}]))
    np.testing.assert_allclose(solution.r("beam@1"), exact.tip, rtol=5e-4)
    check_balance(solution, [0, -60])


def test_the_zone_of_a_law_is_the_length_in_contact() -> None:
    """A rod pressed flat on a floor touches from end to end; an upright one touches only with its end."""
    law = {"stiffness": 1e5}
    for end, zone in (([1, 0], (0.0, 1.0)), ([0, 1], (0.0, 0.0))):
        rod = {"geometry": {"type": "line", "start": [0, 0.05], "end": [end[0], end[1] + 0.05]},
               "section": {"height": 0.1, "width": 0.1}, "material": {"E": 1e7, "nu": 0.3, "rho": 1000},
               "element": {"type": "reissner3", "count": 4}}
        solution = helpers.Solution(helpers.build(
            {"rod": rod}, {"type": "static"}, loads=[{"type": "gravity", "value": [0, -10]}],
            bc=[{"type": "roller", "at": f"rod@{s}", "fixed": "x"} for s in ([0.5] if end[0] else [0.5, 1])],
            obstacles={"floor": {"type": "half_plane", "through": [0, 0 if end[0] else 0.049], "normal": [0, 1]}},
            contacts=[{"between": ["rod", "floor"], "law": law}]))
        (report,) = contact_report(solution.model, solution.state)
        assert (report["from"], report["to"]) == pytest.approx(zone, abs=1e-12)
        assert report["length"] == pytest.approx(zone[1] - zone[0], abs=1e-12)
        assert report["force"] == pytest.approx([0.0, 100.0], abs=1e-6)


def test_a_strip_touches_a_drum_at_a_point() -> None:
    """A point that is no node, by shooting."""
    center, radius, force = (0.6, -0.3), 0.28, 6.0
    found, s, pressed = reference.strip_at_drum(Beam(1e6, math.inf, 1.0), 1.0, center, radius, force, (-0.5, 0.7, 1.57))
    solution = helpers.Solution(strip(
        32, bc=[CLAMP], loads=[{"type": "force", "at": "beam@1", "value": [0, -force]}],
        obstacles={"solid": {"type": "circle", "center": list(center), "radius": radius}}))
    np.testing.assert_allclose(solution.r("beam@1"), found[:2], rtol=1e-4)
    (report,) = contact_report(solution.model, solution.state)
    assert report["from"] == pytest.approx(s, rel=1e-3)
    assert np.hypot(*report["force"]) == pytest.approx(pressed, rel=1e-3)


@pytest.mark.slow
def test_a_ring_is_pressed_flat_between_plates() -> None:
    """From point contact through flattening, by an elastica; half a ring, between its lines of symmetry."""
    half = {"type": "arc", "center": [0, 1], "radius": 1.0, "from": -math.pi / 2, "to": math.pi / 2}
    ends = [{"type": "prescribed", "at": f"beam@{s}", "ux": 0, "angle": 0} for s in (0, 1)]
    plates = {"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]},
              "lid": {"type": "half_plane", "through": [0, 2], "normal": [0, -1],
                      "motion": {"y": {"type": "ramp", "scale": -1.0}}}}
    model = helpers.build(
        {"beam": helpers.body(half, helpers.element("cable", 40), STIFF)}, bc=ends, obstacles=plates,
        contacts=[{"between": ["beam", name], "side": "axis"} for name in plates])
    for state in solve(model):
        below, above = contact_report(model, state)
        force = 2.0 * below["force"][1]
        assert force == pytest.approx(-2.0 * above["force"][1], rel=1e-8)
        height, _ = reference.ring_between_plates(1.0, 1.0, force)
        assert height == pytest.approx(2.0 - state.t, rel=5e-4)
        assert state.history["iterations"] < 40


def test_a_cam_lifts_and_releases_a_leaf_spring() -> None:
    """An eccentric disc under a thin cantilever: its tip by beam theory during contact, and zero afterwards."""
    eccentricity, arm, gap, EI = 0.01, 0.6, 0.004, 1.0
    turn = {"angle": {"type": "ramp", "scale": 2.0 * math.pi}, "about": [arm, -0.1 - gap]}
    model = strip(10, bc=[CLAMP], solver={"type": "static", "steps": 12}, obstacles={
        "solid": {"type": "circle", "center": [arm, -0.1 - gap - eccentricity], "radius": 0.1, "motion": turn}})
    lifted = 0
    for state in solve(model):
        angle = 2.0 * math.pi * state.t
        # of the disc's highest point, to first order in the slope
        height = -eccentricity * math.cos(angle) - gap
        at = arm + eccentricity * math.sin(angle)
        (report,) = contact_report(model, state)
        assert state.history["iterations"] < 40
        if height <= 0.0:
            assert report["length"] == 0.0
            assert np.abs(state.d[:model.n_q]).max() < 1e-12
            continue
        lifted += 1
        # the spring leans over the disc: by slope 3 height/2 arm it touches that much further in
        slope = 1.5 * height / at
        touch, rise = at - 0.1 * slope, height - 0.5 * 0.1 * slope**2
        assert report["force"][1] == pytest.approx(3.0 * EI * rise / touch**3, rel=5e-3)
    assert lifted >= 4


@pytest.mark.slow_rows("-0.4-0.3")
@pytest.mark.parametrize(("turn", "mu"), [(-0.4, 0.3), (0.4, 0.3), pytest.param(-0.4, 0.0, marks=pytest.mark.slow)])
def test_a_belt_slips_on_a_drum_at_the_ratio_of_euler_and_eytelwein(turn: float, mu: float) -> None:
    """T2/T1 = exp(mu phi) over half a turn, either way; the template, whose drum turns until the whole belt slips."""
    solution = ancf2d.solve(template("capstan", "belt"), [
        f"obstacles.drum.motion.angle.value=[0, 0, {turn}]", f"contacts.0.friction={mu}"], states=False)
    pulled = 10.0 * math.exp(math.copysign(mu, -turn) * math.pi)
    # within what the bending stiffness of the belt bears, EI/R^2 = 0.07 N beside 10 N
    assert solution.reactions["anchor"]["fy"] == pytest.approx(-pulled, rel=4e-3)
    assert solution.reactions["drum"]["fy"] == pytest.approx(pulled + 10.0, rel=4e-3)
    assert solution.reactions["drum"]["m"] == pytest.approx(0.05 * (10.0 - pulled), rel=1e-2, abs=1e-9)


@pytest.mark.slow
def test_a_belt_without_a_law_slips_at_the_same_ratio() -> None:
    """A thin belt that starts slack, 5e-6 off the drum; its bending stiffness bears EI/R^2 = 0.003 N of 10 N."""
    solution = ancf2d.solve(template("capstan", "belt"), [
        "contacts.0.law=null", "obstacles.drum.radius=0.049995", "bodies.belt.section.height=0.00035",
        "bodies.belt.element.type=cable", "bodies.belt.element.count=60", "boundary_conditions.0.type=clamp",
        "obstacles.drum.motion.angle.value=[0, 0, -0.4]"], states=False)
    pulled = 10.0 * math.exp(0.3 * math.pi)
    assert solution.reactions["anchor"]["fy"] == pytest.approx(-pulled, rel=5e-4)
    assert solution.reactions["drum"]["m"] == pytest.approx(0.05 * (10.0 - pulled), rel=4e-3)


def test_closed_points_solve_linear_complementarity_problems() -> None:
    """Also if M is singular, as for redundant points, or skew, as for closed against open ones.

    From a guess of what is closed, right or wrong, a regular problem has its solution, too.
    """
    rng = np.random.default_rng(3)
    for n in (1, 3, 8, 20):
        for rank in {1, max(n // 2, 1), n}:
            A = rng.standard_normal((n, rank))
            B = rng.standard_normal((n, n))
            M = A @ A.T / rank + (B - B.T) * (rank == n)
            # a solution is known to exist
            z0, w0 = rng.random(n) * (rng.random(n) < 0.5), rng.random(n)
            q = np.where(z0 > 0.0, 0.0, w0) - M @ z0
            for z in (lemke(M, q), *((lemke_from(M, q, z0 > 0.0), lemke_from(M, q, rng.random(n) < 0.3))
                                     if rank == n else ())):
                assert z is not None
                w = q + M @ z
                assert z.min() >= 0.0
                assert w.min() > -1e-9
                assert np.abs(w * z).max() < 1e-9
    assert lemke(np.array([[-1.0]]), np.array([-1.0])) is None
    assert lemke_from(np.zeros((1, 1)), np.array([-1.0]), np.array([True])) is None


@pytest.mark.parametrize("gap", [1e-5, 1e-4])
def test_the_edge_of_a_block_supports_a_strip(gap: float) -> None:
    """A beam clamped at 0 and supported at a (Roark, table 8.1, 1a): P (3 L - a)/2 a, less 3 EI/a^3 times the gap."""
    a, P = 0.88, 0.03
    block = {"solid": {"type": "polyline", "closed": True, "points": [
        [1.5, -0.3], [a, -gap], [a - 0.2, -gap], [a - 0.25, -0.5], [1.4, -0.8]]}}
    solution = helpers.Solution(strip(10, bc=[CLAMP], loads=[{"type": "force", "at": "beam@1", "value": [0, -P]}],
                                      obstacles=block))
    (report,) = contact_report(solution.model, solution.state)
    assert report["force"][1] == pytest.approx(P * (3.0 - a) / (2.0 * a) - 3.0 * gap / a**3, rel=3e-5)
    assert report["from"] == report["to"] == pytest.approx(a, abs=1e-5)


def test_a_file_has_the_positions_of_moving_obstacles(tmp_path: Path) -> None:
    """In every state: displaced, and rotated about its own centre; a probe of the same name does not hide it."""
    motion = {"y": {"type": "ramp", "scale": -0.1}, "angle": {"type": "ramp", "scale": 1.0}}
    scene = helpers.load(
        {"beam": helpers.body(helpers.line(1.0), helpers.element("cable", 4), STIFF)}, {"type": "static", "steps": 2},
        bc=[CLAMP], obstacles={"solid": {"type": "circle", "center": [0.9, 0.25], "radius": 0.2, "motion": motion}},
        contacts=[{"between": ["beam", "solid"], "side": "axis"}],
        output={"every": 2, "probes": {"solid": "beam@1"}})
    assert run_case(scene, str(tmp_path / "a.h5")).failure is None
    with open_results(tmp_path / "a.h5") as results:
        for state, factor in ((0, 0.0), (1, 1.0)):
            (drawn,) = obstacles_of(results, state, 1.0)
            np.testing.assert_allclose(drawn.solid[:-1].mean(axis=0), [0.9, 0.25 - 0.1 * factor], atol=1e-12)
            spoke = np.diff(drawn.lines[1], axis=0)[0]
            assert math.atan2(spoke[1], spoke[0]) == pytest.approx(factor, abs=1e-12)


@pytest.mark.parametrize(("push", "roots"), [(-0.5, (3.926602, 7.068583)), (0.5, (1.875104, 4.694091))])
def test_modes_about_a_state_keep_contacts_closed(push: float, roots: tuple[float, float]) -> None:
    """A cantilever pressed on a stop vibrates like one with a hinged end, otherwise like one with a free end.

    omega L^2 sqrt(rhoA/EI) = roots^2 (Blevins 1979, table 8-1); the free one is hardly bent.
    """
    model = strip(8, solver={"type": "eigen", "modes": 2, "about": "static"}, bc=[CLAMP],
                  loads=[{"type": "force", "at": "beam@1", "value": [0, 0.02 * push]}],
                  obstacles={"solid": {"type": "circle", "center": [1, -0.1], "radius": 0.1}})
    (state,) = solve(model)
    (report,) = contact_report(model, state)
    assert report["force"][1] == pytest.approx(max(-0.02 * push, 0.0), abs=1e-12)
    found = [row["omega"] for row in state.report["frequencies"]]
    np.testing.assert_allclose(found, np.square(roots), rtol=1e-3)


@pytest.mark.parametrize(("solid", "where"), [
    ({"type": "circle", "center": [0.5, -0.2], "radius": 0.3}, "by up to 0.1 at S = 0.5; expected beam outside solid,"),
    ({"type": "half_plane", "through": [0, 0.1], "normal": [0, 1]}, "the side of solid that its normal points to, or"),
    ({"type": "half_plane", "through": [0, 1e-7], "normal": [0, 1]}, "expected a small gap between them, or a law"),
    ({"type": "polyline", "points": [[2, -0.1], [-1, -0.1]]}, "to the left of solid, from its first point to its")])
def test_initial_overlaps_with_obstacles_are_reported_with_position_and_depth(solid, where) -> None:
    with pytest.raises(CaseError, match=re.escape(where)):
        strip(4, bc=[CLAMP], obstacles={"solid": solid})


def test_a_run_reports_only_the_worst_state_of_obstacles_between_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """The further the cantilever is pressed, the deeper it is."""
    monkeypatch.setattr(path, "overlap", lambda model, d, t: 1e-3 * t)
    arc = {"type": "static", "method": "arc_length", "steps": 200, "until": {"load_factor": 1}}
    model = strip(8, solver=arc, bc=[CLAMP], loads=[{"type": "force", "at": "beam@0.5", "value": [0, -2]}],
                  obstacles={"solid": {"type": "circle", "center": [1, -0.1], "radius": 0.1}})
    told = [w for state in solve(model) for w in state.warnings]
    assert len(told) > 1
    outcome = run_case(model.loaded, None)
    assert outcome.warnings == [max(told, key=lambda w: w.size)]


@pytest.mark.parametrize("stop", [0.03, pytest.param(0.055, marks=pytest.mark.slow)])
def test_a_path_turns_back_where_a_snapping_truss_meets_a_stop_below_its_load(stop: float) -> None:
    """The stop carries what the load exceeds the force that holds the truss at this height.

    The load factor falls until the truss meets the stop, and rises again while the truss rests on it.
    """
    EA, h, P = 1e6, 0.1, 1000.0
    bodies = {name: helpers.body({"type": "line", "start": [x, 0], "end": [0, h]}, helpers.element("cable", 2),
                                 {"EA": EA, "EI": 1e3}) for name, x in (("left", -1), ("right", 1))}
    solution = helpers.Solution(helpers.build(
        bodies, {"type": "static", "method": "arc_length", "steps": 300, "until": {"load_factor": 1}},
        bc=[{"type": "pin", "at": "left@0"}, {"type": "pin", "at": "right@0"}],
        joints=[{"type": "pin", "between": ["left@1", "right@1"]}],
        loads=[{"type": "force", "at": "left@1", "value": [0, -P]}],
        obstacles={"floor": {"type": "half_plane", "through": [0, -stop], "normal": [0, 1]}},
        contacts=[{"between": ["left", "floor"], "side": "axis"}]))
    L, length = math.hypot(1, h), math.hypot(1, stop)
    # engineering strain of both bars at the stop; negative: the load pulls the truss back
    held = 2.0 * EA * (length - L) / L * stop / length
    assert solution.r("left@1") == pytest.approx([0.0, -stop], abs=1e-9)
    assert obstacle_reactions(solution.model, solution.state)["floor"]["fy"] == pytest.approx(P - held, rel=1e-6)
    assert [row["factor"] for row in solution.state.report["limit_points"]][1:] == [pytest.approx(held / P, rel=1e-4)]
