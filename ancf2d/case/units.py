"""Unit labels: the names of SI units in the units of a case."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

from ..quantities import UNIT_OF

# SI unit -> exponents of force, length and time
_EXPONENTS = {
    "m": (0, 1, 0), "m^2": (0, 2, 0), "m^4": (0, 4, 0), "1/m": (0, -1, 0),
    "N": (1, 0, 0), "N m": (1, 1, 0), "N/m": (1, -1, 0), "N m^2": (1, 2, 0), "N m/rad": (1, 1, 0),
    "Pa": (1, -2, 0), "N s/m": (1, -1, 1), "N m s/rad": (1, 1, 1),
    "kg": (1, -1, 2), "kg/m^3": (1, -4, 2), "kg m^2": (1, 1, 2), "kg/m": (1, -2, 2),
    "kg m": (1, 0, 2), "s": (0, 0, 1), "1/s": (0, 0, -1), "m/s": (0, 1, -1),
    "K/m": (0, -1, 0), "m/s^2": (0, 1, -2), "Hz": (0, 0, -1), "rad/s": (0, 0, -1),
}
SI = ("m", "N", "s")
# SI units of the quantities of probes, reactions and goals
QUANTITY_UNITS = {**UNIT_OF, "strain_energy": "N m"}
_FREQUENCIES = ("bending", "axial", "shear", "thickness", "mixed")


def with_unit(what: str, labels: tuple[str, str, str] = SI) -> str:
    """Return 'tip uy [m]' for 'tip uy', and so on; names without a known unit are returned unchanged."""
    words = what.split() or [""]
    unit = "rad/s" if words[0] in _FREQUENCIES and words[-1].isdigit() else QUANTITY_UNITS.get(words[-1], "")
    return f"{what} [{unit_label(unit, labels)}]" if unit else what


@lru_cache(maxsize=256)
def unit_label(unit: str, labels: tuple[str, str, str] = SI) -> str:
    """Return the label of an SI unit if length, force and time are called ``labels``.

    Units without length, force and time (rad), and all units in SI, are returned unchanged.
    """
    if labels == SI or unit not in _EXPONENTS:
        return unit
    length, force, time = labels
    # temperature has only one label
    above, below = "K" if unit.startswith("K") else "", []
    for name, power in zip((force, length, time), _EXPONENTS[unit], strict=True):
        text = name if abs(power) == 1 else f"{name}^{abs(power)}"
        if power > 0:
            above = f"{above} {text}".strip()
        elif power < 0:
            below.append(text)
    return "/".join([above or "1", *below])


# common labels in SI units; other labels are not checked
_LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
_FORCES = {"N": 1.0, "kN": 1e3, "MN": 1e6, "mN": 1e-3, "uN": 1e-6, "lbf": 4.4482216}
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0}
# of solids [kg/m^3]: from the lightest foams to osmium
_DENSITIES = 0.1, 23e3
# largest modulus of a material [Pa], and wave speed in it [m/s]: above those of diamond
_STIFFEST, _FASTEST = 2e12, 3e4
# a softer material [Pa] may belong to a dimensionless model, which cannot be checked
_SOFTEST = 1e5
# solids as dense as this [kg/m^3] (metals, minerals, carbon fibres) have moduli [Pa] and wave speeds [m/s] in these
# ranges, unlike gels and rubbers, whose waves are as slow as those of steel with E in MPa
_DENSE, _STIFF, _WAVES = 1600.0, (1e10, 1.2e12), (1e3, 1e4)
_PREFIXES = {"MPa": 1e6, "GPa": 1e9}
_EARTH = 9.81
_STEEL = {"density": 7850.0, "modulus": 2.07e11}


def _misread(rho: float, E: float, unit: float) -> str | None:
    """Return MPa or GPa if E [Pa] is implausibly small for a solid of density rho [kg/m^3], and plausible in that unit.

    ``unit`` is the unit of stress of the case [Pa].
    """
    for prefix, pascals in _PREFIXES.items():
        meant = E * pascals / unit
        if pascals > unit and rho >= _DENSE and _STIFF[0] <= meant <= _STIFF[1] and (
                _WAVES[0] <= math.sqrt(meant / rho) <= _WAVES[1]):
            return prefix
    return None


def unit_warnings(case: Any) -> list[str]:
    """Return warnings about densities, moduli and gravity that are implausible in the units of the case."""
    labels = (case.units.length, case.units.force, case.units.time)
    if labels[0] not in _LENGTHS or labels[1] not in _FORCES or labels[2] not in _TIMES:
        return []
    L, F, T = _LENGTHS[labels[0]], _FORCES[labels[1]], _TIMES[labels[2]]
    units, out = ", ".join(labels), []
    for name, body in case.bodies.items():
        m = body.material
        if m is None or not isinstance(m.E, float) or not isinstance(m.rho, float):
            continue
        rho, E = m.rho * F * T**2 / L**4, m.E * F / L**2
        if (meant := _misread(rho, E, F / L**2)) is not None:
            out.append(f"bodies.{name}.material.E: {m.E:g} looks like a modulus in {meant}: with rho: {m.rho:g} in "
                       f"{units}, waves would travel at {math.sqrt(E / rho):.3g} m/s. In these units, E of steel is "
                       f"{_STEEL['modulus'] * L**2 / F:.3g}. Correct the number, or give its units under 'units'")
        known = _DENSITIES[0] <= rho <= _DENSITIES[1] and E <= _STIFFEST and E / rho <= _FASTEST**2
        if known or E < _SOFTEST:
            continue
        out.append(f"bodies.{name}.material: no known material has rho: {m.rho:g} with E: {m.E:g} in {units} (that is "
                   f"{rho:.3g} kg/m^3 and {E:.3g} Pa). In these units, steel has rho: "
                   f"{_STEEL['density'] * L**4 / (F * T**2):.3g} and E: {_STEEL['modulus'] * L**2 / F:.3g}. Correct "
                   "the numbers, or give their units under 'units'")
    for i, load in enumerate(case.loads):
        g = math.hypot(*load.value) * L / T**2 if getattr(load, "tag", "") == "gravity" else 0.0
        power = round(math.log(g / _EARTH, 1000.0)) if g > 0.0 else 0
        if power and 0.9 < g / _EARTH / 1000.0**power < 1.1:
            out.append(f"loads.{i}: gravity of {math.hypot(*load.value):g} in {units} is {g:.3g} m/s^2. In these "
                       f"units, that of the earth is {_EARTH * T**2 / L:.4g}. Correct the number, or give its "
                       "units under 'units'")
    return out
