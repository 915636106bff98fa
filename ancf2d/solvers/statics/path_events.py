"""Events of a path: its end, limit points and bifurcations, and how they are located within a step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from ...case import LimitPoints, LoadFactor, ProbeReaches
from ...elements.contact_geometry import STATUS
from ...elements.shape import Array
from ...errors import ComputationError
from ...model.model import Model
from ..state import State
from ..state_results import Observer
from .continuation import Curve, PathPoint
from .path_controls import Control, FactorControl, ProbeControl, ProbeValue

# displacements of a limit point are located to this share of the largest
LIMIT_DIGITS = 1e-9
# points this close determine the path between by the cubic through them (error of fourth order)
NARROW = 1e-4
MOST_TRIALS = 40
# distance of a point from the straight legs of a corner before it, as a share of the step
OFF_LEGS = 0.1
SAMPLES = np.linspace(0.0, 1.0, 33)


class Goal(Protocol):
    """The value at which a path ends."""

    def distance(self, d: Array, t: float) -> float:
        """Return the signed distance of a state from the value."""
        ...

    def slope(self, point: PathPoint) -> float:
        """Return the derivative of ``distance`` along the path."""
        ...

    def control(self) -> Control:
        """Return the equation that selects the state at the value."""
        ...

    def settle(self, d: Array, turned: Array) -> None:
        """Update the goal with an accepted state."""
        ...

    def __str__(self) -> str:
        """Return the goal in words."""
        ...


class FactorGoal:
    """A load factor."""

    def __init__(self, model: Model, until: LoadFactor) -> None:
        self.value, self.n = until.value, model.numbering.n_unknowns

    def distance(self, d: Array, t: float) -> float:
        """Return t - value."""
        return t - self.value

    def slope(self, point: PathPoint) -> float:
        """Return dt/ds."""
        return point.rate

    def control(self) -> Control:
        """Return t = value."""
        return FactorControl(self.value, self.n)

    def settle(self, d: Array, turned: Array) -> None:
        """Do nothing: a load factor has no turns to count."""

    def __str__(self) -> str:
        return f"load factor {self.value:.6g}"


class ProbeGoal:
    """A value of a quantity of a probe."""

    def __init__(self, model: Model, until: ProbeReaches) -> None:
        self.until = until
        self.probe = ProbeValue(model, model.case.output.probes[until.probe], until.quantity)

    def distance(self, d: Array, t: float) -> float:
        """Return the probe's quantity less the value."""
        return self.probe.value(d) - self.until.reaches

    def slope(self, point: PathPoint) -> float:
        """Return the derivative of the quantity along the path."""
        gradient, by_t = self.probe.derivatives(point.d)
        return float(gradient @ point.z) + by_t * point.rate

    def control(self) -> Control:
        """Return quantity = value."""
        return ProbeControl(self.probe, self.until.reaches)

    def settle(self, d: Array, turned: Array) -> None:
        """Count the probe's turns from this state."""
        self.probe.settle(d, turned)

    def __str__(self) -> str:
        return f"{self.until.probe} {self.until.quantity} = {self.until.reaches:.6g}"


def goal_of(model: Model, until: LoadFactor | LimitPoints | ProbeReaches) -> Goal | None:
    """Return the goal of a path, or None if it ends at a limit point."""
    if isinstance(until, LimitPoints):
        return None
    return FactorGoal(model, until) if isinstance(until, LoadFactor) else ProbeGoal(model, until)


def cubic(a: Any, slope_a: Any, b: Any, slope_b: Any, h: float, x: Any) -> Any:
    """Return the cubic through values and slopes at 0 and h, at the fraction x of h (Hermite)."""
    y = 1 - x
    return a * y * y * (1 + 2 * x) + slope_a * h * x * y * y + b * x * x * (3 - 2 * x) - slope_b * h * x * x * y


def between(model: Model, a: PathPoint, b: PathPoint, s: float) -> tuple[Array, float]:
    """Return the state (n_full,) and load factor at parameter s by the cubic through two points and their tangents."""
    free, h = model.numbering.free, b.s - a.s
    x = (s - a.s) / h
    t = float(cubic(a.t, a.rate, b.t, b.rate, h, x))
    return model.displacements(cubic(a.d[free], a.z, b.d[free], b.z, h, x), t), t


def hides_limit_points(a: PathPoint, b: PathPoint) -> bool:
    """Return whether the load factor, by the cubic, reverses twice between two points with dt/ds of the same sign."""
    if a.rate * b.rate <= 0:
        return False
    middle = 3 * (b.t - a.t) / (b.s - a.s) - a.rate - b.rate
    # derivative of the cubic: a (1-x)^2 + 2 c x (1-x) + b x^2 in Bernstein form, with c = ``middle``
    return middle * a.rate < 0 and middle**2 > a.rate * b.rate


def limit_between(curve: Curve, a: PathPoint, b: PathPoint, settled: Callable[[float, Any], PathPoint]) -> PathPoint:
    """Return the limit point between two points whose dt/ds differ in sign, by regula falsi (Illinois) along the path.

    ``settled(s, guess)`` returns the path's point at s. The load is then accurate to 1e-2 of the tolerance, as its
    error is of second order. If the tangent stiffness is singular to round-off, the point is interpolated.
    """
    low, high, f_low, f_high = a, b, a.rate, b.rate
    iterations = 0
    for _ in range(MOST_TRIALS):
        narrow = _spread(curve, low, high.s - low.s) <= NARROW
        if narrow and others_act(low, high) and corner_between(curve, low, high) is not None:
            # at an acute corner, an arc may meet the path on both sides
            return _interpolated(curve, low, high, iterations)
        s = low.s + (high.s - low.s) * f_low / (f_low - f_high)
        try:
            point = settled(s, between(curve.model, low, high, s))
        except ComputationError:
            if narrow:
                return _interpolated(curve, low, high, iterations)
            low, high = _closer(curve, low, high, s, settled)
            f_low, f_high = low.rate, high.rate
            continue
        iterations += point.iterations
        off = abs(point.rate * (high.s - low.s) / (high.rate - low.rate))
        close = 0.5 * off * abs(point.rate) <= 1e-2 * curve.tolerance * max(abs(a.t), abs(b.t))
        if close and _spread(curve, point, off) <= LIMIT_DIGITS:
            return replace(point, iterations=iterations)
        if point.rate * low.rate > 0:
            low, f_low, f_high = point, point.rate, f_high if high is b else 0.5 * f_high
        else:
            high, f_high, f_low = point, point.rate, f_low if low is a else 0.5 * f_low
    raise ComputationError("a limit point was passed but could not be located", at={"factor": float(f"{b.t:.6g}")})


def _spread(curve: Curve, point: PathPoint, h: float) -> float:
    """Return the displacement of a step of h relative to the total displacements."""
    return h * curve.system.norm(point.z) / curve.system.norm(point.d[curve.model.numbering.free])


def _closer(curve: Curve, low: PathPoint, high: PathPoint, s: float,
            settled: Callable[[float, Any], PathPoint]) -> tuple[PathPoint, PathPoint]:
    """Return points on both sides of s, ten times closer than low and high."""
    ends = [low, high]
    for side in (low, high):
        near = s + 0.1 * (side.s - s)
        point = settled(near, between(curve.model, low, high, near))
        ends[point.rate * low.rate < 0] = point
    return ends[0], ends[1]


def others_act(a: PathPoint, b: PathPoint) -> bool:
    """Return whether other contact points, closed or in layers, or other one-sided springs act at two points of a path.
    """
    closed = any((one[:, STATUS] != two[:, STATUS]).any() for one, two in zip(a.touching, b.touching, strict=True))
    return closed or any((one != two).any() for one, two in zip(a.acting, b.acting, strict=True))


def corner_between(curve: Curve, a: PathPoint, b: PathPoint) -> tuple[Array, float] | None:
    """Return unknowns and load factor of the corner if the path goes straight to it from a, and from there straight to
    b; else None.
    """
    free, metric, legs = curve.model.numbering.free, curve.metric, (a.tangent, b.tangent)
    went = b.d[free] - a.d[free], b.t - a.t
    G = [[metric.dot(one, other) for other in legs] for one in legs]
    first, second = np.linalg.lstsq(G, [metric.dot(one, went) for one in legs], rcond=None)[0].tolist()
    beside = metric.norm((went[0] - first * a.z - second * b.z, went[1] - first * a.rate - second * b.rate))
    if min(first, second) < 0.0 or beside > OFF_LEGS * metric.norm(went):
        return None
    return a.d[free] + first * a.z, a.t + first * a.rate


def _interpolated(curve: Curve, low: PathPoint, high: PathPoint, iterations: int) -> PathPoint:
    """Return the point where dt/ds = 0 between two very close ones, or where it changes sign at a corner."""
    if others_act(low, high) and (corner := corner_between(curve, low, high)) is not None:
        d, t = curve.model.displacements(*corner), corner[1]
        return replace(low, d=d, t=t, balance=curve.system.forces(d, t), iterations=iterations)
    x = low.rate / (low.rate - high.rate)
    s = low.s + x * (high.s - low.s)
    d, t = between(curve.model, low, high, s)
    return PathPoint(d, t, s, (1 - x) * low.z + x * high.z, 0.0, high.negative, curve.system.forces(d, t), iterations,
                     high.increment, high.uncertainty, high.touching, high.acting)


def goal_between(curve: Curve, goal: Goal, a: PathPoint, b: PathPoint,
                 scale: Callable[[Array, Array], float]) -> PathPoint | None:
    """Return the point between two points where the goal is met exactly, or None if it is not met there."""
    h, off_a, off_b = b.s - a.s, goal.distance(a.d, a.t), goal.distance(b.d, b.t)
    along = cubic(off_a, goal.slope(a), off_b, goal.slope(b), h, SAMPLES)
    along[0], along[-1] = off_a, off_b
    crossed = np.flatnonzero((along[:-1] != 0) & (along[:-1] * along[1:] <= 0))
    if not len(crossed):
        return None
    k = int(crossed[0])
    x = SAMPLES[k] + (SAMPLES[k + 1] - SAMPLES[k]) * along[k] / (along[k] - along[k + 1])
    d, t = between(curve.model, a, b, a.s + x * h)
    found = curve.correct(goal.control(), d, t)
    free = curve.model.numbering.free
    away = curve.metric.norm((found.d[free] - d[free], found.t - t))
    step = curve.metric.norm((b.d[free] - a.d[free], b.t - a.t))
    if away > 0.25 * step:
        raise ComputationError(f"{goal} was passed but could not be located", at={"factor": float(f"{t:.6g}")})
    return curve.point(found, a.s + x * h, scale)


class PathLog:
    """Limit points and bifurcations of the path so far, with the values of the probes there."""

    def __init__(self, model: Model) -> None:
        self.observer = Observer(model)
        self.limit_points: list[dict[str, Any]] = []
        self.bifurcations: list[dict[str, Any]] = []

    def observe(self, state: State, limit: bool) -> None:
        """Store a limit point with the values of the probes."""
        if limit:
            self.limit_points.append({"factor": state.t, "probes": self.observer.observe(state)})

    def branch(self, a: PathPoint, b: PathPoint, before: State) -> str:
        """Store a bifurcation between two points, with the values of the probes before it; return the warning."""
        factor = 0.5 * (a.t + b.t)
        direction = "and the path continues straight on; the branches are not followed"
        self.bifurcations.append({"factor": factor, "negative_pivots": [a.negative, b.negative],
                                  "direction": direction, "probes": self.observer.observe(before)})
        return (f"a bifurcation was passed at load factor {factor:.6g} ({a.negative} negative pivots before, "
                f"{b.negative} after), {direction}; to follow a branch, add an imperfection or branch: {{at: "
                f"{len(self.bifurcations)}}} under solver")

    def left(self, factor: float, direction: int, negative: int, known: bool) -> str:
        """Store the departure from the path at the last bifurcation, with its improved factor; return the warning.

        ``negative``: the negative pivots at the first point of the branch.
        """
        stable = "" if not known else (", which is stable there" if negative <= 0 else ", which is unstable there "
                                       f"(negative pivots: {negative})")
        way = f"and the path was left along its mode in direction {direction}"
        self.bifurcations[-1].update(factor=factor, direction=way, branch_negative_pivots=negative)
        return f"a bifurcation was met at load factor {factor:.6g}, {way}: onto a branch{stable}"

    def report(self) -> dict[str, Any]:
        """Return the entries for the summary."""
        return {"limit_points": list(self.limit_points), "bifurcations": list(self.bifurcations)}

    def tables(self) -> dict[str, dict[str, list[Any]]]:
        """Return the limit points as a table: number, factor, and each probe's quantities."""
        if not self.limit_points:
            return {}
        table: dict[str, list[Any]] = {"number": list(range(1, len(self.limit_points) + 1)),
                                       "factor": [p["factor"] for p in self.limit_points]}
        for name, values in self.limit_points[0]["probes"].items():
            for quantity in values:
                table[f"{name}.{quantity}"] = [p["probes"][name][quantity] for p in self.limit_points]
        return {"limit_points": table}
