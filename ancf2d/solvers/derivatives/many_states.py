"""Elements at many states of a motion, evaluated side by side.

Kernels evaluate elements of one class together. A body with varying section has a class for each of its elements, so
the states of a motion are evaluated together instead.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...elements.shape import Array
from ...kernels.elements import force, tangent_action, viscous_action, viscous_force
from ...kernels.lowlevel.records import Record
from ...kernels.motion.dynamics import signals_at
from ...kernels.motion.state import fill_full
from ...model.groups import of_elements
from ..motion.dynamic import Run


class Full(NamedTuple):
    """States in full coordinates: d and v (m, n_full), virtual displacements lam (m, n_full, goals)."""

    d: Array
    v: Array
    lam: Array


def in_full(run: Run, at: Record, window: Array, lam: Array | None = None) -> Full:
    """Return states of a motion in full coordinates, with signals as in a window (2,) of times.

    They are cached as long as the states exist.
    """
    known: tuple[Array | None, Full] | None = run.seen.get(at)
    if known is not None and (lam is None or known[0] is lam):
        return known[1]
    p, w, m = run.problem, run.stepper.w, len(at.t)
    before, none = p.programs.window.copy(), np.zeros_like(w.amps)
    p.programs.window[:] = window
    n = len(p.place)
    out = Full(np.zeros((m, n)), np.zeros((m, n)), np.zeros((m, n, 0 if lam is None else lam.shape[2])))
    room = np.zeros(n)
    for k in range(m):
        signals_at(p, float(at.t[k]), w.amps)
        fill_full(p, at.z[k], w.amps, 0, out.d[k])
        fill_full(p, at.v[k], w.amps, 1, out.v[k])
        for q in range(out.lam.shape[2]):
            fill_full(p, np.ascontiguousarray(lam[k, :, q]), none, 0, room)  # type: ignore[index]
            out.lam[k, :, q] = room
    p.programs.window[:] = before
    run.seen[at] = lam, out
    return out


def forces(group: Record, tau: float, d: Array, v: Array) -> Array:
    """Return the forces (m, elements, n) of elements at m states in full coordinates.

    Each element at each state gets its own coordinates, with the states of one element adjacent, so that they are
    evaluated side by side.
    """
    many, (here, rates) = _side_by_side(group, d, v)
    Q = np.zeros_like(here)
    force(many, here, Q)
    if tau:
        viscous_force(many, tau, here, rates, Q)
    return _by_states(Q, group)


def left_out(group: Record, tau: float, d: Array, v: Array, lam: Array) -> tuple[Array, Array]:
    """Return the derivatives of the work of viscous elements on lam (m, n_full) by positions and rates.

    They are (m, elements, n) each, at m states, without the part in ``many_states.tangents``. lam should be about as
    large as the rates, so that quadratic terms keep most digits.
    """
    many, (here, rates, virtual) = _side_by_side(group, d, v, lam)
    by_d, by_v, stiff, room = (np.zeros_like(here) for _ in range(4))
    viscous_action(many, tau, here, rates, virtual, by_d, by_v, room)
    tangent_action(many, here, virtual, stiff)
    return _by_states(by_d - by_v, group), _by_states(by_v - tau * stiff, group)


def _side_by_side(group: Record, *full: Array) -> tuple[Record, list[Array]]:
    """Return a group of each element at each state, and full coordinates (m, n_full) copied to its own coordinates."""
    m, (count, n) = len(full[0]), group.dofs.shape
    many = of_elements(group, np.repeat(np.arange(count), m))
    return (many.replaced(dofs=np.arange(count * m * n).reshape(-1, n)),
            [np.ascontiguousarray(np.swapaxes(x[:, group.dofs], 0, 1)).ravel() for x in full])


def _by_states(own: Array, group: Record) -> Array:
    """Return values of elements at states as (m, elements, n)."""
    count, n = group.dofs.shape
    return np.swapaxes(own.reshape(count, -1, n), 0, 1)
