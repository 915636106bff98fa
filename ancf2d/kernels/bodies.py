"""All elements of a model in one table, and their forces, which the kernels of motion call by address."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from . import calls
from .batch import Group, Law
from .elements import force, force_noise, force_tangent, viscous_force
from .jit import addressed, inlined, inner, named
from .lanes import Plan, array_at
from .mean_stress import mean_force, mean_force_tangent
from .symmetric import in_band, in_fronts


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


def _with_matrix(stored: Any, kind: str) -> tuple[Any, Any]:
    """Return the tangents of elastic forces, and of those of a step, for matrices of a kind."""
    def tangent(p, g, scale, d, Q, A):  # type: ignore[no-untyped-def]
        return force_tangent(_group(p.bodies, g), d, scale, Q, stored(p, A), p.place, p.indptr, p.index, p.value)

    def mean_tangent(p, g, damping, d0, d1, Q, A):  # type: ignore[no-untyped-def]
        return mean_force_tangent(_group(p.bodies, g), damping, d0, d1, Q, stored(p, A), p.place, p.indptr, p.index,
                                  p.value)[0]

    return addressed(named(tangent, kind)), addressed(named(mean_tangent, kind))


_TANGENTS = _with_matrix(in_band, "band"), _with_matrix(in_fronts, "fronts")


def element_functions(fronts: bool, viscous: bool, mean: bool, problem: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the functions of elements that the table of a model of this type has (``kernels.calls.table``).

    ``viscous``, ``mean`` : whether viscous forces, and forces of a step that keeps energy, are wanted.
    """
    out: dict[Any, tuple[Any, ...]] = {calls.force: (force,), calls.noise: (force_noise,),
                                       calls.tangent: (_TANGENTS[fronts][0], problem)}
    if viscous:
        out[calls.viscous] = (viscous_force,)
    if mean:
        out |= {calls.mean: (mean_force,), calls.mean_tangent: (_TANGENTS[fronts][1], problem)}
    return out


@inner
def elastic(p, d, Q):  # type: ignore[no-untyped-def]
    """Add the elastic forces to Q; return the strain energy."""
    energy = 0.0
    for g in range(len(p.bodies.numbers)):
        energy += calls.force(p.calls, (_group(p.bodies, g), d, Q))
    return energy


@inner
def elastic_tangent(p, c, d, Q, A):  # type: ignore[no-untyped-def]
    """Add the elastic forces to Q, and to A the tangents times 1 + c tau; return the strain energy."""
    energy = 0.0
    for g in range(len(p.bodies.numbers)):
        energy += calls.tangent(p.calls, (p, g, 1.0 + c * p.tau[g], d, Q, A))
    return energy


@inner
def elastic_noise(p, d, out):  # type: ignore[no-untyped-def]
    """Add what round-off can leave of the forces to ``out``."""
    for g in range(len(p.bodies.numbers)):
        calls.noise(p.calls, (_group(p.bodies, g), d, out))


@inner
def viscous(p, d, v, Q):  # type: ignore[no-untyped-def]
    """Add Kelvin-Voigt forces to Q; return the power lost."""
    power = 0.0
    for g in range(len(p.bodies.numbers)):
        if p.tau[g] > 0.0:
            power += calls.viscous(p.calls, (_group(p.bodies, g), p.tau[g], d, v, Q))
    return power


@inner
def mean_elastic(p, h, d0, d1, Q):  # type: ignore[no-untyped-def]
    """Add the forces of a step h that keeps energy and momentum to Q."""
    for g in range(len(p.bodies.numbers)):
        calls.mean(p.calls, (_group(p.bodies, g), p.tau[g] / h, d0, d1, Q))


@inner
def mean_elastic_tangent(p, h, d0, d1, Q, A):  # type: ignore[no-untyped-def]
    """As ``mean_elastic``, and add the derivative to A."""
    for g in range(len(p.bodies.numbers)):
        calls.mean_tangent(p.calls, (p, g, p.tau[g] / h, d0, d1, Q, A))
