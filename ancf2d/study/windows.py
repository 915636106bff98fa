"""Values of a motion over windows of time: the mean, or the largest magnitude, and what stored times leave open.

The value at one time of a motion with stick and slip, impacts or waves that no step resolves need not have a limit over
meshes and steps. Its mean over a window has one, as has an impulse.
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
    """Return the window [s] that a goal or an expected value is over, None where it is of the last state."""
    found: tuple[float, float] | None = goal.mean_over or goal.peak_over
    return found


def window_key(goal: Any) -> str:
    """Return what the value of a goal over a window is called in a summary."""
    begin, end = window_of(goal) or (0.0, 0.0)
    return f"{'mean' if goal.mean_over else 'peak'} of {_read_by(goal)} from {begin:g} to {end:g} s"


def _read_by(goal: Any) -> str:
    """Return what the values that a goal reads are called over time."""
    return " ".join(str(p) for p in (goal.probe, goal.reaction, goal.quantity) if p is not None)


def value_at(goal: Any, summary: dict[str, Any]) -> float | None:
    """Return the value of a goal in what is known of one state, None where it is not there."""
    if goal.probe is not None:
        found: float | None = summary["probes"].get(goal.probe, {}).get(goal.quantity)
    elif goal.reaction is not None:
        found = summary.get("reactions", {}).get(goal.reaction, {}).get(goal.quantity)
    else:
        found = summary.get("energy", {}).get("strain")
    return found


class Windows:
    """Follows those of some goals that are over windows, from state to state; without any those of the case."""

    def __init__(self, model: Model, goals: Sequence[Any] | None = None) -> None:
        told = (model.case.goal, *model.case.expected) if goals is None else goals
        self.model = model
        self.goals = {window_key(g): g for g in told if g is not None and window_of(g) is not None}
        self.reacts = any(g.reaction is not None for g in self.goals.values())
        self.samples: dict[str, list[tuple[float, float]]] = {name: [] for name in self.goals}

    def take(self, state: State, probes: dict[str, dict[str, float]],
             reacted: Callable[[State], dict[str, dict[str, float]]]) -> None:
        """Take the next state, what its probes read, and what tells its reactions, which is dear."""
        if not self.goals:
            return
        summary = {"probes": probes, "energy": state.history}
        if self.reacts:
            summary["reactions"] = reacted(state)
        for name, goal in self.goals.items():
            value = value_at(goal, summary)
            self.samples[name].append((state.t, np.nan if value is None else value))

    def values(self) -> dict[str, dict[str, Any]]:
        """Return ``value`` of each, and ``sampling``, its difference from that of every second stored time.

        Both are None where the motion has not come to the end of the window. ``of``, ``from`` and ``to`` tell what they
        are of.
        """
        return {name: {"of": _read_by(goal), **dict(zip(("from", "to"), window_of(goal) or (), strict=False)),
                       **self._told(goal, np.array(self.samples[name]).reshape(-1, 2))}
                for name, goal in self.goals.items()}

    def _told(self, goal: Any, found: Array) -> dict[str, float | None]:
        window = window_of(goal)
        assert window is not None
        near = 1e-9 * window[1]
        if not len(found) or found[-1, 0] < window[1] - near or np.isnan(found[:, 1]).any():
            return {"value": None, "sampling": None}
        of = mean if goal.mean_over else peak
        # the first and the last are of both
        half = found[np.unique([*range(0, len(found), 2), len(found) - 1])]
        value = of(found[:, 0], found[:, 1], window)
        return {"value": value, "sampling": abs(value - of(half[:, 0], half[:, 1], window))}

    def kept(self) -> dict[str, list[tuple[float, float]]]:
        """Return what a run that is resumed needs."""
        return dict(self.samples)

    def go_on(self, found: dict[str, list[tuple[float, float]]]) -> None:
        """Take up what was kept."""
        self.samples.update({name: [(float(t), float(v)) for t, v in rows] for name, rows in found.items()})


def _within(t: Array, f: Array, window: tuple[float, float]) -> tuple[Array, Array]:
    """Return samples within a window, those at its ends between their neighbours."""
    inside = (t > window[0]) & (t < window[1])
    times = np.concatenate([window[:1], t[inside], window[1:]])
    # of two samples of one time, before and after a jump, the integral needs both
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
    """Return what a change of each sample f (n,) at times t (n,) does to the value of a goal over a window.

    The mean is linear in the samples, and the peak is one of them, or lies between two at an end of the window.
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
