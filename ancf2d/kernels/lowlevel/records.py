"""Records of arrays that kernels take by their address, so that one number crosses a call, whatever is in them.

A named tuple crosses a call as all that is in its arrays, some hundred numbers for a model in motion, and every
function that it goes through is compiled for all of them.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
    unbox,
)
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


_WORD, _BYTES = ir.IntType(64), 8
_KINDS = {"f": types.float64, "i": types.int64, "b": types.boolean, "c": types.complex128}


class RecordType(types.Type):  # type: ignore[misc]
    """The type of records of one kind of named tuple: ``fields`` (name, type) in the order of the tuple.

    They are laid out in words of 8 bytes: a number is one, an array the address of its first entry and its shape.
    """

    def __init__(self, kind: type, fields: tuple[tuple[str, types.Type], ...]) -> None:
        self.kind, self.fields, at = kind, fields, 0
        self.place: dict[str, tuple[int, types.Type]] = {}
        for name, field in fields:
            self.place[name] = at, field
            at += words_of(field)
        self.words = at
        inside = ",".join(f.name for _, f in fields)
        super().__init__(name=f"{kind.__name__}({inside})")

    def whole(self) -> types.Type:
        """Return the type of the named tuple itself."""
        inside = [f.whole() if isinstance(f, RecordType) else f for _, f in self.fields]
        return types.BaseTuple.from_types(inside, self.kind)


def words_of(field: types.Type) -> int:
    """Return how many words a field takes."""
    if isinstance(field, RecordType):
        return field.words
    return 1 + field.ndim if isinstance(field, types.Array) else 1


@register_model(RecordType)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: RecordType) -> None:
        super().__init__(manager, kind, _WORD)


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    key = RecordType

    def generic_resolve(self, record: Any, name: Any) -> Any:  # type: ignore[override]
        return record.place[name][1] if name in record.place else None


def _word(builder: Any, address: Any, at: int, kind: Any = _WORD) -> Any:
    """Return a word of a record; while a kernel runs it stays as it is, so that loops need not look again."""
    pointer = builder.inttoptr(builder.add(address, ir.Constant(_WORD, _BYTES * at)), kind.as_pointer())
    word = builder.load(pointer)
    word.set_metadata("invariant.load", builder.module.add_metadata([]))
    return word


def _field(context: Any, builder: Any, address: Any, at: int, kind: types.Type) -> Any:
    if isinstance(kind, RecordType):
        return builder.add(address, ir.Constant(_WORD, _BYTES * at))
    if isinstance(kind, types.Array):
        data = builder.inttoptr(_word(builder, address, at), context.get_data_type(kind.dtype).as_pointer())
        return array_over(context, builder, kind, data, [_word(builder, address, at + 1 + k) for k in range(kind.ndim)])
    if kind == types.boolean:
        return builder.trunc(_word(builder, address, at), ir.IntType(1))
    return _word(builder, address, at, context.get_value_type(kind))


@lower_getattr_generic(RecordType)
def _load(context: Any, builder: Any, record: RecordType, address: Any, name: str) -> Any:
    at, kind = record.place[name]
    return _field(context, builder, address, at, kind)


def _whole(context: Any, builder: Any, record: RecordType, address: Any) -> Any:
    values = []
    for at, kind in record.place.values():
        value = _field(context, builder, address, at, kind)
        values.append(_whole(context, builder, kind, value) if isinstance(kind, RecordType) else value)
    return context.make_tuple(builder, record.whole(), values)


def _of_record(_: Any, record: Any) -> Any:
    return record.whole()(record), lambda context, builder, signature, args: _whole(context, builder, record, args[0])


# in kernels, the named tuple of a record: ``whole(record)``
whole: Any = intrinsic(_of_record)


def at(kind: RecordType) -> Any:
    """Return what takes, in kernels, the record of a type that is at an address."""
    @intrinsic
    def record_at(_: Any, address: Any) -> Any:
        return kind(types.int64), lambda context, builder, signature, args: args[0]

    return record_at


@unbox(RecordType)
def _unbox(kind: RecordType, record: Any, c: Any) -> Any:
    number = c.pyapi.object_getattr_string(record, "address")
    with cgutils.if_unlikely(c.builder, cgutils.is_null(c.builder, number)):
        c.builder.ret(c.pyapi.get_null_object())
    address = c.pyapi.long_as_longlong(number)
    c.pyapi.decref(number)
    return NativeValue(address)


# types by what they are made of: to make one takes far longer than to find it, and a motion has dozens of records
_ARRAYS: dict[tuple[str, int], types.Type] = {}
_RECORDS: dict[tuple[Any, ...], RecordType] = {}


def type_of(values: Any) -> Any:
    """Return the type of a field: a number, an array row by row, or a named tuple of such."""
    if isinstance(values, np.ndarray):
        key = values.dtype.kind, values.ndim
        if key not in _ARRAYS:
            _ARRAYS[key] = types.Array(_KINDS[key[0]], key[1], "C")
        return _ARRAYS[key]
    if isinstance(values, tuple):
        fields = [type_of(v) for v in values]
        # the types of fields live as long as this table: there is one of each kind
        one = (type(values), *map(id, fields))
        if one not in _RECORDS:
            _RECORDS[one] = RecordType(type(values), tuple(zip(values._fields, fields, strict=True)))  # type: ignore[attr-defined]
        return _RECORDS[one]
    return _KINDS["b" if isinstance(values, bool | np.bool_) else "i" if isinstance(values, int | np.integer) else "f"]


class Record:
    """A named tuple of numbers, arrays and named tuples, as kernels take it; its fields are those of the tuple.

    Raises ValueError for arrays that are not row by row in 8 byte numbers (1 of booleans, 16 of complex numbers).
    """

    __slots__ = ("_nested", "_numba_type_", "_others", "_words", "address", "values")

    def __init__(self, values: Any, words: Any = None, others: Any = None, kind: RecordType | None = None) -> None:
        # other records whose addresses are among the values live as long as this one
        self.values, self._numba_type_, self._others = values, kind or type_of(values), others
        self._words = np.zeros(self._numba_type_.words, dtype=np.int64) if words is None else words
        self.address, self._nested = self._words.ctypes.data, {}
        for (at, kind), name, value in zip(self._numba_type_.place.values(), values._fields, values, strict=True):
            if isinstance(kind, RecordType):
                self._nested[name] = Record(value, self._words[at:at + kind.words], kind=kind)
            else:
                self._words[at:at + words_of(kind)] = _as_words(kind, value)

    @property
    def layout(self) -> RecordType:
        """The type that kernels know it by."""
        return self._numba_type_

    def __getattr__(self, name: str) -> Any:
        return self._nested[name] if name in self._nested else getattr(self.values, name)


def _as_words(kind: types.Type, value: Any) -> Any:
    if isinstance(kind, types.Array):
        size = {types.boolean: 1, types.complex128: 16}.get(kind.dtype, 8)
        if not value.flags.c_contiguous or value.dtype.itemsize != size:
            raise ValueError(f"an array {value.dtype} {value.strides} cannot be part of a record")
        return [value.ctypes.data, *value.shape]
    return ctypes.c_int64.from_buffer(ctypes.c_double(value)).value if kind == types.float64 else int(value)
