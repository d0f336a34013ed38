"""Bode diagram and efficiency of the bench cantilever, with python-control.

The two-port closed with a shunt is a `control.StateSpace` with named signals; what comes out of it is compared with the
nonlinear simulation at a few frequencies. Efficiency is harvested over mechanical power.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
from matplotlib.figure import Figure

from piezoharvest import Open, Resistor, SeriesRL, Short, Shunt, System, closed_loop, load_study, simulate

STUDY = load_study(Path(__file__).with_name("study.toml"))
SHUNTS: dict[str, Shunt] = {
    "shorted": Short(),
    "open": Open(),
    "resistor 79.1 kΩ": Resistor(resistance=79.1e3),
    "series RL 241 H, 38.7 kΩ": SeriesRL(inductance=241.0, resistance=38.7e3),
}


def receptance(shunt: Shunt, frequencies: np.ndarray) -> np.ndarray:
    """Displacement (f,) per force in m/N, by python-control."""
    loop = closed_loop(System(STUDY.transducer, shunt))
    response = control.frequency_response(loop["displacement", "force"], 2 * np.pi * frequencies)
    return np.ravel(response.complex)


def efficiencies(shunt: Shunt, frequencies: np.ndarray) -> np.ndarray:
    """Harvested over mechanical power (f,), by simulation."""
    system = System(STUDY.transducer, shunt)
    drives = [replace(STUDY.excitation, frequency=float(f)) for f in frequencies]
    return np.array([simulate(system, drive, samples=16).efficiency for drive in drives])


def main(out: Path, short: bool = False) -> dict[str, float]:
    """Write bode_efficiency.png; return the largest receptance of each shunt in m/N, and the largest disagreement."""
    frequencies = np.linspace(44.0, 57.0, 40 if short else 400)
    few = np.linspace(45.0, 56.0, 4 if short else 23)
    figure = Figure(figsize=(7.4, 7.0), layout="constrained")
    gain, phase, efficiency = figure.subplots(3, sharex=True)
    found, off = {}, 0.0
    for (name, shunt), colour in zip(SHUNTS.items(), ("#1d232b", "#68717d", "#0072b2", "#d55e00"), strict=True):
        response = receptance(shunt, frequencies)
        gain.semilogy(frequencies, np.abs(response), color=colour, label=name)
        phase.plot(frequencies, np.degrees(np.unwrap(np.angle(response))), color=colour)
        if not isinstance(shunt, Open | Short):
            efficiency.plot(few, 100 * efficiencies(shunt, few), ".-", color=colour)
        found[name] = float(np.max(np.abs(response)))
        at = replace(STUDY.excitation, frequency=float(few[1]))
        simulated = simulate(System(STUDY.transducer, shunt), at, samples=16).displacement_amplitude
        expected = STUDY.excitation.amplitude * abs(receptance(shunt, few[1:2])[0])
        off = max(off, abs(simulated / expected - 1))
    gain.set_ylabel("receptance in m/N")
    phase.set_ylabel("phase in degrees")
    efficiency.set(ylabel="efficiency in %", xlabel="frequency in Hz", ylim=(0, 100))
    for axes in (gain, phase, efficiency):
        axes.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=2)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "bode_efficiency.png", dpi=150)
    return found | {"simulation against python-control": off}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("bode-efficiency"))
    parser.add_argument("--short", action="store_true", help="few points")
    options = parser.parse_args()
    for name, value in main(options.out, options.short).items():
        print(f"{name:36} {value:.3g}")
