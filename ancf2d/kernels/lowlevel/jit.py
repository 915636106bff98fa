"""Compilation of kernels and their storage between processes; functions called only by kernels get no machine code.

numba stops before it generates machine code (``no_compile``). Functions called only by kernels (``inner``) are stored
as code to be linked: they are optimised and compiled to machine code only as parts of the kernels that call them.
"""

from __future__ import annotations

import ctypes
import hashlib
import mmap
import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numba
from llvmlite import binding
from numba import _dynfunc, types
from numba.core import compiler
from numba.core.runtime import rtsys

from .cache import SUFFIX, cache_folder, file_of, read, write

_REFUSE = ctypes.cast(ctypes.pythonapi.PyErr_BadArgument, ctypes.c_void_p).value
# folder of compiled kernels, or None with the reason why there is none
CACHE, REFUSED = cache_folder()
# set to 1 as soon as this process, or a fork of it, has to compile a kernel
_MISSED = mmap.mmap(-1, 1)
# functions whose kernels are optimised for size
_SELDOM: set[Any] = set()


class _Kernel:
    """The compiler of kernels, which replaces numba's, and the form in which results are stored."""

    def __init__(self, typing: Any, target: Any, library: Any, args: Any, restype: Any, flags: Any,
                 *rest: Any) -> None:
        flags.no_compile = True
        self._compiler = compiler.Compiler(typing, target, library, args, restype, flags, *rest)

    def compile_extra(self, function: Any) -> Any:
        """Compile a function with all it calls linked in, and register it for its callers; return numba's result."""
        result = self._compiler.compile_extra(function)
        library = result.library
        for other in dict.fromkeys(library._linking_libraries):
            library._reload_init.update(other._reload_init)
            library._final_module.link_in(other._get_module_for_linking(), preserve=True)
        library._linking_libraries.clear()
        if function in _SELDOM:
            for each in library._final_module.functions:
                if not each.is_declaration:
                    each.add_function_attribute("optsize")
        result.reload_init.extend(library._reload_init)
        result = self._finished(result)
        result.target_context.insert_user_function(result.entry_point, result.fndesc, [library])
        return result

    @staticmethod
    def _finished(result: Any) -> Any:
        """Generate machine code, with private copies of all functions that are linked into it.

        These functions have the same name in every kernel, but each kernel optimises its copy differently, e.g. sums in
        another order. Under a shared name a kernel would call the copy loaded first, so the last digits would differ
        between a process that has compiled other kernels and one that loads them. The functions of reference counting
        keep their names, by which numba removes counts that cancel.
        """
        mark = hashlib.sha256(result.fndesc.mangled_name.encode()).hexdigest()[:12]
        for function in result.library._final_module.functions:
            shared = function.linkage == binding.Linkage.linkonce_odr and not function.name.startswith("NRT_")
            if shared and not function.is_declaration:
                function.name = f"{function.name}.{mark}"
        entry = result.target_context.get_executable(result.library, result.fndesc, result.environment)
        return result._replace(entry_point=_entry(result, entry))

    @staticmethod
    def reduced(result: Any) -> Any:
        """Return the picklable part of a result."""
        return result._reduce()

    @staticmethod
    def rebuilt(target: Any, kept: Any) -> Any:
        """Return the result from its ``reduced`` form."""
        result = compiler.CompileResult._rebuild(target, *kept)
        return result._replace(entry_point=_entry(result, result.entry_point))


class _Inner(_Kernel):
    """The compiler of functions called only by kernels: linkable code, which kernels optimise after linking."""

    @staticmethod
    def _finished(result: Any) -> Any:
        for function in result.library._final_module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.external:
                function.linkage = binding.Linkage.linkonce_odr
        return _linkable(result)

    @staticmethod
    def reduced(result: Any) -> Any:
        result.fndesc.typemap = result.fndesc.calltypes = None
        return (result.library._final_module.as_bitcode(), result.fndesc, result.environment, result.signature,
                result.reload_init, tuple(result._find_referenced_environments()))

    @staticmethod
    def rebuilt(target: Any, kept: Any) -> Any:
        code, fndesc, environment, signature, reload_init, environments = kept
        for function in reload_init:
            function()
        library = target.codegen().create_library("linked")
        library._final_module = binding.parse_bitcode(code)
        return _linkable(compiler.compile_result(
            typing_context=target.typing_context, target_context=target, library=library, fndesc=fndesc,
            environment=environment, signature=signature, objectmode=False, lifted=(), reload_init=reload_init,
            referenced_envs=list(environments)))


def _linkable(result: Any) -> Any:
    """Return a result without machine code, ready for linking into others."""
    library = result.library
    library._finalize_dynamic_globals()
    library._shared_module, library._finalized = library._final_module, True
    return result._replace(entry_point=_entry(result, None))


def _entry(result: Any, wrapper: Any) -> Any:
    """Return the Python entry point, by which numba identifies functions; without wrapper, a call raises TypeError."""
    fndesc, library = result.fndesc, result.library
    if wrapper is not None and library.get_pointer_to_function(fndesc.llvm_cpython_wrapper_name):
        return wrapper
    return _dynfunc.make_function(fndesc.lookup_module(), fndesc.qualname, "", _REFUSE, result.environment, (library,))


class Storage:
    """Storage of the compiled code of one function between processes, which replaces numba's cache."""

    def __init__(self, function: Callable[..., Any], folder: Any, kind: type[_Kernel]) -> None:
        self.function, self.cache_path, self._kind = function, folder, kind

    def load_overload(self, sig: Any, target: Any) -> Any:
        """Return the stored result for argument types, or None.

        Its machine code is complete: it needs only numba's memory management, not the modules that compiling needs
        (e.g. numba's and scipy's linear algebra), which take longer to import than a small case to solve. A file that
        cannot be read is compiled again and replaced.
        """
        rtsys.initialize(target)
        with suppress(Exception):
            return self._kind.rebuilt(target, read(self._file(sig, target)))
        _MISSED[0] = 1
        return None

    def save_overload(self, sig: Any, result: Any) -> None:
        """Store a compiled result; if that fails, it is available only in this process."""
        if result.library.has_dynamic_globals:
            warnings.warn(f"'{self.function.__qualname__}' refers to large arrays or addresses: every run compiles it",
                          numba.errors.NumbaWarning, stacklevel=2)
            return
        with suppress(OSError, ValueError):
            write(self._file(sig, result.target_context), self._kind.reduced(result))

    def _file(self, sig: Any, target: Any) -> Any:
        return file_of(self.cache_path, self.function, f"{sig} {target.codegen().magic_tuple()}")


_PRESET: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "reassoc"}, "no_cfunc_wrapper": True}
# reference counting doubles the code, so functions that allocate no arrays are compiled without it
_NO_MEMORY: dict[str, Any] = {"_nrt": False}
# explicit, because numba compiles callees with the options of their caller
_MEMORY: dict[str, Any] = {"_nrt": True}


def _compiled(function: Callable[..., Any], kind: type[_Kernel] = _Kernel, **options: Any) -> Any:
    compiled = numba.njit(pipeline_class=kind, **_PRESET, **options)(function)
    if CACHE is not None:  # else each process compiles for itself
        compiled._cache = Storage(function, CACHE, kind)
    template = compiled.get_call_template

    def for_any_value(args: Any, kws: Any) -> Any:
        # numba would compile a kernel for each constant that other kernels call it with
        return template([types.unliteral(a) for a in args], {k: types.unliteral(a) for k, a in kws.items()})

    compiled.get_call_template = for_any_value
    return compiled


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a module-level function on first use, cached between processes; NaN-safe, no Python objects.

    It must not allocate arrays, nor call functions that return newly allocated ones: see ``kernel_with_memory``.
    """
    return _compiled(function, **_NO_MEMORY)


def seldom(function: Callable[..., Any]) -> Callable[..., Any]:
    """Mark a kernel that runs at most once per step: it is optimised for size, which takes LLVM half as long."""
    _SELDOM.add(function)
    return function


def shared(function: Callable[..., Any]) -> Any:
    """Compile as ``kernel``, without Python's global lock, so that several threads can run it at once."""
    return _compiled(function, nogil=True, **_NO_MEMORY)


def kernel_with_memory(function: Callable[..., Any]) -> Any:
    """Compile as ``kernel`` a function that allocates arrays."""
    return _compiled(function, **_MEMORY)


def addressed(function: Callable[..., Any]) -> Any:
    """Compile as ``kernel`` a function that is only called by address, without the Python wrapper, to save time."""
    return _compiled(function, no_cpython_wrapper=True, **_NO_MEMORY)


def addressed_with_memory(function: Callable[..., Any]) -> Any:
    """Compile as ``addressed`` a function that allocates arrays."""
    return _compiled(function, no_cpython_wrapper=True, **_MEMORY)


def named(function: Callable[..., Any], kind: str) -> Callable[..., Any]:
    """Append ``kind`` to a function's qualified name, by which the cache distinguishes its variants; return it."""
    function.__qualname__ = f"{function.__name__}_{kind}"
    return function


def inner(function: Callable[..., Any]) -> Any:
    """Compile as ``kernel`` a function that only kernels call; it is linked into them."""
    return _compiled(function, _Inner, no_cpython_wrapper=True, **_NO_MEMORY)


def inner_with_memory(function: Callable[..., Any]) -> Any:
    """Compile as ``inner`` a function that allocates arrays."""
    return _compiled(function, _Inner, no_cpython_wrapper=True, **_MEMORY)


def merged(function: Callable[..., Any]) -> Any:
    """Compile as ``inner``, and force LLVM to inline the function, which makes some kernels faster."""
    return _compiled(function, _Inner, no_cpython_wrapper=True, forceinline=True, **_NO_MEMORY)


def inlined(function: Callable[..., Any]) -> Any:
    """Inline a helper in numba itself, where a caller needs its stack frame or its constants.

    This takes long to compile; use ``merged`` otherwise.
    """
    return numba.njit(inline="always")(function)


def expect_kernels() -> None:
    """Reset ``missed``, which then reports only kernels compiled from here on."""
    _MISSED[0] = 0


def missed() -> bool:
    """Return whether this process or a fork had to compile a kernel since ``expect_kernels``, or there is no cache."""
    return CACHE is None or _MISSED[0] == 1


def cache_is_cold() -> bool:
    """Return whether the cache has no kernel of this version yet, so that the first run takes longer."""
    return CACHE is not None and not any(CACHE.glob(f"*{SUFFIX}"))
