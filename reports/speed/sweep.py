"""Designs a second of `piezoharvest sweep`, from the command line: start of the process and Parquet file included."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil
import pyarrow.parquet

from reports.speed.engine import Simulation
from reports.speed.steady import wait
from reports.speed.studies import SSHI, TRANSDUCER, Case
from reports.speed.timing import as_users

COMMAND = Path(sys.executable).with_name("piezoharvest")
DESIGNS = (1_000, 10_000, 100_000)
WORKERS = (1, 2)
LONGEST = 150.0  # s that a sweep may be expected to take; a longer one is left out, and said to be
CHECKED = 12  # designs whose answer is compared with a long transient's
FREQUENCIES = 50
STUDY = """
[transducer]
mass = {mass}
damping = {damping}
stiffness = {stiffness}
coupling = {coupling}
capacitance = {capacitance}

[excitation]
kind = "sine_force"
amplitude = 0.02
frequency = 50.6

[[shunts]]
kind = "{kind}"
inductance = {inductance}
quality = {quality}
smoothing_capacitance = {smoothing_capacitance}
load_resistance = {load_resistance}

[sweep]
method = "grid"
parameters = [
  {{ path = "shunts.0.load_resistance", from = 1e5, to = 1e6, scale = "log", count = {loads} }},
  {{ path = "excitation.frequency", from = 48.0, to = 53.0, scale = "linear", count = {frequencies} }},
]
outputs = ["harvested_power", "displacement_amplitude"]
"""


class Finished(NamedTuple):
    """A process that ran: wall time in s, largest memory of it and all its children together in bytes."""

    seconds: float
    memory: int
    status: int
    said: str


def measure(designs: tuple[int, ...] = DESIGNS, workers: tuple[int, ...] = WORKERS) -> dict:
    """Rows of designs, workers, seconds and memory; or why there are none."""
    if subprocess.run([COMMAND, "sweep", "--help"], capture_output=True, check=False).returncode:
        return {"skipped": "this version has no command sweep"}
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        _sweep(place, FREQUENCIES, 1)  # compiles what is to be compiled
        rows, notes = [], []
        for count in workers:
            expected = 0.0
            for n in designs:
                if expected * n > LONGEST:
                    notes.append(f"{n:,} designs on {count} core(s) are left out: they would take {expected * n:.0f} s")
                    continue
                done = _sweep(place, n, count)
                expected = done.seconds / n
                rows.append({"designs": n, "workers": count, "seconds": done.seconds, "memory": done.memory})
        table = pyarrow.parquet.read_table(place / f"{designs[0]}-{workers[0]}.parquet")
    converged = float(np.mean(table["converged"].to_numpy()))
    return {"rows": rows, "notes": notes, "converged": converged, "power_error": _error(table)}


def _sweep(place: Path, designs: int, workers: int) -> Finished:
    """Sweep a grid of designs into a fresh file, on as many cores as there are workers."""
    loads = max(2, designs // FREQUENCIES)
    text = STUDY.format(**TRANSDUCER, **SSHI, loads=loads, frequencies=designs // loads)
    study, out = place / "study.toml", place / f"{designs}-{workers}.parquet"
    study.write_text(text)
    done = run([COMMAND, "sweep", study, "--out", out, "--workers", workers], cores=workers)
    # Status 1 tells that some design has no trusted answer; their share is in the results.
    if done.status not in (0, 1):
        raise RuntimeError(f"sweep ended with status {done.status}: {done.said}")
    found = pyarrow.parquet.read_metadata(out).num_rows
    if found != loads * (designs // loads):
        raise RuntimeError(f"sweep wrote {found} rows for {designs} designs")
    return done


def run(command: list, cores: int) -> Finished:
    """Run a command on some of the cores only, and look at its memory ten times a second."""
    begin = time.perf_counter()
    with tempfile.TemporaryFile() as output:
        process = psutil.Popen([*map(str, command)], stdout=output, stderr=subprocess.STDOUT, env=as_users())
        if hasattr(os, "sched_setaffinity"):
            process.cpu_affinity(sorted(os.sched_getaffinity(0))[:cores])
        memory = 0
        while process.poll() is None:
            memory = max(memory, _memory(process))
            time.sleep(0.02 if time.perf_counter() - begin < 1 else 0.1)
        seconds = time.perf_counter() - begin
        output.seek(0)
        said = output.read().decode(errors="replace")[-500:]
    return Finished(seconds, memory, process.returncode, said)


def _memory(process: psutil.Process) -> int:
    """Resident memory of a process and its children, what they share counted for each of them."""
    total = 0
    try:
        for one in (process, *process.children(recursive=True)):
            total += one.memory_info().rss
    except psutil.NoSuchProcess:
        pass  # ended while it was looked at
    return total


def _error(table) -> float:
    """Largest relative error of the harvested power against long transients, over some designs chosen at random."""
    power, converged = table["harvested_power"].to_numpy(), table["converged"].to_numpy()
    candidates = np.flatnonzero(converged)
    chosen = np.random.default_rng(1).choice(candidates, min(CHECKED, len(candidates)), replace=False)
    return max(abs(float(power[n]) / _long_transient(table, int(n)) - 1) for n in chosen)


def _long_transient(table, n: int) -> float:
    """Harvested power of one design by waiting, W."""
    load = table["shunts.0.load_resistance"][n].as_py()
    drive = {"kind": "sine_force", "amplitude": 0.02, "frequency": table["excitation.frequency"][n].as_py()}
    shunt = {**SSHI, "load_resistance": load}
    case = Case("design", "design of a sweep", {"transducer": TRANSDUCER, "excitation": drive, "shunts": [shunt]})
    return wait(Simulation(case, ledger=True)).power
