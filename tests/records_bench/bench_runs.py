"""Runs of the bench's solver on the tables of a study."""

from pathlib import Path

import numpy as np

from piezoharvest.bench.effects import registered
from piezoharvest.bench.solver import CIRCUITS, Model, integrate
from piezoharvest.study import build, build_excitation, build_shunt, build_transducer, study_from

# The ring stack of the paper: 22 kHz mechanics under records of 1 kHz.
STACK = {
    "mass": 0.0158, "damping": 1250.0, "stiffness": 3.125e8, "coupling": 7.822, "capacitance": 3.2e-6,
    "hysteresis": {"thresholds": [0.1e-6, 0.3e-6, 0.7e-6], "weights": [0.5e6, 1.5e6, 0.5e6]},
}  # fmt: skip
# The same without hysteresis, for closed forms.
LINEAR = {key: value for key, value in STACK.items() if key != "hysteresis"}
SINE = {"kind": "sine_force", "amplitude": 450.0, "offset": 550.0, "frequency": 5.0}
# Rises at once; held for as long as records last here.
HOLD = {"kind": "step_force", "amplitude": 1000.0, "duration": 100.0}
LOAD = {"kind": "resistor", "resistance": 51.43e3}
OPEN, SHORT = {"kind": "open"}, {"kind": "short"}
# How far a held, loaded stack moves and what it would show at open electrodes.
K, C, T = LINEAR["stiffness"], LINEAR["capacitance"], LINEAR["coupling"]


def tables(excitation=SINE, shunt=LOAD, transducer=STACK, **bench):
    return {"transducer": transducer, "excitation": excitation, "shunts": [shunt], "bench": bench}


def study(*arguments, **bench):
    return study_from(tables(*arguments, **bench), Path("study.toml"))


def waves(excitation=SINE, shunt=LOAD, transducer=STACK, *, effects=None, length=0.5, rate=1000.0, times=None):
    """Noise-free waveforms; `effects` are tables by name."""
    excitation, shunt = build_excitation(excitation, Path()), build_shunt(shunt)
    model = Model(build_transducer(transducer), CIRCUITS[shunt.kind](shunt), base=excitation.base)
    times = np.arange(round(length * rate) + 1) / rate if times is None else times
    for name, table in (effects or {}).items():
        build(registered()[name], table, name).act(model, float(times[-1]))
    return integrate(model, excitation, times)


def error(found, wanted, floor=0.0):
    """Largest difference relative to the largest value."""
    return np.abs(found - wanted).max() / max(np.abs(wanted).max(), floor)
