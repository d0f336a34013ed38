"""Memory does not grow with the number of designs and stays below a gibibyte, nor does time grow faster than it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

LIMIT = 1024  # MiB, for 100,000 designs
# From two groups of rows of a file on (131,072) memory is at its largest: one is written while the next one is read.
# The rows of the other designs, if they were kept, would take 100 MiB (120 bytes each).
SMALL, LARGE = 140_000, 1_000_000
DIFFERENCE = 40  # MiB that two sweeps may differ by for other reasons than their number of designs: 19 were measured

# The peak of this very process: the one that `getrusage` tells goes back before exec, to the one that started it. With
# "real" the engine simulates; without, all but the simulation itself is real.
SCRIPT = """
import resource, sys
from pathlib import Path
import numpy as np
from sweep_studies import BENCH, SINE, SSHI, parameter, study_of, sweep_table
from piezoharvest.sweep import run, sweep

def evaluate(study, values):
    names = ("harvested_power", "mechanical_power", "efficiency", "displacement_amplitude", "voltage_amplitude",
             "dc_voltage", "attenuation_db", "figure_of_merit", "closure")
    return {"converged": np.ones((len(values), 1), bool), **{name: np.cumsum(values[:, :1]) for name in names}}

if sys.argv[4:] != ["real"]:
    run.evaluate = evaluate
table = sweep_table(parameter("shunts.0.load_resistance", 1e4, 1e7, "log"), parameter("shunts.0.quality", 1.0, 9.0),
                    method="sobol", samples=int(sys.argv[1]))
result = sweep(study_of(sys.argv[2], BENCH, SINE, SSHI, table), sys.argv[2] + "/out." + sys.argv[3])
used = resource.getrusage(resource.RUSAGE_SELF)
status = dict(line.split(":") for line in Path("/proc/self/status").read_text().splitlines())
print(result.rows, used.ru_utime + used.ru_stime, int(status["VmHWM"].split()[0]) / 1024)
"""


def swept(folder, designs, suffix, *how):
    """Rows, seconds of a core and the largest memory in MiB of a sweep in a process of its own."""
    folder.mkdir()
    command = [sys.executable, "-c", SCRIPT, str(designs), str(folder), suffix, *how]
    # Arrow's own allocator gives memory back by the clock: on a busy machine its peak is up to 22 MiB higher.
    setting = {**os.environ, "ARROW_DEFAULT_MEMORY_POOL": "system"}
    run = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parent, env=setting)
    return map(float, run.stdout.split())


@pytest.mark.skipif(sys.platform != "linux", reason="the largest memory of a process is told by Linux only")
class TestMemory:
    @pytest.mark.slow
    @pytest.mark.parametrize("suffix", ["parquet", "csv"])
    def test_it_does_not_grow_with_the_number_of_designs(self, tmp_path, suffix):
        rows, _, small = swept(tmp_path / "small", SMALL, suffix)
        assert rows == SMALL
        rows, seconds, large = swept(tmp_path / "large", LARGE, suffix)
        assert rows == LARGE
        assert large < LIMIT
        assert large < small + DIFFERENCE
        # A goal of 20,000 designs a second leaves 50 us for each: what is not simulated should take little of it.
        assert seconds / LARGE < 20e-6

    @pytest.mark.slow
    def test_the_engine_needs_less_than_a_gibibyte(self, tmp_path):
        """Chunks are simulated one after the other, and are at their largest from 16,384 designs on."""
        rows, _, peak = swept(tmp_path / "real", 16_384, "parquet", "real")
        assert rows == 16_384
        assert peak < LIMIT
