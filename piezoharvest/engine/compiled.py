"""How the engine is compiled: cached on disk, never stale, and without reference counting.

Numba caches a function under the time stamp of its own file, although the functions that it calls from other files are
compiled into it: after a change of one file, the others would go on with the old code. Here every entry carries the
stamps of all files of the engine.

Compiled functions work on a few flat arrays that Python owns. Counting references to them would cost more than the
arithmetic, so it is switched off (`_nrt=False`): nothing compiled allocates, and a function may return an array only
where it is inlined.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.typed_passes import NativeLowering, NopythonTypeInference

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}
_STAMP = tuple(
    (path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in sorted(Path(__file__).parent.glob("*.py"))
)


class _PartLibrary(JITCodeLibrary):
    """Code of a part as it comes from the front end: it is optimised, and made machine code of, within an entry."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=False, analysis_only=True)
class _Begin(AnalysisPass):
    """Gives a part its library."""

    _name = "begin_part"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        state.library = _PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
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
        state.targetctx.insert_user_function(name, state["cr"].fndesc, [state.library])
        return False


class _Part(Compiler):
    """Compiles a function that only compiled code calls.

    Numba optimises every function, with all that it calls, for itself and again within each of its callers: in a chain
    of calls the innermost is compiled once for every link. Here only entries are.
    """

    def __init__(self, *args: Any):
        super().__init__(*args)
        flags = self.state.flags
        flags.no_compile = flags.no_cfunc_wrapper = flags.no_cpython_wrapper = True

    def define_pipelines(self) -> Any:
        pipelines = super().define_pipelines()
        for pipeline in pipelines:
            pipeline.add_pass_after(_Begin, NopythonTypeInference)
            pipeline.add_pass_after(_End, NativeLowering)
            pipeline.finalize()
        return pipelines


def compiled(function: Callable) -> Any:
    """Compile a function that only compiled code calls: it becomes part of every entry that uses it."""
    return njit(pipeline_class=_Part, **_OPTIONS)(function)


def inlined(function: Callable) -> Any:
    """Compile a function of a line or two into its callers; it may return part of an array."""
    return njit(inline="always", **_OPTIONS)(function)


def entry(function: Callable) -> Any:
    """Compile a function that Python calls; it is kept on disk with all that it calls."""
    dispatcher: Any = njit(cache=True, **_OPTIONS)(function)
    dispatcher._cache._cache_file._source_stamp = _STAMP
    return dispatcher
