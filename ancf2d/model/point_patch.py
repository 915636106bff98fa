"""Springs, loads that turn and constraints at points: a law (``elements.point_laws``) over fields of coordinates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..case import Active, Latch, jets
from ..case.programs import state_programs
from ..case.syntax import Tree
from ..elements.point_laws import DIRECTION, FORMULAS, GROUND, MAX_CONSTANTS, MAX_MEM, RUN, THETA, PointLaw
from ..elements.shape import Array
from ..errors import ComputationError, PluginError
from .mesh import Index
from .points import PointRef, dot

# each record by its address, with the formulas as the case has them and the names of the quantities
_TOLD: dict[float, tuple[Any, Sequence[str], Sequence[str]]] = {}


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


class Items(NamedTuple):
    """A law over m sets of n coordinates each, as tables have it.

    dofs : (m, n); G : (m, fields, n); p0 : (m, fields); par : (m, constants); mem : (m, numbers); what they follow (or
    up to three signals) and the fields that it prescribes, their multiplier and the size of their terms
    (``PointPatch``), and whether they act; what an impact returns of the rate of one-sided constraints (nan: a contact
    with a law of its own; -1: no contact); how many sets from each on have the same fields (m,), None: no two have;
    whether G stays as it is.
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


def constants_of(item: Any, force: Callable[..., Any], returns: Sequence[str]) -> list[float]:
    """Return the constants of the law of a record, whose ``force`` (of two numbers and these) ``returns`` so much.

    Raises PluginError where they are too many, or no numbers, and where the force takes or returns something else.
    """
    name, given = type(item).__name__, item.constants()
    try:
        found = [float(x) for x in given]
    except (TypeError, ValueError):
        raise PluginError(f"{name}.constants() returns {given!r}; expected a list of numbers") from None
    if len(found) > MAX_CONSTANTS:
        raise PluginError(f"{name}.constants() returns {len(found)} numbers; expected at most {MAX_CONSTANTS}")
    # at 0 it may have no value
    with np.errstate(all="ignore"), suppress(ArithmeticError):
        try:
            out = force(0.0, 0.0, np.array(found))
        except TypeError as error:
            if error.__traceback__ is not None and error.__traceback__.tb_next is None:
                raise PluginError(f"the force of {name}: {error}") from None
            raise
        if not isinstance(out, tuple) or len(out) != len(returns):
            what = f"{len(out)} values" if isinstance(out, tuple) else str(out)
            raise PluginError(f"the force of {name} returns {what}; expected {len(returns)}: {', '.join(returns)}")
    return found


class PointPatch:
    """A law without multiplier: forces and stiffness along ``dofs`` (1, n); fields are p0 + G d[dofs[0]].

    ``par`` are the constants of the law, ``signal`` its amplitude (None: 1), ``fed`` the field that the signal
    prescribes (-1: none), ``mem`` the last angles of directions whose turns are counted, those of ``sections`` (None
    where nothing has to be counted); ``symmetric`` tells whether the stiffness is.
    """

    multiplier = -1
    scale = 1.0
    # when it acts, None for always; the first of its items that act on one side alone, or from a gap on, each with
    # those behind it (0: all of them)
    active: Active | Latch | None = None
    breaks: Sequence[int] = ()
    # points of bodies that it acts at, with what each has of the fields, where they are told apart
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
        """Every full coordinate that the law acts on."""
        return self.dofs[0]

    @property
    def rows(self) -> Array:
        """The matrix that gives the fields from the coordinates."""
        return self.G

    def items(self) -> Items:
        """Return the law as tables have it."""
        return Items(self.law, self.coordinates[None], self.rows[None], self.p0[None], self.par[None], self.mem[None],
                     self.signal, self.fed, self.multiplier, self.scale)

    def keep_in(self, par: Array, mem: Array) -> None:
        """Keep constants and last angles in rows of a table."""
        self.par, self.mem = par, mem

    def forces(self, u: Array, t: float, rates: Array | None = None) -> tuple[Array, Array, Array]:
        """Return f, H and C at fields p0 + u (m,) and their rates, at rest without; ``u`` gets the field that is
        prescribed."""
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
        """Yield those of its ``ends`` that are wanted, and the forces (n_q,) exerted there at d (n_q,) and rates v.

        With ``linear`` they are those to first order about the reference.
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

    ``owner`` is the support or joint it belongs to, ``holds`` what it holds, in words; ``scale`` the size of the terms
    of g. ``multiplier`` is the full coordinate of the multiplier, known once a model is numbered. ``facing`` tells from
    the fields by its sign whether two directions agree (None: there are none).
    """

    def __init__(self, law: PointLaw, fields: Sequence[Field], par: Sequence[float], owner: str, holds: str,
                 scale: float, signal: Callable[[float], float] | None = None, fed: int = -1,
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
                advice="smaller steps or a slower motion, more elements there, or reissner3, whose sections cannot "
                "collapse")


def formula_record(trees: Sequence[Tree], names: Sequence[str], texts: Sequence[str]) -> Any:
    """Return functions of local quantities as a record, which laws know by its ``address`` from now on.

    ``texts`` are the functions as messages tell them.
    """
    from ..kernels.compiled_laws import formula
    from ..kernels.lowlevel.records import Record

    meaning = {name: k for k, name in enumerate(names)}
    record = Record(formula(state_programs([(tree, 1.0) for tree in trees], meaning, len(names)), len(names)))
    FORMULAS[record.address] = record.values
    _TOLD[float(record.address)] = record, texts, names
    RUN[:] = [jets.run_with_gradient]
    return record


def check_formulas(patches: Iterable[Any], d: Array, v: Array, t: float) -> None:
    """Raise the ComputationError of a formula without a value among point laws, at d with rates v (n_full,)."""
    for items in (patch.items() for patch in patches):
        for k, par in enumerate(items.par):
            found = [x for x in par.tolist() if x in _TOLD]
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
    record, texts, names = _TOLD[address]
    told = {name: float(f"{x:.6g}") for name, x in zip(names, record.values.values, strict=True)}
    text = texts[min(int(np.flatnonzero(~np.isfinite(f))[0]), len(texts) - 1)]
    return ComputationError(f"the formula '{text}' has no value: it divides by zero, or a square root or a power is "
                            "not real", at={"t": t, **{k: x for k, x in told.items() if k != "t"}},
                            advice="guard the formula with 'a if c else b'")
