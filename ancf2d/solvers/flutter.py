"""Load factors at which small motions begin to grow: flutter and divergence under loads without a potential."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..elements.shape import Array
from ..errors import ComputationError
from .linearised import Linearised
from .lowest_modes import characteristic, first_shift
from .quadratic import AT_REST, Search, shift_of
from .reduced import Complex, Quadratic, Space, projected_pairs, projected_values

if TYPE_CHECKING:
    from scipy.sparse import csc_array

# pairs that are followed beyond the factors asked for
EXTRA = 6
# steps of the load factor: shares of the smallest factor that can matter, and of the factor itself
FIRST, STEP = 0.1, 0.03
# factors beside the smallest that can matter, and beside the first critical one, at which the search ends
LAST, BEYOND = 100.0, 4.0
# growth beside |s| that is none: without damping it grows from a double eigenvalue like a root, with damping straight
UNDAMPED, DAMPED = 1e-5, 1e-9
# relative change of a critical factor that has come to rest, and most spaces for it
SETTLED, MOST = 1e-8, 4
# relative width of the brackets of critical factors
ROUND = 1e-10
# points of the root locus
POINTS = 80


@dataclass(frozen=True)
class Critical:
    """A critical factor with its kind, frequency [rad/s] and complex vector (n_unknowns,)."""

    factor: float
    kind: str
    omega: float
    vector: Complex


@dataclass(frozen=True)
class Stability:
    """Critical factors, lowest first; ``last`` is the factor up to which all were sought; columns of the root locus."""

    critical: list[Critical]
    last: float
    locus: dict[str, list[float]]


def critical_factors(small: Linearised, rate: csc_array, modes: int) -> Stability:
    """Return the lowest factors mu at which a solution s of (K + mu rate + s C + s^2 M) x = 0 begins to grow.

    The eigenvalues are followed over the factor in a space of few vectors. About each critical factor the space gets
    those of a Krylov space there, until the factor has come to rest.
    """
    track = _Track(small, rate, modes)
    found: list[Critical] = []
    low, before = 0.0, track.growing(0.0)
    while len(found) < modes:
        high = low + max(FIRST * track.smallest, STEP * low)
        if high > (BEYOND * found[0].factor if found else LAST * track.smallest):
            break
        now = track.growing(high)
        if now > before:
            critical = track.refined(low, high)
            if critical is None:
                # the better space has none of it
                before = track.growing(low)
                continue
            found.append(critical)
            high = max(high, critical.factor * (1 + 1e-6))
            now = track.growing(high)
        low, before = high, now
    end = 1.5 * max((c.factor for c in found), default=low)
    return Stability(found, low, track.locus(np.linspace(0.0, end, POINTS)))


class _Track:
    """The eigenvalues of lowest |s| over the load factor, in a space of few vectors."""

    def __init__(self, small: Linearised, rate: csc_array, modes: int) -> None:
        self.small, self.rate, self.pairs = small, rate, modes + EXTRA
        self.limit = DAMPED if small.rates.damps else UNDAMPED
        pencil = small.pencil.with_mass(small.model.e0 + small.base.state.d[:small.model.n_q])
        self.first = math.sqrt(first_shift(pencil))
        self.still = AT_REST * math.sqrt(characteristic(pencil))
        self.space = Space(self._problem(0.0))
        self._project(0.0)
        s = np.abs(self._values(0.0))
        self.lowest = float(s[s > self.still].min(initial=np.inf))
        if not math.isfinite(self.lowest):
            raise ComputationError("nothing vibrates", advice="give the bodies a density and a stiffness")
        self.radius = float(np.sort(s)[min(2 * self.pairs, len(s)) - 1]) * (1 + 1e-6)
        self.smallest = self._smallest()

    def _problem(self, factor: float) -> Quadratic:
        return Quadratic(self.small, load=factor * self.rate)

    def _project(self, factor: float) -> None:
        """Add a Krylov space at a load factor to the space, or all that can move where that is little."""
        problem = self._problem(factor)
        search = Search(problem, shift_of(problem, self.first), self.still)
        search.fill(self.pairs)
        for x in search.space.V:
            self.space.add(x)
        V = self.space.V
        self.matrices = self.space.project()
        self.rates = V @ (self.rate @ V.T)
        self.shift = search.s0

    def _matrices(self, factor: float) -> Array:
        """Return K, C and M in the space at a load factor."""
        K, C, M = self.matrices
        return np.array([K + factor * self.rates, C, M])

    def _values(self, factor: float) -> Complex:
        """Return all eigenvalues in the space, by |s|."""
        s = projected_values(self._matrices(factor), self.shift)
        return s[np.argsort(np.abs(s), kind="stable")]

    def _grows(self, s: Complex) -> NDArray[np.bool_]:
        """Return which eigenvalues grow, one of each pair."""
        return (s.real > self.limit * np.maximum(np.abs(s), self.lowest)) & (s.imag >= 0) & (np.abs(s) <= self.radius)

    def _smallest(self) -> float:
        """Return the factor at which ``rate`` can be as much as the stiffness in some combination of the modes."""
        K, _, M = self.matrices
        w, U = np.linalg.eigh(0.5 * (M + M.T))
        T = U[:, w > 1e-12 * w[-1]] / np.sqrt(w[w > 1e-12 * w[-1]])
        values, Y = np.linalg.eigh(0.5 * T.T @ (K + K.T) @ T)
        some = (values > self.still**2) & (values <= self.radius**2)
        phi = (T @ Y)[:, some] / np.sqrt(values[some])
        size = float(np.linalg.norm(phi.T @ self.rates @ phi, 2)) if some.any() else 0.0
        if not size > 0.0:
            raise ComputationError("the loads do not change the stiffness", at={"solver": "buckling"},
                                   advice="a load without an amplitude, which the load factor scales")
        return 1.0 / size

    def growing(self, factor: float) -> int:
        """Return how many motions grow at a load factor."""
        return int(self._grows(self._values(factor)).sum())

    def refined(self, low: float, high: float) -> Critical | None:
        """Return the critical factor near two others, None where a better space has none there."""
        last, known = math.inf, self.growing(low)
        for _ in range(MOST):
            a, b = bisected(lambda f: self.growing(f) > known, low, high)
            if abs(b - last) <= SETTLED * b:
                break
            last = b
            self._project(b)
            # the better space may have moved it a little
            width = 0.02 * b
            low, high = max(0.0, b - width), b + width
            while self.growing(high) <= known:
                width *= 2
                high = b + width
                if width > b:
                    return None
            while self.growing(low) > known and low > 0.0:
                width *= 2
                low = max(0.0, b - width)
        s, Y = projected_pairs(self._matrices(b), self.shift)
        grows = np.flatnonzero(self._grows(s))
        slowest = grows[np.argmin(s[grows].real)]
        omega = float(s[slowest].imag)
        flutters = omega > 1e-3 * self.lowest
        return Critical(0.5 * (a + b), "flutter" if flutters else "divergence", omega if flutters else 0.0,
                        self.space.combined(Y[slowest]))

    def locus(self, factors: Array) -> dict[str, list[float]]:
        """Return the eigenvalues of lowest |s| over the factors as columns."""
        out: dict[str, list[float]] = {"factor": [], "growth": [], "omega": []}
        for factor in factors:
            s = self._values(float(factor))
            for one in s[(s.imag >= 0) & (np.abs(s) <= self.radius)]:
                out["factor"].append(float(factor))
                out["growth"].append(float(one.real))
                out["omega"].append(float(one.imag))
        return out


def bisected(holds: Callable[[float], bool], low: float, high: float) -> tuple[float, float]:
    """Return the last of the numbers between ``low`` and ``high`` for which something does not hold, and the next."""
    while high - low > ROUND * high:
        middle = 0.5 * (low + high)
        if holds(middle):
            high = middle
        else:
            low = middle
    return low, high
