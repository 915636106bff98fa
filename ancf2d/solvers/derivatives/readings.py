"""What goals read of the stored states of a motion, as sums of changes of its unknowns and of its rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ...elements.shape import Array
from ...kernels.motion.advance import INSIDE
from ...kernels.motion.dynamics import signals_at
from ...kernels.motion.state import fill_full
from ...model.model import Model
from ..linear import unknowns_to_coordinates
from ..post import Observer
from ..state import Row, State
from .differences import Quotient, UnsuitedError, error_of
from .linear_steps import Change
from .varied_motions import Beside

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

# a value, a state, a probe and its quantity, and what a change of this does to the value
Term = tuple[int, int, str, str, float]


class Goals(Protocol):
    """Numbers that follow from what probes read of states, of the last alone unless ``whole``."""

    @property
    def whole(self) -> bool: ...

    @property
    def count(self) -> int:
        """How many depend on states."""
        ...

    def __call__(self, model: Model, states: Sequence[State]) -> Array:
        """Return the values (k,)."""
        ...

    def terms(self, model: Model, states: Sequence[State]) -> list[Term]:
        """Return what quantities of probes do to the values. Raises UnsuitedError where these do not tell."""
        ...

    def alike(self, one: Model, other: Model) -> bool:
        """Return whether the values of the same states are those of both models."""
        ...


class Readings:
    """What goals (k,) read of the ``states`` of a motion, which are all that are stored, or the last one alone.

    ``free`` (n,) is 0 of multipliers.
    """

    def __init__(self, model: Model, goals: Goals, states: Sequence[State], free: Array) -> None:
        self.model, self.goals, self.states, self.free = model, goals, states, free
        self.values = goals(model, states)

    @cached_property
    def by(self) -> tuple[csc_matrix, csc_matrix]:
        """What changes of the unknowns, and of their rates, of all states do to the goals: (k, states n) each.

        Raises UnsuitedError where rates are read that are put onto the constraints, and what ``Goals.terms`` raises.
        """
        from scipy.sparse import csc_matrix, csr_matrix, identity, kron

        observer, n_q = Observer(self.model, forces=False), self.model.n_q
        slopes: dict[tuple[int, str, str], Any] = {}
        parts: list[list[Array]] = []
        for goal, state, probe, quantity, weight in self.goals.terms(self.model, self.states):
            asked = state, probe, quantity
            if asked not in slopes:
                slopes[asked] = observer.slopes(probe, quantity, self.states[state])
            coords, by_d, by_v = slopes[asked]
            if by_v.any() and not self.free.all():
                raise UnsuitedError("rates of states are put onto the constraints")
            parts.append([np.full(len(coords), goal), state * n_q + coords, weight * by_d, weight * by_v])
        n, k = self.model.n_q * len(self.states), len(self.values)
        T = kron(identity(len(self.states)), unknowns_to_coordinates(self.model), "csr")
        if not parts:
            return csc_matrix((k, T.shape[1])), csc_matrix((k, T.shape[1]))
        rows, columns, by_place, by_rate = (np.concatenate(part) for part in zip(*parts, strict=True))
        by_place, by_rate = (csc_matrix(csr_matrix((by, (rows, columns)), (k, n)) @ T) for by in (by_place, by_rate))
        return by_place, by_rate

    def of(self, rows: Sequence[Row]) -> bool:
        """Return whether the goals are sums of changes of stored states, none of which is put onto constraints."""
        if not self.free.all() and any(row.kind == INSIDE for row in rows):
            return False
        try:
            return bool(self.by)
        except UnsuitedError:
            return False

    def bars(self) -> list[Change]:
        """Return what changes of each state do to the goals (n, k)."""
        n, out = len(self.free), [Change.none(len(self.free), len(self.values)) for _ in self.states]
        for name, by in zip(("z", "v"), self.by, strict=True):
            for state, bar in enumerate(out):
                getattr(bar, name)[:] = by[:, state * n:(state + 1) * n].T.toarray()
        return out

    def change(self, number: Beside, rows: Sequence[Row], windows: Sequence[Array], value: Array, error: Array
               ) -> Quotient:
        """Return the change of the goals with a number, by that of the states (states, 3, n) and its ``error``."""
        parts = [(by @ value[:, k].ravel(), abs(by) @ error[:, k].ravel()) for k, by in enumerate(self.by)]
        direct, near = self.directly(number, rows, windows)
        return Quotient(sum(found for found, _ in parts) + direct,
                        sum(off for _, off in parts) + error_of(direct, near), number.h)

    def directly(self, number: Beside, rows: Sequence[Row], windows: Sequence[Array]) -> Array:
        """Return differences (2, k), by the weights of a number, of what is read where unknowns stay as they are.

        ``windows`` are between breaks, which amplitudes follow at the ``rows`` of the states.
        """
        found = number.differing
        if not found.moves and all(self.goals.alike(self.model, model) for model in found.models):
            return np.zeros((2, len(self.values)))
        read = [self.goals(model, self._beside(number, side, rows, windows) if found.moves else self.states)
                for side, model in enumerate(found.models)]
        return np.asarray(number.weights @ np.array(read))

    def _beside(self, number: Beside, side: int, rows: Sequence[Row], windows: Sequence[Array]) -> list[State]:
        """Return the states of a model beside the number at the same unknowns."""
        p, w, out = number.differing.problems[side], number.differing.w[side], list[State]()
        for row, window, state in zip(rows, windows, self.states, strict=True):
            full = np.zeros((2, len(p.place)))
            p.programs.window[:] = window
            signals_at(p, row.side, w.amps)
            fill_full(p, row.z, w.amps, 0, full[0])
            fill_full(p, row.v, w.amps, 1, full[1])
            out.append(replace(state, d=full[0], v=full[1]))
        return out
