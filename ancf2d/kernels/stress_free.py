"""Stress-free strains: natural strains of free elements, e.g. by temperature or actuators, and internal strains of laws
with memory."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from .lowlevel.jit import inner

# natural strains now, their rates, those before a step, and their change in the step
NOW, RATES, BEFORE, CHANGE = range(4)


class Natural(NamedTuple):
    """Natural strains: those of free elements; stresses are D times the strains beyond them.

    stretch : (loads, patterns * parts, strains, stations) stretch per unit of each load; quadratic : (strains of a
    point,) 1 where a stretch L gives the strain L + L^2/2, 0 where it gives L; pattern : (ne,) pattern of each
    element; amount : (loads, 3) of each load now, its rate, and its amount before a step; signal : (loads,) row of the
    signal that it follows in motion. All are empty if only displacements strain the elements.
    """

    stretch: Any
    quadratic: Any
    pattern: Any
    amount: Any
    signal: Any


@cache
def no_natural() -> Natural:
    """Return the (shared) empty natural strains, for elements that only displacements strain."""
    n = np.zeros(0, dtype=np.int64)
    return Natural(np.zeros((0, 0, 0, 0)), np.zeros(0), n, np.zeros((0, 3)), n)


def of_some(natural: Natural, which: Any) -> Natural:
    """Return the natural strains of the elements ``which``; the amounts are shared."""
    return natural._replace(pattern=np.ascontiguousarray(natural.pattern[which])) if len(natural.pattern) else natural


# marks internal strains that are computed by the law; slopes of prescribed ones are 0 or less
COMPUTED = 1.0


class Memory(NamedTuple):
    """History variables of laws with memory.

    states : (rows, stations, numbers of all points) last accepted state, possibly shared by groups, of the stations of
    all parts up to the last that has internal strains; row : (ne,) row of each element; trial : like states, of the
    last evaluation of forces, or empty. slope (1,) : slope of prescribed internal strains, which replace those of the
    law, or COMPUTED; prescribed, change (rows, stations of all parts, strains of all points) : prescribed internal
    strains, and the change of internal strains whose work is asked for. All are empty if the law has no memory.
    """

    row: Any
    states: Any
    trial: Any
    slope: Any
    prescribed: Any
    change: Any


@cache
def no_memory() -> Memory:
    """Return the (shared) empty memory, for laws without history."""
    none = np.zeros((0, 0, 0))
    return Memory(np.zeros(0, dtype=np.int64), none, none, np.zeros(0), none, none)


def memory_of_some(memory: Memory, which: Any) -> Memory:
    """Return the memory of the elements ``which``; the states are shared."""
    return memory._replace(row=np.ascontiguousarray(memory.row[which])) if memory.states.size else memory


@inner
def _strain_of(stretch, quadratic):  # type: ignore[no-untyped-def]
    return stretch + 0.5 * quadratic * stretch * stretch


@inner
def natural_strain(natural, what, q, i, s, quadratic):  # type: ignore[no-untyped-def]
    """Return natural strain i at station s of pattern q: NOW, its RATES, BEFORE the step or its CHANGE (``what``)."""
    now, rate, before = 0.0, 0.0, 0.0
    for k in range(len(natural.amount)):
        v = natural.stretch[k, q, i, s]
        now += natural.amount[k, 0] * v
        rate += natural.amount[k, 1] * v
        before += natural.amount[k, 2] * v
    if what == NOW:
        return _strain_of(now, quadratic)
    if what == RATES:
        return rate * (1.0 + quadratic * now)
    if what == BEFORE:
        return _strain_of(before, quadratic)
    return (now - before) * (1.0 + 0.5 * quadratic * (now + before))
