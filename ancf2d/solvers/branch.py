"""Leaving a path at a bifurcation: the mode that becomes soft there, and the first point of the branch along it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..elements.shape import Array
from ..errors import ComputationError
from .continuation import Curve, PathPoint

# how far the first point of a branch is from the path, as a share of the extent, and the nearest one that is tried
FAR, NEAREST = 0.01, 1e-5
INVERSE_ITERATIONS = 30
# a branch whose first point goes along the path by this many times what it goes along the mode is the path itself
ALONG = 100.0


class _AtAmplitude:
    """phi . W (z - z0) = amplitude: a share of the mode, whatever the load."""

    def __init__(self, curve: Curve, start: PathPoint, mode: Array, amplitude: float) -> None:
        self.gradient, self.free = curve.metric.weights * mode, curve.model.numbering.free
        self.gradient /= float(self.gradient @ mode)
        self.z0, self.amplitude = start.d[self.free], amplitude

    def evaluate(self, d: Array, t: float) -> tuple[float, Array, float]:
        """Return the constraint and its derivatives."""
        return float(self.gradient @ (d[self.free] - self.z0)) - self.amplitude, self.gradient, 0.0


@dataclass(frozen=True)
class Branch:
    """The first point of a branch, and the load factor at which it leaves the path."""

    point: PathPoint
    factor: float


def leave(curve: Curve, a: PathPoint, b: PathPoint, direction: float,
          scale: Callable[[PathPoint], Callable[[Array, Array], float]]) -> Branch:
    """Return where the branch between two points of a path begins, on the side of the mode that ``direction`` tells.

    ``scale(point)`` makes a tangent a unit of the path's parameter on the side of a point's own. Raises
    ComputationError where no branch is found.
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
    raise ComputationError(f"no branch was found that leaves the path at load factor {factor:.6g}",
                           at={"factor": float(f"{factor:.6g}")},
                           advice="a small load with an amplitude of its own, which leads onto a branch") from trouble


def _softest(curve: Curve, point: PathPoint) -> tuple[float, Array]:
    """Return the eigenvalue of K next to zero at a point, and its mode (n_unknowns,), whose largest displacement is 1.

    By inverse iteration with the metric of the path.
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
    """Return 1 for unknowns that are positions, else 0 (n_unknowns,)."""
    model = curve.model
    full = np.zeros(len(model.numbering.place))
    for mesh in model.meshes.values():
        full[mesh.first_dof:mesh.first_dof + mesh.n_dofs] = mesh.kinds <= 1
    return full[model.numbering.free]
