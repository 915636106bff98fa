"""The largest difference that round-off alone can cause between two answers to the same scene.

A backward stable solution of n equations whose matrix, its rows and columns brought to one size, has the condition
number kappa is wrong by about n kappa u, u = 2^-53 (Higham, Accuracy and Stability of Numerical Algorithms, ch. 7
and 9), and by kappa times what its entries are wrong by: sums over quadrature points of products of a dozen numbers,
some hundred roundings. With large displacements what is rounded is the position of points, which is larger than their
displacement.
"""

from __future__ import annotations

import numpy as np

from ancf2d.model.model import Model
from ancf2d.solvers.system import System

from .shapes import Array

UNIT_ROUNDOFF = 2.0**-53
# sweeps that bring rows and columns to one size
SWEEPS = 8
# roundings in an entry of a matrix
ROUNDINGS = 100


def tangent(model: Model, d: Array, t: float) -> Array:
    """Return the symmetric part of the tangent stiffness (n, n) of the unknowns of a model, loads aside."""
    system, num = System(model), model.numbering
    out = np.zeros((num.n_unknowns, num.n_unknowns))
    for k, unit in enumerate(np.eye(num.n_unknowns)):
        full = np.zeros(len(num.place))
        num.expand(unit, full)
        out[k] = num.reduce(system.action(d, full, t))
    return 0.5 * (out + out.T)


def condition(K: Array) -> float:
    """Return the condition number of a symmetric matrix, scaled by a few sweeps."""
    A = np.array(K)
    for _ in range(SWEEPS):
        size = np.sqrt(np.abs(A).max(axis=1, initial=0.0))
        size[size == 0.0] = 1.0
        A /= np.outer(size, size)
    return float(np.linalg.cond(A)) if len(A) else 1.0


def uncertainty(model: Model, d: Array, t: float) -> float:
    """Return (n + ROUNDINGS) kappa u of a model at a state."""
    K = tangent(model, d, t)
    return roundings(model) * condition(K)


def roundings(model: Model) -> float:
    """Return (n + ROUNDINGS) u: the relative error of a product of stiffness and displacements."""
    return (model.numbering.n_unknowns + ROUNDINGS) * UNIT_ROUNDOFF
