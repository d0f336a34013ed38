"""Threads: linear algebra without them, for small matrices for which they cost time; and those that share records."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
R = TypeVar("R")


@cache
def cores() -> int:
    """Number of cores that this process may use."""
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed else os.cpu_count() or 1


def threads_for_records() -> int:
    """Number of records that this process may evaluate at a time: one for each core, or as `OMP_NUM_THREADS` says.

    Worker processes are told to use one: where each core has a process, threads in it only wait for each other.
    """
    told = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    return min(int(told), cores()) if told.isdecimal() and int(told) > 0 else cores()


def single_threaded(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function that multiplies small matrices, or evaluates records in parallel.

    Threads of the linear algebra wait for each other within every product, and spin after it: with two of them a fit
    takes twice as long, and fifty times as long beside another process.
    """

    @wraps(function)
    def alone(*args: P.args, **kwargs: P.kwargs) -> R:
        with _threads().limit(limits=1):
            return function(*args, **kwargs)

    return alone


@cache
def _threads() -> ThreadpoolController:
    """Controller of the libraries' threads; cached, because finding the libraries takes as long as fitting a record."""
    import scipy.linalg  # noqa: F401 (loads a library of its own, which must be loaded to be found)

    return ThreadpoolController()
