"""Springs, loads that turn and constraints at points: a law of ``elements.point_laws`` over fields of coordinates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..elements.point_laws import DIRECTION, GROUND, MAX_MEM, POINT_LAWS, THETA
from ..elements.shape import Array
from ..errors import ComputationError
from .mesh import Index
from .points import PointRef, dot
from .signals import rates_of

LAWS = {law.name: law for law in POINT_LAWS}


@dataclass(frozen=True)
class Field:
    """A quantity p0 + sum of weights * d[coords]."""

    coords: Index
    weights: Array
    p0: float = 0.0


NOTHING = Field(np.zeros(0, dtype=np.int64), np.zeros(0))


def position_fields(point: PointRef, spread: str | None = None) -> list[Field]:
    """Return x and y of a point."""
    first = point.mesh.first_dof
    return [Field(*c, dot((c[0] - first, c[1]), point.mesh.e0)) for c in point.position(spread)]


def turn_fields(point: PointRef) -> tuple[int, list[Field]]:
    """Return how the section at a point turns, and the fields that tell: theta, or its direction along and across
    that of the reference."""
    if point.turns_by_theta:
        return THETA, [Field(*point.theta())]
    (x, y), angle = point.director()
    c, s = (0.0 if abs(v) < 1e-15 else v for v in (np.cos(angle), np.sin(angle)))
    coords = np.concatenate([x[0], y[0]])
    along, across = np.concatenate([c * x[1], s * y[1]]), np.concatenate([-s * x[1], c * y[1]])
    length = float(along @ point.mesh.e0[coords - point.mesh.first_dof])
    return DIRECTION, [Field(coords, along, length), Field(coords, across)]


def table_of(fields: Sequence[Field]) -> tuple[Index, Array, Array]:
    """Return the coordinates (n,) of some fields, the matrix (m, n) that gives them from d, and p0 (m,)."""
    used = [f.coords[f.weights != 0.0] for f in fields]
    coords = np.unique(np.concatenate(used)).astype(np.int64)
    G = np.zeros((len(fields), len(coords)))
    for row, field in zip(G, fields, strict=True):
        kept = field.weights != 0.0
        np.add.at(row, np.searchsorted(coords, field.coords[kept]), field.weights[kept])
    return coords, G, np.array([f.p0 for f in fields])


class PointPatch:
    """A law without multiplier: forces and stiffness along ``dofs`` (1, n); fields are p0 + G d[dofs[0]].

    ``par`` are the constants of the law, ``signal`` its amplitude (None: 1), ``fed`` the field that the signal
    prescribes (-1: none), ``mem`` the last angles of directions whose turns are counted, those of ``sections`` (None
    where nothing has to be counted); ``symmetric`` tells whether the stiffness is.
    """

    multiplier = -1
    scale = 1.0

    def __init__(self, law: str, fields: Sequence[Field], par: Sequence[float],
                 signal: Callable[[float], float] | None = None, fed: int = -1,
                 sections: Sequence[PointRef | None] = ()) -> None:
        self.law, self.par, self.signal, self.fed = LAWS[law], np.array(par, dtype=float), signal, fed
        coords, self.G, self.p0 = table_of(fields)
        self.dofs: Index = coords[None, :]
        self.mem, self.sections = np.zeros(MAX_MEM), tuple(sections)
        self.symmetric = self.law.symmetric

    @property
    def coordinates(self) -> Index:
        """Every full coordinate that the law acts on."""
        return self.dofs[0]

    @property
    def rows(self) -> Array:
        """The matrix that gives the fields from the coordinates."""
        return self.G

    def forces(self, u: Array, t: float, rates: Array | None = None) -> tuple[float, Array, Array]:
        """Return energy, f and H at fields p0 + u (m,) and their rates, at rest without; ``u`` gets the field that is
        prescribed."""
        m = len(self.p0)
        a = np.array([1.0 if self.signal is None else self.signal(t), 0.0, 0.0])
        if self.fed >= 0:
            u[self.fed] = a[0]
        f, H = np.zeros(m), np.zeros((m, m))
        v = np.zeros(m) if rates is None else rates
        U = self.law.forces(self.p0, u, v, self.par, a, self.mem, f, H, np.zeros((m, m)))
        return float(U), f, H

    def evaluate(self, e: Array, d: Array, t: float) -> tuple[float, Array, Array]:
        """Return energy, Q (1, n) and K (1, n, n)."""
        U, f, H = self.forces(self.G @ d[self.dofs[0]], t)
        return U, (self.G.T @ f)[None], (self.G.T @ H @ self.G)[None]

    def damping(self, d: Array) -> Array:
        """Return the matrix (n, n) of the forces that rates exert along the coordinates, at d (n_full,)."""
        u, m = self.G @ d[self.dofs[0]], len(self.p0)
        C = np.zeros((m, m))
        self.law.forces(self.p0, u, np.zeros(m), self.par, np.array([1.0, 0.0, 0.0]), self.mem, np.zeros(m),
                        np.zeros((m, m)), C)
        return np.asarray(self.G.T @ C @ self.G)


class PointConstraint(PointPatch):
    """A law g(d, t) = 0 with a multiplier, the last of its fields; ``dofs`` (n,) are the coordinates without it.

    ``owner`` is the support or joint it belongs to, ``holds`` what it holds, in words; ``scale`` the size of the terms
    of g. ``multiplier`` is the full coordinate of the multiplier, known once a model is numbered. ``facing`` tells from
    the fields by its sign whether two directions agree (None: there are none).
    """

    def __init__(self, law: str, fields: Sequence[Field], par: Sequence[float], owner: str, holds: str, scale: float,
                 signal: Callable[[float], float] | None = None, fed: int = -1,
                 facing: Callable[[Array], float] | None = None, sections: Sequence[PointRef | None] = ()) -> None:
        super().__init__(law, [*fields, NOTHING], par, signal, fed, sections)
        self.dofs = self.dofs[0]
        self.owner, self.holds, self.scale, self.facing = owner, holds, scale, facing

    @property
    def coordinates(self) -> Index:
        """Every full coordinate that the law acts on, the multiplier last."""
        return np.append(self.dofs, self.multiplier)

    @property
    def rows(self) -> Array:
        """The matrix that gives the fields from the coordinates, the multiplier last."""
        m, n = self.G.shape
        out = np.zeros((m, n + 1))
        out[:, :n], out[-1, -1] = self.G, 1.0
        return out

    def turns_by(self, t: float) -> list[tuple[PointRef, float]]:
        """Return the sections whose rotation is prescribed, whole turns included, with what it is at t."""
        if self.signal is None:
            return []
        return [(point, self.signal(t)) for point in self.sections if point is not None]

    def opposed(self, d: Array, t: float) -> bool:
        """Whether directions that should agree stand against each other at d (n_full,): g vanishes there too."""
        p = self.p0 + self.G @ d[self.dofs]
        if self.fed >= 0 and self.signal is not None:
            p[self.fed] = self.signal(t)
        return self.facing is not None and self.facing(p) < 0.0

    def evaluate(self, e: Array, d: Array, t: float) -> tuple[float, Array, Array]:
        """Return g, its gradient (n,) and Hessian (n, n) along ``dofs``."""
        u = self.G @ d[self.dofs]
        u[-1] = 1.0
        _, f, H = self.forces(u, t)
        g, f[-1] = float(f[-1]), 0.0
        H[-1], H[:, -1] = 0.0, 0.0
        return g, self.G.T @ f, self.G.T @ H @ self.G

    def rates(self, e: Array, d: Array, v: Array, t: float) -> tuple[float, float]:
        """Return g_t and v^T g_qq v + 2 g_qt v + g_tt at d with rates v (n_full,)."""
        u, w = self.G @ d[self.dofs], self.G @ v[self.dofs]
        u[-1], w[-1], fed = 1.0, 0.0, (0.0, 0.0)
        _, f, H = self.forces(u, t)
        if self.fed >= 0:
            fed = rates_of(self.signal, t)
            w[self.fed] = fed[0]
        return float(f[self.fed] * fed[0]), float(f[self.fed] * fed[1] + w @ H @ w)

    def slopes(self) -> Array:
        """Return dg/dp (m,) for the fields p in the reference, where nothing is prescribed yet."""
        u = np.zeros(len(self.p0))
        u[-1] = 1.0
        f, H = np.zeros_like(u), np.zeros((len(u), len(u)))
        self.law.forces(self.p0, u, np.zeros_like(u), self.par, np.zeros(3), self.mem, f, H, np.zeros_like(H))
        f[-1] = 0.0
        return f

    def reference_gradient(self) -> Array:
        """Return the gradient (n,) of g in the reference, where nothing is prescribed yet."""
        gradient: Array = self.G.T @ self.slopes()
        return gradient


class ConstraintBatch:
    """Constraints of one law over as many coordinates each, evaluated together."""

    def __init__(self, constraints: Sequence[PointConstraint]) -> None:
        self.law = constraints[0].law
        self.dofs: Index = np.stack([c.coordinates for c in constraints])
        self.G = np.stack([c.rows for c in constraints])
        self.p0 = np.stack([c.p0 for c in constraints], axis=1)
        self.par = np.stack([c.par for c in constraints], axis=1)
        self.fed = [(c.fed, k, c.signal) for k, c in enumerate(constraints) if c.signal is not None]

    def evaluate(self, d: Array, t: float, linear: bool = False) -> tuple[Array, Array]:
        """Return Q (m, n) and K (m, n, n) of lambda g along ``dofs`` (m, n), the multiplier last.

        ``linear``: g is that of linear theory, also in what is prescribed.
        """
        u = np.einsum("mfn,mn->fm", self.G, d[self.dofs])
        for field, k, signal in [] if linear else self.fed:
            u[field, k] = signal(t)
        f, H = np.zeros_like(u), np.zeros((len(u), *u.shape))
        self.law.forces(self.p0, u, np.zeros_like(u), self.par, np.zeros(3), np.zeros(MAX_MEM), f, H,
                        np.zeros_like(H))
        for field, k, signal in self.fed if linear else []:
            f[-1, k] += H[field, -1, k] * signal(t)
        Gt = self.G.transpose(0, 2, 1)
        return (Gt @ f.T[:, :, None])[:, :, 0], Gt @ H.transpose(2, 0, 1) @ self.G


def batches(constraints: Iterable[object]) -> list[ConstraintBatch]:
    """Return the constraints that are laws of points, those that are alike together."""
    alike: dict[tuple[str, tuple[int, ...]], list[PointConstraint]] = {}
    for c in constraints:
        if isinstance(c, PointConstraint):
            alike.setdefault((c.law.name, c.G.shape), []).append(c)
    return [ConstraintBatch(group) for group in alike.values()]


def turns(ends: Sequence[PointRef | None]) -> tuple[list[int], list[Field]]:
    """Return how each end turns and the fields of all; None is the ground."""
    kinds, fields = [], []
    for end in ends:
        kind, more = (GROUND, []) if end is None else turn_fields(end)
        kinds.append(kind)
        fields += more
    return kinds, fields


def check_facing(constraints: Iterable[object], d: Array, t: float) -> None:
    """Raise ComputationError where a section stands opposite to where a constraint holds it, at d (n_full,)."""
    for constraint in constraints:
        if isinstance(constraint, PointConstraint) and constraint.opposed(d, t):
            raise ComputationError(
                f"{constraint.owner}: the section points opposite to its prescribed direction because its element is "
                "inverted", at={"t": t},
                advice="smaller steps or a gentler motion, more elements there, or reissner3, whose sections cannot "
                       "collapse")
