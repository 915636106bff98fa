"""Energies and momentum of a moving model, and the energy stored in materials beyond that of linear elasticity."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..elements.formulations.base import StrainLaw
from ..elements.shape import Array
from ..interactions.forces import DeadLoad
from ..interactions.moving import MovingPatch
from ..kernels.elements import commit, stations
from ..kernels.lowlevel.records import Record
from ..model.model import Model
from ..model.rotation import CoordinateKinds
from ..model.timing import Signal

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


def is_constant(amplitude: Callable[[float], float]) -> bool:
    """Return whether the amplitude of a load in a dynamic case is constant in time."""
    return isinstance(amplitude, Signal) and (amplitude.amplitude is None or amplitude.amplitude.constant)


def has_potential(load: DeadLoad | MovingPatch) -> bool:
    """Return whether a load has a potential energy (constant gravity); others are counted by their work."""
    amplitude = load.signal if isinstance(load, MovingPatch) else load.amplitude
    return load.gravity and amplitude is not None and is_constant(amplitude)


def constant_loads(model: Model, loads: Iterable[DeadLoad]) -> Array:
    """Return the forces (n_full,) of constant loads."""
    out = np.zeros(len(model.numbering.place))
    for load in loads:
        np.add.at(out, load.dofs, load.values * load.amplitude(0.0))
    return out


class Energies:
    """Kinetic, strain and potential energy and momentum of a model at states (d, v) in full coordinates.

    ``kinetic`` and ``momentum`` include bodies and fixed masses; ``carried`` has both for masses that move along
    bodies.
    """

    def __init__(self, model: Model) -> None:
        self.model, self.kinds = model, CoordinateKinds(model.meshes.values())
        patches = [p for p in model.interactions.points if isinstance(p, MovingPatch)]
        self.moving = [p for p in patches if p.mass]
        self.weights = [p for p in patches if has_potential(p)]
        self.gravity = constant_loads(model, [load for load in model.loads.dead if has_potential(load)])

    @cached_property
    def M(self) -> csr_matrix:
        """The mass matrix (n_q, n_q) of all nodal coordinates."""
        from .linear import full_mass

        return full_mass(self.model)

    def kinetic(self, v: Array) -> float:
        """Return v^T M v/2."""
        v = v[:self.model.n_q]
        return 0.5 * float(v @ (self.M @ v))

    def carried(self, d: Array, v: Array, t: float) -> tuple[float, Array]:
        """Return kinetic energy and momentum (3,) (see ``momentum``) of masses that move along bodies at t."""
        energy, momentum = 0.0, np.zeros(3)
        for patch in self.moving:
            mass, r, rate = patch.carried(d, v, t)
            energy += 0.5 * mass * float(rate @ rate)
            momentum += mass * np.array([*rate, r[0] * rate[1] - r[1] * rate[0]])
        return energy, momentum

    def potential(self, d: Array) -> float:
        """Return the potential of constant gravity on bodies and fixed masses, relative to the reference."""
        return -float(self.gravity @ d)

    def lifted(self, d: Array, t: float) -> float:
        """Return the potential of constant gravity on masses that move along bodies at t."""
        return sum(patch.potential(d, t) for patch in self.weights)

    def momentum(self, d: Array, v: Array) -> tuple[float, float, float]:
        """Return the linear momentum px, py and the angular momentum about the origin.

        With the momenta m = M v of the coordinates, these are sums over positions, and over e x m of all vectors plus
        those of theta.
        """
        n_q = self.model.n_q
        m, e, x = self.M @ v[:n_q], self.model.e0 + d[:n_q], self.kinds.x
        angular = e[x] @ m[x + 1] - e[x + 1] @ m[x] + m[self.kinds.theta].sum()
        return float(m[self.kinds.positions].sum()), float(m[self.kinds.positions + 1].sum()), float(angular)


def extra_energy(model: Model, d: Array, t: float) -> tuple[float, float, float]:
    """Return energies [J] stored in materials at d (n_full,) and t beyond sigma^T D^-1 sigma/2.

    They are those of inelastic laws, then of elastic laws with internal strains: of springs in Maxwell terms, of
    kinematic hardening, of residual stress in partly yielded sections, and of curves on unloading
    (``StrainLaw.extra_energy``). The third is the excess of the dissipation that steps report with the stress at their
    ends (``StrainLaw.excess_work``).
    """
    found = [0.0, 0.0, 0.0]
    for pool, group in zip(model.pools, model.groups, strict=True):
        law = pool.plan.formulation.law
        if law.extra_energy is None:
            continue
        memory = group.values.memory
        states = memory.states.copy()
        alone: Any = Record(group.values._replace(memory=memory._replace(states=states)))
        model.set_natural(t)
        # accepted states map to themselves
        commit(alone, d)
        eps, _ = shape = np.zeros((2, len(group.dofs), *_stations_of(group, law)))
        stations(alone, d, *shape)
        for some, constants, D, now in _classes(group, law, states):
            found[law.elastic] += float(np.sum(law.extra_energy(constants, D, eps[some], now)))
            if law.excess_work is not None:
                found[2] += float(np.sum(law.excess_work(constants, D, now)))
    return found[0], found[1], found[2]


def internal_energy(model: Model) -> float:
    """Return the energy eps_i^T D eps_i/2 [J] of the internal strains eps_i at the last accepted state."""
    found = 0.0
    for pool, group in zip(model.pools, model.groups, strict=True):
        law = pool.plan.formulation.law
        if law.elastic or not law.state:
            continue
        for some, _, D, now in _classes(group, law, group.values.memory.states):
            taken = now[..., :law.strains].reshape(len(some), *_stations_of(group, law))
            found += 0.5 * float(np.einsum("esi,sij,esj->", taken, D, taken))
    return found


def _stations_of(group: Any, law: StrainLaw) -> tuple[int, int]:
    """Return the number of stations of an element, and the number of strains at a station."""
    return group.plan.parts * group.law.B.shape[2], group.law.B.shape[1] // law.fields * law.strains


def _classes(group: Any, law: StrainLaw, states: Array) -> Iterator[tuple[Any, Array, Array, Array]]:
    """Yield the elements (k,) of each class with their constants and history variables at the stations.

    These are ref (stations, points, any), D (stations, strains, strains) and the states (k, stations, points, numbers).
    """
    parts, (n, strains) = group.plan.parts, _stations_of(group, law)
    ref, D = (np.moveaxis(x, -1, 1).reshape(len(x) // parts, n, *x.shape[1:-1]) for x in (group.law.ref, group.law.D))
    own = states if states.size else np.zeros((len(group.dofs), n, 0))
    for c in range(len(ref)):
        some = np.flatnonzero(group.cls == c)
        points = strains // law.strains
        now = np.zeros((len(some), n, own.shape[2]))
        # the last stations may have no state
        now[:, :own.shape[1]] = own[group.values.memory.row[some]] if states.size else own[some]
        yield some, ref[c].reshape(n, points, -1), D[c], now.reshape(len(some), n, points, -1)
