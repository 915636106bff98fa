"""Plastic hinges: collapse loads of frames with fibres, compared with limit analysis (Neal 1977)."""

from __future__ import annotations

from typing import Any

import helpers as h
import numpy as np
import pytest

import ancf2d
from ancf2d.errors import ComputationError

E, YIELD, HEIGHT, WIDTH, LENGTH = 2e11, 250e6, 0.1, 0.05, 1.0
FIRST = YIELD / E
# moment at which the outermost fibre yields
MOMENT = YIELD * WIDTH * HEIGHT**2 / 6
STEEL = {"E": E, "nu": 0.3, "yield": YIELD}
TYPES = [("reissner3", None), ("cable", None), ("vallejo", "structural")]


@pytest.mark.parametrize("method", ["arc_length", "displacement"])
def test_paths_reach_the_collapse_load(method: str) -> None:
    """P L = 3/2 M_y: a hinge forms in the clamped section, a station; 16 fibres add 0.3 %."""
    body = {"geometry": h.line(LENGTH), "element": h.element("reissner3", 4), "material": STEEL,
            "section": {"height": HEIGHT, "width": WIDTH}}
    done = ancf2d.solve(h.load(
        {"beam": body}, {"type": "static", "method": method, "until": {"probe": "tip", "quantity": "uy",
                                                                       "reaches": -0.04}},
        bc=[{"type": "clamp", "at": "beam@0"}], output={"probes": {"tip": "beam@1"}},
        loads=[{"type": "force", "at": "beam@1", "value": [0, -MOMENT / LENGTH]}]))
    assert done.course_t[-1] == pytest.approx(1.5, rel=5e-3)
    # a path that turned back would unload
    assert np.all(np.diff(done.course["tip"]["uy"]) < 0.0)


@pytest.mark.parametrize(("kind", "share"), h.chosen([("cable", 1 / 3), ("reissner2", 1 / 2)], ["reissner2"]))
def test_hinges_away_from_nodes_give_a_warning(kind: str, share: float) -> None:
    """The hinge of a cantilever lies a share of an element from its clamp: P (1 - share/n) L = 3/2 M_y."""
    body = {"geometry": h.line(LENGTH), "element": h.element(kind, 4), "material": STEEL,
            "section": {"height": HEIGHT, "width": WIDTH}}
    done = ancf2d.solve(h.load(
        {"beam": body}, {"type": "static", "method": "arc_length", "until": {"probe": "tip", "quantity": "uy",
                                                                             "reaches": -0.06}},
        bc=[{"type": "clamp", "at": "beam@0"}], output={"probes": {"tip": "beam@1"}},
        loads=[{"type": "force", "at": "beam@1", "value": [0, -MOMENT / LENGTH]}]))
    assert done.course_t[-1] * (1.0 - share / 4) == pytest.approx(1.5, rel=5e-3)
    assert any("reissner3 or vallejo, whose hinges are at the nodes" in w for w in done.warnings)


@pytest.mark.parametrize(("kind", "height"), [(TYPES[0], 0.2), *(
    pytest.param(kind, height, marks=pytest.mark.slow) for kind, height in (
        (TYPES[0], 0.1), (TYPES[0], 0.05), (TYPES[2], 0.1)))])
def test_portal_frames_collapse_with_hinges_in_all_corners(kind: tuple[str, str | None], height: float) -> None:
    """P h cos(sway) = 4 M_p of clamped columns h under a beam, within 1 % with eight elements each (Neal 1977)."""
    tall, wide, plastic = 3.0, 4.0, 0.25 * YIELD * WIDTH * height**2
    rod = {"section": {"height": height, "width": WIDTH}, "material": STEEL, "element": h.element(kind[0], 8, kind[1])}
    ends = {"left": ([0, 0], [0, tall]), "beam": ([0, tall], [wide, tall]), "right": ([wide, 0], [wide, tall])}
    # more than three times the sway at which an elastic frame would yield
    sway = 2.5 * FIRST * tall**2 / height
    done = ancf2d.solve(h.load(
        {name: {"geometry": {"type": "line", "start": a, "end": b}, **rod} for name, (a, b) in ends.items()},
        {"type": "static", "method": "arc_length", "until": {"probe": "corner", "quantity": "ux", "reaches": sway}},
        bc=[{"type": "clamp", "at": "left@0"}, {"type": "clamp", "at": "right@0"}],
        joints=[{"type": "weld", "between": ["left@1", "beam@0"]}, {"type": "weld", "between": ["beam@1", "right@1"]}],
        loads=[{"type": "force", "at": "left@1", "value": [4.0 * plastic / tall, 0]}],
        output={"probes": {"corner": "left@1"}}))
    turned = np.arcsin(done.course["corner"]["ux"][-1] / tall)
    assert done.course_t[-1] * np.cos(turned) == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize("at", [0.25, 0.5])
def test_a_clamped_beam_collapses_with_a_hinge_under_its_load(at: float) -> None:
    """P = 2 M_p/(a (1 - a) L) of a load at a L (Neal 1977), with hinges on both sides of the loaded node."""
    load = 2.0 * 0.25 * YIELD * WIDTH * HEIGHT**2 / (at * (1.0 - at) * 2.0)
    done = ancf2d.solve(h.load(
        {"beam": {"geometry": h.line(2.0), "section": {"height": HEIGHT, "width": WIDTH}, "material": STEEL,
                  "element": h.element("reissner3", 8)}},
        {"type": "static", "method": "arc_length", "until": {"probe": "load", "quantity": "uy", "reaches": -0.04}},
        bc=[{"type": "clamp", "at": "beam@0"}, {"type": "prescribed", "at": "beam@1", "uy": 0, "angle": 0}],
        loads=[{"type": "force", "at": f"beam@{at:g}", "value": [0, -load]}],
        output={"probes": {"load": f"beam@{at:g}"}}))
    assert done.course_t[-1] == pytest.approx(1.0, rel=0.01)


def two_spans(elements: int, height: float, reaches: float) -> Any:
    """Push a perfectly plastic beam over two spans of 0.5 m by 6 M_p over a span in the middle of one span."""
    load = 6.0 * 0.25 * YIELD * WIDTH * height**2 / 0.5
    return ancf2d.solve(h.load(
        {"beam": {"geometry": h.line(1.0), "section": {"height": height, "width": WIDTH}, "material": STEEL,
                  "element": h.element("vallejo", elements, "structural")}},
        {"type": "static", "method": "arc_length", "until": {"probe": "load", "quantity": "uy", "reaches": reaches}},
        bc=[{"type": "pin", "at": "beam@0"}, *({"type": "roller", "at": p, "normal": [0, 1]}
                                               for p in ("beam@0.5", "beam@1"))],
        loads=[{"type": "force", "at": "beam@0.25", "value": [0, -load]}], output={"probes": {"load": "beam@0.25"}}))


@pytest.mark.slow
def test_a_path_continues_with_a_hinge_shared_by_two_elements() -> None:
    """P = 6 M_p/L (Neal 1977), and far beyond: round-off does not decide how a node between two hinges turns."""
    done = two_spans(32, 0.05, -0.08)
    assert done.course_t.max() == pytest.approx(1.0, rel=5e-3)
    assert done.course["load"]["uy"][-1] == pytest.approx(-0.08, rel=1e-9)


def test_hinges_that_turn_too_far_within_an_element_give_a_warning() -> None:
    with pytest.raises(ComputationError, match="plastic hinges have no stiffness"):
        two_spans(2, 0.1, -0.2)


def test_over_time_a_bar_bears_no_more_than_its_yield_stress() -> None:
    """sigma = 1.25 t yield: steps become shorter up to t = 0.8, beyond which there is no equilibrium."""
    body = {"geometry": h.line(LENGTH), "element": h.element("reissner3", 1), "material": STEEL,
            "section": {"height": HEIGHT, "width": WIDTH}}
    pull = {"type": "force", "at": "beam@1", "value": [1.25 * YIELD * WIDTH * HEIGHT, 0],
            "amplitude": {"type": "ramp", "t1": 1}}
    with pytest.raises(ComputationError, match=r"no equilibrium was found beyond t = 0\.8: ") as error:
        ancf2d.solve(h.load({"beam": body}, {"type": "quasi_static", "t_end": 1}, loads=[pull],
                            bc=[{"type": "clamp", "at": "beam@0"}]))
    assert "limit load" in error.value.failure.advice


def test_paths_continue_if_all_fibres_of_a_bar_yield_at_once() -> None:
    """A flat truss bears 2 A s_y sin a once its bars yield, half at each end: its path has a corner there.

    Without hardening the load falls at once.
    """
    area, depth = 1e-4, 0.05

    def bar(start: list[float], end: list[float]) -> dict[str, Any]:
        return {"geometry": {"type": "line", "start": start, "end": end}, "section": {"height": 0.01, "width": 0.01},
                "material": STEEL, "element": h.element("cable", 1)}

    done = ancf2d.solve({
        "bodies": {"left": bar([0, 0], [1, 0.1]), "right": bar([1, 0.1], [2, 0])},
        "boundary_conditions": [{"name": "base", "type": "pin", "at": "left@0"}, {"type": "pin", "at": "right@1"}],
        "joints": [{"type": "pin", "between": ["left@1", "right@0"]}],
        "loads": [{"type": "force", "at": "left@1", "value": [0, -1000]}],
        "solver": {"type": "static", "method": "arc_length",
                   "until": {"probe": "top", "quantity": "uy", "reaches": depth - 0.1}},
        "goal": {"reaction": "base", "quantity": "fy"}, "output": {"probes": {"top": "left@1"}}}, states=False)
    assert done.value == pytest.approx(area * YIELD * depth / np.hypot(1.0, depth), rel=1e-9)
