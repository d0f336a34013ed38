"""Studies to be swept, as files, and what comes of them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from piezoharvest.study import load_study

BENCH = """\
title = "bench harvester"

[transducer]
mass = 0.010
damping = 0.0628
stiffness = 986.96
coupling = 1.0e-3
capacitance = 40e-9
"""
SINE = """
[excitation]
kind = "sine_force"
amplitude = 0.02
frequency = 50.6
"""
# A transient of some milliseconds for each design, however fast steady states are found.
NOISE = """
[excitation]
kind = "random_force"
psd = 1e-6
band = [10.0, 200.0]
duration = 0.15
seed = 1
"""
RESISTOR = """
[[shunts]]
kind = "resistor"
resistance = 8e4
"""
SSHI = """
[[shunts]]
kind = "parallel_sshi"
inductance = 0.1
quality = 5.0
smoothing_capacitance = 1e-6
load_resistance = 1e6
"""
# Every kind of place at which a number may stand.
EVERYTHING = (
    BENCH
    + """
[transducer.hysteresis]
thresholds = [1e-7, 3e-7]
weights = [5e5, 1.5e6]

[[transducer.modes]]
mass = 0.011
damping = 0.2
stiffness = 4.0e4
coupling = 5e-4

[transducer.effects.leakage]
resistance = 1.3e5
"""
    + SINE
    + RESISTOR
    + SSHI
)


def parameter(path, first, last, scale="linear", count=None):
    """One table of [sweep] parameters."""
    counted = "" if count is None else f", count = {count}"
    return f'{{ path = "{path}", from = {first!r}, to = {last!r}, scale = "{scale}"{counted} }}'


def sweep_table(*parameters, **keys):
    """Table [sweep]."""
    lines = [f"{key} = {value!r}".replace("'", '"') for key, value in keys.items()]
    return "\n[sweep]\n" + "\n".join([*lines, f"parameters = [{', '.join(parameters)}]"]) + "\n"


def write(folder, text, name="study.toml"):
    path = Path(folder) / name
    path.write_text(text)
    return path


def study_of(folder, *texts):
    """Study of a file with these texts."""
    return load_study(write(folder, "".join(texts)))


def start(folder, *arguments, program=("-m", "piezoharvest")):
    """The command line as a process of its own."""
    command = [sys.executable, *program, "sweep", *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, cwd=folder, preexec_fn=_heed_interrupts, **pipes)


def _heed_interrupts():
    """In the child: tests that run in the background hand on that Ctrl-C is ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def finish(process):
    """Exit status, stdout and stderr of a process, which has to end by itself."""
    out, err = process.communicate(timeout=300)
    assert "Traceback" not in err
    return process.returncode, out, err


def parts(out):
    """Part files of a sweep that is not complete."""
    return sorted(Path(f"{out}.partial").glob("[0-9]*.arrow"))


def wait_for(condition, process=None, seconds=240.0):  # the first simulation compiles
    """Wait until a condition holds, as long as the process runs."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        assert process is None or process.poll() is None, process.communicate()
        time.sleep(0.02)


def running(pid):
    """Whether a process runs (one that has ended but was not fetched does not)."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"


def children(pid):
    """Processes that a process has started, and theirs."""
    found = []
    for entry in filter(str.isdigit, os.listdir("/proc")):
        try:
            parent = int(Path(f"/proc/{entry}/stat").read_text().rsplit(")", 1)[1].split()[1])
        except OSError:
            continue
        if parent == pid:
            found += [int(entry), *children(int(entry))]
    return found
