"""Values of a motion over time windows: mean or largest magnitude, and their uncertainty due to stored times.

The value at a single time of a motion with stick and slip, impacts or waves that no step resolves need not converge
under refinement of mesh and steps. Its mean over a window converges, as does an impulse.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..elements.shape import Array
from ..model.model import Model

if TYPE_CHECKING:
    from ..solvers.state import State


def window_of(goal: Any) -> tuple[float, float] | None:
    """Return the window [s] of a goal or an expected value, or None if it refers to the last state."""
    found: tuple[float, float] | None = goal.mean_over or goal.peak_over
    return found


def window_key(goal: Any) -> str:
    """Return the key of a goal over a window in a summary."""
    begin, end = window_of(goal) or (0.0, 0.0)
    return f"{'mean' if goal.mean_over else 'peak'} of {_quantity_name(goal)} from {begin:g} to {end:g} s"


def _quantity_name(goal: Any) -> str:
    """Return the name of the values over time that a goal reads."""
    return " ".join(str(p) for p in (goal.probe, goal.reaction, goal.quantity) if p is not None)


def value_at(goal: Any, summary: dict[str, Any]) -> float | None:
    """Return the value of a goal from the summary of one state, or None if it is not there."""
    if goal.probe is not None:
        found: float | None = summary["probes"].get(goal.probe, {}).get(goal.quantity)
    elif goal.reaction is not None:
        found = summary.get("reactions", {}).get(goal.reaction, {}).get(goal.quantity)
    else:
        found = summary.get("energy", {}).get("strain")
    return found


class Windows:
    """Collects the values of goals over windows, state by state; by default those of the case."""

    def __init__(self, model: Model, goals: Sequence[Any] | None = None) -> None:
        goals = (model.case.goal, *model.case.expected) if goals is None else goals
        self.model = model
        self.goals = {window_key(g): g for g in goals if g is not None and window_of(g) is not None}
        self.reacts = any(g.reaction is not None for g in self.goals.values())
        self.samples: dict[str, list[tuple[float, float]]] = {name: [] for name in self.goals}

    def record(self, state: State, probes: dict[str, dict[str, float]],
             reactions: Callable[[State], dict[str, dict[str, float]]]) -> None:
        """Record the next state with its probes; ``reactions`` computes those of a state, which is expensive."""
        if not self.goals:
            return
        summary = {"probes": probes, "energy": state.history}
        if self.reacts:
            summary["reactions"] = reactions(state)
        for name, goal in self.goals.items():
            value = value_at(goal, summary)
            self.samples[name].append((state.t, np.nan if value is None else value))

    def values(self) -> dict[str, dict[str, Any]]:
        """Return ``value`` of each goal, and ``sampling``, its difference from the value with every second stored time.

        Both are None if the motion has not reached the end of the window. ``of``, ``from`` and ``to`` describe quantity
        and window.
        """
        return {name: {"of": _quantity_name(goal), **dict(zip(("from", "to"), window_of(goal) or (), strict=False)),
                       **self._value_and_sampling(goal, np.array(self.samples[name]).reshape(-1, 2))}
                for name, goal in self.goals.items()}

    def _value_and_sampling(self, goal: Any, found: Array) -> dict[str, float | None]:
        window = window_of(goal)
        assert window is not None
        near = 1e-9 * window[1]
        if not len(found) or found[-1, 0] < window[1] - near or np.isnan(found[:, 1]).any():
            return {"value": None, "sampling": None}
        of = mean if goal.mean_over else peak
        # both samplings include the first and the last time
        half = found[np.unique([*range(0, len(found), 2), len(found) - 1])]
        value = of(found[:, 0], found[:, 1], window)
        return {"value": value, "sampling": abs(value - of(half[:, 0], half[:, 1], window))}

    def checkpoint_data(self) -> dict[str, list[tuple[float, float]]]:
        """Return the samples for a checkpoint."""
        return dict(self.samples)

    def restore(self, found: dict[str, list[tuple[float, float]]]) -> None:
        """Restore the samples from a checkpoint."""
        self.samples.update({name: [(float(t), float(v)) for t, v in rows] for name, rows in found.items()})


def _within(t: Array, f: Array, window: tuple[float, float]) -> tuple[Array, Array]:
    """Return the samples within a window, with interpolated ones at its ends."""
    inside = (t > window[0]) & (t < window[1])
    times = np.concatenate([window[:1], t[inside], window[1:]])
    # keep both samples at the time of a jump, for the integral
    values = np.concatenate([[np.interp(window[0], t, f)], f[inside], [np.interp(window[1], t, f)]])
    return times, values


def mean(t: Array, f: Array, window: tuple[float, float]) -> float:
    """Return the mean of samples f (n,) at times t (n,) over a window, by the trapezoidal rule."""
    times, values = _within(t, f, window)
    return float(np.trapezoid(values, times)) / (window[1] - window[0])


def peak(t: Array, f: Array, window: tuple[float, float]) -> float:
    """Return the largest magnitude of samples f (n,) at times t (n,) within a window."""
    return float(np.abs(_within(t, f, window)[1]).max())


def window_weights(goal: Any, t: Array, f: Array) -> Array:
    """Return the derivative of a goal over a window by each sample f (n,) at times t (n,).

    The mean is linear in the samples; the peak is one sample, or interpolated between two at an end of the window.
    """
    window = window_of(goal)
    assert window is not None
    (times, values), out = _within(t, f, window), np.zeros(len(t))
    by = np.zeros(len(times))
    if goal.mean_over:
        halves = 0.5 * np.diff(times) / (window[1] - window[0])
        by[:-1] += halves
        by[1:] += halves
    else:
        k = int(np.abs(values).argmax())
        by[k] = np.sign(values[k])
    out[(t > window[0]) & (t < window[1])] = by[1:-1]
    for at, weight in ((window[0], by[0]), (window[1], by[-1])):
        j = min(max(int(np.searchsorted(t, at, side="right")) - 1, 0), len(t) - 2)
        share = (at - t[j]) / (t[j + 1] - t[j]) if t[j + 1] > t[j] else 1.0
        out[j] += (1.0 - share) * weight
        out[j + 1] += share * weight
    return out
