"""Small arrays that live as long as the kernel that makes them: on its stack, without a word to the allocator."""

from __future__ import annotations

from functools import reduce
from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np import arrayobj

from .jit import inlined


def _room(context: Any, builder: Any, result: Any, dims: Any) -> Any:
    """Return an array of a type in the frame of the caller, of which no references are counted."""
    kind = context.get_data_type(result.dtype)
    size = context.get_constant(types.intp, context.get_abi_sizeof(kind))
    strides = [size]
    for dim in dims[:0:-1]:
        strides.insert(0, builder.mul(strides[0], dim))
    out = arrayobj.make_array(result)(context, builder)
    data = builder.alloca(kind, size=reduce(builder.mul, dims))
    arrayobj.populate_array(out, data=data, shape=dims, strides=strides, itemsize=size, meminfo=None, parent=None)
    return out._getvalue()


@intrinsic
def _doubles(_: Any, shape: Any) -> Any:
    result = types.Array(types.float64, len(shape), "C")

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _room(context, builder, result, cgutils.unpack_tuple(builder, args[0], len(shape)))

    return result(types.UniTuple(types.intp, len(shape))), generate


@intrinsic
def numbers(_: Any, like: Any, count: Any) -> Any:
    """Return room for so many numbers of an array's kind, as ``vector`` does; what they are is not said."""
    result = types.Array(like.dtype, 1, "C")

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _room(context, builder, result, [args[1]])

    return result(like, types.intp), generate


@inlined
def vector(n):  # type: ignore[no-untyped-def]
    """Return zeros (n,). Made before loops, never in them, and never returned: gone when the kernel returns."""
    out = _doubles((n,))
    out[:] = 0.0
    return out


@inlined
def matrices(k, n, m):  # type: ignore[no-untyped-def]
    """Return zeros (k, n, m), as ``vector`` does."""
    out = _doubles((k, n, m))
    out[:] = 0.0
    return out


@inlined
def array(n, m):  # type: ignore[no-untyped-def]
    """Return zeros (n, m), as ``vector`` does."""
    out = _doubles((n, m))
    out[:] = 0.0
    return out
