"""Warnings of meshes that are too coarse, with their error, compared with the limits of the same elements."""

from __future__ import annotations

import math
import re
from typing import Any

import helpers
import pytest
from scipy.optimize import brentq

from ancf2d.case import LoadedCase
from ancf2d.solvers import resolution
from ancf2d.study.run import Outcome, run_case

COUNTS = (1, 2, 4, 8)
LIMIT = 64
SECTION = {"height": 0.1, "width": 0.1}
TIP = [{"type": "force", "at": "b@1", "value": [0, -4e5]}]


def said(outcome: Outcome) -> list[str]:
    return [w for w in outcome.warnings if "mesh is too coarse" in w]


def cantilever(name: str, count: int, solver: Any, **scene: Any) -> LoadedCase:
    body = helpers.body(helpers.line(2.0), helpers.element(name, count), SECTION, helpers.STEEL)
    return helpers.load({"b": body}, solver, bc=[{"type": "clamp", "at": "b@0"}],
                        output={"probes": {"tip": "b@1"}}, **scene)


@helpers.covering({"name": helpers.FEW_TYPES}, name=helpers.SMALL_TYPES, solver=["linear_static", "static"])
def test_the_warning_has_the_error_of_a_deflection(name: str, solver: str) -> None:
    """A cantilever has determinate section forces: the reported error is the error, up to nonlinear effects."""
    def tip(count: int) -> tuple[float, list[str]]:
        outcome = run_case(cantilever(name, count, solver, loads=TIP))
        return outcome.summary["probes"]["tip"]["uy"], said(outcome)

    limit, _ = tip(LIMIT if "[1,2]" not in name else 16 * LIMIT)
    for count in COUNTS:
        value, warnings = tip(count)
        error = abs(1.0 - value / limit)
        if warnings:
            told = float(re.search(r"an error of about (\S+) %", warnings[0])[1]) / 100
            assert error == pytest.approx(told, rel=0.35)
        assert error < 0.1 or warnings
        assert error > 0.04 or not warnings


@helpers.every_small_type
def test_the_warning_has_the_error_of_frequencies(name: str) -> None:
    def second(count: int) -> tuple[float | None, list[str]]:
        outcome = run_case(cantilever(name, count, {"type": "eigen", "modes": 4}))
        bending = [f["omega"] for f in outcome.summary["frequencies"] if (f["kind"], f["number"]) == ("bending", 2)]
        return bending[0] if bending else None, said(outcome)

    limit, _ = second(LIMIT if "[1,2]" not in name else 16 * LIMIT)
    assert limit is not None
    for count in COUNTS[2:]:
        value, warnings = second(count)
        if value is None:
            continue
        found = re.search(r"bending 2 by about (\S+) %", "".join(warnings))
        error = abs(value / limit - 1.0)
        assert (error > 0.06) if found else (error < 0.1)
        if found and error < 0.5:
            assert error == pytest.approx(float(found[1]) / 100, rel=0.35)


def test_damped_modes_are_judged_like_undamped_ones() -> None:
    """Kelvin-Voigt damping of any size has the same shapes; omega is that of damped vibration."""
    def warnings(tau: float) -> list[str]:
        material = {**helpers.STEEL, "damping": {"kelvin_voigt": tau}}
        body = helpers.body(helpers.line(2.0), helpers.element("reissner2", 4), SECTION, material)
        case = helpers.load({"b": body}, {"type": "eigen", "modes": 2}, bc=[{"type": "clamp", "at": "b@0"}])
        return said(run_case(case))

    (undamped,), (damped,) = warnings(1e-9), warnings(1e-3)
    assert damped == undamped


def cable(count: int) -> Outcome:
    """A steel cable whose ends approach by a tenth of its length, under its own weight, of straight elements."""
    body = helpers.body(helpers.line(10.0), helpers.element("reissner2", count), {"height": 0.005, "width": 0.005},
                        helpers.STEEL)
    ends = [{"type": "pin", "at": "b@0"},
            {"type": "prescribed", "at": "b@1", "y": 0, "x": {"type": "table", "t": [0, 1], "value": [10, 9]}}]
    return run_case(helpers.load({"b": body}, {"type": "static", "steps": 20}, bc=ends,
                                 loads=[{"type": "gravity", "value": [0, -9.81]}], output={"probes": {"p": "b@0.5"}}))


def test_a_cable_in_tension_may_have_straight_elements() -> None:
    """Their bending moments are far from equilibrium, but the shape is not: tension determines it."""
    coarse, fine = cable(8), cable(64)
    assert coarse.summary["probes"]["p"]["uy"] == pytest.approx(fine.summary["probes"]["p"]["uy"], rel=0.02)
    assert not said(coarse)
    assert not said(fine)


WHIP = """
bodies:
  whip:
    geometry: {{type: line, start: [0, 0], end: [2, 0]}}
    section: {{height: 0.01, width: 0.01}}
    material: {{E: 1e7, nu: 0.3, rho: 1100}}
    element: {{type: reissner3, count: {count}}}
boundary_conditions: [{{name: hand, type: prescribed, at: whip@0, x: 0, y: 0,
                        angle: {{type: expression, value: "1.5*sin(8*t)"}}}}]
loads: [{{type: gravity, value: [0, -9.81]}}]
solver: {{type: dynamic, t_end: 1, tolerance: 1e-6}}
output: {{probes: {{tip: whip@1}}}}
"""


def whip(count: int) -> Outcome:
    from ancf2d.case import load_case_text

    return run_case(load_case_text(WHIP.format(count=count)))


@pytest.mark.slow
def test_a_whip_on_a_coarse_mesh_gives_a_warning_despite_a_small_error_of_its_steps() -> None:
    coarse, fine, limit = (whip(count) for count in (8, 32, 64))
    tip = [(o.summary["probes"]["tip"]["x"], o.summary["probes"]["tip"]["y"]) for o in (coarse, fine, limit)]
    assert abs(complex(*tip[0]) - complex(*tip[2])) > 0.03
    assert coarse.summary["accuracy"]["estimate"] < 1e-3
    (warning,) = said(coarse)
    assert "does not include this" in warning
    assert "--accuracy" in warning
    assert abs(complex(*tip[1]) - complex(*tip[2])) < 0.02
    assert not said(fine)


@pytest.mark.parametrize("angle", ["0.4*t", "3*t"])
def test_rigidly_moved_bodies_are_not_judged(angle: str) -> None:
    """Strains of a body that only rotates are round-off, whatever its section forces."""
    body = helpers.body(helpers.line(1.0), helpers.element("2d3n", 2), {"height": 0.01, "width": 0.01}, helpers.STEEL)
    turn = {"type": "expression", "value": angle}
    outcome = run_case(helpers.load({"b": body}, "static", bc=[
        {"type": "prescribed", "at": "b@0", "x": 0, "y": 0, "angle": turn}]))
    assert not said(outcome)


def buckled(count: int) -> tuple[float, list[str]]:
    loads = [{"type": "force", "at": "b@1", "value": [-1, 0]}]
    outcome = run_case(cantilever("reissner2", count, {"type": "buckling", "modes": 1}, loads=loads))
    return outcome.summary["load_factors"][0], said(outcome)


def test_a_coarse_mesh_that_raises_a_buckling_load_gives_a_warning() -> None:
    (coarse, told), (fine, silent), (limit, _) = (buckled(count) for count in (2, 16, 64))
    assert coarse / limit - 1.0 > 0.08
    assert "load factors" in told[0]
    assert fine / limit - 1.0 < 0.01
    assert not silent


@pytest.mark.parametrize("force", [-2e4, 1e6])
def test_the_warning_has_the_error_of_modes_about_a_static_state(force: float) -> None:
    """In compression and tension: tension provides a part of the stiffness, which the mesh resolves."""
    def second(count: int) -> tuple[float, list[str]]:
        loads = [{"type": "force", "at": "b@1", "value": [force, 0]}]
        outcome = run_case(cantilever("reissner2", count, {"type": "eigen", "modes": 2, "about": "static"},
                                      loads=loads))
        return outcome.summary["frequencies"][1]["omega"], said(outcome)

    (coarse, told), (_, silent), (limit, _) = (second(count) for count in (4, 16, 64))
    found = re.search(r"bending 2 by about (\S+) %", told[0])
    assert found is not None
    assert coarse / limit - 1.0 == pytest.approx(float(found[1]) / 100, rel=0.35)
    assert not silent


def test_a_coarse_body_next_to_one_of_very_many_elements_gives_a_warning() -> None:
    def warnings(count: int) -> list[str]:
        bodies = {name: helpers.body(helpers.line(2.0), helpers.element("reissner2", n), SECTION, helpers.STEEL)
                  for name, n in (("b", count), ("c", 20_000))}
        ends = [{"type": "clamp", "at": f"{name}@0"} for name in bodies]
        return said(run_case(helpers.load(bodies, "linear_static", bc=ends, loads=TIP)))

    assert "bodies.b" in warnings(1)[0]
    assert not warnings(8)


def test_a_sample_of_very_many_bodies_gives_the_same_as_one_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Identical cantilevers, of which 50 are examined, and one alone."""
    looked = []
    energies = resolution.CheckedBody.energies
    monkeypatch.setattr(resolution.CheckedBody, "energies", lambda *given: looked.append(1) or energies(*given))
    told = []
    for count in (1, 120):
        bodies = {f"b{k}": helpers.body(helpers.line(2.0), helpers.element("2d2n", 2), SECTION, helpers.STEEL)
                  for k in range(count)}
        loads = [{"type": "force", "at": f"{name}@1", "value": [0, -4e3]} for name in bodies]
        case = helpers.load(bodies, "static", bc=[{"type": "clamp", "at": f"{name}@0"} for name in bodies], loads=loads)
        (warning,) = said(run_case(case))
        told.append(re.search(r"an error of about (\S+) %", warning)[1])
    assert told[0] == told[1]
    assert len(looked) == 1 + resolution.LOOKED


def test_a_short_body_whose_sections_stay_straight_is_judged() -> None:
    def warnings(count: int) -> list[str]:
        body = helpers.body(helpers.line(1.8), helpers.element("reissner2", count), {"height": 1.0, "width": 1.0},
                            helpers.STEEL)
        return said(run_case(helpers.load({"b": body}, "linear_static", bc=[{"type": "clamp", "at": "b@0"}],
                                          loads=TIP)))

    assert warnings(1)
    assert not warnings(8)


@pytest.mark.parametrize(("element", "material"), [
    ({"type": "ancf", "order": [3, 1], "formulation": "continuum"}, {"law": "neo_hooke"}),
    ({"type": "vallejo"}, {"viscoelastic": [{"modulus": 0.5, "time": 0.1}]}),
    ({"type": "cable", "formulation": "green"}, {})], ids=["hyperelastic", "relaxing", "green"])
def test_a_bar_whose_uniform_strain_is_large_is_not_judged_by_a_linear_law(element: Any, material: Any) -> None:
    """Its energy is that of a linear law only to the order of the strain, on a sufficiently fine mesh."""
    body = helpers.body(helpers.line(1.0), {**element, "count": 4}, SECTION, {"E": 1e6, "nu": 0.3, **material})
    case = helpers.load({"b": body}, {"type": "quasi_static", "t_end": 1.0}, bc=[{"type": "clamp", "at": "b@0"}],
                        loads=[{"type": "force", "at": "b@1", "value": [3000, 0]}], output={"probes": {"tip": "b@1"}})
    outcome = run_case(case)
    assert outcome.summary["probes"]["tip"]["ux"] > 0.15
    assert not said(outcome)


@pytest.mark.parametrize("stretch", [0.6, 1.7, 3.0])
def test_a_rubber_bar_at_any_stretch_is_not_judged_by_a_linear_law(stretch: float) -> None:
    """N^2/EA ds/2 is up to three times its energy; one element is exact."""
    body = helpers.body(helpers.line(1.0), helpers.element("omar", 4, formulation="continuum"),
                        {"height": 0.3, "width": 0.1}, {"E": 1e6, "nu": 0.0, "law": "neo_hooke"})
    case = helpers.load({"b": body}, "static", bc=[{"type": "clamp", "at": "b@0", "hold": "breathe"},
                                                   {"type": "prescribed", "at": "b@1", "ux": stretch - 1.0, "uy": 0.0}])
    assert not said(run_case(case))


@pytest.mark.parametrize("force", [500.0, 2000.0])
def test_modes_about_a_stretched_rubber_bar_are_not_judged_by_a_linear_law(force: float) -> None:
    """The axial frequency is that of the tangent modulus, (pi/2) sqrt(dP/dl / rho) for a bar with one end held."""
    mu, rho = 2e6 / 3, 1100.0
    stretch = brentq(lambda x: mu * (x - x**-2) - force / 0.0025, 1.0, 9.0)
    body = helpers.body(helpers.line(1.0), helpers.element("2d3n", 16, formulation="continuum"),
                        {"height": 0.05, "width": 0.05}, {"E": 2e6, "nu": 0.499, "rho": rho, "law": "neo_hooke"})
    outcome = run_case(helpers.load(
        {"b": body}, {"type": "eigen", "about": "static", "modes": 4},
        bc=[{"type": "clamp", "at": "b@0", "hold": "breathe"}],
        loads=[{"type": "force", "at": "b@1", "value": [force, 0], "spread": "uniform"}]))
    axial = next(mode for mode in outcome.summary["frequencies"] if mode["kind"] == "axial")
    assert axial["omega"] == pytest.approx(math.pi / 2 * math.sqrt(mu * (1 + 2 * stretch**-3) / rho), rel=5e-3)
    assert not said(outcome)


@pytest.mark.parametrize("count", [8, 64])
def test_a_clamp_that_breathes_does_not_make_a_fine_mesh_coarse(count: int) -> None:
    """Its forces act on three nodes of the first element of 2d3n."""
    body = helpers.body(helpers.line(1.0), helpers.element("2d3n", count), {"height": 0.2, "width": 0.01})
    clamp = {"type": "clamp", "at": "b@0", "hold": "breathe"}
    outcome = run_case(helpers.load({"b": body}, "linear_static", bc=[clamp],
                                    loads=[{"type": "force", "at": "b@1", "value": [0, -1]}]))
    assert not said(outcome)


@pytest.mark.parametrize("solver", ["linear_static", "static"])
def test_free_natural_strains_are_not_judged_by_residual_stress(solver: str) -> None:
    """A bar with a change of temperature bends without section forces, to 3 % of the fine mesh."""
    def tip(count: int) -> tuple[Any, list[str]]:
        curve = {"type": "spline", "points": [[0, 0], [1, 0.3], [2, 0], [3, -0.2]]}
        body = helpers.body(curve, helpers.element("vallejo", count), {"height": 0.05, "width": 0.05},
                            {**helpers.STEEL, "alpha": 1.2e-5})
        outcome = run_case(helpers.load({"b": body}, solver, bc=[{"type": "clamp", "at": "b@0"}],
                                        loads=[{"type": "temperature", "on": "b", "value": 60, "gradient": 100}],
                                        output={"probes": {"tip": "b@1"}}))
        return outcome.summary["probes"]["tip"]["uy"], said(outcome)

    (coarse, told), (limit, _) = tip(8), tip(LIMIT)
    assert coarse == pytest.approx(limit, rel=0.04)
    assert not told


def test_a_mild_change_of_temperature_does_not_hide_a_coarse_mesh() -> None:
    warm = {"type": "temperature", "on": "b", "value": 5, "gradient": 20}
    body = helpers.body(helpers.line(2.0), helpers.element("reissner2", 1), SECTION, {**helpers.STEEL, "alpha": 1e-5})
    case = helpers.load({"b": body}, "linear_static", bc=[{"type": "clamp", "at": "b@0"}], loads=[*TIP, warm])
    assert said(run_case(case))


def strip(name: str, solver: dict[str, Any], count: int = 6, bodies: int = 1, lift: float = 0.0) -> LoadedCase:
    """Return a heavy strip that lies on a floor, or on another one; a force may lift its end."""
    section, k_of = {"height": 0.02, "width": 0.05}, range(bodies)
    lies = [{"name": f"under {k}", "between": [f"b{k}", "floor" if k == 0 else f"b{k - 1}"]} for k in range(bodies)]
    return helpers.load(
        {f"b{k}": helpers.body({"type": "line", "start": [0, 0.02 * k], "end": [1, 0.02 * k]},
                               helpers.element(name, count), section, {"E": 1e7, "nu": 0.3, "rho": 1000})
         for k in k_of}, solver, bc=[{"type": "roller", "at": f"b{k}@0.5", "fixed": "x"} for k in k_of],
        loads=[{"type": "gravity", "value": [0, -9.81]}, {"type": "force", "at": "b0@1", "value": [0, lift]}],
        obstacles={"floor": {"type": "half_plane", "through": [0, -0.01], "normal": [0, 1]}}, contacts=lies,
        output={"probes": {"tip": "b0@1"}})


@pytest.mark.slow_rows("solver0-vallejo-2", "solver1-reissner2-2", "solver1-vallejo-2")
@pytest.mark.parametrize("bodies", [1, 2])
@pytest.mark.parametrize("name", ["reissner2", "vallejo"])
@pytest.mark.parametrize("solver", [{"type": "static"}, {"type": "dynamic", "t_end": 0.02, "dt": 1e-3}])
def test_bodies_that_only_lie_are_not_called_too_coarse(solver: dict[str, Any], name: str, bodies: int) -> None:
    """No bending: forces at nodes represent the pressure between them, which is the weight."""
    assert said(run_case(strip(name, solver, bodies=bodies))) == []


def test_lifted_bodies_are_still_judged() -> None:
    def tip(count: int) -> tuple[float, list[str]]:
        outcome = run_case(strip("reissner2", {"type": "static"}, count, lift=2.0))
        return outcome.summary["probes"]["tip"]["uy"], said(outcome)

    (coarse, warnings), (fine, _) = tip(6), tip(48)
    told = float(re.search(r"an error of about (\S+) %", warnings[0])[1]) / 100
    # within the places of lift-off, which nodes tell on a coarse mesh
    assert abs(1.0 - coarse / fine) == pytest.approx(told, abs=0.25)
    assert abs(1.0 - coarse / fine) > 0.08


@pytest.mark.parametrize(("kind", "count", "told"), [("cable", 32, False), ("cable", 64, False),
                                                    ("reissner2", 1, True)])
def test_a_plastically_bent_body_is_not_judged_by_residual_stress(kind: str, count: int, told: bool) -> None:
    """Unloaded after yielding, it has no section forces; the stored energy is far below the work that bent it."""
    amplitude = {"type": "table", "t": [0, 0.5, 1], "value": [0, 1, 0 if count > 1 else 1]}
    body = helpers.body(helpers.line(1.0), helpers.element(kind, count), {"height": 0.02, "width": 0.02},
                        {"E": 2e11, "nu": 0.3, "yield": 2.5e8, "hardening": {"kinematic": 1e10}})
    load = {"type": "force", "at": "b@1", "value": [0, -470], "amplitude": amplitude}
    outcome = run_case(helpers.load({"b": body}, {"type": "static", "steps": 2}, loads=[load],
                                    bc=[{"type": "clamp", "at": "b@0"}]))
    assert bool(said(outcome)) == told
