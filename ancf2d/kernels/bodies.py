"""All elements of a model in one table, and their laws behind pointers.

The kernels of motion call laws by address: they are compiled once for every kind of model, and a law that a model has
not is not compiled at all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import types

from ..elements.formulations import FORMULATIONS
from .elements import Group, force, force_noise, scaled_force_tangent
from .jit import inner, kernel
from .matrix import SymBand
from .mean import mean_force, mean_force_tangent
from .pointers import address_of, caller
from .viscous import viscous_force

# every type of law, in the order of their numbers
LAWS: tuple[type, ...] = tuple(dict.fromkeys(f.law for f in FORMULATIONS.values() if f.law is not None))
# what a law is asked for
FORCE, TANGENT, NOISE = range(3)


class Bodies(NamedTuple):
    """Groups of elements: law number kind (g,), shape (g, 9), and where their arrays start (g, 6) in floats and ints.

    shape : classes, stations, fields, coordinates, reference values, strains, elements, turns, components. start : of
    B, ref, D, turn among the floats, of cls and dofs among the ints.
    """

    kind: Any
    shape: Any
    start: Any
    floats: Any
    ints: Any


def make_bodies(groups: Sequence[Group]) -> Bodies:
    """Return the table of some groups."""
    shape, start = np.zeros((len(groups), 9), dtype=np.int64), np.zeros((len(groups), 6), dtype=np.int64)
    floats: list[Any] = [np.zeros(0)]
    ints: list[Any] = [np.zeros(0, dtype=np.int64)]
    for g, group in enumerate(groups):
        law = group.law
        shape[g] = (*law.B.shape, law.ref.shape[2], law.D.shape[2], len(group.dofs), len(group.turn), group.components)
        for k, part in enumerate((law.B, law.ref, law.D, group.turn)):
            start[g, k] = sum(len(f) for f in floats)
            floats.append(np.ravel(part))
        for k, part in enumerate((group.cls, group.dofs), start=4):
            start[g, k] = sum(len(i) for i in ints)
            ints.append(np.ravel(part))
    kind = np.array([LAWS.index(type(group.law)) for group in groups], dtype=np.int64)
    return Bodies(kind, shape, start, np.concatenate(floats), np.concatenate(ints))


@inner
def _parts(b, g):  # type: ignore[no-untyped-def]
    """Return B, ref, D, cls, turn, dofs and components of group g."""
    h, o = b.shape[g], b.start[g]
    c, s, f, n, r, e, ne, nt = h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7]
    B = b.floats[o[0]:o[0] + c * s * f * n].reshape((c, s, f, n))
    ref = b.floats[o[1]:o[1] + c * s * r].reshape((c, s, r))
    D = b.floats[o[2]:o[2] + c * s * e * e].reshape((c, s, e, e))
    turn = b.floats[o[3]:o[3] + 2 * nt].reshape((nt, 2))
    return B, ref, D, b.ints[o[4]:o[4] + ne], turn, b.ints[o[5]:o[5] + ne * n].reshape((ne, n)), h[8]


def _elastic_of(law: type) -> Any:
    @kernel
    def elastic(what, b, g, scale, d, Q, A, place, indptr, index, value):  # type: ignore[no-untyped-def]
        B, ref, D, cls, turn, dofs, nc = _parts(b, g)
        group = Group(law(B, ref, D), cls, turn, dofs, nc)
        if what == FORCE:
            return force(group, d, Q)
        if what == TANGENT:
            return scaled_force_tangent(group, d, scale, Q, SymBand(A), place, indptr, index, value)
        force_noise(group, d, Q)
        return 0.0
    return elastic


def _viscous_of(law: type) -> Any:
    @kernel
    def viscous(b, g, tau, d, v, Q):  # type: ignore[no-untyped-def]
        B, ref, D, cls, turn, dofs, nc = _parts(b, g)
        return viscous_force(Group(law(B, ref, D), cls, turn, dofs, nc), tau, d, v, Q)
    return viscous


def _mean_of(law: type) -> Any:
    @kernel
    def mean(what, b, g, damping, d0, d1, Q, A, place, indptr, index, value):  # type: ignore[no-untyped-def]
        B, ref, D, cls, turn, dofs, nc = _parts(b, g)
        group = Group(law(B, ref, D), cls, turn, dofs, nc)
        if what == FORCE:
            return mean_force(group, damping, d0, d1, Q)[0]
        return mean_force_tangent(group, damping, d0, d1, Q, SymBand(A), place, indptr, index, value)[0]
    return mean


@kernel
def _no_elastic(what, b, g, scale, d, Q, A, place, indptr, index, value):  # type: ignore[no-untyped-def]
    return np.nan


@kernel
def _no_viscous(b, g, tau, d, v, Q):  # type: ignore[no-untyped-def]
    return np.nan


@kernel
def _no_mean(what, b, g, damping, d0, d1, Q, A, place, indptr, index, value):  # type: ignore[no-untyped-def]
    return np.nan


_i, _f = types.int64, types.float64
_x, _A, _n = types.float64[::1], types.float64[:, ::1], types.int64[::1]


def _signatures() -> tuple[Any, Any, Any]:
    b = numba.typeof(make_bodies([]))
    tables = (_A, _n, _n, _n, _x)
    return _f(_i, b, _i, _f, _x, _x, *tables), _f(b, _i, _f, _x, _x, _x), _f(_i, b, _i, _f, _x, _x, _x, *tables)


SIGNATURES = _signatures()
_call_elastic, _call_viscous, _call_mean = (caller(s) for s in SIGNATURES)
_MAKERS: tuple[tuple[Callable[[type], Any], Any], ...] = (
    (_elastic_of, _no_elastic), (_viscous_of, _no_viscous), (_mean_of, _no_mean))
ELASTIC, VISCOUS, MEAN = range(3)


@cache
def _compiled(which: int, law: int) -> tuple[Any, int]:
    """Return the kernel of the elastic, viscous or mean forces of a law, or of none (-1), and its address."""
    make, none = _MAKERS[which]
    function = none if law < 0 else make(LAWS[law])
    return function, address_of(function, SIGNATURES[which])


def addresses(*kinds: set[int]) -> Any:
    """Return the addresses (3, laws) of elastic, viscous and mean forces, compiled for the ``kinds`` of each."""
    return np.array([[_compiled(which, k if k in wanted else -1)[1] for k in range(len(LAWS))]
                     for which, wanted in enumerate(kinds)], dtype=np.int64)


@inner
def elastic(p, d, Q, A):  # type: ignore[no-untyped-def]
    """Add the elastic forces to Q; return the strain energy."""
    energy = 0.0
    for g in range(len(p.bodies.kind)):
        energy += _call_elastic(p.laws[ELASTIC, p.bodies.kind[g]], (
            FORCE, p.bodies, g, 1.0, d, Q, A, p.place, p.indptr, p.index, p.value))
    return energy


@inner
def elastic_tangent(p, c, d, Q, A):  # type: ignore[no-untyped-def]
    """Add the elastic forces to Q, and to A the tangents times 1 + c tau; return the strain energy."""
    energy = 0.0
    for g in range(len(p.bodies.kind)):
        scale = 1.0 + c * p.tau[g]
        energy += _call_elastic(p.laws[ELASTIC, p.bodies.kind[g]], (
            TANGENT, p.bodies, g, scale, d, Q, A, p.place, p.indptr, p.index, p.value))
    return energy


@inner
def elastic_noise(p, d, out, A):  # type: ignore[no-untyped-def]
    """Add what round-off can leave of the forces to ``out``."""
    for g in range(len(p.bodies.kind)):
        _call_elastic(p.laws[ELASTIC, p.bodies.kind[g]], (
            NOISE, p.bodies, g, 1.0, d, out, A, p.place, p.indptr, p.index, p.value))


@inner
def viscous(p, d, v, Q):  # type: ignore[no-untyped-def]
    """Add Kelvin-Voigt forces to Q; return the power lost."""
    power = 0.0
    for g in range(len(p.bodies.kind)):
        if p.tau[g] > 0.0:
            power += _call_viscous(p.laws[VISCOUS, p.bodies.kind[g]], (p.bodies, g, p.tau[g], d, v, Q))
    return power


@inner
def mean_elastic(p, what, h, d0, d1, Q, A):  # type: ignore[no-untyped-def]
    """Add the forces of a step h that keeps energy and momentum to Q, and for TANGENT their derivative to A."""
    for g in range(len(p.bodies.kind)):
        _call_mean(p.laws[MEAN, p.bodies.kind[g]], (
            what, p.bodies, g, p.tau[g] / h, d0, d1, Q, A, p.place, p.indptr, p.index, p.value))
