"""Small arrays that live as long as the kernel that makes them: on its stack, without a word to the allocator."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic

from .jit import inlined


@intrinsic
def _doubles(_: Any, count: Any) -> Any:
    """Return the address of so many doubles in the frame of the caller."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.alloca(ir.DoubleType(), size=args[0])

    return types.CPointer(types.float64)(types.intp), generate


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
