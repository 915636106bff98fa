"""Eigenvalues of (K + s C + s^2 M) x = 0: a second-order Krylov space, Rayleigh-Ritz in it, and a count of all.

The space is that of the two-level orthogonal Arnoldi method about a real shift (Lu, Su & Bai 2016), so that only one
real matrix is factored and the quadratic problem is never made twice as long. The eigenvalues within a circle are
counted by the argument principle, from the phase of det(K + s C + s^2 M) along it.
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

# up to so many unknowns, every eigenvalue is computed at once
DENSE = 40
# vectors of the space beyond two for each pair that is asked for, and between two looks at the eigenvalues
BEYOND, STRIDE = 24, 8
# vectors after which the search ends
MOST = 400
# looks after which fewer pairs than were asked for are all that there are; random starts
CALM, TRIES = 5, 3
# relative change of eigenvalues that have come to rest, and of those that may be held up by round-off, where they
# change by more than a share of what they changed by before
SETTLED, ROUGH, STALLED = 1e-8, 1e-6, 0.1
# change that no larger space makes less, where it has not done so a few times
STUCK = 1e-3
# residual beyond which a Ritz pair is no eigenpair
TRUSTED = 1e-5
# share of an eigenvalue within which its imaginary part is round-off
REAL = 1e-9
# terms of a quadratic polynomial beside its last one, below which it has no root within a circle
OUTSIDE = 0.9
# eigenvalues beyond the pairs asked for that are corrected with them
MARGIN = 12
# strain energy beside that of elastic modes, and size of an eigenvalue beside theirs, of motions that are at rest
NOTHING, AT_REST = 1e-8, 1e-3
# share of a motion at rest that is no other such motion
ALIKE = 1e-3
# the shift beside the lowest eigenvalue
NEAR = 0.6


@dataclass
class Pairs:
    """Eigenvalues s (k,) [1/s] with Im s >= 0, vectors (k, n_unknowns), residuals (k,), and whether none is missing.

    ``rest`` (k,): which are rigid motions that nothing moves or holds, each once, with s = 0. ``residual``:
    |Q(s0)^-1 Q(s) x|/|x| as displacements, Q(s) = K + s C + s^2 M, s0 the shift. ``missing``: how many more eigenvalues
    there are within the circle through the last pair, by the argument principle (None: it could not tell).
    ``skipped`` pairs did not converge.
    """

    s: Complex
    vectors: Complex
    residual: Array
    rest: NDArray[np.bool_]
    missing: int | None
    skipped: int


def shift_of(problem: Quadratic, s0: float) -> float:
    """Return a real shift near the lowest |s|, from a first one that is not beyond it."""
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

    def __init__(self, problem: Quadratic, s0: float, still: float) -> None:
        self.problem, self.s0, self.still, self.complete = problem, s0, still, False
        self.factors = problem.factors(s0)
        if self.factors.singular:
            raise ComputationError("the matrix K + s C + s^2 M is singular for every s",
                                   advice="a mass or a stiffness for everything that can move")
        self._fulfilled = within_constraints(problem)
        self.space = Space(problem, self._within)

    def _within(self, x: Array) -> Array:
        """Return x (n,) within the constraints, with its multipliers: stiff forces that they balance take no digits."""
        return np.where(self.problem.moved, self._fulfilled(x), x)

    def _inverse(self, b: Array) -> Array:
        return self.factors.solve(b)

    def everything(self) -> None:
        """Fill the space with all that the constraints leave free."""
        from scipy.linalg import null_space

        p = self.problem
        held = np.flatnonzero(~p.moved)
        G = p.K[held][:, p.moved].toarray() / p.weights[p.moved]
        free = null_space(G) if len(held) else np.eye(int(p.moved.sum()))
        for column in free.T:
            x = np.zeros(p.n)
            x[p.moved] = column / p.weights[p.moved]
            self.space.add(x)

    def fill(self, number: int) -> None:
        """Fill the space with what the ``number`` lowest pairs need."""
        if self.problem.n <= max(DENSE, 2 * number + BEYOND):
            self.everything()
            self.complete = True
            return
        self.extend(2 * number + BEYOND, 0)

    def extend(self, steps: int, seed: int) -> None:
        """Go on by so many steps of the two-level Arnoldi method, from a random start where ``seed`` is new."""
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
        """Take one step; return whether it found anything new."""
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
        """Return the eigenvalues in the space, by |s|, and their vectors (m, k) along it."""
        s, Y = projected_pairs(self.space.project(), self.s0)
        order = np.argsort(np.abs(s), kind="stable")
        return s[order], Y[order]

    def corrected(self, s: Complex, Y: Complex, number: int) -> tuple[Complex, Complex]:
        """Return the lowest eigenvalues again, with the digits that stiff motions in the space have taken.

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
            new[~p.moved] = 0.0
            self.space.add(new.real)
            self.space.add(new.imag)
        return self.ritz()

    def strains_nothing(self, x: Complex) -> bool:
        """Return whether x has no strain energy beside that of elastic modes."""
        p = self.problem
        mass, stiff = (sum(float(u @ act(u)) for u in (x.real, x.imag)) for act in (p.mass, p.stiffness))
        return abs(stiff) <= NOTHING * (self.still / AT_REST) ** 2 * mass

    def residual(self, s: complex, x: Complex) -> float:
        """Return |Q(s0)^-1 Q(s) x|/|x| as displacements."""
        p = self.problem
        r = s * s * _both(p.mass, x) + s * _both(p.damping, x) + _both(p.stiffness, x)
        out = _both(self._inverse, r)
        return float(np.linalg.norm(p.weights * out) / np.linalg.norm(p.weights * x))


def _both(act: Callable[[Array], Array], x: Complex) -> Complex:
    return act(np.ascontiguousarray(x.real)) + 1j * act(np.ascontiguousarray(x.imag))


def lowest_pairs(problem: Quadratic, number: int, s0: float, still: float) -> Pairs:
    """Return the ``number`` pairs of lowest |s|, and the real eigenvalues that are not beyond the last of them.

    Of real eigenvalues there are at most two for each pair asked for; of pairs, fewer where there are no more.
    ``still`` [1/s] is far below the lowest elastic frequency: what is slower and strains nothing is at rest.
    """
    search = Search(problem, s0, still)
    search.fill(number)
    if search.complete:
        s, Y = search.corrected(*search.ritz(), number)
        return _chosen(search, s, Y, number, complete=True)
    for seed in range(TRIES):
        s, Y = _settled(search, number, seed)
        found = _chosen(search, s, Y, number, complete=False)
        crowded = int((~_upper(found.s)).sum()) >= 2 * number
        if not found.missing or crowded or seed == TRIES - 1:
            break
    return found


def _settled(search: Search, number: int, seed: int) -> tuple[Complex, Complex]:
    """Extend the space until the pairs asked for have come to rest; return all eigenvalues in it."""
    if seed:
        search.extend(2 * number + BEYOND, seed)
    before, calm, last, least, idle = np.zeros(0, dtype=complex), 0, 1.0, 1.0, 0
    while True:
        s, Y = search.ritz()
        wanted = s[_upper(s) & (np.abs(s) > search.still)][:number]
        moved = max((float(np.abs(before - one).min(initial=np.inf)) / abs(one) for one in wanted), default=0.0)
        # where round-off of K moves them for ever, they are as good as they get
        calm = calm + 1 if moved <= SETTLED or last * STALLED < moved <= ROUGH else 0
        # of very fine meshes round-off takes more digits than those, and the changes shrink no more
        idle = 0 if moved < 0.5 * least else idle + 1
        last, least = moved, min(least, moved)
        rests, full = calm or (idle >= CALM and least <= STUCK), search.space.count >= min(MOST, search.problem.n)
        if (rests and len(wanted) == number) or calm >= CALM or full:
            return s, Y
        before, count = s, search.space.count
        search.extend(STRIDE, seed)
        if search.space.count == count:
            return s, Y


def _upper(s: Complex) -> NDArray[np.bool_]:
    """Return which eigenvalues stand for a pair."""
    return s.imag > REAL * np.abs(s)


def _chosen(search: Search, s: Complex, Y: Complex, number: int, complete: bool) -> Pairs:
    """Return the pairs that were asked for, lowest |s| first, with the real eigenvalues among them."""
    keep: list[complex] = []
    vectors: list[Complex] = []
    residuals: list[float] = []
    resting: list[Complex] = []
    pairs = real = skipped = 0
    for k in np.flatnonzero(s.imag >= -REAL * np.abs(s)):
        if pairs == number:
            break
        x, is_pair = search.space.combined(Y[k]), bool(_upper(s[k:k + 1])[0])
        rest = abs(s[k]) <= search.still and search.strains_nothing(x)
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
    return Pairs(found, np.array([*motions, *vectors], dtype=complex).reshape(-1, n),
                 np.array([*(search.residual(0.0, x) for x in motions), *residuals]),
                 np.arange(len(found)) < rest_count, missing, skipped)


def _motions(problem: Quadratic, modes: Sequence[Complex]) -> Array:
    """Return the motions (m, n) of modes at rest, each once.

    Their eigenvalues come twice, and round-off makes those of two motions complex: the real and the imaginary part of a
    mode are different motions then.
    """
    space = Space(problem)
    for x in modes:
        for part in (x.real, x.imag):
            count = space.count
            if space.add(part)[1] < ALIKE * problem.size(np.abs(x)):
                space.count = count
    return space.V


def _diagonals(problem: Quadratic) -> tuple[Array, Array, Array]:
    """Return the diagonals of K, C and M where Kelvin-Voigt damping acts (k,), none without."""
    k, c, m = (A.diagonal() for A in (problem.K, problem.C, problem.M))
    acts = (c > 0) & (k > 0) & (problem.damped and problem.small.viscous is not None)
    return k[acts], c[acts], m[acts]


def _missing(search: Search, found: Complex, ritz: Complex) -> int | None:
    """Return how many eigenvalues there are beside those found within the circle through the last of them."""
    if not len(found):
        return None
    radius = float(np.abs(found).max())
    beyond = np.sort(np.abs(ritz[np.abs(ritz) > radius * (1 + 1e-6)]))
    outer = math.sqrt(radius * float(beyond[0])) if len(beyond) else 1.1 * radius
    # what rests has moved by round-off in ``found``, and comes twice
    slow = ritz[np.abs(ritz) <= search.still] if (found == 0).any() else found[:0]
    fast = found[found != 0]
    both = np.concatenate([fast, fast[_upper(fast)].conj(), slow])
    # those beyond the circle make the phase turn less between its points, and count for nothing
    near = ritz[(np.abs(ritz) > outer) & (np.abs(ritz) < 4 * outer)]

    # Kelvin-Voigt damping of fine meshes turns the phase by (1 + tau s)^n: the diagonal does so too, and its roots,
    # ``own`` of them within the circle, are known
    k, c, m = _diagonals(search.problem)
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
    turned = turned_on_half_circle(phase)
    return None if turned is None else round(turned / math.pi) + own
