"""Eigenvalues of (K + s C + s^2 M) x = 0: a second-order Krylov space, Rayleigh-Ritz in it, and a count of all.

The space is that of the two-level orthogonal Arnoldi method about a real shift (Lu, Su & Bai 2016), so that only one
real matrix is factored and the quadratic problem is not linearised to twice its size. The eigenvalues within a circle
are counted by the argument principle, from the phase of det(K + s C + s^2 M) along it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...elements.shape import Array
from ...errors import ComputationError
from .factors import Factors, turned_on_half_circle
from .projected import Complex, Quadratic, Space, projected_pairs, within_constraints

# up to this number of unknowns, every eigenvalue is computed at once
DENSE = 40
# vectors of the space in addition to two for each wanted pair, and between two checks of the eigenvalues
BEYOND, STRIDE = 24, 8
# number of vectors at which the search ends
MAX_VECTORS = 400
# checks without change after which there are no more pairs than found; number of random starts
CALM_CHECKS, RANDOM_STARTS = 5, 3
# relative change at which eigenvalues have converged; the same if round-off limits them, which shows in changes that do
# not fall below a share of the previous ones
SETTLED, ROUGH, STALLED = 1e-8, 1e-6, 0.1
# change that is accepted if larger spaces have not reduced it a few times
STUCK = 1e-3
# residual above which a Ritz pair is rejected
TRUSTED = 1e-5
# residual above which pairs are computed again, in a small space, and how often
GOOD, IMPROVEMENTS = 1e-8, 3
# share of an eigenvalue below which its imaginary part is round-off
REAL = 1e-9
# if the first terms of a quadratic polynomial are below this share of its last one, no root lies within the circle
OUTSIDE = 0.9
# additional eigenvalues that are corrected with the wanted pairs
MARGIN = 12
# relative to elastic modes: strain energy and size of the eigenvalue of rigid motions
NOTHING, AT_REST = 1e-8, 1e-3
# the lowest |s| may be wrong if it is this many times smaller than a shift that is kept above round-off
FAR = 3e3
# a motion at rest is a new one if this share of it is independent of the others
ALIKE = 1e-3
# ratio of the shift to the lowest eigenvalue
NEAR = 0.6


@dataclass
class Pairs:
    """Eigenvalues s (k,) [1/s] with Im s >= 0, vectors (k, n_unknowns), residuals (k,), and a count of missing ones.

    ``rigid`` (k,): whether they are free rigid motions, each listed once, with s = 0. ``residual``: |Q(s0)^-1 Q(s)
    x|/|x| as displacements, Q(s) = K + s C + s^2 M, s0 the shift. ``missing``: number of other eigenvalues within the
    circle through the last pair, by the argument principle (None: unknown). ``skipped`` pairs did not converge.
    ``hidden``: whether the shift, which is kept above round-off of K, is so far above the lowest pair that it may be
    wrong.
    """

    s: Complex
    vectors: Complex
    residual: Array
    rigid: NDArray[np.bool_]
    missing: int | None
    skipped: int
    hidden: bool = False


def shift_of(problem: Quadratic, s0: float) -> float:
    """Return a real shift near the lowest |s|, from a first one below it."""
    factors = problem.factors(s0)
    while factors.singular:
        s0 *= 1.37
        factors = problem.factors(s0)
    x = np.sin(1.0 + np.arange(problem.n))
    for _ in range(4):
        x = factors.solve(problem.mass(x))
        x /= problem.size(x)
    y = factors.solve(problem.mass(x))
    lowest = abs(float(x @ problem.mass(x)) / float(x @ problem.mass(y))) - s0 * s0
    return max(s0, NEAR * math.sqrt(max(lowest, 0.0)))


class Search:
    """The lowest pairs of a quadratic problem, by |s|."""

    def __init__(self, problem: Quadratic, s0: float, rest_limit: float) -> None:
        self.problem, self.s0, self.rest_limit, self.complete = problem, s0, rest_limit, False
        self.factors = problem.factors(s0)
        if self.factors.singular:
            raise ComputationError("the matrix K + s C + s^2 M is singular for every s",
                                   advice="a mass or a stiffness for everything that can move")
        # without multipliers, which do no work, but would grow with the space and cost all digits
        self._within = within_constraints(problem)
        self.space = Space(problem, self._within)

    def _inverse(self, b: Array) -> Array:
        return self.factors.solve(b)

    def fill_with_all(self) -> None:
        """Fill the space with all motions that the constraints allow."""
        from scipy.linalg import null_space

        p = self.problem
        held = np.flatnonzero(~p.is_coordinate)
        G = p.K[held][:, p.is_coordinate].toarray() / p.weights[p.is_coordinate]
        free = null_space(G) if len(held) else np.eye(int(p.is_coordinate.sum()))
        for column in free.T:
            x = np.zeros(p.n)
            x[p.is_coordinate] = column / p.weights[p.is_coordinate]
            self.space.add(x)

    def fill(self, number: int) -> None:
        """Fill the space with the vectors that the ``number`` lowest pairs need."""
        if self.problem.n <= max(DENSE, 2 * number + BEYOND):
            self.fill_with_all()
            self.complete = True
            return
        self.extend(2 * number + BEYOND, 0)

    def extend(self, steps: int, seed: int) -> None:
        """Extend the space by steps of the two-level Arnoldi method, from a random start if ``seed`` is new."""
        if seed != getattr(self, "_seed", None):
            self._seed = seed
            p, random = self.problem, np.random.default_rng(seed)
            start = self._inverse(p.mass(self._inverse(p.mass(random.standard_normal(p.n)))))
            along, new = self.space.add(start)
            first = np.append(along, new)[:self.space.count]
            self._small = [np.stack([first, first]) / np.linalg.norm(first)]
        for _ in range(steps):
            if not self._step():
                return

    def _step(self) -> bool:
        """Make one step; return whether it added a new vector."""
        p, s0, space = self.problem, self.s0, self.space
        g = self._small[-1]
        x1, x2 = g @ space.V[:g.shape[1]]
        shifted = p.C @ x1 + 2 * s0 * (p.M @ x1)
        along, new = space.add(-self._inverse(s0 * shifted + s0 * s0 * (p.M @ x2)))
        k = space.count
        w = np.zeros((2, k))
        w[0, :len(along)] = along
        if new:
            w[0, -1] = new
        w[1, :g.shape[1]] = g[0]
        size = np.linalg.norm(w)
        for _ in range(2):
            for old in self._small:
                w[:, :old.shape[1]] -= np.vdot(old, w[:, :old.shape[1]]) * old
        if not np.linalg.norm(w) > 1e-13 * size:
            return False
        self._small.append(w / np.linalg.norm(w))
        return True

    def ritz(self) -> tuple[Complex, Complex]:
        """Return the eigenvalues in the space, by |s|, and their vectors (m, k) in terms of its vectors."""
        s, Y = projected_pairs(self.space.project(), self.s0)
        order = np.argsort(np.abs(s), kind="stable")
        return s[order], Y[order]

    def corrected(self, s: Complex, Y: Complex, number: int) -> tuple[Complex, Complex]:
        """Return the lowest eigenvalues recomputed with the digits that stiff motions in the space have cost.

        The space becomes that of their vectors after one inverse iteration.
        """
        p, some = self.problem, 2 * number + MARGIN
        if len(s) <= some:
            return s, Y
        X = [self.space.combined(y) for y in Y[:some]]
        self.space = Space(p, self._within)
        for one, x in zip(s, X, strict=False):
            tau = one - self.s0
            b = tau * (_both(p.damping, x) + 2 * self.s0 * _both(p.mass, x)) + tau * tau * _both(p.mass, x)
            new = _both(self._inverse, b)
            new[~p.is_coordinate] = 0.0
            self.space.add(new.real)
            self.space.add(new.imag)
        return self.ritz()

    def improved(self, s: Complex, Y: Complex, number: int) -> tuple[Complex, Complex]:
        """Return the same as ``corrected``, as often as one of the wanted pairs has a large residual."""
        for _ in range(IMPROVEMENTS):
            lowest = np.flatnonzero(_upper(s) & (np.abs(s) > self.rest_limit))[:number]
            crowded = (lowest >= 2 * number + MARGIN).any()  # by real eigenvalues, so that pairs would be lost
            if crowded or all(self.residual(s[k], self.space.combined(Y[k])) <= GOOD for k in lowest):
                break
            s, Y = self.corrected(s, Y, number)
        return s, Y

    def strains_nothing(self, x: Complex) -> bool:
        """Return whether x has no strain energy compared with elastic modes."""
        p = self.problem
        mass, stiff = (sum(float(u @ act(u)) for u in (x.real, x.imag)) for act in (p.mass, p.stiffness))
        return abs(stiff) <= NOTHING * (self.rest_limit / AT_REST) ** 2 * mass

    def residual(self, s: complex, x: Complex) -> float:
        """Return |Q(s0)^-1 Q(s) x|/|x| as displacements."""
        p = self.problem
        r = s * s * _both(p.mass, x) + s * _both(p.damping, x) + _both(p.stiffness, x)
        out = _both(self._inverse, r)
        return float(np.linalg.norm(p.weights * out) / np.linalg.norm(p.weights * x))


def _both(act: Callable[[Array], Array], x: Complex) -> Complex:
    return act(np.ascontiguousarray(x.real)) + 1j * act(np.ascontiguousarray(x.imag))


def lowest_pairs(problem: Quadratic, number: int, s0: float, rest_limit: float) -> Pairs:
    """Return the ``number`` pairs of lowest |s|, and the real eigenvalues not larger than the last of them.

    At most two real eigenvalues are returned for each wanted pair, and fewer pairs if there are no more. ``rest_limit``
    [1/s] is far below the lowest elastic frequency: slower motions without strain energy are at rest.
    """
    search = Search(problem, s0, rest_limit)
    search.fill(number)
    if search.complete:
        s, Y = search.corrected(*search.ritz(), number)
        return _chosen(search, s, Y, number, complete=True)
    for seed in range(RANDOM_STARTS):
        s, Y = search.improved(*_settled(search, number, seed), number)
        found = _chosen(search, s, Y, number, complete=False)
        crowded = int((~_upper(found.s)).sum()) >= 2 * number
        if not found.missing or crowded or seed == RANDOM_STARTS - 1:
            break
    return found


def _settled(search: Search, number: int, seed: int) -> tuple[Complex, Complex]:
    """Extend the space until the wanted pairs have converged; return all eigenvalues in it."""
    if seed:
        search.extend(2 * number + BEYOND, seed)
    before, calm, last, least, idle = np.zeros(0, dtype=complex), 0, 1.0, 1.0, 0
    while True:
        s, Y = search.ritz()
        wanted = s[_upper(s) & (np.abs(s) > search.rest_limit)][:number]
        moved = max((float(np.abs(before - one).min(initial=np.inf)) / abs(one) for one in wanted), default=0.0)
        # if round-off of K keeps changing them, they cannot be improved
        calm = calm + 1 if moved <= SETTLED or last * STALLED < moved <= ROUGH else 0
        # for very fine meshes round-off is larger still, and the changes stop decreasing
        idle = 0 if moved < 0.5 * least else idle + 1
        last, least = moved, min(least, moved)
        rests = calm or (idle >= CALM_CHECKS and least <= STUCK)
        full = search.space.count >= min(MAX_VECTORS, search.problem.n)
        if (rests and len(wanted) == number) or calm >= CALM_CHECKS or full:
            return s, Y
        before, count = s, search.space.count
        search.extend(STRIDE, seed)
        if search.space.count == count:
            return s, Y


def _upper(s: Complex) -> NDArray[np.bool_]:
    """Return which eigenvalues represent a pair."""
    return s.imag > REAL * np.abs(s)


def _chosen(search: Search, s: Complex, Y: Complex, number: int, complete: bool) -> Pairs:
    """Return the wanted pairs, lowest |s| first, with the real eigenvalues among them."""
    keep: list[complex] = []
    vectors: list[Complex] = []
    residuals: list[float] = []
    resting: list[Complex] = []
    pairs = real = skipped = 0
    for k in np.flatnonzero(s.imag >= -REAL * np.abs(s)):
        if pairs == number:
            break
        x, is_pair = search.space.combined(Y[k]), bool(_upper(s[k:k + 1])[0])
        rest = abs(s[k]) <= search.rest_limit and search.strains_nothing(x)
        if not rest and not is_pair and real == 2 * number:
            continue
        residual = search.residual(s[k], x)
        if residual > TRUSTED:
            skipped += int(is_pair)
        elif rest:
            resting.append(x)
        else:
            pairs, real = pairs + is_pair, real + (not is_pair)
            keep.append(s[k] if is_pair else complex(s[k].real))
            vectors.append(x)
            residuals.append(residual)
    motions = _motions(search.problem, resting)
    rest_count, n = len(motions), search.problem.n
    found = np.array([0j] * rest_count + keep, dtype=complex)
    missing = skipped if complete else _missing(search, found, s)
    lowest = max(np.abs(found[_upper(found)]).min(initial=search.s0), search.rest_limit / AT_REST)
    return Pairs(found, np.array([*motions, *vectors], dtype=complex).reshape(-1, n),
                 np.array([*(search.residual(0.0, x) for x in motions), *residuals]),
                 np.arange(len(found)) < rest_count, missing, skipped,
                 bool(search.s0 > FAR * lowest))


def _motions(problem: Quadratic, modes: Sequence[Complex]) -> Array:
    """Return the motions (m, n) of modes at rest, each once.

    Their eigenvalues are double, and round-off makes those of two motions complex: the real and the imaginary part of a
    mode are then different motions.
    """
    space = Space(problem)
    for x in modes:
        for part in (x.real, x.imag):
            count = space.count
            if space.add(part)[1] < ALIKE * problem.size(np.abs(x)):
                space.count = count
    return space.V


def _diagonals(problem: Quadratic) -> tuple[Array, Array, Array]:
    """Return the diagonals of K, C and M where Kelvin-Voigt damping acts (k,), empty without it."""
    k, c, m = (A.diagonal() for A in (problem.K, problem.C, problem.M))
    acts = (c > 0) & (k > 0) & (problem.damped and problem.small.viscous is not None)
    return k[acts], c[acts], m[acts]


def _missing(search: Search, found: Complex, ritz: Complex) -> int | None:
    """Return the number of eigenvalues within the circle through the last one found that were not found."""
    if not len(found):
        return None
    radius = float(np.abs(found).max())
    beyond = np.sort(np.abs(ritz[np.abs(ritz) > radius * (1 + 1e-6)]))
    outer = math.sqrt(radius * float(beyond[0])) if len(beyond) else 1.1 * radius
    # zero eigenvalues in ``found`` are double, and only zero to round-off: take their Ritz values
    slow = ritz[np.abs(ritz) <= search.rest_limit] if (found == 0).any() else found[:0]
    fast = found[found != 0]
    both = np.concatenate([fast, fast[_upper(fast)].conj(), slow])
    # Kelvin-Voigt damping of fine meshes turns the phase by (1 + tau s)^n; so does the diagonal, whose ``own`` roots
    # within the circle are known
    k, c, m = _diagonals(search.problem)
    # dividing out eigenvalues outside the circle reduces the phase change between points without affecting the count;
    # the diagonal has done so already
    near = ritz[(np.abs(ritz) > outer) & (np.abs(ritz) < 4 * outer) & (len(k) == 0)]
    own = sum(int((np.abs(np.roots([c2, c1, c0])) < outer).sum()) for c0, c1, c2 in zip(k, c, m, strict=True)
              if c2 * outer**2 + c1 * outer > OUTSIDE * c0)

    def phase(angle: float) -> complex:
        at = outer * complex(math.cos(angle), math.sin(angle))
        matrix = search.problem.matrix(at if 0.0 < angle < math.pi else at.real)
        out = Factors(matrix).phase
        for s in both:
            out *= abs(at - s) / (at - s)
        for s in near:
            out *= abs(at - s) / (at - s)
        return out * np.exp(-1j * np.angle(k + at * c + at * at * m).sum())
    # all motions together turn the phase relative to the diagonal's
    turned = turned_on_half_circle(phase, 12 if len(k) else 6)
    return None if turned is None else round(turned / math.pi) + own
