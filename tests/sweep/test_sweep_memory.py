"""Memory does not grow with the number of designs, nor time faster than it."""

import subprocess
import sys
from pathlib import Path

import pytest

# All but the simulation itself is real.
SCRIPT = """
import resource, sys
import numpy as np
from sweep_studies import BENCH, SINE, SSHI, parameter, study_of, sweep_table
from piezoharvest.sweep import run, sweep

def evaluate(study, values):
    names = ("harvested_power", "mechanical_power", "efficiency", "displacement_amplitude", "voltage_amplitude",
             "dc_voltage", "attenuation_db", "closure")
    return {"converged": np.ones((len(values), 1), bool), **{name: np.cumsum(values[:, :1]) for name in names}}

run.evaluate = evaluate
table = sweep_table(parameter("shunts.0.load_resistance", 1e4, 1e7, "log"), parameter("shunts.0.quality", 1.0, 9.0),
                    method="sobol", samples=int(sys.argv[1]))
result = sweep(study_of(sys.argv[2], BENCH, SINE, SSHI, table), sys.argv[2] + "/out." + sys.argv[3])
used = resource.getrusage(resource.RUSAGE_SELF)
print(result.rows, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
"""


def swept(folder, designs, suffix):
    """Rows, seconds of a core and the largest memory in MiB of a sweep in a process of its own."""
    command = [sys.executable, "-c", SCRIPT, str(designs), str(folder), suffix]
    run = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parent)
    return map(float, run.stdout.split())


@pytest.mark.skipif(sys.platform != "linux", reason="the largest memory of a process is counted in kB on Linux only")
@pytest.mark.parametrize("suffix", ["parquet", "csv"])
def test_memory_is_bounded(tmp_path, suffix):
    rows, _, small = swept(tmp_path, 70_000, suffix)
    assert rows == 70_000
    rows, seconds, large = swept(tmp_path, 250_000, suffix)
    assert rows == 250_000
    assert large < 512
    assert large < small + 40
    # A goal of 20,000 designs a second leaves 50 us for each: what is not simulation should take little of it.
    assert seconds / 250_000 < 20e-6
