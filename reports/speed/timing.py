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

LIBRARIES = ("numpy", "scipy", "numba", "matplotlib", "pyarrow")


class Seconds(NamedTuple):
    """Shortest and middle time of some repeats, s."""

    least: float
    median: float


def repeat(work: Callable[[], Any], repeats: int, share: float = 1.0) -> Seconds:
    """Time some work again and again; each time is multiplied by `share`, as one over the number of periods in it."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append((time.perf_counter() - begin) * share)
    return Seconds(min(times), median(times))


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
