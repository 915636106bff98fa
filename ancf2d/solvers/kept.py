"""Energy that materials keep beside that of their stress in the stiffness of small strains."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..elements.shape import Array
from ..kernels.elements import commit, stations
from ..kernels.lowlevel.records import Record
from ..model.model import Model


def kept_energy(model: Model, d: Array, t: float) -> tuple[float, float, float]:
    """Return what materials keep [J] at d (n_full,) and t beyond sigma^T D^-1 sigma/2: those that remember, and others.

    It is that of springs in Maxwell terms, of kinematic hardening, of stress within sections that have yielded in part,
    and of curves that are followed back. Every law tells its own (``PointLaw.stored``). The third is what was told too
    much of what internal strains have taken (``PointLaw.overtold``).
    """
    found = [0.0, 0.0, 0.0]
    for pool, group in zip(model.pools, model.groups, strict=True):
        law = pool.plan.formulation.law
        if law.stored is None:
            continue
        memory = group.values.memory
        states = memory.states.copy()
        alone: Any = Record(group.values._replace(memory=memory._replace(states=states)))
        model.set_natural(t)
        # states that have been accepted lead to themselves
        commit(alone, d)
        S, points = group.law.B.shape[2], group.law.B.shape[1] // law.fields
        parts = group.plan.parts
        eps, _ = shape = np.zeros((2, len(group.dofs), parts * S, points * law.strains))
        stations(alone, d, *shape)
        # (classes, stations, ...): what is constant of each station
        ref, D = (np.moveaxis(x, -1, 1).reshape(len(x) // parts, parts * S, *x.shape[1:-1])
                  for x in (group.law.ref, group.law.D))
        own = states if states.size else np.zeros((*eps.shape[:2], 0))
        for c in range(len(ref)):
            some = np.flatnonzero(group.cls == c)
            shape_of = (len(some), parts * S, points)
            constants, now = ref[c].reshape(parts * S, points, -1), own[memory.row[some]].reshape(
                *shape_of, -1) if states.size else own[some].reshape(*shape_of, -1)
            found[law.elastic] += float(np.sum(law.stored(constants, D[c], eps[some], now)))
            if law.overtold is not None:
                found[2] += float(np.sum(law.overtold(constants, D[c], now)))
    return found[0], found[1], found[2]
