"""Loss of a design that ignores the hysteresis of the paper's stack, against the amplitude of the force.

The load of each circuit is tuned twice, for the stack without its hysteresis and for the stack as it is, and both are
simulated with the hysteresis.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import minimize_scalar

from piezoharvest import ParallelSSHI, Rectifier, Resistor, Shunt, SineForce, System, Transducer, load_study, simulate

STUDY = Path(__file__).parents[1] / "stack-load" / "study.toml"
FREQUENCY = 5.0  # Hz, well below all resonances: best loads go with 1/frequency, losses do not depend on it
LOADS = 1e2, 1e8  # ohm
CIRCUITS = {
    "resistor": lambda load: Resistor(resistance=load),
    "rectifier": lambda load: Rectifier(smoothing_capacitance=1e-4, load_resistance=load),
    "parallel SSHI, Q_i = 6": lambda load: ParallelSSHI(
        inductance=0.1, quality=6.0, smoothing_capacitance=1e-4, load_resistance=load
    ),
}


def power(transducer: Transducer, shunt: Shunt, amplitude: float) -> float:
    """Harvested power, W; the force's mean keeps the stack compressed."""
    drive = SineForce(amplitude=amplitude, offset=1.2 * amplitude, frequency=FREQUENCY)
    return simulate(System(transducer, shunt), drive, samples=16).harvested_power


def best_load(transducer: Transducer, circuit, amplitude: float) -> float:
    """Load with the largest power, ohm."""

    def lost(log_load: float) -> float:
        return -power(transducer, circuit(float(np.exp(log_load))), amplitude)

    grid = np.log(np.geomspace(*LOADS, 37))
    best = int(np.argmin([lost(each) for each in grid]))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    return float(np.exp(minimize_scalar(lost, bounds=bounds, method="bounded", options={"xatol": 1e-3}).x))


def main(out: Path, short: bool = False) -> dict[str, np.ndarray]:
    """Write hysteresis_map.png; return amplitudes in N, and for each circuit loads in ohm and the share lost."""
    stack = load_study(STUDY).transducer
    ideal = replace(stack, hysteresis=None)
    amplitudes = np.geomspace(1.0, 900.0, 3 if short else 15)
    found = {"amplitude": amplitudes}
    for name, circuit in CIRCUITS.items():
        ignored = best_load(ideal, circuit, amplitudes[-1])  # without hysteresis, loads do not depend on the amplitude
        tuned = np.array([best_load(stack, circuit, force) for force in amplitudes])
        best = np.array([power(stack, circuit(load), force) for load, force in zip(tuned, amplitudes, strict=True)])
        without = np.array([power(stack, circuit(ignored), force) for force in amplitudes])
        believed = np.array([power(ideal, circuit(ignored), force) for force in amplitudes])
        found |= {f"{name}: load": tuned, f"{name}: ignored load": np.full(len(tuned), ignored)}
        found |= {f"{name}: lost": 1 - without / best, f"{name}: overestimated": believed / without}
    out.mkdir(parents=True, exist_ok=True)
    draw(found).savefig(out / "hysteresis_map.png", dpi=150)
    return found


def draw(found: dict[str, np.ndarray]) -> Figure:
    """Share of the power that is lost, and how much too much is expected, against the amplitude."""
    figure = Figure(figsize=(7.4, 5.2), layout="constrained")
    lost, believed = figure.subplots(2, sharex=True)
    for name, colour in zip(CIRCUITS, ("#0072b2", "#d55e00", "#009e73"), strict=True):
        lost.plot(
            found["amplitude"], 100 * found[f"{name}: lost"], ".-", color=colour, label=name.replace("Q_i", "$Q_i$")
        )
        believed.plot(found["amplitude"], found[f"{name}: overestimated"], ".-", color=colour)
    lost.set_ylabel("power lost in %")
    believed.set_ylabel("expected over actual")
    believed.set_xlabel("amplitude of the force in N")
    believed.set_xscale("log")
    for axes in (lost, believed):
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=3)
    return figure


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("hysteresis-map"))
    parser.add_argument("--short", action="store_true", help="few points")
    options = parser.parse_args()
    for name, values in main(options.out, options.short).items():
        print(f"{name:40}", *(f"{value:.4g}" for value in values))
