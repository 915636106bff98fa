"""Small vibrations in a steadily turning frame: M q'' + 2 omega G q' + (K_t - omega^2 M) q = 0."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..case import Eigen
from ..elements.shape import Array
from ..errors import ComputationError
from ..model.masses import mass_terms
from ..model.mesh import mass_matrix
from ..model.model import Model
from .classify import Classifier
from .eigen import full_shapes, renumber, table
from .linearised import base_state
from .matrix_pencil import Pencil
from .state import State

# below this number of unknowns every pair is computed at once
DENSE = 300
# a real part within this share of the pair's size is round-off
IMAGINARY = 1e-7
# pairs beyond those asked for, so that the last ones have come to rest
EXTRA = 6


@dataclass
class Pairs:
    """Eigenvalues s (m,) [1/s] with Im s > 0 (or real and positive), lowest first, and their complex vectors."""

    s: NDArray[np.complex128]
    vectors: NDArray[np.complex128]

    def frequency(self, k: int) -> tuple[float, float]:
        """Return (omega, growth rate) of pair k: a pair that grows has no frequency."""
        s = self.s[k]
        if abs(s.real) <= IMAGINARY * abs(s):
            return float(s.imag), 0.0
        return 0.0, float(abs(s.real))

    def shape(self, k: int, pencil: Pencil) -> Array:
        """Return the real shape (n_unknowns,) of pair k at its phase of most kinetic energy, x^T M x = 1."""
        x = self.vectors[k]
        a, b, c = (float(u @ pencil.other(v)) for u, v in ((x.real, x.real), (x.imag, x.imag), (x.real, x.imag)))
        phase = 0.5 * np.arctan2(-2 * c, a - b)
        real = x.real * np.cos(phase) - x.imag * np.sin(phase)
        return real / np.sqrt(real @ pencil.other(real))


class Gyroscope:
    """2 omega G of a model, G = int rho S^T J S dV with J the quarter turn: the Coriolis forces of the frame."""

    def __init__(self, model: Model, omega: float) -> None:
        self.model, self.omega = model, omega
        self.blocks = [(mesh.dofs[mesh.cls == k], mass_matrix(c.sampler), mesh.plan.element.components)
                       for mesh in model.meshes.values() for k, c in enumerate(mesh.classes)]
        self.terms = [term for m in model.case.masses for term in mass_terms(m, model.point(m.at))
                      if len(term.columns) == 2]

    def __call__(self, z: Array) -> Array:
        """Return 2 omega T^T G T z."""
        num = self.model.numbering
        v = np.zeros(len(num.place))
        num.expand(z, v)
        return num.reduce(self.forces(v))

    def forces(self, v: Array) -> Array:
        """Return 2 omega G v (n_full,) for rates v of all coordinates."""
        out = np.zeros(len(v))
        for dofs, M, nc in self.blocks:
            turned = np.zeros(dofs.shape)
            local = v[dofs]
            turned[:, 0::nc], turned[:, 1::nc] = -local[:, 1::nc], local[:, 0::nc]
            np.add.at(out, dofs, turned @ M)
        for term in self.terms:
            (cx, wx), (cy, wy) = term.columns
            x, y = wx @ v[cx], wy @ v[cy]
            np.add.at(out, cx, -term.inertia * y * wx)
            np.add.at(out, cy, term.inertia * x * wy)
        return 2.0 * self.omega * out


def gyroscopic_pairs(pencil: Pencil, gyroscope: Gyroscope, number: int) -> Pairs:
    """Return the lowest pairs of s^2 M x + s 2 omega G x + K x = 0, by inverse iteration on [x, s x].

    (x, s x/c) = -K^-1 (c M y2 + 2 omega G y1), y1/c with c near the lowest |s|: only K is factored. Raises
    ComputationError where it is singular.
    """
    pivots = pencil.factor(0.0)
    if pivots.bad >= 0:
        raise ComputationError(
            f"the stiffness in the turning frame is singular: {pencil.system.describe(pivots.bad)} has no stiffness",
            advice="supports that hold the model in the turning frame, or another omega")
    n = pencil.n

    scale = _lowest_scale(pencil)

    def inverse(y: Array) -> Array:
        return np.concatenate([-pencil.solve(scale * pencil.other(y[n:]) + gyroscope(y[:n])), y[:n] / scale])

    if n <= DENSE:
        matrix = np.array([inverse(column) for column in np.eye(2 * n)]).T
        mu, vectors = np.linalg.eig(matrix)
    else:
        mu, vectors = _arnoldi(inverse, n, 2 * (number + EXTRA))
    keep = np.abs(mu) > 1e-14 * np.abs(mu).max()
    s, x = 1.0 / mu[keep], vectors[:n, keep].T
    # of a pair +-i omega, and of a growing and a decaying one, the first
    upper = np.where(np.abs(s.real) <= IMAGINARY * np.abs(s), s.imag > 0, (s.real > 0) & (s.imag >= 0))
    s, x = s[upper], x[upper]
    order = np.argsort(np.abs(s), kind="stable")[:number]
    return Pairs(s[order], x[order])


def _lowest_scale(pencil: Pencil) -> float:
    """Return the lowest frequency without Coriolis forces, roughly [1/s]: it makes both halves of a pair alike."""
    x = pencil.solve(pencil.other(np.sin(1.0 + np.arange(pencil.n))))
    for _ in range(4):
        Mx = pencil.other(x)
        y = pencil.solve(Mx)
        ratio = abs(float(x @ Mx) / float(y @ Mx))
        x = y / np.sqrt(abs(float(y @ pencil.other(y))))
    return float(np.sqrt(ratio))


def _arnoldi(inverse: Callable[[Array], Array], n: int, number: int) -> tuple[Array, Array]:
    """Return the largest eigenvalues of the inverse and their vectors (2 n, k), by Arnoldi's method."""
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

    operator = LinearOperator((2 * n, 2 * n), matvec=inverse, dtype=np.float64)
    try:
        return eigs(operator, k=min(number, 2 * n - 2), which="LM", v0=np.sin(1.0 + np.arange(2 * n)), tol=1e-11,
                    maxiter=400)
    except ArpackNoConvergence as found:
        if len(found.eigenvalues) < number - 2 * EXTRA:
            raise ComputationError("the modes in the turning frame did not converge",
                                   advice="fewer modes, or a coarser mesh") from found
        return found.eigenvalues, found.eigenvectors


def solve_turning(model: Model, spec: Eigen) -> Iterator[State]:
    """Yield the equilibrium in the turning frame with its lowest modes, frequencies as seen in that frame."""
    base = base_state(model, "static")
    state, model = base.state, base.model
    pencil = base.pencil().with_mass()
    assert model.case.steady_rotation is not None
    pairs = gyroscopic_pairs(pencil, Gyroscope(model, model.case.steady_rotation.omega), spec.modes)
    shapes = full_shapes(model, np.array([pairs.shape(k, pencil) for k in range(len(pairs.s))]))
    classifier = Classifier(model, state.d)
    verdicts = [classifier(v, False) for v in shapes]
    found = []
    for k, verdict in enumerate(verdicts):
        omega, growth = pairs.frequency(k)
        entry: dict[str, Any] = {"omega": omega, "hz": omega / (2 * np.pi), "kind": verdict.kind, "number": 0,
                                 "shares": verdict.shares, "gaps": verdict.gaps}
        found.append(entry | {"growth": growth} if growth > 0.0 else entry)
    renumber(found)
    state.report = {"frequencies": found}
    state.arrays = {"modes/shapes": (shapes, "1", "mode shapes in the turning frame, at the phase of most kinetic "
                                                  "energy: rows of nodal coordinates, unit modal mass")}
    state.tables = {"modes": table(found, verdicts)}
    growing = sum("growth" in e for e in found)
    if growing:
        state.warnings = [*state.warnings, f"{growing} of the modes grow: this rotation is unstable"]
    yield state
