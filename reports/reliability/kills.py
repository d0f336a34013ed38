"""A command killed at a random moment and given again: nothing is left half written, and the result is the same."""

from __future__ import annotations

import hashlib
import random
import signal
import subprocess
import sys
import tempfile
import time
from functools import lru_cache
from pathlib import Path
from typing import Any

import tomli_w

from reports.reliability.inputs import OWN, PLAIN

SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
LIMIT = 300.0  # s, within which a command has to end
SWEEP = {"method": "grid", "outputs": ["harvested_power", "displacement_amplitude"], "parameters": [
    {"path": "shunts.0.resistance", "from": 1e3, "to": 1e7, "scale": "log", "count": 100},
    {"path": "excitation.frequency", "from": 45.0, "to": 55.0, "scale": "linear", "count": 50}]}  # fmt: skip
LONG_STUDY = {**PLAIN, "sweep": SWEEP, **OWN["design"], **OWN["measure"]}
# Commands that write `out`: files of that name, or a folder of files that may bear the date.
COMMANDS: dict[str, tuple[str, ...]] = {
    "sweep": ("sweep", "study.toml", "--out", "out.csv"),
    "measure": ("measure", "study.toml", "--out", "out"),
    "design": ("design", "study.toml", "--report", "out"),
    "identify": ("identify", "campaign/campaign.toml", "--report", "out", "--save", "out.toml"),
    "diagnose": ("diagnose", "campaign/campaign.toml", "--report", "out", "--save", "out.toml"),
}
BRIEF: dict[str, tuple[str, ...]] = {  # which end so soon that only other faults than a kill are of interest
    "simulate": ("simulate", "study.toml", "--out", "out.csv"),
    "export": ("export", "study.toml", "--out", "out.cir"),
    "new": ("new", "harvest", "--out", "out.toml"),
    "catalogue": ("catalogue", "--json"),
}


def attempt_kill(seed: int) -> dict[str, Any]:
    """What became of a command that was killed and given again.

    Returns
    -------
    dict
        `seed`, `kind` (the command), `outcome` ("resumed", or "impossible" where something half written was left or the
        result differs), `what` (when it was killed, and how) and `seconds`.
    """
    rng, begin = random.Random(seed), time.monotonic()
    command = rng.choice(list(COMMANDS))
    whole, lasted = undisturbed(command)
    after, how = rng.uniform(0.0, lasted), rng.choice(SIGNALS)
    with tempfile.TemporaryDirectory() as folder:
        prepare(Path(folder))
        found = _killed(command, Path(folder), after, how, whole)
    what = f"{how.name} after {after:.1f} of {lasted:.1f} s{': ' if found else ''}{found}"
    outcome = "impossible" if found else "resumed"
    return {"seed": seed, "kind": command, "outcome": outcome, "what": what[:300], "closure": None,
            "seconds": round(time.monotonic() - begin, 3)}  # fmt: skip


def _killed(command: str, folder: Path, after: float, how: signal.Signals, whole: dict[str, str]) -> str:
    """Fault that a killed command leaves, or that giving it again shows; "" without one."""
    process = subprocess.Popen(line_of(command), cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    try:
        process.communicate(timeout=after)
    except subprocess.TimeoutExpired:
        process.send_signal(how)
        said = process.communicate(timeout=LIMIT)[1].decode(errors="replace")
        if "Traceback" in said:
            return f"it says {said.strip()[-200:]}"
    left = written(folder)
    # What is there under its own name is whole; what is under way has a name of its own.
    if broken := [name for name in left if name in whole and not same(name, left, whole)]:
        return f"left half written: {', '.join(broken)}"
    folder_of = {name for name in whole if name.startswith("out/")}
    if lacking := folder_of - left.keys() if folder_of & left.keys() else set():
        return f"left a folder without {', '.join(sorted(lacking))}"
    again = subprocess.run(line_of(command), cwd=folder, capture_output=True, timeout=LIMIT, check=False)
    if again.returncode not in (0, 1):
        return f"given again it ends with {again.returncode}: {again.stderr.decode(errors='replace').strip()[-200:]}"
    now = written(folder)
    if how == signal.SIGKILL:  # which no program can answer: a file that was under way stays, under its hidden name
        now = {name: found for name, found in now.items() if not Path(name).name.startswith(".")}
    if now.keys() != whole.keys():
        return f"given again it leaves other files: {sorted(now.keys() ^ whole.keys())}"
    other = [name for name in whole if not same(name, now, whole)]
    return f"given again it writes other bytes: {', '.join(other)}" if other else ""


def same(name: str, found: dict[str, str], whole: dict[str, str]) -> bool:
    """Pages and figures bear dates and times; of those that they are there is all that is asked."""
    return Path(name).suffix in (".html", ".png", ".svg", ".pdf") or found[name] == whole[name]


@lru_cache
def undisturbed(command: str) -> tuple[dict[str, str], float]:
    """What a command writes, and how long it takes once its code is compiled, s."""
    for _ in range(2):
        with tempfile.TemporaryDirectory() as folder:
            prepare(Path(folder))
            begin = time.monotonic()
            done = subprocess.run(line_of(command), cwd=folder, capture_output=True, timeout=LIMIT, check=False)
            if done.returncode not in (0, 1):
                raise RuntimeError(f"{command}: {done.stderr.decode(errors='replace')}")
            found, lasted = written(Path(folder)), time.monotonic() - begin
    return found, lasted


def prepare(folder: Path) -> None:
    """A study, and a campaign that was measured on it."""
    (folder / "study.toml").write_text(tomli_w.dumps(LONG_STUDY), encoding="utf-8")
    campaign = folder / "campaign"
    campaign.mkdir()
    for path, data in _campaign().items():
        (campaign / path).write_bytes(data)


@lru_cache
def _campaign() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "study.toml").write_text(tomli_w.dumps(LONG_STUDY), encoding="utf-8")
        subprocess.run(line_of("measure"), cwd=folder, capture_output=True, timeout=LIMIT, check=True)
        return {path.name: path.read_bytes() for path in (Path(folder) / "out").iterdir()}


def line_of(command: str) -> list[str]:
    return [sys.executable, "-m", "piezoharvest", "--quiet", *(COMMANDS | BRIEF)[command]]


def written(folder: Path) -> dict[str, str]:
    """Hashes of what stands beside the input, by name."""
    inputs = {"study.toml", "campaign"}
    files = [path for path in folder.rglob("*") if path.is_file() and path.relative_to(folder).parts[0] not in inputs]
    return {str(path.relative_to(folder)): _hash(path.read_bytes()) for path in files}


def _hash(data: bytes) -> str:
    """Hash of a file without the line of a specimen that bears a date."""
    lines = [line for line in data.splitlines(keepends=True) if not line.startswith(b"date = ")]
    return hashlib.sha256(b"".join(lines)).hexdigest()
