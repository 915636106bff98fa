"""Values of goals from the stored states of a motion, linear in changes of its unknowns and rates."""

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
from ..state import Row, State
from ..state_results import Observer
from .differences import Quotient, UnsuitedError, error_of
from .linear_steps import Change
from .varied_motions import VariedNumber

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

# relative error of derivatives that is negligible for most purposes
CLOSE = 1e-9

# number of the value and of the state, probe and quantity, and the derivative of the value by the quantity
Term = tuple[int, int, str, str, float]


class Goals(Protocol):
    """Numbers that follow from probes of states, of the last state only unless ``all_states``.

    Relative errors of their derivatives below ``negligible`` do not matter.
    """

    @property
    def all_states(self) -> bool: ...

    @property
    def negligible(self) -> float: ...

    @property
    def count(self) -> int:
        """Return how many of the values depend on states."""
        ...

    def __call__(self, model: Model, states: Sequence[State]) -> Array:
        """Return the values (k,)."""
        ...

    def terms(self, model: Model, states: Sequence[State]) -> list[Term]:
        """Return the derivatives of the values by quantities of probes.

        Raises UnsuitedError if the values do not follow from these.
        """
        ...

    def alike(self, one: Model, other: Model) -> bool:
        """Return whether both models give the same values for the same states."""
        ...


class Readings:
    """Goals (k,) as functions of the ``states`` of a motion, either all stored ones or only the last.

    ``free`` (n,) is 0 for multipliers.
    """

    def __init__(self, model: Model, goals: Goals, states: Sequence[State], free: Array) -> None:
        self.model, self.goals, self.states, self.free = model, goals, states, free
        self.values = goals(model, states)

    @cached_property
    def by(self) -> tuple[csc_matrix, csc_matrix]:
        """The derivatives of the goals by the unknowns and by the rates of all states: (k, states n) each.

        Raises UnsuitedError if rates are read that are projected onto the constraints, or as ``Goals.terms`` does.
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
                raise UnsuitedError("rates of states are projected onto the constraints")
            parts.append([np.full(len(coords), goal), state * n_q + coords, weight * by_d, weight * by_v])
        n, k = self.model.n_q * len(self.states), len(self.values)
        T = kron(identity(len(self.states)), unknowns_to_coordinates(self.model), "csr")
        if not parts:
            return csc_matrix((k, T.shape[1])), csc_matrix((k, T.shape[1]))
        rows, columns, by_place, by_rate = (np.concatenate(part) for part in zip(*parts, strict=True))
        by_place, by_rate = (csc_matrix(csr_matrix((by, (rows, columns)), (k, n)) @ T) for by in (by_place, by_rate))
        return by_place, by_rate

    def linear_in(self, rows: Sequence[Row]) -> bool:
        """Return whether the derivatives of the goals follow from those of stored states that are not projected."""
        if not self.free.all() and any(row.kind == INSIDE for row in rows):
            return False
        try:
            return bool(self.by)
        except UnsuitedError:
            return False

    def bars(self) -> list[Change]:
        """Return the derivatives of the goals by each state (n, k)."""
        n, out = len(self.free), [Change.none(len(self.free), len(self.values)) for _ in self.states]
        for name, by in zip(("z", "v"), self.by, strict=True):
            for state, bar in enumerate(out):
                getattr(bar, name)[:] = by[:, state * n:(state + 1) * n].T.toarray()
        return out

    def change(self, number: VariedNumber, rows: Sequence[Row], windows: Sequence[Array], value: Array, error: Array
               ) -> Quotient:
        """Return the derivatives of goals by a number, from those of the states (states, 3, n) and their ``error``."""
        parts = [(by @ value[:, k].ravel(), abs(by) @ error[:, k].ravel()) for k, by in enumerate(self.by)]
        direct, near = self.direct_differences(number, rows, windows)
        return Quotient(sum(found for found, _ in parts) + direct,
                        sum(off for _, off in parts) + error_of(direct, near), number.h)

    def direct_differences(self, number: VariedNumber, rows: Sequence[Row], windows: Sequence[Array]) -> Array:
        """Return differences (2, k), by the weights of a number, of the goals at the same unknowns.

        ``windows`` between breaks give the times of signals at the ``rows`` of the states.
        """
        found = number.differing
        if not found.changes_coordinates and all(self.goals.alike(self.model, model) for model in found.models):
            return np.zeros((2, len(self.values)))
        read = [self.goals(model, self._varied_states(number, side, rows, windows)
                           if found.changes_coordinates else self.states)
                for side, model in enumerate(found.models)]
        return np.asarray(number.weights @ np.array(read))

    def _varied_states(self, number: VariedNumber, side: int, rows: Sequence[Row], windows: Sequence[Array]
                       ) -> list[State]:
        """Return the states of a varied model at the same unknowns."""
        p, w, out = number.differing.problems[side], number.differing.w[side], list[State]()
        for row, window, state in zip(rows, windows, self.states, strict=True):
            full = np.zeros((2, len(p.place)))
            p.programs.window[:] = window
            signals_at(p, row.side, w.amps)
            fill_full(p, row.z, w.amps, 0, full[0])
            fill_full(p, row.v, w.amps, 1, full[1])
            out.append(replace(state, d=full[0], v=full[1]))
        return out
