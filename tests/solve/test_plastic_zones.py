"""Meshes too coarse for plastic zones give a warning with their error, and others do not."""

from __future__ import annotations

import re
from typing import Any

import helpers as h
import pytest

import ancf2d

E, YIELD, HEIGHT, WIDTH = 2e11, 250e6, 0.1, 0.05
# moment at which the outermost fibre yields, and the fully plastic one
FIRST, PLASTIC = YIELD * WIDTH * HEIGHT**2 / 6, YIELD * WIDTH * HEIGHT**2 / 4
HARDENING = {"none": {}, "isotropic": {"hardening": {"isotropic": 2e9}},
             "kinematic": {"hardening": {"kinematic": 2e10}}}
TYPES = {"reissner2": None, "reissner3": None, "cable": None, "omar": "structural", "kerkkanen": "structural",
         "vallejo": "structural", "li": "structural"}
CLAMP = [{"type": "clamp", "at": "beam@0"}]
TIP = {"probes": {"tip": "beam@1"}}


def told(outcome: Any) -> float | None:
    """Return the error in the warning about plastic zones, if there is one."""
    found = [re.search(r"yields, most .* an error of about (\S+) %", w) for w in outcome.warnings]
    return next((float(match[1]) / 100 for match in found if match is not None), None)


def rod(kind: str, count: int, hardening: str, end: tuple[float, float] = (1.0, 0.0), start: Any = (0.0, 0.0)) -> Any:
    material = {"E": E, "nu": 0.3, "rho": 7850, "yield": YIELD, **HARDENING[hardening]}
    return {"geometry": {"type": "line", "start": [*start], "end": [*end]}, "material": material,
            "section": {"height": HEIGHT, "width": WIDTH}, "element": h.element(kind, count, TYPES[kind])}


def cantilever(kind: str, count: int, hardening: str, *loads: Any, **solver: Any) -> Any:
    return ancf2d.solve(h.load({"beam": rod(kind, count, hardening)}, {"type": "static", "steps": 4, **solver},
                               bc=CLAMP, loads=list(loads), output=TIP))


def check(error: float, said: float | None) -> None:
    """Check that there is a warning above an error of 1 %, none below 0.1 %, with at least a quarter of the error."""
    assert said is not None or error < 0.01
    assert said is None or (error > 1e-3 and said > error / 4)


@pytest.mark.parametrize(("kind", "hardening"), h.chosen(
    [(kind, hardening) for kind in TYPES for hardening in HARDENING],
    [("reissner2", "kinematic"), ("reissner3", "none"), ("cable", "isotropic"), ("omar", "none")]))
def test_the_error_of_a_cantilever_with_a_plastic_zone_is_reported(kind: str, hardening: str) -> None:
    """The moment at its clamp is 1.4 times that of first yield: the zone is 0.29 of its length."""
    def tip(count: int) -> tuple[float, float | None]:
        outcome = cantilever(kind, count, hardening, {"type": "force", "at": "beam@1", "value": [0, -1.4 * FIRST]})
        return outcome.course["tip"]["uy"][-1], told(outcome)

    limit, said = tip(64)
    assert said is None
    for count in (2, 4, 8, 16):
        value, said = tip(count)
        check(abs(value / limit - 1.0), said)


@pytest.mark.parametrize("kind", h.chosen(list(TYPES), ["reissner2", "cable"]))
def test_uniform_bending_is_resolved_by_one_element(kind: str) -> None:
    """Plastic strains are uniform, whatever their size."""
    outcome = cantilever(kind, 1 if kind != "omar" else 2, "none",
                         {"type": "moment", "at": "beam@1", "value": 1.35 * FIRST})
    assert told(outcome) is None


def test_a_bar_that_yields_both_ways_is_resolved_by_one_element() -> None:
    """After a cycle of strains, plastic and elastic ones cancel: the displacement is no measure of the error."""
    pull = {"type": "prescribed", "at": "beam@1", "ux": {"type": "table", "t": [0, 0.5, 1], "value": [0, 0.003, 0]}}
    outcome = ancf2d.solve(h.load({"beam": rod("reissner3", 2, "isotropic")}, {"type": "static", "steps": 4},
                                  bc=[*CLAMP, pull], output=TIP))
    assert told(outcome) is None


def test_a_zone_between_stations_is_reported() -> None:
    """Under 1.3 times the moment of first yield, the middle of the first of two elements has 0.975 times it."""
    load = {"type": "force", "at": "beam@1", "value": [0, -1.3 * FIRST]}
    assert told(cantilever("reissner2", 2, "none", load)) > 0.02
    assert told(cantilever("reissner2", 2, "none", {**load, "value": [0, -0.95 * FIRST]})) is None


@pytest.mark.parametrize(("height", "force", "zone"), [("0.1 - 0.05*s", (1.04 * 0.05 * WIDTH * YIELD, 0), True),
                                                      ("0.1 - 0.05*s", (0.96 * 0.05 * WIDTH * YIELD, 0), False),
                                                      ("0.05 + 0.05*s", (0, -0.3 * FIRST), True),
                                                      ("0.1 - 0.05*s", (0, -0.9 * FIRST), False)])
def test_ends_yield_like_their_own_sections(height: str, force: tuple[float, float], zone: bool) -> None:
    """The section at the end of a body differs from that of its stations: beam of two elements, pulled or bent."""
    beam = {**rod("reissner2", 2, "isotropic"), "section": {"height": height, "width": WIDTH}}
    done = ancf2d.solve(h.load({"beam": beam}, {"type": "static", "steps": 4}, bc=CLAMP, output=TIP,
                               loads=[{"type": "force", "at": "beam@1", "value": [*force]}]))
    assert (told(done) is not None) == zone


def test_a_stretch_of_one_element_is_not_continued_from_its_other_end() -> None:
    """A force at a third of a body of two elements, which is divided there: only the clamp yields."""
    beam = rod("reissner2", 2, "isotropic")
    beam["element"]["nodes"] = "acting"
    load = {"type": "force", "at": "beam@0.33", "value": [0, -1.4 / 0.33 * FIRST]}
    done = ancf2d.solve(h.load({"beam": beam}, {"type": "static", "steps": 4}, bc=CLAMP, output=TIP, loads=[load]))
    assert told(done) > 0.1


def test_the_warning_names_the_largest_error_and_a_sufficient_count() -> None:
    load = {"type": "force", "at": "beam@1", "value": [0, -1.4 * FIRST]}
    (warning,) = [w for w in cantilever("reissner3", 4, "none", load).warnings if "yields" in w]
    assert "bodies.beam yields, most from S = 0 to 0.25:" in warning
    count = int(re.search(r"about (\d+) elements", warning)[1])
    assert count > 4
    assert told(cantilever("reissner3", count, "none", load)) is None


def test_a_mesh_of_a_required_accuracy_gives_no_warning() -> None:
    """Eight elements have 0.1 % of error, less than requested, and the series of meshes shows it."""
    case = {"loads": [{"type": "force", "at": "beam@1", "value": [0, -1.4 * FIRST]}], "bc": CLAMP, "output": TIP,
            "goal": {"probe": "tip", "quantity": "uy"}}
    beam, solver = rod("reissner3", 8, "none"), {"type": "static", "steps": 4}
    # all of the required error is for the mesh
    bodies = {"beam": {**beam, "element": {**beam["element"], "fibres": 16}}}
    assert told(ancf2d.solve(h.load(bodies, solver, **case))) == pytest.approx(0.006, abs=2e-3)
    done = ancf2d.solve(h.load(bodies, solver, **case, accuracy=1e-2))
    assert done.accuracy["elements"] == {"beam": 8}
    assert told(done) is None


@pytest.mark.parametrize("kind", ["reissner3", "cable"])
def test_an_unloaded_body_is_judged_by_its_plastic_strains(kind: str) -> None:
    """The remaining deflection is plastic: no force is left."""
    load = {"type": "force", "at": "beam@1", "value": [0, -1.4 * FIRST],
            "amplitude": {"type": "table", "t": [0, 0.5, 1], "value": [0, 1, 0]}}
    found = {count: cantilever(kind, count, "kinematic", load) for count in (4, 32, 128)}
    limit = found[128].course["tip"]["uy"][-1]
    for count, outcome in found.items():
        check(abs(outcome.course["tip"]["uy"][-1] / limit - 1.0) if count < 128 else 0.0, told(outcome))


def portal(kind: str, count: int, hardening: str, factor: float, **solver: Any) -> Any:
    """Run a frame of 1.5 m by 2 m under a share of the collapse load with hinges in all corners."""
    tall, wide = 1.5, 2.0
    ends = {"left": ((0, tall), (0, 0)), "beam": ((wide, tall), (0, tall)), "right": ((wide, tall), (wide, 0))}
    bodies = {name: rod(kind, count, hardening, *both) for name, both in ends.items()}
    joints = [{"type": "weld", "between": ["left@1", "beam@0"]}, {"type": "weld", "between": ["beam@1", "right@1"]}]
    return ancf2d.solve(h.load(bodies, {"type": "static", **solver},
                           bc=[{"type": "clamp", "at": "left@0"}, {"type": "clamp", "at": "right@0"}], joints=joints,
                           loads=[{"type": "force", "at": "left@1", "value": [factor * 4 * PLASTIC / tall, 0]}],
                           output={"probes": {"corner": "left@1"}}))


@pytest.mark.parametrize(("kind", "factor"), h.chosen(
    [(kind, factor) for kind in ("reissner3", "cable", "vallejo") for factor in (0.75, 0.9)],
    [("reissner3", 0.9)]))
def test_the_error_of_a_portal_frame_is_reported(kind: str, factor: float) -> None:
    def sway(count: int) -> tuple[float, float | None]:
        outcome = portal(kind, count, "isotropic", factor, steps=4)
        return outcome.course["corner"]["ux"][-1], told(outcome)

    limit, _ = sway(64)
    for count in (4, 8, 16):
        value, said = sway(count)
        check(abs(value / limit - 1.0), said)


@pytest.mark.parametrize(("kind", "hardening"), h.chosen(
    [*(("reissner3", hardening) for hardening in HARDENING), ("vallejo", "kinematic")], [("reissner3", "isotropic")]))
def test_at_the_end_of_a_path_the_error_of_its_load_is_reported(kind: str, hardening: str) -> None:
    """Rotations of plastic hinges follow from displacements; the load hardly depends on the length of their zones."""
    def load(count: int) -> tuple[float, float | None]:
        until = {"probe": "corner", "quantity": "ux", "reaches": 2.5 * YIELD / E * 1.5**2 / HEIGHT}
        outcome = portal(kind, count, hardening, 1.0, method="arc_length", until=until)
        return outcome.course_t[-1], told(outcome)

    limit, _ = load(48)
    for count in (4, 12):
        value, said = load(count)
        check(abs(value / limit - 1.0), said)


@pytest.mark.parametrize("kind", h.chosen(["reissner3", "cable", "vallejo"], ["reissner3"]))
def test_the_error_of_a_permanent_bend_after_a_motion_is_reported(kind: str) -> None:
    """A load is applied within a tenth of a period, 12 ms, and removed after 1.2: the cantilever stays bent."""
    def tip(count: int) -> tuple[float, float | None]:
        amplitude = {"type": "table", "t": [0, 1.2e-3, 14.7e-3, 15.9e-3], "value": [0, 1, 1, 0]}
        force = {"type": "force", "at": "beam@1", "value": [0, -0.72 * FIRST], "amplitude": amplitude}
        outcome = ancf2d.solve(h.load(
            {"beam": rod(kind, count, "kinematic")},
            {"type": "dynamic", "t_end": 0.0245, "dt": 5e-4, "estimate": False, "method": "generalized_alpha"},
            bc=CLAMP, loads=[force], output={**TIP, "interval": 0.0245}))
        return outcome.course["tip"]["uy"][-1], told(outcome)

    limit, said = tip(64)
    assert said is None
    for count in (4, 16):
        value, said = tip(count)
        check(abs(value / limit - 1.0), said)
