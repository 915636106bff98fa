"""Equilibria and modes of a scene: linear, with large displacements, and small vibrations about the reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eigh, qr
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import SuperLU, splu

from .points import Array
from .scene import Scene

STEPS = 10


@dataclass
class State:
    """A solved scene: coordinates, multipliers of rows, and the axes of section forces."""

    scene: Scene
    x: Array
    multipliers: Array
    linear: bool

    def probe(self, at: str) -> dict[str, float]:
        """Return displacement, rotation and section forces at BODY@S."""
        scene, found = self.scene, self.scene.probe(at, self.x, linear=self.linear)
        if scene.bodies[at.split("@")[0]].rigid is None:
            axes = scene.x0 if self.linear else self.x
            elastic = scene.stiffness(scene.x0) @ (self.x - scene.x0) if self.linear else scene.elastic(self.x)
            found |= scene.section_forces(at, axes, elastic)
        return found


class CriticalError(Exception):
    """The path to the whole load passes a critical point, or Newton's method finds no equilibrium."""


def _bordered(K: Array, G: Array) -> SuperLU:
    """Return the factors of the matrix of equilibrium and rows; raise CriticalError if it is singular."""
    zero = np.zeros((len(G), len(G)))
    try:
        return splu(csc_matrix(np.block([[K, -G.T], [G, zero]])))
    except RuntimeError as error:
        raise CriticalError("the tangent is singular") from error


def linear(case: dict[str, Any], **options: Any) -> State:
    """Solve K u = F + G^T multipliers, G u = prescribed values, at the reference."""
    scene = Scene(case, usual="ramp", **options)
    K, G = scene.tangent(scene.x0, 0.0), scene.gradients(scene.x0)
    F = scene.forces(scene.x0, np.zeros(scene.size), 1.0) - scene.forces(scene.x0, np.zeros(scene.size), 0.0)
    found = _bordered(K, G).solve(np.concatenate([F, [row.drive(1.0)[0] for row in scene.rows]]))
    return State(scene, scene.x0 + found[:scene.size], found[scene.size:], linear=True)


def large(case: dict[str, Any], steps: int = STEPS, **options: Any) -> State:
    """Follow the equilibrium with the load by Newton's method; raise CriticalError if the path is critical."""
    scene = Scene(case, usual="ramp", **options)
    n, at_rest = scene.size, np.zeros(scene.size)
    x, force = scene.x0.copy(), np.zeros(len(scene.rows))
    before, sign = np.concatenate([x, force]), None
    size = max(np.ptp(scene.x0), 1e-300)
    for k in range(1, steps + 1):
        t, now = k / steps, np.concatenate([x, force])
        guess = now if k == 1 else 2 * now - before
        before, (x, force) = now, (guess[:n].copy(), guess[n:].copy())
        last = np.inf
        for _ in range(30):
            G = scene.gradients(x)
            residual = np.concatenate([scene.forces(x, at_rest, t) + G.T @ force, -scene.violation(x, t)])
            factors = _bordered(scene.tangent(x, t, force), G)
            change = factors.solve(residual)
            x, force = x + change[:n], force + change[n:]
            length = float(np.max(np.abs(change[:n])))
            if length < 1e-11 * size or (length < 1e-7 * size and length > 0.5 * last):
                break
            last = length
        else:
            raise CriticalError(f"no equilibrium at load factor {t:g}")
        found = _sign(factors)
        if sign is not None and found != sign:
            raise CriticalError(f"a critical point was passed before load factor {t:g}")
        sign = found
    return State(scene, x, force, linear=False)


def _sign(factors: SuperLU) -> float:
    """Return the sign of the determinant."""
    return float(np.prod(np.sign(factors.U.diagonal())) * _parity(factors.perm_r) * _parity(factors.perm_c))


def _parity(order: Array) -> float:
    left, cycles = set(range(len(order))), 0
    while left:
        k, cycles = left.pop(), cycles + 1
        while (k := int(order[k])) in left:
            left.remove(k)
    return (-1.0) ** (len(order) - cycles)


def modes(case: dict[str, Any], count: int, **options: Any) -> Array:
    """Return the lowest frequencies [rad/s] of small vibrations about the unloaded reference."""
    scene = Scene(case, usual="ramp", **options)
    G = scene.gradients(scene.x0)
    Z = qr(G.T)[0][:, len(G):]  # what no row hinders
    K, M = (Z.T @ A @ Z for A in (scene.tangent(scene.x0, 0.0), scene.M))
    # M is the smaller one of what is massless: K phi = omega^2 M phi by the inverse, whose largest are wanted
    found = eigh(M, K, eigvals_only=True, subset_by_index=(len(K) - count, len(K) - 1))[::-1]
    return 1 / np.sqrt(found)
