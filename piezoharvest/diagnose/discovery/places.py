"""Places at which the records of a campaign may show a law without a name."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from piezoharvest.description.effects.nameless.circuit_places import (
    DcLoad,
    Diode,
    SwitchLoop,
    has_dc_load,
)
from piezoharvest.description.effects.nameless.places import (
    PARAMETERS_OVER_TIME,
    TIMES,
    Capacitor,
    Coupling,
    Damper,
    Electrodes,
    GainOverTime,
    Load,
    LoadCurrent,
    OverTime,
    Place,
    Reading,
    Spring,
)
from piezoharvest.description.effects.nameless.sizes import SIZES
from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.diagnose.discovery.tables.visited import Visited
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.problem import Problem

MIN_DIFFERENCE = 0.05  # of amplitude or frequency, relative: a law over less is told by no other record
ACTING = ("force", "base_acceleration")  # drives whose reading may be off, unless a circuit needs the engine
READ_OF = ("displacement", "voltage", "current")  # what a reading may depend on, beside the drive, rates and time


def places_of(problem: Problem, visited: Visited) -> list[Place]:
    """Places whose input moves in the records, those in the specimen first."""
    records = [data for data in problem.data if isinstance(data, Data)]
    quasi_static = problem.nominal.quasi_static
    inside: list[Place] = [Spring(), Electrodes(), Capacitor(), Coupling()]
    inside += [] if quasi_static else [Damper()]
    inside += [Load()] if any(isinstance(data.setting.shunt, Resistor) for data in records) else []
    loaded = any(has_dc_load(data.setting.shunt) for data in records)
    kinds = (Diode, SwitchLoop, *([DcLoad] if loaded else []))
    inside += [kind(reach=_largest(visited[kind.input])) for kind in kinds if kind.input in visited]
    moving = [of for of in (*TIMES, *SIZES) if of in visited and _differs(visited[of])]
    begins = {data.setting.size.begin for data in records if data.setting.size is not None}
    moving = [of for of in moving if of != "campaign_time" or len(begins) > 1]  # else it is that of the records
    names = [name for name in PARAMETERS_OVER_TIME if not (quasi_static and name == "damping")]
    inside += [OverTime(name, of) for name in names for of in moving]
    drives = dict.fromkeys(data.drive for data in records if data.drive in ACTING and not problem.needs_engine)
    inside += [Reading(drive, drive) for drive in drives]
    return [place for place in (*inside, *_readings(records)) if place.input in visited]


def every_place(problem: Problem, visited: Visited) -> list[Place]:
    """Places of both kinds, and of laws that always have a memory."""
    some = places_of(problem, visited)
    late = [LoadCurrent() for place in some if isinstance(place, Load) and "current" in visited]
    return list(dict.fromkeys([*some, *late, *over_campaign(problem, visited)]))


def over_campaign(problem: Problem, visited: Visited) -> list[Place]:
    """What may change at a moment of the campaign and stay so: parameters, and the sensors' offsets and gains."""
    if "campaign_time" not in visited:
        return []
    records = [data for data in problem.data if isinstance(data, Data)]
    inside = [place for place in places_of(problem, visited) if place.input == "campaign_time"]
    if not inside or problem.needs_engine:  # which has no product with a table
        return inside
    drives = {data.drive for data in records}
    channels = dict.fromkeys(channel for data in records for channel in (*data.channels, data.drive))
    read = [channel for channel in channels if channel in ACTING or channel not in drives]
    return [*inside, *(kind(channel, "campaign_time") for channel in read for kind in (Reading, GainOverTime))]


def _largest(values: np.ndarray) -> float:
    return float(np.abs(values).max())


def _differs(values: np.ndarray) -> bool:
    """True if an input, one number in a record, differs well between records."""
    return float(np.ptp(values)) > MIN_DIFFERENCE * float(np.abs(values).max())


def _readings(records: list[Data]) -> Iterator[Reading]:
    """Readings of all measured channels: of their own values, of other channels, of rates, and of time."""
    channels = dict.fromkeys(channel for data in records for channel in data.channels)
    drives = dict.fromkeys(data.drive for data in records)
    rates = ("displacement_rate", *(f"{drive}_rate" for drive in drives))
    twice = {("velocity", "displacement_rate")}  # the same as its own value
    if _is_proportional(records):
        twice |= {(channel, "voltage" if channel == "current" else "current") for channel in channels}
    for channel in channels:
        for of in dict.fromkeys((channel, *READ_OF, *drives, *rates, "time")):
            if channel not in drives and (channel, of) not in twice:
                yield Reading(channel, of)


def _is_proportional(records: list[Data]) -> bool:
    """True if the current is a multiple of the voltage: all records have the same resistor as their load."""
    shunts = [data.setting.shunt for data in records]
    loads = {shunt.resistance for shunt in shunts if isinstance(shunt, Resistor)}
    return len(loads) == 1 and all(isinstance(shunt, Resistor) for shunt in shunts)


__all__ = ["every_place", "over_campaign", "places_of"]
