"""A planned record as a study that the bench measures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from piezoharvest.bench.devices import Accelerometer, Buffer, Converter, CurrentSense, Laser, LoadCell
from piezoharvest.description.paths import component_table
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose.experiments.candidates import Planned
from piezoharvest.diagnose.experiments.expectation import Bench
from piezoharvest.records.campaign import Campaign

HEADROOM = 1.25  # times the largest reading: range of a sensor on the virtual bench


def study_tables(campaign: Campaign, bench: Bench, planned: Planned, transducer: Transducer) -> dict[str, Any]:
    """Tables of the study: the specimen as it is known, and a virtual bench with the noise that the records showed."""
    own = tuple(effect for effect in transducer.effects if effect.of_specimen)
    if campaign.unknown:
        transducer = transducer.settled(1.0 / planned.sample_rate)
    device = replace(transducer, effects=own, quasi_static=False)
    table = {key: value for key, value in component_table(device).items() if key != "quasi_static"}
    return {
        "title": f"planned for {campaign.title}",
        "transducer": table,
        "excitation": {"kind": planned.excitation.kind, **component_table(planned.excitation)},
        "shunts": [{"kind": planned.shunt.kind, **component_table(planned.shunt)}],
        "bench": {
            "sample_rate": planned.sample_rate,
            "duration": planned.duration,
            **{name: component_table(part) for name, part in _sensors(bench).items()},
        },
    }


def _sensors(bench: Bench) -> dict[str, Any]:
    """Sensors whose ranges hold the readings, with the noise of the campaign's channels."""
    sigma, volts = bench.noise.sigma, Converter().range
    sizes = {**bench.reach.largest, bench.reach.drive: max(map(abs, bench.reach.span))}

    def gain(channel: str) -> float:
        return volts / (HEADROOM * sizes[channel])

    found: dict[str, Any] = {}
    if "force" in sizes:
        found["load_cell"] = LoadCell(sensitivity=gain("force"), noise=sigma["force"])
    if "base_acceleration" in sizes:
        found["accelerometer"] = Accelerometer(sensitivity=gain("base_acceleration"), noise=sigma["base_acceleration"])
    if "displacement" in sizes:
        found["laser"] = Laser(sensitivity=gain("displacement"), noise=sigma["displacement"], resolution=0.0)
    if "voltage" in sizes:
        found["buffer"] = Buffer(gain=gain("voltage"), noise=sigma["voltage"])
    if "current" in sizes:
        sense = CurrentSense()
        found["current_sense"] = replace(sense, gain=gain("current") / sense.resistance, noise=sigma["current"])
    return found
