"""Long vectors in chunks that fit into the processor's cache."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..elements.shape import Array

LENGTH = 2**15


def chunks(n: int) -> Iterator[slice]:
    """Yield slices that divide a vector of n entries."""
    for start in range(0, n, LENGTH):
        yield slice(start, start + LENGTH)


def largest(x: Array, weights: Array | None = None) -> float:
    """Return the largest |x|, or |weights x|; NaN if any entry is."""
    if len(x) <= LENGTH:
        return float(np.abs(x if weights is None else weights * x).max(initial=0.0))
    return float(np.max([largest(x[p], None if weights is None else weights[p]) for p in chunks(len(x))]))


def largest_share(x: Array, sizes: Array) -> float:
    """Return the largest |x / sizes| over nonzero sizes; NaN if any entry is."""
    if len(x) <= LENGTH:
        share = np.divide(x, sizes, out=np.zeros(len(x)), where=sizes > 0.0)
        return float(np.abs(share, out=share).max(initial=0.0))
    return float(np.max([largest_share(x[p], sizes[p]) for p in chunks(len(x))]))
