"""Lift-off of a body from an obstacle in statics, compared with shooting solutions."""

from __future__ import annotations

import math
from typing import Any

import helpers
import numpy as np
import pytest
from instruments.references import contacts as reference
from scipy.optimize import minimize_scalar
from test_contact_statics import check_balance, fields_of, strip

from ancf2d.interactions.contact_curves import spots
from ancf2d.solvers.contact import contact_report
from ancf2d.solvers.registry import solve
from ancf2d.solvers.small_motions.eigen import solve_eigen

STIFF = {"EA": 1e6, "EI": 1.0, "kGA": 1e6, "rhoA": 1.0, "rhoI": 1e-6}
CLAMP = {"name": "wall", "type": "clamp", "at": "beam@0"}
BLOCK = {"type": "polyline", "points": [[-1, -1], [-1, 0], [2, 0], [2, -1]]}


def test_a_heavy_strip_is_lifted_from_the_floor_that_supports_it() -> None:
    length, (_, height, theta) = reference.lifted_far(1.0, 9.81, 3.0)
    weight = {"type": "table", "t": [0, 0.2], "value": [0, 1]}
    lift = {"type": "table", "t": [0.2, 1], "value": [0, 1]}
    solution = helpers.Solution(strip(
        20, bc=[{"name": "anchor", "type": "roller", "at": "beam@0", "fixed": "x"}],
        loads=[{"type": "gravity", "value": [0, -9.81], "amplitude": weight},
               {"type": "force", "at": "beam@1", "value": [0, 3], "amplitude": lift}],
        obstacles={"solid": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}}))
    assert solution.r("beam@1")[1] == pytest.approx(height, rel=1e-3)
    assert solution.theta("beam@1") == pytest.approx(theta, rel=2e-3)
    check_balance(solution, [0, 3 - 9.81])
    # the pressure is the weight that lies on the floor, with a force where it is lifted; the floor is below the axis
    fields, sums = fields_of(solution.model, solution.state)
    np.testing.assert_allclose(sums["pressure"], [9.81 - 3.0, 0.0], atol=1e-8)
    assert np.median(fields["pressure"][:4, :, 0]) == pytest.approx(9.81, rel=0.1)
    np.testing.assert_allclose(fields["gap"][[0, -1], [0, -1], 0], [0.0, height], rtol=1e-3, atol=1e-8)
    assert not fields["traction"].any()
    (report,) = contact_report(solution.model, solution.state)
    np.testing.assert_allclose(report["force"], [0, 9.81 - 3], atol=1e-7)
    assert report["to"] == pytest.approx(1.0 - length, abs=5e-3)
    # the part that stays on the floor is in it nowhere, and what touches is found in few iterations
    assert solution.state.history["iterations"] < 40
    assert not solution.state.warnings
    depths = [solution.r(f"beam@{s}")[1] for s in np.linspace(0.0, 0.35, 211)]
    assert min(depths) > -1e-8


def lifted(name, count, turned=0.0, order=("beam", "solid"), floor=None):
    """Return a heavy strip that 3 N lift off a floor, the whole scene rotated, and the end of its contact."""
    c, s = math.cos(turned), math.sin(turned)
    weight = {"type": "table", "t": [0, 0.2], "value": [0, 1]}
    lift = {"type": "table", "t": [0.2, 1], "value": [0, 1]}
    spec = helpers.body(helpers.line(1.0, turned), helpers.element(name, count), {**STIFF, "kGA": 4e5})
    solution = helpers.Solution(helpers.build(
        {"beam": spec}, {"type": "static", "steps": 5},
        # hardly more than nothing holds it along the floor
        springs=[{"type": "translational", "between": ["beam@0", [-c, -s]], "stiffness": 1e-3}],
        loads=[{"type": "gravity", "value": [9.81 * s, -9.81 * c], "amplitude": weight},
               {"type": "force", "at": "beam@1", "value": [-3 * s, 3 * c], "amplitude": lift}],
        obstacles={"solid": floor or {"type": "half_plane", "through": [0, 0], "normal": [-s, c]}},
        contacts=[{"between": list(order), "side": "axis"}]))
    (report,) = contact_report(solution.model, solution.state)
    return solution, report["to"]


@pytest.mark.parametrize("floor", [None, BLOCK], ids=["half_plane", "polyline"])
@pytest.mark.parametrize("name", helpers.chosen(["cable", "reissner3", "vallejo"], ["cable"]))
def test_the_place_of_lift_off_converges_with_the_elements(name: str, floor: dict[str, Any] | None) -> None:
    """A heavy strip on a floor: at least order 2 in its height and the lifted length, compared with shooting."""
    length, (_, height, _) = reference.lifted_far(1.0, 9.81, 3.0)
    found = [lifted(name, count, floor=floor) for count in (5, 20)]
    heights = [abs(solution.r("beam@1")[1] / height - 1.0) for solution, _ in found]
    lengths = [abs(to - (1.0 - length)) for _, to in found]
    assert heights[1] < heights[0] / 4**2 < 3e-4
    assert lengths[1] < lengths[0] / 4**2 < 5e-4


def test_lift_off_does_not_depend_on_orientation_or_order() -> None:
    """Up to round-off, which may choose between places inside the zone: within a tenth of the error."""
    (one, to), (other, place) = lifted("cable", 8), lifted("cable", 8, 0.7, ("solid", "beam"))
    assert place == pytest.approx(to, abs=3e-4)
    turn = np.array([[math.cos(0.7), -math.sin(0.7)], [math.sin(0.7), math.cos(0.7)]])
    np.testing.assert_allclose(other.r("beam@1"), turn @ one.r("beam@1"), atol=5e-6)


@pytest.mark.parametrize("name", helpers.chosen(["cable", "reissner3", "vallejo"], ["cable"]))
def test_a_beam_that_turns_about_the_corner_of_a_table_within_an_element_converges(name: str) -> None:
    """A heavy strip lifted at one end overhangs an edge with the other: 8 elements are as good as 64 to 0.3 %.

    With points that stay where they are, 8 elements are 5 % off and 16 elements 2 %.
    """
    found = []
    for count in (8, 64):
        spec = helpers.body(helpers.line(1.0), helpers.element(name, count), {**STIFF, "kGA": 4e5})
        solution = helpers.Solution(helpers.build(
            {"beam": spec}, {"type": "static", "steps": 5}, bc=[{"type": "roller", "at": "beam@0", "fixed": "x"}],
            loads=[{"type": "gravity", "value": [0, -9.81]},
                   {"type": "force", "at": "beam@0", "value": [0, 2.0],
                    "amplitude": {"type": "table", "t": [0.2, 1], "value": [0, 1]}}],
            obstacles={"solid": {"type": "polyline", "points": [[-1, 0], [0.7, 0], [0.7, -2]]}},
            contacts=[{"between": ["beam", "solid"], "side": "axis"}]))
        found.append(solution.r("beam@0")[1])
    assert found[0] == pytest.approx(found[1], rel=3e-3)


@pytest.mark.parametrize("name", helpers.chosen(["cable", "reissner3", "vallejo"], ["cable"]))
def test_modes_about_a_state_let_the_place_of_lift_off_move(name: str) -> None:
    """A nearly straight strip of weight w, of which F lifts the length 2 F/w, vibrates as if clamped there.

    With w(l) = w'(l) = w''(l) = 0 in the equilibrium, the motion of the place changes neither w nor w' to first order:
    omega_1 = 1.8751^2 sqrt(EI/(rhoA l^4)). With the place held it would be 15 and 7 % less.
    """
    exact = 1.875104068711961**2 * math.sqrt(50.0) / (2 * 3.0 / 9.81) ** 2
    found = []
    for count in (5, 10):
        spec = helpers.body(helpers.line(1.0), helpers.element(name, count), {
            "EA": 1e7, "EI": 50.0, "kGA": 4e6, "rhoA": 1.0, "rhoI": 5e-6})
        model = helpers.build(
            {"beam": spec}, {"type": "eigen", "modes": 2, "about": "static"},
            springs=[{"type": "translational", "between": ["beam@0", [-1, 0]], "stiffness": 1e-3}],
            loads=[{"type": "gravity", "value": [0, -9.81]}, {"type": "force", "at": "beam@1", "value": [0, 3.0]}],
            obstacles={"solid": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}},
            contacts=[{"between": ["beam", "solid"], "side": "axis"}])
        (state,) = solve_eigen(model, model.case.solver)
        omega = np.array([row["omega"] for row in state.report["frequencies"]])
        found.append(abs(omega[omega > 1.0][0] / exact - 1.0))
    assert found[0] < 0.03
    assert found[1] < 0.25 * found[0]


@pytest.mark.parametrize("name", helpers.chosen(["cable", "reissner3", "vallejo"], ["cable"]))
def test_a_path_finds_the_largest_load_of_a_beam_on_round_supports(name: str) -> None:
    """The beam slides through between its supports where the force is largest; by elastica.

    With points that stay where they are, the path ends at 0.84 of this load, where a node passes the support.
    """
    def bears(angle: float) -> float:
        return reference.on_knife_edges(1.0, 0.5, angle, 0.05)[0]

    most = bears(minimize_scalar(lambda angle: -bears(angle), bounds=(0.5, 1.0), method="bounded").x)
    found = []
    for count in (4, 8):
        spec = helpers.body(helpers.line(1.0), helpers.element(name, count), {
            **STIFF, "EA": 1e7, "kGA": 4e6, "rhoI": 1e-7})
        model = helpers.build(
            {"beam": spec}, {"type": "static", "method": "arc_length", "until": {"limit_points": 1}},
            bc=[{"name": "punch", "type": "prescribed", "at": "beam@0", "ux": 0, "angle": 0}],
            loads=[{"type": "force", "at": "beam@0", "value": [0, -1]}],
            obstacles={"edge": {"type": "circle", "center": [0.5, -0.05], "radius": 0.05}},
            contacts=[{"between": ["beam", "edge"], "side": "axis"}])
        *_, state = solve(model)
        found.append(abs(2.0 * state.t / most - 1.0))
    assert found[1] < found[0] / 6.0 < 1e-3


def strip_around_a_drum(name, count, force, solver):
    """Return a solved strip that a force at its end pulls around the drum to which it is clamped."""
    spec = helpers.body(helpers.line(1.0), helpers.element(name, count), {**STIFF, "kGA": 4e5})
    return helpers.Solution(helpers.build(
        {"beam": spec}, {"type": "static", **solver}, bc=[CLAMP],
        loads=[{"type": "force", "at": "beam@1", "value": [0, -force]}],
        obstacles={"drum": {"type": "circle", "center": [0, -0.3], "radius": 0.3}},
        contacts=[{"between": ["beam", "drum"], "side": "axis"}]))


@pytest.mark.slow_rows("cable-96", "vallejo-96", "reissner3-20")
@pytest.mark.parametrize(("name", "count"), [("cable", 10), ("cable", 96), ("reissner3", 20), ("vallejo", 96)])
def test_a_path_has_the_place_of_lift_off_to_the_order_of_the_element(name: str, count: int) -> None:
    """Like load steps: for a strip around a drum, whose tip has an error of 7e-4 with fixed contact points.

    Places that pass from one element to the next and back, as curves of elements have kinks, come to rest there.
    """
    along = strip_around_a_drum(name, count, 20.0, {"method": "arc_length", "until": {"load_factor": 1}})
    assert math.hypot(*(along.r("beam@1") - reference.strip_on_drum(1.0, 1.0, 0.3, 20.0).tip)) < 4e-5
    assert not along.state.warnings


def test_a_curve_between_nodes_that_has_left_the_contact_zone_stays_out_of_it() -> None:
    """Points of two elements that open and close each other alternate between two curves."""
    solution = strip_around_a_drum("vallejo", 20, 20.0, {"steps": 10})
    assert solution.state.history["step"] == 10


@pytest.mark.parametrize("still", [True, False])
@pytest.mark.parametrize("kind", ["cable", "reissner3", "vallejo"])
def test_moving_points_start_in_the_middle_between_fixed_ones(kind: str, still: bool) -> None:
    mesh = helpers.build({"beam": helpers.body(helpers.line(1.0), helpers.element(kind, 3))}, "static",
                         bc=[CLAMP]).meshes["beam"]
    free, home = ([mesh.starts[p.ie] + 0.5 * (p.z + 1.0) * mesh.lengths[p.ie]
                   for p in spots(mesh, "axis", False, still) if p.free == moves] for moves in (True, False))
    assert len(home) == (4 if still else 7)
    np.testing.assert_allclose(free, 0.5 * (np.array(home[1:]) + home[:-1]), atol=1e-14)
