"""All elements of a model in one table, and their forces behind pointers.

The kernels of motion call them by address: what a motion has not is not compiled, and nothing is compiled into each.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import types
from numba.extending import overload

from .batch import Group, Law
from .elements import force, force_noise, force_tangent, viscous_force
from .jit import addressed, inlined, inner
from .lanes import Plan, array_at
from .matrix import Nested, SymBand
from .mean_stress import mean_force, mean_force_tangent
from .pointers import address_of, caller
from .symmetric import chosen, stored
from .tree import no_fronts

# what elastic forces are asked for
FORCE, TANGENT, NOISE = range(3)


class Bodies(NamedTuple):
    """Groups of elements: numbers (g, 9), shapes (g, 15, 4) and starts (g, 15) of their arrays, and these in two.

    numbers : address, fields, strains and reference values of the law, components, parts, most elements of a batch,
    addresses of dgemm and of what makes a batch. Arrays are those of ``_FLOATS``, then those of ``_INTS``.
    """

    numbers: Any
    shape: Any
    start: Any
    floats: Any
    ints: Any


# the arrays of a group, as they are kept one after another; its law and plan are unfolded
_FLOATS = ("B", "ref", "D", "turn", "products", "work")
_INTS = ("cls", "dofs", "vectors", "coupled", "blocks", "pairs", "entries", "following", "held")


def make_bodies(groups: Sequence[Group]) -> Bodies:
    """Return the table of some groups."""
    names = _FLOATS + _INTS
    shape, start = np.ones((len(groups), len(names), 4), dtype=np.int64), np.zeros((len(groups), len(names)), np.int64)
    kept: dict[type, list[Any]] = {float: [np.zeros(0)], int: [np.zeros(0, dtype=np.int64)]}
    for g, group in enumerate(groups):
        whole = {**group.law._asdict(), **group.plan._asdict(), **group._asdict()}
        for k, name in enumerate(names):
            part, into = whole[name], kept[float if name in _FLOATS else int]
            shape[g, k, :part.ndim] = part.shape
            start[g, k] = sum(len(f) for f in into)
            into.append(np.ravel(part))
    numbers = np.array([(*g.law[:4], g.components, *g.plan[:2], *g.plan[-2:]) for g in groups], dtype=np.int64)
    numbers = numbers.reshape(-1, 9)
    return Bodies(numbers, shape, start, np.concatenate(kept[float]), np.concatenate(kept[int]))


@inlined
def _group(b, g):  # type: ignore[no-untyped-def]
    """Return group g."""
    h, o, f, i, k = b.shape[g], b.start[g], b.floats, b.ints, b.numbers[g]
    sampled = Law(k[0], k[1], k[2], k[3], array_at(f, o[0], (h[0, 0], h[0, 1], h[0, 2], h[0, 3])),
                  array_at(f, o[1], (h[1, 0], h[1, 1], h[1, 2])),
                  array_at(f, o[2], (h[2, 0], h[2, 1], h[2, 2], h[2, 3])))
    plan = Plan(k[5], k[6], array_at(i, o[8], (h[8, 0], h[8, 1])),
                array_at(i, o[9], (h[9, 0], h[9, 1])), array_at(i, o[10], (h[10, 0], h[10, 1])),
                array_at(i, o[11], (h[11, 0], h[11, 1])), array_at(i, o[12], (h[12, 0], h[12, 1])),
                array_at(i, o[13], (h[13, 0], h[13, 1])), array_at(f, o[4], (h[4, 0], h[4, 1])),
                array_at(i, o[14], (h[14, 0],)), array_at(f, o[5], (h[5, 0],)), k[7], k[8])
    return Group(sampled, array_at(i, o[6], (h[6, 0],)), array_at(f, o[3], (h[3, 0], h[3, 1])),
                 array_at(i, o[7], (h[7, 0], h[7, 1])), k[4], plan)


@addressed
def _elastic(what, b, g, scale, d, Q, matrix, place, indptr, index, value):  # type: ignore[no-untyped-def]
    group = _group(b, g)
    if what == FORCE:
        return force(group, d, Q)
    if what == TANGENT:
        return force_tangent(group, d, scale, Q, matrix, place, indptr, index, value)
    force_noise(group, d, Q)
    return 0.0


@addressed
def _viscous(b, g, tau, d, v, Q):  # type: ignore[no-untyped-def]
    return viscous_force(_group(b, g), tau, d, v, Q)


@addressed
def _mean(what, b, g, damping, d0, d1, Q, matrix, place, indptr, index, value):  # type: ignore[no-untyped-def]
    group = _group(b, g)
    if what == FORCE:
        return mean_force(group, damping, d0, d1, Q)[0]
    return mean_force_tangent(group, damping, d0, d1, Q, matrix, place, indptr, index, value)[0]


@addressed
def _no_viscous(b, g, tau, d, v, Q):  # type: ignore[no-untyped-def]
    return np.nan


@addressed
def _no_mean(what, b, g, damping, d0, d1, Q, matrix, place, indptr, index, value):  # type: ignore[no-untyped-def]
    return np.nan


_i, _f = types.int64, types.float64
_x, _n = types.float64[::1], types.int64[::1]


def _signatures(matrix: Any) -> tuple[Any, Any, Any]:
    """Return the types of elastic, viscous and mean forces for a matrix of a kind."""
    b = numba.typeof(make_bodies([]))
    tables = (numba.typeof(matrix), _n, _n, _n, _x)
    return _f(_i, b, _i, _f, _x, _x, *tables), _f(b, _i, _f, _x, _x, _x), _f(_i, b, _i, _f, _x, _x, _x, *tables)


# for bands, and for fronts
_SIGNATURES = _signatures(SymBand(np.zeros((1, 1)))), _signatures(Nested(np.zeros(0), no_fronts()))
(_elastic_band, _call_viscous, _mean_band), (_elastic_fronts, _, _mean_fronts) = (
    [caller(s) for s in signatures] for signatures in _SIGNATURES)
ELASTIC, VISCOUS, MEAN = range(3)


@cache
def _address(which: int, wanted: bool, fronts: bool) -> int:
    """Return the address of the elastic, viscous or mean forces, or of a stand-in that is never called."""
    function = ((_elastic, _elastic), (_no_viscous, _viscous), (_no_mean, _mean))[which][wanted]
    return address_of(function, _SIGNATURES[fronts][which])


def addresses(viscous: bool, mean: bool, fronts: bool) -> Any:
    """Return the addresses (3,) of elastic, viscous and mean forces, compiled as far as they are wanted.

    ``fronts`` tells whether matrices are fronts, not bands.
    """
    wanted = enumerate((True, viscous, mean))
    return np.array([_address(which, each, fronts) for which, each in wanted], dtype=np.int64)


def _ask(fronts: Any, p: Any, what: int, g: int, scale: float, d: Any, Q: Any, A: Any) -> float:
    """Return the strain energy of group g: see ``_elastic``."""
    raise NotImplementedError


@overload(_ask, inline="always")
def _ask_one(fronts, p, what, g, scale, d, Q, A):  # type: ignore[no-untyped-def]
    call = chosen(fronts, _elastic_band, _elastic_fronts)
    return lambda fronts, p, what, g, scale, d, Q, A: call(p.calls[ELASTIC], (
        what, p.bodies, g, scale, d, Q, stored(fronts, A), p.place, p.indptr, p.index, p.value))


def _ask_mean(fronts: Any, p: Any, what: int, g: int, damping: float, d0: Any, d1: Any, Q: Any, A: Any) -> float:
    """Return the strain energy of group g: see ``_mean``."""
    raise NotImplementedError


@overload(_ask_mean, inline="always")
def _ask_one_mean(fronts, p, what, g, damping, d0, d1, Q, A):  # type: ignore[no-untyped-def]
    call = chosen(fronts, _mean_band, _mean_fronts)
    return lambda fronts, p, what, g, damping, d0, d1, Q, A: call(p.calls[MEAN], (
        what, p.bodies, g, damping, d0, d1, Q, stored(fronts, A), p.place, p.indptr, p.index, p.value))


@inner
def elastic(p, d, Q, A):  # type: ignore[no-untyped-def]
    """Add the elastic forces to Q; return the strain energy."""
    energy = 0.0
    for g in range(len(p.bodies.numbers)):
        energy += _ask(p.fronts, p, FORCE, g, 1.0, d, Q, A)
    return energy


@inner
def elastic_tangent(p, c, d, Q, A):  # type: ignore[no-untyped-def]
    """Add the elastic forces to Q, and to A the tangents times 1 + c tau; return the strain energy."""
    energy = 0.0
    for g in range(len(p.bodies.numbers)):
        energy += _ask(p.fronts, p, TANGENT, g, 1.0 + c * p.tau[g], d, Q, A)
    return energy


@inner
def elastic_noise(p, d, out, A):  # type: ignore[no-untyped-def]
    """Add what round-off can leave of the forces to ``out``."""
    for g in range(len(p.bodies.numbers)):
        _ask(p.fronts, p, NOISE, g, 1.0, d, out, A)


@inner
def viscous(p, d, v, Q):  # type: ignore[no-untyped-def]
    """Add Kelvin-Voigt forces to Q; return the power lost."""
    power = 0.0
    for g in range(len(p.bodies.numbers)):
        if p.tau[g] > 0.0:
            power += _call_viscous(p.calls[VISCOUS], (p.bodies, g, p.tau[g], d, v, Q))
    return power


@inner
def mean_elastic(p, what, h, d0, d1, Q, A):  # type: ignore[no-untyped-def]
    """Add the forces of a step h that keeps energy and momentum to Q, and for TANGENT their derivative to A."""
    for g in range(len(p.bodies.numbers)):
        _ask_mean(p.fronts, p, what, g, p.tau[g] / h, d0, d1, Q, A)
