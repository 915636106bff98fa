"""Linear response of contact forces and gaps at an equilibrium, and the points that are closed according to it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..elements.contact_geometry import AUGMENTATION, ON_ELEMENT
from ..elements.contact_sliding import compliance
from ..elements.shape import Array
from .complementarity import DEPENDENT, lemke
from .friction import sticking

if TYPE_CHECKING:
    from ..interactions.contact import ContactPoint
    from ..model.contact_tables import ContactTable
    from .system import System

# pull, relative to the largest force, that counts as none
PULL = 1e-9
# compliance, relative to that of an element, below which other points already hold a point
HELD_ALREADY = 1e-10


class Spot(NamedTuple):
    """A contact point that is closed or may have to close.

    ``row`` (n,) is the gradient of its gap with respect to ``dofs`` (n,); a movable point is at ``place``. With
    friction, ``slope`` (n,) is the gradient of its place on the obstacle, and ``way`` its distance from its anchor.
    """

    one: ContactTable
    k: int
    held: bool
    dofs: Any
    row: Array
    gap: float
    place: float = 0.0
    feature: float = -1.0
    slope: Array | None = None
    way: float = 0.0

    @property
    def soft(self) -> float:
        """Compliance of an open movable point beyond that of its element's polynomial."""
        free = self.one.pair.spots[self.k].free
        if self.held or not free or self.one.placement_at(self.k, self.feature) == ON_ELEMENT:
            return 0.0
        return compliance(self.point.par, self.place)[0]

    @property
    def point(self) -> ContactPoint:
        """The point whose multiplier is the force; for a movable place, before a free point is chosen."""
        return self.one.points[self.k]


class Response:
    """Linear response at a state: changes of the forces of closed points and of the gaps of open ones.

    With ``stuck``, sliding points stick in the tangent. ``base`` (n_unknowns,) is the Newton step to balance if nothing
    opens or closes; ``b`` (m,) are forces and gaps after it.
    """

    def __init__(self, system: System, d: Array, t: float, spots: list[Spot], stuck: bool) -> None:
        self.num = system.model.numbering
        with sticking(system.model.contact_tables if stuck else (), d, t):
            balance = system.assemble(d, t)
            pivots = system.factor({"factor": float(f"{t:.6g}")})
        self.solve = system.answers(d, t)
        self.unstable = system.knows_inertia and pivots.negative > self.num.n_multipliers
        self.base: Array = -self.solve(balance.R.copy())
        self.held = np.array([s.held for s in spots])
        self.rows = np.zeros((len(spots), len(self.num.place)))
        for row, s in zip(self.rows, spots, strict=True):
            np.add.at(row, s.dofs, s.row)
        self.at = self.num.place[[s.point.multiplier for s in spots]]
        self.force = np.array([-d[s.point.multiplier] if s.held else 0.0 for s in spots])
        self.soft = [s.soft for s in spots]
        self.stiff = np.array([s.point.par[AUGMENTATION] for s in spots])
        self.b = np.where(self.held, self.force, [s.gap for s in spots]) + self.told(self.base)
        self.steps: dict[int, Array] = {}
        # friction state (slides, with its sign, or sticks) of spots after the change
        self.slides: dict[int, float] = {}

    def told(self, z: Array) -> Array:
        """Return the changes of forces of closed points and gaps of open ones (m,) for a change z of the unknowns."""
        full = np.zeros(len(self.num.place))
        self.num.expand(z, full)
        return np.where(self.held, -z[self.at], self.rows @ full)

    def answer(self, k: int) -> Array:
        """Return the changes (m,) if the closed point k opens by 1, or if a force of 1 acts on the open point k."""
        rhs = np.zeros(len(self.base))
        if self.held[k]:
            rhs[self.at[k]] = 1.0
        else:
            rhs = self._reduced(self.rows[k])
        self.steps[k] = self.solve(rhs).copy()
        out = self.told(self.steps[k])
        out[k] += self.soft[k]
        return out

    def _reduced(self, full: Array) -> Array:
        return self.num.reduce(full, np.zeros(len(self.num.place)))

    def settled(self, limit: float) -> dict[int, float] | None:
        """Return, by number, openings of closed points and forces on open ones that make the state complementary.

        Start from the points that pull or penetrate by more than ``limit``, and add those that violate the conditions
        then. None if there is no such state nearby.
        """
        size = np.where(self.held, PULL * np.abs(self.force).max(initial=0.0), limit)
        working: list[int] = []
        passed: list[int] = []
        answers = np.zeros((len(self.b), 0))
        w, z = self.b, np.zeros(0)
        while new := [k for k in np.flatnonzero(w < -size).tolist() if k not in working + passed]:
            for k in new:
                answer = self.answer(k)
                if not self.held[k] and answer[k] * self.stiff[k] < HELD_ALREADY:
                    passed.append(k)
                    continue
                answers = np.column_stack([answers, answer])
                working.append(k)
            if working:
                solved = self._complementary(answers[working], np.array(working))
                if solved is None:
                    return None
                z = solved
                w = self.b + answers @ z
        found = {k: float(a) for k, a in zip(working, z, strict=True) if a > 0.0}
        # a force on an open point that pulls it into the obstacle: no other point holds it
        pulled_in = any(self.told(self.steps[k])[k] * self.stiff[k] < -HELD_ALREADY for k in passed)
        return None if pulled_in and not found else found

    def _complementary(self, M: Array, working: Any) -> Array | None:
        # stiffnesses and compliances, each relative to the largest of its kind
        own, closed = np.abs(np.diag(M)), self.held[working]
        most = np.where(closed, own[closed].max(initial=0.0), own[~closed].max(initial=0.0))
        scale: Array = 1.0 / np.sqrt(np.maximum(own, DEPENDENT * most))
        z = lemke(M * np.outer(scale, scale), self.b[working] * scale)
        return None if z is None else scale * z

    def step(self, found: dict[int, float]) -> Array:
        """Return the change of the unknowns (n_unknowns,) for these openings and forces."""
        return self.base + sum((a * self.steps[k] for k, a in found.items()), np.zeros(len(self.base)))
