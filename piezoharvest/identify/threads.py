"""Linear algebra without threads of its own, where these cost more than they bring."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
R = TypeVar("R")


def single_threaded(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate what multiplies small matrices, or evaluates records side by side.

    Threads would wait for each other within every product, and spin for some time after it: alone on the machine a fit
    takes twice as long with two of them, beside another one fifty times.
    """

    @wraps(function)
    def alone(*args: P.args, **kwargs: P.kwargs) -> R:
        with _threads().limit(limits=1):
            return function(*args, **kwargs)

    return alone


@cache
def _threads() -> ThreadpoolController:
    """The libraries whose threads are limited; to find them takes as long as to fit a record."""
    import scipy.linalg  # noqa: F401 (has a library of its own, which would not be found before it is there)

    return ThreadpoolController()
