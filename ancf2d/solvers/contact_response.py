"""Linear response of contact forces and gaps at an equilibrium, and the points that are closed according to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..elements.contact_geometry import AUGMENTATION, ON_ELEMENT
from ..elements.contact_sliding import compliance
from ..elements.shape import Array
from .complementarity import DEPENDENT, lemke, lemke_from
from .friction import sticking

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from ..interactions.contact import ContactPoint
    from ..model.contact_tables import ContactTable
    from .system import System

# pull, relative to the largest force, that counts as none
PULL = 1e-9
# compliance, relative to that of an element, below which other points already hold a point
HELD_ALREADY = 1e-10


def sparse_rows(columns: Sequence[Any], values: Sequence[Array], n: int) -> csr_array:
    """Return a matrix (m, n) with ``values`` (k,) of each row in its ``columns`` (k,); values in equal places add up.
    """
    from scipy.sparse import csr_array

    start = np.cumsum([0, *map(len, values)])
    return csr_array((np.concatenate([np.zeros(0), *values]),
                      np.concatenate([np.zeros(0, dtype=np.int64), *columns]), start), shape=(len(values), n))


class Candidate(NamedTuple):
    """A contact point that is closed or may have to close.

    ``gradient`` (n,) is that of its gap with respect to ``dofs`` (n,); a movable point is at ``place``. With friction,
    ``slip_gradient`` (n,) is that of its place on the obstacle, and ``slip`` its distance from its anchor.
    """

    contact: ContactTable
    k: int
    closed: bool
    dofs: Any
    gradient: Array
    gap: float
    place: float = 0.0
    feature: float = -1.0
    slip_gradient: Array | None = None
    slip: float = 0.0

    @property
    def compliance(self) -> float:
        """Compliance of an open movable point beyond that of its element's polynomial."""
        free = self.contact.pair.spots[self.k].free
        if self.closed or not free or self.contact.placement_at(self.k, self.feature) == ON_ELEMENT:
            return 0.0
        return compliance(self.point.par, self.place)[0]

    @property
    def point(self) -> ContactPoint:
        """The point whose multiplier is the force; for a movable place, before a free point is chosen."""
        return self.contact.points[self.k]


class Response:
    """Linear response at a state: changes of the forces of closed points and of the gaps of open ones.

    With ``stuck``, sliding points stick in the tangent. ``newton_step`` (n_unknowns,) leads to balance if nothing opens
    or closes; ``b`` (m,) are forces and gaps after it.
    """

    def __init__(self, system: System, d: Array, t: float, candidates: list[Candidate], stuck: bool) -> None:
        self.num = system.model.numbering
        with sticking(system.model.contact_tables if stuck else (), d, t):
            balance = system.assemble(d, t)
            pivots = system.factor({"factor": float(f"{t:.6g}")})
        self.solve = system.response(d, t)
        self.unstable = system.knows_inertia and pivots.negative > self.num.n_multipliers
        self.newton_step: Array = -self.solve(balance.R.copy())
        self.closed = np.array([s.closed for s in candidates])
        self.gradients = sparse_rows([s.dofs for s in candidates], [s.gradient for s in candidates],
                                     len(self.num.place))
        self.multiplier_rows = self.num.place[[s.point.multiplier for s in candidates]]
        self.force = np.array([-d[s.point.multiplier] if s.closed else 0.0 for s in candidates])
        self.compliance = [s.compliance for s in candidates]
        self.stiffness = np.array([s.point.par[AUGMENTATION] for s in candidates])
        self.b = np.where(self.closed, self.force, [s.gap for s in candidates]) + self.changes(self.newton_step)
        self.steps: dict[int, Array] = {}
        # friction state (slides, with its sign, or sticks) of candidates after the change
        self.slides: dict[int, float] = {}

    def changes(self, z: Array) -> Array:
        """Return the changes of forces of closed points and gaps of open ones (m,) for a change z of the unknowns."""
        full = np.zeros(len(self.num.place))
        self.num.expand(z, full)
        return np.where(self.closed, -z[self.multiplier_rows], self.gradients @ full)

    def unit_response(self, k: int) -> Array:
        """Return the changes (m,) if the closed point k opens by 1, or if a force of 1 acts on the open point k."""
        rhs = np.zeros(len(self.newton_step))
        if self.closed[k]:
            rhs[self.multiplier_rows[k]] = 1.0
        else:
            rhs = self._reduced(self.gradients, k)
        self.steps[k] = self.solve(rhs).copy()
        out = self.changes(self.steps[k])
        out[k] += self.compliance[k]
        return out

    def _reduced(self, rows: csr_array, k: int) -> Array:
        """Return row k of forces in full coordinates as forces on the unknowns (n_unknowns,)."""
        return self.num.reduce(rows[[k]].toarray()[0], np.zeros(len(self.num.place)))

    def complementary_changes(self, limit: float) -> dict[int, float] | None:
        """Return, by number, openings of closed points and forces on open ones that make the state complementary.

        Points that others hold already close only if they stay deeper than ``limit``: some of the others then open.
        None if there is no such state nearby.
        """
        found, deep = self._changes(limit, HELD_ALREADY)
        exchanged = self._changes(limit, -HELD_ALREADY)[0] if deep else None
        return found if exchanged is None else exchanged

    def _changes(self, limit: float, least: float) -> tuple[dict[int, float] | None, bool]:
        """Return the changes without open points whose compliance relative to the element's is less than ``least``, and
        whether one of these stays deeper than ``limit``.

        Start from the points that pull or penetrate by more than ``limit``, and add those that violate the conditions
        then.
        """
        size = np.where(self.closed, PULL * np.abs(self.force).max(initial=0.0), limit)
        working: list[int] = []
        already_held: list[int] = []
        responses: list[Array] = []
        w, z = self.b, np.zeros(0)
        while new := sorted({*np.flatnonzero(w < -size).tolist()} - {*working, *already_held}):
            for k in new:
                response = self.unit_response(k)
                if not self.closed[k] and response[k] * self.stiffness[k] < least:
                    already_held.append(k)
                    continue
                responses.append(response)
                working.append(k)
            if working:
                columns = np.column_stack(responses)
                solved = self._solve(columns[working], np.array(working), z)
                if solved is None:
                    return None, False
                z = solved
                w = self.b + columns @ z
        found = {k: float(a) for k, a in zip(working, z, strict=True) if a > 0.0}
        # a force on an open point that pulls it into the obstacle: no other point holds it
        pulled_in = any(self.changes(self.steps[k])[k] * self.stiffness[k] < -HELD_ALREADY for k in already_held)
        deep = bool((w[already_held] < -limit).any())
        return (None, False) if pulled_in and not found else (found, deep)

    def _solve(self, M: Array, working: Any, before: Array) -> Array | None:
        """Return the changes (m,) of the points ``working`` that are complementary; ``before`` are those of the first.
        """
        # stiffnesses and compliances, each relative to the largest of its kind
        own, of_closed = np.abs(np.diag(M)), self.closed[working]
        most = np.where(of_closed, own[of_closed].max(initial=0.0), own[~of_closed].max(initial=0.0))
        scale: Array = 1.0 / np.sqrt(np.maximum(own, DEPENDENT * most))
        problem = M * np.outer(scale, scale), self.b[working] * scale
        start = np.append(before, np.zeros(len(working) - len(before))) > 0.0
        z = lemke_from(*problem, start) if start.any() else None
        z = lemke(*problem) if z is None else z
        return None if z is None else scale * z

    def step(self, found: dict[int, float]) -> Array:
        """Return the change of the unknowns (n_unknowns,) for these openings and forces."""
        return self.newton_step + sum((a * self.steps[k] for k, a in found.items()), np.zeros(len(self.newton_step)))
