"""Point laws as the kernels take them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..elements.point_laws import MAX_MEM, MAX_PAR, POINT_LAWS
from ..elements.shape import Array
from ..kernels.points import Points, Turning
from .loads import FollowerLine
from .mesh import Index
from .model import Model
from .point_patch import PointPatch
from .rotation import Turns

_NUMBER = {law.name: k for k, law in enumerate(POINT_LAWS)}


def _joined(parts: list[Any], dtype: type) -> tuple[Index, Array]:
    """Return where each part begins (n + 1,), and all parts one after another."""
    starts = np.zeros(len(parts) + 1, dtype=np.int64)
    starts[1:] = np.cumsum([p.size for p in parts])
    return starts, np.concatenate([np.zeros(0), *(p.ravel() for p in parts)]).astype(dtype)


def points_of(model: Model) -> list[PointPatch]:
    """Return every point law of a model that moves: springs, loads that turn, constraints."""
    loads = [p.points() if isinstance(p, FollowerLine) else [p] for p in model.loads.patches]
    everything = [*model.springs, *(p for parts in loads for p in parts), *model.constraints]
    return [p for p in everything if isinstance(p, PointPatch)]


def point_table(patches: Sequence[PointPatch], signals: list[Any] | None = None) -> Points:
    """Return the table of point laws.

    What they follow is appended to ``signals``, whose rows they refer to; what is there already is not repeated.
    """
    signals = [] if signals is None else signals
    known = {id(s): k for k, s in enumerate(signals)}
    n = len(patches)
    dof, dofs = _joined([p.coordinates for p in patches], np.int64)
    entry, G = _joined([p.rows for p in patches], np.float64)
    field, p0 = _joined([p.p0 for p in patches], np.float64)
    par, mem, rows = np.zeros((n, MAX_PAR)), np.zeros((n, MAX_MEM)), np.full(n, -1, dtype=np.int64)
    for k, patch in enumerate(patches):
        par[k, :len(patch.par)], mem[k] = patch.par, patch.mem
        if patch.signal is not None:
            if id(patch.signal) not in known:
                known[id(patch.signal)] = len(signals)
                signals.append(patch.signal)
            rows[k] = known[id(patch.signal)]
    return Points(np.array([_NUMBER[p.law.name] for p in patches], dtype=np.int64), field, dof, entry, dofs, G, p0,
                  par, mem, rows, np.array([p.fed for p in patches], dtype=np.int64),
                  np.array([p.multiplier for p in patches], dtype=np.int64),
                  np.array([p.scale for p in patches], dtype=np.float64))


def turning_table(turns: Turns) -> Turning:
    """Return the table of the sections whose turns are counted."""
    return Turning(turns.begin, turns.dofs, turns.along, turns.across, turns.length)
