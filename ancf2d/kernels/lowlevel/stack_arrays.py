"""Small arrays that live as long as the kernel that makes them: on its stack, without a word to the allocator."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .jit import inlined
from .pointers import array_over

_SIZE = 8


@intrinsic
def _zeros(_: Any, shape: Any) -> Any:
    """Return an array of zeros in the frame of the caller."""
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
    """Return room for so many numbers of an array's kind, as ``vector`` does; what they are is not said."""
    result = types.Array(like.dtype, 1, "C")

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = builder.alloca(context.get_data_type(like.dtype), size=args[1])
        return array_over(context, builder, result, data, [args[1]])

    return result(like, types.intp), generate


@inlined
def vector(n):  # type: ignore[no-untyped-def]
    """Return zeros (n,). Made before loops, never in them, and never returned: gone when the kernel returns."""
    return _zeros((n,))


@inlined
def matrices(k, n, m):  # type: ignore[no-untyped-def]
    """Return zeros (k, n, m), as ``vector`` does."""
    return _zeros((k, n, m))


@inlined
def array(n, m):  # type: ignore[no-untyped-def]
    """Return zeros (n, m), as ``vector`` does."""
    return _zeros((n, m))
