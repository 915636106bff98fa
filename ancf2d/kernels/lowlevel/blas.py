"""Matrix products by SciPy's BLAS, called by address, so that a call costs no more than a small product."""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from importlib import import_module
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import scipy
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_INT, _DOUBLE = ir.IntType(32), ir.DoubleType()
_DGEMM = ir.FunctionType(ir.VoidType(), [
    ir.IntType(8).as_pointer(), ir.IntType(8).as_pointer(), *[_INT.as_pointer()] * 3, _DOUBLE.as_pointer(),
    _DOUBLE.as_pointer(), _INT.as_pointer(), _DOUBLE.as_pointer(), _INT.as_pointer(), _DOUBLE.as_pointer(),
    _DOUBLE.as_pointer(), _INT.as_pointer()])


@cache
def dgemm_address() -> int:
    """Return the address of BLAS's dgemm, the first argument of ``multiply``.

    Only its module is loaded, under its own name, since importing all of scipy.linalg takes longer than solving a small
    case.
    """
    name = "scipy.linalg.cython_blas"
    if name not in sys.modules:
        folder = Path(scipy.__file__).parent / "linalg"
        found = [path for suffix in EXTENSION_SUFFIXES if (path := folder / f"cython_blas{suffix}").exists()]
        spec = spec_from_file_location(name, found[0]) if found else None
        if spec is not None and spec.loader is not None:
            sys.modules[name] = module = module_from_spec(spec)
            spec.loader.exec_module(module)
    # capsule of a public Cython function, as numba uses it, too
    capsule = import_module(name).__pyx_capi__["dgemm"]
    named = ctypes.pythonapi.PyCapsule_GetName
    named.restype, named.argtypes = ctypes.c_char_p, [ctypes.py_object]
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return int(pointer(capsule, named(capsule)))


def _multiplier(transposed: bool) -> Any:
    @intrinsic
    def multiply(_, dgemm, A, a, B, b, C, c, rows, inner, columns, add):  # type: ignore[no-untyped-def]
        def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
            address, A, a, B, b, C, c, rows, inner, columns, add = args

            def start(array, type_, first):  # type: ignore[no-untyped-def]
                data = context.make_array(type_)(context, builder, array).data
                return builder.gep(data, [first])

            def held(value):  # type: ignore[no-untyped-def]
                slot = cgutils.alloca_once(builder, value.type)
                builder.store(value, slot)
                return slot

            m, k, n = (held(builder.trunc(v, _INT)) for v in (rows, inner, columns))
            plain, turned = (held(ir.Constant(ir.IntType(8), ord(x))) for x in "NT")
            one, beta = held(ir.Constant(_DOUBLE, 1.0)), held(builder.uitofp(add, _DOUBLE))
            # row-major here, column-major in BLAS: C^T = B^T A^T
            arguments = [plain, turned if transposed else plain, n, m, k, one, start(B, signature.args[3], b), n,
                         start(A, signature.args[1], a), m if transposed else k, beta,
                         start(C, signature.args[5], c), n]
            builder.call(builder.inttoptr(address, _DGEMM.as_pointer()), arguments)
            return context.get_dummy_value()

        number = types.intp
        return types.void(number, A, number, B, number, C, number, number, number, number, types.boolean), generate

    return multiply


# C (rows, columns) = A (rows, inner) B, or A^T B with A (inner, rows); added to C if ``add``. Each array is followed by
# the entry where its matrix starts: multiply(dgemm, A, a, B, b, C, c, rows, inner, columns, add)
multiply, multiply_transposed = _multiplier(False), _multiplier(True)
