"""How the engine is compiled: cached on disk, and never stale.

Numba caches a function under the time stamp of its own file, although the functions that it calls from other files are
compiled into it: after a change of one file, the others would go on with the old code. Here every function carries the
stamps of all files of the engine.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit

_STAMP = tuple(
    (path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in sorted(Path(__file__).parent.glob("*.py"))
)


def _stamped(function: Callable, options: dict[str, Any]) -> Any:
    dispatcher: Any = njit(cache=True, error_model="numpy", **options)(function)
    dispatcher._cache._cache_file._source_stamp = _STAMP
    return dispatcher


def compiled(function: Callable) -> Any:
    """Compile a function of the engine."""
    return _stamped(function, {})


def compiled_sums(function: Callable) -> Any:
    """Compile a function whose sums may be reordered, so that they run in vector registers."""
    return _stamped(function, {"fastmath": {"reassoc", "contract"}})
