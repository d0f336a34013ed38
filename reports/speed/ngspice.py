"""ngspice on the netlist that `piezoharvest export` writes, its largest step set from outside."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from piezoharvest.spice import export_spice
from reports.speed.studies import Case, energy_coordinates

NGSPICE = shutil.which("ngspice")
ABSENT = "ngspice is not on the PATH"
RELTOL = 1e-3  # ngspice's own default
SIGNALS = ("V(f1)", "V(u1)", "V(t)", "V(p)", "V(vdc)")
_MEASURED = re.compile(r"^(\w+)\s+=\s+([-+]?[\d.]+(?:e[-+]?\d+)?)", re.MULTILINE | re.IGNORECASE)
_ANALYSIS = re.compile(r"^Transient analysis time = ([\d.]+)", re.MULTILINE)


class Outcome(NamedTuple):
    """States at the times asked for, harvested power in the last period (W), and the time of the analysis alone (s)."""

    states: np.ndarray
    harvested_power: float
    seconds: float


def run(case: Case, times: np.ndarray, step: float) -> Outcome:
    """Run from rest to the last of ascending times.

    Parameters
    ----------
    case : Case
    times : (n,) array
        s
    step : float
        Largest time step, s.

    Raises
    ------
    RuntimeError
        ngspice failed, or gave no value for a time.
    """
    output = _ngspice(_netlist(case, times, step))
    found = {name.lower(): float(value) for name, value in _MEASURED.findall(output)}
    analysis = _ANALYSIS.search(output)
    try:
        columns = np.array([[found[f"s{k}_{n}"] for n in range(len(times))] for k in range(len(SIGNALS))])
    except KeyError as error:
        raise RuntimeError(f"ngspice gave no {error}: {output[-500:]}") from None
    if analysis is None:
        raise RuntimeError(f"ngspice did not say how long it took: {output[-500:]}")
    f, u, v_t, v, dc = columns
    x = f / case.table["transducer"]["stiffness"]
    states = energy_coordinates(case, x, u, v_t, v - v_t, dc)
    return Outcome(states, found["harvested_power"], float(analysis[1]))


def _netlist(case: Case, times: np.ndarray, step: float) -> str:
    """Exported netlist with another step and tolerance, and the state measured at the given times."""
    system, excitation = case.objects()
    options = {}
    if excitation.period is not None:
        options = {"periods": round(times[-1] / excitation.period), "measured_periods": 1}
    text = export_spice(system.transducer, system.shunt, excitation, start="rest", tolerance=RELTOL, **options)
    text, changed = re.subn(r"^\.tran .*$", f".tran {step:.9g} {times[-1]:.15g} 0 {step:.9g} uic", text, flags=re.M)
    if changed != 1:
        raise RuntimeError("the exported netlist has no line .tran to change")
    if excitation.period is None:
        text = re.sub(r"(?<= to=)\S+", f"{times[-1]:.15g}", text)
    # What falls on the very end may lie beyond the last point by rounding.
    at = np.minimum(times, times[-1] - 1e-3 * step)
    measures = [
        f".meas tran s{k}_{n} FIND {signal} AT={time:.15g}"
        for k, signal in enumerate(SIGNALS) for n, time in enumerate(at)
    ]  # fmt: skip
    saved = ".save V(harvested) V(mechanical) V(x) " + " ".join(SIGNALS)
    return text.replace(".end\n", "\n".join([saved, ".options acct", *measures, ".end", ""]))


def _ngspice(netlist: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "bench.cir").write_text(netlist)
        command = [str(NGSPICE), "-b", "bench.cir"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600, check=False)
    output = done.stdout.replace("\r", "\n")
    if done.returncode:
        raise RuntimeError(f"ngspice failed: {(output + done.stderr)[-500:]}")
    return output
