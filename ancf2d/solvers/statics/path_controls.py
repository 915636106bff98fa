"""Controls: the equations that select one point of an equilibrium path, and the metric of the path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...case import Probe
from ...elements.shape import Array
from ...model.model import Model
from ...model.rotation import Rotation
from ..state_results import position_of


class Control(Protocol):
    """The equation that selects one point of a path."""

    def evaluate(self, d: Array, t: float) -> tuple[float, Array, float]:
        """Return c, its gradient (n_unknowns,) by the unknowns, and its derivative by t."""
        ...


@dataclass
class Metric:
    """Length of a change of state: root mean square displacement, with weight ``load`` [m^2] for the factor squared.

    ``weights`` (n_unknowns,) [m^2 per unit squared] are zero for multipliers.
    """

    weights: Array
    load: float

    def dot(self, a: tuple[Array, float], b: tuple[Array, float]) -> float:
        """Return the scalar product of two changes (of unknowns, of the load factor)."""
        return float((self.weights * a[0]) @ b[0] + self.load * a[1] * b[1])

    def norm(self, a: tuple[Array, float]) -> float:
        """Return the length of a change."""
        return float(np.sqrt(self.dot(a, a)))


class ArcLength:
    """|z - z0|^2 + psi^2 (t - t0)^2 = ds^2: the spherical constraint of Crisfield (1981), linearised each time."""

    def __init__(self, model: Model, metric: Metric, d: Array, t: float, ds: float) -> None:
        self.metric, self.free, self.ds = metric, model.numbering.free, ds
        self.z0, self.t0 = d[self.free], t

    def evaluate(self, d: Array, t: float) -> tuple[float, Array, float]:
        """Return the constraint divided by ds, and its derivatives."""
        dz, dt = d[self.free] - self.z0, t - self.t0
        c = (self.metric.dot((dz, dt), (dz, dt)) - self.ds**2) / self.ds
        return c, 2 / self.ds * self.metric.weights * dz, 2 / self.ds * self.metric.load * dt


@dataclass
class FactorControl:
    """t = value: Newton's method at a load factor."""

    value: float
    n: int

    def evaluate(self, d: Array, t: float) -> tuple[float, Array, float]:
        """Return the constraint and its derivatives."""
        return t - self.value, np.zeros(self.n), 1.0


class ProbeValue:
    """A quantity of a probe (x, y, ux, uy or theta) and its derivatives; rotations count full turns."""

    def __init__(self, model: Model, probe: Probe, quantity: str) -> None:
        self.model, self.quantity = model, quantity
        self.point = model.point(probe.at, probe.y)
        self.rotation = Rotation(self.point)
        self.motion = model.displacements(np.zeros(model.numbering.n_unknowns), 1.0)
        self.motion -= model.displacements(np.zeros(model.numbering.n_unknowns), 0.0)
        self.theta = 0.0

    def settle(self, d: Array, turned: Array) -> None:
        """Count the probe's full turns from an equilibrium d with turns ``turned`` (``model.rotation.Turns``)."""
        n = self.model.n_q
        self.theta = self.model.turns.theta(self.rotation, self.model.e0 + d[:n], d[:n], turned)

    def _theta(self, d: Array) -> float:
        n = self.model.n_q
        return self.rotation.value(self.model.e0 + d[:n], d[:n], self.theta)

    def value(self, d: Array) -> float:
        """Return the quantity at a state (n_full,)."""
        theta = self._theta(d)
        if self.quantity == "theta":
            return theta
        reference, u = position_of(self.point, self.model.e0, d[:self.model.n_q], theta, False)
        k = "xy".index(self.quantity[-1])
        return float(u[k] if self.quantity[0] == "u" else reference[k] + u[k])

    def derivatives(self, d: Array) -> tuple[Array, float]:
        """Return the gradient (n_unknowns,) by the unknowns and the derivative by t."""
        full, e = np.zeros(len(d)), self.model.e0 + d[:self.model.n_q]
        p = self.point
        if self.quantity == "theta":
            np.add.at(full, self.rotation.dofs, self.rotation.gradient(e))
        else:
            k = "xy".index(self.quantity[-1])
            coords, weights = p.carrier.position()[k]
            np.add.at(full, coords, weights)
            if p.offset:
                angle = p.angle + self._theta(d)
                arm = -p.offset * (np.cos(angle), np.sin(angle))[k]
                np.add.at(full, self.rotation.dofs, arm * self.rotation.gradient(e))
        return self.model.numbering.reduce(full), float(full @ self.motion)


@dataclass
class ProbeControl:
    """value(probe) = target: displacement control (Batoz & Dhatt 1979)."""

    probe: ProbeValue
    target: float

    def evaluate(self, d: Array, t: float) -> tuple[float, Array, float]:
        """Return the constraint and its derivatives."""
        return self.probe.value(d) - self.target, *self.probe.derivatives(d)
