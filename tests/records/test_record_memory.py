"""Long records are read and checked in little memory, in a process of their own whose peak is looked at."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from selection import with_slow

from piezoharvest.output import write_table

# Ten minutes at 10 kHz are 6 million samples, to be read, checked and fitted within 2 GiB, of which all but the fit may
# take three quarters; a sixth of the samples, and of the memory, here.
SAMPLES, RATE, LIMIT = 1_000_000, 1e4, 0.75 * (2 << 30)

# The peak is that of this very process: the one that `getrusage` tells goes back before exec, to who started it.
SCRIPT = """
import sys
from pathlib import Path
from piezoharvest.records import load_campaign
from piezoharvest.records import campaign, checks
import h5py, nptdms, scipy.io, scipy.signal, pyarrow.csv, pyarrow.parquet

def peak():
    status = dict(line.split(":") for line in Path("/proc/self/status").read_text().splitlines())
    return int(status["VmHWM"].split()[0])

before = peak()
found = load_campaign(sys.argv[1])
assert found.warnings == ()
print(before, peak(), len(found.records[0]))
"""


@pytest.fixture(scope="module")
def columns():
    """A sine of 2 Hz on the paper's stack with 97.78 kohm, by its linear response, with noise."""
    time = np.arange(SAMPLES) / RATE
    rng = np.random.default_rng(0)
    omega, k, capacitance, coupling, load = 2 * np.pi * 2, 3.125e8, 3.2e-6, 7.822, 97780.0
    gain = -1j * omega * coupling * load / (1 + 1j * omega * load * capacitance) / k
    phase = omega * time
    force = 550 + 450 * np.sin(phase)
    voltage = 450 * abs(gain) * np.sin(phase + np.angle(gain))
    noise = {"force_N": 1.0, "displacement_m": 1.2e-8, "voltage_V": 1e-3, "current_A": 1e-8}
    clean = {"force_N": force, "displacement_m": force / k, "voltage_V": voltage, "current_A": voltage / load}
    return {"time_s": time, **{name: x + noise[name] * rng.normal(size=SAMPLES) for name, x in clean.items()}}


@pytest.mark.skipif(sys.platform != "linux", reason="the largest memory of a process is told by Linux only")
@pytest.mark.parametrize("ending", with_slow(["csv", "parquet", "h5"], slow=lambda ending: ending != "parquet"))
def test_peak_of_memory(tmp_path, columns, ending):
    write_table(columns, tmp_path / f"run.{ending}")
    record = f'[[records]]\nfile = "run.{ending}"\nload_resistance = 97780.0\n'
    (tmp_path / "campaign.toml").write_text('[transducer]\ncatalogue = "NAC2125-H10"\n' + record)
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path / "campaign.toml")], capture_output=True, text=True, check=True
    )
    before, peak, count = (int(word) for word in run.stdout.split())
    assert count == SAMPLES
    base = 1024 * before
    assert 1024 * peak - base < (LIMIT - base) * SAMPLES / 6_000_000
