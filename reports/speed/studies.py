"""What is simulated: the reference bench with parallel SSHI, and a record through a resistor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from piezoharvest.description.system import System
from piezoharvest.study import build_excitation, build_shunt, build_transducer

TRANSDUCER = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1.0e-3, "capacitance": 40e-9}
# The charge swings by 0.57 uC to each side: all three operators slip in every half period.
STOPS = {"thresholds": [0.5e-7, 1.5e-7, 3e-7], "weights": [5e5, 5e5, 5e5]}
DRIVE = {"kind": "sine_force", "amplitude": 0.02, "frequency": 50.6}
SSHI = {
    "kind": "parallel_sshi", "inductance": 0.1, "quality": 5.0, "smoothing_capacitance": 1e-6, "load_resistance": 1e6,
}  # fmt: skip
PERIOD = 1 / DRIVE["frequency"]
# Matched to the capacitance at the drive frequency.
LOAD = {"kind": "resistor", "resistance": 8e4}
SAMPLE_RATE = 1000.0


@dataclass(frozen=True)
class Case:
    """A study to be simulated by every alternative.

    Attributes
    ----------
    name, title : str
        Key in the results, and words for people.
    table : dict
        The study as its TOML file would give it.
    """

    name: str
    title: str
    table: dict

    def objects(self):
        """System and excitation, as the package works with them."""
        transducer, shunt = build_transducer(self.table["transducer"]), build_shunt(self.table["shunts"][0])
        return System(transducer, shunt), build_excitation(self.table["excitation"], Path())


def sshi(smoothing_capacitance: float = SSHI["smoothing_capacitance"], stops: bool = False) -> Case:
    """Parallel SSHI under a sine, 8 events a period; with `stops`, 20."""
    transducer = {**TRANSDUCER, "hysteresis": STOPS} if stops else TRANSDUCER
    shunt = {**SSHI, "smoothing_capacitance": smoothing_capacitance}
    name, title = ("sshi_stops", "parallel SSHI, three P-I operators") if stops else ("sshi", "parallel SSHI")
    return Case(name, title, {"transducer": transducer, "excitation": DRIVE, "shunts": [shunt]})


def sshc(capacitors: int = 4) -> Case:
    """Bridge and switched capacitors as large as the electrodes' one: each period closes eighteen stages of four."""
    shunt = {
        "kind": "sshc", "flip_capacitances": [TRANSDUCER["capacitance"]] * capacitors, "switch_resistance": 100.0,
        **{key: SSHI[key] for key in ("smoothing_capacitance", "load_resistance")},
    }  # fmt: skip
    title = f"SSHC with {capacitors} capacitors"
    return Case("sshc", title, {"transducer": TRANSDUCER, "excitation": DRIVE, "shunts": [shunt]})


def record(folder: Path, samples: int) -> Case:
    """A measured force: `samples` at 1 kHz of noise within 5-80 Hz, strong enough for all three operators to slip."""
    spectrum = np.zeros(samples // 2 + 1, complex)
    frequency = np.fft.rfftfreq(samples, 1 / SAMPLE_RATE)
    inside = (frequency >= 5) & (frequency <= 80)
    rng = np.random.default_rng(1)
    spectrum[inside] = rng.normal(size=inside.sum()) + 1j * rng.normal(size=inside.sum())
    force = np.fft.irfft(spectrum, samples)
    force = 0.1 * (force - force[0]) / np.std(force)  # N rms; it begins at rest
    device = {**TRANSDUCER, "hysteresis": STOPS}
    table = {"transducer": device, "excitation": written(force, folder), "shunts": [LOAD]}
    return Case("record", "record of noise, resistor, three P-I operators", table)


def written(force: np.ndarray, folder: Path) -> dict:
    """A force as the table of a record, whose file is written."""
    path = folder / "force.csv"
    np.savetxt(path, force, fmt="%.17g", header="force_N", comments="")
    return {"kind": "record", "file": str(path), "column": "force_N", "sample_rate": SAMPLE_RATE}


def energy_coordinates(case: Case, x, u, v_t, v_h, dc) -> np.ndarray:
    """States as square roots of energies, a row for each instant: half the squared length is about the stored energy.

    The hysteresis voltage v_h stands for all operators, by the capacitance. The switched inductor is left out: it
    carries no current at the instants that are compared.
    """
    device, shunt = case.table["transducer"], case.table["shunts"][0]
    values = (device["stiffness"], device["mass"], device["capacitance"], device["capacitance"])
    sizes = np.sqrt([*values, shunt.get("smoothing_capacitance", 0.0)])
    return np.column_stack([x, u, v_t, v_h, dc]) * sizes


def distance(found: np.ndarray, wanted: np.ndarray) -> float:
    """Largest error of the state over all instants, relative to the largest state, in the energy norm."""
    largest = np.linalg.norm(wanted, axis=-1).max()
    return float(np.linalg.norm(found - wanted, axis=-1).max() / largest)


def instants(periods: int) -> np.ndarray:
    """Instants that are compared, s: the quarters of up to 20 periods, spread evenly to the last one."""
    last = np.unique(np.ceil(np.linspace(0, periods, 21)[1:]))
    return np.ravel(last[:, None] - [0.75, 0.5, 0.25, 0.0]) * PERIOD
