"""Simulated records: what a test bench would have written, and the faults that may be planted in them."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from unittest.mock import patch

import numpy as np

from piezoharvest.description.system import System
from piezoharvest.engine import simulate
from piezoharvest.records import Record, Signal
from piezoharvest.study import build_excitation, build_shunt, build_transducer

STACK = {"catalogue": "NAC2125-H10"}
BENCH = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1.0e-3, "capacitance": 40e-9}
FILE, FIRST_ROW = "run.csv", 2


def frozen(table):
    """A table of a study as something that can be cached."""
    return tuple((key, tuple(value) if isinstance(value, list) else value) for key, value in table.items())


@lru_cache(maxsize=256)
def _simulated(transducer, shunt, excitation, duration, rate):
    system = System(build_transducer(dict(transducer)), build_shunt(dict(shunt)))
    drive = build_excitation({k: list(v) if isinstance(v, tuple) else v for k, v in excitation}, Path())
    dense = max(round(4 * rate * drive.period), 256) if drive.period else round(rate * duration / 2)
    # The attenuation against the short circuit is not looked at; its simulation would take most of the time.
    with patch("piezoharvest.engine.simulation._short_circuit", return_value=(1.0, "")):
        found = simulate(system, drive, transient=duration, samples=dense).waveforms
    assert found is not None
    time = np.arange(round(duration * rate)) / rate
    channels = {"force": "drive", "displacement": "displacement", "voltage": "voltage", "current": "current"}
    values = {channel: np.interp(time, found.time, getattr(found, name)) for channel, name in channels.items()}
    if drive.base:
        values["base_acceleration"] = values.pop("force")
    return time, values, system


def generator(transducer, shunt, excitation, *, duration, rate=1000.0):
    """Record of a force or base experiment without noise, and the transducer."""
    time, values, system = _simulated(frozen(transducer), frozen(shunt), frozen(excitation), duration, rate)
    drive = "force" if "force" in values else "base_acceleration"
    return record(time, values, drive, system.shunt), system.transducer


def actuator(transducer, voltage, rate):
    """Record of a free actuator that follows its voltage quasi-statically, charge by the inverse hysteresis."""
    device = build_transducer(transducer)
    compliant = device.capacitance + device.coupling**2 / device.stiffness
    hysteresis = device.hysteresis
    charge = compliant * voltage if hysteresis is None else hysteresis.charge(voltage, compliant)
    time = np.arange(len(voltage)) / rate
    values = {
        "voltage": voltage,
        "displacement": device.coupling * charge / compliant / device.stiffness,
        "current": -np.gradient(charge, time),
    }
    return record(time, values, "voltage", None), device


def record(time, values, drive, shunt):
    """Record of arrays, as if read from a text file with a header."""
    signals = {channel: Signal(np.array(v, float), None, FILE, channel, FIRST_ROW) for channel, v in values.items()}
    return Record(
        name=FILE, key="records.0", role="fit", drive=drive, shunt=shunt, start_time=0.0,
        time=Signal(np.array(time, float), None, FILE, "time_s", FIRST_ROW), signals=signals,
    )  # fmt: skip


def measured(of, *, noise=0.0, bits=None, seed=0, without=()):
    """The record with noise (relative to each channel's standard deviation), a converter's steps, channels left out."""
    rng = np.random.default_rng(seed)
    signals = {}
    for channel, signal in of.signals.items():
        values = signal.values + noise * np.std(signal.values) * rng.normal(size=len(of))
        step = 2.2 * np.max(np.abs(values)) / 2**bits if bits else 0.0
        signals[channel] = replace(signal, values=np.round(values / step) * step if step else values)
    return replace(of, signals={channel: s for channel, s in signals.items() if channel not in without})


def with_values(of, **values):
    """The record with other values in some channels, or other time stamps."""
    if "time" in values:
        of = replace(of, time=replace(of.time, values=np.array(values.pop("time"), float)))
    changed = {channel: replace(of.signals[channel], values=np.array(v, float)) for channel, v in values.items()}
    return replace(of, signals={**of.signals, **changed})


def rows(first, last):
    """Rows of samples by their indices."""
    return ((first + FIRST_ROW, last + FIRST_ROW),)


def everything(of):
    """Rows of the whole record."""
    return rows(0, len(of) - 1)


def sine(frequency=2.0, amplitude=450.0, offset=550.0):
    return {"kind": "sine_force", "amplitude": amplitude, "frequency": frequency, "offset": offset}


def resistor(resistance=97780.0):
    return {"kind": "resistor", "resistance": resistance}


def stack_sine(**options):
    """The paper's stack under a sine of 2 Hz with 97.78 kohm, with the noise and the converter of a good bench."""
    clean, device = generator(STACK, resistor(), sine(), duration=5.0)
    return measured(clean, **{"noise": 2e-3, "bits": 16, **options}), device
