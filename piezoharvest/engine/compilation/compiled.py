"""How the engine is compiled: kept on disk, never stale, and without reference counting.

Compiled functions work on a few flat arrays that Python owns. Counting references to them would cost more than the
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

from piezoharvest.engine.compilation.uncached_warning import say_once

# Versions of numba of which `pipeline` and `cache` use what numba does not promise to keep; pyproject says so, too.
TESTED = (0, 61), (0, 68)
_VERSION = tuple(map(int, re.findall(r"\d+", numba.__version__)[:2]))

# A product and a sum may be rounded once ("contract"): half the time of a polynomial, whose steps wait for each other.
_plain: Any = partial(njit, error_model="numpy", fastmath={"contract"})

if TESTED[0] <= _VERSION <= TESTED[1]:
    from piezoharvest.engine.compilation.cache import keep
    from piezoharvest.engine.compilation.pipeline import EntryCompiler, PartCompiler, numbers_alone

    _part, _entry = (partial(_plain, pipeline_class=each, _nrt=False) for each in (PartCompiler, EntryCompiler))
else:
    # As numba does it by itself: right, but slow, and kept nowhere, for its own cache does not see other files change.
    _part = _entry = _plain

    def numbers_alone(dispatcher: Any) -> None:
        """Leave numba's way as it is."""

    def keep(dispatcher: Any) -> None:
        """Say that nothing is kept."""
        first, last = (".".join(map(str, version)) for version in TESTED)
        say_once(
            f"this version of piezoharvest does not know numba {numba.__version__} and compiles plainly, anew in each "
            f"run, which takes minutes: install one of the versions {first} to {last}"
        )


def compiled(function: Callable) -> Any:
    """Compile a function that only compiled code calls: it becomes part of every entry that uses it."""
    dispatcher = _part()(function)
    numbers_alone(dispatcher)
    return dispatcher


def inlined(function: Callable) -> Any:
    """Compile a function of a line or two, a part whose callers are bound to take it in."""
    dispatcher = _part(forceinline=True)(function)
    numbers_alone(dispatcher)
    return dispatcher


def entry(function: Callable) -> Any:
    """Compile a function that Python calls; it is kept on disk with all that it calls."""
    return kept(_entry()(function))


def kept(dispatcher: Any) -> Any:
    """Keep on disk what numba makes of a function that Python calls, with all that it calls."""
    keep(dispatcher)
    return dispatcher
