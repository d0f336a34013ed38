"""Times that mean something, and the machine that they were taken on."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import subprocess
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from reports.speed import BLAS_THREADS
from reports.speed.ngspice import NGSPICE

CALM = 1.1  # times the shortest that the yardstick has taken: more tells that others use the core at the moment
PATIENCE = 10.0  # s for which repeats that were disturbed are made again
LIBRARIES = ("numpy", "scipy", "numba", "matplotlib", "pyarrow")


class Seconds(NamedTuple):
    """Shortest and middle time of some repeats, s, and how many of all that were made others disturbed."""

    least: float
    median: float
    disturbed: int


class _Yardstick:
    """A fixed piece of arithmetic, whose time tells what else the core does.

    Other guests of a host may use the other half of a core: everything takes half as long again then, for milliseconds
    or for minutes, and neither load nor stolen time shows it.
    """

    def __init__(self) -> None:
        self._shortest = float("inf")

    def calm(self) -> bool:
        """Whether it takes about as long as it ever did."""
        begin, total = time.perf_counter(), 0
        for n in range(20_000):
            total += n * n
        taken = time.perf_counter() - begin
        self._shortest = min(self._shortest, taken)
        return taken < CALM * self._shortest


_yardstick = _Yardstick()


def repeat(work: Callable[[], Any], repeats: int, share: float = 1.0) -> Seconds:
    """Time some work again and again; each time is multiplied by `share`, as one over the number of periods in it.

    What began or ended while the core was used by others is made again, for as long as there is patience. Where not
    even one repeat was left alone, all of them count.
    """
    alone, disturbed, first = [], [], time.perf_counter()
    while len(alone) < repeats and (len(alone) + len(disturbed) < repeats or time.perf_counter() - first < PATIENCE):
        calm, begin = _yardstick.calm(), time.perf_counter()
        work()
        taken = (time.perf_counter() - begin) * share
        (alone if calm and _yardstick.calm() else disturbed).append(taken)
    times = alone or disturbed
    return Seconds(min(times), median(times), len(disturbed))


def once(work: Callable[[], Any]) -> tuple[Any, float]:
    """Do some work once; its result and the time it took, s."""
    begin = time.perf_counter()
    result = work()
    return result, time.perf_counter() - begin


def as_users() -> dict[str, str]:
    """Environment of commands: theirs are the threads that a user's would have."""
    return {name: value for name, value in os.environ.items() if name != BLAS_THREADS}


def machine() -> dict[str, Any]:
    """What the measurements ran on: nothing that names the machine or its user."""
    return {
        "date": datetime.now(UTC).date().isoformat(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in LIBRARIES},
        "ngspice": _ngspice_version(),
    }


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return platform.processor() or platform.machine()
    found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return found[1].strip() if found else platform.machine()


def _ngspice_version() -> str | None:
    if NGSPICE is None:
        return None
    text = subprocess.run([NGSPICE, "--version"], capture_output=True, text=True, check=False).stdout
    found = re.search(r"ngspice-(\S+)", text)
    return found[1] if found else "unknown"
