"""What all tools of the bench compute: the paper's cantilever of Table 2, its pendulums of Sec. 5.4; frames."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Bar:
    """A straight bar of rectangular section; ``shear`` is its shear factor, ``load`` a force at its end [N]."""

    length: float
    height: float
    width: float
    E: float
    rho: float
    shear: float
    nu: float = 0.3
    gravity: float = 9.81
    load: float = 0.0

    @property
    def area(self) -> float:
        """Area of the section [m2]."""
        return self.height * self.width

    @property
    def inertia(self) -> float:
        """Second moment of area [m4]."""
        return self.width * self.height**3 / 12

    @property
    def shear_stiffness(self) -> float:
        """Shear stiffness kGA [N]."""
        return self.shear * self.E / (2 * (1 + self.nu)) * self.area


# ancf2d's own shear factor of a rectangle, after Cowper (1966)
COWPER = 10 * (1 + 0.3) / (12 + 11 * 0.3)
STATIC = Bar(2.0, 0.1, 0.1, 2.07e11, 7850, COWPER, load=500e3)
PENDULUMS = {1: Bar(1.8, 0.008, 0.03125, 2.07e11, 2766.67, 5 / 6), 2: Bar(1.2, 0.253, 0.006335, 7e5, 5540, 5 / 6)}
T_END = {1: 1.5, 2: 1.1}
# load steps of the cantilever
STEPS = 10


@dataclass(frozen=True)
class Yielding:
    """Members of fibres from corner to corner, whose first is clamped, and the last where there are several members.

    ``push`` is the force [N] that goes through ``CYCLE`` at the end of the first member, where ``along`` (0: x, 1: y)
    is what is compared.
    """

    corners: tuple[tuple[float, float], ...]
    push: float
    along: int
    steps: int = 40


# a steel with kinematic hardening, in members of 0.1 m x 0.05 m with 16 fibres
STEEL = {"E": 2e11, "nu": 0.3, "yield": 2.5e8, "kinematic": 2e10, "shear": 5 / 6}
DEEP, WIDE, FIBRES = 0.1, 0.05, 16
YIELD_MOMENT = STEEL["yield"] * WIDE * DEEP**2 / 6
CYCLE = ((0.0, 0.25, 0.75, 1.0), (0.0, 1.0, -1.0, 0.5))
YIELDING = {"cantilever": Yielding(((0, 0), (1, 0)), 1.4 * YIELD_MOMENT, 1),
            "portal": Yielding(((0, 0), (0, 1.5), (2, 1.5), (2, 0)), 5 * YIELD_MOMENT / 1.5, 0)}
