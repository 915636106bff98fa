"""Functions that only kernels call: kept as they are lowered, optimised and made machine code of in their callers."""

from __future__ import annotations

import ctypes
import hashlib
from typing import Any

from llvmlite import binding
from numba import _dynfunc
from numba.core import compiler
from numba.core.caching import CompileResultCacheImpl
from numba.core.codegen import JITCodeLibrary

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
