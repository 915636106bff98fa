"""Long vectors gone through piece by piece, so that what is made of them on the way stays in the caches."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..elements.shape import Array

LENGTH = 2**15


def pieces(n: int) -> Iterator[slice]:
    """Yield the pieces of a vector of n entries."""
    for start in range(0, n, LENGTH):
        yield slice(start, start + LENGTH)


def largest(x: Array, weights: Array | None = None) -> float:
    """Return the largest |x|, or |weights x|; NaN where one is not a number."""
    found = [np.max(np.abs(x[p]) if weights is None else np.abs(weights[p] * x[p])) for p in pieces(len(x))]
    return float(np.max(found, initial=0.0))


def largest_share(x: Array, sizes: Array) -> float:
    """Return the largest |x / sizes| of those whose size is not zero; NaN where one is not a number."""
    found = []
    for p in pieces(len(x)):
        share = np.zeros(len(x[p]))
        np.divide(x[p], sizes[p], out=share, where=sizes[p] > 0.0)
        found.append(np.max(np.abs(share)))
    return float(np.max(found, initial=0.0))
