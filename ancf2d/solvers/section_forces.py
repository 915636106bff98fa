"""Section forces N, Q, M along a body, from the equilibrium of each element's part before (or after) the section."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from ..elements.formulations.base import cross
from ..elements.shape import Array, gauss
from ..interactions.body_loads import Line, per_length
from ..interactions.inertia import mass_terms
from ..interactions.tendons import Guide
from ..kernels.elements import force as elastic_force
from ..kernels.elements import natural_slope, tangent_action, viscous_force
from ..kernels.stress_free import memory_of_some, of_some
from ..model.body_groups import damping_time, place_in_pools
from ..model.classes import Volume, over_body
from ..model.mesh import BodyMesh, Index
from ..model.model import Model
from ..model.profiles import load_breaks
from ..model.timing import rates_of
from .element_loads import Inside, acting_inside, is_inside
from .linear import inertia_rates
from .state import State

BLOCK = 2048  # number of elements per block, which limits the memory of element matrices and sampled loads
KEPT = 8  # number of cached element groups, for elements of several shapes
SAME = 1e-12  # tolerance for places along a body, relative to its length
POINTS = 6  # Gauss points of line loads on an element or a part of it


def has_section_forces(mesh: BodyMesh) -> bool:
    """Return whether the body has section forces: a rigid one has no law that determines them."""
    return not mesh.plan.rigid


def uncoupled_group(model: Model, mesh: BodyMesh, chosen: Index) -> Any:
    """Return the group of chosen elements (m,), each with coordinates of its own, so that no forces are summed."""
    pool, first = place_in_pools(model.pools, mesh)
    group, dofs, some = model.groups[pool], mesh.dofs[chosen], first + np.asarray(chosen)
    own = np.arange(dofs.size).reshape(dofs.shape)
    if np.array_equal(some, np.arange(len(group.dofs))):
        return group.replaced(dofs=own)
    turn = group.turn[some] if len(group.turn) > 1 else group.turn
    return group.replaced(cls=group.cls[some], turn=turn, natural=of_some(group.values.natural, some),
                          memory=memory_of_some(group.values.memory, some), dofs=own)


def nodal_forces(model: Model, mesh: BodyMesh, state: State, chosen: Index, alone: Any = None
                 ) -> tuple[Array, float, Any]:
    """Return the elastic forces (m, n) of chosen elements on their coordinates, their strain energy, and their group.

    The group is that of ``uncoupled_group``; it may be given as ``alone``.
    """
    alone, dofs = alone or uncoupled_group(model, mesh, chosen), mesh.dofs[chosen]
    d, Q = state.d[:model.n_q][dofs].ravel(), np.zeros(dofs.size)
    if state.linear:
        zero, natural = np.zeros_like(d), np.zeros_like(d)
        model.set_natural(None, natural_rates(model, state))
        energy = natural_slope(alone, zero, natural) if model.loads.natural else 0.0
        model.set_natural(None)
        tangent_action(alone, zero, d, Q)
        energy += 0.5 * float(Q @ d) + float(natural @ d)
        Q += natural
    else:
        model.set_natural(state.side, None if state.v is None else natural_rates(model, state, 1))
        start = d if state.about is None else state.about[:model.n_q][dofs].ravel()
        energy = elastic_force(alone, start, Q)
        if start is not d:
            tangent_action(alone, start, d - start, Q)
    return Q.reshape(dofs.shape), energy, alone


def natural_rates(model: Model, state: State, order: int = 0) -> dict[int, float]:
    """Return the amplitudes of natural strains in a state by the number of their load, or (``order`` 1) their rates."""
    rates = [rates_of(load.amplitude, state.side)[0] if order else load.amplitude(state.side)
             for load in model.loads.natural]
    return dict(enumerate(rates))


def stacked(parts: Sequence[Array]) -> Array:
    """Return arrays that differ in length as one (parts, longest, ...), with zeros behind the shorter ones."""
    longest = max(map(len, parts))
    return np.stack([np.pad(x, [(0, longest - len(x)), *[(0, 0)] * (x.ndim - 1)]) for x in parts])


class SectionForces:
    """N, Q, M of one body at the same stations ``xi`` (k,) in [0, 1] of every element.

    The element's nodal forces, minus the consistent forces of loads and inertia on it, are the forces at its ends, in
    balance regardless of the accuracy of the formulation's stresses. Loads, masses, springs, supports and joints
    between nodes act at their points; the imbalance of inner nodes is distributed evenly along the element.
    """

    def __init__(self, model: Model, mesh: BodyMesh, xi: Array) -> None:
        self.model, self.mesh, self.xi = model, mesh, np.asarray(xi, dtype=float)
        # of the parts before each station, and of the whole element
        self.ends = np.append(self.xi, 1.0)
        element = mesh.plan.element
        self.nc = element.components
        self.tau = damping_time(model.case, mesh.plan.name)
        self.is_r = np.array([name == "r" for _, name in element.functionals])
        self.first_node = np.array([node == 0 for node, _ in element.functionals])
        self.last_node = np.array([node == len(element.nodes) - 1 for node, _ in element.functionals])
        # elements that differ only in section are processed together
        kinds: dict[Any, int] = {}
        kind = [kinds.setdefault((id(c.shape), c.sampler.cuts, c.sampler.profile is None), len(kinds))
                for c in mesh.classes]
        self.kinds, self.kind = len(kinds), np.array(kind)[mesh.cls]
        points = [(item, model.point(item.at)) for item in model.case.resting_masses]
        self.point_masses = [(p, mass_terms(item, p)) for item, p in points if is_inside(p, mesh)]
        self.inside: list[Inside] = []
        # strain energy of the last evaluated elements, without that of a viscous stress
        self.energy = 0.0
        self.along = gauss(POINTS)
        self._uncoupled: dict[bytes, Any] = {}

    def uncoupled(self, chosen: Index) -> Any:
        """Return the group of ``uncoupled_group``, cached for repeated sets of elements."""
        key = np.asarray(chosen).tobytes()
        if key not in self._uncoupled:
            if len(self._uncoupled) >= KEPT:
                self._uncoupled.clear()
            self._uncoupled[key] = uncoupled_group(self.model, self.mesh, chosen)
        return self._uncoupled[key]

    @cached_property
    def masses(self) -> list[Array]:
        """The mass matrix of each class."""
        return [c.mass for c in self.mesh.classes]

    @cached_property
    def volumes(self) -> list[Volume]:
        """For each class, the mass quadratures (k + 1, points, ...) of its part before each station, and of all of it.
        """
        return [Volume(*map(stacked, zip(*(over_body(c.sampler, x) for x in self.ends), strict=True)))
                for c in self.mesh.classes]

    def __call__(self, state: State, elements: Index | None = None) -> Array:
        """Return N (tension) along the section's x axis, Q along its y axis, M counter-clockwise: (m, k, 3).

        These are for the given elements (m,), by default for all.
        """
        every = np.arange(len(self.mesh.dofs)) if elements is None else elements
        self.inside, self.energy = acting_inside(self.model, self.mesh, state), 0.0
        out = np.empty((len(every), len(self.xi), 3))
        for start in range(0, len(every), BLOCK):
            block = every[start:start + BLOCK]
            for k in np.unique(self.kind[block]) if self.kinds > 1 else [0]:
                mine = np.flatnonzero(self.kind[block] == k)
                out[start + mine] = _Part(self, state, block[mine]).forces()
        return out


class _Part:
    """Some elements of equal shape in one state; wrenches are (fx, fy, moment) about each element's first node."""

    def __init__(self, body: SectionForces, state: State, chosen: Index) -> None:
        self.body, self.state, self.chosen = body, state, chosen
        cls = body.mesh.cls[chosen]
        self.k, self.classes = int(cls[0]), cls if np.any(cls != cls[0]) else None
        model, n_q = body.model, body.model.n_q
        self.dofs = body.mesh.dofs[chosen]
        d = np.zeros(n_q) if state.linear else state.d[:n_q]
        self.d = d[self.dofs].reshape(len(chosen), -1, body.nc)
        self.e = model.e0[self.dofs].reshape(self.d.shape) + self.d
        self.pole = self.e[:, :1, :2].copy()
        self.local = self.e[..., :2] - np.where(body.is_r[:, None], self.pole, 0.0)
        self.rates = self._accelerations()
        self.lines = list(self._line_loads())
        self.guides = [(g, g.tension(state.d[:n_q], state.side)) for g in model.loads.guides if g.mesh is body.mesh]
        # elements, xi and generalised forces of the actions inside them
        inner = list(self._inner_forces())
        self.within, self.at = np.array([i[0] for i in inner], dtype=np.int64), np.array([i[1] for i in inner])
        self.acting = np.array([i[2] for i in inner]).reshape(-1, *self.e.shape[1:])

    def _each(self, of_classes: list[Array]) -> Array:
        """Return the array of the common class, or those of all elements (m, ...) if their classes differ."""
        return of_classes[self.k] if self.classes is None else np.array([of_classes[k] for k in self.classes])

    def _accelerations(self) -> Array | None:
        """Return nodal values (m, n_shape, nc) of gravity, centrifugal and Coriolis acceleration minus a, or None."""
        body, model = self.body, self.body.model
        out, found = np.zeros_like(self.e), False
        for load in model.case.loads:
            if load.acceleration is not None:
                g = self._factor(load) * np.array(load.acceleration, float)
                out[..., :2] += np.where(body.is_r[:, None], g, 0.0)
                found = True
        spin = model.case.steady_rotation
        if spin is not None:
            centre = np.where(body.is_r[:, None], np.array(spin.about, float), 0.0)
            out[..., :2] += self.state.t * spin.omega**2 * (self.e[..., :2] - centre)
            if self.state.v is not None:
                v = self.state.v[self.dofs].reshape(self.e.shape)
                out[..., 0] += 2.0 * spin.omega * v[..., 1]
                out[..., 1] -= 2.0 * spin.omega * v[..., 0]
            found = True
        a = inertia_rates(model, self.state)
        if a is not None:
            out -= a[self.dofs].reshape(self.e.shape)
            found = True
        return out if found else None

    def _factor(self, load: Any) -> float:
        return float(self.body.model.timing.factor(load)(self.state.side))

    def _line_loads(self) -> Iterator[tuple[Line, float]]:
        for load in self.body.model.case.loads:
            line = load.line
            if line is not None and line.body == self.body.mesh.plan.name:
                yield line, self._factor(load)

    def _inner_forces(self) -> Iterator[tuple[int, float, Array]]:
        """Yield element, xi and generalised forces (n_shape, nc) of actions inside the elements."""
        place = {int(ie): m for m, ie in enumerate(self.chosen)}
        for item in self.body.inside:
            if item.ie in place:
                yield place[item.ie], item.xi, item.force.reshape(-1, self.body.nc)
        if self.rates is None:
            return
        for point, terms in self.body.point_masses:
            if point.ie not in place:
                continue
            m = place[point.ie]
            rates, force, first = self.rates[m].ravel(), np.zeros(self.dofs.shape[1]), self.dofs[m, 0]
            for term in terms:
                for coords, weights in term.columns:
                    force[coords - first] += term.inertia * (weights @ rates[coords - first]) * weights
            yield m, point.xi, force.reshape(-1, self.body.nc)

    def _line_samples(self, ends: Array) -> Iterator[tuple[Array, Array]]:
        """Yield points xi (m, k, g) before each of ``ends`` (k,) for each line load, and their forces (m, k, g, 2)."""
        mesh = self.body.mesh
        start, l = mesh.starts[self.chosen, None], mesh.lengths[self.chosen, None]
        x, w = self.body.along
        parts = [(line, factor, a, b) for line, factor in self.lines for a, b in pairwise(load_breaks(line))]
        for line, factor, a, b in parts:
            low = np.maximum(a * mesh.plan.length - start, 0.0)
            span = np.maximum(np.minimum(b * mesh.plan.length - start, ends * l) - low, 0.0)[..., None]
            flat = (xi := (low[..., None] + x * span) / l[..., None]).reshape(len(l), -1)
            f = factor * per_length(line.density, mesh, self.chosen, flat)
            if line.follower:
                c, s = self._axes(flat)
                f = np.array([c * f[0] - s * f[1], s * f[0] + c * f[1]])
            force = np.moveaxis(np.broadcast_to(f, (2, *flat.shape)), 0, -1).reshape(*xi.shape, 2)
            yield xi, force * (w * span)[..., None]

    def _rows(self, xi: Array, i: int = 0, j: int = 0, y: Array | None = None) -> Array:
        """Return shape functions (..., n_shape), or derivatives, at xi (...), on the axis or at y (...)."""
        shape = self.body.mesh.classes[self.k].shape
        eta = np.zeros(xi.size) if y is None else 2.0 * y.ravel() / shape.h
        return shape(xi.ravel(), eta, i, j).reshape(*xi.shape, -1)

    def _axes(self, xi: Array) -> tuple[Array, Array]:
        """Return cosine and sine (m, g) of the sections' angles at xi (m, g)."""
        body = self.body
        mesh = body.mesh
        angle = mesh.angles_at(self.chosen, xi)
        if self.state.linear:
            return np.cos(angle), np.sin(angle)
        kind = body.mesh.plan.element.section_kind
        if kind == "theta":
            angle = angle + np.einsum("mgk,mk->mg", self._rows(xi), self.d[..., 2])
        else:
            rows = self._rows(xi, *((0, 1) if kind == "interpolated" else (1, 0)))
            v, dv = (rows @ q[..., :2] for q in (self.e, self.d))
            v0 = v - dv
            angle = angle + np.arctan2(cross(v0, dv), np.sum(v0 * (v0 + dv), axis=-1))
        return np.cos(angle), np.sin(angle)

    def _nodal(self) -> Array:
        """Return the elastic and viscous forces (m, n_shape, nc) of the elements on their coordinates."""
        body, state = self.body, self.state
        Q, energy, alone = nodal_forces(body.model, body.mesh, state, self.chosen, body.uncoupled(self.chosen))
        body.energy += energy
        if not state.linear and state.v is not None and body.tau:
            d, v = (x[:body.model.n_q][self.dofs].ravel() for x in (state.d, state.v))
            viscous_force(alone, body.tau, d, v, Q.reshape(-1))
        return Q.reshape(len(Q), -1, body.nc)

    def _consistent(self) -> Array:
        """Return the consistent forces (m, n_shape, nc) of the loads on the elements' own coordinates."""
        out = np.zeros_like(self.e)
        for xi, force in self._line_samples(np.ones(1)):
            out[..., :2] += np.einsum("mgk,mgc->mkc", self._rows(xi[:, 0]), force[:, 0])
        if self.rates is not None:
            M = self._each(self.body.masses)
            out += (self.rates.reshape(len(self.dofs), 1, -1) @ M).reshape(out.shape)
        np.add.at(out, self.within, self.acting)
        return out

    def _node_wrench(self, forces: Array, chosen: Array, elements: Index | slice = slice(None)) -> Array:
        """Return the wrench (m, 3) of generalised forces on the chosen coordinates of elements."""
        f = forces[:, chosen]
        moment = cross(self.local[elements][:, chosen], f).sum(axis=1)
        if self.body.nc == 3:
            moment = moment + f[:, :, 2].sum(axis=1)
        at = self.body.is_r & chosen
        return np.concatenate([forces[:, at, :2].sum(axis=1), moment[:, None]], axis=1)

    def _loads_before(self) -> Array:
        """Return the wrenches (m, k + 1, 3) of the loads on the elements' parts before each station, and on the whole.
        """
        ends, local = self.body.ends, self.local[:, None]
        total = np.zeros((len(self.dofs), len(ends), 3))
        for xi, force in self._line_samples(ends):
            total[..., :2] += force.sum(axis=-2)
            total[..., 2] += cross(self._rows(xi) @ local, force).sum(axis=-1)
        if len(self.within):
            acting = self._node_wrench(self.acting, np.ones(self.acting.shape[1], bool), self.within)
            for k, end in enumerate(ends):
                before = (self.at < end) | (self.at == 0.0) | (k == len(ends) - 1)
                np.add.at(total[:, k], self.within[before], acting[before])
        if self.rates is None:
            return total
        S, dm, dI = (self._each([v[j] for v in self.body.volumes]) for j in range(3))
        b = S @ self.rates[:, None]
        f = dm[..., None] * b[..., :2]
        total[..., :2] += f.sum(axis=-2)
        total[..., 2] += cross(S @ local, f).sum(axis=-1)
        if self.body.nc == 3:
            total[..., 2] += (b[..., 2] * dI).sum(axis=-1)
        return total

    def forces(self) -> Array:
        """Return N, Q, M (m, k, 3) at the stations."""
        body = self.body
        own = self._nodal() + self._tendon_forces() - self._consistent()
        start, end = (self._node_wrench(own, node) for node in (body.first_node, body.last_node))
        loads = self._loads_before()
        stations = np.broadcast_to(body.xi, (len(self.dofs), len(body.xi)))
        place = self._rows(body.xi) @ self.local
        c, s = self._axes(stations)
        borne = self._tendon_pulls(stations)
        off = start + end + loads[:, -1]
        total = body.xi[:, None] * off[:, None] - start[:, None] - loads[:, :-1]
        fx, fy = total[..., 0], total[..., 1]
        out = np.stack([c * fx + s * fy, -s * fx + c * fy, total[..., 2] - cross(place, total)], axis=-1)
        for fx, fy, moment in borne:
            out -= np.stack([c * fx + s * fy, c * fy - s * fx, moment], axis=-1)
        return out

    def _guide_at(self, guide: Guide, xi: Array) -> tuple[Array, Array, Array]:
        """Return y and dy/dx (2, m, g) of a guide at xi (m, g), its direction d(r + y n)/dx and the arm y n from the
        axis (m, g, 2)."""
        mesh = self.body.mesh
        s = (mesh.starts[self.chosen, None] + xi * mesh.lengths[self.chosen, None]) / mesh.plan.length
        y, rise = (v.reshape(xi.shape) for v in guide.offsets(s.ravel()))
        r_x, kind = self._rows(xi, 1) @ self.e[..., :2], mesh.plan.element.section_kind
        if kind == "tangent":
            return np.stack([y, rise]), r_x, np.zeros_like(r_x)
        if kind == "theta":
            c, s = self._axes(xi)
            along, normal = np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)
            turned = (self._rows(xi, 1) @ self.e[..., 2:])[..., 0]
            return (np.stack([y, rise]), r_x - (y * turned)[..., None] * along + rise[..., None] * normal,
                    y[..., None] * normal)
        off = [self._rows(xi, i, j, y) @ self.e[..., :2] for i, j in ((0, 0), (1, 0), (0, 1))]
        return np.stack([y, rise]), off[1] + rise[..., None] * off[2], off[0] - self._rows(xi) @ self.e[..., :2]

    def _tendon_forces(self) -> Array:
        """Return the generalised forces (m, n_shape, nc) of tendons along the body, in elastic sign."""
        out, kind = np.zeros_like(self.e), self.body.mesh.plan.element.section_kind
        for guide, T in self.guides:
            for elements, points, w in guide.cover:
                here = np.flatnonzero(np.isin(self.chosen, elements))
                if not len(here):
                    continue
                xi = np.broadcast_to(points, (len(self.chosen), len(points)))
                (y, rise), way, _ = self._guide_at(guide, xi)
                pull = T * way / np.linalg.norm(way, axis=-1, keepdims=True) * w[:, None]
                if kind == "interpolated":
                    rows = self._rows(xi, 1, 0, y) + rise[..., None] * self._rows(xi, 0, 1, y)
                    found = np.einsum("mgk,mgc->mkc", rows, pull)
                else:
                    found = np.einsum("mgk,mgc->mkc", self._rows(xi, 1), pull)
                out[here, :, :2] += found[here]
                if kind == "theta":
                    c, s = self._axes(xi)
                    along, across = c * pull[..., 0] + s * pull[..., 1], c * pull[..., 1] - s * pull[..., 0]
                    turned = (self._rows(xi, 1) @ self.e[..., 2:])[..., 0]
                    moment = np.einsum("mgk,mg->mk", self._rows(xi), -y * turned * across - rise * along)
                    out[here, :, 2] += (moment + np.einsum("mgk,mg->mk", self._rows(xi, 1), -y * along))[here]
        return out

    def _tendon_pulls(self, xi: Array) -> Iterator[tuple[Array, Array, Array]]:
        """Yield force along x and y, and moment about the axis, (m, g) each, of each tendon at xi."""
        mesh = self.body.mesh
        for guide, T in self.guides:
            s = (mesh.starts[self.chosen, None] + xi * mesh.lengths[self.chosen, None]) / mesh.plan.length
            _, way, arm = self._guide_at(guide, xi)
            force = T * way / np.linalg.norm(way, axis=-1, keepdims=True)
            force *= ((s >= guide.first - SAME) & (s <= guide.last + SAME))[..., None]
            yield force[..., 0], force[..., 1], cross(arm, force)
