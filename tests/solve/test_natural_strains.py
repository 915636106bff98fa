"""Natural strains: free bodies follow them without stress, constrained bodies are stressed by them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ancf2d

ALPHA, E, WIDTH, HEIGHT = 2e-5, 7e10, 0.01, 0.02
EA, EI = E * WIDTH * HEIGHT, E * WIDTH * HEIGHT**3 / 12
STATIC, LINEAR = {"type": "static"}, {"type": "linear_static"}
# everything that has a formulation, and every formulation
TYPES = [("reissner3", None), ("cable", None), ("cable", "green"), ("vallejo", None), ("vallejo", "structural"),
         ("vallejo", "continuum"), ("vallejo", "strain_split"), ("omar", None), ("2d2n", None), ("2d3n-nu", None),
         ("patel", None), ([3, 3], None)]
FREE = [{"type": "pin", "at": "strip@0"}, {"type": "roller", "at": "strip@1", "fixed": "y"}]
CLAMPED = [{"type": "clamp", "at": "strip@0"}]


def element(kind: Any, formulation: str | None = None, count: int = 8) -> dict[str, Any]:
    what = {"type": kind} if isinstance(kind, str) else {"type": "ancf", "order": kind}
    return {**what, "count": count, **({"formulation": formulation} if formulation else {})}


def strip(elements: dict[str, Any], loads: list[dict[str, Any]], supports: list[dict[str, Any]] = CLAMPED,
          solver: dict[str, Any] = STATIC, **more: Any) -> dict[str, Any]:
    line = {"type": "line", "start": [0, 0], "end": [1, 0]}
    body = {"geometry": more.pop("geometry", line), "section": {"height": HEIGHT, "width": WIDTH},
            "material": {"E": E, "nu": 0.3, "rho": 2700, "alpha": ALPHA} | more.pop("material", {}),
            "element": elements}
    output = {"probes": {"tip": "strip@1", "mid": "strip@0.5"}, "fields": more.pop("fields", [])}
    loads = [{"on": "strip", **load} if load["type"] in ("eigenstrain", "temperature") else load for load in loads]
    return {"bodies": {"strip": body}, "boundary_conditions": supports, "loads": loads, "solver": solver,
            "output": output, **more}


def solved(*args: Any, **more: Any) -> dict[str, Any]:
    return ancf2d.solve(strip(*args, **more), states=False).summary


@pytest.mark.parametrize(("kind", "formulation"), TYPES)
@pytest.mark.parametrize("solver", [STATIC, LINEAR], ids=["static", "linear"])
def test_heat_alone_makes_no_stress(kind: Any, formulation: str | None, solver: dict[str, Any]) -> None:
    T = 60.0
    free = solved(element(kind, formulation), [{"type": "temperature", "value": T}], FREE, solver)
    assert free["probes"]["tip"]["ux"] == pytest.approx(ALPHA * T, rel=1e-9)
    assert free["energy"]["strain"] < 1e-9 * 0.5 * EA * (ALPHA * T) ** 2


@pytest.mark.parametrize("course", ["1", "0.3 if t < 0.5 else 1"])
@pytest.mark.parametrize("solver", [STATIC, {"type": "quasi_static", "t_end": 1}], ids=["static", "quasi_static"])
def test_sudden_heat_buckles_no_free_strip(solver: dict[str, Any], course: str) -> None:
    """Held at its length, the strip would bear EA alpha T, fifteen times its buckling load pi^2 EI/4."""
    T, F = 60.0, 1.0
    loads = [{"type": "temperature", "value": T, "amplitude": {"type": "expression", "value": course}},
             {"type": "force", "at": "strip@1", "value": [0, -F]}]
    found = solved(element("reissner3"), loads, solver=solver)
    assert found["warnings"] == []
    assert found["probes"]["tip"]["ux"] == pytest.approx(ALPHA * T, rel=1e-3)
    assert found["probes"]["tip"]["uy"] == pytest.approx(-F * (1 + ALPHA * T)**3 / (3 * EI), rel=1e-3)


@pytest.mark.parametrize(("kind", "formulation"), TYPES)
def test_a_heated_arc_keeps_its_angle(kind: Any, formulation: str | None) -> None:
    arc = {"type": "arc", "center": [0, 0], "radius": 1, "from": 0, "to": 1}
    along_the_chord = {"type": "roller", "at": "strip@1", "normal": [math.cos(0.5), math.sin(0.5)]}
    hold = [{"type": "pin", "at": "strip@0"}, along_the_chord]
    T = 60.0
    hot = solved(element(kind, formulation), [{"type": "temperature", "value": T}], hold, geometry=arc)
    assert abs(hot["probes"]["tip"]["theta"]) < (1e-6 if formulation == "green" else 1e-7)
    # the spatial curvature of the Green cable follows to first order
    assert hot["energy"]["strain"] < (1e-5 if formulation == "green" else 1e-9) * 0.5 * EA * (ALPHA * T) ** 2


@pytest.mark.parametrize("kind", ["reissner3", "reissner2", "vallejo"])
def test_a_strip_with_the_curvature_of_a_circle_closes(kind: str) -> None:
    formulation = "structural" if kind == "vallejo" else None
    loads = [{"type": "eigenstrain", "curvature": 2 * math.pi}]
    closed = solved(element(kind, formulation), loads, solver={"type": "static", "steps": 10})
    tip = closed["probes"]["tip"]
    # the elements of vallejo are no arcs: their axis closes as their mesh becomes finer
    exact = 1e-9 if kind != "vallejo" else 1e-3
    assert (tip["x"], tip["y"], tip["theta"]) == pytest.approx((0, 0, 2 * math.pi), abs=5 * exact)
    assert closed["energy"]["strain"] < 1e-20 * 0.5 * EI * (2 * math.pi) ** 2


@pytest.mark.parametrize("kind", ["cable", "vallejo", [3, 3]])
def test_the_error_of_elements_on_a_circle_vanishes_with_their_length(kind: Any) -> None:
    loads = [{"type": "eigenstrain", "curvature": 2 * math.pi}]
    coarse, fine = (solved(element(kind, None, n), loads, solver={"type": "static", "steps": 10})["energy"]["strain"]
                    for n in (8, 16))
    assert fine < coarse / 12 < 0.002 * 0.5 * EI * (2 * math.pi) ** 2


@pytest.mark.parametrize("kind", ["reissner3", "cable", "vallejo", [3, 3]])
def test_natural_strains_of_one_body_add_up(kind: Any) -> None:
    one = solved(element(kind), [{"type": "eigenstrain", "axial": 0.03, "curvature": 0.5}], FREE)
    parts = [{"type": "eigenstrain", "axial": 0.01, "curvature": 0.5}, {"type": "eigenstrain", "axial": 0.02}]
    two = solved(element(kind), parts, FREE)
    assert two["probes"]["tip"]["x"] == pytest.approx(one["probes"]["tip"]["x"], rel=1e-10)
    assert two["probes"]["mid"]["y"] == pytest.approx(one["probes"]["mid"]["y"], rel=1e-10)


def test_partial_and_varying_natural_curvatures_bend_the_tip_by_their_integrals() -> None:
    part = solved(element("reissner3"), [{"type": "eigenstrain", "curvature": 0.6, "from": 0.3, "to": 0.55}])
    assert part["probes"]["tip"]["theta"] == pytest.approx(0.6 * 0.25, rel=1e-12)
    table = {"s": [0, 0.35, 0.35, 1], "value": [0.1, 0.1, 0.4, 0.0]}
    varying = solved(element("reissner3"), [{"type": "eigenstrain", "curvature": table}])
    assert varying["probes"]["tip"]["theta"] == pytest.approx(0.1 * 0.35 + 0.5 * 0.4 * 0.65, rel=1e-12)
    heated = solved(element("cable"), [{"type": "temperature", "gradient": "300*s^2"}])
    assert heated["probes"]["tip"]["theta"] == pytest.approx(-ALPHA * 100, rel=1e-6)


BOTH = [{"type": "clamp", "at": "strip@0", "name": "left"}, {"type": "clamp", "at": "strip@1"}]
BREATHING = [{**clamp, "hold": "breathe"} for clamp in BOTH]


@pytest.mark.parametrize("kind", ["reissner3", "cable", "vallejo"])
@pytest.mark.parametrize("solver", [STATIC, LINEAR], ids=["static", "linear"])
def test_clamped_ends_bear_the_forces_of_heat(kind: str, solver: dict[str, Any]) -> None:
    T, g = 40.0, 500.0
    supports = BREATHING if kind == "vallejo" else BOTH
    held = solved(element(kind), [{"type": "temperature", "value": T, "gradient": g}], supports, solver)
    left = held["reactions"]["left"]
    # Green's strain is that of the stretch and half its square
    rel = 3 * ALPHA * T if kind == "vallejo" and solver is STATIC else 1e-9
    assert left["fx"] == pytest.approx(EA * ALPHA * T, rel=rel)
    assert left["m"] == pytest.approx(-EI * ALPHA * g, rel=rel)


@pytest.mark.parametrize(("kind", "solver"), [("reissner3", STATIC), ("vallejo", STATIC), ("vallejo", LINEAR)])
def test_stress_is_that_of_the_constrained_part(kind: str, solver: dict[str, Any], tmp_path: Path) -> None:
    T, g = 40.0, 500.0
    case = strip(element(kind), [{"type": "temperature", "value": T, "gradient": g}],
                 BREATHING if kind == "vallejo" else BOTH, solver)
    case["output"]["fields"] = ["stress"]
    held = ancf2d.solve(case, output=tmp_path / "held.h5")
    stress = held.results.field("strip", "stress")
    eta = np.linspace(-1, 1, stress.shape[2])
    middle = stress[4, 2, :, 0]
    # Green's strain as above
    rel = 1e-9 if solver is LINEAR else 2e-3
    assert middle == pytest.approx(-E * ALPHA * (T + 0.5 * HEIGHT * eta * g), rel=rel)


def test_heat_buckles_a_clamped_bar() -> None:
    # Euler: EA alpha T = 4 pi^2 EI/l^2, of an axis that keeps its length with kGA
    case = strip(element("reissner3", count=32), [{"type": "temperature", "value": 1.0}], BOTH,
                 {"type": "buckling", "modes": 2})
    G = E / 2.6
    k = 10 * 1.3 / (12 + 11 * 0.3)
    euler = 4 * math.pi**2 * EI
    critical = euler / (1 + euler / (k * G * WIDTH * HEIGHT)) / (EA * ALPHA)
    factors = ancf2d.solve(case, states=False).summary["load_factors"]
    # the thrust shortens the bar that is heated: first order in EI/(EA l^2)
    assert factors[0] == pytest.approx(critical, rel=3 * 4 * math.pi**2 * EI / EA)


def test_a_path_follows_heat_past_the_critical_temperature() -> None:
    # a mid-span force of its own leads onto the branch
    loads = [{"type": "temperature", "value": 300.0},
             {"type": "force", "at": "strip@0.5", "value": [0, 500.0], "amplitude": {"type": "constant"}}]
    path = solved(element("reissner3"), loads, BOTH, {"type": "static", "method": "arc_length", "steps": 200})
    whole = solved(element("reissner3"), loads, BOTH, {"type": "static", "steps": 60})
    assert path["probes"]["mid"]["y"] == pytest.approx(whole["probes"]["mid"]["y"], rel=1e-8)
    assert path["probes"]["mid"]["y"] > 0.03


def test_heat_lowers_the_frequencies_of_a_clamped_bar() -> None:
    def first(T: float) -> float:
        case = strip(element("reissner3", count=16), [{"type": "temperature", "value": T}], BOTH,
                     {"type": "eigen", "modes": 1, "about": "static"})
        return float(ancf2d.solve(case, states=False).summary["frequencies"][0]["omega"])

    cold, hot = first(1e-9), first(30.0)
    # Galerkin with the clamped mode: omega^2 falls by N int w'^2/(rhoA int w^2), 12.30 of the first mode, and by a
    # little more, as the mode is free to change
    fall = 12.3026 * EA * ALPHA * 30.0 / (2700 * WIDTH * HEIGHT)
    assert cold**2 - hot**2 == pytest.approx(fall, rel=2e-2)


@pytest.mark.slow
@pytest.mark.parametrize("tau", [0.0, 0.01])
@pytest.mark.parametrize("formulation", [None, "structural"])
def test_the_work_of_an_actuator_is_exact_in_energy_momentum(tau: float, formulation: str | None) -> None:
    soft = {"E": 7e7} | ({"damping": {"kelvin_voigt": tau}} if tau else {})
    loads = [{"type": "eigenstrain", "axial": 0.01, "curvature": 2.0, "amplitude": {"type": "sine", "frequency": 2}},
             {"type": "temperature", "value": 60, "gradient": 100}, {"type": "gravity", "value": [0, -9.81]}]
    moved = solved(element("vallejo", formulation, 4), loads, material=soft,
                   solver={"type": "dynamic", "t_end": 0.3, "dt": 0.005, "method": "energy_momentum"})
    assert moved["energy_drift"] < 1e-12
    assert moved["energy"]["work"] > 0.1


@pytest.mark.slow
def test_the_work_of_an_actuator_is_counted_in_motion() -> None:
    def drift(dt: float) -> float:
        loads = [{"type": "eigenstrain", "curvature": 2.0, "amplitude": {"type": "expression",
                                                                        "value": "1 - exp(-(4*t)^4)"}}]
        soft = {"E": 7e7, "damping": {"kelvin_voigt": 0.01}}
        moved = solved(element("reissner3", None, 4), loads, material=soft,
                       solver={"type": "dynamic", "t_end": 0.4, "dt": dt})
        return float(moved["energy_drift"])

    coarse, fine = drift(0.02), drift(0.01)
    assert fine < coarse / 8
    assert fine < 1e-5


REFUSED = [
    ({"type": "temperature", "value": 0}, {}, "has no effect: value and gradient are both 0"),
    ({"type": "eigenstrain", "axial": 1e-3, "from": 0.5, "to": 0.5}, {}, "from must be less than to"),
    ({"type": "temperature", "value": 10}, {"alpha": None}, "body 'strip' has no thermal expansion"),
]


@pytest.mark.parametrize(("load", "material", "says"), REFUSED)
def test_missing_natural_strains_are_refused(load: dict[str, Any], material: dict[str, Any], says: str) -> None:
    case = strip(element("reissner3"), [load])
    if material:
        del case["bodies"]["strip"]["material"]["alpha"]
    with pytest.raises(ancf2d.CaseError, match=says):
        ancf2d.load(case) if "thermal" not in says else ancf2d.solve(case)


def test_a_rigid_body_has_no_natural_strains() -> None:
    case = strip({"type": "rigid"}, [{"type": "eigenstrain", "axial": 1e-3}])
    with pytest.raises(ancf2d.CaseError, match="body 'strip' is rigid"):
        ancf2d.solve(case, states=False)


@pytest.mark.parametrize("curvature", [2 / 7, 11 / 7, 26 / 7, 5.0])
def test_a_partly_bent_strip_takes_no_more_steps_than_requested(curvature: float) -> None:
    """There are no forces, so Newton's method ends in round-off, which must not decide anything."""
    case = strip(element("reissner3"), [{"type": "eigenstrain", "curvature": curvature, "from": 0.2, "to": 0.6}],
                 geometry={"type": "line", "start": [0, 0], "end": [0.1, 0]})
    case["bodies"]["strip"]["section"] = {"height": 2e-3, "width": 0.01}
    summary = ancf2d.solve(case, states=False).summary
    assert summary["steps"] == 10
    assert summary["iterations"] <= 60
    assert summary["probes"]["tip"]["theta"] == pytest.approx(0.04 * curvature, rel=1e-10)


@pytest.mark.parametrize("kind", [("reissner3", None), ("cable", None), ("vallejo", "structural")])
@pytest.mark.parametrize("solver", [{"type": "static", "steps": 8},
                                    {"type": "quasi_static", "t_end": 1.0, "tolerance": 1e-4}])
def test_a_constrained_strip_heated_beyond_yield_and_cooled_remains_in_tension(kind: tuple[str, str | None],
                                                                               solver: dict[str, Any]) -> None:
    """It yields in compression by p = (E alpha T - s)/(E + H), and back by q = (E p - s - H p)/(E + H) as it cools.

    Isotropic hardening: stress then is s + H (p + q).
    """
    s, H, T = 100e6, 2e9, 400.0
    p = (E * ALPHA * T - s) / (E + H)
    q = (E * p - s - H * p) / (E + H)
    heat = {"type": "temperature", "value": T, "amplitude": {"type": "table", "t": [0, 0.5, 1], "value": [0, 1, 0]}}
    case = strip(element(*kind, 2), [heat], [*CLAMPED, {"type": "clamp", "at": "strip@1"}], solver,
                 material={"yield": s, "hardening": {"isotropic": H}}, fields=["N"])
    left = ancf2d.solve(case, states=False).probes["mid"]["N"]
    assert left == pytest.approx((s + H * (p + q)) * WIDTH * HEIGHT, rel=1e-5)
