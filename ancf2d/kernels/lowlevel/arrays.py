"""Arrays copied by loops: a slice's assignment brings in what numba knows of every shape, and is slow to compile."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from .jit import inner


@intrinsic
def rank(_: Any, x: Any) -> Any:
    """Return a whole number that sizes x >= 0 compare by as by x, and what is no number lies above all."""
    return types.int64(types.float64), lambda context, builder, _, args: builder.bitcast(args[0], ir.IntType(64))


@intrinsic
def ranked(_: Any, k: Any) -> Any:
    """Return the number of a rank."""
    return types.float64(types.int64), lambda context, builder, _, args: builder.bitcast(args[0], ir.DoubleType())


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
