"""Runs netlists in ngspice, where it is installed, and reads what their .meas commands found."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

ABSENT = "ngspice is not on the PATH (Debian: apt install ngspice)"
_MEASUREMENT = re.compile(r"^(\w+)\s+=\s+([-+]?[\d.]+(?:e[-+]?\d+)?)(?:\s+from=.*)?\s*$", re.MULTILINE | re.IGNORECASE)
# ngspice ends with status 0 after some of these, and goes on from others with numbers that mean nothing.
_FAILURES = re.compile(r"error|aborted|fatal|singular|too small|meas .* failed|unknown|unrecognized", re.IGNORECASE)


class NgspiceError(RuntimeError):
    """The netlist did not run, or ngspice is not there."""


def available() -> bool:
    """True if ngspice is installed."""
    return shutil.which("ngspice") is not None


def run_netlist(netlist: str, timeout: float = 120.0, raw: Path | None = None) -> dict[str, float]:
    """Run a netlist in batch mode.

    Parameters
    ----------
    netlist : str
    timeout : float
        s
    raw : Path, optional
        File to which the saved waveforms are written.

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
        try:
            run = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=timeout, check=False)
            if raw is not None:  # with -r ngspice leaves the .meas commands out
                command[1:1] = ["-r", str(raw.absolute())]
                subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=timeout, check=False)
        except subprocess.TimeoutExpired:
            raise NgspiceError(f"ngspice was stopped after {timeout:g} s") from None
    return _measured(run.stdout + run.stderr, run.returncode)


def _measured(output: str, status: int) -> dict[str, float]:
    # The first line that is printed repeats the title, which may hold any word.
    lines = [line for line in output.splitlines() if not line.startswith("Circuit:")]
    failures = [line for line in lines if _FAILURES.search(line)]
    measured = {name.lower(): float(value) for name, value in _MEASUREMENT.findall("\n".join(lines))}
    if status or failures or not measured:
        raise NgspiceError("\n".join(failures) or output[-2000:])
    return measured
