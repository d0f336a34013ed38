"""Records as they are measured: steps and sines of the reference paper's campaign, and multisines, on its stack."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from piezoharvest.bench.settings import build_bench
from piezoharvest.description.transducer import Transducer
from piezoharvest.study import load_study
from reports.speed import engine, reference, studies
from reports.speed.studies import SAMPLE_RATE, Case
from reports.speed.transient import Sizes

STUDY = Path(__file__).parents[2] / "designs" / "paper_campaign" / "study.toml"
# Hz, whole periods in 10 s: multisines of the first ten tones, and of all.
TONES = np.array([0.5, 1, 2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61])
PEAK = 900.0  # N


class Recorded(NamedTuple):
    """A record: its name, the force in N, sampled, and the load in ohm."""

    title: str
    force: np.ndarray
    load: float


def measure(sizes: Sizes) -> list[dict]:
    """Time of every record, and the error of its states over the samples that are compared."""
    transducer, rows, times = load_study(STUDY).transducer, [], np.arange(1, sizes.compared_samples + 1) / SAMPLE_RATE
    for record in _records(np.arange(sizes.samples) / SAMPLE_RATE):
        with tempfile.TemporaryDirectory() as folder:
            case, end = _case(transducer, record, Path(folder)), (sizes.samples - 1) / SAMPLE_RATE
            seconds, _ = engine.time_run(case, end, 3 * sizes.repeats, 1.0)
            truth = reference.record(case, record.force, SAMPLE_RATE, times)
            error = studies.distance(engine.states(case, times), truth.states)
            events = engine.events(case, end)
        rows.append({"title": case.title, "samples": sizes.samples, "events": events, "seconds": seconds.median,
                     "least_seconds": seconds.least, "error": error})  # fmt: skip
    return rows


def _records(instants: np.ndarray) -> Iterator[Recorded]:
    """All of them, each beginning at rest."""
    setups = build_bench(load_study(STUDY))[2]
    for setup in setups:
        force, frequency = setup.excitation.signal().at(instants), setup.excitation.frequency_hz
        what = setup.excitation.kind.removesuffix("_force") + (f", {frequency:g} Hz" if frequency else "")
        yield Recorded(what, force - force[0], float(setup.shunt.resistance))
    load, phases = float(setups[0].shunt.resistance), np.random.default_rng(1).uniform(0, 2 * np.pi, len(TONES))
    for count in (10, len(TONES)):
        force = np.sin(2 * np.pi * instants[:, None] * TONES[:count] + phases[:count]).sum(axis=1)
        force -= force[0]
        what = f"multisine, {count} tones to {TONES[count - 1]:g} Hz"
        yield Recorded(what, PEAK * force / np.abs(force).max(), load)


def _case(transducer: Transducer, record: Recorded, folder: Path) -> Case:
    """A record as a study."""
    names, stops = ("mass", "damping", "stiffness", "coupling", "capacitance"), transducer.hysteresis
    assert stops is not None
    device = {name: getattr(transducer, name) for name in names}
    device["hysteresis"] = {"thresholds": list(stops.thresholds), "weights": list(stops.weights)}
    title = f"{record.title}, {np.ptp(record.force):.0f} N, {record.load / 1e3:.4g} kΩ"
    table = {
        "transducer": device, "excitation": studies.written(record.force, folder),
        "shunts": [{"kind": "resistor", "resistance": record.load}],
    }  # fmt: skip
    return Case("campaign", title, table)
