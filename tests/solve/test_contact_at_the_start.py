"""Statics of bodies that touch at the start, or that only contact supports."""

from __future__ import annotations

import copy
from typing import Any

import helpers
import numpy as np
import pytest

import ancf2d
from ancf2d.errors import ComputationError


def scene(kind: str, method: str, gap: float = 0.0, force: float = 0.0, hold: str = "clamp",
          **contact: Any) -> dict[str, Any]:
    """Return a heavy strip over a floor, with a force at its end."""
    supports = {"clamp": {"type": "clamp", "at": "strip@0"}, "x": {"type": "roller", "at": "strip@0.5", "fixed": "x"}}
    return {"format": 1, "bodies": {"strip": {
                "geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                "section": {"height": 0.02, "width": 0.05}, "material": {"E": 1e7, "nu": 0.3, "rho": 1000},
                "element": {"type": kind, "count": 8}}},
            "boundary_conditions": [supports[hold]], "solver": {"type": "static", "method": method},
            "loads": [{"type": "gravity", "value": [0, -9.81]},
                      {"type": "force", "at": "strip@1", "value": [0, force]}],
            "obstacles": {"floor": {"type": "half_plane", "through": [0, -gap], "normal": [0, 1]}},
            "contacts": [{"between": ["strip", "floor"], "side": "axis", **contact}],
            "output": {"probes": {"tip": "strip@1"}}}


def tip(case: dict[str, Any]) -> float:
    return float(ancf2d.solve(case).summary["probes"]["tip"]["uy"])


@pytest.mark.slow_rows("cable-1e-06", "reissner3-0.0", "reissner3-1e-06")
@pytest.mark.parametrize("gap", [0.0, 1e-6])
@pytest.mark.parametrize("kind", ["cable", "reissner3"])
def test_a_path_starts_without_displacements(kind: str, gap: float) -> None:
    """The force lifts the end from the first step on, but before that all displacements may be round-off."""
    assert tip(scene(kind, "arc_length", gap)) == pytest.approx(-gap, abs=1e-12)
    assert tip(scene(kind, "arc_length", gap, 2.0)) == pytest.approx(tip(scene(kind, "newton", gap, 2.0)), rel=1e-4)


@pytest.mark.parametrize("kind", ["cable", "reissner3"])
def test_a_path_continues_after_all_displacements_vanish(kind: str) -> None:
    """Nothing moves with the load factor any more, so no step can move a point too far."""
    case = scene(kind, "arc_length", 1e-6, -1.0)
    del case["loads"][0]
    assert tip(case) == pytest.approx(-1e-6, rel=1e-9)


LAWS = [{}, {"law": {"stiffness": 1e6}}]


@pytest.mark.slow_rows("newton-law0")
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("method", ["newton", "arc_length"])
def test_bodies_without_support_before_contact_are_reported(method: str, law: dict[str, Any]) -> None:
    """A body that a force or a path of loads would have to press down; sideways forces do not support it either."""
    case = scene("reissner3", method, 1e-3, hold="x", **law)
    free = {**case, "boundary_conditions": [], "solver": {"type": "static"}}
    pressed = {**case, "loads": [{"type": "force", "at": "strip@0.5", "value": [0, -9.81]}]}
    for told in (pressed, free if method == "newton" else case):
        with pytest.raises(ComputationError, match="contacts hold a body only while they press") as error:
            ancf2d.solve(told)
        assert "weak spring" in error.value.failure.advice
    # what is advised helps
    case["springs"] = [{"type": "translational", "between": [f"strip@{s}", [s, 1.0]], "stiffness": 1e-2}
                       for s in (0, 1)]
    depth = 9.81 / 1e6 if law else 0.0
    found = ancf2d.solve(case)
    assert np.abs(found.summary["probes"]["tip"]["uy"] + 1e-3 + depth) < 1e-7


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", ["rigid", "cable", "reissner3", "vallejo"])
def test_a_lever_falls_onto_the_floor(kind: str, law: dict[str, Any]) -> None:
    """A straight bar, pinned at one end, leans on the lower corner of its other end: moments about the pin."""
    rise, gap, height = 0.1, 0.3, 0.02
    case = scene("cable", "newton", gap, friction=0.0, **law)
    body = case["bodies"]["strip"]
    body["element"] = {"type": "rigid"} if kind == "rigid" else {"type": kind, "count": 4}
    body["geometry"]["end"] = [1.0, rise]
    body["material"]["E"] = 1e11
    case["boundary_conditions"] = [{"type": "pin", "at": "strip@0"}]
    del case["contacts"][0]["side"]
    found = ancf2d.solve(case)
    assert [w for w in found.warnings if "sinks under its weight" in w]
    length, weight = np.hypot(1.0, rise), 9.81 * np.hypot(1.0, rise)
    ux, uy = (found.summary["probes"]["tip"][u] for u in ("ux", "uy"))
    angle = -np.arctan2(rise + uy, 1.0 + ux)
    assert np.hypot(1.0 + ux, rise + uy) == pytest.approx(length, rel=1e-5)
    # into a layer its corner sinks as a wedge of its points does, those of one element less
    depth = length * np.sin(angle) + 0.5 * height * np.cos(angle) - gap
    wedge = np.sqrt(2.0 * found.reactions["floor"]["fy"] * np.tan(angle) / 1e6)
    assert abs(depth) < 2e-5 if not law else (0.15 if kind == "rigid" else 0.75) * wedge < depth < 1.02 * wedge
    lever = length * np.cos(angle) - 0.5 * height * np.sin(angle)
    assert found.reactions["floor"]["fy"] == pytest.approx(weight * length / 2.0 * np.cos(angle) / lever,
                                                         rel=3e-3 if law else 2e-4)


@pytest.mark.slow
def test_a_rod_falls_to_rest_on_a_rough_floor() -> None:
    """Only the floor supports it; a rod that would miss every obstacle is reported at once."""
    case = scene("cable", "newton", 0.3, friction=0.3)
    case["boundary_conditions"] = []
    case["bodies"]["strip"]["geometry"]["end"] = [1.0, 0.1]
    found = ancf2d.solve(case)
    tip = found.summary["probes"]["tip"]
    assert tip["uy"] == pytest.approx(-0.4, abs=1e-7)
    assert found.reactions["floor"]["fy"] == pytest.approx(9.81 * np.hypot(1.0, 0.1), rel=1e-8)
    case["obstacles"] = {"disc": {"type": "circle", "center": [5.0, -1.0], "radius": 0.1}}
    case["contacts"][0]["between"] = ["strip", "disc"]
    with pytest.raises(ComputationError, match="nothing holds"):
        ancf2d.solve(case)


@pytest.mark.slow
def test_a_soft_ring_sinks_to_the_floor_and_not_through_it() -> None:
    """It collapses under its weight, far from any path of equilibria, and comes to rest on the floor."""
    R, height, width, rho = 0.234, 0.01, 0.05, 1000.0
    piece = {"arc": R, "angle": np.pi}
    case = {"format": 1, "bodies": {"ring": {
                "geometry": {"type": "path", "start": [0, 0.147], "heading": 0, "closed": True,
                             "pieces": [piece, dict(piece)]},
                "section": {"height": height, "width": width}, "material": {"E": 3.3e5, "nu": 0.3, "rho": rho},
                "element": {"type": "cable", "count": 8}}},
            "boundary_conditions": [{"name": "wall", "type": "clamp", "at": "ring@0"}], "solver": {"type": "static"},
            "loads": [{"type": "gravity", "value": [0, -9.81]}],
            "obstacles": {"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}},
            "contacts": [{"between": ["ring", "floor"]}]}
    found = ancf2d.solve(case)
    pair = found.model.contacts[0]
    home = [not spot.free for spot in pair.spots]
    assert pair.gaps(found.d[-1], 1.0)[home].min() > -1e-8
    floor, wall = found.reactions["floor"]["fy"], found.reactions["wall"]["fy"]
    assert floor > 0.0
    # the whole weight, of elements that are not quite arcs
    weight = ancf2d.solve({**case, "solver": {"type": "linear_static"}, "obstacles": {}, "contacts": []},
                          states=False).reactions["wall"]["fy"]
    assert weight == pytest.approx(rho * height * width * 2 * np.pi * R * 9.81, rel=1e-3)
    assert floor + wall == pytest.approx(weight, rel=1e-6)


LIFT, WEIGHT = 2.0, 9.81


@pytest.mark.slow_rows("cable-0.0", "reissner3-0.0", "vallejo-0.0")
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("kind", ["cable", "reissner3", "vallejo", "rigid"])
def test_a_chain_lies_on_a_floor_that_its_joint_touches_twice(kind: str, friction: float) -> None:
    """The pinned ends have one common gap. A lifted end rises by q a^4/(24 E I) with a = 2 F/q.

    Rigid bodies lie as they are: nothing there has any stiffness but that of round-off in the directions of forces.
    """
    case = scene(kind, "newton", force=LIFT, hold="x", friction=friction)
    if kind == "rigid":
        del case["bodies"]["strip"]["element"]["count"]
        case["boundary_conditions"][0]["at"] = "strip@1"
    case["bodies"]["other"] = copy.deepcopy(case["bodies"]["strip"])
    case["bodies"]["other"]["geometry"].update(start=[-1, 0], end=[0, 0])
    case["contacts"].append({**case["contacts"][0], "between": ["other", "floor"]})
    case["joints"] = [{"type": "pin", "between": ["strip@0", "other@1"]}]
    solution = ancf2d.solve(case)
    lifted, stiffness = 2.0 * LIFT / WEIGHT, 1e7 * 0.05 * 0.02**3 / 12.0
    risen = WEIGHT * lifted**4 / (24.0 * stiffness) if kind != "rigid" else 0.0
    assert solution.summary["probes"]["tip"]["uy"] == pytest.approx(risen, rel=0.03, abs=1e-12)
    bears = sum(contact["force"][1] for contact in solution.summary["contacts"])
    assert bears == pytest.approx(2.0 * WEIGHT - LIFT, rel=1e-9)


def test_coinciding_obstacles_support_a_body_together() -> None:
    case = scene("reissner3", "newton", force=LIFT)
    case["obstacles"]["second"] = dict(case["obstacles"]["floor"])
    case["contacts"].append({**case["contacts"][0], "between": ["strip", "second"]})
    solution = ancf2d.solve(case)
    bears = sum(contact["force"][1] for contact in solution.summary["contacts"])
    assert bears + solution.summary["reactions"]["strip@0"]["fy"] == pytest.approx(WEIGHT - LIFT, rel=1e-9)


@pytest.mark.parametrize("kind", ["vallejo", "reissner3", "cable"])
def test_faces_of_a_tapered_body_are_half_its_height_from_its_axis(kind: str) -> None:
    case = scene(kind, "newton", 0.3, side="surface")
    case["bodies"]["strip"]["section"]["height"] = "0.2 - 0.1*s"
    (pair,) = helpers.build(**case).contacts
    mesh = pair.mesh
    s = np.array([mesh.starts[p.ie] + 0.5 * (p.z + 1.0) * mesh.lengths[p.ie] for p in pair.spots])
    half = 0.5 * (0.2 - 0.1 * s) * [p.eta for p in pair.spots]
    np.testing.assert_allclose(pair.gaps(np.zeros(mesh.n_dofs), 0.0), 0.3 + half, atol=1e-12)


@pytest.mark.parametrize("drive", ["prescribed", "clamp"])
def test_a_flat_follower_rests_on_a_cam_with_both_corners(drive: str) -> None:
    """A guided rigid bar moves only up and down, and the supports move the cam: two contacts, one unknown."""
    angle, height, stiffness = 0.3 if drive == "prescribed" else 0.0, 0.02, 50.0
    turn = {"x": 0, "y": 0, "angle": {"type": "ramp", "scale": angle}} if drive == "prescribed" else {}

    def rigid(start: list[float], end: list[float]) -> dict[str, Any]:
        return {"geometry": {"type": "line", "start": start, "end": end}, "section": {"height": height, "width": 0.02},
                "element": {"type": "rigid", "mass": 1, "inertia": 0.1}}

    case = {"bodies": {"crank": rigid([0, 0], [1, 0]), "bar": rigid([0.5, 0.5], [0.5, 1])},
            "boundary_conditions": [{"type": drive, "at": "crank@0", **turn}, *(
                {"type": "roller", "at": f"bar@{s}", "fixed": "x"} for s in (0.4, 1))],
            "springs": [{"type": "translational", "between": ["bar@1", [0.5, 2]], "stiffness": stiffness,
                         "length": 1.1}],
            "obstacles": {"cam": {"type": "polyline", "points": [[-1, 0.5], [2, 0.5]], "on": "crank"}},
            "contacts": [{"between": ["bar", "cam"]}], "solver": {"type": "static"}}
    # the corner on the higher side stands on the line 0.5 above the crank's axis
    rise = (0.5 + (0.5 + height / 2) * np.sin(angle)) / np.cos(angle) - 0.5
    push = stiffness * (1.1 - (1.0 - rise))
    force = ancf2d.solve(case).summary["contacts"][0]["force"]
    assert force == pytest.approx([-push * np.tan(angle), push], rel=1e-9)
