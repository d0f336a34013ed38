"""Commands where something is not as it should be: they work or say why not, and leave nothing half written."""

from __future__ import annotations

import ctypes
import os
import random
import resource
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import piezoharvest
from reports.reliability.kills import BRIEF, COMMANDS, LIMIT, line_of, prepare, same, undisturbed, written

HOMES = ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "MPLCONFIGDIR", "NUMBA_CACHE_DIR")
DROP, CAPABILITIES = 24, 41  # PR_CAPBSET_DROP of Linux, and how many there are
READER_GONE = 141  # status of a command whose reader has gone, as a shell has it after SIGPIPE

Options = dict[str, Any]  # of the process
Place = Iterator[Options]


def attempt_fault(seed: int) -> dict[str, Any]:
    """What became of a command under a fault; the seeds go through all pairs, and draw sizes.

    Returns
    -------
    dict
        `seed`, `kind` (the fault), `outcome` ("done", "said", or "impossible" where something half written was left,
        what was said is no sentence, or the same command does not work afterwards), `what` and `seconds`.
    """
    begin = time.monotonic()
    command, fault = PAIRS[seed % len(PAIRS)]
    whole, _ = undisturbed(command)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "place"
        folder.mkdir()
        with FAULTS[fault](folder, random.Random(seed)) as options:
            count = 2 if fault == TWICE else 1
            begun = [subprocess.Popen(line_of(command), cwd=folder, **options) for _ in range(count)]
            outcomes, wrong = zip(*(_answered(process) for process in begun), strict=True)
            found = "".join(wrong) or _left(folder, whole, "done" in outcomes)
            if not found and fault in STAYS:  # what the fault was in is gone with it
                shutil.copytree(folder, Path(name) / "later")
        found = found or _again(command, Path(name) / "later" if fault in STAYS else folder, whole)
    outcome = "impossible" if found else "done" if set(outcomes) == {"done"} else "said"
    return {"seed": seed, "kind": fault, "outcome": outcome, "what": f"{command}: {found}"[:300], "closure": None,
            "seconds": round(time.monotonic() - begin, 3)}  # fmt: skip


def _answered(process: subprocess.Popen[str]) -> tuple[str, str]:
    """Whether a command has done its work or said why not, and what is wrong about it; "" if nothing is."""
    said = process.communicate(timeout=LIMIT)[1].strip()
    errors = [line for line in said.splitlines() if line.startswith("piezoharvest:")]
    if "Traceback" in said or "internal error" in said or len(errors) > 1:
        return "", f"it says {said[-200:]}"
    if process.returncode == 0 or (process.returncode == 1 and not errors):
        return "done", ""
    if process.returncode == READER_GONE and not errors:
        return "said", ""
    return ("said", "") if process.returncode in (1, 2) and errors else ("", f"{process.returncode}: {said[-200:]}")


def _left(folder: Path, whole: dict[str, str], done: bool) -> str:
    """What is wrong about the files that a command has left; "" if nothing is."""
    left = written(folder)
    if broken := [name for name in left if (name not in whole and not _part(name)) or _differs(name, left, whole)]:
        return f"left {', '.join(broken)}"
    lacking = whole.keys() - left.keys()
    report = {name for name in whole if name.startswith("out/")}
    if lacking and (done or (report & left.keys() and report & lacking)):
        return f"left a result without {', '.join(sorted(lacking))}"
    return ""


def _part(name: str) -> bool:
    """True for a part of a sweep, which the same command resumes from."""
    return Path(name).parts[0].endswith(".partial")


def _differs(name: str, left: dict[str, str], whole: dict[str, str]) -> bool:
    return name in whole and not same(name, left, whole)


def _again(command: str, folder: Path, whole: dict[str, str]) -> str:
    """What is wrong about the same command without the fault; "" if nothing is."""
    if command == "new" and written(folder):  # which overwrites nothing
        return ""
    done = subprocess.run(line_of(command), cwd=folder, capture_output=True, text=True, timeout=LIMIT, check=False)
    if done.returncode not in (0, 1):
        return f"given again it ends with {done.returncode}: {done.stderr.strip()[-200:]}"
    now = written(folder)
    if now.keys() != whole.keys():
        return f"given again it leaves other files: {sorted(now.keys() ^ whole.keys())}"
    other = [name for name in whole if not same(name, now, whole)]
    return f"given again it writes other bytes: {', '.join(other)}" if other else ""


def _options(prepared: Callable[[], object] | None = None, without: tuple[str, ...] = (), **others: Any) -> Options:
    """Of a process that does something before it begins, and does not have some variables of the environment."""
    environment = {name: value for name, value in os.environ.items() if name not in without}
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return {**streams, "preexec_fn": prepared, "env": environment | others.pop("more", {}), **others}


def _as_a_user() -> None:
    """Give up what root may do beyond others, as reading and writing what it has no right to."""
    for number in range(CAPABILITIES):
        ctypes.CDLL(None).prctl(DROP, number, 0, 0, 0)


@contextmanager
def _closed(folder: Path) -> Iterator[None]:
    """A folder with all in it, into which nobody may write."""
    found = [folder, *folder.rglob("*")]
    for path in found:
        path.chmod(path.stat().st_mode & ~0o222)
    try:
        yield
    finally:
        for path in found:
            path.chmod(path.stat().st_mode | 0o200)


@contextmanager
def _large_files(folder: Path, rng: random.Random) -> Place:
    most = int(10 ** rng.uniform(0.0, 5.5))
    prepare(folder)
    yield _options(lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)))


@contextmanager
def _full_disk(folder: Path, rng: random.Random) -> Place:
    """Of which some KiB are left beside the input; only root can make one."""
    room = int(10 ** rng.uniform(3.6, 6.0))
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", folder], check=True, capture_output=True)
    try:
        prepare(folder)
        free = os.statvfs(folder).f_bavail * os.statvfs(folder).f_frsize
        (folder / "campaign" / "filled").write_bytes(bytes(max(free - room, 0)))
        yield _options()
        (folder / "campaign" / "filled").unlink()
    finally:
        subprocess.run(["umount", folder], check=True)


@contextmanager
def _read_only(folder: Path, rng: random.Random) -> Place:
    prepare(folder)
    with _closed(folder):
        yield _options(_as_a_user)


@contextmanager
def _unreadable(folder: Path, rng: random.Random) -> Place:
    prepare(folder)
    inputs = (folder / "study.toml", folder / "campaign" / "campaign.toml")
    for path in inputs:
        path.chmod(0)
    yield _options(_as_a_user)
    for path in inputs:
        path.chmod(0o644)


@contextmanager
def _no_home(folder: Path, rng: random.Random) -> Place:
    prepare(folder)
    yield _options(_as_a_user, without=HOMES, more={"HOME": "/nowhere"} if rng.random() < 0.5 else {})


@contextmanager
def _no_cache(folder: Path, rng: random.Random) -> Place:
    """Nothing but the place itself may be written: neither the installation, nor a home, nor a folder of caches."""
    prepare(folder)
    installed = folder.parent / "installed"
    code = Path(piezoharvest.__file__).parent
    shutil.copytree(code, installed / code.name, ignore=shutil.ignore_patterns("__pycache__"))
    (folder.parent / "home").mkdir()
    with _closed(installed), _closed(folder.parent / "home"):
        home = str(folder.parent / "home")
        yield _options(_as_a_user, without=HOMES, more={"HOME": home, "PYTHONPATH": str(installed)})


@contextmanager
def _twice(folder: Path, rng: random.Random) -> Place:
    prepare(folder)
    yield _options()


@contextmanager
def _reader_gone(folder: Path, rng: random.Random) -> Place:
    prepare(folder)
    reader, writer = os.pipe()
    os.close(reader)
    yield _options(stdout=writer)
    os.close(writer)


@contextmanager
def _full_output(folder: Path, rng: random.Random) -> Place:
    prepare(folder)
    with Path("/dev/full").open("w") as full:
        yield _options(stdout=full)


@contextmanager
def _no_output(folder: Path, rng: random.Random) -> Place:
    prepare(folder)
    yield _options(lambda: os.close(1), stdout=None)


TWICE = "two at once"
FAULTS = {
    "files are too large": _large_files, "full disk": _full_disk, "read-only folder": _read_only,
    "unreadable input": _unreadable, "no home": _no_home, "nothing else may be written": _no_cache, TWICE: _twice,
    "output into a pipe that is closed": _reader_gone, "output into a full device": _full_output,
    "no output": _no_output,
}  # fmt: skip
STAYS = ("full disk",)
PAIRS = [(command, fault) for fault in FAULTS for command in (*COMMANDS, *BRIEF)]
