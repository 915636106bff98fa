"""Steps along a path, and how it leaves on a branch at a bifurcation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ...case.schema.solvers import LARGEST_STEP, LOAD_STEPS
from ...elements.shape import Array
from ...errors import ComputationError
from .continuation import Curve, Found, PathPoint
from .path_controls import ArcLength, Control, ProbeControl
from .path_events import FactorGoal, Goal, ProbeGoal

# first step of a path that does not end at a load factor, as a share of the largest step
FIRST = 0.1
# largest displacement in this step, as a share of the extent, if the tangent is not symmetric: its determinant hides
# critical points that come in pairs
FIRST_BLIND_MOVE = 1e-6
# share of a path's length that is round-off
END = 1e-12
# displacements relative to the extent that count as none, if bodies rest on obstacles
REST = 1e-5

Scale = Callable[[Array, Array], float]


class Steps(Protocol):
    """The parameter s of a path; ``start`` is its first point, at s = 0."""

    start: PathPoint

    def control(self, a: PathPoint, h: float) -> Control:
        """Return the equation that selects the point a step of h from a."""
        ...

    def scale(self, a: PathPoint) -> Scale:
        """Return a function of (d, dz/dt) that gives dt/ds of a tangent in the direction of a's tangent."""
        ...

    def first(self) -> float:
        """Return the first step to try."""
        ...

    def largest(self, a: PathPoint) -> float:
        """Return the largest step from a."""
        ...

    def ends(self, a: PathPoint) -> bool:
        """Return whether the parameter has reached its end."""
        ...

    def renew(self, a: PathPoint) -> float:
        """Adapt the unit of s to the path so far; return the length of an old unit in new ones."""
        ...


class ArcSteps:
    """Steps by arc length, in the direction of the previous tangent."""

    def __init__(self, curve: Curve, goal: Goal | None, start: Found, longest: float | None = None) -> None:
        self.curve, self.goal, self.longest = curve, goal, longest or LARGEST_STEP
        self.origin = start.d[curve.model.numbering.free]
        self.moved = self.loaded = 0.0
        forward = -1.0 if isinstance(goal, FactorGoal) and goal.value < start.t else 1.0
        self.start = curve.first_point(start, forward, lambda d, by_load: forward)
        curve.metric.load = curve.metric.dot((self.start.z, 0.0), (self.start.z, 0.0))
        if curve.model.contacts and not self._moves(curve.metric.load):
            # bodies that rest on obstacles may move later
            curve.metric.load = curve.model.extent**2
        if curve.metric.load == 0.0:
            raise ComputationError("nothing moves as the load factor grows", at={"factor": float(f"{start.t:.6g}")},
                                   advice="a load or prescribed motion without an amplitude, which the load factor "
                                   "scales")
        self.renew(self.start)
        self.whole = 0.0 if goal is None else abs(goal.distance(start.d, start.t))

    def control(self, a: PathPoint, h: float) -> Control:
        """Return the arc of length h from a."""
        return ArcLength(self.curve.model, self.curve.metric, a.d, a.t, h)

    def scale(self, a: PathPoint) -> Scale:
        """Return a function that scales a tangent to one unit of arc, on the side of a's tangent."""
        def unit(d: Array, by_load: Array) -> float:
            metric = self.curve.metric
            sign = 1.0 if metric.dot(a.tangent, (by_load, 1.0)) > 0 else -1.0
            return sign / metric.norm((by_load, 1.0))
        return unit

    def first(self) -> float:
        """Return a share of the way to a load factor, or a small step."""
        largest = self.largest(self.start)
        if isinstance(self.goal, FactorGoal):
            return largest
        share = FIRST * self.longest if self.curve.model.symmetric else FIRST_BLIND_MOVE
        return min(largest, self._moving(self.start, share))

    def _moves(self, square: float) -> bool:
        """Return whether the square of a displacement is more than round-off."""
        return square > (REST * self.curve.model.extent)**2

    def _moving(self, a: PathPoint, share: float) -> float:
        size = self.curve.system.norm(a.z)
        return share * self.curve.model.extent / size if size > 0.0 else np.inf

    def largest(self, a: PathPoint) -> float:
        """Return the largest step that moves no point too far and resolves the way to the goal."""
        slope = 0.0 if self.goal is None else abs(self.goal.slope(a))
        return min(self._moving(a, self.longest), self.whole * self.longest / slope if slope > 0 else np.inf)

    def ends(self, a: PathPoint) -> bool:
        """Return False: arc length has no end."""
        return False

    def renew(self, a: PathPoint) -> float:
        """Weigh load factor and displacements by their ranges along the path so far."""
        metric = self.curve.metric
        dz = a.d[self.curve.model.numbering.free] - self.origin
        self.moved, self.loaded = max(self.moved, metric.dot((dz, 0.0), (dz, 0.0))), max(self.loaded, a.t**2)
        if self.moved > 0 and self.loaded > 0 and (self._moves(self.moved) or not self.curve.model.contacts):
            metric.load = self.moved / self.loaded
        unit = metric.norm(a.tangent)
        a.z, a.rate = a.z / unit, a.rate / unit
        return unit


class ProbeSteps:
    """Steps by a quantity of a probe, towards its final value."""

    def __init__(self, curve: Curve, goal: ProbeGoal, start: Found, steps: int | None) -> None:
        self.curve, self.goal = curve, goal
        way = -goal.distance(start.d, start.t)
        self.sign, self.length = float(np.sign(way)), abs(way)
        self.step = self.length / (steps or LOAD_STEPS)
        self.start = curve.first_point(start, 1.0, self._unit)
        # give load factor and displacements equal weight at the start
        curve.metric.load = curve.metric.dot((self.start.z, 0.0), (self.start.z, 0.0)) / self.start.rate**2

    def _unit(self, d: Array, by_load: Array) -> float:
        gradient, by_t = self.goal.probe.derivatives(d)
        slope = float(gradient @ by_load) + by_t
        if slope == 0.0:
            until = self.goal.until
            raise ComputationError(f"{until.probe} {until.quantity} does not change with the load factor, so it cannot "
                                   "be controlled", advice="another quantity, or method: arc_length")
        return self.sign / slope

    def control(self, a: PathPoint, h: float) -> Control:
        """Return the equation for the probe's value a step of h from a, with the final value exact."""
        rest = self.length - a.s - h
        rest = rest if rest > END * self.length else 0.0
        return ProbeControl(self.goal.probe, self.goal.until.reaches - self.sign * rest)

    def scale(self, a: PathPoint) -> Scale:
        """Return the function that scales a tangent to one unit of the probe's quantity."""
        return self._unit

    def first(self) -> float:
        """Return the largest step."""
        return self.step

    def largest(self, a: PathPoint) -> float:
        """Return the regular step, or the remaining way if that is shorter."""
        return min(self.step, self.length - a.s)

    def ends(self, a: PathPoint) -> bool:
        """Return whether the value is reached."""
        return self.length - a.s <= END * self.length

    def renew(self, a: PathPoint) -> float:
        """Keep the unit, which is that of the probe's quantity."""
        return 1.0


# distance of the first point of a branch from the path, as a share of the extent, and the shortest one tried
FAR, NEAREST = 0.01, 1e-5
INVERSE_ITERATIONS = 30
# if the first point lies this many times farther along the path than along the mode, it is on the path itself
ALONG = 100.0


class _AtAmplitude:
    """phi . W (z - z0) = amplitude: a given amplitude of the mode at any load."""

    def __init__(self, curve: Curve, start: PathPoint, mode: Array, amplitude: float) -> None:
        self.gradient, self.free = curve.metric.weights * mode, curve.model.numbering.free
        self.gradient /= float(self.gradient @ mode)
        self.z0, self.amplitude = start.d[self.free], amplitude

    def evaluate(self, d: Array, t: float) -> tuple[float, Array, float]:
        """Return the constraint and its derivatives."""
        return float(self.gradient @ (d[self.free] - self.z0)) - self.amplitude, self.gradient, 0.0


@dataclass(frozen=True)
class Branch:
    """The first point of a branch, and the load factor of the bifurcation."""

    point: PathPoint
    factor: float


def leave(curve: Curve, a: PathPoint, b: PathPoint, direction: float,
          scale: Callable[[PathPoint], Callable[[Array, Array], float]]) -> Branch:
    """Return the first point of the branch between two points, on the side of the mode given by ``direction``.

    ``scale(point)`` returns a function that scales a tangent to one unit of the path's parameter, in the direction of
    the point's tangent. Raises ComputationError if no branch is found.
    """
    soft_a, mode = _softest(curve, a)
    soft_b, _ = _softest(curve, b)
    x = soft_a / (soft_a - soft_b) if soft_a * soft_b < 0 else 0.5
    factor = a.t + x * (b.t - a.t)
    mode *= direction
    along = replace(a, z=mode, rate=0.0)
    amplitude, trouble = FAR * curve.model.extent, None
    while amplitude >= NEAREST * curve.model.extent:
        guess = curve.model.displacements(a.d[curve.model.numbering.free] + amplitude * mode, factor)
        try:
            found = curve.correct(_AtAmplitude(curve, a, mode, amplitude), guess, factor)
            went = found.d[curve.model.numbering.free] - a.d[curve.model.numbering.free]
            if curve.system.norm(went - amplitude * mode) > ALONG * amplitude:
                raise ComputationError("the branch is lost", at={"factor": factor})
            s = a.s + curve.metric.norm((went, found.t - a.t))
            return Branch(curve.point(found, s, scale(along)), factor)
        except ComputationError as error:
            trouble, amplitude = error, 0.25 * amplitude
    raise ComputationError(f"no branch that leaves the path was found at load factor {factor:.6g}",
                           at={"factor": float(f"{factor:.6g}")},
                           advice="a small load with its own amplitude as an imperfection") from trouble


def _softest(curve: Curve, point: PathPoint) -> tuple[float, Array]:
    """Return the eigenvalue of K closest to zero at a point, and its mode (n_unknowns,) with largest displacement 1.

    By inverse iteration in the metric of the path.
    """
    system = curve.system
    system.assemble(point.d, point.t)
    system.factor({"factor": float(f"{point.t:.6g}")})
    W = curve.metric.weights
    v, value = W**0.5 * np.random.default_rng(0).standard_normal(len(W)), 0.0
    for _ in range(INVERSE_ITERATIONS):
        w = system.matrix.solve(W * v)
        value = float(v @ (W * v)) / float(v @ (W * w))
        v = w / np.sqrt(float(w @ (W * w)))
    places = _places(curve)
    size = system.weights * v * places
    if not size.any():
        size = system.weights * v
    largest = int(np.argmax(np.abs(size) > 0.999 * np.abs(size).max()))
    return value, v / (np.sign(size[largest]) * system.norm(v))


def _places(curve: Curve) -> Array:
    """Return 1 for unknowns that are positions, 0 for others (n_unknowns,)."""
    model = curve.model
    full = np.zeros(len(model.numbering.place))
    for mesh in model.meshes.values():
        full[mesh.first_dof:mesh.first_dof + mesh.n_dofs] = mesh.kinds <= 1
    return full[model.numbering.free]
