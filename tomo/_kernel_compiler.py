"""numba's compiler, less the work on code that only ever runs as a part of a kernel.

numba makes machine code of every function it meets. A loop that runs in parallel is four to it:
the loop's body, two wrappers around that and the kernel that starts it, and so is every helper.
Each of them is optimised and translated by itself and then, because it is linked into the next,
again with that one: the body four times. Nothing but the kernel is ever called from outside, so
here only the kernel, with all that it calls linked into it, is optimised and translated: once.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import FunctionPass, PassManager, register_pass
from numba.core.typed_passes import ParforFusionPass, ParforPreLoweringPass
from numba.parfors.parfor import Parfor

_PARTS = ("__numba_parfor_gufunc", "_GufuncWrapper", "parallelgufuncwrapper")
"""What numba names a parallel loop's body, and the wrappers around it."""


class LinkedLibrary(JITCodeLibrary):
    """Code that is linked into a kernel as it was written, and never runs by itself."""

    def _optimize_final_module(self) -> None:
        """Leave it to whom it is linked into."""

    def _finalize_final_module(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: there is no machine code to point to."""
        self._ensure_finalized()
        return 0


class KernelCompiler(Compiler):
    """The compiler of a kernel or, with ``forceinline``, of a helper for kernels alone."""

    def define_pipelines(self) -> list[PassManager]:
        """Return numba's passes, without what prepares for the fusion of loops."""
        (passes,) = super().define_pipelines()
        if self.state.flags.auto_parallel.enabled:
            if not self.state.flags.auto_parallel.fusion:
                passes.passes = [some for some in passes.passes if some[0] is not ParforFusionPass]
            passes.add_pass_after(_BodiesWithoutWrapper, ParforPreLoweringPass)
            passes.finalize()
        return [passes]

    def compile_extra(self, function: Any) -> Any:
        """Compile a function, the parts of it into libraries that are linked alone."""
        codegen = self.state.targetctx.codegen()
        is_helper = self.state.flags.forceinline
        kind = LinkedLibrary if is_helper else JITCodeLibrary
        library = self.state.library = kind(codegen, function.__qualname__)
        if not is_helper:
            library.enable_object_caching()
        with _parts_linked(codegen):
            compiled = super().compile_extra(function)
        if not is_helper:  # now there is a place for what the parts refer to
            for environment in compiled._find_referenced_environments():
                codegen.set_env(environment.env_name, environment)
        return compiled


@register_pass(mutates_CFG=False, analysis_only=False)
class _BodiesWithoutWrapper(FunctionPass):
    """Have numba make nothing by which Python could call the body of a parallel loop."""

    _name = "bodies_without_wrapper"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        for block in state.func_ir.blocks.values():
            for statement in block.body:
                if isinstance(statement, Parfor):
                    statement.flags = statement.flags.copy()
                    statement.flags.no_cpython_wrapper = True
        return False


@contextmanager
def _parts_linked(codegen: Any) -> Iterator[None]:
    """Have numba, meanwhile, put the parts of parallel loops into libraries that are linked alone.

    numba holds a lock while it compiles, so that nobody else meets with this.
    """
    kind, before = type(codegen), dict(vars(codegen))

    def create_library(name: str, **options: Any) -> JITCodeLibrary:
        if any(part in name for part in _PARTS):
            return LinkedLibrary(codegen, name)
        return kind.create_library(codegen, name, **options)

    def set_env(name: str, environment: Any) -> None:
        if codegen._engine.is_symbol_defined(name):
            kind.set_env(codegen, name, environment)

    own = {"create_library": create_library, "set_env": set_env}
    vars(codegen).update(own)
    try:
        yield
    finally:
        for name in own:
            del vars(codegen)[name]
            if name in before:  # one kernel is compiled while another is
                vars(codegen)[name] = before[name]
