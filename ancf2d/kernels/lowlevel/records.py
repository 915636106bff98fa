"""Records: named tuples of arrays that kernels take by address, so that a call passes one number.

numba passes a named tuple as all fields of all its arrays, some hundred numbers for a model in motion, and compiles
every function on the way for all of them.
"""

from __future__ import annotations

import ctypes
import hashlib
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
    """Return the address of a kernel compiled for a signature; it is valid as long as the kernel lives.

    Raises TypeError if the kernel returns another type.
    """
    function.compile(signature.args)
    result = function.get_compile_result(signature)
    if result.signature.return_type != signature.return_type:
        raise TypeError(f"{function} returns {result.signature.return_type}, not {signature.return_type}")
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


def call_at(context: Any, builder: Any, signature: Any, address: Any, packed: Any) -> Any:
    """Generate a call of a function by address with a tuple of arguments; return its result."""
    restype, argtypes = signature.return_type, signature.args
    values = cgutils.unpack_tuple(builder, packed, len(argtypes))
    kind: ir.FunctionType = context.call_conv.get_function_type(restype, argtypes)
    status, out = context.call_conv.call_function(
        builder, builder.inttoptr(address, kind.as_pointer()), restype, argtypes, values)
    with cgutils.if_unlikely(builder, status.is_error):
        context.call_conv.return_status_propagate(builder, status)
    return out


def caller(signature: Any) -> Callable[..., Any]:
    """Return the intrinsic that calls functions of one signature by address: ``call(address, (argument, ...))``."""
    restype, argtypes = signature.return_type, signature.args

    def generate(context: Any, builder: Any, _: Any, args: Any) -> Any:
        return call_at(context, builder, signature, *args)

    @intrinsic
    def call(_: Any, address: Any, arguments: Any) -> Any:  # pragma: no cover - runs in the compiler
        return restype(types.int64, types.Tuple(argtypes)), generate

    return call  # type: ignore[no-any-return]


def array_over(context: Any, builder: Any, kind: Any, data: Any, dims: Any) -> Any:
    """Return a C-contiguous array over memory that it does not own, without reference counting."""
    intp = context.get_value_type(types.intp)
    size = intp(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    strides = [size]
    for dim in dims[:0:-1]:
        strides.insert(0, builder.mul(strides[0], dim))
    out = arrayobj.make_array(kind)(context, builder)
    arrayobj.populate_array(out, data=data, shape=dims, strides=strides, itemsize=size, meminfo=None, parent=None)
    return out._getvalue()


# distance of rows in a work buffer: more than LANES, so that rows do not map to the same cache lines
STRIDE = 72


def _view(buffer: Any, places: list[Any], dimensions: int, parts: Any) -> Any:
    """Return signature and generator of an array over a buffer; ``parts`` returns (first entry, shape) for ``places``.
    """
    result = types.Array(buffer.dtype, dimensions, "C")

    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        first, dims = parts(builder, *args[1:])
        data = builder.gep(arrayobj.make_array(buffer)(context, builder, args[0]).data, [first])
        return array_over(context, builder, result, data, dims)

    return result(buffer, *places), generate


@intrinsic
def array_at(_, buffer, first, shape):  # type: ignore[no-untyped-def]
    """Return an array of a shape over a buffer from entry ``first`` on, without reference counting."""
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
    """Generate a call of the function at entry ``number`` of a table of addresses.

    ``args`` are the table and a tuple of arguments, ``own`` the signature with their types.
    """
    data = context.make_array(own.args[0])(context, builder, args[0]).data
    address = builder.load(builder.gep(data, [ir.Constant(ir.IntType(64), number)]))
    return call_at(context, builder, signature, address, args[1])


_WORD, _BYTES = ir.IntType(64), 8
_KINDS = {"f": types.float64, "i": types.int64, "b": types.boolean, "c": types.complex128}


class RecordType(types.Type):  # type: ignore[misc]
    """The numba type of records of one named tuple class: ``fields`` (name, type) in the order of the tuple.

    A record consists of words of 8 bytes: one for a number, the address of the first entry and the shape for an array.
    """

    def __init__(self, kind: type, fields: tuple[tuple[str, types.Type], ...]) -> None:
        self.kind, self.fields, at = kind, fields, 0
        self.place: dict[str, tuple[int, types.Type]] = {}
        for name, field in fields:
            self.place[name] = at, field
            at += words_of(field)
        self.words = at
        inside = ",".join(f.name for _, f in fields)
        # short, since it is part of the names of all functions that take the record
        super().__init__(name=f"{kind.__name__}_{hashlib.sha256(inside.encode()).hexdigest()[:12]}")

    def whole(self) -> types.Type:
        """Return the type of the named tuple itself."""
        inside = [f.whole() if isinstance(f, RecordType) else f for _, f in self.fields]
        return types.BaseTuple.from_types(inside, self.kind)


def words_of(field: types.Type) -> int:
    """Return the number of words of a field."""
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
    """Return a word of a record, marked as constant while a kernel runs, so that loops need not reload it."""
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


# for kernels: ``whole(record)`` returns the named tuple of a record
whole: Any = intrinsic(_of_record)


def at(kind: RecordType) -> Any:
    """Return the intrinsic that makes, in kernels, a record of this type from its address."""
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


# record types by form (``_form``); making one takes as long as a small solve
_TYPES: dict[Any, RecordType] = {}


def _form(value: Any) -> Any:
    """Return a hashable description of a value that determines the type of a field."""
    if isinstance(value, np.ndarray):
        return value.dtype.kind, value.ndim
    if isinstance(value, tuple):
        return type(value), *map(_form, value)
    return "b" if isinstance(value, bool | np.bool_) else "i" if isinstance(value, int | np.integer) else "f"


def type_of(values: Any) -> Any:
    """Return the numba type of a field: a number, a C-contiguous array, or a named tuple of these."""
    return _type(_form(values))


def _type(form: Any) -> Any:
    if isinstance(form, str):
        return _KINDS[form]
    kind, *inside = form
    if isinstance(kind, str):
        return types.Array(_KINDS[kind], inside[0], "C")
    if form not in _TYPES:
        _TYPES[form] = RecordType(kind, tuple(zip(kind._fields, map(_type, inside), strict=True)))
    return _TYPES[form]


class Record:
    """A named tuple of numbers, arrays and named tuples that kernels take by address, with the tuple's attributes.

    Raises ValueError for arrays that are not C-contiguous with 8-byte numbers (booleans 1 byte, complex 16).
    """

    def __init__(self, values: Any, others: Any = None) -> None:
        # keeps other records alive whose addresses are among the values
        self._others = others
        self._lay(values, type_of(values), np.array(_words(values, []), dtype=np.int64))

    def _lay(self, values: Any, kind: RecordType, words: Any) -> None:
        self.values, self._numba_type_, self._words = values, kind, words
        self.address = words.ctypes.data

    def replaced(self, others: Any = None, **fields: Any) -> Record:
        """Return a copy with other values of some fields, of the same types; it keeps ``others`` alive."""
        out, words = Record.__new__(Record), self._words.copy()
        for name, value in fields.items():
            _replace(words, *self._numba_type_.place[name], value, getattr(self.values, name))
        out._others = self._others, others
        out._lay(self.values._replace(**fields), self._numba_type_, words)
        return out

    @property
    def layout(self) -> RecordType:
        """The record's type in kernels."""
        return self._numba_type_

    def __getattr__(self, name: str) -> Any:
        value = getattr(self.values, name)
        if isinstance(value, tuple) and name in self._numba_type_.place:
            at, kind = self._numba_type_.place[name]
            inside = Record.__new__(Record)
            inside._lay(value, kind, self._words[at:at + kind.words])
            value = inside
        # so that the next access does not get here
        self.__dict__[name] = value
        return value


def _replace(words: Any, at: int, kind: Any, new: Any, old: Any) -> None:
    """Write the words of a field, except for unchanged parts. Raises TypeError if the type changes."""
    if new is old:
        return
    if isinstance(kind, RecordType):
        for (place, inside), one, other in zip(kind.place.values(), new, old, strict=True):
            _replace(words, at + place, inside, one, other)
    elif _form(new) != _form(old):
        raise TypeError(f"a field of a record became {type(new)}")
    else:
        words[at:at + words_of(kind)] = _words((new,), [])


# size of an entry of an array in a record by its kind; others have 8 bytes
_SIZES = {"b": 1, "c": 16}
# NumPy's arrays begin, like all objects, with a head, and then the address of their data
_word_at, _HEAD = ctypes.c_ssize_t.from_address, object.__basicsize__


def _words(values: Any, out: list[int]) -> list[int]:
    """Append the words of a named tuple to ``out``, and return it."""
    for value in values:
        if isinstance(value, np.ndarray):
            if not value.flags.c_contiguous or value.itemsize != _SIZES.get(value.dtype.kind, 8):
                raise ValueError(f"an array {value.dtype} {value.strides} cannot be part of a record")
            # __array_interface__ and ctypes.data take ten times as long
            out.append(_word_at(id(value) + _HEAD).value)
            out += value.shape
        elif isinstance(value, tuple):
            _words(value, out)
        elif isinstance(value, bool | np.bool_ | int | np.integer):
            out.append(int(value))
        else:
            out.append(ctypes.c_int64.from_buffer(ctypes.c_double(value)).value)
    return out
