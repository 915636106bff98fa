"""Warnings of densities, moduli and gravity that do not fit the declared units."""

from __future__ import annotations

import pytest

from ancf2d.case import load_case_text
from ancf2d.case.units import SI, with_unit
from ancf2d.study.run import prepare

CASE = """
{units}
bodies:
  b:
    geometry: {{type: line, start: [0, 0], end: [100, 0]}}
    section: {{height: 10, width: 10}}
    material: {{E: {E}, nu: 0.3, rho: {rho}}}
    element: {{type: reissner3, count: 2}}
boundary_conditions: [{{type: clamp, at: b@0}}]
loads: [{{type: gravity, value: [0, {g}]}}]
solver: {{type: linear_static}}
"""
M, MM, KN = "", "units: {length: mm, force: N, time: s}", "units: {length: m, force: kN, time: s}"


def said(units: str, E: float, rho: float, g: float) -> list[str]:
    warnings = prepare(load_case_text(CASE.format(units=units, E=E, rho=rho, g=g))).warnings
    return [w for w in warnings if "In these units" in w]


@pytest.mark.parametrize(("units", "E", "rho", "g"), [
    (M, 2.07e11, 7850, -9.81), (MM, 2.07e5, 7.85e-9, -9810), (KN, 2.07e8, 7.85, -9.81), (M, 1.05e12, 3500, -1.62),
    (M, 1e5, 20, -9.81), (MM, 1.0, 1.1e-9, -9810), (M, 1.2e10, 0.5e3, 0), ("units: {length: barn}", 1, 1e9, -3),
    (M, 1.0, 1.0, -1.0), (M, 7e5, 5540, -9.81), (M, 1e5, 1070, -9.81), (M, 1e6, 2400, -9.81), (MM, 500.0, 2.2e-9, 0)],
    ids=["steel", "steel in mm", "steel in kN", "diamond on the moon", "foam", "rubber in mm", "wood", "unknown labels",
         "a model without units", "the paper's soft pendulum", "silicone", "filled silicone", "PTFE in mm"])
def test_numbers_that_fit_their_units_give_no_warning(units: str, E: float, rho: float, g: float) -> None:
    assert said(units, E, rho, g) == []


@pytest.mark.parametrize(("units", "E", "rho", "steel"), [
    (MM, 2.07e5, 7850, "7.85e-09"), (MM, 2.07e5, 7.85e-6, "7.85e-09"), (MM, 2.07e11, 7850, "7.85e-09"),
    (M, 2.07e11, 7.85, "7.85e+03"), (M, 2.07e5, 7.85e-9, "7.85e+03"), (M, 2.07e8, 7.85e6, "7.85e+03"),
    (KN, 2.07e11, 7.85, "7.85")])
def test_materials_in_other_units_are_compared_with_steel(units: str, E: float, rho: float, steel: str) -> None:
    (warning,) = said(units, E, rho, 0.0)
    assert f"steel has rho: {steel} and E:" in warning


@pytest.mark.parametrize(("units", "E", "rho", "unit", "speed"), [
    (M, 2.07e5, 7850, "MPa", "5.14"), (M, 70.0, 2700, "GPa", "0.161"), (MM, 207.0, 7.85e-9, "GPa", "162"),
    (KN, 2.07e5, 7.85, "MPa", "162"), (M, 3e4, 2400, "MPa", "3.54")],
    ids=["steel", "aluminium", "steel in mm", "steel in kN", "concrete"])
def test_moduli_in_another_unit_are_recognised_by_slow_waves(units: str, E: float, rho: float, unit: str,
                                                             speed: str) -> None:
    (warning,) = said(units, E, rho, 0.0)
    assert f"looks like a modulus in {unit}" in warning
    assert f"waves would travel at {speed} m/s" in warning


@pytest.mark.parametrize(("units", "E", "rho", "g", "earth"), [
    (MM, 2.07e5, 7.85e-9, -9.81, "9810"), (M, 2.07e11, 7850, -9810, "9.81"), (M, 2.07e11, 7850, 9.81e-3, "9.81")])
def test_gravity_in_other_units_gives_a_warning(units: str, E: float, rho: float, g: float, earth: str) -> None:
    (warning,) = said(units, E, rho, g)
    assert f"that of the earth is {earth}" in warning


@pytest.mark.parametrize(("E", "yields", "told"), [
    (2.07e11, 235e6, None), (2.07e5, 235, None), (7e10, 5e8, None), (2e9, 8e7, None), (2.07e11, 235, "1.1e-09"),
    (2.07e11, 235e3, "1.1e-06"), (2.07e5, 235e6, "1.1e+03")],
    ids=["steel", "steel in mm", "aluminium", "plastic", "MPa beside Pa", "kPa beside Pa", "Pa beside MPa"])
def test_yield_stresses_in_other_units_give_a_warning(E: float, yields: float, told: str | None) -> None:
    whole = CASE.format(units=M, E=E, rho=7850, g=0).replace("linear_static", "static")
    given = f"{{E: {E}, nu: 0.3, rho: 7850, yield: {yields}}}"
    before, material, after = whole.partition(f"    material: {{E: {E}, nu: 0.3, rho: 7850}}\n")
    alone = f"{before}    material: {given}\n{after}"
    layer = before.replace("height: 10, width: 10", f"width: 10, layers: [{{height: 10, material: {given}}}]") + after
    assert material
    for text in (alone, layer):
        said = [w for w in prepare(load_case_text(text)).warnings if "no known material has yield" in w]
        assert len(said) == (told is not None)
        assert told is None or f"its strain at the yield stress is {told}," in said[0]


def test_unused_parameters_and_layers_without_expansion_give_warnings() -> None:
    text = CASE.format(units=M, E=2.07e11, rho=7850, g=0)
    heated, steel = ["loads=[{type: temperature, on: b, value: 20}]"], "E: 2e11, nu: 0.3, rho: 7850"
    layers = (f"bodies.b.section={{width: 10, layers: [{{height: 5, material: {{{steel}, alpha: 1e-5}}}}, "
              f"{{height: 5, material: {{{steel}}}}}]}}")
    for overrides, told in (
            (["parameters={h: 5, k: 2}", 'bodies.b.section.height="2*h"'], "parameters.k: nothing in the case uses it"),
            ([*heated, layers, "bodies.b.material=null"], "bodies.b.section.layers.1.material.alpha: not given")):
        (warning,) = prepare(load_case_text(text, overrides=overrides)).warnings
        assert warning.startswith(told)


@pytest.mark.parametrize(("what", "labels", "said"), [
    ("tip uy", SI, "tip uy [m]"), ("tip uy", ("mm", "kN", "s"), "tip uy [mm]"), ("limit point 1 load ux", SI,
    "limit point 1 load ux [m]"), ("left M", ("mm", "N", "s"), "left M [N mm]"), ("bending 2", SI, "bending 2 [rad/s]"),
    ("strain_energy", SI, "strain_energy [N m]"), ("load factor 1", SI, "load factor 1"), ("", SI, "")])
def test_quantities_show_their_units(what: str, labels: tuple[str, str, str], said: str) -> None:
    assert with_unit(what, labels) == said
