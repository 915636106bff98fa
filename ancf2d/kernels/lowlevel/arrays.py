"""Small arrays on a kernel's stack, and copies by loops, which compile faster than slices."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .jit import inlined, inner
from .records import array_over


@intrinsic
def rank(_: Any, x: Any) -> Any:
    """Return the bits of x >= 0 as an integer, which orders like x, with nan above all numbers."""
    return types.int64(types.float64), lambda context, builder, _, args: builder.bitcast(args[0], ir.IntType(64))


@intrinsic
def ranked(_: Any, k: Any) -> Any:
    """Return the number x of a ``rank``."""
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


_SIZE = 8


@intrinsic
def _zeros(_: Any, shape: Any) -> Any:
    """Return an array of zeros in the stack frame of the caller."""
    result = types.Array(types.float64, len(shape), "C")

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        dims = cgutils.unpack_tuple(builder, args[0], len(shape))
        count = dims[0]
        for dim in dims[1:]:
            count = builder.mul(count, dim)
        data = builder.alloca(ir.DoubleType(), size=count)
        cgutils.memset(builder, data, builder.mul(count, count.type(_SIZE)), 0)
        return array_over(context, builder, result, data, dims)

    return result(types.UniTuple(types.intp, len(shape))), generate


@intrinsic
def numbers(_: Any, like: Any, count: Any) -> Any:
    """Return an uninitialised array (count,) of the type of ``like``, on the stack as in ``vector``."""
    result = types.Array(like.dtype, 1, "C")

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = builder.alloca(context.get_data_type(like.dtype), size=args[1])
        return array_over(context, builder, result, data, [args[1]])

    return result(like, types.intp), generate


@inlined
def vector(n):  # type: ignore[no-untyped-def]
    """Return zeros (n,) on the stack; call it before loops, not in them, and never return the array from a kernel."""
    return _zeros((n,))


@inlined
def matrices(k, n, m):  # type: ignore[no-untyped-def]
    """Return zeros (k, n, m) on the stack, as in ``vector``."""
    return _zeros((k, n, m))


@inlined
def array(n, m):  # type: ignore[no-untyped-def]
    """Return zeros (n, m) on the stack, as in ``vector``."""
    return _zeros((n, m))
