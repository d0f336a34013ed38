"""Load of the ring stack, chosen from Python: power against the load at the paper's frequencies.

The design step gives the best resistor at each frequency; `simulate` gives the curve, and the paper's loads on it.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from piezoharvest import DesignOptions, Resistor, Study, System, design, load_study, simulate

STUDY = load_study(Path(__file__).with_name("study.toml"))
PAPER_LOADS = 51.43e3, 97.78e3, 143.8e3  # ohm


def power(load: float, frequency: float) -> float:
    """Harvested power in W, by simulation with the hysteresis."""
    drive = replace(STUDY.excitation, frequency=frequency)
    return simulate(System(STUDY.transducer, Resistor(resistance=load)), drive, samples=16).harvested_power


def best(frequency: float) -> tuple[float, float]:
    """Best resistance in ohm, and its power in W."""
    options = DesignOptions(candidates=("resistor",))
    drive = replace(STUDY.excitation, frequency=frequency)
    found = design(Study(transducer=STUDY.transducer, excitation=drive, design=options)).best
    return found.shunt.resistance, found.harvested_power


def main(out: Path, short: bool = False) -> dict[float, tuple[float, float]]:
    """Write choose_load.png; return the best load in ohm and its power in W for each frequency in Hz."""
    frequencies = (1.0, 5.0) if short else (1.0, 2.0, 3.0, 4.0, 5.0)
    loads = np.geomspace(1e3, 1e6, 9 if short else 61)
    figure = Figure(figsize=(7.4, 4.0), layout="constrained")
    axes, found = figure.subplots(), {}
    for frequency, colour in zip(frequencies, ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00"), strict=False):
        found[frequency] = best(frequency)
        axes.plot(loads, [1e6 * power(load, frequency) for load in loads], color=colour, label=f"{frequency:g} Hz")
        axes.plot(found[frequency][0], 1e6 * found[frequency][1], "o", color=colour)
        axes.plot(PAPER_LOADS, [1e6 * power(load, frequency) for load in PAPER_LOADS], "x", color=colour)
    axes.set(xscale="log", xlabel="load in Ω (dots: best, crosses: the paper's)", ylabel="mean power in µW")
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    axes.legend()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "choose_load.png", dpi=150)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("stack-load"))
    parser.add_argument("--short", action="store_true", help="two frequencies")
    options = parser.parse_args()
    for frequency, (load, watts) in main(options.out, options.short).items():
        print(
            f"{frequency:g} Hz: {load / 1e3:.3g} kohm, {1e6 * watts:.3g} uW; R f = {load * frequency / 1e3:.3g} kohm Hz"
        )
