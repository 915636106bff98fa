"""Formulations of the elastic forces: strains as functions of a few gradient fields, with a constant stiffness.

Every linear elastic energy is U = sum_s 1/2 eps_s^T D_s eps_s over sampling stations s, with strains eps(u) of the
fields u = B d, where d are the element's displacements from its reference in the element's own frame. A formulation
supplies B, the strain function with its Jacobian, and its second derivatives; one kernel does the rest.
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
class StrainLaw:
    """Strains of one point as functions of its fields; formulations that sample different points may share a law.

    The kernels compile the functions for one point in many lanes: ref (any, lanes), u (fields, lanes), eps and
    sigma (strains, lanes), J (strains, fields, lanes), H (fields, fields, lanes).

    ``strain(ref, u, eps, J, lanes)`` fills eps and the nonzero entries of J = d eps/du; J[0, 0] must not be zero.
    ``geometric(ref, u, sigma, J, H, lanes)`` adds sum_i sigma_i d2 eps_i/du2 to the upper half of H; J is from
    ``strain``, or from ``mean`` if there is one. ``mean(ref, u0, u1, eps0, eps1, J, lanes)`` overwrites the entries of
    J that ``strain`` fills with those of the discrete Jacobian between two states with given strains: J (u1 - u0) =
    eps1 - eps0, and a rotation of the mid-configuration causes no strain by J (Gonzalez 1996, in quadratic invariants
    of the position gradients). None if no such form is known: then no time step conserves both energy and angular
    momentum. ``quadratic`` lists the strains that are L + L^2/2 under a stretch by 1 + L, such as Green-Lagrange
    strains.

    A law with memory has ``state`` numbers at each point, initially 0. The first are its internal strains eps_i, which
    bear no stress: sigma = D (eps - eps_i). ``internal(ref, eps, old, new, slope, lanes)`` fills the state new (state,
    lanes) for the strains eps and the last accepted state old, and the nonzero entries of slope (strains, strains,
    lanes) = d eps_i/d eps; D slope must be symmetric. With new as old and the same strains, the state must not change.
    If internal strains are sums with cancellation, the next numbers of the state, one per strain, are the magnitudes
    of the summands: round-off is a share of them.
    ``inelastic`` lists the strains that have internal parts, by default all: stations whose D is zero for these have no
    state. These functions may call other functions of numbers and arrays. If the law is ``timed``, the last number of
    the state is the time since the last accepted state, which solvers set.
    ``elastic``: internal strains depend on the present strains alone, so there is no state to keep.
    ``extra_energy(ref, D, eps, state)`` returns the stored energy (elements, stations) beyond eps^T D eps/2 of the
    stress-bearing strains eps (elements, stations, points strains); ref (stations, points, any), D (stations, points
    strains, points strains), state (elements, stations, points, numbers).
    The work of the internal strains in a step is counted with the stress at its end; ``excess_work(ref, D, state)``
    returns the accumulated excess (elements, stations) over the true work, if the law can compute it.
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
    inelastic: tuple[int, ...] = ()
    timed: bool = False
    elastic: bool = False
    extra_energy: Callable[[Any, Any, Any, Any], Any] | None = None
    excess_work: Callable[[Any, Any, Any], Any] | None = None

    @property
    def remembers(self) -> bool:
        """Whether the law keeps a state, on which its stresses depend."""
        return self.state > 0 and not self.elastic


@dataclass(frozen=True)
class Rule:
    """Quadrature: Gauss points (along, across) for the normal strains and for shear (usually the same).

    ``lobatto``: the stretch of a curve is sampled at the same number of Gauss-Lobatto points along the axis.
    """

    normal: tuple[int, int]
    shear: tuple[int, int]
    lobatto: bool = False

    @property
    def uniform(self) -> bool:
        """Whether normal strains and shear use the same points."""
        return self.normal == self.shear

    def __str__(self) -> str:
        """Return the rule in words."""
        words = f"{self.normal[0]} x {self.normal[1]} Gauss points"
        if self.lobatto:
            words += ", stretch at as many Lobatto points"
        return words if self.uniform else f"{words} (shear {self.shear[0]} x {self.shear[1]})"


@dataclass(frozen=True)
class Sampler:
    """The data that a formulation samples: shape functions, section and the element's reference in its own frame.

    ``e0`` (n_shape, components): the reference nodal coordinates, rotated so that the element starts
    along x. If the section varies, ``profile`` gives its constants at stations xi (n,), ``section`` has the mean
    values of the body, and ``cuts`` are the positions xi in the element where the section has a kink or jump. ``peak``
    is -1 or 1 if the moment of fibres may peak at the start or at the end of the element, else 0.
    """

    shape: ShapeFunctions
    e0: Array
    section: Section
    profile: Callable[[Array], Section] | None = None
    cuts: tuple[float, ...] = ()
    peak: int = 0

    def points(self, n: int) -> tuple[Array, Array]:
        """Return n points in [0, 1] along and their weights (sum 1): Gauss points, or Radau points at a peak."""
        if self.peak == 0 or n < 2:
            return gauss(n)
        x, w = radau(n)
        return (x, w) if self.peak < 0 else (1.0 - x[::-1], w[::-1])

    def at(self, xi: Array) -> Section:
        """Return the section constants at stations xi (n,) along: arrays (n,) where they vary, else numbers."""
        return self.section if self.profile is None else self.profile(xi)

    def derivative(self, xi: Array, eta: Array, i: int, j: int) -> Array:
        """Return d^(i+j) S/dx^i dy^j (points, n_shape) at points; eta runs from -1 to 1 between the faces."""
        height = self.at(xi).height
        return self.shape(xi, eta * (height / self.shape.h), i, j)

    def spread(self, S: Array, component: int) -> Array:
        """Expand shape-function rows (points, n_shape) to rows over all element coordinates, for one component."""
        nc = self.e0.shape[1]
        out = np.zeros((len(S), S.shape[1] * nc))
        out[:, component::nc] = S
        return out

    def vectors(self, *fields: Array) -> Array:
        """Return rows (points, 2 fields, n_dof) over the element coordinates for x and y of vectors that are given by
        shape-function rows (points, n_shape)."""
        nc = self.e0.shape[1]
        out = np.zeros((len(fields[0]), 2 * len(fields), fields[0].shape[1] * nc))
        for k, S in enumerate(fields):
            out[:, 2 * k, 0::nc] = out[:, 2 * k + 1, 1::nc] = S
        return out


# imposed strains of an element: from stations xi (n,) in [0, 1] to (4, n) axial strain, curvature [1/m], temperature
# change [K] on the axis and its gradient [K/m] across
Free = Callable[[Array], Array]


def of_section(sampler: Sampler, free: Free, xi: Array) -> tuple[Array, Array, Array]:
    """Return the axial strain, curvature and strain across (n,) of sections at xi under ``free`` without stress."""
    axial, curvature, value, gradient = free(xi)
    return sampler.at(xi).free(axial, curvature, value, gradient)


# function of strains (..., 3) at points, strains on the axis at the same x, and D and D0 of ``green.elasticity``, that
# returns stress (..., 3) and energy density (...)
StressLaw = Callable[[Array, Array, Array, Array], tuple[Array, Array]]


@dataclass(frozen=True)
class Formulation:
    """A selectable form of the elastic forces.

    ``refuse(element)`` returns the reason why the formulation does not suit a type, or None. ``rule(element)`` is
    its default quadrature; ``exact(element)`` the rule that integrates a straight element exactly, or
    None if no finite rule does. ``sample(sampler, rule)`` returns B (stations, fields, n_dof), ref (stations,
    any) and D (stations, strains, strains) of one class of elements, including quadrature weight and volume; the
    fields, reference values and strains of a station are those of its points, one after another.
    ``selective``: shear may have its own rule; ``lobatto``: the default rule uses Lobatto points.
    ``fibres(sampler, rule)`` returns the positions xi of the stations, and (B, ref, D) as ``sample`` does, in a form in
    which the first strain is the axial strain, and the second of two or the third of more the curvature, so that
    sections can be made of fibres; None if there are no such strains.
    ``points``: under one rule and without layers, each station is one point in plane stress with Green-Lagrange strain.
    ``green``: the strains are Green-Lagrange strains of any kind.
    ``stress`` gives stress and energy density at a point; None: stress is recovered from the section forces.
    ``natural(sampler, rule, free)`` returns the strains (stations, strains), in the order of ``sample``, of an element
    without stress under the imposed strains ``free``, linear in these; None: imposed strains are not possible.
    """

    name: str
    law: StrainLaw
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
    """Return xi in [0, 1], eta in [-1, 1] and weights (sum 1) of an nx by ny Gauss rule, x slowest; read-only
    arrays."""
    found = product_points(gauss(rule[0]), gauss(rule[1]))
    for one in found:
        one.flags.writeable = False
    return found


def product_points(along: tuple[Array, Array], across: tuple[Array, Array]) -> tuple[Array, Array, Array]:
    """Return the points and weights of the product of two rules on [0, 1], in the form of ``rule_points``."""
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
