"""Cross-section and material of a body as the formulations need them."""

from __future__ import annotations

from dataclasses import dataclass


def timoshenko(nu: float) -> float:
    """Return the shear factor of the rectangle, 10 (1 + nu)/(12 + 11 nu) (Cowper 1966)."""
    return 10.0 * (1.0 + nu) / (12.0 + 11.0 * nu)


@dataclass(frozen=True)
class Section:
    """Section constants: height and width [m], E, k_s mu [Pa], and the stiffnesses and inertias.

    EA, kGA [N], EI [N m^2], rhoA [kg/m], rhoI [kg m], thermal expansion alpha [1/K]; the rectangle height x
    width stands for the section where a formulation integrates over the body. Each is a number, or, of a section
    that varies, an array (stations,) at the stations that were asked for.
    """

    height: float
    width: float
    E: float
    nu: float
    k_s: float
    EA: float
    kGA: float
    EI: float
    rhoA: float = 0.0
    rhoI: float = 0.0
    alpha: float = 0.0

    @property
    def mu_k(self) -> float:
        """Shear modulus times shear factor [Pa], as kGA over the area."""
        return self.kGA / (self.height * self.width)

    @property
    def rho(self) -> float:
        """Mass density of the rectangle [kg/m^3]."""
        return self.rhoA / (self.height * self.width)
