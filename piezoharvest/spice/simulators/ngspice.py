"""Runs netlists in ngspice, where it is installed, and reads what their .meas commands found."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from piezoharvest.progress import Step

ABSENT = "ngspice is not on the PATH (Debian: apt install ngspice)"
# A run that takes longer (s) is told of in so many parts; it is looked at every so many seconds, at the last bytes of
# what it said.
QUICK, PARTS, LOOK, TAIL = 5.0, 20, 0.05, 400
_REACHED = re.compile(r"Reference value :\s*([\d.]+e[-+]\d+)\s*[\r\n]")
_MEASUREMENT = re.compile(r"^(\w+)\s+=\s+([-+]?[\d.]+(?:e[-+]?\d+)?)(?:\s+from=.*)?\s*$", re.MULTILINE | re.IGNORECASE)
# ngspice ends with status 0 after some of these, and goes on from others with numbers that mean nothing.
# A singular matrix makes it try a shorter step: where that does not help it says so, too.
_RECOVERED = "Warning: singular matrix"
_FAILURES = re.compile(r"error|aborted|fatal|singular|too small|meas .* failed|unknown|unrecognized", re.IGNORECASE)


class NgspiceError(RuntimeError):
    """The netlist did not run, or ngspice is not there."""


def available() -> bool:
    """True if ngspice is installed."""
    return shutil.which("ngspice") is not None


def run_netlist(
    netlist: str, timeout: float = 120.0, raw: Path | None = None, progress: Callable[[str], None] = lambda text: None
) -> dict[str, float]:
    """Run a netlist in batch mode.

    Parameters
    ----------
    netlist : str
    timeout : float
        s
    raw : Path, optional
        File to which the saved waveforms are written.
    progress : callable, optional
        Called with a `Step` for each twentieth of a run that takes long.

    Returns
    -------
    dict
        Results of the .meas commands by name, in lower case.

    Raises
    ------
    NgspiceError
        There is no ngspice, it reported a failure, took too long, or measured nothing.
    """
    program = shutil.which("ngspice")
    if program is None:
        raise NgspiceError(ABSENT)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "netlist.cir").write_text(netlist)
        command = [program, "-b", "netlist.cir"]
        status, output = _run(command, folder, Clock(netlist, timeout, progress))
        if raw is not None:  # with -r ngspice leaves the .meas commands out
            command[1:1] = ["-r", str(raw.absolute())]
            _run(command, folder, Clock(netlist, timeout, progress))
    return _measured(output, status)


class Clock:
    """How far a run is, which ngspice says on stderr, and how long it may take."""

    def __init__(self, netlist: str, timeout: float, progress: Callable[[str], None]) -> None:
        words = next((line.split() for line in netlist.splitlines() if line.startswith(".tran ")), [])
        self.end = _value(words[2]) if len(words) > 2 else 0.0
        self.timeout, self.progress = timeout, progress
        self.begun, self.at, self.told = time.monotonic(), 0.0, 0

    def look(self, errors: str) -> None:
        """Tell how far a run is whose stderr ends so; raise `NgspiceError` where it takes too long."""
        spent, found = time.monotonic() - self.begun, _REACHED.findall(errors)
        self.at = float(found[-1]) if found else self.at
        share = min(self.at / self.end, 1.0) if self.end else 0.0
        if spent > self.timeout:
            reached = f", when {100 * share:.2g} % of the run was done" if self.end else ""
            raise NgspiceError(f"ngspice was stopped after {self.timeout:g} s, the time limit{reached}")
        if spent > QUICK and (done := int(PARTS * share)) > self.told:
            self.told = done
            self.progress(Step(f"ngspice: {100 * share:.0f} % of its run", PARTS * share, PARTS, spent=spent))


def _run(command: list[str], folder: str, clock: Clock) -> tuple[int, str]:
    """Run a program in a folder; status and what it printed."""
    said, errors = Path(folder) / "stdout", Path(folder) / "stderr"
    with said.open("w") as out, errors.open("w") as err, subprocess.Popen(
        command, cwd=folder, stdin=subprocess.DEVNULL, stdout=out, stderr=err
    ) as run:  # fmt: skip
        try:
            while True:
                try:
                    run.wait(LOOK)
                    break
                except subprocess.TimeoutExpired:
                    with errors.open("rb") as file:
                        file.seek(max(errors.stat().st_size - TAIL, 0))
                        clock.look(file.read().decode(errors="replace"))
        except BaseException:  # also where the user ends it
            run.kill()
            raise
    texts = (path.read_text(errors="replace") for path in (said, errors))
    return run.returncode, "".join(texts)


def _value(word: str) -> float:
    try:
        return float(word)
    except ValueError:  # an expression
        return 0.0


def _measured(output: str, status: int) -> dict[str, float]:
    # The first line that is printed repeats the title, which may hold any word.
    lines = [line for line in output.splitlines() if not line.startswith("Circuit:")]
    failures = [line for line in lines if _FAILURES.search(line) and not line.startswith(_RECOVERED)]
    measured = {name.lower(): float(value) for name, value in _MEASUREMENT.findall("\n".join(lines))}
    if status or failures or not measured:
        raise NgspiceError("\n".join(failures) or output[-2000:])
    return measured
