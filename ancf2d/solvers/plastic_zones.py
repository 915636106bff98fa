"""Check that the elements resolve the zones of a body that yield.

Elements know plastic strains only at their stations, and these zones begin and peak between them. The plastic strains
of a body are therefore recovered as functions of its arc length, linear between stations. At the ends of the body and
where something acts on it, where moments peak, they follow from the section forces by equilibrium, added to what the
fibres of the nearest station remember. The rotations and elongations of the elements by recovered strains differ from
those of the stations by about their error. Both are exact where the strains are linear, and so is uniform bending.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..elements.fibres import internal
from ..elements.shape import Array, gauss
from ..errors import percent
from ..model.curve import peak_nodes
from ..model.mesh import BodyMesh, Index
from ..model.model import Model
from .fields import fibre_stations
from .section_forces import SectionForces, uncoupled_group
from .state import State

# relative error of rotations and elongations that gives a warning, and of the load of a path
WARN_ABOVE, WARN_ABOVE_ON_PATH = 5e-3, 1e-2
# largest error that is reported
WHOLE = 0.99
# largest number of bodies that are checked, those that yield most, since each takes 2 ms
LOOKED = 50
# iterations for the strains that section forces cause, and their relative error
ITERATIONS, CONVERGED = 12, 1e-6
# what the plastic strain at an end counts as, relative to that continued from inside, if fibres cannot bear the forces
BEYOND = 3.0
# places closer than this share of the length are one
SAME = 1e-9


@dataclass
class Zone:
    """The error (ne,) [m] of the elements of a body: of their rotations, times the radius of gyration, and elongations.
    """

    mesh: BodyMesh
    error: Array

    @property
    def total(self) -> float:
        """The error of all elements [m]."""
        return float(self.error.sum())

    @property
    def worst(self) -> tuple[float, float]:
        """The places S between which the error is largest: an element."""
        k = int(np.argmax(self.error))
        ends = np.append(self.mesh.starts, self.mesh.plan.length) / self.mesh.plan.length
        return float(ends[k]), float(ends[k + 1])


class PlasticZones:
    """The error of zones that yield, in the last state of a run.

    Where loads are given, it is one of displacements. A path may have displacements given: then it is one of the load,
    to the extent that the load still grows with the displacements.
    """

    def __init__(self, model: Model) -> None:
        self.model, self.on_path = model, model.case.solver.on_path
        self.bodies = [] if model.case.solver.scales else [m for m in model.meshes.values() if m.plan.section.laws]
        # load factor and mean displacement under the loads; relative change of the first per change of the second
        self.last, self.slope = (0.0, 0.0), 1.0

    def follow(self, state: State) -> None:
        """Take an equilibrium of a path."""
        if not (self.bodies and self.on_path) or state.t == 0.0:
            return
        n_q, (t, moved) = self.model.n_q, self.last
        now = float(state.F[:n_q] @ state.d[:n_q]) / state.t
        ratios = [b / a if a else 0.0 for a, b in ((t, state.t), (moved, now))]
        self.last = state.t, now
        if min(ratios) > 0.0 and ratios[1] != 1.0:
            self.slope = min(1.0, abs(math.log(ratios[0]) / math.log(ratios[1])))

    def warnings(self, state: State) -> list[str]:
        """Return the warning about a state, if any: where, how large the error is, and what to change."""
        with self.model.remembering(state.memory):
            bodies = [_Body(self.model, mesh) for mesh in self.bodies]
            most = sorted(bodies, key=lambda body: -float(np.abs(body.plastic).max()))[:LOOKED]
            zones = [Zone(body.mesh, body.error(state)) for body in most]
        whole, limit = sum(body.whole for body in bodies), WARN_ABOVE_ON_PATH if self.on_path else WARN_ABOVE
        off = self.slope * sum(zone.total for zone in zones) / whole if whole > 0.0 else 0.0
        if off <= limit:
            return []
        off, zone = min(off, WHOLE), max(zones, key=lambda zone: zone.total)
        (start, end), plan = zone.worst, zone.mesh.plan
        # the error falls with the square of the length of elements
        count = math.ceil(plan.count * math.sqrt(2.0 * off / limit))
        what = "the load has" if self.on_path else "rotations and displacements have"
        return [f"the mesh is too coarse where bodies.{plan.name} yields, most from S = {start:.3g} to {end:.3g}: "
                f"{what} an error of about {percent(off)}. Use about {count} elements, or a grading that makes them "
                "shorter there, or --accuracy with a goal; ancf2d convergence shows the error"]


class _Body:
    """The stations of a body with fibres: places xi (ne, nx), weights (ne, nx), history variables (ne, nx, numbers).

    ``plastic`` (ne, nx, 2) has the plastic part of the axial strain and of the curvature times the radius of gyration;
    ``whole`` [m] is the integral of the sizes of these strains and of the elastic ones, which may cancel each other
    after a cycle.
    """

    def __init__(self, model: Model, mesh: BodyMesh) -> None:
        self.model, self.mesh = model, mesh
        law, self.xi, section = mesh.plan.formulation.law, fibre_stations(mesh), mesh.plan.section
        memory = uncoupled_group(model, mesh, np.arange(len(mesh.dofs))).values.memory
        self.states = memory.states[memory.row][:, :self.xi.shape[1]]
        # of the axial strain and the curvature, and of N and M in the state
        self.strains, self.forces = [0, 1 if law.strains == 2 else 2], slice(law.state - 3, law.state - 1)
        # the rules integrate as many powers as they have points
        powers = np.arange(self.xi.shape[1])
        moments = np.broadcast_to(1.0 / (powers + 1.0), self.xi.shape)[..., None]
        self.weights = np.linalg.solve(self.xi[:, None, :] ** powers[:, None], moments)[..., 0]
        self.scale = np.array([1.0, math.sqrt(section.EI / section.EA)])
        self.plastic = self.states[..., self.strains] * self.scale
        elastic = self.states[..., self.forces] / np.array([section.EA, section.EI]) * self.scale
        sizes = np.abs(self.plastic) + np.abs(elastic)
        self.whole = float(np.einsum("es,e,esc->", self.weights, mesh.lengths, sizes))

    def error(self, state: State) -> Array:
        """Return the error (ne,) of the elements in a state [m]."""
        held = np.einsum("es,e,esc->ec", self.weights, self.mesh.lengths, self.plastic)
        error, (s, values) = np.zeros(len(held)), self._resolved(self.plastic)
        nodes = np.append(self.mesh.starts, self.mesh.plan.length)
        for first, last, ends in self._stretches(state):
            inside, own = s[first:last].ravel(), values[first:last].reshape(-1, 2)
            found = [None if end is None else end * self.scale for end in ends]
            recovered = _integrals(inside, own, found, nodes[first:last + 1])
            error[first:last] = np.abs(recovered - held[first:last]).sum(axis=1)
        return error

    def _resolved(self, plastic: Array) -> tuple[Array, Array]:
        """Return arc lengths (ne, n) and plastic strains (ne, n, 2) there, with n values for a curvature of n terms.

        If elements have more stations than terms, their values are projected to Gauss points: the section forces of
        stations then scatter about those by equilibrium, but their projection does not.
        """
        terms, xi = max(1, self.mesh.plan.element.degree_of_turn), self.xi
        if terms < xi.shape[1]:
            x, powers = gauss(terms)[0], np.arange(terms)
            V, root = xi[..., None] ** powers, np.sqrt(self.weights)[..., None]
            plastic = x[:, None] ** powers @ np.linalg.pinv(root * V) @ (root * plastic)
            xi = np.broadcast_to(x, (len(xi), terms))
        return self.mesh.starts[:, None] + xi * self.mesh.lengths[:, None], plastic

    def _stretches(self, state: State) -> Iterator[tuple[int, int, list[Array | None]]]:
        """Yield first and last node of each stretch between places where moments peak, and the strains at its ends."""
        nodes = np.flatnonzero(peak_nodes(self.mesh.plan.pieces, self.mesh.plan.acting))
        first, last = nodes[:-1], nodes[1:]
        forces = SectionForces(self.model, self.mesh, np.array([0.0, 1.0]))
        ends = np.stack([forces(state, first)[:, 0], forces(state, last - 1)[:, 1]], axis=1)[..., [0, 2]]
        for a, b, (start, end) in zip(first.tolist(), last.tolist(), ends, strict=True):
            yield a, b, [self._strained(a, 0, start), self._strained(b - 1, -1, end)]

    def _strained(self, element: int, station: int, target: Array) -> Array | None:
        """Return the plastic strains (2,) of a station under other section forces; None if its fibres cannot bear
        them."""
        mesh, old = self.mesh, self.states[element, station][:, None]
        plan, chosen = mesh.plan, np.ix_(self.strains, self.strains)
        n = plan.formulation.law.strains
        sampler = mesh.classes[mesh.cls[element]].sampler
        if (profile := sampler.profile) is not None:
            # of the section at the end of the element
            at = 0.0 if station == 0 else 1.0
            sampler = replace(sampler, profile=lambda xi: profile(np.full_like(xi, at)))
        _, refs, _ = plan.formulation.sample(sampler, plan.rule)
        ref = refs[self.xi.shape[1] + station if station < 0 else station][:, None]
        A, C, B = ref[int(ref[-2, 0]) - 3:int(ref[-2, 0]), 0]
        compliance, scale = np.array([[A, C], [C, B]]), np.array([1.0, math.sqrt(A / B)])
        eps, new, slope = np.zeros((n, 1)), np.empty_like(old), np.zeros((n, n, 1))
        eps[self.strains, 0] = old[self.strains, 0] + compliance @ old[self.forces, 0]
        # of the strains; the state has the magnitudes of the internal ones
        size = scale @ np.maximum(old[n + np.array(self.strains), 0], np.abs(compliance @ target))
        for _ in range(ITERATIONS):
            internal(ref, eps, old, new, slope, 1)
            lack = compliance @ (target - new[self.forces, 0])
            if scale @ np.abs(lack) <= CONVERGED * size:
                return np.asarray(new[self.strains, 0])
            eps[self.strains, 0] += np.linalg.solve(np.eye(2) - slope[chosen][..., 0], lack)
        return None


def _integrals(s: Array, values: Array, ends: list[Array | None], nodes: Array) -> Array:
    """Return the integrals (m - 1, 2) over elements between nodes (m,) of values (k, 2) that are linear between s (k,).

    Where nodes are beyond s, the value at the end is the larger of that given and that continued from inside.
    """
    same, stations = SAME * (nodes[-1] - nodes[0]), len(s)
    if nodes[-1] - s[-1] > same:
        last = _end(nodes[-1], s[::-1], values[::-1], ends[1])
        s, values = np.append(s, nodes[-1]), np.append(values, last[None], axis=0)
    if s[0] - nodes[0] > same:
        # not continued from the end on the other side
        first = _end(nodes[0], s[:stations], values[:stations], ends[0])
        s, values = np.append(nodes[:1], s), np.append(first[None], values, axis=0)
    steps = np.diff(s)
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * steps[:, None] * (values[1:] + values[:-1]), axis=0)])
    k: Index = np.clip(np.searchsorted(s, nodes, side="right") - 1, 0, len(s) - 2)
    x = (nodes - s[k])[:, None]
    return np.diff(total[k] + x * values[k] + 0.5 * x**2 * (values[k + 1] - values[k]) / steps[k, None], axis=0)


def _end(node: float, s: Array, values: Array, given: Array | None) -> Array:
    """Return the values (2,) at a node: those given, or those continued from the two stations nearest to it, first in s
    (k,), whichever are larger."""
    end = values[0]
    if len(s) > 1:
        end = end + (node - s[0]) / (s[0] - s[1]) * (values[0] - values[1])
    given = BEYOND * end if given is None else given
    return np.where(np.abs(given) > np.abs(end), given, end)
