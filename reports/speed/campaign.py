"""Records as they are measured: the steps and sines of the reference paper's campaign, on its stack."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from piezoharvest.records.bench.settings import Setup, build_bench
from piezoharvest.study import load_study
from piezoharvest.transducer import Transducer
from reports.speed import engine, reference, studies
from reports.speed.studies import SAMPLE_RATE, Case
from reports.speed.transient import Sizes

STUDY = Path(__file__).parents[2] / "designs" / "paper_campaign" / "study.toml"


def measure(sizes: Sizes) -> list[dict]:
    """Time of every record, and the error of its states over the samples that are compared."""
    study = load_study(STUDY)
    rows, times = [], np.arange(1, sizes.compared_samples + 1) / SAMPLE_RATE
    for setup in build_bench(study)[2]:
        instants = np.arange(sizes.samples) / SAMPLE_RATE
        force = setup.excitation.signal().at(instants)
        force = force - force[0]  # it begins at rest
        with tempfile.TemporaryDirectory() as folder:
            case = _case(study.transducer, setup, force, Path(folder))
            seconds, _ = engine.time_run(case, instants[-1], 3 * sizes.repeats, 1.0)
            truth = reference.record(case, force, SAMPLE_RATE, times)
            error = studies.distance(engine.states(case, times), truth.states)
            events = engine.events(case, instants[-1])
        rows.append({"title": case.title, "samples": sizes.samples, "events": events, "seconds": seconds.median,
                     "least_seconds": seconds.least, "error": error})  # fmt: skip
    return rows


def _case(transducer: Transducer, setup: Setup, force: np.ndarray, folder: Path) -> Case:
    """A record of the campaign as a study."""
    names, stops = ("mass", "damping", "stiffness", "coupling", "capacitance"), transducer.hysteresis
    assert stops is not None
    device = {name: getattr(transducer, name) for name in names}
    device["hysteresis"] = {"thresholds": list(stops.thresholds), "weights": list(stops.weights)}
    load = float(setup.shunt.resistance)
    what = setup.excitation.kind.removesuffix("_force")
    frequency = setup.excitation.frequency_hz
    title = f"{what}, {f'{frequency:g} Hz, ' if frequency else ''}{np.ptp(force):.0f} N, {load / 1e3:.4g} kΩ"
    table = {
        "transducer": device, "excitation": studies.written(force, folder),
        "shunts": [{"kind": "resistor", "resistance": load}],
    }  # fmt: skip
    return Case("campaign", title, table)
