"""Opening, closing, sticking and sliding of contacts with friction, found together.

About a state, the normal forces N and the tangential forces T = T+ - T- of all points are related by a compliance to
their conjugates: the gaps z and the slips s since the last accepted state. With the coefficient mu,

    z >= 0 complementary to N >= 0, s + l >= 0 to T+ >= 0, l - s >= 0 to T- >= 0, mu N - T+ - T- >= 0 to l >= 0

is a linear complementarity problem that Lemke's method solves if the compliance is positive semidefinite (D. E. Stewart
& J. C. Trinkle, International Journal for Numerical Methods in Engineering 39, 1996; A. Klarbring, Ingenieur-Archiv 60,
1990).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..elements.contact_geometry import FRICTION, SLIP_STATUS, STICK, STICKS
from ..elements.shape import Array
from .complementarity import DEPENDENT, lemke, lemke_from
from .contact_response import HELD_ALREADY, Response, Spot

if TYPE_CHECKING:
    from .system import System

# least stiffness, relative to the largest of its kind, of bodies that only contact holds
LOOSE = 1e-6


class RoughResponse(Response):
    """Linear response with friction, and the points that open, close, stick and slide according to it.

    In the tangent, closed points stick with their current forces. Numbers below the number of spots (m,) are normal
    forces and gaps; those from there on are tangential forces and slips of the spots with friction, ``rough``.
    """

    def __init__(self, system: System, d: Array, t: float, spots: list[Spot], stuck: bool = True) -> None:
        self.between = np.array([s.one.pair.spots[s.k].free for s in spots])
        rubs = {k: s.slope for k, s in enumerate(spots) if s.slope is not None and s.slope.any()}
        self.rough = list(rubs)
        points = [spots[k].point for k in self.rough]
        self.mu, self.spring = (np.array([p.par[key] for p in points]) for key in (FRICTION, STICK))
        way, held = np.array([spots[k].way for k in self.rough]), np.array([spots[k].held for k in self.rough])
        self.signs = signs = np.array([p.mem[SLIP_STATUS] for p in points])
        # tangential forces, and slip since the last accepted state
        drag = np.where(held, np.where(signs == STICKS, -self.spring * way,
                                       -signs * self.mu * np.array([d[p.multiplier] for p in points])), 0.0)
        slip = way + drag / self.spring
        super().__init__(system, d, t, spots, stuck)
        self.slopes = np.zeros((len(self.rough), len(self.num.place)))
        for row, (k, slope) in zip(self.slopes, rubs.items(), strict=True):
            np.add.at(row, spots[k].dofs, slope)
        self.sticks = np.append(self.held, held)
        self.begin = np.append(np.zeros(len(spots)), np.where(held, slip, 0.0))
        self.b = np.append(self.b, np.where(held, drag, slip)) + np.append(np.zeros(len(spots)), self._along(self.base))
        self.total = self.base

    def _along(self, z: Array) -> Array:
        """Return how unknowns z change the tangential forces of closed points and the slips of open ones."""
        full = np.zeros(len(self.num.place))
        self.num.expand(z, full)
        out: Array = np.where(self.held[self.rough], -self.spring, 1.0) * (self.slopes @ full)
        return out

    def _column(self, k: int) -> Array:
        """Return the changes of all entries for a unit of entry k: opening or slip of a closed point, or a force."""
        m = len(self.held)
        if k < m:
            own = np.append(self.answer(k), np.zeros(len(self.rough)))
        else:
            own, i = np.zeros(len(self.b)), k - m
            force = self.spring[i] if self.sticks[k] else 1.0
            self.steps[k] = self.solve(self._reduced(force * self.slopes[i])).copy()
            own[:m] = self.told(self.steps[k])
            own[k] = self.spring[i] if self.sticks[k] else 1.0 / self.spring[i]
        own[m:] += self._along(self.steps[k])
        return own

    def settled(self, limit: float) -> dict[int, float] | None:
        """Return the forces of spots that close or open; ``slides`` then has the friction states of the closed spots.

        Start from the closed points and those deeper than ``limit``, and add those that are deep then. None if there is
        no such state nearby.
        """
        m = len(self.held)
        acts, new = np.flatnonzero(self.sticks).tolist(), np.flatnonzero(~self.held & (self.b[:m] < -limit)).tolist()
        columns = np.zeros((len(self.b), 0))
        while True:
            acts += new + [m + self.rough.index(k) for k in new if k in self.rough]
            columns = np.column_stack([columns, *(self._column(k) for k in acts[columns.shape[1]:])])
            problem = _Forces.of(self, acts, columns)
            p = problem.complementary()
            if p is None:
                return None
            x, closed, signs = problem.balanced(p)
            w = self.b + columns @ x
            deep = np.flatnonzero(~self.held & (w[:m] < -limit)).tolist()
            new = [k for k in deep if k not in acts]
            if not new:
                break
        if deep:
            return None
        self.total = self.base + sum((a * self.steps[k] for k, a in zip(acts, x, strict=True)),
                                     np.zeros(len(self.base)))
        at = {k: j for j, k in enumerate(acts)}
        self.slides = {k: float(signs[at[m + i]]) or STICKS for i, k in enumerate(self.rough)
                       if m + i in at and closed[at[k]]}
        force = problem.forces @ x + problem.none
        return {k: float(force[j]) for k, j in at.items() if k < m and closed[j] != self.held[k]}

    def step(self, found: dict[int, float]) -> Array:
        """Return the change of the unknowns (n_unknowns,)."""
        return self.total


class _Forces(NamedTuple):
    """Contact forces and their conjugates (gaps, slips), n of each, as functions of x (n,): ``forces`` x + ``none`` and
    ``ways`` x + ``begin``. ``rubs`` are numbers of friction forces, ``across`` those of the normal forces of the same
    points, ``mu`` the coefficients. x is the gap or slip where a point is ``held`` (n,), and the force elsewhere."""

    forces: Array
    none: Array
    ways: Array
    begin: Array
    rubs: Any
    across: Any
    mu: Array
    held: Any
    between: Any
    stiff: Array
    slides: Array

    @classmethod
    def of(cls, response: RoughResponse, acts: list[int], columns: Array) -> _Forces:
        """Return the problem for some entries of a response."""
        m, one = len(response.held), np.eye(len(acts))
        way, at = response.sticks[acts], {k: j for j, k in enumerate(acts)}
        told, b, begin = columns[acts], response.b[acts], response.begin[acts]
        rubs = [j for j, k in enumerate(acts) if k >= m]
        owners = [response.rough[acts[j] - m] for j in rubs]
        return cls(np.where(way[:, None], told, one), np.where(way, b, 0.0), np.where(way[:, None], one, told),
                   np.where(way, begin, b), np.array(rubs, dtype=int), np.array([at[k] for k in owners], dtype=int),
                   response.mu[[acts[j] - m for j in rubs]], way,
                   np.array([k < m and response.between[k] for k in acts]),
                   np.array([response.stiff[k] if k < m else 0.0 for k in acts]),
                   response.signs[[acts[j] - m for j in rubs]])

    def _compliance(self) -> Array:
        """Return the change of gaps and slips with the forces (n, n); bodies held by contact alone are held softly."""
        held, free = np.flatnonzero(self.held), np.flatnonzero(~self.held)
        H = self.forces[np.ix_(held, held)]
        most = np.abs(np.diag(H)).max(initial=0.0) or 1.0
        size = np.sqrt(np.maximum(np.abs(np.diag(H)), LOOSE * most))
        H = 0.5 * (H + H.T) / np.outer(size, size)
        try:
            np.linalg.cholesky(H)
            inverse = np.linalg.inv(H + LOOSE * np.eye(len(H)))
        except np.linalg.LinAlgError:
            values, vectors = np.linalg.eigh(H)
            inverse = (vectors / np.maximum(values, LOOSE)) @ vectors.T
        inverse /= np.outer(size, size)
        x = np.eye(len(self.none))
        x[np.ix_(held, held)] = inverse
        x[np.ix_(held, free)] = -inverse @ self.forces[np.ix_(held, free)]
        W: Array = self.ways @ x
        return W

    def complementary(self) -> tuple[Array, Array, Array, Array] | None:
        """Return normal forces (n - r,), friction forth and back (r,) and slips (r,), or None if Lemke's method
        fails."""
        n, r = len(self.none), len(self.rubs)
        W = self._compliance()
        offset = self.begin - W @ self.none
        normals = np.setdiff1d(np.arange(n), self.rubs)
        one, none, order = np.eye(r), np.zeros((r, r)), [*normals, *self.rubs]
        W, offset, n_n = W[np.ix_(order, order)], offset[order], len(normals)
        limit = np.zeros((r, n_n))
        limit[np.arange(r), np.searchsorted(normals, self.across)] = self.mu
        slip, beside = W[n_n:], np.zeros((n_n, r))
        M = np.block([[W[:n_n], -W[:n_n, n_n:], beside], [slip, -slip[:, n_n:], one],
                      [-slip, slip[:, n_n:], one], [limit, -one, -one, none]])
        q = np.concatenate([offset[:n_n], offset[n_n:], -offset[n_n:], np.zeros(r)])
        own = np.diag(M).copy()
        own = np.maximum(own, DEPENDENT * own.max(initial=0.0))
        scale = 1.0 / np.sqrt(np.where(own > 0.0, own, 1.0))
        if r:
            scale[-r:] = 1.0 / scale[n_n:n_n + r]
        M, q = M * np.outer(scale, scale), q * scale
        z = lemke_from(M, q, self._present(normals))
        if z is None:
            z = lemke(M, q)
        z = None if z is None else scale * z
        return None if z is None else (z[:n_n], z[n_n:n_n + r], z[n_n + r:n_n + 2 * r], z[n_n + 2 * r:])

    def _present(self, normals: Any) -> Any:
        """Return which forces and slips of the problem are nonzero if all points keep their states."""
        held, sticks = self.held[self.rubs], self.slides == STICKS
        forth = np.where(held & sticks, self.none[self.rubs] >= 0.0,
                         np.where(held, self.slides > 0.0, self.begin[self.rubs] <= 0.0))
        return np.concatenate([self.held[normals], forth, ~forth, ~(held & sticks)])

    def _repeated(self, closed: Any) -> list[int]:
        """Return the closed points that others already hold; of an element, those between its fixed points first."""
        W, out = self._compliance(), []
        for k in closed[np.argsort(self.between[closed], kind="stable")].tolist():
            if W[k, k] * self.stiff[k] < HELD_ALREADY:
                out.append(k)
            else:
                W = W - np.outer(W[:, k], W[k]) / W[k, k]
        return out

    def balanced(self, found: tuple[Array, Array, Array, Array]) -> tuple[Array, Any, Array]:
        """Return x (n,) for the set found, which entries are closed (n,), and signs of sliding friction (n,)."""
        n, (pressed, forth, back, slips) = len(self.none), found
        closed, signs = np.zeros(n, dtype=bool), np.zeros(n)
        closed[np.setdiff1d(np.arange(n), self.rubs)] = pressed > 0.0
        closed[self._repeated(np.flatnonzero(closed))] = False
        closed[self.rubs] = closed[self.across]
        signs[self.rubs] = np.where(slips > 0.0, np.where(forth > back, 1.0, -1.0), 0.0)
        given = closed & (signs == 0.0)
        A, rhs = np.where(given[:, None], self.ways, self.forces), -np.where(given, self.begin, self.none)
        share = np.where(closed[self.rubs], signs[self.rubs] * self.mu, 0.0)
        A[self.rubs] -= share[:, None] * self.forces[self.across]
        rhs[self.rubs] += share * self.none[self.across]
        size = np.abs(A).max(axis=1)
        size[size == 0.0] = 1.0
        return np.linalg.lstsq(A / size[:, None], rhs / size, rcond=None)[0], closed, signs
