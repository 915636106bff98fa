"""Cross-section and material of a body, as used by the formulations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np


def timoshenko(nu: float) -> float:
    """Return the shear factor of the rectangle, 10 (1 + nu)/(12 + 11 nu) (Cowper 1966)."""
    return 10.0 * (1.0 + nu) / (12.0 + 11.0 * nu)


@dataclass(frozen=True)
class Layer:
    """A layer of a section, from y = ``bottom`` to ``top`` [m]: E [Pa], nu, rho [kg/m^3], alpha [1/K]."""

    bottom: float
    top: float
    E: float
    nu: float
    rho: float
    alpha: float

    @property
    def G(self) -> float:
        """Shear modulus [Pa]."""
        return self.E / (2.0 * (1.0 + self.nu))

    def moment(self, n: int) -> float:
        """Return int y^n dy over the layer."""
        return float(self.top ** (n + 1) - self.bottom ** (n + 1)) / (n + 1)


@dataclass(frozen=True)
class Section:
    """Section constants: height and width [m], E, k_s mu [Pa], and the stiffnesses and inertias.

    EA, kGA [N], EI [N m^2], rhoA [kg/m], rhoI [kg m], thermal expansion alpha [1/K]. Formulations that integrate over
    the body use the rectangle height x width. Each constant is a number, or an array (stations,) at the requested
    stations if the section varies. With ``layers``, ES [N m] couples stretch and bending (N = EA eps - ES kappa,
    M = EI kappa - ES eps), and rhoS [kg] is the first moment of the mass.
    ``laws`` are the laws of the fibres (``fibres.Uniaxial``) layer by layer, empty if all are elastic; ``maxwell`` are
    (modulus relative to E, relaxation time [s]) of a relaxing material; ``neo_hooke``: whether it is hyperelastic.
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
    ES: float = 0.0
    rhoS: float = 0.0
    layers: tuple[Layer, ...] = ()
    laws: tuple[Any, ...] = ()
    maxwell: tuple[tuple[float, float], ...] = ()
    neo_hooke: bool = False

    @property
    def mu_k(self) -> float:
        """Shear modulus times shear factor [Pa]: kGA divided by the area."""
        return self.kGA / (self.height * self.width)

    @property
    def height_of_axis(self) -> float:
        """Height of the axis above the lower face [m]."""
        return -self.layers[0].bottom if self.layers else 0.5 * self.height

    def free(self, axial: Any, curvature: Any, value: Any, gradient: Any) -> tuple[Any, Any, Any]:
        """Return the axial strain, curvature and mean strain across of a section without force and moment.

        ``axial`` and ``curvature`` are prescribed strains; the temperature changes by ``value`` + ``gradient`` y. A
        body that expands equally in all directions keeps its angles, and so its curvature per unit of reference length.
        """
        if not self.layers:
            return axial + self.alpha * value, curvature - self.alpha * gradient, self.alpha * value
        b, across = self.width, sum(l.alpha * (l.top - l.bottom) for l in self.layers) / self.height
        T = [sum(l.E * l.alpha * b * l.moment(n) for l in self.layers) for n in range(3)]
        N, M = T[0] * value + T[1] * gradient, -(T[1] * value + T[2] * gradient)
        det = self.EA * self.EI - self.ES**2
        return (axial + (self.EI * N + self.ES * M) / det, curvature + (self.ES * N + self.EA * M) / det,
                across * value)

    def of_layer(self, y: Any, value: Callable[[Layer], float], otherwise: Any) -> Any:
        """Return a value of the layer at each height y (n,), or ``otherwise`` for a section without layers."""
        if not self.layers:
            return otherwise
        tops = np.array([l.top for l in self.layers[:-1]])
        return np.array([value(l) for l in self.layers])[np.searchsorted(tops, y)]


# constants that may vary along a body; the heights and materials of layers cannot
NO_CONSTANTS = ("layers", "laws", "maxwell", "neo_hooke")
CONSTANTS = tuple(f.name for f in fields(Section) if f.name not in NO_CONSTANTS)


def laminate(width: Any, layers: tuple[Layer, ...], factor: float = 1.0) -> Section:
    """Return the section made of layers; its shear stiffness follows from equilibrium, times ``factor``.

    nu and E are averaged by stiffness, and alpha over the height. ``width`` may be an array (stations,).
    """
    E, rho = ([sum(getattr(l, name) * l.moment(n) for l in layers) for n in range(3)] for name in ("E", "rho"))
    height = layers[-1].top - layers[0].bottom
    kGA = factor / shear_compliance(layers, (E[0], E[1], E[2]))
    area = sum(l.G * (l.top - l.bottom) for l in layers)
    nu = sum(l.nu * l.E * (l.top - l.bottom) for l in layers) / E[0]
    alpha = sum(l.alpha * (l.top - l.bottom) for l in layers) / height
    return Section(height, width, E[0] / height, nu, kGA / area, EA=width * E[0], kGA=width * kGA, EI=width * E[2],
                   rhoA=width * rho[0], rhoI=width * rho[2], alpha=alpha, ES=width * E[1], rhoS=width * rho[1],
                   layers=layers)


def shear_flow(layers: tuple[Layer, ...], E: tuple[float, float, float], y: Any) -> Any:
    """Return the shear stress (n,) [Pa] at heights y (n,) per unit of Q, by equilibrium of the part below y.

    Without axial force, M' = -Q strains the fibres by (a - c y) Q per unit length. ``E`` are EA, ES and EI.
    """
    det = E[0] * E[2] - E[1] ** 2
    a, c = -E[1] / det, -E[0] / det
    out = np.zeros(np.shape(y))
    for l in layers:
        top = np.clip(y, l.bottom, l.top)
        out -= l.E * (a * (top - l.bottom) - 0.5 * c * (top**2 - l.bottom**2))
    return out


def shear_compliance(layers: tuple[Layer, ...], E: tuple[float, float, float]) -> float:
    """Return 1/kGA per unit of width by the energy int tau^2/G dy of the shear stress that satisfies equilibrium."""
    x, w = np.polynomial.legendre.leggauss(5)
    total = 0.0
    for l in layers:
        half = 0.5 * (l.top - l.bottom)
        y = 0.5 * (l.top + l.bottom) + half * x
        total += half * float(w @ shear_flow(layers, E, y) ** 2) / l.G
    return total
