"""Entries of a tangent that follow from others, as translations meet no force: those of an element's first position."""

from __future__ import annotations

import numpy as np

from .mesh import Index

Pair = tuple[int, int]


def pair(a: int, b: int) -> Pair:
    """Return an entry of a symmetric matrix by the row and column of its lower half."""
    return max(a, b), min(a, b)


def first_and_others(nc: int, positions: list[int]) -> tuple[list[int], list[list[int]]]:
    """Return x and y of the first position, and those of the others; positions : their shape functions."""
    first, *others = ([k * nc, k * nc + 1] for k in positions)
    return first, others


def made(n: int, first: list[int]) -> list[Pair]:
    """Return the entries of n coordinates that do not follow from others."""
    return [(a, b) for a in range(n) for b in range(a + 1) if a not in first and b not in first]


def following(n: int, nc: int, positions: list[int], entries: Index) -> tuple[list[Pair], Index]:
    """Return the entries that follow from those that are made (m, 2), and ``following`` of ``kernels.lanes.Plan``.

    Where there are just two positions nothing is summed up, and nothing rounded.
    """
    first, others = first_and_others(nc, positions)
    number = {(int(a), int(b)): k for k, (a, b) in enumerate(entries)}
    rest = [a for a in range(n) if a not in first]
    sums: list[tuple[int, int, int]] = []
    follow: list[Pair] = []
    for a, b in [*((a, b) for a in rest for b in first), *((a, b) for a in first for b in first if b <= a)]:
        sources = [number[p] for other in others if (p := pair(a, other[b - first[0]])) in number]
        if sources:
            target = number[pair(a, b)] = len(entries) + len(follow)
            sums += _sum(target, sources)
            follow.append(pair(a, b))
    places = [a for other in others for a in other]
    alike = [(a, a) for a in places] + [(a, b) for a in places for b in places if b < a]
    known = [number[p] for p in alike if p in number] if len(others) > 1 else []
    rounded = [(len(known), len(places), -1), *((k, 0, 0) for k in known)] if known else []
    return follow, np.array(rounded + sums, dtype=np.int64).reshape(-1, 3)


def _sum(target: int, sources: list[int]) -> list[tuple[int, int, int]]:
    """Return the rules for an entry that is less by all sources: two of them at once, then one by one."""
    return [(target, sources[0], sources[min(1, len(sources) - 1)]), *((target, target, k) for k in sources[2:])]
