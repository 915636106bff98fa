"""Compiled functions called by their address, so that their callers are compiled without them; arrays over memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np import arrayobj


def address_of(function: Any, signature: Any) -> int:
    """Return the address of a kernel compiled for a signature; it holds as long as the kernel lives."""
    function.compile(signature.args)
    result = function.get_compile_result(signature)
    if result.signature.return_type != signature.return_type:
        raise TypeError(f"{function} returns {result.signature.return_type}, not {signature.return_type}")
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


def call_at(context: Any, builder: Any, signature: Any, address: Any, packed: Any) -> Any:
    """Generate the call of an address with a tuple of arguments; return the result."""
    restype, argtypes = signature.return_type, signature.args
    values = cgutils.unpack_tuple(builder, packed, len(argtypes))
    kind: ir.FunctionType = context.call_conv.get_function_type(restype, argtypes)
    status, out = context.call_conv.call_function(
        builder, builder.inttoptr(address, kind.as_pointer()), restype, argtypes, values)
    with cgutils.if_unlikely(builder, status.is_error):
        context.call_conv.return_status_propagate(builder, status)
    return out


def caller(signature: Any) -> Callable[..., Any]:
    """Return what kernels call addresses of one signature by: ``call(address, (argument, ...))``."""
    restype, argtypes = signature.return_type, signature.args

    def generate(context: Any, builder: Any, _: Any, args: Any) -> Any:
        return call_at(context, builder, signature, *args)

    @intrinsic
    def call(_: Any, address: Any, arguments: Any) -> Any:  # pragma: no cover - runs in the compiler
        return restype(types.int64, types.Tuple(argtypes)), generate

    return call  # type: ignore[no-any-return]


def array_over(context: Any, builder: Any, kind: Any, data: Any, dims: Any) -> Any:
    """Return an array, row by row, of a type over memory that it does not own: no references to it are counted."""
    intp = context.get_value_type(types.intp)
    size = intp(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    strides = [size]
    for dim in dims[:0:-1]:
        strides.insert(0, builder.mul(strides[0], dim))
    out = arrayobj.make_array(kind)(context, builder)
    arrayobj.populate_array(out, data=data, shape=dims, strides=strides, itemsize=size, meminfo=None, parent=None)
    return out._getvalue()


# rows of a work buffer lie so far apart: further than lanes, so that they do not fall on the same lines of the cache
STRIDE = 72


def _view(buffer: Any, places: list[Any], dimensions: int, parts: Any) -> Any:
    """Return signature and code of an array over a buffer: ``parts`` makes (first entry, shape) of ``places``."""
    result = types.Array(buffer.dtype, dimensions, "C")

    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        first, dims = parts(builder, *args[1:])
        data = builder.gep(arrayobj.make_array(buffer)(context, builder, args[0]).data, [first])
        return array_over(context, builder, result, data, dims)

    return result(buffer, *places), generate


@intrinsic
def array_at(_, buffer, first, shape):  # type: ignore[no-untyped-def]
    """Return an array of a shape over a buffer from entry ``first`` on, of which no references are counted."""
    n = len(shape)
    return _view(buffer, [types.intp, types.UniTuple(types.intp, n)], n,
                 lambda builder, first, shape: (first, cgutils.unpack_tuple(builder, shape, n)))


def _stride(builder: Any, k: Any, *shape: Any) -> Any:
    return builder.mul(k, k.type(STRIDE)), [*shape, k.type(STRIDE)]


@intrinsic
def row(_, work, k):  # type: ignore[no-untyped-def]
    """Return row k of the work buffer."""
    return _view(work, [types.intp], 1, _stride)


@intrinsic
def rows(_, work, k, m):  # type: ignore[no-untyped-def]
    """Return rows k, k + 1, ... as (m, lanes)."""
    return _view(work, [types.intp] * 2, 2, _stride)


@intrinsic
def table(_, work, k, m, n):  # type: ignore[no-untyped-def]
    """Return rows k, k + 1, ... as (m, n, lanes)."""
    return _view(work, [types.intp] * 3, 3, _stride)


def call_entry(context: Any, builder: Any, signature: Any, own: Any, number: int, args: Any) -> Any:
    """Generate the call of the address at an entry of a table; ``args`` are the table and a tuple of arguments.

    ``own`` are their types.
    """
    data = context.make_array(own.args[0])(context, builder, args[0]).data
    address = builder.load(builder.gep(data, [ir.Constant(ir.IntType(64), number)]))
    return call_at(context, builder, signature, address, args[1])
