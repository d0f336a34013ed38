"""Compiler pipelines for the engine: numba's front end runs once for each part, its optimiser once for each entry.

Uses internals of numba that may change between versions: see `compiled.TESTED`.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite.binding import Linkage, create_pass_builder, create_pipeline_tuning_options
from numba import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import AnalysisPass, PassManager, register_pass
from numba.core.typed_passes import NativeLowering, NoPythonBackend, NopythonTypeInference, PreLowerStripPhis
from numba.core.untyped_passes import FixupArgs, GenericRewrites, ReconstructSSA, TranslateByteCode


class _PartLibrary(JITCodeLibrary):
    """Unoptimised code of a part from the front end; it is optimised and compiled to machine code within an entry.

    Each part is a library of its own with a list of all that it calls, directly or not; only the entry links them.
    """

    def _optimize_functions(self, ll_module: Any) -> None:
        pass

    def finalize(self) -> None:
        self._finalize_dynamic_globals()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == Linkage.external:
                function.linkage = "linkonce_odr"
        self._shared_module, self._finalized = self._final_module, True


class _EntryLibrary(JITCodeLibrary):
    """Code of an entry, optimised once; numba would do so three times because of reference counts."""

    def _optimize_functions(self, ll_module: Any) -> None:
        pass

    def _optimize_final_module(self) -> None:
        # Parts are called from here alone: one that has a single caller becomes part of it.
        for function in self._final_module.functions:
            if function.linkage == Linkage.linkonce_odr and not function.is_declaration:
                function.linkage = "internal"
        # Loops here are over a handful of numbers, or laid out for vectors by hand (`vector`).
        options = create_pipeline_tuning_options(speed_level=3)
        options.loop_unrolling = options.loop_interleaving = False
        options.loop_vectorization = True
        builder = create_pass_builder(self._codegen._tm, options)
        builder.getModulePassManager().run(self._final_module, builder)


class _CreateLibrary(AnalysisPass):
    """Compiler pass that creates the library of a function."""

    _name, _library = "begin", _PartLibrary

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        state.library = self._library(state.targetctx.codegen(), state.func_id.func_qualname)
        return False


@register_pass(mutates_CFG=False, analysis_only=True)
class _CreatePartLibrary(_CreateLibrary):
    _name = "begin_part"


@register_pass(mutates_CFG=False, analysis_only=True)
class _CreateEntryLibrary(_CreateLibrary):
    _name, _library = "begin_entry", _EntryLibrary

    def run_pass(self, state: Any) -> bool:
        super().run_pass(state)
        state.library.enable_object_caching()
        return False


@register_pass(mutates_CFG=False, analysis_only=True)
class _RegisterPart(AnalysisPass):
    """Compiler pass that registers a part for its callers, under a Python-callable object that is never called."""

    _name = "end_part"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        name = [].append
        state["cr"] = state["cr"]._replace(cfunc=name)
        libraries = list(dict.fromkeys([state.library, *state.library._linking_libraries]))
        state.targetctx.insert_user_function(name, state["cr"].fndesc, libraries)
        return False


class PartCompiler(Compiler):
    """Compiler of functions that only compiled code calls.

    Numba optimises every function, with all that it calls, for itself and again within each of its callers: in a chain
    of calls the innermost is compiled once for every link. Here only entries are. And of Numba's passes only those are
    run that plain arithmetic on pointers needs: half of the time until the first result is that of its front end.
    """

    def __init__(self, *args: Any):
        super().__init__(*args)
        flags = self.state.flags
        flags.no_compile = flags.no_cfunc_wrapper = flags.no_cpython_wrapper = True

    def define_pipelines(self) -> Any:
        """Passes of the front end alone."""
        passes = PassManager("part")
        passes._ENFORCING = False
        for each in (
            TranslateByteCode, FixupArgs, GenericRewrites, ReconstructSSA, NopythonTypeInference,
            _CreatePartLibrary, PreLowerStripPhis, NativeLowering, _RegisterPart, NoPythonBackend,
        ):  # fmt: skip
            passes.add_pass(each, each.__name__)
        passes.finalize()
        return [passes]


@contextmanager
def _memoised_types() -> Iterator[None]:
    """Memoise the result types of operations: there are few, and each is looked up thousands of times."""
    find, known = types.Function.get_call_type, {}

    def call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        operation = self, context, tuple(args), *kws.items()
        if operation not in known:
            known[operation] = find(self, context, args, kws)
        return known[operation]

    types.Function.get_call_type = call_type
    try:
        yield
    finally:
        types.Function.get_call_type = find


class EntryCompiler(Compiler):
    """Compiler of functions that Python calls, with all their parts."""

    def compile_extra(self, func: Callable) -> Any:
        """Compile with the garbage collector off, which would go through millions of objects that are all in use."""
        collecting = gc.isenabled()
        gc.disable()
        try:
            with _memoised_types():
                return super().compile_extra(func)
        finally:
            if collecting:
                gc.enable()

    def define_pipelines(self) -> Any:
        """Numba's default passes, with the library that is optimised once."""
        pipelines = super().define_pipelines()
        for pipeline in pipelines:
            pipeline.add_pass_after(_CreateEntryLibrary, NopythonTypeInference)
            pipeline.finalize()
        return pipelines


def ignore_literal_types(dispatcher: Any) -> None:
    """Compile a part once for integers instead of once for every constant argument."""
    find, known = dispatcher.get_call_template, {}

    def template(args: tuple, kws: dict) -> Any:
        numbers = tuple(map(types.unliteral, args))
        call = *numbers, *kws.items()
        if call not in known:
            known[call] = find(numbers, kws)
        return known[call]

    dispatcher.get_call_template = template
