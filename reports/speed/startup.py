"""How long it takes until something happens: import, help, the first simulation after an installation and the next."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from reports.speed.studies import SSHI, TRANSDUCER
from reports.speed.sweep import COMMAND, STUDY
from reports.speed.timing import as_users, repeat

FRESH = 3  # installations


def measure(repeats: int = 5, fresh: bool = True) -> dict:
    """Wall times of whole processes, s; `fresh` tells whether to compile anew."""
    commands = {
        "python": [sys.executable, "-c", "pass"],
        "import": [sys.executable, "-c", "import piezoharvest"],
        "help": [COMMAND, "--help"],
    }
    found: dict = {}
    for name, command in commands.items():
        _run(command)
        found[name] = repeat(lambda command=command: _run(command), repeats).median
    with tempfile.TemporaryDirectory() as folder:
        study, cache = Path(folder) / "study.toml", Path(folder) / "cache"
        study.write_text(STUDY.format(**TRANSDUCER, **SSHI, loads=2, frequencies=2))
        simulate = [COMMAND, "simulate", study]
        environment = {"NUMBA_CACHE_DIR": str(cache)} if fresh else {}

        def first() -> None:
            shutil.rmtree(cache, ignore_errors=True)
            _run(simulate, **environment)

        found["first_simulate"] = repeat(first, FRESH if fresh else 1).median
        found["next_simulate"] = repeat(lambda: _run(simulate, **environment), repeats).median
        found["compiled_anew"] = any(cache.rglob("*.nbi"))
    return found


def _run(command: list, **environment: str) -> None:
    subprocess.run(list(map(str, command)), env={**as_users(), **environment}, capture_output=True, check=True)
