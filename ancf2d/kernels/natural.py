"""Strains that bear no stress: natural ones, which elements would have if they were free, as temperature or an actuator
makes them, and internal ones, which laws with memory remember."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from .lowlevel.jit import inner

# of natural strains: what they are now, their rates, what they were before a step, and how they change in it
NOW, RATES, BEFORE, CHANGE = range(4)


class Natural(NamedTuple):
    """Strains that elements would have if they were free: stresses are D times what they are strained beyond these.

    stretch : (loads, patterns parts, strains, stations) of each load, per unit of it; quadratic : (strains of a point,)
    1 where the strain of a stretch L is L + L^2/2, 0 where it is L; pattern : (ne,) which of the patterns an element
    has; amount : (loads, 3) of each load now, its rate, and its amount before a step; signal : (loads,) what it
    follows in motion. All are empty where nothing but displacements strains the elements.
    """

    stretch: Any
    quadratic: Any
    pattern: Any
    amount: Any
    signal: Any


@cache
def no_natural() -> Natural:
    """Return the same natural strains always, those of elements that nothing but displacements strains."""
    n = np.zeros(0, dtype=np.int64)
    return Natural(np.zeros((0, 0, 0, 0)), np.zeros(0), n, np.zeros((0, 3)), n)


def of_some(natural: Natural, which: Any) -> Natural:
    """Return the natural strains of some elements, which follow the same amounts."""
    return natural._replace(pattern=np.ascontiguousarray(natural.pattern[which])) if len(natural.pattern) else natural


# slopes are 0 or less
UNGIVEN = 1.0


class Memory(NamedTuple):
    """What laws with memory remember of the last accepted state.

    row : (ne,) where that of each element is in states (rows, stations of all parts, numbers of all points), which may
    be those of other groups too; trial : room for those of the state whose forces were last asked for, which may be
    accepted next, or nothing. slope (1,) : that of internal strains which are given in the place of the law's own,
    UNGIVEN where none are; given, taken (rows, stations of all parts, strains of all points) : these, and what they
    have taken. All are empty where the law has none.
    """

    row: Any
    states: Any
    trial: Any
    slope: Any
    given: Any
    taken: Any


@cache
def no_memory() -> Memory:
    """Return the same memory always, that of laws that have none."""
    none = np.zeros((0, 0, 0))
    return Memory(np.zeros(0, dtype=np.int64), none, none, np.zeros(0), none, none)


def memory_of_some(memory: Memory, which: Any) -> Memory:
    """Return the memory of some elements, which is a part of that of all."""
    return memory._replace(row=np.ascontiguousarray(memory.row[which])) if memory.states.size else memory


@inner
def _strain_of(stretch, quadratic):  # type: ignore[no-untyped-def]
    return stretch + 0.5 * quadratic * stretch * stretch


@inner
def natural_strain(natural, what, q, i, s, quadratic):  # type: ignore[no-untyped-def]
    """Return what is asked for of natural strain i at station s of pattern q."""
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
