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
from .contact_response import HELD_ALREADY, Candidate, Response, sparse_rows

if TYPE_CHECKING:
    from .system import System

# least stiffness, relative to the largest of its kind, of bodies that only contact holds
LOOSE = 1e-6


class FrictionResponse(Response):
    """Linear response with friction, and the points that open, close, stick and slide according to it.

    In the tangent, closed points stick with their current forces. Numbers below the number of candidates (m,) are
    normal forces and gaps; those from there on are tangential forces and slips of the candidates ``with_friction``.
    """

    def __init__(self, system: System, d: Array, t: float, candidates: list[Candidate], stuck: bool = True) -> None:
        self.movable = np.array([s.contact.pair.spots[s.k].free for s in candidates])
        self.with_friction = [k for k, s in enumerate(candidates)
                              if s.slip_gradient is not None and s.slip_gradient.any()]
        some = [candidates[k] for k in self.with_friction]
        points = [s.point for s in some]
        self.mu, self.spring = (np.array([p.par[key] for p in points]) for key in (FRICTION, STICK))
        anchored, closed = np.array([s.slip for s in some]), np.array([s.closed for s in some])
        self.friction_states = states = np.array([p.mem[SLIP_STATUS] for p in points])
        # tangential forces, and slip since the last accepted state
        force = np.where(closed, np.where(states == STICKS, -self.spring * anchored,
                                          -states * self.mu * np.array([d[p.multiplier] for p in points])), 0.0)
        slip = anchored + force / self.spring
        super().__init__(system, d, t, candidates, stuck)
        self.slip_gradients = sparse_rows([s.dofs for s in some], [np.asarray(s.slip_gradient) for s in some],
                                          len(self.num.place))
        self.closed_entries, none = np.append(self.closed, closed), np.zeros(len(candidates))
        self.initial_slip = np.append(none, np.where(closed, slip, 0.0))
        self.b = np.append(self.b, np.where(closed, force, slip))
        self.b += np.append(none, self._tangential_changes(self.newton_step))
        self.whole_step = self.newton_step

    def _tangential_changes(self, z: Array) -> Array:
        """Return how unknowns z change the tangential forces of closed points and the slips of open ones."""
        full = np.zeros(len(self.num.place))
        self.num.expand(z, full)
        out: Array = np.where(self.closed[self.with_friction], -self.spring, 1.0) * (self.slip_gradients @ full)
        return out

    def _column(self, k: int) -> Array:
        """Return the changes of all entries for a unit of entry k: opening or slip of a closed point, or a force."""
        m = len(self.closed)
        if k < m:
            own = np.append(self.unit_response(k), np.zeros(len(self.with_friction)))
        else:
            own, i = np.zeros(len(self.b)), k - m
            force = self.spring[i] if self.closed_entries[k] else 1.0
            self.steps[k] = self.solve(force * self._reduced(self.slip_gradients, i)).copy()
            own[:m] = self.changes(self.steps[k])
            own[k] = self.spring[i] if self.closed_entries[k] else 1.0 / self.spring[i]
        own[m:] += self._tangential_changes(self.steps[k])
        return own

    def complementary_changes(self, limit: float) -> dict[int, float] | None:
        """Return the forces of candidates that close or open; ``slides`` then has the friction states of closed ones.

        Start from the closed points and those deeper than ``limit``, and add those that are deep then. None if there is
        no such state nearby.
        """
        m = len(self.closed)
        entries = np.flatnonzero(self.closed_entries).tolist()
        new = np.flatnonzero(~self.closed & (self.b[:m] < -limit)).tolist()
        columns = np.zeros((len(self.b), 0))
        while True:
            entries += new + [m + self.with_friction.index(k) for k in new if k in self.with_friction]
            columns = np.column_stack([columns, *(self._column(k) for k in entries[columns.shape[1]:])])
            problem = _ContactProblem.of(self, entries, columns)
            p = problem.complementary()
            if p is None:
                return None
            x, closed, signs = problem.balanced(p)
            w = self.b + columns @ x
            deep = np.flatnonzero(~self.closed & (w[:m] < -limit)).tolist()
            new = [k for k in deep if k not in entries]
            if not new:
                break
        if deep:
            return None
        self.whole_step = self.newton_step + sum((a * self.steps[k] for k, a in zip(entries, x, strict=True)),
                                                 np.zeros(len(self.newton_step)))
        at = {k: j for j, k in enumerate(entries)}
        self.slides = {k: float(signs[at[m + i]]) or STICKS for i, k in enumerate(self.with_friction)
                       if m + i in at and closed[at[k]]}
        force = problem.forces @ x + problem.forces0
        return {k: float(force[j]) for k, j in at.items() if k < m and closed[j] != self.closed[k]}

    def step(self, found: dict[int, float]) -> Array:
        """Return the change of the unknowns (n_unknowns,)."""
        return self.whole_step


class _ContactProblem(NamedTuple):
    """Contact forces and their conjugates (gaps, slips), n of each, as functions of x (n,): ``forces`` x + ``forces0``
    and ``conjugates`` x + ``conjugates0``. ``tangential`` are numbers of friction forces, ``normal_of`` those of the
    normal forces of the same points, ``mu`` their coefficients, ``friction_states`` whether they stick or the signs of
    their sliding. x is the gap or slip where a point is ``closed`` (n,), and the force elsewhere."""

    forces: Array
    forces0: Array
    conjugates: Array
    conjugates0: Array
    tangential: Any
    normal_of: Any
    mu: Array
    closed: Any
    movable: Any
    stiffness: Array
    friction_states: Array

    @classmethod
    def of(cls, response: FrictionResponse, entries: list[int], columns: Array) -> _ContactProblem:
        """Return the problem for some entries of a response."""
        m, unit = len(response.closed), np.eye(len(entries))
        closed, at = response.closed_entries[entries], {k: j for j, k in enumerate(entries)}
        changes, b, slip = columns[entries], response.b[entries], response.initial_slip[entries]
        tangential = [j for j, k in enumerate(entries) if k >= m]
        which = [entries[j] - m for j in tangential]
        return cls(np.where(closed[:, None], changes, unit), np.where(closed, b, 0.0),
                   np.where(closed[:, None], unit, changes), np.where(closed, slip, b), np.array(tangential, dtype=int),
                   np.array([at[response.with_friction[i]] for i in which], dtype=int), response.mu[which], closed,
                   np.array([k < m and response.movable[k] for k in entries]),
                   np.array([response.stiffness[k] if k < m else 0.0 for k in entries]),
                   response.friction_states[which])

    def _compliance(self) -> Array:
        """Return the change of gaps and slips with the forces (n, n); bodies held by contact alone are held softly."""
        closed, free = np.flatnonzero(self.closed), np.flatnonzero(~self.closed)
        H = self.forces[np.ix_(closed, closed)]
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
        x = np.eye(len(self.forces0))
        x[np.ix_(closed, closed)] = inverse
        x[np.ix_(closed, free)] = -inverse @ self.forces[np.ix_(closed, free)]
        W: Array = self.conjugates @ x
        return W

    def complementary(self) -> tuple[Array, Array, Array, Array] | None:
        """Return normal forces (n - r,), friction forth and back (r,) and slips (r,), or None if Lemke's method
        fails."""
        n, r = len(self.forces0), len(self.tangential)
        W = self._compliance()
        offset = self.conjugates0 - W @ self.forces0
        normals = np.setdiff1d(np.arange(n), self.tangential)
        unit, zero, order = np.eye(r), np.zeros((r, r)), [*normals, *self.tangential]
        W, offset, n_n = W[np.ix_(order, order)], offset[order], len(normals)
        limit = np.zeros((r, n_n))
        limit[np.arange(r), np.searchsorted(normals, self.normal_of)] = self.mu
        slip = W[n_n:]
        M = np.block([[W[:n_n], -W[:n_n, n_n:], np.zeros((n_n, r))], [slip, -slip[:, n_n:], unit],
                      [-slip, slip[:, n_n:], unit], [limit, -unit, -unit, zero]])
        q = np.concatenate([offset[:n_n], offset[n_n:], -offset[n_n:], np.zeros(r)])
        own = np.diag(M).copy()
        own = np.maximum(own, DEPENDENT * own.max(initial=0.0))
        scale = 1.0 / np.sqrt(np.where(own > 0.0, own, 1.0))
        if r:
            scale[-r:] = 1.0 / scale[n_n:n_n + r]
        M, q = M * np.outer(scale, scale), q * scale
        z = lemke_from(M, q, self._current_basis(normals))
        if z is None:
            z = lemke(M, q)
        z = None if z is None else scale * z
        return None if z is None else (z[:n_n], z[n_n:n_n + r], z[n_n + r:n_n + 2 * r], z[n_n + 2 * r:])

    def _current_basis(self, normals: Any) -> Any:
        """Return which forces and slips of the problem are nonzero if all points keep their states."""
        closed, sticks = self.closed[self.tangential], self.friction_states == STICKS
        forth = np.where(closed & sticks, self.forces0[self.tangential] >= 0.0,
                         np.where(closed, self.friction_states > 0.0, self.conjugates0[self.tangential] <= 0.0))
        return np.concatenate([self.closed[normals], forth, ~forth, ~(closed & sticks)])

    def _redundant(self, closed: Any) -> list[int]:
        """Return the closed points that others already hold; of an element, those between its fixed points first."""
        W, out = self._compliance(), []
        for k in closed[np.argsort(self.movable[closed], kind="stable")].tolist():
            if W[k, k] * self.stiffness[k] < HELD_ALREADY:
                out.append(k)
            else:
                W = W - np.outer(W[:, k], W[k]) / W[k, k]
        return out

    def balanced(self, found: tuple[Array, Array, Array, Array]) -> tuple[Array, Any, Array]:
        """Return x (n,) for the set found, which entries are closed (n,), and signs of sliding friction (n,)."""
        n, (pressed, forth, back, slips) = len(self.forces0), found
        closed, signs = np.zeros(n, dtype=bool), np.zeros(n)
        closed[np.setdiff1d(np.arange(n), self.tangential)] = pressed > 0.0
        closed[self._redundant(np.flatnonzero(closed))] = False
        closed[self.tangential] = closed[self.normal_of]
        signs[self.tangential] = np.where(slips > 0.0, np.where(forth > back, 1.0, -1.0), 0.0)
        sticks = closed & (signs == 0.0)
        A = np.where(sticks[:, None], self.conjugates, self.forces)
        rhs = -np.where(sticks, self.conjugates0, self.forces0)
        share = np.where(closed[self.tangential], signs[self.tangential] * self.mu, 0.0)
        A[self.tangential] -= share[:, None] * self.forces[self.normal_of]
        rhs[self.tangential] += share * self.forces0[self.normal_of]
        size = np.abs(A).max(axis=1)
        size[size == 0.0] = 1.0
        return np.linalg.lstsq(A / size[:, None], rhs / size, rcond=None)[0], closed, signs
