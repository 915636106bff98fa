"""Motions in which supports, joints and other points already fix the gap of a contact point."""

from __future__ import annotations

import math
from typing import Any

import helpers
import numpy as np
import pytest

import ancf2d
from ancf2d.errors import ComputationError

G, L, MASS, HEIGHT = 9.81, 1.0, 1.0, 0.02
BEAM = {"section": {"height": HEIGHT, "width": 0.05}, "material": {"E": 1e7, "nu": 0.3, "rho": 1000}}
METHODS = "generalized_alpha", "radau5"


def body(kind: str, start: float = 0.0, y: float = 0.0, end: tuple[float, float] | None = None) -> dict[str, Any]:
    """Return a body of length L from a position."""
    element = {"type": "rigid"} if kind == "rigid" else {"type": kind, "count": 4}
    to = [start + L, y] if end is None else list(end)
    return {"geometry": {"type": "line", "start": [start, y], "end": to}, "element": element, **BEAM}


def scene(bodies: dict[str, Any], supports: list[dict[str, Any]], side: str, method: str,
          **more: Any) -> dict[str, Any]:
    """Return bodies under gravity that lie on a floor."""
    return {"format": 1, "bodies": bodies, "boundary_conditions": supports,
            "loads": [{"type": "gravity", "value": [0, -G]}],
            "obstacles": {"floor": {"type": "half_plane", "normal": [0, 1],
                                    "through": [0, 0 if side == "axis" else -HEIGHT / 2]}},
            "contacts": [{"name": name, "between": [name, "floor"], "side": side} for name in bodies],
            "solver": {"type": "dynamic", "t_end": 0.01, "dt": 0.002, "estimate": False, "method": method}, **more}


def borne(solution: Any) -> float:
    """Return the force along y of all supports and obstacles in the last state."""
    return math.fsum(r["fy"] for r in solution.reactions.values())


@helpers.pairwise(support=[{"type": "pin", "at": "rod@0"}, {"type": "roller", "at": "rod@0", "fixed": "y"},
                           {"type": "pin", "at": "rod@0.5"}],
                  kind=["cable", "reissner2", "rigid"], side=["axis", "surface"], method=METHODS)
def test_a_rod_lies_still_if_a_support_holds_it_on_the_floor(support, kind, side, method):
    found = ancf2d.solve(scene({"rod": body(kind)}, [{"name": "held", **support}], side, method))
    assert np.abs(found.d).max() < 1e-12 * L
    assert borne(found) == pytest.approx(MASS * G, rel=1e-9)


@pytest.mark.parametrize("joint", ["pin", "weld"])
@pytest.mark.parametrize("kind", ["cable", "rigid"])
@pytest.mark.parametrize("side", ["axis", "surface"])
def test_bodies_joined_at_a_common_contact_lie_still(side, kind, joint):
    found = ancf2d.solve(scene({"rod": body(kind), "other": body(kind, start=L)}, [], side, METHODS[0], joints=[
        {"type": joint, "between": ["rod@1", "other@0"]}]))
    assert np.abs(found.d).max() < 1e-12 * L
    assert borne(found) == pytest.approx(2 * MASS * G, rel=1e-9)


@pytest.mark.slow_rows("cable-generalized_alpha-1", "cable-radau5-0.5", "reissner3-radau5-0.5")
@pytest.mark.parametrize(("kind", "method", "at"), [
    ("reissner3", "generalized_alpha", 0), ("reissner3", "radau5", 0.5), ("cable", "generalized_alpha", 1),
    ("cable", "radau5", 0.5)])
def test_a_beam_falls_flat_about_a_pin_onto_one_on_the_floor(kind, method, at):
    """Once it lies there, both have nearly one gap at the pin: h/4 theta^2 apart, and one of two forces would pull."""
    angle = 0.05
    end = at + L * math.cos(angle), L * math.sin(angle)
    case = scene({"low": body(kind), "rod": body(kind, start=at, end=end)}, [], "surface", method,
                 joints=[{"type": "pin", "between": [f"low@{at}", "rod@0"]}])
    case["solver"] |= {"t_end": 0.2, "dt": 1e-3}
    found = ancf2d.solve({**case, "output": {"every": 1}})
    energies, fall = found.energies, MASS * G * L / 2 * math.sin(angle)
    total = energies["kinetic"] + energies["strain"] + energies["potential"]
    assert energies["potential"][-1] - energies["potential"][0] == pytest.approx(-fall, rel=1e-2)
    assert np.diff(total).max() < 1e-3 * fall
    for pair in found.model.contacts:
        nodes = [not spot.free for spot in pair.spots]
        assert min(pair.gaps(d, t)[nodes].min() for d, t in zip(found.d, found.t, strict=True)) > -1e-8 * L


@pytest.mark.parametrize("kind", ["reissner3", "rigid"])
def test_a_body_pinned_where_it_lies_on_another_lies_still(kind):
    case = scene({"rod": body(kind), "low": body("rigid", y=-HEIGHT)},
                 [{"name": "held", "type": "pin", "at": "rod@0"}, {"name": "wall", "type": "clamp", "at": "low@0"}],
                 "surface", METHODS[0])
    found = ancf2d.solve({**case, "obstacles": {}, "contacts": [{"name": "lies", "between": ["rod", "low"]}]})
    assert np.abs(found.d).max() < 1e-12 * L
    # the clamp has the weight of its body and of what lies on it, the pin the rest
    assert borne(found) == pytest.approx(2 * MASS * G, rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("end", [0, 1])
def test_either_end_of_a_rod_pinned_in_its_middle_bears_the_force_on_it(end, method):
    """The gaps of both ends follow from one angle: while both touch, only one of them is a constraint."""
    F = 7.0
    case = scene({"rod": body("rigid")}, [{"name": "held", "type": "pin", "at": "rod@0.5"}], "surface", method)
    case["loads"].append({"type": "force", "at": f"rod@{end}", "value": [0, -F]})
    found = ancf2d.solve(case)
    assert np.abs(found.d).max() < 1e-12 * L
    assert found.reactions["floor"]["fy"] == pytest.approx(F, rel=1e-9)
    assert found.reactions["held"]["fy"] == pytest.approx(MASS * G, rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("side", ["axis", "surface"])
def test_a_pinned_rod_that_falls_flat_onto_the_floor_lies_still(side, method):
    """The lower corner at the pin comes down to the floor on a circle, with the whole of the lower face."""
    angle = 0.05
    case = scene({"rod": body("rigid", end=(L * math.cos(angle), L * math.sin(angle)))},
                 [{"name": "held", "type": "pin", "at": "rod@0"}], side, method)
    case["solver"]["t_end"] = 0.2
    found = ancf2d.solve(case)
    tip = found.e[-1] - found.e[0]
    assert found.energies["potential"][-1] - found.energies["potential"][0] == pytest.approx(
        -MASS * G * L / 2 * math.sin(angle), rel=1e-9)
    assert np.abs(tip).max() == pytest.approx(L * math.sin(angle), rel=1e-9)
    assert found.energies["kinetic"][-1] < 1e-12 * MASS * G * L
    assert borne(found) == pytest.approx(MASS * G, rel=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_a_rod_with_three_points_bounces_like_one_with_two(method):
    """The gap of the middle follows from those of the ends."""
    fall = 0.1
    rod = {"geometry": {"type": "polyline", "points": [[0, fall], [L / 2, fall], [L, fall]]},
           "element": {"type": "rigid"}, **BEAM}
    case = scene({"rod": rod}, [], "axis", method)
    case["contacts"][0]["restitution"] = 1.0
    case["solver"] |= {"t_end": 1.5 * math.sqrt(2 * fall / G), "dt": 1e-3}
    found = ancf2d.solve(case)
    # up again for half of the time of the fall, from 0
    assert found.d[-1].min() == pytest.approx(-0.25 * fall, abs=1e-2 * fall)
    assert found.energies["dissipated"][-1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_support_that_moves_into_the_floor_ends_the_motion_with_a_reason(method):
    case = scene({"rod": body("rigid")}, [{"type": "prescribed", "at": "rod@0", "ux": 0, "uy": {
        "type": "ramp", "scale": -0.05, "t0": 0, "t1": 0.2}}], "surface", method)
    with pytest.raises(ComputationError, match="supports or joints press rod into floor at S = 0"):
        ancf2d.solve(case)


@pytest.mark.slow_rows("cable-radau5")
@pytest.mark.parametrize(("kind", "method"), [("cable", METHODS[0]), ("cable", METHODS[1]), ("reissner3", METHODS[0])])
def test_a_motion_ends_if_the_pivot_of_a_section_enters_the_floor(kind, method):
    """The floor rises to the axis of a pinned beam, whose face it meets before."""
    case = scene({"rod": body(kind)}, [{"type": "pin", "at": "rod@0"}], "surface", method)
    rises = {"type": "ramp", "scale": HEIGHT, "t0": 0, "t1": 0.1}
    case["obstacles"]["floor"].update(through=[0, -0.75 * HEIGHT], motion={"y": rises})
    case["solver"] |= {"t_end": 0.1, "dt": 2e-3}
    with pytest.raises(ComputationError, match="supports or joints press rod into floor at S = 0,") as error:
        ancf2d.solve(case)
    assert float(error.value.failure.at["t"]) == pytest.approx(0.075, rel=1e-3)


@pytest.mark.slow_rows("cable-floor", "reissner3-floor", "reissner3-support", "vallejo-floor", "vallejo-support")
@pytest.mark.parametrize("moved", ["support", "floor"])
@pytest.mark.parametrize("kind", ["cable", "reissner2", "reissner3", "vallejo"])
def test_a_support_that_moves_into_the_floor_ends_statics_with_a_reason(kind, moved):
    """Exactly where it meets the floor; up to there, the path is found."""
    gap, way = 0.05, {"type": "ramp", "scale": 0.08}
    down = {"type": "prescribed", "at": "rod@1", "ux": 0, "uy": {**way, "scale": -0.08}}
    supports = [{"type": "clamp", "at": "rod@0"}, down if moved == "support" else {"type": "pin", "at": "rod@1"}]
    case = scene({"rod": body(kind)}, supports, "axis", "", solver={"type": "static"})
    case["obstacles"]["floor"].update(through=[0, -gap], **({"motion": {"y": way}} if moved == "floor" else {}))
    with pytest.raises(ComputationError, match="supports or joints press rod into floor at S = ") as error:
        ancf2d.solve(case)
    assert float(error.value.failure.at["factor"]) == pytest.approx(gap / 0.08, rel=1e-4)
    for part in (down["uy"], way):
        part["scale"] *= 0.99 * gap / 0.08
    ancf2d.solve(case)


@pytest.mark.slow_rows("cable", "reissner3")
@pytest.mark.parametrize("kind", ["cable", "reissner3", "vallejo"])
def test_statics_end_if_the_pivot_of_a_section_enters_the_floor(kind):
    """The face there meets the floor before, and turns about the moved point."""
    gap, way = 0.05, 0.08
    down = {"type": "prescribed", "at": "rod@1", "ux": 0, "uy": {"type": "ramp", "scale": -way}}
    case = scene({"rod": body(kind)}, [{"type": "clamp", "at": "rod@0"}, down], "surface", "",
                 solver={"type": "static"})
    case["obstacles"]["floor"]["through"] = [0, -gap]
    with pytest.raises(ComputationError, match="supports or joints press rod into floor at S = 1,") as error:
        ancf2d.solve(case)
    assert float(error.value.failure.at["factor"]) == pytest.approx(gap / way, rel=1e-4)
