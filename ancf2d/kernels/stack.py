"""Small arrays that live as long as the kernel that makes them: on its stack, without a word to the allocator."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic
from numba.np import arrayobj

from .jit import inlined


@intrinsic
def _doubles(_: Any, count: Any) -> Any:
    """Return the address of so many doubles in the frame of the caller."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.alloca(ir.DoubleType(), size=args[0])

    return types.CPointer(types.float64)(types.intp), generate


@intrinsic
def numbers(_: Any, like: Any, count: Any) -> Any:
    """Return room for so many numbers of an array's kind, as ``vector`` does; what they are is not said."""
    kind = types.Array(like.dtype, 1, "C")

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = builder.alloca(context.get_data_type(like.dtype), size=args[1])
        out = arrayobj.make_array(kind)(context, builder)
        size = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(like.dtype)))
        arrayobj.populate_array(out, data=data, shape=[args[1]], strides=[size], itemsize=size, meminfo=None,
                                parent=None)
        return out._getvalue()

    return kind(like, types.intp), generate


@inlined
def vector(n):  # type: ignore[no-untyped-def]
    """Return zeros (n,). Made before loops, never in them, and never returned: gone when the kernel returns."""
    out = carray(_doubles(n), (n,))
    out[:] = 0.0
    return out


@inlined
def matrices(k, n, m):  # type: ignore[no-untyped-def]
    """Return zeros (k, n, m), as ``vector`` does."""
    out = carray(_doubles(k * n * m), (k, n, m))
    out[:] = 0.0
    return out


@inlined
def array(n, m):  # type: ignore[no-untyped-def]
    """Return zeros (n, m), as ``vector`` does."""
    out = carray(_doubles(n * m), (n, m))
    out[:] = 0.0
    return out
