"""numba's compiler, less the work on code that only ever runs as a part of a kernel.

numba makes machine code of every function it meets. A loop that runs in parallel is four to it:
the loop's body, two wrappers around that and the kernel that starts it, and so is every helper.
Each of them is optimised and translated by itself and then, because it is linked into the next,
again with that one: the body four times. Nothing but the kernel is ever called from outside, so
here only the kernel, with all that it calls linked into it, is optimised and translated: once.

What numba makes for a kernel, of `numpy.zeros` say, is for kernels alone: other code that numba
compiles never meets with parts that have no machine code.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import compiler as numba_compiler
from numba.core import typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import FunctionPass, PassManager, register_pass
from numba.parfors.parfor import Parfor

_FOR_OTHERS = frozenset(
    {
        untyped_passes.WithLifting,
        untyped_passes.InlineClosureLikes,
        untyped_passes.RewriteSemanticConstants,
        untyped_passes.DeadBranchPrune,
        untyped_passes.RewriteDynamicRaises,
        untyped_passes.MakeFunctionToJitFunction,
        untyped_passes.InlineInlinables,
        untyped_passes.FindLiterallyCalls,
        untyped_passes.LiteralUnroll,
        untyped_passes.LiteralPropagationSubPipelinePass,
        typed_passes.InlineOverloads,
        typed_passes.NopythonRewrites,
        typed_passes.DumpParforDiagnostics,
        typed_passes.ParforFusionPass,
    }
)
"""numba's passes over what kernels have not: ``with`` blocks, functions and comprehensions inside
a function, branches on the type of an argument, errors with values in their text, whole-array
expressions. Each pass analyses the whole function again, found or not."""


class LinkedLibrary(JITCodeLibrary):
    """Code that is linked into a kernel as it was written, and never runs by itself."""

    def _optimize_functions(self, module: Any) -> None:
        """Leave it to whom it is linked into, which has to have the same layout of data."""
        module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        """Leave it to whom it is linked into."""

    def _finalize_final_module(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: there is no machine code to point to."""
        self._ensure_finalized()
        return 0


class KernelFlags(numba_compiler.Flags):
    """How a kernel and its parts are compiled; unlike any flags of what is none.

    numba looks up what it has compiled by these, for every operation that it meets, and lists all
    options each time to compare two: here those set otherwise than by default.
    """

    __slots__ = ()

    def __hash__(self) -> int:
        return hash(KernelFlags)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, KernelFlags):
            return False
        return self._values == other._values or self._chosen() == other._chosen()

    def _chosen(self) -> dict[str, Any]:
        options = self.options
        return {
            name: set_to
            for name, set_to in self._values.items()
            if set_to != options[name].default
        }


class KernelCompiler(numba_compiler.Compiler):
    """The compiler of a kernel or, with ``forceinline``, of a helper for kernels alone."""

    def __init__(
        self, typing: Any, target: Any, library: Any, arguments: Any, returned: Any, flags: Any,
        types: Any,
    ) -> None:  # fmt: skip
        flags = KernelFlags(flags)
        super().__init__(typing, target, library, arguments, returned, flags, types)

    def define_pipelines(self) -> list[PassManager]:
        """Return numba's passes, without those that kernels have no use for."""
        (passes,) = super().define_pipelines()
        passes.passes = [some for some in passes.passes if some[0] not in _FOR_OTHERS]
        if self.state.flags.auto_parallel.enabled:
            passes.add_pass_after(_BodiesWithoutWrapper, typed_passes.ParforPreLoweringPass)
        passes.finalize()
        return [passes]

    def compile_extra(self, function: Any) -> Any:
        """Compile a function, the parts of it into libraries that are linked alone."""
        codegen = self.state.targetctx.codegen()
        is_helper = self.state.flags.forceinline
        if not is_helper:
            self.state.library = JITCodeLibrary(codegen, function.__qualname__)
            self.state.library.enable_object_caching()
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
    """Have numba, meanwhile, put all it compiles into libraries that are linked alone.

    numba holds a lock while it compiles, so that nobody else meets with this.
    """
    kind, before = type(codegen), dict(vars(codegen))

    def create_library(name: str, **options: Any) -> JITCodeLibrary:
        return LinkedLibrary(codegen, name)

    def set_env(name: str, environment: Any) -> None:
        if codegen._engine.is_symbol_defined(name):
            kind.set_env(codegen, name, environment)

    own = {"create_library": create_library, "set_env": set_env}
    vars(codegen).update(own)
    flags, numba_compiler.Flags = numba_compiler.Flags, KernelFlags
    try:
        yield
    finally:
        numba_compiler.Flags = flags
        for name in own:
            del vars(codegen)[name]
            if name in before:  # one kernel is compiled while another is
                vars(codegen)[name] = before[name]
