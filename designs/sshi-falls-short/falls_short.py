"""A harvester whose SSHI falls short of its design: measured, diagnosed, designed again, measured again.

The design knows the data sheet (study.toml), later the specimen that the diagnosis saves. The bench (bench.toml) has a
solver of its own, and an effect that the data sheet does not tell.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from piezoharvest import Shunt, System, Transducer, design, diagnose, load_campaign, load_specimen, load_study, simulate
from piezoharvest.bench import measure, write_campaign

HERE = Path(__file__).parent
STUDY, BENCH = load_study(HERE / "study.toml"), load_study(HERE / "bench.toml")
SETTLED = 8.0  # time constants of load and smoothing capacitor, after which the power is read
PERIODS = 10  # over which it is averaged


def with_load(shunt, load: float) -> Shunt:
    """The same circuit with another load, ohm."""
    return replace(shunt, load_resistance=load)


def simulated(transducer: Transducer, shunt: Shunt) -> float:
    """Power of the load in the steady state, W."""
    return simulate(System(transducer, shunt), STUDY.excitation, samples=16).harvested_power


def measured(shunt) -> float:
    """Power of the load on the bench, W: mean square of the dc voltage, by the load."""
    setup = {key: value for key, value in BENCH.bench.items() if key != "records"}
    setup["duration"] = SETTLED * shunt.load_resistance * shunt.smoothing_capacitance
    (record,) = measure(replace(BENCH, shunts=(shunt,), bench=setup)).records
    count = round(PERIODS * setup["sample_rate"] * STUDY.excitation.period)
    return float(np.mean(record.columns["dc_voltage_V"][-count:] ** 2)) / shunt.load_resistance


def draw(curves: dict, points: dict, loads: np.ndarray) -> Figure:
    """Power against the load: curves by the models, points by the bench."""
    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    axes = figure.subplots()
    for (name, powers), colour in zip(curves.items(), ("#0072b2", "#009e73", "#d55e00"), strict=True):
        axes.semilogx(loads / 1e3, 1e6 * powers, color=colour, label=name)
    for (name, (load, power)), marker in zip(points.items(), ("s", "o"), strict=True):
        axes.plot(load / 1e3, 1e6 * power, marker, color="#1d232b", label=name)
    axes.set(xlabel="load in kΩ", ylabel="power in µW", ylim=(0, None))
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    return figure


def main(out: Path, short: bool = False) -> dict:
    """Write the campaign, the specimens and falls_short.png; return the figures that README.md tells."""
    out.mkdir(parents=True, exist_ok=True)
    first = design(STUDY).best
    campaign = write_campaign(measure(replace(BENCH, shunts=(first.shunt,))), out / "campaign")
    found = diagnose(load_campaign(campaign))
    found.before.save(out / "identified.toml")
    found.save(out / "specimen.toml")
    models = {"data sheet": STUDY.transducer} | {
        name: load_specimen(out / f"{file}.toml").transducer
        for name, file in (("fitted as it was", "identified"), ("fitted with the cause", "specimen"))
    }
    again = design(replace(STUDY, transducer=models["fitted with the cause"])).best
    points = {
        "first design, measured": (first.shunt.load_resistance, measured(first.shunt)),
        "second design, measured": (again.shunt.load_resistance, measured(again.shunt)),
    }
    loads = np.geomspace(5e4, 3e6, 5 if short else 41)
    curves = {
        name: np.array([simulated(model, with_load(first.shunt, load)) for load in loads])
        for name, model in models.items()
    }
    draw(curves, points, loads).savefig(out / "falls_short.png", dpi=150)
    return {
        "verdict": found.verdict,
        "effects": {named.effect.name: vars(named.effect) for named in found.effects},
        "rms before": found.validation_before.rms,
        "rms after": found.validation_after.rms,
        "noise": found.validation_after.noise,
        "predicted": {name: simulated(model, first.shunt) for name, model in models.items()},
        "predicted again": again.harvested_power,
        "kinds": (first.shunt.kind, again.shunt.kind),
        "loads": tuple(load for load, _ in points.values()),
        "measured": tuple(power for _, power in points.values()),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("sshi-falls-short"))
    parser.add_argument("--short", action="store_true", help="few points of the curves")
    options = parser.parse_args()
    for name, value in main(options.out, options.short).items():
        print(f"{name:16} {value}")
