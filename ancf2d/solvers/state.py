"""The states that solvers yield."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..elements.shape import Array
from ..errors import CheckpointError

# history variables of a motion, as named in ``Row`` and checkpoints
MEMORIES = ("turns", "feet", "states")


def check_checkpoint(kept: dict[str, Array], fresh: dict[str, Array] | None) -> None:
    """Compare a stored checkpoint with one of a solver before its start. Raises CheckpointError if they do not match.

    Names and shapes have to agree. Arrays without rows at the start may have grown; texts (uint8) have any length.
    """
    fresh = fresh or {}
    for name in sorted({*kept, *fresh}):
        if name not in kept or name not in fresh:
            raise CheckpointError(f"'{name}' is {'unknown' if name in kept else 'missing'}")
        found, wanted = np.shape(kept[name]), np.shape(fresh[name])
        grows = wanted[:1] == (0,) or np.asarray(fresh[name]).dtype == np.uint8
        if len(found) != len(wanted) or found[grows:] != wanted[grows:]:
            raise CheckpointError(f"'{name}' has shape {list(found)}, not {list(wanted)}")


class Graded(str):
    """A warning about one state; a run reports only the one with the largest ``size`` of each kind."""

    kind: str
    size: float

    def __new__(cls, text: str, kind: str, size: float) -> Graded:
        """Return the text with its kind and size."""
        out = super().__new__(cls, text)
        out.kind, out.size = kind, size
        return out


@dataclass
class State:
    """A state that a solver yields: full coordinates ``d`` at load factor or time ``t``, and related data.

    ``Q`` are the elastic and patch forces, ``F`` the dead loads, in full coordinates. ``turned`` (bodies,) counts full
    turns (``model.rotation.Turns``; None: only as far as d determines them). ``report`` is merged into the summary
    (frequencies, limit points, ...); ``arrays`` go to the result file: path -> (data, units, description); ``tables``:
    name -> columns. ``last`` marks the end of a path, which is always stored.

    ``side`` is the time at which amplitudes are evaluated: t by default, but at a break of a motion the preceding
    float. ``about`` (n_full,): displacements about which elastic forces are linearised, None if they are not.
    ``controllers`` has output and states of each controller. ``memory`` has the history variables of elements
    (``Model.states``), None if there are none.

    Motion: ``v`` and ``a`` (n_full,) are the rates of the coordinates (zero for multipliers), None in statics.
    ``blocks`` holds a column of values per step since the last state; ``checkpoint`` is what the solver needs to
    continue from here; ``left`` [s] is the estimated rest of the computing time, if known.
    """

    t: float
    d: Array
    Q: Array
    F: Array
    energy: float
    turned: Array | None = None
    linear: bool = False
    last: bool = False
    history: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    report: dict[str, Any] = field(default_factory=dict)
    arrays: dict[str, tuple[Array, str, str]] = field(default_factory=dict)
    tables: dict[str, dict[str, list[Any]]] = field(default_factory=dict)
    v: Array | None = None
    a: Array | None = None
    blocks: dict[str, Array] = field(default_factory=dict)
    checkpoint: dict[str, Array] | None = None
    side: float = math.nan
    left: float | None = None
    about: Array | None = None
    controllers: dict[str, dict[str, float]] = field(default_factory=dict)
    memory: Array | None = None

    def __post_init__(self) -> None:
        if math.isnan(self.side):
            self.side = self.t


@dataclass
class Row:
    """A stored state: unknowns with two rates at t, work and loss up to it, and the log of the steps up to it.

    ``kind`` as in ``kernels.motion.advance``. ``side`` is the time at which signals are evaluated: t, but at a break,
    where a step ends, the preceding float. ``turns``, ``feet`` and ``states`` are the history variables of point laws,
    prismatic joints and elements, ``turned`` the rotations of the sections whose full turns are counted. ``full`` are
    d, v, a and Q - F (n_full,), ``energy`` the strain energy of elements and the kinetic energy, once they are
    computed.
    """

    t: float
    side: float
    kind: int
    z: Array
    v: Array
    a: Array
    work: float
    lost: float
    turns: Array
    feet: Array
    states: Array
    turned: Array
    log: Array
    full: tuple[Array, ...] = ()
    energy: tuple[float, float] = (math.nan, math.nan)


def with_rows(log: Array, more: Array) -> Array:
    """Return both in one array (n + m, columns), which has room behind it: n calls that add a row copy about 2 n rows.

    ``log`` is an array of its own or the result of the last call, whose rows stay the same.
    """
    n, needed, room = len(log), len(log) + len(more), log.base
    if room is None or needed > len(room):
        room = np.empty((2 * needed, more.shape[1]))
        room[:n] = log
    room[n:needed] = more
    return room[:needed]
