"""Load factors at which small motions begin to grow: flutter and divergence under loads without a potential."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...elements.shape import Array
from ...errors import ComputationError
from .changes import Change
from .linearised import Linearised
from .lowest_modes import Pencil, characteristic, lowest, soft_shift
from .projected import (
    Complex,
    Quadratic,
    Space,
    projected_pairs,
    projected_values,
    symmetric_modes,
    undamped_values,
    within_constraints,
)
from .quadratic import AT_REST, Search, shift_of
from .relaxing import Term, corrected, system_matrix, terms_of, with_dashpots

# additional pairs that are followed
EXTRA = 6
# steps of the load factor: shares of the smallest factor that can matter, and of the factor itself
FIRST, STEP = 0.1, 0.03
# end of the search, relative to the smallest factor that can matter, and to the first critical one
LAST, BEYOND = 100.0, 4.0
# growth relative to |s| that counts as zero: from a double eigenvalue it rises like a square root without damping,
# linearly with damping
UNDAMPED, DAMPED = 1e-5, 1e-9
# relative change of a critical factor at which it is accepted, and the largest number of spaces for it
SETTLED, MAX_SPACES = 1e-8, 4
# relative width of the brackets of critical factors, and where the search continues after one
ROUND, PAST = 1e-10, 1e-6
# imaginary part relative to |s| of pairs that only relax (close rates form pairs); negligible share of load effects
RELAXES, NEGLIGIBLE = 1e-2, 1e-6
# number of modes without loads in which eigenvalues are followed: per followed pair, and in addition
FOLLOWED, MORE = 3, 10
# points between two factors at which eigenvalues are predicted, and the closest distance of a new factor to the ends
GUESSES, INSIDE = 65, 1e-3
# share of the squared distance of two eigenvalues below which they are close between two factors, and relative error of
# the prediction that requires a halving; largest number of such halvings, and of samples between two factors
CLOSE, MISSED, HALVINGS, MOST_GUESSES = 0.1, 0.3, 3, 40
# points of the root locus; a shift this many times the size of elastic eigenvalues may hide the lowest motions
POINTS, HIDES = 80, 1e3


@dataclass(frozen=True)
class Critical:
    """A critical factor with its kind, frequency [rad/s] and complex vector (n_unknowns,)."""

    factor: float
    kind: str
    omega: float
    vector: Complex


@dataclass(frozen=True)
class Stability:
    """Critical factors, lowest first; ``last``: the factor up to which all were searched; columns of the root locus.

    ``doubtful``: factors from which motions seem to grow in the lowest modes, but not in the whole space. ``error``:
    relative error that round-off may cause in the lowest frequencies without loads.
    """

    critical: list[Critical]
    doubtful: list[float]
    last: float
    locus: dict[str, list[float]]
    error: float = 0.0


def critical_factors(small: Linearised, change: Change, modes: int) -> Stability:
    """Return the lowest factors mu at which a solution s of (K + dK + s (C + dC) + s^2 M) x = 0 begins to grow.

    ``change`` gives dK and dC over mu. The eigenvalues are followed over the factor in a space of few vectors. Near
    each critical factor, the space is extended by a Krylov space there, until the factor no longer changes. Relaxing
    materials add their dashpots, and for each critical factor the vector of the motion with the complex modulus.
    """
    track = _Track(small, change, modes)
    found: list[Critical] = []
    doubtful: list[float] = []
    low = track.start(0.0)
    while len(found) < modes:
        high = track.sample(low.factor + max(FIRST * track.smallest, STEP * low.factor))
        if high.factor > (BEYOND * found[0].factor if found else LAST * track.smallest):
            break
        bracket = track.first_growth(low, high)
        if bracket is None:
            low = high
            continue
        critical = track.refined(low, *bracket)
        if critical is None:
            # in the better space nothing grows there
            doubtful.append(bracket[1])
            low = track.sample(bracket[1])
        else:
            found.append(critical)
            low = track.start(critical.factor * (1 + PAST))
    end = 1.5 * max((c.factor for c in found), default=low.factor)
    return Stability(found, doubtful, low.factor, track.locus(np.linspace(0.0, end, POINTS)), track.error)


@dataclass(frozen=True)
class _Sample:
    """The eigenvalues s (m,) of lowest |s| at a load factor, by Im s >= 0, their rates, and how many grow."""

    factor: float
    s: Complex
    rate: Complex
    grows: int


class _Track:
    """The eigenvalues of lowest |s| over the load factor, in a space of few vectors."""

    def __init__(self, small: Linearised, change: Change, modes: int) -> None:
        self.small, self.change, self.pairs = small, change, modes + EXTRA
        self.limit = DAMPED if small.rates.damps or change.damps or small.relaxing else UNDAMPED
        pencil = small.pencil_with_mass()
        shift, size = soft_shift(pencil), characteristic(pencil)
        self.first_shift, self.rest_limit = math.sqrt(shift), AT_REST * math.sqrt(size)
        problem, self.terms = self._problem(0.0), list[Term]()
        self.space = Space(problem, within_constraints(problem))
        self.error = self._add_modes(pencil) if shift > HIDES * size else 0.0
        self._project(0.0)
        # relaxation rates do not count as vibrations
        s = np.abs(self._values(0.0, relaxes=False))
        self.lowest = float(s[s > self.rest_limit].min(initial=np.inf))
        if not math.isfinite(self.lowest):
            raise ComputationError("nothing vibrates", advice="bodies with a density and a stiffness")
        stiffer = math.sqrt(1.0 + max((sum(g for g, _ in one.terms) for one in small.relaxing), default=0.0))
        self.radius = float(np.sort(s)[min(2 * self.pairs, len(s)) - 1]) * (1 + 1e-6) * stiffer
        self.smallest = self._smallest()

    def _add_modes(self, pencil: Pencil) -> float:
        """Add the lowest modes without loads, which a far larger shift misses; return their relative error."""
        modes, problem = lowest(pencil, self.pairs), self.space.problem
        for x in modes.vectors:
            self.space.add(np.where(problem.is_coordinate, x, 0.0))
        return float(0.5 * modes.error[np.abs(modes.values) > modes.floor].max(initial=0.0))

    def _problem(self, factor: float, relaxes: bool = False, rigid_dashpots: bool = False) -> Quadratic:
        """Return the problem at a load factor, with the complex modulus, or with ``rigid_dashpots``."""
        load, gyration = self.change.stiffness(factor), self.change.gyration
        for one in self.small.relaxing if rigid_dashpots else ():
            springs = sum(g for g, _ in one.terms) * one.V
            load = springs if load is None else load + springs
        return Quadratic(self.small, load=load, rates=None if gyration is None else factor * gyration, relaxes=relaxes)

    def _project(self, factor: float) -> None:
        """Add a Krylov space at a load factor to the space, or all motions if they are few."""
        for rigid_dashpots in (True, False) if self.small.relaxing else (False,):
            problem = self._problem(factor, rigid_dashpots=rigid_dashpots)
            search = Search(problem, shift_of(problem, self.first_shift), self.rest_limit)
            search.fill(self.pairs)
            for x in search.space.V:
                self.space.add(x)
        self.shift = search.s0
        if self.terms and factor > 0.0:
            s, x = self._growing_motion(factor)
            x = corrected(self._problem(factor, relaxes=True), s, x)[1]
            self.space.add(np.ascontiguousarray(x.real))
            self.space.add(np.ascontiguousarray(x.imag))
        self.space.diagonalise()
        V = self.space.V
        self.matrices = self.space.project()
        self.strained = [V @ np.array([one.stiffness(x) for x in V]).T for one in self.small.relaxing]
        self.terms = self._terms(np.eye(len(V)))
        change = self.change
        self.changes = np.array([np.zeros((len(V), len(V))) if A is None else V @ (A @ V.T)
                                 for A in (change.rate, change.square, change.gyration)])
        self._choose_modes()

    def _terms(self, T: Array) -> list[Term]:
        """Return the Maxwell terms of all materials in combinations T (k, m) of the space."""
        materials = zip(self.small.relaxing, self.strained, strict=True)
        return [term for k, (one, V) in enumerate(materials) for term in terms_of(k, one.terms, T.T @ V @ T)]

    def _growing_motion(self, factor: float) -> tuple[complex, Complex]:
        """Return the eigenvalue and the vector (n,) of the motion that has just started to grow at a factor."""
        s, Y = projected_pairs(self._matrices(factor), self.shift)
        grows = np.flatnonzero(self._grows(s))
        # at the very onset, round-off may make no motion grow
        most = np.where((s.imag >= 0) & (np.abs(s) <= self.radius), self._growth(s), -np.inf)
        slowest = grows[np.argmin(s[grows].real)] if len(grows) else np.argmax(most)
        return complex(s[slowest]), self.space.combined(Y[slowest, :self.matrices.shape[1]])

    def _choose_modes(self) -> None:
        """Choose the lowest modes without loads (k, r), of unit modal mass, in which eigenvalues are followed.

        The static response of the other modes to the loads' action on the lowest ones is added: bending stretches a
        bent beam.
        """
        K, C, M = self.matrices
        self.values, T = symmetric_modes(0.5 * (K + K.T), 0.5 * (M + M.T), self.shift**2)
        self.followed = min(FOLLOWED * self.pairs + MORE, T.shape[1])
        low, high = T[:, :self.followed], T[:, self.followed:]
        stiff = np.abs(self.values[self.followed:, None]) + self.shift**2
        given = np.hstack([high.T @ A @ low[:, :self.pairs] / stiff for A in self.changes[:2]])
        # the most important directions of this response, as many as are not negligible
        Q, sizes, _ = np.linalg.svd(given, full_matrices=False)
        self.modes = np.hstack([low, high @ Q[:, sizes > NEGLIGIBLE * sizes.max(initial=0.0)]])
        self.small_K, self.small_C = (self.modes.T @ A @ self.modes for A in (K, C))
        self.small_changes = np.array([self.modes.T @ A @ self.modes for A in self.changes])
        self.small_terms = self._terms(self.modes)
        self.undamped = not C.any() and not self.changes[2].any()

    def _matrices(self, factor: float, relaxes: bool = True) -> Array:
        """Return K, C and M in the space at a load factor, with the dashpots of relaxing materials appended."""
        (K, C, M), (rate, square, gyration) = self.matrices, self.changes
        found = np.array([K + factor * (rate + factor * square), C + factor * gyration, M])
        return with_dashpots(found, self.terms) if self.terms and relaxes else found

    def _values(self, factor: float, relaxes: bool = True) -> Complex:
        """Return all eigenvalues in the space, by |s|."""
        matrices, undamped = self._matrices(factor, relaxes), self.undamped and not (self.terms and relaxes)
        s = undamped_values(matrices, self.shift) if undamped else projected_values(matrices, self.shift)
        return s[np.argsort(np.abs(s), kind="stable")]

    def sample(self, factor: float, rates: bool = True) -> _Sample:
        """Return the eigenvalues at a load factor, in the lowest modes without loads, with their ``rates`` or zeros."""
        inverse = np.linalg.pinv if rates else np.zeros_like
        rate, square, gyration = self.small_changes
        K, C = self.small_K + factor * (rate + factor * square), self.small_C + factor * gyration
        K1, r = rate + 2.0 * factor * square, len(K)
        if self.undamped and not self.terms:
            squares, Z = np.linalg.eig(-K)
            s, change = np.sqrt(squares.astype(complex)), -np.einsum("ij,jk,ki->i", inverse(Z), K1, Z)
            rate = change / np.where(s == 0.0, 1.0, 2 * s)
            s, rate = np.concatenate([s, -s]), np.concatenate([rate, -rate])
        else:
            s, Z = np.linalg.eig(system_matrix(K, C, self.small_terms))
            rate = -np.einsum("ij,ji->i", inverse(Z)[:, r:2 * r], K1 @ Z[:r] + gyration @ Z[r:2 * r])
        grows = int(self._grows(s).sum())
        # relaxation rates, which are many and close to each other, are not predicted
        some = (s.imag > RELAXES * np.abs(s) if self.terms else s.imag >= 0) & (np.abs(s) <= self.radius)
        s, rate = s[some].astype(complex), rate[some]
        order = np.lexsort((s.real, s.imag))
        return _Sample(factor, s[order], rate[order], grows)

    def start(self, factor: float) -> _Sample:
        """Return the sample at a factor, with the number of growing motions in the whole space."""
        return replace(self.sample(factor), grows=int((self._margins(factor) > 0).sum()))

    def first_growth(self, low: _Sample, high: _Sample) -> tuple[float, float] | None:
        """Return factors between which a motion begins to grow, or None if none does between two samples.

        Motions that grow only between the two samples are searched where their eigenvalues are predicted to grow.
        """
        left, count = [(low, high, 0)], 0
        while left:
            a, b, depth = left.pop()
            if b.grows > a.grows:
                return a.factor, b.factor
            guess = self._predicted(a, b, depth < HALVINGS) if count < MOST_GUESSES else None
            if guess is not None:
                count, middle = count + 1, self.sample(guess)
                left += [(middle, b, depth + 1), (a, middle, depth + 1)]
        return None

    def _predicted(self, low: _Sample, high: _Sample, halves: bool) -> float | None:
        """Return a factor between two samples at which a motion may grow that does not grow at both, or None.

        It is the middle if ``halves`` and the prediction contradicts the samples.

        Two eigenvalues m + sqrt D and m - sqrt D that meet have a mean and a D that are smooth, unlike the eigenvalues
        themselves. Cubics through both samples and their rates predict them. The lowest eigenvalue is paired with its
        conjugate.
        """
        (m0, D0), (m1, D1) = _means(low), _means(high)
        n, h = min(m0.shape[1], m1.shape[1]), high.factor - low.factor
        if not n or h <= ROUND * high.factor:
            return None
        m0, D0, m1, D1 = (x[:, :n] for x in (m0, D0, m1, D1))
        t = np.linspace(0.0, 1.0, GUESSES)[1:-1, None]
        m, D = _hermite_cubic(m0, m1, h, t), _hermite_cubic(D0, D1, h, t)
        growth = m.real + np.abs(np.sqrt(D).real) - self.limit * np.maximum(np.abs(m), self.lowest)
        before = np.maximum(*(x[0].real + np.abs(np.sqrt(y[0]).real) for x, y in ((m0, D0), (m1, D1))))
        gap = np.minimum(np.abs(D0[0]), np.abs(D1[0]))
        grows = (growth > 0) & (before <= 0.1 * growth)
        close = (np.abs(D) < CLOSE * gap) & (gap > (self.limit * self.lowest) ** 2)
        left = np.abs(D) / np.where(gap > 0.0, gap, 1.0)
        wanted = np.where(grows, 2.0 + growth / self.lowest, np.where(close, 1.0 - left, 0.0))
        k = np.unravel_index(int(np.argmax(wanted)), wanted.shape)
        if wanted[k] > 0.0:
            return low.factor + h * float(np.clip(self._vertex(D0[:, k[1]], D1[:, k[1]], h, float(t[k[0], 0])),
                                                  INSIDE, 1.0 - INSIDE))
        missed = np.abs(D1[0] - D0[0] - 0.5 * h * (D0[1] + D1[1])) > MISSED * np.maximum(np.abs(D0[0]), np.abs(D1[0]))
        return 0.5 * (low.factor + high.factor) if halves and missed.any() else None

    @staticmethod
    def _vertex(D0: Complex, D1: Complex, h: float, t: float) -> float:
        """Return the point between two samples near t where Re D is largest."""
        for width in 0.02 ** np.arange(1, 5):
            near = np.clip(t + width * np.linspace(-1.0, 1.0, 101), 0.0, 1.0)
            t = float(near[np.argmax(_hermite_cubic(D0[:, None], D1[:, None], h, near[:, None])[:, 0].real)])
        return t

    def _growth(self, s: Complex) -> Array:
        """Return the growth of eigenvalues beyond round-off."""
        return np.asarray(s.real - self.limit * np.maximum(np.abs(s), self.lowest))

    def _grows(self, s: Complex) -> NDArray[np.bool_]:
        """Return which eigenvalues grow, one of each pair."""
        return (self._growth(s) > 0) & (s.imag >= 0) & (np.abs(s) <= self.radius)

    def _smallest(self) -> float:
        """Return the factor at which its effect can equal the stiffness in some combination of the modes."""
        some = (self.values > self.rest_limit**2) & (self.values <= self.radius**2)
        some = some[:self.followed]
        phi = self.modes[:, :len(some)][:, some] / np.sqrt(self.values[:len(some)][some])
        sizes = [float(np.linalg.norm(phi.T @ A @ phi, 2)) if some.any() else 0.0 for A in self.changes[:2]]
        size = max(sizes[0], math.sqrt(sizes[1]))
        if not size > 0.0:
            raise ComputationError("the loads do not change the stiffness", at={"solver": "buckling"},
                                   advice="a load without an amplitude, which the load factor scales")
        return 1.0 / size

    def _margins(self, factor: float) -> Array:
        """Return the growth beyond round-off of motions of the whole space at a factor, largest first (< 0: stable)."""
        s = self._values(factor)
        some = s[(s.imag >= 0) & (np.abs(s) <= self.radius)]
        return np.sort(self._growth(some))[::-1]

    def refined(self, start: _Sample, low: float, high: float) -> Critical | None:
        """Return the critical factor near ``low`` and ``high``, above ``start``, or None if a better space has none."""
        last, found = math.inf, self._onset(low, high)
        for _ in range(MAX_SPACES):
            b = high if found is None else found[1]
            if found is not None and abs(b - last) <= SETTLED * b:
                break
            last = b
            self._project(b)
            # the better space may have shifted it a little
            width, bracket = 0.02 * b, None
            while bracket is None and width <= b:
                bracket = self.first_growth(self.start(max(start.factor, b - width)), self.sample(b + width))
                width *= 2
            if bracket is None:
                return None
            found, high = self._onset(*bracket), bracket[1]
        if found is None:
            return None
        a, b = found
        s, x = self._growing_motion(b)
        flutters = s.imag > 1e-3 * self.lowest
        return Critical(0.5 * (a + b), "flutter" if flutters else "divergence", s.imag if flutters else 0.0, x)

    def _onset(self, low: float, high: float) -> tuple[float, float] | None:
        """Return neighbouring factors between which one more motion of the whole space begins to grow.

        Return None if the modes in which eigenvalues are followed are wrong, and nothing more grows at ``high``.
        """
        known, tried = int((self._margins(low) > 0).sum()), dict[float, float]()

        def margin(factor: float) -> float:
            found = self._margins(factor)
            tried[factor] = float(found[known]) if len(found) > known else -self.radius
            return tried[factor]
        if margin(low) > 0.0 or margin(high) <= 0.0:
            return None
        from scipy.optimize import brentq

        brentq(margin, low, high, xtol=0.5 * ROUND * high, rtol=1e-15)
        return max(f for f, m in tried.items() if m <= 0.0), min(f for f, m in tried.items() if m > 0.0)

    def locus(self, factors: Array) -> dict[str, list[float]]:
        """Return the eigenvalues of lowest |s| over the factors as columns."""
        out: dict[str, list[float]] = {"factor": [], "growth": [], "omega": []}
        for factor in factors:
            s = self.sample(float(factor), rates=False).s
            out["factor"] += [float(factor)] * len(s)
            out["growth"] += s.real.tolist()
            out["omega"] += s.imag.tolist()
        return out


def _means(sample: _Sample) -> tuple[Complex, Complex]:
    """Return the mean m and D of neighbouring eigenvalues m + sqrt D, m - sqrt D, with their rates (2, pairs)."""
    if not len(sample.s):
        return np.zeros((2, 0), dtype=complex), np.zeros((2, 0), dtype=complex)
    s = np.concatenate([sample.s[:1].conj(), sample.s])
    rate = np.concatenate([sample.rate[:1].conj(), sample.rate])
    half, change = 0.5 * np.diff(s), 0.5 * np.diff(rate)
    return np.array([0.5 * (s[1:] + s[:-1]), 0.5 * (rate[1:] + rate[:-1])]), np.array([half**2, 2 * half * change])


def _hermite_cubic(low: Complex, high: Complex, h: float, t: Array) -> Complex:
    """Return the cubic through values and rates (2, k) at 0 and h, at shares t (m, 1) of h."""
    a, b = t * t * (3 - 2 * t), t * (1 - t)
    return np.asarray((1 - a) * low[0] + a * high[0] + h * b * ((1 - t) * low[1] - t * high[1]))
