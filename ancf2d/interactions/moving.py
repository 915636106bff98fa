"""Forces, masses and springs at points that move along bodies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..case import Active, Case, Latch
from ..elements.point_laws import MAX_MEM, PointLaw
from ..elements.shape import Array
from ..elements.sliding import OFF, Moving
from ..model.breakpoints import breakpoints
from ..model.mesh import BodyMesh, Index
from ..model.point_patch import Field, Items, table_of
from ..model.timing import Signal, TimeFunction, rates_of
from .prismatic import axis_coefficients

# tolerance in S for the ends of a body
NEAR = 1e-12


def constant_force(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """A force of constant direction; par: fx, fy."""
    f[0], f[1] = -a[0] * par[0], -a[0] * par[1]
    return 0.0, 0.0


def carried(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """Inertia forces of a mass that moves along a body, except m S^T S q''; par: m; a: s and its rates.

    Fields: r, r_s and r_ss. The acceleration of the mass is r_tt + 2 s' r_st + s'' r_s + s'^2 r_ss.
    """
    m, v, v2 = par[0], a[1], a[2]
    for c in range(2):
        f[c] = m * (2.0 * v * w[2 + c] + v2 * (p0[2 + c] + u[2 + c]) + v * v * (p0[4 + c] + u[4 + c]))
        H[c, 2 + c], H[c, 4 + c], C[c, 2 + c] = m * v2, m * v * v, 2.0 * m * v
    return 0.0, 0.0


def _refused(*_: Any) -> Any:
    raise NotImplementedError


FORCE = PointLaw("constant_force", constant_force, _refused)
MASS = PointLaw("carried_mass", carried, _refused, symmetric=False)


class MovingPatch:
    """A law at a point that moves along a body; its first two fields are base + sign r(s(t)), plus those of ``others``.

    ``course`` is s over time, ``signal`` the amplitude of the law, ``mass`` the moving mass, ``dofs`` (elements, n) the
    coordinates that it acts on together. It acts while 0 <= s <= 1.
    """

    multiplier, fed, scale, symmetric = -1, -1, 1.0, False
    # when it acts, None for always; see ``PointPatch``
    active: Active | Latch | None = None
    breaks: Sequence[int] = ()
    # whether it is the weight of a mass
    gravity = False

    def __init__(self, mesh: BodyMesh, course: TimeFunction, law: PointLaw, par: Sequence[float],
                 signal: TimeFunction | None,
                 mass: float = 0.0, sign: float = 1.0, others: Sequence[Field] = (), stretches: bool = False) -> None:
        self.mesh, self.course, self.law, self.signal = mesh, course, law, signal
        self.par, self.mass, self.sign, self.stretches = np.array(par, dtype=float), mass, sign, stretches
        self.derivatives = 2 if law is MASS else 0
        self.coords, self.G, self.base = table_of(others) if others else (np.zeros(0, np.int64), np.zeros((2, 0)),
                                                                          np.zeros(2))
        self.own: Index = mesh.dofs.reshape(len(mesh.dofs), -1, mesh.plan.element.components)[:, :, :2]
        n = len(mesh.dofs)
        self.dofs: Index = np.hstack([self.own.reshape(n, -1), np.broadcast_to(self.coords, (n, len(self.coords)))])

    @cached_property
    def nodes(self) -> Array:
        """The positions S of the starts of all elements, and of the end."""
        return np.append(self.mesh.starts / self.mesh.plan.length, 1.0)

    def element(self, t: float) -> int:
        """Return the element that the point is on at time t, or OFF if it is off the body or does not act."""
        return OFF if self.active is not None and not self.active.at(t) else self.under(t)

    def under(self, t: float) -> int:
        """Return the element that the point is on at time t, acting or not, or OFF if it is off the body."""
        s = self.course(t)
        if not -NEAR <= s <= 1.0 + NEAR:
            return OFF
        return int(np.clip(np.searchsorted(self.nodes, s, side="right") - 1, 0, len(self.nodes) - 2))

    def _fields_at(self, m: int, t: float) -> tuple[float, Array, Array, Array]:
        """Return xi in element m, the matrix from its coordinates to the fields, p0 and the constants at time t."""
        n, fields = self.dofs.shape[1], 2 * (1 + self.derivatives)
        G, p0, par = np.zeros((fields, n)), np.zeros(fields), self.par.copy()
        shape, length = self.mesh.classes[self.mesh.cls[m]].shape, self.mesh.plan.length
        s = min(max(self.course(t), 0.0), 1.0)
        xi = (s - self.nodes[m]) * length / float(self.mesh.lengths[m])
        local = self.mesh.e0[self.own[m] - self.mesh.first_dof]
        own = 2 * len(self.own[m])
        for order in range(1 + self.derivatives):
            # shape functions are differentiated by the arc length, fields by S
            row = self.sign * shape(np.array([xi]), np.zeros(1), order, 0)[0] * length**order
            for c in range(2):
                G[2 * order + c, c:own:2] = row
                p0[2 * order + c] = row @ local[:, c]
        G[:2, own:] = self.G
        p0[:2] += self.base
        if self.stretches:
            par[1] = math.hypot(*p0[:2])
        return xi, G, p0, par

    def items(self) -> Items:
        """Return the law at its point at t = 0 as point items."""
        m = self.element(0.0)
        _, G, p0, par = self._fields_at(max(m, 0), 0.0)
        return Items(self.law, self.dofs[max(m, 0)][None], G[None], p0[None], par[None], np.zeros((1, MAX_MEM)),
                     self.signal, on=m != OFF, stays=False)

    def acting(self, m: int, t: float, d: Array, v: Array, a: Array) -> tuple[float, Array]:
        """Return xi in element m and the forces (n_dof,) on its coordinates at t, d and rates v and a (n_full,)."""
        xi, G, p0, par = self._fields_at(m, t)
        dofs, k = self.dofs[m], len(p0)
        _, rate, _ = _jet(self.course, t)
        f, H, C, w = np.zeros(k), np.zeros((k, k)), np.zeros((k, k)), G @ v[dofs]
        if self.derivatives == 0:
            own = self.mesh.classes[self.mesh.cls[m]].shape(np.array([xi]), np.zeros(1), 1, 0)[0]
            e = self.mesh.e0[self.own[m] - self.mesh.first_dof] + d[self.own[m]]
            w[:2] += rate * self.sign * self.mesh.plan.length * (own @ e)
        self.law.forces(p0, G @ d[dofs], w, par, np.array(_jet(self.signal, t)), np.zeros(MAX_MEM), f, H, C)
        f[:2] += self.mass * (G[:2] @ a[dofs])
        full = np.zeros(len(d))
        np.add.at(full, dofs, -(G.T @ f))
        return xi, full[self.mesh.dofs[m]]

    def carried(self, d: Array, v: Array, t: float) -> tuple[float, Array, Array]:
        """Return mass, position and velocity (2,) of the moving mass at d and rates v (n_full,); zeros off the body."""
        m = self.element(t) if self.mass else OFF
        if m == OFF:
            return 0.0, np.zeros(2), np.zeros(2)
        _, G, p0, _ = self._fields_at(m, t)
        r = p0 + G @ d[self.dofs[m]]
        return self.mass, r[:2], (G @ v[self.dofs[m]])[:2] + rates_of(self.course, t)[0] * r[2:4]

    def potential(self, d: Array, t: float) -> float:
        """Return the potential of a constant weight at d (n_full,), relative to its position in the reference at t = 0.

        It is 0 off the body; for a weight that enters later, the reference is the end of the body at which it starts.
        """
        m = self.element(t)
        if m == OFF:
            return 0.0
        _, G, p0, par = self._fields_at(m, t)
        plan, begins = self.mesh.plan, min(max(self.course(0.0), 0.0), 1.0)
        return -float(par @ (p0 + G @ d[self.dofs[m]] - plan.position(begins)[0]))

    def crossings(self, times: Sequence[float]) -> list[float]:
        """Return the times at which the point enters another element; s is smooth between the given times."""
        out: list[float] = []
        for a, b in pairwise(times):
            t = _inside(a, b)
            s = np.array([self.course(x) for x in t.tolist()])
            for node in self.nodes.tolist():
                off = np.flatnonzero(s != node)
                above = s[off] > node
                for k in np.flatnonzero(above[1:] != above[:-1]):
                    out.append(_root(self.course, node, float(t[off[k]]), float(t[off[k + 1]])))
        return sorted(out)


def _jet(course: TimeFunction | None, t: float) -> tuple[float, float, float]:
    """Return the value of a signal and its first two rates at t; 1, 0, 0 for no signal."""
    return (1.0, 0.0, 0.0) if course is None else (course(t), *rates_of(course, t))


_NONE: NDArray[Any] = np.zeros(0)
# number of times between two breaks of a course at which it is sampled
SAMPLES = 1000


def _inside(a: float, b: float) -> Array:
    """Return sampling times between two breaks of a course, from just after the first to just before the second."""
    t = np.linspace(a, b, SAMPLES + 2)
    t[[0, -1]] = a + 1e-9 * (b - a), b - 1e-9 * (b - a)
    return t


def _root(course: TimeFunction, value: float, a: float, b: float) -> float:
    """Return the time between a and b at which a course crosses a value, by bisection to the last digit."""
    below = course(a) < value
    while True:
        middle = a + 0.5 * (b - a)
        if not a < middle < b:
            return b
        if (course(middle) < value) == below:
            a = middle
        else:
            b = middle


def moving_table(patches: Iterable[Any], row: Callable[[Any], int], fixed: Array) -> Moving:
    """Return the table of the moving point laws among the patches of a model, in their order.

    ``row`` gives the row of a signal, ``fixed`` is the mass matrix without them.
    """
    found: list[tuple[int, MovingPatch]] = []
    at = 0
    for patch in patches:
        if isinstance(patch, MovingPatch):
            found.append((at, patch))
        at += len(patch.items().p0)
    bodies: dict[str, tuple[int, int]] = {}
    starts, lengths, coef_first, coefs, dofs = ([_NONE] for _ in range(5))
    size = [0, 0, 0]
    for _, patch in found:
        mesh = patch.mesh
        if mesh.plan.name not in bodies:
            first, coef = axis_coefficients(mesh)
            bodies[mesh.plan.name] = size[0], size[1]
            starts.append(patch.nodes[:-1])
            lengths.append(mesh.lengths / mesh.plan.length)
            coef_first.append(first + size[2])
            coefs.append(coef)
            dofs.append(patch.own.ravel())
            size = [size[0] + len(mesh.dofs), size[1] + patch.own[:, :, 0].size, size[2] + len(coef)]

    def of(value: Callable[[MovingPatch], float], kind: Any = np.int64) -> Any:
        return np.array([value(p) for _, p in found], dtype=kind)

    def joined(parts: list[Any], kind: Any = np.float64) -> Any:
        return np.concatenate(parts).astype(kind)
    return Moving(np.array([k for k, _ in found], dtype=np.int64), of(lambda p: p.mass, float),
                  of(lambda p: row(p.course)), of(lambda p: p.sign, float),
                  np.array([p.base for _, p in found]).reshape(-1, 2), of(lambda p: p.derivatives),
                  of(lambda p: p.stretches), of(lambda p: p.element(0.0)),
                  of(lambda p: bodies[p.mesh.plan.name][0]), joined(starts), joined(lengths),
                  joined(coef_first, np.int64), of(lambda p: p.mesh.plan.element.n_shape),
                  of(lambda p: p.mesh.plan.element.degree_x + 1), joined(coefs),
                  of(lambda p: bodies[p.mesh.plan.name][1]), joined(dofs, np.int64).reshape(-1, 2),
                  fixed if any(p.mass > 0.0 for _, p in found) else np.zeros(0))


def moving_force(mesh: BodyMesh, course: TimeFunction, value: Sequence[float], signal: TimeFunction | None
                 ) -> MovingPatch:
    """Return a force of constant direction, ``signal`` times ``value``, at a point that moves along a body."""
    return MovingPatch(mesh, course, FORCE, value, signal)


def off_body_warnings(case: Case) -> list[str]:
    """Return a warning for each moving point of a motion that is never on its body."""
    out = []
    for where, at in case.moving_points.items():
        course, t_end = Signal(at.s), case.solver.end
        ends = [0.0, *(b.t for b in breakpoints(course, 0.0, t_end)), t_end]
        s = [np.array([course(x) for x in _inside(a, b).tolist()]) for a, b in pairwise(ends)]
        # between two breaks a continuous course passes everything between its values
        if all((x > 1.0 + NEAR).all() or (x < -NEAR).all() for x in s):
            least, most = min(x.min() for x in s), max(x.max() for x in s)
            out.append(f"{where}: s is between {least:.6g} and {most:.6g} up to t = {t_end:g} and the point is never "
                       f"on {at.on}, so it has no effect (it acts while 0 <= s <= 1)")
    return out


def moving_mass(mesh: BodyMesh, course: TimeFunction, mass: float) -> MovingPatch:
    """Return a mass at a point that moves along a body."""
    return MovingPatch(mesh, course, MASS, [mass], course, mass=mass)
