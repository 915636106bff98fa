"""Models held only by gravity: ropes, chains and pendulums come to rest from any start."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import jn_zeros

from ancf2d.case import load_case_text
from ancf2d.errors import CaseError
from ancf2d.solvers.statics import hanging as hanging_module
from ancf2d.study.run import run_case, vocabulary

G = 9.81
GRAVITY = [{"type": "gravity", "value": [0, -G]}]
PIN = {"name": "top", "type": "pin", "at": "l0@0"}
ROPE = {"EA": 1e6, "kGA": 1e6, "EI": 1e-6, "rhoA": 1.0}


def solved(folder: Path, **case: Any) -> dict[str, Any]:
    text = json.dumps({"loads": GRAVITY, "solver": {"type": "static"}, **case})
    outcome = run_case(load_case_text(text, vocabulary=vocabulary()), str(folder / "a.h5"), force=True)
    assert outcome.failure is None, outcome.failure
    return outcome.summary


def chain(links: int, angle: float, element: dict[str, Any], length: float = 1.0) -> dict[str, Any]:
    """Return a straight chain of pinned links that hangs from its first one, initially at an angle."""
    ends = [[length * k / links * math.cos(angle), length * k / links * math.sin(angle)] for k in range(links + 1)]
    bodies = {f"l{k}": {"geometry": {"type": "line", "start": ends[k], "end": ends[k + 1]}, "element": element,
                        "section": {"EA": 1e6, "kGA": 1e6, "EI": 1.0, "rhoA": 1.0, "rhoI": 1e-4}}
              for k in range(links)}
    return {"bodies": bodies, "boundary_conditions": [PIN],
            "joints": [{"type": "pin", "between": [f"l{k}@1", f"l{k + 1}@0"]} for k in range(links - 1)],
            "output": {"probes": {"tip": f"l{links - 1}@1"}}}


def rope(geometry: dict[str, Any], count: int = 32, **section: float) -> dict[str, Any]:
    body = {"geometry": geometry, "section": {**ROPE, **section}, "element": {"type": "cable", "count": count}}
    return {"bodies": {"l0": body}, "boundary_conditions": [PIN],
            "output": {"probes": {"tip": "l0@1", "mid": "l0@0.5"}}}


def line(angle: float) -> dict[str, Any]:
    return {"type": "line", "start": [0, 0], "end": [math.cos(angle), math.sin(angle)]}


@pytest.mark.parametrize("element", [{"type": "rigid"}, {"type": "reissner3", "count": 2}], ids=lambda e: e["type"])
@pytest.mark.parametrize(("links", "angle"), [(1, 0.0), (1, 1.5), (5, 0.3), (5, 3.0)])
def test_chains_hang_below_their_pin_from_any_angle(tmp_path: Path, element: dict[str, Any], links: int,
                                                    angle: float) -> None:
    found = solved(tmp_path, **chain(links, angle, element))
    tip, top = found["probes"]["tip"], found["reactions"]["top"]
    # a hanging bar of weight w L is longer by w L^2/(2 EA)
    stretch = 0.0 if element["type"] == "rigid" else G / 2e6
    assert (tip["x"], tip["y"]) == pytest.approx((0, -1 - stretch), abs=1e-7)
    assert (top["fx"], top["fy"]) == pytest.approx((0, G), abs=1e-6)
    assert (found["warnings"], found["negative_pivots"]) == ([], 0)


@pytest.mark.slow_rows("rope")
@pytest.mark.parametrize("case", [chain(1, math.pi / 2, {"type": "rigid"}), chain(3, math.pi / 2, {"type": "rigid"}),
                                  rope(line(math.pi / 2), count=8, EI=1e-4)], ids=["pendulum", "chain", "rope"])
def test_an_upright_start_is_called_unstable(tmp_path: Path, case: dict[str, Any]) -> None:
    found = solved(tmp_path, **case)
    assert found["probes"]["tip"]["y"] == pytest.approx(-1, abs=1e-4)
    (said,) = found["warnings"]
    links = len(case["bodies"])
    assert "next to an unstable equilibrium (negative pivots: " in said
    assert links == 1 or f"negative pivots: {links})" in said  # each link may fall to its side


def test_a_rope_from_any_start_swings_with_the_frequencies_of_bernoulli(tmp_path: Path) -> None:
    """j/2 sqrt(g/L), j the zeros of J0; transverse although the initial rope was along x."""
    case = rope(line(0.0), EA=1e8, kGA=1e8)
    found = solved(tmp_path, **{**case, "solver": {"type": "eigen", "about": "static", "modes": 2}})
    omega = [f["omega"] for f in found["frequencies"]]
    np.testing.assert_allclose(omega, jn_zeros(0, 2) / 2 * math.sqrt(G), rtol=1e-5)
    assert [f["kind"] for f in found["frequencies"]] == ["bending", "bending"]


def catenary(length: float, span: float, EA: float) -> tuple[float, float]:
    """Return the horizontal force and the sag of an elastic catenary of unit mass per length (Irvine 1981)."""
    def gap(H: float) -> float:
        return H * length / EA + 2 * H / G * math.asinh(G * length / 2 / H) - span

    H = brentq(gap, 1e-6, 1e3, xtol=1e-13)
    V = G * length / 2
    return H, H / G * (math.sqrt(1 + (V / H) ** 2) - 1) + V * V / (2 * EA * G)


@pytest.mark.parametrize("to", [2 * math.pi, pytest.param(0.0, marks=pytest.mark.slow)], ids=["below", "above"])
def test_a_rope_between_two_points_is_a_catenary(tmp_path: Path, to: float) -> None:
    """Initially half a circle below its ends, or above them, from where it must fall."""
    arc = {"type": "arc", "center": [0, 0], "radius": 0.5, "from": math.pi, "to": to}
    case = rope(arc, count=64, EI=1e-7)
    case["boundary_conditions"] = [PIN, {"name": "end", "type": "pin", "at": "l0@1"}]
    case["output"]["probes"]["start"] = "l0@0"
    found = solved(tmp_path, **case)
    H, sag = catenary(math.pi / 2, 1.0, 1e6)
    end = found["reactions"]["end"]
    assert (end["fx"], end["fy"]) == pytest.approx((H, G * math.pi / 4), rel=1e-6)
    mid, start = found["probes"]["mid"], found["probes"]["start"]
    assert mid["y"] == pytest.approx(-sag, rel=1e-6)
    # the middle of what is symmetric turns to no side, and theta has no jump from there to an end
    drawn = -math.pi / 2 if to else math.pi / 2
    assert mid["theta"] == pytest.approx(0.0, abs=1e-6)
    assert start["theta"] == pytest.approx(-math.atan2(G * math.pi / 4, H) - drawn, abs=1e-3)
    assert ["sinks from" in w for w in found["warnings"]] == ([True] if to == 0.0 else [])


def test_a_rope_with_approaching_ends_sags_to_a_catenary(tmp_path: Path) -> None:
    case = rope(line(0.0), count=40)
    case["boundary_conditions"] = [PIN, {"name": "end", "type": "prescribed", "at": "l0@1", "uy": 0,
                                         "ux": {"type": "ramp", "scale": -0.4}}]
    found = solved(tmp_path, **case)
    H, sag = catenary(1.0, 0.6, 1e6)
    assert found["reactions"]["end"]["fx"] == pytest.approx(H, rel=1e-4)
    assert found["probes"]["mid"]["y"] == pytest.approx(-sag, rel=1e-4)


def test_collinear_bars_give_way_when_their_end_moves_in(tmp_path: Path) -> None:
    """Two bars of half the length each: moments about the joint give the horizontal force."""
    case = chain(2, 0.0, {"type": "rigid"})
    end = {"name": "end", "type": "prescribed", "at": "l1@1", "uy": 0, "ux": {"type": "ramp", "scale": -0.4}}
    case["boundary_conditions"] = [PIN, end]
    found = solved(tmp_path, **case)
    assert found["reactions"]["end"]["fx"] == pytest.approx((G / 2 * 0.3 - G / 2 * 0.15) / 0.4, rel=1e-9)
    assert found["probes"]["tip"]["theta"] == pytest.approx(math.acos(0.6), rel=1e-9)


@pytest.mark.slow_rows("20", "22", "30")
@pytest.mark.parametrize("links", [12, 20, 22, 30])
def test_chains_drawn_level_sag_where_their_end_moves_in(tmp_path: Path, links: int) -> None:
    """Links of weight w: moments about the joints of one, n links from the middle, give tan(theta) = n w/H."""
    case = chain(links, 0.0, {"type": "rigid"})
    case["boundary_conditions"] = [PIN, {"name": "end", "type": "prescribed", "at": f"l{links - 1}@1", "uy": 0,
                                         "ux": {"type": "ramp", "scale": -0.2}}]
    case["output"] = {"probes": {"mid": f"l{links // 2}@0"}}
    from_middle = links / 2 - np.arange(links) - 0.5
    over_weight = brentq(lambda h: np.mean(1.0 / np.hypot(1.0, from_middle / h)) - 0.8, 1e-3, 1e3)
    slopes = from_middle / np.hypot(from_middle, over_weight)
    sag = slopes[:links // 2].sum() / links
    assert solved(tmp_path, **case)["probes"]["mid"]["y"] == pytest.approx(-sag, rel=1e-9)


@pytest.mark.slow
def test_a_load_on_a_rope_from_a_crane_starts_to_move_from_rest(tmp_path: Path) -> None:
    """Three bodies: nothing moves from the static state, which is found from a level start."""
    steel = {"material": {"E": 2e11, "nu": 0.3, "rho": 7850}, "section": {"height": 0.1, "width": 0.1}}
    bodies = {
        "boom": {"geometry": {"type": "line", "start": [0, 0], "end": [3, 1]}, **steel,
                 "element": {"type": "reissner3", "count": 2}},
        "rope": {"geometry": {"type": "line", "start": [3, 1], "end": [4.5, 1]}, "section": {**ROPE, "EI": 1e-3},
                 "element": {"type": "cable", "count": 6}},
        "load": {"geometry": {"type": "line", "start": [4.5, 1], "end": [4.8, 1]}, **steel,
                 "element": {"type": "rigid"}}}
    joints = [{"type": "pin", "between": ["boom@1", "rope@0"]}, {"type": "pin", "between": ["rope@1", "load@0"]}]
    foot = {"type": "clamp", "at": "boom@0", "name": "foot"}
    case = {"bodies": bodies, "joints": joints, "boundary_conditions": [foot],
            "output": {"probes": {"hook": "rope@1", "head": "boom@1"}}}
    still = solved(tmp_path, **case)
    weight = G * (7850 * 0.01 * (math.sqrt(10) + 0.3) + 1.5)
    assert still["reactions"]["foot"]["fy"] == pytest.approx(weight, rel=1e-9)
    assert still["probes"]["hook"]["x"] == pytest.approx(still["probes"]["head"]["x"], abs=1e-8)
    moving = solved(tmp_path, **case, initial={"from": "static"}, **{"solver": {"type": "dynamic", "t_end": 0.2}})
    hook = moving["probes"]["hook"]
    assert (hook["x"], hook["y"]) == pytest.approx([still["probes"]["hook"][k] for k in "xy"], abs=1e-7)
    assert math.hypot(hook["vx"], hook["vy"]) < 1e-6


BAR = {"geometry": {"type": "line", "start": [0, -1], "end": [0, -1.5]},
       "element": {"type": "rigid", "mass": 40.0, "inertia": 1.0}}


@pytest.mark.parametrize("elastic", ["spring", "tendon"])
@pytest.mark.parametrize("x", [0.0, 0.5])
def test_a_bar_hangs_on_a_spring_or_tendon_alone(tmp_path: Path, elastic: str, x: float) -> None:
    """It hangs below the hook, and swings as a double pendulum whose upper arm is the spring."""
    k, m, a, inertia = 1e4, 40.0, 0.25, 1.0
    case: dict[str, Any] = {"bodies": {"bar": BAR}, "output": {"probes": {"top": "bar@0"}}}
    if elastic == "spring":
        case["springs"] = [{"type": "translational", "between": [[x, 0], "bar@0"], "stiffness": k}]
        l0, rate = math.hypot(x, 1.0), k
    else:
        case["loads"] = [*GRAVITY, {"type": "tendon", "through": [[x, 0], "bar@0"], "stiffness": k}]
        l0, rate = math.hypot(x, 1.0), k / math.hypot(x, 1.0)
    length = l0 + m * G / rate
    top = solved(tmp_path, **case)["probes"]["top"]
    assert [top["x"], top["y"]] == pytest.approx([x, -length], abs=1e-7)
    found = solved(tmp_path, **case, solver={"type": "eigen", "modes": 3, "about": "static"})["frequencies"]
    K = np.diag([m * G / length, rate, m * G * a])
    M = np.array([[m, 0.0, m * a], [0.0, m, 0.0], [m * a, 0.0, inertia + m * a * a]])
    assert [f["omega"] for f in found] == pytest.approx(np.sqrt(eigh(K, M)[0]), rel=1e-6)


def test_hanging_bodies_bear_the_bodies_below(tmp_path: Path) -> None:
    rope = {"geometry": {"type": "line", "start": [0.1, -2], "end": [0.1, -3]},
            "section": {"EA": 1e5, "EI": 10.0, "rhoA": 5.0}, "element": {"type": "cable", "count": 2}}
    k, below = 1e4, math.hypot(0.1, 0.5)
    springs = [{"type": "translational", "between": pair, "stiffness": k}
               for pair in ([[0, 0], "bar@0"], ["bar@1", "rope@0"])]
    found = solved(tmp_path, bodies={"bar": BAR, "rope": rope}, springs=springs, output={"probes": {"end": "rope@1"}})
    y = -(1.0 + 45.0 * G / k) - 0.5 - (below + 5.0 * G / k) - (1.0 + 5.0 * G / 2e5)
    assert [found["probes"]["end"][q] for q in "xy"] == pytest.approx([0.0, y], abs=1e-7)


@pytest.mark.parametrize("hook", [[0, -3], [2, -1]])
def test_a_spring_below_or_beside_a_body_does_not_hold_it(tmp_path: Path, hook: list[float]) -> None:
    with pytest.raises(CaseError, match="'bar' is free to move along"):
        solved(tmp_path, bodies={"bar": BAR}, springs=[
            {"type": "translational", "between": [hook, "bar@0"], "stiffness": 1e4}])


def test_sliding_and_falling_bodies_are_refused(tmp_path: Path) -> None:
    case = rope(line(0.0), count=2)
    for supports, said in (([], "'l0' is free to move along"),
                           ([{"type": "roller", "fixed": "y", "at": "l0@0"}], r"'l0' is free to move along \(1, 0\)")):
        with pytest.raises(CaseError, match=said):
            solved(tmp_path, **{**case, "boundary_conditions": supports})
    for other in ({"loads": []}, {"solver": {"type": "linear_static"}},
                  {"solver": {"type": "static", "method": "arc_length"}}):
        with pytest.raises(CaseError, match=r"'l0' is free to turn about \(0, 0\)"):
            solved(tmp_path, **{**case, **other})


def test_neutral_equilibria_are_refused(tmp_path: Path) -> None:
    bar = chain(1, 0.0, {"type": "rigid"})
    bar["boundary_conditions"] = [{"type": "pin", "at": "l0@0.5"}]
    text = json.dumps({"loads": GRAVITY, "solver": {"type": "static"}, **bar})
    outcome = run_case(load_case_text(text, vocabulary=vocabulary()), str(tmp_path / "a.h5"))
    assert outcome.failure is not None
    assert "has no stiffness" in str(outcome.failure)


def test_newtons_method_is_tried_seldom_while_a_rope_falls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    relaxation, tries = hanging_module._Relaxation, []
    newton = relaxation._newton

    def counted(self: Any, rests: bool) -> Any:
        tries.append(self.steps)
        return newton(self, rests)

    monkeypatch.setattr(relaxation, "_newton", counted)
    half_circle = {"type": "arc", "center": [0, 0], "radius": 0.5, "from": math.pi, "to": 0}
    scene = rope(half_circle, 60, EI=1e-7) | {"boundary_conditions": [
        {"type": "pin", "at": "l0@0"}, {"type": "pin", "at": "l0@1"}]}
    solved(tmp_path, **scene)
    # hundreds of steps are shorter than those after which an equilibrium may be near
    assert tries[-1] > 150
    assert len(tries) < 0.15 * tries[-1]
