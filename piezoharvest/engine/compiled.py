"""How the engine is compiled: cached on disk, never stale, and without reference counting.

Numba caches a function under the time stamp of its own file, although the functions that it calls from other files are
compiled into it: after a change of one file, the others would go on with the old code. Here every entry carries the
stamps of all files of the engine.

Compiled functions work on a few flat arrays that Python owns. Counting references to them would cost more than the
arithmetic, so it is switched off (`_nrt=False`): nothing compiled allocates, and a function may return an array only
where it is inlined.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from llvmlite.binding import Linkage, create_pass_builder, create_pipeline_tuning_options
from numba import njit, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import AnalysisPass, PassManager, register_pass
from numba.core.typed_passes import NativeLowering, NoPythonBackend, NopythonTypeInference, PreLowerStripPhis
from numba.core.untyped_passes import FixupArgs, GenericRewrites, ReconstructSSA, TranslateByteCode

# A product and a sum may be rounded once ("contract"): half the time of a polynomial, whose steps wait for each other.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False, "fastmath": {"contract"}}
_STAMP = tuple(
    (path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in sorted(Path(__file__).parent.glob("*.py"))
)


class _PartLibrary(JITCodeLibrary):
    """Code of a part as it comes from the front end: it is optimised, and made machine code of, within an entry.

    Each part keeps to itself, with a list of all that it calls, directly or not: only the entry links them.
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
    """Code of an entry, optimised once; Numba would do so three times, for the sake of reference counts."""

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


class _Begin(AnalysisPass):
    """Gives a function its library."""

    _name, _library = "begin", _PartLibrary

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        state.library = self._library(state.targetctx.codegen(), state.func_id.func_qualname)
        return False


@register_pass(mutates_CFG=False, analysis_only=True)
class _BeginPart(_Begin):
    _name = "begin_part"


@register_pass(mutates_CFG=False, analysis_only=True)
class _BeginEntry(_Begin):
    _name, _library = "begin_entry", _EntryLibrary

    def run_pass(self, state: Any) -> bool:
        super().run_pass(state)
        state.library.enable_object_caching()
        return False


@register_pass(mutates_CFG=False, analysis_only=True)
class _End(AnalysisPass):
    """Makes a part known to other functions, under something that Python could call although nobody does."""

    _name = "end_part"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        name = [].append
        state["cr"] = state["cr"]._replace(cfunc=name)
        libraries = list(dict.fromkeys([state.library, *state.library._linking_libraries]))
        state.targetctx.insert_user_function(name, state["cr"].fndesc, libraries)
        return False


class _Part(Compiler):
    """Compiles a function that only compiled code calls.

    Numba optimises every function, with all that it calls, for itself and again within each of its callers: in a chain
    of calls the innermost is compiled once for every link. Here only entries are. And of Numba's passes only those are
    run that plain arithmetic on pointers needs: half of the time until the first result is that of its front end.
    """

    def __init__(self, *args: Any):
        super().__init__(*args)
        flags = self.state.flags
        flags.no_compile = flags.no_cfunc_wrapper = flags.no_cpython_wrapper = True

    def define_pipelines(self) -> Any:
        passes = PassManager("part")
        passes._ENFORCING = False
        for each in (
            TranslateByteCode, FixupArgs, GenericRewrites, ReconstructSSA, NopythonTypeInference,
            _BeginPart, PreLowerStripPhis, NativeLowering, _End, NoPythonBackend,
        ):  # fmt: skip
            passes.add_pass(each, each.__name__)
        passes.finalize()
        return [passes]


@contextmanager
def _types_remembered() -> Iterator[None]:
    """Look up once what an operation on given types results in: there are few, and each is met thousands of times."""
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


class _Entry(Compiler):
    """Compiles a function that Python calls, with all its parts."""

    def compile_extra(self, func: Callable) -> Any:
        """Compile; the garbage collector, which would go through millions of objects all in use, waits meanwhile."""
        collecting = gc.isenabled()
        gc.disable()
        try:
            with _types_remembered():
                return super().compile_extra(func)
        finally:
            if collecting:
                gc.enable()

    def define_pipelines(self) -> Any:
        pipelines = super().define_pipelines()
        for pipeline in pipelines:
            pipeline.add_pass_after(_BeginEntry, NopythonTypeInference)
            pipeline.finalize()
        return pipelines


def _part(function: Callable, **options: Any) -> Any:
    """A part, compiled once for whole numbers and not again for every constant that a caller gives it."""
    dispatcher: Any = njit(pipeline_class=_Part, **_OPTIONS, **options)(function)
    find, known = dispatcher.get_call_template, {}

    def template(args: tuple, kws: dict) -> Any:
        numbers = tuple(map(types.unliteral, args))
        call = *numbers, *kws.items()
        if call not in known:
            known[call] = find(numbers, kws)
        return known[call]

    dispatcher.get_call_template = template
    return dispatcher


def compiled(function: Callable) -> Any:
    """Compile a function that only compiled code calls: it becomes part of every entry that uses it."""
    return _part(function)


def inlined(function: Callable) -> Any:
    """Compile a function of a line or two, a part whose callers are bound to take it in."""
    return _part(function, forceinline=True)


def entry(function: Callable) -> Any:
    """Compile a function that Python calls; it is kept on disk with all that it calls."""
    dispatcher: Any = njit(cache=True, pipeline_class=_Entry, **_OPTIONS)(function)
    dispatcher._cache._cache_file._source_stamp = _STAMP
    return dispatcher
