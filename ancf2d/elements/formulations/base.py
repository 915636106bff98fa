"""What a formulation is: strains of a few gradient fields, with a constant stiffness between them.

Every elastic energy of this project is U = sum_s 1/2 eps_s^T D_s eps_s over sampling stations s, with
strains eps(u) of the fields u = B d, d the element's displacements from its reference in the element's
own frame. A formulation states B, the strain function with its Jacobian, and its second derivatives;
one kernel does the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from ..definition import ElementType
from ..section import Section
from ..shape import Array, ShapeFunctions, gauss, radau


@dataclass(frozen=True)
class PointLaw:
    """Strains of one point as functions of its fields; formulations that differ in what they sample may share one.

    Functions are compiled by the kernels for one point in many lanes: ref (any, lanes), u (fields, lanes), eps and
    sigma (strains, lanes), J (strains, fields, lanes), H (fields, fields, lanes).

    ``strain(ref, u, eps, J, lanes)`` fills eps and J = d eps/du, whose zeros are left alone, J[0, 0] being none.
    ``geometric(ref, u, sigma, J, H, lanes)`` adds sum_i sigma_i d2 eps_i/du2 to the upper half of H; J is that of
    ``strain``, unless there is a ``mean``. ``mean(ref, u0, u1, eps0, eps1, J, lanes)`` overwrites the entries of J that
    ``strain`` fills with those of the discrete Jacobian between two states whose strains are given: J (u1 - u0) =
    eps1 - eps0, and turning the mid-configuration makes no strain by J (Gonzalez 1996, in quadratic invariants of the
    position gradients). None where no such form is known: then no time step keeps energy and angular momentum at once.
    ``quadratic`` are the strains that a stretch by 1 + L makes L + L^2/2, such as those of Green and Lagrange.

    A law with memory has so many numbers of ``state`` at each point, all 0 to begin with. The first are its internal
    strains eps_i, which bear no stress: sigma = D (eps - eps_i). ``internal(ref, eps, old, new, slope, lanes)`` fills
    the state new (state, lanes) that the strains eps lead to from old, the state at the end of the last accepted step,
    and slope (strains, strains, lanes) = d eps_i/d eps, whose zeros are left alone; D slope has to be symmetric. At the
    strains of an accepted step, the new state leads to itself. Where internal strains are sums that cancel, the next
    numbers of the state, as many, tell how large these are: round-off is a share of them.
    These may call other functions of numbers and arrays. Of a ``timed`` law the last number of the state is the time
    since the last accepted state, which solvers set.
    ``elastic`` tells that internal strains follow from the strains alone: then there is no state to keep.
    ``stored(ref, D, eps, state)`` returns the energy (elements, stations) that is kept beyond eps^T D eps/2 of the
    strains eps (elements, stations, points strains) that bear stress; ref (stations, points, any), D (stations, points
    strains, points strains), state (elements, stations, points, numbers).
    What internal strains take in a step is told as that under the stress at its end; ``overtold(ref, D, state)`` tells
    by how much (elements, stations) this is too much so far, where a law knows it.
    """

    fields: int
    strains: int
    references: int
    strain: Callable[..., Any]
    geometric: Callable[..., Any]
    mean: Callable[..., Any] | None = None
    quadratic: tuple[int, ...] = ()
    state: int = 0
    internal: Callable[..., Any] | None = None
    timed: bool = False
    elastic: bool = False
    stored: Callable[[Any, Any, Any, Any], Any] | None = None
    overtold: Callable[[Any, Any, Any], Any] | None = None


@dataclass(frozen=True)
class Rule:
    """Quadrature: Gauss points (along, across) for the normal strains and for shear (usually the same).

    ``lobatto``: the stretch of a curve is sampled at as many Gauss-Lobatto points along.
    """

    normal: tuple[int, int]
    shear: tuple[int, int]
    lobatto: bool = False

    @property
    def uniform(self) -> bool:
        """Whether one rule serves both."""
        return self.normal == self.shear

    def __str__(self) -> str:
        """Return the rule in words."""
        words = f"{self.normal[0]} x {self.normal[1]} Gauss points"
        if self.lobatto:
            words += ", stretch at as many Lobatto points"
        return words if self.uniform else f"{words} (shear {self.shear[0]} x {self.shear[1]})"


@dataclass(frozen=True)
class Sampler:
    """What a formulation samples: shape functions, section and the element's reference in its own frame.

    ``e0`` is (n_shape, components): the reference nodal coordinates turned so that the element starts
    along x. Where the section varies, ``profile`` gives its constants at stations xi (n,), ``section`` is that of the
    body's mean values, and ``cuts`` are the places xi inside the element where it kinks or jumps. ``peak`` is -1 or 1
    where the moment of fibres may peak at the start or at the end of the element, else 0.
    """

    shape: ShapeFunctions
    e0: Array
    section: Section
    profile: Callable[[Array], Section] | None = None
    cuts: tuple[float, ...] = ()
    peak: int = 0

    def points(self, n: int) -> tuple[Array, Array]:
        """Return n points in [0, 1] along and their weights (sum 1): those of Gauss, or of Radau with a peak."""
        if self.peak == 0 or n < 2:
            return gauss(n)
        x, w = radau(n)
        return (x, w) if self.peak < 0 else (1.0 - x[::-1], w[::-1])

    def at(self, xi: Array) -> Section:
        """Return the section constants at stations xi (n,) along: arrays (n,) where they vary, else numbers."""
        return self.section if self.profile is None else self.profile(xi)

    def derivative(self, xi: Array, eta: Array, i: int, j: int) -> Array:
        """Return d^(i+j) S/dx^i dy^j at points (points, n_shape); eta from -1 to 1 from face to face."""
        height = self.at(xi).height
        return self.shape(xi, eta * (height / self.shape.h), i, j)

    def spread(self, S: Array, component: int) -> Array:
        """Return shape-function rows (points, n_shape) as rows on the element coordinates of a component."""
        nc = self.e0.shape[1]
        out = np.zeros((len(S), S.shape[1] * nc))
        out[:, component::nc] = S
        return out

    def vectors(self, *fields: Array) -> Array:
        """Return x and y of vectors, each given by shape-function rows (points, n_shape), as rows on the element
        coordinates: (points, 2 fields, n_dof)."""
        nc = self.e0.shape[1]
        out = np.zeros((len(fields[0]), 2 * len(fields), fields[0].shape[1] * nc))
        for k, S in enumerate(fields):
            out[:, 2 * k, 0::nc] = out[:, 2 * k + 1, 1::nc] = S
        return out


# what would strain an element if it were free: from stations xi (n,) in [0, 1] to (4, n) axial strain and curvature
# [1/m], temperature [K] at the axis and its gradient [K/m] across
Free = Callable[[Array], Array]


def of_section(sampler: Sampler, free: Free, xi: Array) -> tuple[Array, Array, Array]:
    """Return axial strain, curvature and strain across (n,) that sections at xi would have if they were free."""
    axial, curvature, value, gradient = free(xi)
    return sampler.at(xi).free(axial, curvature, value, gradient)


# from strains (..., 3) at points and on the axis below them, and D and D0 of ``green.elasticity``: stress (..., 3) and
# energy density (...)
StressLaw = Callable[[Array, Array, Array, Array], tuple[Array, Array]]


@dataclass(frozen=True)
class Formulation:
    """A selectable form of the elastic forces.

    ``refuse(element)`` gives the reason why it makes no sense for a type, or None. ``rule(element)`` is
    its default quadrature; ``exact(element)`` the rule that integrates a straight element exactly, or
    None where no finite rule does. ``sample(sampler, rule)`` returns B (stations, fields, n_dof), ref (stations,
    any) and D (stations, strains, strains) of one element class, quadrature weight and volume included; fields,
    reference values and strains of a station are those of its points, one after another.
    ``selective`` tells whether shear may have a rule of its own, ``lobatto`` whether the default rule is such a one.
    ``fibres(sampler, rule)`` returns the places xi of stations whose strains, the first and the last or third, are the
    axial strain and the curvature of sections that fibres make, with what ``sample`` returns of them; None where it has
    no such strains.
    ``points`` tells whether stations, under one rule and without layers, are its points, each in plane stress and with
    Green's strain. ``green`` tells whether the strains are Green's in any way.
    ``stress`` gives stress and energy density where a formulation has them at every point; without one, stress is
    recovered from the section forces. ``natural(sampler, rule, free)`` returns the strains (stations, strains), in the
    order of ``sample``, that an element would have if it were free, linear in what strains it; without one, nothing but
    displacements can strain a body of this formulation.
    """

    name: str
    law: PointLaw
    refuse: Callable[[ElementType], str | None]
    rule: Callable[[ElementType], tuple[int, int]]
    exact: Callable[[ElementType], tuple[int, int] | None]
    sample: Callable[[Sampler, Rule], tuple[Array, Array, Array]]
    source: str
    doc: str
    selective: bool = True
    lobatto: bool = False
    stress: StressLaw | None = None
    natural: Callable[[Sampler, Rule, Free], Array] | None = None
    fibres: Callable[[Sampler, Rule], tuple[Array, tuple[Array, Array, Array]]] | None = None
    points: bool = False
    green: bool = False


def strains_at(formulation: Formulation, ref: Array, u: Array) -> tuple[Array, Array]:
    """Return the strains (strains,) and their derivatives J (strains, fields) of one station.

    ``ref`` (any,) and ``u`` (fields,) are its reference values and fields, point by point; ``u`` may be complex.
    """
    law = formulation.law
    points = len(u) // law.fields
    eps, J = np.zeros((points, law.strains), u.dtype), np.zeros((points, law.strains, len(u)), u.dtype)
    for p, (r, v) in enumerate(zip(ref.reshape(points, -1), u.reshape(points, -1), strict=True)):
        own = J[p, :, p * len(v):(p + 1) * len(v), None]
        law.strain(r[:, None], v[:, None], eps[p, :, None], own, 1)
    return eps.ravel(), J.reshape(-1, len(u))


@lru_cache
def rule_points(rule: tuple[int, int]) -> tuple[Array, Array, Array]:
    """Return xi in [0, 1], eta in [-1, 1] and weights (sum 1) of an nx by ny Gauss rule, x slowest, not to be written
    to."""
    found = product_points(gauss(rule[0]), gauss(rule[1]))
    for one in found:
        one.flags.writeable = False
    return found


def product_points(along: tuple[Array, Array], across: tuple[Array, Array]) -> tuple[Array, Array, Array]:
    """Return the points and weights of two rules on [0, 1] together, as ``rule_points`` does."""
    (x, wx), (y, wy) = along, across
    return np.repeat(x, len(y)), np.tile(2 * y - 1, len(x)), np.outer(wx, wy).ravel()


def across_mass(sampler: Sampler) -> tuple[Array, Array]:
    """Return points in [0, 1] from face to face of a section, and weights that integrate over its mass."""
    element, section = sampler.shape.element, sampler.section
    y, w = gauss(element.degree_y + 2)
    if not section.layers or not section.rhoA or element.degree_y == 0:
        return y, w
    thick = [layer.top - layer.bottom for layer in section.layers]
    points = [0.5 + (layer.bottom + t * y) / section.height for layer, t in zip(section.layers, thick, strict=True)]
    mass = [layer.rho * t * section.width / section.rhoA * w for layer, t in zip(section.layers, thick, strict=True)]
    return np.concatenate(points), np.concatenate(mass)


def diagonal(ds: Array, *stiffness: float) -> Array:
    """Return D (stations, n, n) = ds diag(stiffness); each stiffness is a number or an array (stations,)."""
    D = np.zeros((len(ds), len(stiffness), len(stiffness)))
    for k, value in enumerate(stiffness):
        D[:, k, k] = ds * value
    return D


def coupled(D: Array, ds: Array, ES: Any, stretch: int, bend: int) -> Array:
    """Return D with the coupling -ES of a stretch and a curvature, per length ds (stations,)."""
    D[:, stretch, bend] = D[:, bend, stretch] = -ds * ES
    return D


def join(*parts: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
    """Return (B, ref, D) of several sets of stations as one."""
    B, ref, D = (np.concatenate(column) for column in zip(*parts, strict=True))
    return B, ref, D


def cross(a: Array, b: Array) -> Array:
    """Return the planar cross products a x b of rows."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
