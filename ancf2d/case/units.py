"""Unit labels: what an SI unit is called in the units that a case works in."""

from __future__ import annotations

from functools import lru_cache

# SI unit -> exponents of force, length and time
_EXPONENTS = {
    "m": (0, 1, 0), "m^2": (0, 2, 0), "m^4": (0, 4, 0), "1/m": (0, -1, 0),
    "N": (1, 0, 0), "N m": (1, 1, 0), "N/m": (1, -1, 0), "N m^2": (1, 2, 0), "N m/rad": (1, 1, 0),
    "Pa": (1, -2, 0), "N s/m": (1, -1, 1), "N m s/rad": (1, 1, 1),
    "kg": (1, -1, 2), "kg/m^3": (1, -4, 2), "kg m^2": (1, 1, 2), "kg/m": (1, -2, 2),
    "kg m": (1, 0, 2), "s": (0, 0, 1), "1/s": (0, 0, -1), "m/s": (0, 1, -1),
    "m/s^2": (0, 1, -2), "Hz": (0, 0, -1), "rad/s": (0, 0, -1),
}
SI = ("m", "N", "s")


@lru_cache(maxsize=256)
def unit_label(unit: str, labels: tuple[str, str, str] = SI) -> str:
    """Return the label of an SI unit where length, force and time are called ``labels``.

    Units that no label touches (rad, and all of them in SI) come back as they are.
    """
    if labels == SI or unit not in _EXPONENTS:
        return unit
    length, force, time = labels
    above, below = "", []
    for name, power in zip((force, length, time), _EXPONENTS[unit], strict=True):
        text = name if abs(power) == 1 else f"{name}^{abs(power)}"
        if power > 0:
            above = f"{above} {text}".strip()
        elif power < 0:
            below.append(text)
    return "/".join([above or "1", *below])
