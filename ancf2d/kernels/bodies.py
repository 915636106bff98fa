"""Forces and tangents of all elements of a model in motion, by calls through the model's table of addresses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from . import calls
from .elements import (
    commit,
    force,
    force_noise,
    force_tangent,
    mean_force,
    mean_force_tangent,
    natural_power,
    natural_work,
    total_strains,
    viscous_force,
)
from .forces import GROUP
from .lowlevel.jit import addressed, inner, named
from .lowlevel.records import Record, at
from .matrices.symmetric import in_band, in_fronts, rows_in


def addresses(groups: Sequence[Record]) -> Any:
    """Return the addresses (g,) of the records of groups, which must stay alive (``Model.groups``)."""
    return np.array([group.address for group in groups], dtype=np.int64)


# group g of a problem p: ``group_at(p.groups[g])``
group_at = at(GROUP)


def _with_matrix(stored: Any, kind: str) -> tuple[Any, Any]:
    """Return the functions that add tangents of elastic forces, and of those of a conserving step, to one matrix kind.
    """
    def tangent(p, g, scale, d, Q, A):  # type: ignore[no-untyped-def]
        return force_tangent(group_at(p.groups[g]), d, scale, Q, stored(p, A), rows_in(p))

    def mean_tangent(p, g, damping, d0, d1, Q, A):  # type: ignore[no-untyped-def]
        return mean_force_tangent(group_at(p.groups[g]), damping, d0, d1, Q, stored(p, A), rows_in(p))[0]

    return addressed(named(tangent, kind)), addressed(named(mean_tangent, kind))


_TANGENTS = _with_matrix(in_band, "band"), _with_matrix(in_fronts, "fronts")


def element_functions(fronts: bool, viscous: bool, mean: bool, natural: bool, remembers: bool, problem: Any
                      ) -> dict[Any, tuple[Any, ...]]:
    """Return the entries for elements of the table of a model (``kernels.calls.table``).

    ``viscous``, ``mean``, ``natural``, ``remembers`` : whether viscous forces, forces of energy-conserving steps, the
    power of natural strains, and laws with memory are needed.
    """
    out: dict[Any, tuple[Any, ...]] = {calls.force: (force,), calls.noise: (force_noise,),
                                       calls.tangent: (_TANGENTS[fronts][0], problem)}
    if viscous:
        out[calls.viscous] = (viscous_force,)
    if natural:
        out[calls.natural_power] = (natural_power,)
    if natural and mean:
        out[calls.natural_work] = (natural_work,)
    if remembers:
        out |= {calls.commit: (commit,), calls.total_strains: (total_strains,)}
    if mean:
        out |= {calls.mean: (mean_force,), calls.mean_tangent: (_TANGENTS[fronts][1], problem)}
    return out


@inner
def set_natural(p, amps, before):  # type: ignore[no-untyped-def]
    """Set natural strains to those of the signals ``amps``, and those at the start of a step to those of ``before``."""
    for g in range(len(p.groups)):
        natural = group_at(p.groups[g]).natural
        for k in range(len(natural.signal)):
            natural.amount[k, 0] = amps[natural.signal[k], 0]
            natural.amount[k, 1] = amps[natural.signal[k], 1]
            natural.amount[k, 2] = before[natural.signal[k], 0]


@inner
def power_of_natural(p, d, v):  # type: ignore[no-untyped-def]
    """Return the power that changing natural strains feed in at d with rates v."""
    power = 0.0
    for g in range(len(p.groups)):
        changes = False
        amount = group_at(p.groups[g]).natural.amount
        for k in range(len(amount)):
            changes |= amount[k, 1] != 0.0
        if changes:
            power += calls.natural_power(p.calls, (group_at(p.groups[g]), p.tau[g], d, v))
    return power


@inner
def work_of_natural(p, h, d0, d1):  # type: ignore[no-untyped-def]
    """Return the work of natural strains in a conserving step h from d0 to d1, and the viscous part of this work."""
    work, viscous = 0.0, 0.0
    for g in range(len(p.groups)):
        changes = False
        amount = group_at(p.groups[g]).natural.amount
        for k in range(len(amount)):
            changes |= amount[k, 0] != amount[k, 2]
        if changes:
            W = calls.natural_work(p.calls, (group_at(p.groups[g]), p.tau[g] / h, d0, d1))
            work += W
            if p.tau[g] > 0.0:
                viscous += W - calls.natural_work(p.calls, (group_at(p.groups[g]), 0.0, d0, d1))
    return work, viscous


@inner
def elastic(p, d, Q):  # type: ignore[no-untyped-def]
    """Add the elastic forces to Q; return the strain energy."""
    energy = 0.0
    for g in range(len(p.groups)):
        energy += calls.force(p.calls, (group_at(p.groups[g]), d, Q))
    return energy


@inner
def elastic_where_driven(p, d, Q):  # type: ignore[no-untyped-def]
    """Add to Q the elastic forces of the groups with coordinates that prescribed motion drives."""
    for g in range(len(p.groups)):
        if p.driven[g]:
            calls.force(p.calls, (group_at(p.groups[g]), d, Q))


@inner
def elastic_tangent(p, c, d, Q, A):  # type: ignore[no-untyped-def]
    """Add the elastic forces to Q, and to A the tangents times 1 + c tau; return the strain energy."""
    energy = 0.0
    for g in range(len(p.groups)):
        energy += calls.tangent(p.calls, (p, g, 1.0 + c * p.tau[g], d, Q, A))
    return energy


@inner
def accept_elements(p, d, amps, timed):  # type: ignore[no-untyped-def]
    """Update the history variables at the accepted state d; return the energy dissipated since the last one.

    ``timed`` : whether laws with a clock are updated too.
    """
    set_natural(p, amps, amps)
    lost = 0.0
    for g in range(len(p.groups)):
        law = group_at(p.groups[g]).law
        if law.state > 0 and (timed or not law.timed):
            lost += calls.commit(p.calls, (group_at(p.groups[g]), d))
    return lost


@inner
def prescribe_stored(p):  # type: ignore[no-untyped-def]
    """Prescribe for relaxing laws the internal strains of their stored states, as fixed ones."""
    for g in range(len(p.groups)):
        law, memory = group_at(p.groups[g]).law, group_at(p.groups[g]).memory
        if law.timed:
            p.slopes[g] = 0.0
            for k in range(memory.prescribed.shape[0]):
                for s in range(memory.prescribed.shape[1]):
                    for i in range(memory.prescribed.shape[2]):
                        memory.prescribed[k, s, i] = memory.states[k, s, i // law.strains * law.state + i % law.strains]


@inner
def elastic_noise(p, d, out):  # type: ignore[no-untyped-def]
    """Add the sizes of the terms of the elastic forces, which bound their round-off, to ``out`` (n_full,)."""
    for g in range(len(p.groups)):
        calls.noise(p.calls, (group_at(p.groups[g]), d, out))


@inner
def viscous(p, d, v, Q):  # type: ignore[no-untyped-def]
    """Add Kelvin-Voigt forces to Q; return the power lost."""
    power = 0.0
    for g in range(len(p.groups)):
        if p.tau[g] > 0.0:
            power += calls.viscous(p.calls, (group_at(p.groups[g]), p.tau[g], d, v, Q))
    return power


@inner
def mean_elastic(p, h, d0, d1, Q):  # type: ignore[no-untyped-def]
    """Add the elastic and viscous forces of an energy-momentum step h from d0 to d1 to Q."""
    for g in range(len(p.groups)):
        calls.mean(p.calls, (group_at(p.groups[g]), p.tau[g] / h, d0, d1, Q))


@inner
def mean_elastic_tangent(p, h, d0, d1, Q, A):  # type: ignore[no-untyped-def]
    """Same as ``mean_elastic``, and add the symmetric tangent by d1 to A."""
    for g in range(len(p.groups)):
        calls.mean_tangent(p.calls, (p, g, p.tau[g] / h, d0, d1, Q, A))
