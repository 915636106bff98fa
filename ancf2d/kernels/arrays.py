"""Arrays copied by loops: a slice's assignment brings in what numba knows of every shape, and is slow to compile."""

from __future__ import annotations

from .jit import inner


@inner
def copy(x, out):  # type: ignore[no-untyped-def]
    """Copy x (n,) to ``out`` (n,)."""
    for i in range(len(out)):
        out[i] = x[i]


@inner
def copy_rows(x, out):  # type: ignore[no-untyped-def]
    """Copy x (m, n) to ``out`` (m, n)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = x[i, j]
