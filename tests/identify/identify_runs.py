"""Campaigns of the virtual bench, short enough for tests, and their identification."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from piezoharvest.bench import measure, write_campaign
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.study import build_transducer, study_from

STACK = {
    "mass": 0.0158,
    "damping": 1250.0,
    "stiffness": 3.125e8,
    "coupling": 7.822,
    "capacitance": 3.2e-6,
    "hysteresis": {"thresholds": [0.1e-6, 0.3e-6, 0.7e-6], "weights": [0.5e6, 1.5e6, 0.5e6]},
}
LINEAR = {key: value for key, value in STACK.items() if key != "hysteresis"}
SINE = {"kind": "sine_force", "amplitude": 450.0, "offset": 550.0, "frequency": 4.0}
RECORDS = [
    {
        "load_resistance": 97.78e3,
        "excitation": {"kind": "step_force", "amplitude": 900.0, "offset": 100.0, "duration": 1.0, "rise_time": 0.05},
    },
    {"load_resistance": 51.43e3, "excitation": {"frequency": 3.0}},
    {"load_resistance": 143.8e3, "excitation": {"amplitude": 200.0, "offset": 300.0}},
    {"load_resistance": 97.78e3, "role": "validate"},
]


def scattered(seed, off, nominal=STACK):
    """Specimen whose parameters are within `off` of the nominal ones."""
    rng, device = np.random.default_rng(seed), build_transducer(nominal)

    def drawn(value):
        return value * rng.uniform(1.0 - off, 1.0 + off)

    values = {key: drawn(nominal[key]) for key in ("damping", "stiffness", "coupling", "capacitance")}
    if device.hysteresis is not None:
        pairs = device.hysteresis
        values["hysteresis"] = Hysteresis(
            thresholds=tuple(map(drawn, pairs.thresholds)), weights=tuple(map(drawn, pairs.weights))
        )
    return replace(device, **values)


PERFECT = {
    "load_cell": {"noise": 0.0},
    "laser": {"noise": 0.0, "resolution": 0.0},
    "buffer": {"noise": 0.0},
    "current_sense": {"noise": 0.0},
    "converter": {"bits": 32},
}


@lru_cache(maxsize=16)
def measured(seed, off=0.3, linear=False, duration=2.0, perfect=False):
    """What the bench measures of a specimen, its nominal values being those of the stack; and the specimen."""
    nominal = LINEAR if linear else STACK
    tables = {
        "transducer": nominal,
        "excitation": SINE,
        "shunts": [{"kind": "resistor", "resistance": 97.78e3}],
        "bench": {"duration": duration, "seed": seed, "records": RECORDS, **(PERFECT if perfect else {})},
    }
    study, truth = study_from(tables, Path("study.toml")), scattered(seed, off, nominal)
    return replace(measure(replace(study, transducer=truth)), nominal=study.transducer), truth


def campaign_file(folder, seed, **options):
    """A campaign's file, and the specimen that stood on the bench."""
    campaign, truth = measured(seed, **options)
    return write_campaign(campaign, folder / f"campaign{seed}"), truth
