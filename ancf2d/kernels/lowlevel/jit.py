"""How kernels are compiled: one preset, and a cache that can never serve stale or damaged machine code."""

from __future__ import annotations

import ctypes
import hashlib
import io
import mmap
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numba
from llvmlite import binding
from numba import _dynfunc, types
from numba.core import compiler, config
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.runtime import rtsys

from .cache import cache_folder, fingerprint, is_private

_REFUSE = ctypes.cast(ctypes.pythonapi.PyErr_BadArgument, ctypes.c_void_p).value


class Own(JITCodeLibrary):
    """Code of a kernel with its own copies of all that is linked into it.

    Those have the same name in each kernel that they are linked into, but are optimised with its other parts: sums are
    in another order. By that name a kernel would call the copy that happens to be there first, so that a process that
    has just compiled other kernels had other last digits than one that found its kernels in the cache.
    """

    def _finalize_final_module(self) -> None:
        self._shared_module = self._for_linking()
        mark = hashlib.sha256(self.name.encode()).hexdigest()[:12]
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.linkonce_odr:
                function.name = f"{function.name}.{mark}"
        super()._finalize_final_module()

    def _for_linking(self) -> Any:
        """Return the code under the names that callers know, as numba's ``_get_module_for_linking`` does."""
        module = self._final_module.clone()
        for function in module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.external:
                function.linkage = binding.Linkage.linkonce_odr
        return module


class Lean(Own):
    """Code that counts no references, which numba goes through three times to find those that cancel."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout
        manager, builder = self._codegen._function_pass_manager(opt=1, loop_vectorize=False, slp_vectorize=False)
        for function in ll_module.functions:
            if not function.is_declaration:
                manager.run(function, builder)

    def _optimize_final_module(self) -> None:
        manager, builder = self._codegen._module_pass_manager()
        manager.run(self._final_module, builder)


class Linked(Lean):
    """Code that is there to be linked into that of kernels."""

    def _optimize_final_module(self) -> None:
        """Leave it to the kernel that this is linked into, which would do all of it once more."""

    def _finalize_final_module(self) -> None:
        """Make no machine code: nobody calls it."""
        self._finalize_dynamic_globals()
        self._finalized = True


class OwnCompiler(compiler.Compiler):  # type: ignore[misc]
    """numba's compiler of kernels that make arrays."""

    code: type[Own] = Own

    def compile_extra(self, func: Any) -> Any:
        """Return what numba compiles a function to."""
        state = self.state
        state.library = self.code(state.targetctx.codegen(), f"{func.__module__}.{func.__qualname__}{state.args}")
        state.library.enable_object_caching()
        return super().compile_extra(func)


class LeanCompiler(OwnCompiler):
    """numba's compiler of other kernels."""

    code = Lean


class LinkedCompiler(compiler.Compiler):  # type: ignore[misc]
    """numba's compiler, which stops before there is machine code."""

    def __init__(self, typingctx: Any, targetctx: Any, library: Any, args: Any, return_type: Any, flags: Any,
                 *rest: Any) -> None:
        flags.no_compile = True
        super().__init__(typingctx, targetctx, Linked(targetctx.codegen(), "linked"), args, return_type, flags, *rest)

    def compile_extra(self, func: Any) -> Any:
        """Return what numba compiles a function to, known to those who call it."""
        result = super().compile_extra(func)
        result = result._replace(entry_point=_entry(result.fndesc, result.environment, result.library))
        result.target_context.insert_user_function(result.entry_point, result.fndesc, [result.library])
        return result


def _entry(fndesc: Any, environment: Any, library: Any) -> Any:
    # by this numba tells functions apart; called from Python it raises TypeError
    return _dynfunc.make_function(fndesc.lookup_module(), fndesc.qualname, "", _REFUSE, environment, (library,))


class LinkedCacheImpl(CompileResultCacheImpl):  # type: ignore[misc]
    """What of such a function is kept between processes: its code for linking."""

    def reduce(self, result: Any) -> Any:
        """Return what can be pickled of a function."""
        result.fndesc.typemap = result.fndesc.calltypes = None
        code = result.library._get_module_for_linking().as_bitcode()
        return (code, result.fndesc, result.environment, result.signature, result.reload_init,
                tuple(result._find_referenced_environments()))

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return the function that was reduced."""
        code, fndesc, environment, signature, reload_init, environments = payload
        for function in reload_init:
            function()
        library = Linked(target_context.codegen(), "linked")
        library._final_module = binding.parse_bitcode(code)
        library._finalize_final_module()
        return compiler.compile_result(
            typing_context=target_context.typing_context, target_context=target_context, library=library,
            entry_point=_entry(fndesc, environment, library), fndesc=fndesc, environment=environment,
            signature=signature, objectmode=False, lifted=(), reload_init=reload_init,
            referenced_envs=list(environments))


# where compiled kernels are kept; None, and why, where they cannot be
CACHE, REFUSED = cache_folder()
if CACHE is not None:
    config.CACHE_DIR = str(CACHE)
_CHECKSUM = struct.Struct("<I")
# the first byte is 1 as soon as this process, or a copy of it, has a kernel to compile
_MISSED = mmap.mmap(-1, 1)


class CheckedFile(IndexDataCacheFile):  # type: ignore[misc]
    """The files of one kernel, each with a checksum at its end, which unpickling does not look at."""

    def _load_index(self) -> Any:
        with suppress(FileNotFoundError):
            _check(self._index_path)
        return super()._load_index()

    def _load_data(self, name: str) -> Any:
        _check(self._data_path(name))
        return super()._load_data(name)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        with super()._open_for_write(filepath) as stream, io.BytesIO() as content:
            yield content
            os.chmod(stream.fileno(), 0o600)
            stream.write(content.getvalue() + _CHECKSUM.pack(zlib.crc32(content.getvalue())))


def _check(path: str) -> None:
    """Raise ValueError for a file of the cache that is damaged, or that others may write: what is in it is run."""
    with open(path, "rb") as stream:
        data = stream.read()
        private = is_private(os.fstat(stream.fileno()))
    if not private or data[-_CHECKSUM.size:] != _CHECKSUM.pack(zlib.crc32(data[:-_CHECKSUM.size])):
        raise ValueError(f"{path} is damaged")


class KernelCache(FunctionCache):
    """Compiled kernels between processes, which may be lost or damaged at any time."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = CheckedFile(locator.get_cache_path(), self._impl.filename_base, locator.get_source_stamp())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return a kernel from the cache, or None.

        Its machine code is complete: of numba it needs the memory management, and nothing of what compiling needs
        (all that a kernel may call, numba's and scipy's linear algebra among it), which takes longer to import than
        a small case to solve. What cannot be read is compiled anew, in its place.
        """
        rtsys.initialize(target_context)
        found = None
        try:
            found = self._load_overload(sig, target_context)
        except Exception:
            with suppress(OSError):
                self.flush()
        if found is None:
            _MISSED[0] = 1
        return found

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return what a kernel is found by: its code and that of what it is closed over, whose pickles differ."""
        return sig, codegen.magic_tuple(), fingerprint(self._py_func)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a kernel where there is room; else it is compiled for this process alone."""
        with suppress(OSError, ValueError):
            super().save_overload(sig, data)


class LinkedCache(KernelCache):
    """Functions that only kernels call, between processes."""

    _impl_class = LinkedCacheImpl


_PRESET: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "reassoc"}, "no_cfunc_wrapper": True}
# code that counts references to arrays is as much as all else: what makes no arrays is compiled without
_NO_MEMORY: dict[str, Any] = {"_nrt": False}
# said, as numba compiles what is called as its caller is
_MEMORY: dict[str, Any] = {"_nrt": True}


def _compiled(function: Callable[..., Any], cache: type[KernelCache] = KernelCache, **options: Any) -> Any:
    compiled = numba.njit(**_PRESET, **options)(function)
    if CACHE is not None:  # else each process compiles for itself
        with suppress(RuntimeError):
            compiled._cache = cache(function)
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
    return _compiled(function, pipeline_class=LeanCompiler, **_NO_MEMORY)


def shared(function: Callable[..., Any]) -> Any:
    """Compile as ``kernel`` what several threads do at once: Python's lock is let go meanwhile."""
    return _compiled(function, pipeline_class=LeanCompiler, nogil=True, **_NO_MEMORY)


def kernel_with_memory(function: Callable[..., Any]) -> Any:
    """Compile as ``kernel`` what makes arrays."""
    return _compiled(function, pipeline_class=OwnCompiler, **_MEMORY)


def addressed(function: Callable[..., Any]) -> Any:
    """Compile as ``kernel`` what is called by its address alone: the way in from Python takes long to compile."""
    return _compiled(function, pipeline_class=LeanCompiler, no_cpython_wrapper=True, **_NO_MEMORY)


def addressed_with_memory(function: Callable[..., Any]) -> Any:
    """Compile as ``addressed`` what makes arrays."""
    return _compiled(function, pipeline_class=OwnCompiler, no_cpython_wrapper=True, **_MEMORY)


def named(function: Callable[..., Any], kind: str) -> Callable[..., Any]:
    """Return a function of which there are several kinds under the name that the cache tells it from others by."""
    function.__qualname__ = f"{function.__name__}_{kind}"
    return function


def inner(function: Callable[..., Any]) -> Any:
    """Compile as ``kernel`` what only kernels call: it becomes a part of them."""
    return _compiled(function, LinkedCache, pipeline_class=LinkedCompiler, no_cpython_wrapper=True, **_NO_MEMORY)


def inner_with_memory(function: Callable[..., Any]) -> Any:
    """Compile as ``inner`` what makes arrays."""
    return _compiled(function, LinkedCache, pipeline_class=LinkedCompiler, no_cpython_wrapper=True, **_MEMORY)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a helper anew into each of its callers, where they must see it whole (its frame, or what is constant)."""
    return numba.njit(inline="always")(function)


def expect_kernels() -> None:
    """Forget that kernels had to be compiled so far: ``missed`` tells of those to come."""
    _MISSED[0] = 0


def missed() -> bool:
    """Whether a kernel was compiled since ``expect_kernels``, by this process or a copy of it, as none was kept."""
    return CACHE is None or _MISSED[0] == 1


def cache_is_cold() -> bool:
    """Whether this machine has compiled no kernel of this version yet (the first run takes longer)."""
    return CACHE is not None and not any(CACHE.rglob("*.nbi"))
