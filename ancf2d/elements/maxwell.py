"""Generalised Maxwell material: springs with dashpots in parallel to the elastic law of any formulation.

With the long-time stiffness D, the stress is D (eps + sum_i g_i h_i), where h_i' + h_i/tau_i = eps'. All strains
relax alike, so Poisson's ratio does not change. If the strains change linearly in a step h, the solution is exact:

    h_i(t + h) = exp(-x) h_i(t) + (1 - exp(-x))/x (eps(t + h) - eps(t)),    x = h/tau_i

(Taylor, Pister & Goudreau 1970; Simo & Hughes 1998, section 10.3). The instantaneous stiffness is
D (1 + sum_i g_i), the long-time stiffness D. For the kernels, -sum_i g_i h_i are internal strains.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from .formulations.base import Formulation, Rule, Sampler, StrainLaw
from .shape import Array

# (modulus relative to the long-time one, relaxation time [s]) of each spring with its dashpot
Terms = tuple[tuple[float, float], ...]


def internal(ref, eps, old, new, slope, lanes):  # type: ignore[no-untyped-def]
    """Fill the internal strains; the state also gets h_i of each term, the strains, excess work and the time step.

    The excess work is kept as the upper half of a matrix P (strains, strains): sum D P is the accumulated excess of the
    internal strains' work, counted with the stress at the end of each step, over their work with the mean of the
    stresses at both ends. The time step is the last number.

    The last reference values of a point are (g_i, tau_i) of each term, and the number of terms.
    """
    n, last, clock = len(eps), len(ref) - 1, len(new) - 1
    terms = int(ref[last, 0])
    for i in range(n):
        for l in range(lanes):
            new[i, l], slope[i, i, l] = 0.0, 0.0
    for k in range(terms):
        g, tau = ref[last - 2 * (terms - k), 0], ref[last - 2 * (terms - k) + 1, 0]
        # all points have the same time step
        x = old[clock, 0] / tau
        keeps = np.exp(-x) if x > 0.0 else 1.0
        takes = -np.expm1(-x) / x if x > 0.0 else 1.0
        for i in range(n):
            at = (1 + k) * n + i
            for l in range(lanes):
                h = keeps * old[at, l] + takes * (eps[i, l] - old[(1 + terms) * n + i, l])
                new[at, l] = h
                new[i, l] -= g * h
                slope[i, i, l] -= g * takes
    before, at = (1 + terms) * n, (2 + terms) * n
    for i in range(n):
        for j in range(i, n):
            half = 0.25 if i == j else 0.5
            for l in range(lanes):
                taken, other = new[i, l] - old[i, l], new[j, l] - old[j, l]
                bears = eps[i, l] - old[before + i, l] - taken
                new[at, l] = old[at, l] + half * (
                    bears * other + (eps[j, l] - old[before + j, l] - other) * taken)
            at += 1
    at = (1 + terms) * n
    for i in range(n):
        for l in range(lanes):
            new[at + i, l] = eps[i, l]
    for l in range(lanes):
        new[clock, l] = old[clock, l]


def extra_energy(ref: Array, D: Array, eps: Array, state: Array) -> Array:
    """Return the energy stored in all springs beyond eps D eps/2, for elastic strains eps; see ``StrainLaw``.

    With q = sum g h, the total strains are eps - q, and the result is q D q/2 - q D eps + sum g h D h/2.
    """
    count, n = int(ref[0, 0, -1]), D.shape[-1] // state.shape[2]
    g = ref[0, 0, -1 - 2 * count:-1:2]
    h = [state[..., (1 + k) * n:(2 + k) * n].reshape(eps.shape) for k in range(count)]
    q = sum(a * b for a, b in zip(g, h, strict=True))
    twice = np.einsum("esi,sij,esj->es", q, D, q - 2.0 * eps)
    for a, b in zip(g, h, strict=True):
        twice += a * np.einsum("esi,sij,esj->es", b, D, b)
    return np.asarray(0.5 * twice)


def _excess_work(ref: Array, D: Array, state: Array) -> Array:
    """Return the excess of the internal strains' work counted with end-of-step stresses; see ``StrainLaw``."""
    points = state.shape[2]
    n = D.shape[-1] // points
    i, j = np.triu_indices(n)
    # strains of one point cause no stress at another
    own = np.array([D[:, p * n + i, p * n + j] for p in range(points)])
    return np.asarray(np.einsum("espk,psk->es", state[..., -1 - len(i):-1], own))


@dataclass(frozen=True)
class _Sample:
    """Sampling of a formulation whose material relaxes."""

    base: Formulation

    def __call__(self, sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
        """Return (B, ref, D) as in ``Formulation.sample``; each point of a station gets all constants."""
        B, ref, D = self.base.sample(sampler, rule)
        terms = sampler.section.maxwell
        points = B.shape[1] // self.base.law.fields
        own = np.array([*(v for term in terms for v in term), len(terms)])
        whole = np.concatenate([ref.reshape(len(ref), points, -1),
                                np.broadcast_to(own, (len(ref), points, len(own)))], axis=2)
        return B, whole.reshape(len(ref), -1), D


@cache
def relaxing(base: Formulation, terms: int) -> Formulation:
    """Return a formulation whose material has this number of Maxwell terms; ``base`` itself for 0."""
    if not terms:
        return base
    law = base.law
    own = StrainLaw(law.fields, law.strains, law.references + 2 * terms + 1, law.strain, law.geometric,
                   quadratic=law.quadratic, internal=internal, timed=True, extra_energy=extra_energy,
                   state=(2 + terms) * law.strains + law.strains * (law.strains + 1) // 2 + 1, excess_work=_excess_work)
    return replace(base, law=own, sample=_Sample(base), stress=None)
