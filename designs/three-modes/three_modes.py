"""Damping of three modes of a beam with one patch.

A force of constant amplitude goes from below the first to above the third resonance, the worst peak counts. Compared
are a resistor, a series RL, and shunts with a branch for each mode, all tuned for the worst of the three peaks.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from piezoharvest import (
    DesignOptions,
    Mode,
    Short,
    Shunt,
    SineForce,
    Study,
    System,
    Transducer,
    design,
    frequency_response,
)

# Modes at 50, 150 and 320 Hz of equal stiffness, so that with shorted electrodes all peaks are as high; one patch of
# 40 nF, k_e^2 = 0.025, 0.02 and 0.015, Q_m = 80.
FREQUENCIES, COUPLINGS_SQUARED, STIFFNESS, CAPACITANCE = (50.0, 150.0, 320.0), (0.025, 0.02, 0.015), 986.96, 40e-9
BAND = (40.0, 380.0)
BANDS = ((40.0, 60.0), (130.0, 170.0), (290.0, 350.0))  # Hz, of one mode each
KINDS = ("resistor", "series_rl", "parallel_branches", "current_flowing")


def beam() -> Transducer:
    """The beam with its patch."""
    masses = [STIFFNESS / (2 * np.pi * f) ** 2 for f in FREQUENCIES]
    dampings = [np.sqrt(STIFFNESS * mass) / 80 for mass in masses]
    couplings = [np.sqrt(k2 * STIFFNESS * CAPACITANCE) for k2 in COUPLINGS_SQUARED]
    first, *others = (
        {"mass": m, "damping": b, "stiffness": STIFFNESS, "coupling": t}
        for m, b, t in zip(masses, dampings, couplings, strict=True)
    )
    modes = tuple(Mode(**values, force_participation=1.0) for values in others)
    return Transducer(**first, capacitance=CAPACITANCE, modes=modes)


def displacement(transducer: Transducer, shunt: Shunt, frequencies: np.ndarray) -> np.ndarray:
    """Displacement amplitude (f,) per force, m/N."""
    return np.abs(frequency_response(System(transducer, shunt), frequencies).displacement)


def tuned(transducer: Transducer, kinds: tuple[str, ...]) -> dict[str, Shunt]:
    """Shunt of each kind with the least worst peak from below the first to above the third mode."""
    drive = SineForce(amplitude=0.02, frequency=50.0)
    options = DesignOptions(objective="damping", band=BAND, candidates=kinds)
    found = design(Study(transducer=transducer, excitation=drive, design=options))
    return {candidate.shunt.kind: candidate.shunt for candidate in found.candidates}


def main(out: Path, short: bool = False) -> dict[str, list[float]]:
    """Write three_modes.png; return the attenuation in dB of the worst peak in each mode's band, for each kind."""
    transducer = beam()
    shunts = tuned(transducer, KINDS[:2] if short else KINDS)
    frequencies = np.geomspace(*BAND, 4000)
    shorted = displacement(transducer, Short(), frequencies)
    figure = Figure(figsize=(7.4, 4.4), layout="constrained")
    axes, found = figure.subplots(), {}
    axes.loglog(frequencies, shorted, color="#1d232b", label="shorted")
    for (kind, shunt), colour in zip(shunts.items(), ("#0072b2", "#d55e00", "#009e73", "#cc79a7"), strict=False):
        response = displacement(transducer, shunt, frequencies)
        dashes = "--" if list(shunts).index(kind) % 2 else "-"
        axes.loglog(frequencies, response, dashes, color=colour, label=kind.replace("_", " ").replace("rl", "RL"))
        inside = [(frequencies >= low) & (frequencies <= high) for low, high in BANDS]
        found[kind] = [20 * float(np.log10(response[m].max() / shorted[m].max())) for m in inside]
    ticks = [50, 100, 150, 200, 320]
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.set(xlabel="frequency in Hz", ylabel="displacement per force in m/N")
    axes.grid(alpha=0.3)
    axes.legend()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "three_modes.png", dpi=150)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("three-modes"))
    parser.add_argument("--short", action="store_true", help="without the shunts of several branches")
    options = parser.parse_args()
    for kind, values in main(options.out, options.short).items():
        print(f"{kind:20}", *(f"{value:.1f} dB" for value in values))
