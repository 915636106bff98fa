"""How kernels are compiled and kept between processes; what only kernels call gets no machine code of its own.

numba stops before it makes machine code (``no_compile``). What only kernels call (``inner``) is kept as code to be
linked: it is optimised, and made machine code of, once, in the kernels that it becomes part of.
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
# where compiled kernels are kept; None, and why, where they cannot be
CACHE, REFUSED = cache_folder()
# the first byte is 1 as soon as this process, or a copy of it, has a kernel to compile
_MISSED = mmap.mmap(-1, 1)
# functions that kernels are made of for size
_SELDOM: set[Any] = set()


class _Kernel:
    """How a kernel is compiled, in the place of numba's compiler, and what of it is kept."""

    def __init__(self, typing: Any, target: Any, library: Any, args: Any, restype: Any, flags: Any,
                 *rest: Any) -> None:
        flags.no_compile = True
        self._compiler = compiler.Compiler(typing, target, library, args, restype, flags, *rest)

    def compile_extra(self, function: Any) -> Any:
        """Return what numba compiles a function to, known to those who call it."""
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
        """Make machine code, with copies of its own of all that is linked into it.

        Those have the same name in each kernel that they are linked into, but are optimised with its other parts: sums
        are in another order. By that name a kernel would call the copy that happens to be there first, so that a
        process that has just compiled other kernels had other last digits than one that found its kernels kept. What
        counts references keeps its name, by which numba finds counts that cancel.
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
        """Return what can be pickled of a result."""
        return result._reduce()

    @staticmethod
    def rebuilt(target: Any, kept: Any) -> Any:
        """Return the result that was reduced."""
        result = compiler.CompileResult._rebuild(target, *kept)
        return result._replace(entry_point=_entry(result, result.entry_point))


class _Inner(_Kernel):
    """What only kernels call: code that is linked into theirs, which would optimise all of it once more."""

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
    """Return a result without machine code, whose code can be linked."""
    library = result.library
    library._finalize_dynamic_globals()
    library._shared_module, library._finalized = library._final_module, True
    return result._replace(entry_point=_entry(result, None))


def _entry(result: Any, wrapper: Any) -> Any:
    """Return what Python calls, and numba tells functions apart by: where there is no way in, it raises TypeError."""
    fndesc, library = result.fndesc, result.library
    if wrapper is not None and library.get_pointer_to_function(fndesc.llvm_cpython_wrapper_name):
        return wrapper
    return _dynfunc.make_function(fndesc.lookup_module(), fndesc.qualname, "", _REFUSE, result.environment, (library,))


class Kept:
    """The compiled code of one function between processes, in the place of numba's cache."""

    def __init__(self, function: Callable[..., Any], folder: Any, kind: type[_Kernel]) -> None:
        self.function, self.cache_path, self._kind = function, folder, kind

    def load_overload(self, sig: Any, target: Any) -> Any:
        """Return what was kept for argument types, or None.

        Its machine code is complete: of numba it needs the memory management, and nothing of what compiling needs
        (all that a kernel may call, numba's and scipy's linear algebra among it), which takes longer to import than
        a small case to solve. What cannot be read is compiled anew, in its place.
        """
        rtsys.initialize(target)
        with suppress(Exception):
            return self._kind.rebuilt(target, read(self._file(sig, target)))
        _MISSED[0] = 1
        return None

    def save_overload(self, sig: Any, result: Any) -> None:
        """Keep what was compiled where there is room; else it is compiled for this process alone."""
        if result.library.has_dynamic_globals:
            warnings.warn(f"'{self.function.__qualname__}' refers to large arrays or addresses: every run compiles it",
                          numba.errors.NumbaWarning, stacklevel=2)
            return
        with suppress(OSError, ValueError):
            write(self._file(sig, result.target_context), self._kind.reduced(result))

    def _file(self, sig: Any, target: Any) -> Any:
        return file_of(self.cache_path, self.function, f"{sig} {target.codegen().magic_tuple()}")


_PRESET: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "reassoc"}, "no_cfunc_wrapper": True}
# code that counts references to arrays is as much as all else: what makes no arrays is compiled without
_NO_MEMORY: dict[str, Any] = {"_nrt": False}
# said, as numba compiles what is called as its caller is
_MEMORY: dict[str, Any] = {"_nrt": True}


def _compiled(function: Callable[..., Any], kind: type[_Kernel] = _Kernel, **options: Any) -> Any:
    compiled = numba.njit(pipeline_class=kind, **_PRESET, **options)(function)
    if CACHE is not None:  # else each process compiles for itself
        compiled._cache = Kept(function, CACHE, kind)
    template = compiled.get_call_template

    def for_any_value(args: Any, kws: Any) -> Any:
        # numba would compile a kernel for each constant that other kernels call it with
        return template([types.unliteral(a) for a in args], {k: types.unliteral(a) for k, a in kws.items()})

    compiled.get_call_template = for_any_value
    return compiled


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a module-level function on first use, cached between processes; NaN-safe, no Python objects.

    It makes no arrays, nor does it call what returns arrays that it made: see ``kernel_with_memory``.
    """
    return _compiled(function, **_NO_MEMORY)


def seldom(function: Callable[..., Any]) -> Callable[..., Any]:
    """Let a kernel that runs once in a step, or less, be optimised for its size, which takes LLVM half as long."""
    _SELDOM.add(function)
    return function


def shared(function: Callable[..., Any]) -> Any:
    """Compile as ``kernel`` what several threads do at once: Python's lock is let go meanwhile."""
    return _compiled(function, nogil=True, **_NO_MEMORY)


def kernel_with_memory(function: Callable[..., Any]) -> Any:
    """Compile as ``kernel`` what makes arrays."""
    return _compiled(function, **_MEMORY)


def addressed(function: Callable[..., Any]) -> Any:
    """Compile as ``kernel`` what is called by its address alone: the way in from Python takes long to compile."""
    return _compiled(function, no_cpython_wrapper=True, **_NO_MEMORY)


def addressed_with_memory(function: Callable[..., Any]) -> Any:
    """Compile as ``addressed`` what makes arrays."""
    return _compiled(function, no_cpython_wrapper=True, **_MEMORY)


def named(function: Callable[..., Any], kind: str) -> Callable[..., Any]:
    """Return a function of which there are several kinds under the name that the cache tells it from others by."""
    function.__qualname__ = f"{function.__name__}_{kind}"
    return function


def inner(function: Callable[..., Any]) -> Any:
    """Compile as ``kernel`` what only kernels call: it becomes a part of them."""
    return _compiled(function, _Inner, no_cpython_wrapper=True, **_NO_MEMORY)


def inner_with_memory(function: Callable[..., Any]) -> Any:
    """Compile as ``inner`` what makes arrays."""
    return _compiled(function, _Inner, no_cpython_wrapper=True, **_MEMORY)


def merged(function: Callable[..., Any]) -> Any:
    """Compile as ``inner`` what kernels are faster with when LLVM sees it whole: it makes no call of it."""
    return _compiled(function, _Inner, no_cpython_wrapper=True, forceinline=True, **_NO_MEMORY)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a helper anew into each of its callers, where numba must see it whole (its frame, or what is constant).

    This takes long to compile: ``merged`` is for all else.
    """
    return numba.njit(inline="always")(function)


def expect_kernels() -> None:
    """Forget that kernels had to be compiled so far: ``missed`` tells of those to come."""
    _MISSED[0] = 0


def missed() -> bool:
    """Whether a kernel was compiled since ``expect_kernels``, by this process or a copy of it, as none was kept."""
    return CACHE is None or _MISSED[0] == 1


def cache_is_cold() -> bool:
    """Whether this machine has compiled no kernel of this version yet (the first run takes longer)."""
    return CACHE is not None and not any(CACHE.glob(f"*{SUFFIX}"))
