"""Stress, strain and energy density over the bodies, by each formulation's own law or from the section forces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from ..elements.formulations.base import Sampler, cross, of_section
from ..elements.formulations.green import elasticity, natural_at
from ..elements.section import CONSTANTS, Section, shear_flow
from ..elements.shape import Array, gauss
from ..kernels.elements import commit, stations
from ..kernels.lowlevel.records import Record
from ..model.body_groups import damping_time
from ..model.mesh import BodyMesh
from ..model.model import Model
from .section_forces import BLOCK, SectionForces, natural_rates, uncoupled_group
from .small_motions.section_motions import element_velocities, interpolation
from .state import State

RECTANGLE = 1e-9  # relative difference of the second moment from b h^3/12 up to which a section is a rectangle


@dataclass
class OverBody:
    """Stress [Pa], strain (..., 3) and energy density [J/m^3] (..., 1) at stations (ne, nx, ny) of a body.

    Components xx, yy, xy along and across the reference axis: second Piola-Kirchhoff stress and Green-Lagrange strain,
    with shear strain 2 eps_xy. For small strains this is the stress in the axes of the rotated section.
    """

    stress: Array
    strain: Array
    energy: Array

    @property
    def plastic(self) -> Array:
        """Plastic strain (..., 1) along the axis: zero."""
        return np.zeros_like(self.energy)


class _Gradients(NamedTuple):
    """Rows for u_,t and u_,n (..., points, n_shape), and t and n (..., points, 2), of elements on a grid of points."""

    t: Array
    n: Array
    along: Array
    across: Array

    @staticmethod
    def at(sampler: Sampler, xi: Array, eta: Array) -> _Gradients:
        """Return the gradients of one element class at all pairs of stations."""
        x, y = np.repeat(xi, len(eta)), np.tile(eta, len(xi))
        Sx, Sy = sampler.derivative(x, y, 1, 0), sampler.derivative(x, y, 0, 1)
        rx, ry = Sx @ sampler.e0, Sy @ sampler.e0
        det = cross(rx, ry)[:, None]
        t = rx / np.hypot(rx[:, 0], rx[:, 1])[:, None]
        n = np.stack([-t[:, 1], t[:, 0]], axis=1)
        return _Gradients(t, n, (Sx * cross(t, ry)[:, None] + Sy * cross(rx, t)[:, None]) / det,
                          (Sx * cross(n, ry)[:, None] + Sy * cross(rx, n)[:, None]) / det)

    def strain(self, u: Array, linear: bool) -> Array:
        """Return eps_tt, eps_nn, 2 eps_tn (m, points, 3) of displacements u (m, n_shape, 2) in the element's frame."""
        a, b = self.along @ u, self.across @ u
        half = 0.0 if linear else 0.5
        tt = np.sum((self.t + half * a) * a, axis=-1)
        nn = np.sum((self.n + half * b) * b, axis=-1)
        tn = np.sum(self.t * b + self.n * a, axis=-1) + 2.0 * half * np.sum(a * b, axis=-1)
        return np.stack([tt, nn, tn], axis=-1)

    def rate(self, u: Array, v: Array) -> Array:
        """Return the rates (m, points, 3) of the strains at velocities v (m, n_shape, 2)."""
        f, g = self.t + self.along @ u, self.n + self.across @ u
        fv, gv = self.along @ v, self.across @ v
        return np.stack([np.sum(f * fv, axis=-1), np.sum(g * gv, axis=-1), np.sum(f * gv + g * fv, axis=-1)], axis=-1)


class NaturalPoints:
    """Natural strains of a body at stations xi (nx,) and eta (ny,) of its elements."""

    def __init__(self, model: Model, mesh: BodyMesh, xi: Array, eta: Array) -> None:
        self.model, self.size = model, (len(xi), len(eta))
        x, y = np.repeat(xi, len(eta)), np.tile(eta, len(xi))
        self.loads = [k for k, load in enumerate(model.loads.natural) if load.mesh is mesh]
        # (loads, elements, points, 3), for unit amplitude of each load
        self.stretch = np.array([[natural_at(mesh.classes[c].sampler, partial(model.loads.natural[k].along, e), x, y)
                                  for e, c in enumerate(mesh.cls)] for k in self.loads])

    def __call__(self, state: State, some: slice = slice(None), order: int = 0) -> Array:
        """Return the strains (m, nx, ny, 3) of some elements in a state; with ``order`` 1 their time derivatives."""
        if not self.loads:
            return np.zeros(3)
        amounts, rates = (natural_rates(self.model, state, k) for k in (0, order))
        now, rate = (sum(a[k] * s[some] for k, s in zip(self.loads, self.stretch, strict=True))
                     for a in (amounts, rates))
        quadratic = 0.0 if state.linear else 1.0
        out = rate * (1.0 + quadratic * now) if order else now + 0.5 * quadratic * now**2
        return np.asarray(out).reshape(-1, *self.size, 3)


class StressByLaw:
    """Stress by the formulation's own law, for formulations with a stress at every point.

    Along an element, strains are interpolated by the polynomial through the quadrature points: between these, strains
    that an element cannot represent oscillate about the true ones, above all in shear. Material damping adds a viscous
    stress; the energy density is elastic.
    """

    def __init__(self, model: Model, mesh: BodyMesh, xi: Array, eta: Array) -> None:
        self.model, self.mesh, self.size = model, mesh, (len(xi), len(eta))
        assert mesh.plan.formulation.stress is not None
        self.law, self.middle = mesh.plan.formulation.stress, len(eta) // 2
        x, _ = gauss(mesh.plan.rule.normal[0])
        self.through = interpolation(x, xi)
        place = ("stress", x.tobytes(), xi.tobytes(), eta.tobytes())
        # for all classes, stacked: gradients, and D and D0 at the stations along the element (nx, 3, 3)
        found = [c.once(place, partial(_of_class, c.sampler, x, xi, eta)) for c in mesh.classes]
        self.gradients, self.laws = ([np.stack(part) for part in zip(*parts, strict=True)]
                                     for parts in zip(*found, strict=True))
        self.natural = NaturalPoints(model, mesh, xi, eta)
        self.tau = damping_time(model.case, mesh.plan.name)

    def __call__(self, state: State) -> OverBody:
        """Return the fields of a state."""
        mesh, n_q = self.mesh, self.model.n_q
        strain = np.empty((len(mesh.dofs), *self.size, 3))
        stress, energy = np.empty_like(strain), np.empty(strain.shape[:-1])
        for start in range(0, len(mesh.dofs), BLOCK):
            some = slice(start, start + BLOCK)
            gradients = _Gradients(*(part[mesh.cls[some]] for part in self.gradients))
            laws = [part[mesh.cls[some]] for part in self.laws]
            u = element_velocities(mesh, state.d[:n_q], some).reshape(len(gradients.t), -1, 2)
            strain[some] = self._along(gradients.strain(u, state.linear))
            stress[some], energy[some] = self._law(strain[some] - self.natural(state, some), *laws)
            if state.v is not None and self.tau > 0.0:
                v = element_velocities(mesh, state.v[:n_q], some).reshape(u.shape)
                rate = self._along(gradients.rate(u, v)) - self.natural(state, some, 1)
                stress[some] += self.tau * self._law(rate, *laws)[0]
        return OverBody(stress, strain, energy[..., None])

    def _along(self, sampled: Array) -> Array:
        """Return strains (m, nx, ny, 3) at the stations from those (m, points, 3) at the quadrature points."""
        grid = sampled.reshape(len(sampled), self.through.shape[1], self.size[1], 3)
        return np.einsum("xg,mgyc->mxyc", self.through, grid)

    def _law(self, strain: Array, D: Array, D0: Array) -> tuple[Array, Array]:
        return self.law(strain, np.broadcast_to(strain[:, :, self.middle, None], strain.shape), D, D0)


def _of_class(sampler: Sampler, x: Array, xi: Array, eta: Array) -> tuple[_Gradients, list[Array]]:
    """Return the gradients and laws of one class for ``StressByLaw``."""
    return _Gradients.at(sampler, x, eta), [np.broadcast_to(D, (len(xi), 3, 3)) for D in elasticity(sampler.at(xi))]


class StressByEquilibrium:
    """Stress of a body that only has section forces: N/A - M y/I, and Q spread over the section.

    The shear stress is the parabola of a rectangle if the section is one, else the mean Q/A. Strains are those with the
    energy of the section's given stiffnesses; a section that stays normal to the axis has no shear strain.
    """

    def __init__(self, model: Model, mesh: BodyMesh, xi: Array, eta: Array) -> None:
        self.forces, self.eta, self.mesh = SectionForces(model, mesh, xi), eta, mesh
        self.natural = NaturalPoints(model, mesh, xi, eta)
        sections = mesh.sections(xi)
        # (elements, stations along, stations across)
        arrays: dict[str, Any] = {name: np.asarray(getattr(sections, name))[..., None] for name in CONSTANTS}
        self.section = Section(**arrays)

    def __call__(self, state: State) -> OverBody:
        """Return the fields of a state."""
        section, eta = self.section, self.eta
        N, Q, M = np.moveaxis(self.forces(state), -1, 0)[..., None]
        A, I, nu = section.EA / section.E, section.EI / section.E, section.nu
        parabola = is_rectangle(section)
        axial = N / A - M / I * (0.5 * section.height * eta)
        shear = Q / A * np.where(parabola, 1.5 * (1.0 - eta**2), 1.0)
        slides = 0.0 if self.mesh.plan.element.section_kind == "tangent" else np.where(parabola, 1.0, 1.2)
        gamma = shear * slides * A / (1.2 * section.kGA)
        stress = np.stack([axial, np.zeros_like(axial), shear], axis=-1)
        strain = np.stack([axial / section.E, -nu * axial / section.E, gamma], axis=-1)
        strain = strain + self.natural(replace(state, linear=True))
        return OverBody(stress, strain, 0.5 * (axial**2 / section.E + shear * gamma)[..., None])


class StressOverLayers:
    """Stress of a body of layers: section forces give the strain of the section, and each layer's stiffness its stress.

    Natural strains of each layer are subtracted; the shear stress follows from equilibrium.
    """

    def __init__(self, model: Model, mesh: BodyMesh, xi: Array, eta: Array) -> None:
        self.forces, self.eta, self.section = SectionForces(model, mesh, xi), eta, mesh.plan.section
        self.natural = NaturalPoints(model, mesh, xi, eta)
        self.middle = NaturalSections(model, mesh, xi)
        # all stiffnesses are proportional to the width
        widths = np.array([np.broadcast_to(c.sampler.at(xi).width, len(xi)) for c in mesh.classes])
        self.share = (widths / self.section.width)[mesh.cls]

    def __call__(self, state: State) -> OverBody:
        """Return the fields of a state."""
        s = self.section
        y = 0.5 * s.height * self.eta
        E, G, nu = (s.of_layer(y, value, 0.0) for value in (lambda l: l.E, lambda l: l.G, lambda l: l.nu))
        N, Q, M = np.moveaxis(self.forces(state) / self.share[..., None], -1, 0)[..., None]
        det = s.EA * s.EI - s.ES**2
        axial, curvature = (s.EI * N + s.ES * M) / det, (s.ES * N + s.EA * M) / det
        free = self.middle(state)
        whole = axial + free[..., :1] - (curvature + free[..., 1:]) * y
        natural = np.broadcast_to(self.natural(replace(state, linear=True)), (*whole.shape, 3))
        beyond = whole - natural[..., 0]
        tau = Q * shear_flow(s.layers, (s.EA, s.ES, s.EI), y)
        stress = np.stack([E * beyond, np.zeros_like(beyond), tau], axis=-1)
        strain = np.stack([whole, natural[..., 1] - nu * beyond, tau / G], axis=-1)
        return OverBody(stress, strain, 0.5 * (E * beyond**2 + tau**2 / G)[..., None])


class NaturalSections:
    """Natural axial strain and curvature of the sections of a body at stations xi (nx,)."""

    def __init__(self, model: Model, mesh: BodyMesh, xi: Array) -> None:
        self.model, self.count = model, (len(mesh.dofs), len(xi))
        self.loads = [k for k, load in enumerate(model.loads.natural) if load.mesh is mesh]
        self.free = np.array([[of_section(mesh.classes[c].sampler, partial(model.loads.natural[k].along, e), xi)[:2]
                               for e, c in enumerate(mesh.cls)] for k in self.loads])

    def __call__(self, state: State) -> Array:
        """Return axial strain and curvature (ne, nx, 2) in a state."""
        out = np.zeros((*self.count, 2))
        amounts = natural_rates(self.model, state)
        for k, free in zip(self.loads, self.free, strict=True):
            out += amounts[k] * np.moveaxis(free, 1, -1)
        return out


def is_rectangle(section: Section) -> Any:
    """Return whether height and width give the section's area and second moment as a rectangle, at each station."""
    area = section.height * section.width
    return np.isclose(section.EI / section.E, area * section.height**2 / 12.0, rtol=RECTANGLE)


def stress_of(model: Model, mesh: BodyMesh, xi: Array, eta: Array) -> Callable[[State], OverBody]:
    """Return a function for stress, strain and energy density of a body at stations xi in [0, 1] and eta in [-1, 1].

    ``eta`` has an odd number of points with 0 in the middle.
    """
    if mesh.plan.section.layers:
        return StressOverLayers(model, mesh, xi, eta)
    own = mesh.plan.formulation.stress is not None
    return (StressByLaw if own else StressByEquilibrium)(model, mesh, xi, eta)


class StressOfFibres:
    """The fibres of a body at stations xi (ne, nx) of its elements and places eta (ny,), each with its own law.

    Shear is that of the elastic section. The transverse strain of fibres is -nu times the elastic and -1/2 times the
    plastic strain.
    """

    def __init__(self, model: Model, mesh: BodyMesh, xi: Array, eta: Array) -> None:
        self.model, self.mesh, self.size = model, mesh, (*xi.shape, len(eta))
        rows, self.rule = np.unique(xi, axis=0, return_inverse=True)
        self.elastic = [stress_of(model, mesh, row, eta) for row in rows]
        section, points = mesh.plan.section, len(eta) // len(mesh.plan.section.laws)
        self.laws = [(law, slice(k * points, (k + 1) * points)) for k, law in enumerate(section.laws)]
        nu = [layer.nu for layer in section.layers] or [section.nu]
        self.nu = np.repeat(nu, points)
        heights = np.stack([np.broadcast_to(mesh.sections(row).height, self.size[:2]) for row in rows])
        self.y = 0.5 * heights[self.rule.ravel(), np.arange(len(xi)), :, None] * eta

    def __call__(self, state: State) -> OverFibres:
        """Return the fields of a state, each of which is computed on demand."""
        return OverFibres(self, state)

    def shear(self, state: State) -> Array:
        """Return shear stress and strain (ne, nx, ny, 2) of the elastic section."""
        found = [of(state) for of in self.elastic]
        both = np.stack([np.stack([f.stress[..., 2], f.strain[..., 2]], axis=-1) for f in found])
        return np.asarray(both[self.rule.ravel(), np.arange(self.size[0])])

    def strained(self, state: State, natural: bool) -> tuple[Array, Array]:
        """Return strains of the fibres, minus ``natural`` ones if so asked, and plastic strains (ne, nx, ny)."""
        model, mesh, law = self.model, self.mesh, self.mesh.plan.formulation.law
        group = uncoupled_group(model, mesh, np.arange(self.size[0]))
        memory = group.values.memory
        states = memory.states[memory.row].copy()
        alone: Any = Record(group.values._replace(memory=memory._replace(row=np.arange(self.size[0]), states=states)))
        model.set_natural(state.side if natural else None,
                          None if state.v is None or not natural else natural_rates(model, state, 1))
        d = state.d[:model.n_q][mesh.dofs].ravel()
        commit(alone, d)
        # accepted states map to themselves
        eps, sigma = np.zeros((2, len(states), group.plan.parts * group.law.B.shape[2], law.strains))
        stations(alone, d, eps, sigma)
        found, n, nx = states[:, :self.size[1]], law.strains, self.size[1]
        eps = eps[:, :nx] + found[..., :n]
        strain = eps[..., :1] - self.y * eps[..., 1 if n == 2 else 2, None]
        return strain, found[..., 2 * n::2][..., :self.size[2]]


@dataclass
class OverFibres:
    """The results of ``OverBody`` for fibres in a state; their energy density is unknown."""

    of: StressOfFibres
    state: State

    @cached_property
    def _shear(self) -> Array:
        return self.of.shear(self.state)

    @cached_property
    def _borne(self) -> tuple[Array, Array]:
        return self.of.strained(self.state, True)

    @property
    def stress(self) -> Array:
        """Stress [Pa] (ne, nx, ny, 3)."""
        strain, plastic = self._borne
        stress = np.empty(self.of.size)
        for law, some in self.of.laws:
            stress[..., some] = law.stress_of(strain[..., some], plastic[..., some])
        return np.stack([stress, np.zeros_like(stress), self._shear[..., 0]], axis=-1)

    @property
    def strain(self) -> Array:
        """Strain (ne, nx, ny, 3)."""
        borne, plastic = self._borne
        whole = self.of.strained(self.state, False)[0] if self.of.model.loads.natural else borne
        across = -self.of.nu * (borne - plastic) - 0.5 * plastic
        return np.stack([whole, across, self._shear[..., 1]], axis=-1)

    @property
    def energy(self) -> Array:
        """Not a number (ne, nx, ny, 1)."""
        return np.full((*self.of.size, 1), np.nan)

    @property
    def plastic(self) -> Array:
        """Plastic strain (ne, nx, ny, 1) along the axis."""
        return self._borne[1][..., None]
