"""Decorators that compile numerical code: cached on disk, never stale, without reference counting.

Compiled functions work on a few arrays that Python owns. Counting references to them would cost more than the
arithmetic, so it is switched off (`_nrt=False`): nothing compiled allocates, and a function may return an array only
where it is inlined.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import Any

import numba
from numba import njit

from piezoharvest.engine.compilation.uncached_warning import warn_once

# Versions of numba whose internals `pipeline` and `cache` are tested with; stated in pyproject, too.
TESTED = (0, 61), (0, 68)
_VERSION = tuple(map(int, re.findall(r"\d+", numba.__version__)[:2]))

# A product and a sum may be rounded once ("contract"): half the time of a polynomial, whose steps wait for each other.
_plain: Any = partial(njit, error_model="numpy", fastmath={"contract"})

if TESTED[0] <= _VERSION <= TESTED[1]:
    from piezoharvest.engine.compilation.cache import cache_on_disk
    from piezoharvest.engine.compilation.pipeline import EntryCompiler, PartCompiler, ignore_literal_types

    _part, _entry = (partial(_plain, pipeline_class=each, _nrt=False) for each in (PartCompiler, EntryCompiler))
else:
    # Numba's documented behaviour: right, but slow, and not cached, for its own cache does not see other files change.
    _part = _entry = _plain

    def ignore_literal_types(dispatcher: Any) -> None:
        """Leave numba's typing of constants unchanged."""

    def cache_on_disk(dispatcher: Any) -> None:
        """Warn that compiled code is not cached."""
        first, last = (".".join(map(str, version)) for version in TESTED)
        warn_once(
            f"this version of piezoharvest does not know numba {numba.__version__} and compiles again in each "
            f"run, which takes minutes: install one of the versions {first} to {last}"
        )


def compiled(function: Callable) -> Any:
    """Compile a function that only compiled code calls: it becomes part of every entry that uses it."""
    dispatcher = _part()(function)
    ignore_literal_types(dispatcher)
    return dispatcher


def inlined(function: Callable) -> Any:
    """Compile a function of a line or two that is always inlined into its callers."""
    dispatcher = _part(forceinline=True)(function)
    ignore_literal_types(dispatcher)
    return dispatcher


def entry(function: Callable, *, nogil: bool = False) -> Any:
    """Compile a function that Python calls; it is cached on disk with all functions that it calls.

    Parameters
    ----------
    function : callable
    nogil : bool
        Other threads of Python run meanwhile.
    """
    dispatcher = _entry(nogil=nogil)(function)
    cache_on_disk(dispatcher)
    return dispatcher
