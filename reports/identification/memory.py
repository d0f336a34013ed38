"""A long record: ten minutes at 10 kHz, four channels, read, checked and fitted, and the memory that takes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from piezoharvest.description.shunts import Resistor
from piezoharvest.output import write_table
from piezoharvest.predict.discrete_model import setting_of
from piezoharvest.predict.prediction import Prediction
from piezoharvest.study import build_transducer

SAMPLES, RATE, LOAD = 6_000_000, 1e4, 97780.0
LIMIT = 2 << 30
NOISE = {"force_N": 0.5, "displacement_m": 1.2e-8, "voltage_V": 1.5e-3, "current_A": 3e-8}

# The peak is that of this very process: the one that `getrusage` tells goes back before exec, to who started it.
_SCRIPT = """
import sys, time
from pathlib import Path
from piezoharvest.identify import identify
from piezoharvest.predict.parameters import value_at
from piezoharvest.records import load_campaign
from piezoharvest.study import build_transducer
found = identify(load_campaign(sys.argv[1]))
status = dict(line.split(":") for line in Path("/proc/self/status").read_text().splitlines())
truth = build_transducer({"catalogue": "NAC2125-H10"})
off = [abs(e.value - value_at(truth, e.parameter.path)) / e.std for e in found.estimates if e.identifiable and e.std]
peak = int(status["VmHWM"].split()[0]) * 1024
print(peak, time.process_time(), found.converged, len(found.campaign.records[0]), max(off))
"""


class Peak(NamedTuple):
    """What a fit took, and what it gave.

    Attributes
    ----------
    memory : int
        The largest of the process, bytes.
    cpu : float
        s.
    converged : bool
    samples : int
    off : float
        Largest error of a parameter, in its standard errors.
    """

    memory: int
    cpu: float
    converged: bool
    samples: int
    off: float


def write_long_record(folder: Path, samples: int = SAMPLES, ending: str = "parquet") -> Path:
    """Write a campaign of one record: a sine that swells and fades on the paper's stack, with noise."""
    rng, time = np.random.default_rng(0), np.arange(samples) / RATE
    force = 550.0 + 300.0 * np.sin(2 * np.pi * 2.0 * time) * (1.0 + 0.4 * np.sin(2 * np.pi * 0.05 * time))
    device = build_transducer({"catalogue": "NAC2125-H10"})
    prediction = Prediction(device, setting_of("force", Resistor(resistance=LOAD), 1.0 / RATE, force, device))
    values = np.concatenate([block.values for block in prediction.blocks(False)])
    clean = {"force_N": force, **dict(zip(("displacement_m", "voltage_V", "current_A"), values.T, strict=True))}
    noisy = {name: x + NOISE[name] * rng.standard_normal(samples) for name, x in clean.items()}
    write_table({"time_s": time, **noisy}, folder / f"long.{ending}")
    lines = [
        "[transducer]",
        "mass = 0.0158",
        "damping = 1250.0",
        "stiffness = 3.3e8",
        "coupling = 7.4",
        "capacitance = 3.4e-6",
        "[transducer.hysteresis]",
        "thresholds = [0.1e-6, 0.3e-6, 0.7e-6]",
        "weights = [0.5e6, 1.5e6, 0.5e6]",
        "[[records]]",
        f'file = "long.{ending}"',
        f"load_resistance = {LOAD}",
    ]
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n")
    return folder / "campaign.toml"


def peak_of(campaign: Path) -> Peak:
    """Identify a campaign in a process of its own."""
    command = [sys.executable, "-c", _SCRIPT, str(campaign)]
    words = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    return Peak(int(words[0]), float(words[1]), words[2] == "True", int(words[3]), float(words[4]))
