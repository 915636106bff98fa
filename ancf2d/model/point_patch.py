"""Springs, turning loads and constraints at points: a law (``elements.point_laws``) on fields of coordinates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..case import Active, Latch, jets
from ..case.programs import state_programs
from ..case.syntax import Tree
from ..elements.point_laws import DIRECTION, FORMULA_RECORDS, GROUND, MAX_MEM, RUN, THETA, PointLaw
from ..elements.shape import Array
from ..errors import ComputationError
from .mesh import Index
from .points import PointRef, dot

# each formula record by its address, with the texts of the formulas and the names of the quantities
_FORMULA_TEXTS: dict[float, tuple[Any, Sequence[str], Sequence[str]]] = {}


@dataclass(frozen=True)
class Field:
    """A quantity p0 + sum of weights * d[coords]."""

    coords: Index
    weights: Array
    p0: float = 0.0

    def scaled(self, factor: float) -> Field:
        """Return the field times a factor."""
        return Field(self.coords, factor * self.weights, factor * self.p0)

    def __add__(self, other: Field) -> Field:
        """Return the sum of two fields."""
        return Field(np.concatenate([self.coords, other.coords]), np.concatenate([self.weights, other.weights]),
                     self.p0 + other.p0)


NOTHING = Field(np.zeros(0, dtype=np.int64), np.zeros(0))


def constant_field(value: float) -> Field:
    """Return a field that depends on no coordinate."""
    return Field(NOTHING.coords, NOTHING.weights, value)


def position_fields(point: PointRef, spread: str | None = None) -> list[Field]:
    """Return the fields x and y of a point."""
    first = point.mesh.first_dof
    return [Field(*c, dot((c[0] - first, c[1]), point.mesh.e0)) for c in point.position(spread)]


def turn_fields(point: PointRef) -> tuple[int, list[Field]]:
    """Return how the section at a point turns, and its fields: theta, or the components of its direction along and
    across the reference direction."""
    if point.turns_by_theta:
        return THETA, [Field(*point.theta())]
    (x, y), angle = point.director()
    c, s = (0.0 if abs(v) < 1e-15 else v for v in (np.cos(angle), np.sin(angle)))
    coords = np.concatenate([x[0], y[0]])
    along, across = np.concatenate([c * x[1], s * y[1]]), np.concatenate([-s * x[1], c * y[1]])
    length = float(along @ point.mesh.e0[coords - point.mesh.first_dof])
    return DIRECTION, [Field(coords, along, length), Field(coords, across)]


def table_of(fields: Sequence[Field]) -> tuple[Index, Array, Array]:
    """Return the coordinates (n,) of some fields, the matrix (m, n) from d to the fields, and p0 (m,)."""
    used = [f.coords[f.weights != 0.0] for f in fields]
    coords = np.unique(np.concatenate(used)).astype(np.int64)
    G = np.zeros((len(fields), len(coords)))
    for row, field in zip(G, fields, strict=True):
        kept = field.weights != 0.0
        np.add.at(row, np.searchsorted(coords, field.coords[kept]), field.weights[kept])
    return coords, G, np.array([f.p0 for f in fields])


class Items(NamedTuple):
    """A law for m sets of n coordinates each, in the layout of tables.

    dofs : (m, n); G : (m, fields, n); p0 : (m, fields); par : (m, constants); mem : (m, numbers); signal : its signal
    or up to three; fed : the fields that these prescribe; multiplier, scale : as of ``PointConstraint``; on : whether
    the sets act; restitution : share of the gap rate after an impact (nan: a contact with a law; -1: no contact); runs
    : (m,) number of sets, from each on, with the same fields, or None if no two have the same; stays : whether G is
    constant.
    """

    law: PointLaw
    dofs: Index
    G: Array
    p0: Array
    par: Array
    mem: Array
    signal: Any = None
    fed: int | tuple[int, ...] = -1
    multiplier: int = -1
    scale: float = 1.0
    on: bool = True
    restitution: float = -1.0
    runs: Index | None = None
    stays: bool = True


class PointPatch:
    """A law without multiplier: forces and stiffness along ``dofs`` (1, n); fields are p0 + G d[dofs[0]].

    ``par`` are the constants of the law, ``signal`` its amplitude (None: 1), ``fed`` the field that the signal
    prescribes (-1: none). ``mem`` has the last angles of the directions of ``sections`` (None: no turns to count).
    ``symmetric``: whether the stiffness is symmetric.
    """

    multiplier = -1
    scale = 1.0
    # when it acts (None: always); first numbers of runs of items that are unilateral or have a gap (0: all items)
    active: Active | Latch | None = None
    breaks: Sequence[int] = ()
    # the path in the case of the spring or tendon that it is
    path = ""
    # the points of bodies at which it acts, with the fields of each, where they are known separately
    ends: Sequence[tuple[PointRef, Sequence[Field]]] = ()

    def __init__(self, law: PointLaw, fields: Sequence[Field], par: Sequence[float],
                 signal: Callable[[float], float] | None = None, fed: int = -1,
                 sections: Sequence[PointRef | None] = ()) -> None:
        self.law = law
        self.par, self.signal, self.fed = np.array(par, dtype=float), signal, fed
        coords, self.G, self.p0 = table_of(fields)
        self.dofs: Index = coords[None, :]
        self.mem, self.sections = np.zeros(MAX_MEM), tuple(sections)
        self.symmetric = self.law.symmetric

    @property
    def coordinates(self) -> Index:
        """All full coordinates that the law acts on."""
        return self.dofs[0]

    @property
    def rows(self) -> Array:
        """The matrix from the coordinates to the fields."""
        return self.G

    def items(self) -> Items:
        """Return the law in the layout of tables."""
        return Items(self.law, self.coordinates[None], self.rows[None], self.p0[None], self.par[None], self.mem[None],
                     self.signal, self.fed, self.multiplier, self.scale)

    def keep_in(self, par: Array, mem: Array, at: int) -> None:
        """Replace ``par`` and ``mem`` by row ``at`` of tables."""
        self.par, self.mem = par[at], mem[at]

    def forces(self, u: Array, t: float, rates: Array | None = None) -> tuple[Array, Array, Array]:
        """Return f, H and C at fields p0 + u (m,) and their rates (default 0); set the prescribed field in ``u``."""
        m = len(self.p0)
        a = np.array([1.0 if self.signal is None else self.signal(t), 0.0, 0.0])
        if self.fed >= 0:
            u[self.fed] = a[0]
        f, H, C = np.zeros(m), np.zeros((m, m)), np.zeros((m, m))
        v = np.zeros(m) if rates is None else rates
        self.law.forces(self.p0, u, v, self.par, a, self.mem, f, H, C)
        return f, H, C

    def at_ends(self, wanted: Callable[[PointRef], bool], d: Array, v: Array | None, t: float,
                linear: bool = False) -> Iterator[tuple[PointRef, Array]]:
        """Yield the wanted points of ``ends`` and the forces (n_q,) exerted there at d (n_q,) with rates v.

        With ``linear``, the forces are linearised about the reference.
        """
        ends = [(point, fields) for point, fields in self.ends if wanted(point)]
        if not ends or (self.active is not None and not self.active.at(t)):
            return
        u = self.G @ d[self.dofs[0]]
        rates = np.zeros_like(u) if v is None else self.G @ v[self.dofs[0]]
        f, H, _ = self.forces(np.zeros_like(u) if linear else u, t, rates)
        if linear:
            f = f + H @ u
        for point, fields in ends:
            coords, G, _ = table_of(fields)
            full = np.zeros_like(d)
            full[coords] = -(G.T @ f)
            yield point, full

    def reference_stiffness(self) -> Array:
        """Return the stiffness (n, n) along the coordinates in the reference."""
        _, H, _ = self.forces(np.zeros(len(self.p0)), 0.0)
        return np.asarray(self.G.T @ H @ self.G)


class PointConstraint(PointPatch):
    """A law g(d, t) = 0 with a multiplier, the last of its fields; ``dofs`` (n,) are the coordinates without it.

    ``owner`` is the support or joint that it belongs to, ``holds`` says in words what it holds; ``scale`` is the size
    of the terms of g. ``multiplier`` is the full coordinate of the multiplier, set when the model is numbered.
    ``facing`` is a function of the fields, positive where two directions agree (None: there are none).
    """

    def __init__(self, law: PointLaw, fields: Sequence[Field], par: Sequence[float], owner: str, holds: str,
                 scale: float, signal: Callable[[float], float] | None = None, fed: int = -1,
                 facing: Callable[[Array], float] | None = None, sections: Sequence[PointRef | None] = ()) -> None:
        super().__init__(law, [*fields, NOTHING], par, signal, fed, sections)
        self.dofs = self.dofs[0]
        self.owner, self.holds, self.scale, self.facing = owner, holds, scale, facing

    @property
    def coordinates(self) -> Index:
        """All full coordinates that the law acts on, the multiplier last."""
        return np.append(self.dofs, self.multiplier)

    @property
    def rows(self) -> Array:
        """The matrix from the coordinates to the fields, the multiplier last."""
        m, n = self.G.shape
        out = np.zeros((m, n + 1))
        out[:, :n], out[-1, -1] = self.G, 1.0
        return out

    def turns_by(self, t: float) -> list[tuple[PointRef, float]]:
        """Return the sections whose rotation is prescribed and their rotations at t, including full turns."""
        if self.signal is None:
            return []
        return [(point, self.signal(t)) for point in self.sections if point is not None]

    def opposed(self, d: Array, t: float) -> bool:
        """Return whether directions that should agree are opposite at d (n_full,); g vanishes there, too."""
        p = self.p0 + self.G @ d[self.dofs]
        if self.fed >= 0 and self.signal is not None:
            p[self.fed] = self.signal(t)
        return self.facing is not None and self.facing(p) < 0.0

    def slopes(self) -> Array:
        """Return dg/dp (m,) for the fields p in the reference, before any prescribed motion."""
        u = np.zeros(len(self.p0))
        u[-1] = 1.0
        f, H = np.zeros_like(u), np.zeros((len(u), len(u)))
        self.law.forces(self.p0, u, np.zeros_like(u), self.par, np.zeros(3), self.mem, f, H, np.zeros_like(H))
        f[-1] = 0.0
        return f

    def reference_gradient(self) -> Array:
        """Return the gradient (n,) of g in the reference, before any prescribed motion."""
        gradient: Array = self.G.T @ self.slopes()
        return gradient


def turn_fields_of_ends(ends: Sequence[PointRef | None]) -> tuple[list[int], list[Field]]:
    """Return how each end turns and the fields of all ends; None is the ground."""
    kinds, fields = [], []
    for end in ends:
        kind, more = (GROUND, []) if end is None else turn_fields(end)
        kinds.append(kind)
        fields += more
    return kinds, fields


def check_facing(constraints: Iterable[object], d: Array, t: float) -> None:
    """Raise ComputationError if a section at d (n_full,) is opposite to where a constraint holds it."""
    for constraint in constraints:
        if isinstance(constraint, PointConstraint) and constraint.opposed(d, t):
            raise ComputationError(
                f"{constraint.owner}: the section points opposite to its prescribed direction because its element is "
                "inverted", at={"t": t},
                advice="smaller steps or a slower motion, more elements there, or reissner3, whose sections cannot "
                "collapse")


def formula_record(trees: Sequence[Tree], names: Sequence[str], texts: Sequence[str]) -> Any:
    """Return a record of functions of local quantities, and register it under its ``address`` for laws.

    ``texts`` are the functions as shown in messages.
    """
    from ..kernels.compiled_laws import formula
    from ..kernels.lowlevel.records import Record

    meaning = {name: k for k, name in enumerate(names)}
    record = Record(formula(state_programs([(tree, 1.0) for tree in trees], meaning, len(names)), len(names)))
    FORMULA_RECORDS[record.address] = record.values
    _FORMULA_TEXTS[float(record.address)] = record, texts, names
    RUN[:] = [jets.run_with_gradient]
    return record


def check_formulas(patches: Iterable[Any], d: Array, v: Array, t: float) -> None:
    """Raise ComputationError if a formula among point laws has no value at d with rates v (n_full,)."""
    for items in (patch.items() for patch in patches):
        for k, par in enumerate(items.par):
            found = [x for x in par.tolist() if x in _FORMULA_TEXTS]
            if not found:
                continue
            m = len(items.p0[k])
            f, H, C = np.zeros(m), np.zeros((m, m)), np.zeros((m, m))
            with np.errstate(all="ignore"):
                items.law.forces(items.p0[k], items.G[k] @ d[items.dofs[k]], items.G[k] @ v[items.dofs[k]], par,
                                 np.array([1.0, t, 0.0]), items.mem[k].copy(), f, H, C)
            if not np.isfinite(f).all():
                raise _without_value(found[0], f, t)


def _without_value(address: float, f: Array, t: float) -> ComputationError:
    record, texts, names = _FORMULA_TEXTS[address]
    values = {name: float(f"{x:.6g}") for name, x in zip(names, record.values.values, strict=True)}
    text = texts[min(int(np.flatnonzero(~np.isfinite(f))[0]), len(texts) - 1)]
    return ComputationError(f"the formula '{text}' has no value: it divides by zero, or a square root or a power is "
                            "not real", at={"t": t, **{k: x for k, x in values.items() if k != "t"}},
                            advice="guard the formula with 'a if c else b'")
