"""Compilation of functions that only kernels call: to LLVM code, which the kernel links.

By default numba optimises each function together with its callees and translates it into machine code, and
repeats both in each of its callers. Here only the kernel is optimised and translated.
"""

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class _Linked(JITCodeLibrary):  # type: ignore[misc]  # numba carries no types
    """LLVM code of a function and of its callees."""

    def _optimize_final_module(self) -> None:
        """Do nothing: the module is optimised as a part of the kernel."""

    def _finalize_final_module(self) -> None:
        self._finalized = True

    @property
    def codegen(self) -> "_Linked":
        """The object on which numba calls `set_env`, its only use here."""
        return self

    def set_env(self, name: str, env: object) -> None:
        """Do nothing: the Python objects in `env` belong to machine code."""


class SubroutineCompiler(Compiler):  # type: ignore[misc]  # numba carries no types
    """numba's compiler for functions that only kernels call."""

    def compile_extra(self, func: Any) -> Any:
        """Compile a function; TypeError if it returns an array without counting references to arrays."""
        self.state.library = _Linked(self.state.targetctx.codegen(), func.__qualname__)
        compiled = super().compile_extra(func)
        returned = compiled.signature.return_type
        holds_arrays = self.state.targetctx.data_model_manager[returned].contains_nrt_meminfo()
        if holds_arrays and not self.state.flags.nrt:
            raise TypeError(
                f"{func.__module__}.{func.__qualname__} returns {returned}; wanted no arrays: "
                "let the caller pass one to fill"
            )
        return compiled


LINKED: dict[str, Any] = {
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "_nrt": False,
    "pipeline_class": SubroutineCompiler,
}
"""numba's options for functions of which only the LLVM code is wanted; they count no references to arrays."""
