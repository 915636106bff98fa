"""Contact compared with closed forms: walls, knife edges, a layer before a wall, a rolling disc, slipping belts."""

from __future__ import annotations

import math
from typing import Any

import helpers as h
import numpy as np
import pytest
from instruments.references import contacts as reference
from motions import ride, rigid
from scipy.optimize import brentq

from ancf2d.solvers.contact import contact_report
from ancf2d.solvers.registry import solve
from ancf2d.solvers.state_results import reactions

STIFF = {"EA": 1e7, "EI": 1.0, "rhoA": 1.0, "kGA": 1e7, "rhoI": 1e-6}
EULER = math.pi**2


def test_a_wall_stops_a_buckled_beam() -> None:
    """Half of a clamped column: straight up to 4 Euler loads, then pressed on the wall at a point up to 16 of them."""
    gap, most = 0.01, 15.75
    model = h.build(
        {"beam": h.body(h.line(0.5), h.element("cable", 16), STIFF)}, {"type": "static", "steps": 15},
        bc=[{"name": "wall", "type": "clamp", "at": "beam@0"},
            {"name": "middle", "type": "prescribed", "at": "beam@1", "angle": 0}],
        # a small force leads onto the branch
        loads=[{"type": "force", "at": "beam@1", "value": [-most * EULER, 0]},
               {"type": "force", "at": "beam@1", "value": [0, 1e-4]}],
        obstacles={"above": {"type": "half_plane", "through": [0, gap], "normal": [0, -1]}},
        contacts=[{"between": ["beam", "above"], "side": "axis"}])
    seen = set()
    for state in solve(model):
        force = most * EULER * state.t
        stage, shortening = reference.between_walls(1.0, 1.0, gap, force)
        if abs(force / EULER - 4.0) < 0.1:
            # the small force moves it far where it buckles
            continue
        seen.add(stage)
        u = h.dot(h.point_ref(model.meshes["beam"], 1.0).position()[0], state.d)
        moved = 2.0 * (-u - 0.5 * force / STIFF["EA"])
        (report,) = contact_report(model, state)
        assert moved == pytest.approx(shortening, rel=1e-3, abs=1e-7)
        # one wave is stopped by nothing but the small force
        assert (report["force"][1] < -0.01) == (stage == "point")
    assert seen == {"straight", "point"}


@pytest.mark.parametrize("name", h.chosen(["cable", "reissner3"], ["cable"]))
def test_a_beam_is_pressed_through_round_supports_beyond_its_largest_load(name: str) -> None:
    """Three-point bending: the beam slides on the supports, and the force passes its maximum; by elastica."""
    edge, radius, down = 0.5, 0.05, 0.35
    model = h.build(
        {"beam": h.body(h.line(1.0), h.element(name, 16 if name == "cable" else 24), STIFF)},
        {"type": "static", "steps": 7},
        bc=[{"name": "punch", "type": "prescribed", "at": "beam@0", "ux": 0, "angle": 0,
             "uy": {"type": "ramp", "scale": -down}}],
        obstacles={"edge": {"type": "circle", "center": [edge, -radius], "radius": radius}},
        contacts=[{"between": ["beam", "edge"], "side": "axis"}])
    pressed = []
    for state in solve(model):
        def sag(angle: float, wanted: float = down * state.t) -> float:
            return reference.on_knife_edges(1.0, edge, angle, radius)[1] - wanted

        force, _ = reference.on_knife_edges(1.0, edge, brentq(sag, 1e-4, 1.5), radius)
        (report,) = contact_report(model, state)
        pressed.append(2.0 * report["force"][1])
        assert pressed[-1] == pytest.approx(force, rel=1e-3)
    assert 0 < np.argmax(pressed) < len(pressed) - 1


def test_a_bar_hits_a_layer_and_rebounds_with_its_waves() -> None:
    """Duration, force and rebound by d'Alembert: the momentum of the bar at all times."""
    stiffness, v, gap = 10.0, 0.01, 0.005
    section = {"EA": 1.0, "EI": 1e-4, "kGA": 0.3, "rhoA": 1.0, "rhoI": 1e-4}
    bar = h.body({"type": "line", "start": [gap, 0], "end": [1 + gap, 0]}, h.element("reissner3", 20), section)
    # over its height, that of a rectangle with this EI/EA
    law = {"stiffness": stiffness / math.sqrt(12.0 * 1e-4)}
    found = ride({"bodies": {"bar": bar}, "initial": {"velocity": [-v, 0]},
                  "obstacles": {"wall": {"type": "half_plane", "through": [0, 0], "normal": [1, 0]}},
                  "contacts": [{"between": ["bar", "wall"], "law": law}]}, 3.0, tolerance=1e-5, every=1)
    _, momenta = found.totals()
    pushed = [reference.bar_against_layer(1.0, 1.0, 1.0, v, stiffness, row.t - gap / v)[1] for row in found.rows]
    np.testing.assert_allclose(momenta[:, 0], np.array(pushed) - v, atol=1e-3 * v)
    forces = [reference.bar_against_layer(1.0, 1.0, 1.0, v, stiffness, t)[0] for t in (1.9, 2.1678, 2.1679)]
    # EA v/c for two passages of the wave, and free behind them
    assert forces[0] == pytest.approx(v, rel=1e-7)
    assert forces[1] > 0.0 == forces[2]
    flown = [row.t > gap / v + 2.17 for row in found.rows]
    assert sum(flown) > 10
    np.testing.assert_allclose(momenta[flown, 0], momenta[-1, 0], rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.5, 0.05])
def test_a_disc_rolls_down_a_slope_or_slides(mu: float) -> None:
    """An obstacle on a body that is free to turn, on a stiff track."""
    slope, radius, start, t_end, stiffness = 0.3, 0.1, 0.03, 0.4, 3e6
    # the pressure of a layer below a disc is k (depth - x^2/2R): it bears 4/3 k sqrt(2 R) depth^(3/2)
    depth = (0.75 * 9.81 * math.cos(slope) / stiffness / math.sqrt(2.0 * radius)) ** (2.0 / 3.0)
    height = radius - depth
    model = h.build(
        {"track": h.body(h.line(0.3), h.element("cable", 40), {"EA": 1e6, "EI": 1e6, "rhoA": 10.0}),
         "wheel": rigid([start - 0.01, height], [start + 0.01, height], 1.0, 0.5 * radius**2)},
        {"type": "dynamic", "t_end": t_end, "dt": 1e-3, "method": "generalized_alpha", "estimate": False},
        bc=[{"name": f"end {s}", "type": "clamp", "at": f"track@{s}"} for s in (0, 1)],
        loads=[{"type": "gravity", "value": [9.81 * math.sin(slope), -9.81 * math.cos(slope)]}],
        obstacles={"disc": {"type": "circle", "center": [start, height], "radius": radius, "on": "wheel"}},
        contacts=[{"between": ["track", "disc"], "side": "axis", "friction": mu,
                   "law": {"stiffness": stiffness, "damping": 50}}])
    *_, state = solve(model)
    wheel = model.meshes["wheel"]
    ends = [np.array([h.dot(axis, state.d) for axis in h.point_ref(wheel, s).position()]) for s in (0.0, 1.0)]
    way, turned = reference.rolls_down(slope, mu, 9.81, t_end, 0.5)
    # the spring that friction is until it slides has no force at first
    assert 0.5 * (ends[0] + ends[1])[0] == pytest.approx(way, rel=1.5e-3)
    across = ends[1] - ends[0] + [0.02, 0.0]
    angle = math.atan2(across[1], across[0])
    # a disc that rolls creeps, as points of the layer are sheared while they pass below it; one that slides is late by
    # 2/3 of the time in which friction grows, about (4/3 mu depth/2.4 m/s^2)^(1/2) = 2.6 ms: 1 % of the time squared
    assert -radius * angle == pytest.approx(turned, rel=1e-2)


def two_pulleys(first: float, second: float, pull: float, radius: float, **how: Any) -> Any:
    """Return a belt around two pulleys pulled apart by a force; the first one turns, the second one is fixed."""
    apart, angle = 0.2, {"type": "table", "t": [0, 0.2, 1], "value": [0, 0, 0.02]}
    pieces = [{"line": apart}, {"arc": radius, "angle": math.pi}] * 2
    belt = {"geometry": {"type": "path", "start": [0, -radius], "heading": 0, "closed": True, "pieces": pieces},
            "section": {"height": 0.0005, "width": 0.02}, "material": {"E": 1e9, "nu": 0.3},
            "element": {"type": "cable", "count": 40, **how}}
    grip = {"side": "axis", "law": {"stiffness": 1e7}}
    return h.build(
        {"belt": belt, "driver": rigid([-0.01, 0], [0.01, 0], 1.0, 1.0),
         "driven": rigid([apart - 0.01, 0], [apart + 0.01, 0], 1.0, 1.0)},
        {"type": "static", "steps": 20},
        bc=[{"name": "shaft", "type": "prescribed", "at": "driver@0.5", "uy": 0, "angle": angle},
            {"name": "brake", "type": "clamp", "at": "driven@0.5"}],
        loads=[{"type": "force", "at": "driver@0.5", "value": [-pull, 0],
                "amplitude": {"type": "table", "t": [0, 0.2], "value": [0.05, 1]}}],
        obstacles={name: {"type": "circle", "center": [x, 0], "radius": radius * (1 + 2e-4), "on": name2}
                   for name, x, name2 in (("one", 0, "driver"), ("two", apart, "driven"))},
        contacts=[{"between": ["belt", "one"], "friction": first, **grip},
                  {"between": ["belt", "two"], "friction": second, **grip}])


@pytest.mark.slow
@pytest.mark.parametrize(("first", "second"), [(0.5, 0.3)])
def test_a_belt_bears_the_torque_at_which_it_slips_on_one_of_two_pulleys(first: float, second: float) -> None:
    """T1/T2 = exp(mu pi) of the pulley with less grip, T1 + T2 = the force that pulls them apart.

    Here the driven one, and in ``cases/contact/two_pulleys.yaml`` the other.
    """
    pull, radius = 20.0, 0.05
    model = two_pulleys(first, second, pull, radius)
    ratio = reference.capstan(1.0, min(first, second), math.pi)
    most = pull * radius * (ratio - 1.0) / (ratio + 1.0)
    torques = []
    for state in solve(model):
        held = reactions(model, state)
        torques.append(-held["brake"]["m"])
        assert held["brake"]["fx"] == pytest.approx(pull * min(0.05 + 0.95 * state.t / 0.2, 1.0), rel=1e-6)
    assert torques[-1] == pytest.approx(most, rel=1e-3)
    assert max(torques) < most * (1.0 + 1e-3)
