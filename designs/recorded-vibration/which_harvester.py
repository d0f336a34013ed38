"""Harvester and circuit for a recorded vibration.

`machine.csv` is the acceleration of a machine's frame: a hum that drifts between 47 and 52 Hz, its second harmonic, a
rumble and noise. It was made by `machine()` below, not measured. Three harvesters of equal mass and
material but different sharpness and resonance are designed for it, each with the best of its circuits.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import butter, sosfilt, welch

from piezoharvest import DesignOptions, DesignResult, Record, Study, Transducer, design

FILE = Path(__file__).with_name("machine.csv")
RATE, SECONDS = 500.0, 4.0  # Hz, s
MASS = 0.01  # kg at the tip: with a moving base, the force on the relative displacement is mass times acceleration
BASE = Transducer(mass=MASS, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)


def tuned(frequency: float, quality: float, coupling_squared: float) -> Transducer:
    """Harvester of a short-circuit frequency in Hz, mechanical quality and k_e^2, by its stiffness and patch."""
    stiffness = MASS * (2 * np.pi * frequency) ** 2
    coupling = np.sqrt(coupling_squared * stiffness * BASE.capacitance)
    return replace(BASE, stiffness=stiffness, damping=np.sqrt(stiffness * MASS) / quality, coupling=coupling)


HARVESTERS = {
    "sharp, 49.5 Hz": tuned(49.5, 150.0, 0.01),
    "well coupled, 48 Hz": tuned(48.0, 60.0, 0.09),
    "soft, 30 Hz": tuned(30.0, 25.0, 0.09),
}


def machine() -> np.ndarray:
    """Acceleration of the machine in m/s^2, made once and kept in FILE."""
    rng, time = np.random.default_rng(31), np.arange(int(RATE * SECONDS)) / RATE
    phase = 2 * np.pi * np.cumsum(49.5 + 2.5 * np.sin(2 * np.pi * time / SECONDS)) / RATE
    rumble = sosfilt(butter(2, (8.0, 40.0), "bandpass", fs=RATE, output="sos"), rng.normal(0, 1.2, len(time)))
    return 1.5 * np.sin(phase) + 0.3 * np.sin(2 * phase + 1.0) + rumble + rng.normal(0, 0.05, len(time))


def write_forces(path: Path, count: int) -> Path:
    """Write the force on the harvester for the first samples of the record, N."""
    acceleration = np.loadtxt(FILE, delimiter=",", skiprows=1)[:count, 1]
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["force_N"])
        rows.writerows([[f"{MASS * value:.6e}"] for value in acceleration])
    return path


def designed(transducer: Transducer, forces: Path) -> DesignResult:
    """Design for the record: resistor, rectifier and parallel SSHI."""
    options = DesignOptions(candidates=("resistor", "rectifier", "parallel_sshi"), phase_lag="fixed")
    excitation = Record(file=str(forces), column="force_N", sample_rate=RATE)
    return design(Study(title="recorded vibration", transducer=transducer, excitation=excitation, design=options))


def main(out: Path, short: bool = False) -> dict[str, dict[str, float]]:
    """Write which_harvester.png; return the power of each circuit on each harvester, W."""
    out.mkdir(parents=True, exist_ok=True)
    forces = write_forces(out / "forces.csv", 250 if short else int(RATE * SECONDS))
    found = {
        name: {c.shunt.kind: c.harvested_power for c in designed(transducer, forces).candidates}
        for name, transducer in HARVESTERS.items()
    }
    draw(found).savefig(out / "which_harvester.png", dpi=150)
    return found


def draw(found: dict[str, dict[str, float]]) -> Figure:
    """Spectrum of the record with the resonances, and the power of each harvester and circuit."""
    figure = Figure(figsize=(7.4, 5.2), layout="constrained")
    spectrum, powers = figure.subplots(2)
    frequencies, density = welch(np.loadtxt(FILE, delimiter=",", skiprows=1)[:, 1], RATE, nperseg=500)
    spectrum.semilogy(frequencies, density, color="#1d232b")
    for (name, transducer), colour in zip(HARVESTERS.items(), ("#0072b2", "#d55e00", "#009e73"), strict=True):
        spectrum.axvline(transducer.short_circuit_frequency, color=colour, linestyle="--", label=name)
    spectrum.set(xlim=(5, 120), xlabel="frequency in Hz", ylabel="density in (m/s²)²/Hz")
    spectrum.legend(fontsize=8)
    kinds = list(next(iter(found.values())))
    for n, kind in enumerate(sorted(kinds)):
        heights = [1e6 * each[kind] for each in found.values()]
        bars = powers.bar(
            np.arange(len(found)) + 0.27 * (n - 1), heights, 0.25, label=kind.replace("_", " ").replace("sshi", "SSHI")
        )
        powers.bar_label(bars, fmt="%.3g", fontsize=8)
    powers.set_xticks(range(len(found)), list(found))
    powers.set_ylabel("mean power in µW")
    powers.margins(y=0.12)
    powers.legend(fontsize=8)
    return figure


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("recorded-vibration"))
    parser.add_argument("--short", action="store_true", help="the first half second only")
    options = parser.parse_args()
    for name, powers in main(options.out, options.short).items():
        print(f"{name:22}", *(f"{kind} {1e6 * value:.3g} uW" for kind, value in powers.items()))
