"""Motions of a scene: reduction to index one, steps by DOP853, and a projection onto the constraints after each.

M x'' = F + G^T multipliers with G x'' = drive'' - (G v)_x v gives accelerations (Hairer & Wanner, Solving ODEs II,
VII.1); what remains of rows and their rates after a step is taken away in the metric of M (the same, VII.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import DOP853
from scipy.linalg import block_diag

from .amplitudes import course
from .points import TINY, Array
from .scene import Scene
from .statics import large


@dataclass
class Motion:
    """A motion at ``times``: coordinates and rates, and at its end the multipliers of rows."""

    scene: Scene
    times: Array
    x: list[Array]
    v: list[Array]
    multipliers: Array

    def course(self, at: str) -> dict[str, Array]:
        """Return displacements and rotation of BODY@S, and their rates, over time."""
        found = [self.scene.probe(at, x, v) for x, v in zip(self.x, self.v, strict=True)]
        return {k: np.array([f[k] for f in found]) for k in found[0]}

    def energies(self) -> dict[str, float]:
        """Return strain and kinetic energy at the end."""
        return self.scene.energies(self.x[-1], self.v[-1])

    def momenta(self) -> Array:
        """Return linear momentum and that about the origin (3,) at the end, by virtual rigid motions of M v."""
        scene, x = self.scene, self.x[-1]
        motions = np.zeros((3, scene.size))
        for first, n in scene.sections:
            a, b, turn = (slice(first + k * n, first + (k + 1) * n) for k in range(3))
            motions[0, a] = motions[1, b] = motions[2, turn] = 1
            motions[2, a], motions[2, b] = -x[b], x[a]
        return motions @ scene.M @ self.v[-1]


class Mover:
    """The integrator of a scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.n = scene, scene.size
        self.W = block_diag(*(np.linalg.inv(block) for block in scene.blocks))

    def gradients(self, x: Array, v: Array) -> tuple[Array, Array]:
        """Return G at x, and (G v)_x v, which is due to rotating coordinates."""
        G, bend = self.scene.gradients(x), np.zeros(len(self.scene.rows))
        z = x + 1j * TINY * v
        for k in self.scene.curved:
            row = self.scene.rows[k]
            bend[k] = row.gradient(z).imag @ v[row.index] / TINY
        return G, bend

    def drives(self, t: float) -> Array:
        """Return values, rates and accelerations (3, rows) of prescribed motions."""
        return np.array([row.drive(t) for row in self.scene.rows]).T

    def accelerations(self, x: Array, v: Array, t: float) -> tuple[Array, Array]:
        """Return x'' and the multipliers."""
        G, bend = self.gradients(x, v)
        F, WG = self.scene.forces(x, v, t), self.W @ G.T
        multipliers = np.linalg.solve(G @ WG, self.drives(t)[2] - bend - WG.T @ F)
        return self.W @ F + WG @ multipliers, multipliers

    def put_back(self, x: Array, v: Array, t: float) -> tuple[Array, Array]:
        """Return the nearest coordinates and rates, in the metric of M, that rows allow."""
        for _ in range(3):
            G, _ = self.gradients(x, v)
            WG = self.W @ G.T
            x = x - WG @ np.linalg.solve(G @ WG, self.scene.violation(x, t))
        G, _ = self.gradients(x, v)
        WG = self.W @ G.T
        return x, v - WG @ np.linalg.solve(G @ WG, G @ v - self.drives(t)[1])

    def rates(self, t: float, y: Array) -> Array:
        """Return dy/dt of y = (x, v)."""
        x, v = y[:self.n], y[self.n:]
        return np.concatenate([v, self.accelerations(x, v, t)[0]])


def velocities(scene: Scene) -> Array:
    """Return the initial rates of a case, before projection onto the rows."""
    v, initial = np.zeros(scene.size), scene.case.get("initial", {})
    for name, body in scene.bodies.items():
        own = initial.get("bodies", {}).get(name, initial)
        turn = own.get("rotation_rate", {"omega": 0.0})
        omega, about = turn["omega"], np.array(turn.get("about", [0.0, 0.0]), float)
        spans = [(body.rigid, 1)] if body.rigid is not None else [
            (scene.bars[k][1], scene.bars[k][0].n) for _, _, k in body.pieces]
        for first, n in spans:
            x, y = (scene.x0[first + j * n:first + (j + 1) * n] for j in range(2))
            given = own.get("velocity", [0.0, 0.0])
            v[first:first + n] = given[0] - omega * (y - about[1])
            v[first + n:first + 2 * n] = given[1] + omega * (x - about[0])
            v[first + 2 * n:first + 3 * n] = omega
    for point, first in scene.masses:
        rate = v[point.index]
        v[first:first + 3] = [*(point.pull(scene.x0, n) @ rate for n in np.eye(2)), rate[2]]
    return v


def _begun(case: dict[str, Any]) -> dict[str, Any]:
    """Return the case of statics with the loads at t = 0."""
    loads = []
    for load in case.get("loads", []):
        now = course(load.get("amplitude"), "constant")(0.0)[0]
        loads.append({**{k: v for k, v in load.items() if k != "amplitude"},
                      "value": (now * np.array(load["value"])).tolist()})
    return {**case, "loads": loads}


def move(case: dict[str, Any], times: Array, rtol: float = 1e-11, **options: Any) -> Motion:
    """Return the motion of a case at ``times``, the first of which is 0."""
    scene = Scene(case, **options)
    mover, n = Mover(scene), scene.size
    still = case.get("initial", {}).get("from") == "static"
    x, v = mover.put_back(large(_begun(case), **options).x if still else scene.x0, velocities(scene), 0.0)
    xs, vs, step = [x], [v], None
    for a, b in pairwise(times):
        solver = DOP853(mover.rates, a, np.concatenate([x, v]), b, rtol=rtol, atol=0.1 * rtol,
                        first_step=step and min(step, b - a))
        while solver.status == "running":
            solver.step()
            if solver.status == "failed":
                raise ArithmeticError(f"the steps vanish at t = {solver.t:g}")
            step = solver.h_abs
            x, v = mover.put_back(solver.y[:n], solver.y[n:], solver.t)
            solver.y = np.concatenate([x, v])
            solver.f = mover.rates(solver.t, solver.y)
        xs.append(x)
        vs.append(v)
    return Motion(scene, times, xs, vs, mover.accelerations(x, v, float(times[-1]))[1])
