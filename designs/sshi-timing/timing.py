"""Timing of the switch of a parallel SSHI, and the quality of its loop.

Power against the phase lag, the error of the on-time, the jitter of the switch and the quality of its loop, for weak,
medium and strong coupling of a 50 Hz cantilever, with the load retuned at every point; beside it the closed form for a
prescribed displacement, and the optimum with the frequency retuned as well.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from piezoharvest import ParallelSSHI, SineForce, System, Transducer, resonances, simulate

BARE = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=0.0, capacitance=40e-9)
COUPLINGS = {"weak": 0.0002, "medium": 0.02, "strong": 0.2}  # k_e^2; times Q_m = 50: 0.01, 1 and 10
QUALITY = 6.0
LOADS = np.log(1e4), np.log(3e7)  # ohm
NAMES = {
    "phase_lag": "phase lag of the switch in rad",
    "on_time_error": "error of the on-time",
    "jitter": "jitter of the switch, rms in rad",
    "quality": "quality of the loop",
}


@dataclass(frozen=True)
class Case:
    """A transducer under a sine of 20 mN at the frequency that is best with an ideally timed switch, Hz."""

    transducer: Transducer
    frequency: float

    @classmethod
    def of(cls, coupling_squared: float) -> Case:
        """Case of a coupling k_e^2."""
        coupling = np.sqrt(coupling_squared * BARE.stiffness * BARE.capacitance)
        case = cls(replace(BARE, coupling=coupling), 50.0)
        return replace(case, frequency=case.best_frequency()[0])

    def power(self, load: float, frequency: float, **fields: float) -> float:
        """Harvested power, W."""
        shunt = ParallelSSHI(
            inductance=0.1, smoothing_capacitance=1e-6, load_resistance=load, **{"quality": QUALITY} | fields
        )
        return simulate(
            System(self.transducer, shunt), SineForce(amplitude=0.02, frequency=frequency), samples=16
        ).harvested_power

    def best_power(self, frequency: float | None = None, **fields: float) -> float:
        """Power with the best load, W; by default at the frequency of the case."""
        at = frequency or self.frequency

        def lost(log_load: float) -> float:
            return -self.power(float(np.exp(log_load)), at, **fields)

        return -minimize_scalar(lost, bounds=LOADS, method="bounded", options={"xatol": 0.02}).fun

    def best_frequency(self, **fields: float) -> tuple[float, float]:
        """Best frequency in Hz, between the two resonances or near them, and the power there in W."""
        found = resonances(self.transducer)
        bounds = float(found.short_circuit.undamped[0]) - 0.5, float(found.open_circuit.undamped[0]) + 0.5
        best = minimize_scalar(
            lambda f: -self.best_power(f, **fields), bounds=bounds, method="bounded", options={"xatol": 0.02}
        )
        return float(best.x), -best.fun


def curves(case: Case, short: bool) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Power over that with ideal timing, against each of NAMES; and with the frequency retuned against the lag."""
    ideal, grids = case.best_power(), {
        "phase_lag": np.linspace(-0.9, 0.9, 5 if short else 25),
        "on_time_error": np.linspace(-0.5, 0.5, 3 if short else 11),
        "quality": np.geomspace(1.5, 100, 3 if short else 11),
    }  # fmt: skip
    found = {
        name: (grid, np.array([case.best_power(**{name: float(value)}) for value in grid]) / ideal)
        for name, grid in grids.items()
    }
    # Slow jitter: the mean over a normal distribution of the lag.
    nodes, weights = np.polynomial.hermite_e.hermegauss(15)
    rms = np.linspace(0, 0.3, 16)
    lag, power = found["phase_lag"]
    spline = CubicSpline(lag, power)
    found["jitter"] = rms, np.array([weights @ spline(np.clip(s * nodes, -0.9, 0.9)) for s in rms]) / np.sum(weights)
    lags = np.linspace(-0.9, 0.9, 2 if short else 7)
    best = np.array([case.best_frequency(phase_lag=float(value))[1] for value in lags])
    found["retuned"] = lags, best / ideal
    return found


def prescribed(lags: np.ndarray) -> np.ndarray:
    """P/P(0) for a prescribed displacement: late ((1 - q + (1 + q) cos phi)/2)^2, early cos^2 phi; load retuned."""
    q = np.exp(-np.pi / (2 * QUALITY))
    return np.where(lags > 0, ((1 - q + (1 + q) * np.cos(lags)) / 2) ** 2, np.cos(lags) ** 2)


def draw(found: dict) -> Figure:
    """Four panels, one for each of NAMES."""
    figure = Figure(figsize=(7.4, 6.2), layout="constrained")
    for axes, (name, label) in zip(figure.subplots(2, 2).flat, NAMES.items(), strict=True):
        for colour, (coupling, each) in zip(("#0072b2", "#009e73", "#d55e00"), found.items(), strict=True):
            axes.plot(*each[name], color=colour, label=f"{coupling} coupling, load retuned")
            if name == "phase_lag":
                axes.plot(*each["retuned"], ":", color=colour, label=f"{coupling}, frequency too")
        if name == "phase_lag":
            lags = found["weak"][name][0]
            axes.plot(lags, prescribed(lags), "--", color="#68717d", label="prescribed displacement, closed form")
        if name == "quality":
            axes.set_xscale("log")
        axes.set(xlabel=label, ylabel="relative power")
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, fontsize=8)
    return figure


def main(out: Path, short: bool = False) -> dict[str, float]:
    """Write timing.png; return the figures that README.md tells."""
    cases = {name: Case.of(value) for name, value in COUPLINGS.items()}
    found = {name: curves(case, short) for name, case in cases.items()}
    out.mkdir(parents=True, exist_ok=True)
    draw(found).savefig(out / "timing.png", dpi=150)
    told: dict[str, float] = {}
    for name, each in found.items():
        told[f"{name} frequency"] = cases[name].frequency
        lag, power = each["phase_lag"]
        told |= {f"{name} lag {at:+.1f}": float(np.interp(at, lag, power)) for at in (-0.6, -0.3, 0.3, 0.6)}
        told[f"{name} best lag"] = float(lag[np.argmax(power)])
        told[f"{name} best lag gain"] = float(np.max(power))
        told[f"{name} on-time +-20 %"] = float(min(np.interp((-0.2, 0.2), *each["on_time_error"])))
        told[f"{name} jitter 0.2"] = float(np.interp(0.2, *each["jitter"]))
        told |= {f"{name} quality {q}": float(np.interp(q, *each["quality"])) for q in (3, 20)}
        told[f"{name} lag +0.6, frequency retuned"] = float(np.interp(0.6, *each["retuned"]))
    lags, power = found["weak"]["phase_lag"]
    told["closed form at most off"] = float(np.max(np.abs(power - prescribed(lags))))
    return told


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("sshi-timing"))
    parser.add_argument("--short", action="store_true", help="few points")
    options = parser.parse_args()
    for name, value in main(options.out, options.short).items():
        print(f"{name:36} {value:.3f}")
