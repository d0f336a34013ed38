"""What the paper leaves for later: rectifier, SSHI, the best load, and what the same force cycle could give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import minimize_scalar

from piezoharvest import SECE, ParallelSSHI, Rectifier, Resistor, SeriesSSHI, Shunt, System, Transducer, simulate
from reports.paper.extended import device, extended_fit
from reports.paper.model import open_circuit_voltage_per_force, transducer
from reports.paper.rows import sine_force
from reports.paper.tables import experiment

# The switched loop: an inductance that can be wound, and the quality that such loops reach with an ordinary core.
INDUCTANCE, QUALITY = 47e-3, 6.0  # H, -
SCHOTTKY = 0.3  # V
DROPS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7)  # V, one diode; two conduct


@dataclass(frozen=True)
class Interface:
    """A circuit with one quantity to be tuned: a resistance (ohm) or the dc voltage (V); or none."""

    name: str
    build: Callable[[float, float], Shunt]  # tuned quantity and diode drop
    tuned: str


INTERFACES = (
    Interface("resistor", lambda r, drop: Resistor(resistance=r), "ohm"),
    Interface("rectifier", lambda v, drop: Rectifier(dc_voltage=v, diode_drop=drop), "V"),
    Interface(
        "parallel SSHI",
        lambda v, drop: ParallelSSHI(dc_voltage=v, diode_drop=drop, inductance=INDUCTANCE, quality=QUALITY), "V",
    ),
    Interface(
        "series SSHI",
        lambda v, drop: SeriesSSHI(dc_voltage=v, diode_drop=drop, inductance=INDUCTANCE, quality=QUALITY), "V",
    ),
    Interface("SECE", lambda _, drop: SECE(), ""),
)  # fmt: skip


@dataclass(frozen=True)
class Tuned:
    """An interface at its best: mean power (W), the tuned quantity, and whether the simulation is to be trusted."""

    interface: Interface
    power: float
    value: float
    voltage_amplitude: float
    converged: bool


def power(device: Transducer, shunt: Shunt, force: float, frequency: float) -> float:
    """Mean power (W) of a sine between the offset and the force (N); NaN where the simulation is not to be trusted."""
    response = simulate(System(device, shunt), sine_force(force, frequency), samples=8)
    return response.harvested_power if response.converged else np.nan


def tune(device: Transducer, interface: Interface, force: float, frequency: float, drop: float = 0.0) -> Tuned:
    """Largest power of an interface."""
    swing = open_circuit_voltage_per_force(device) * 0.5 * (force - experiment()["offset_N"])
    middle = swing if interface.tuned == "V" else 1 / (2 * np.pi * frequency * device.capacitance)

    def lost(exponent: float) -> float:
        return -power(device, interface.build(float(np.exp(exponent)), drop), force, frequency)

    if interface.tuned:
        # From far below to what the voltage build-up of a loop of quality 6 can reach.
        grid = np.log(np.geomspace(0.01 * middle, 8 * middle, 15))
        losses = np.array([lost(x) for x in grid])
        best = grid[int(np.argmin(np.where(np.isnan(losses), np.inf, losses)))]
        width = grid[1] - grid[0]
        found = minimize_scalar(lost, bounds=(best - width, best + width), method="bounded", options={"xatol": 1e-3})
        value = float(np.exp(found.x))  # pyright: ignore[reportAttributeAccessIssue]
    else:
        value = 0.0
    response = simulate(System(device, interface.build(value, drop)), sine_force(force, frequency), samples=8)
    gained = response.harvested_power if response.converged else np.nan
    return Tuned(interface, gained, value, response.voltage_amplitude, response.converged)


@dataclass(frozen=True)
class Survey:
    """Best powers of all interfaces.

    Attributes
    ----------
    tuned : dict
        By device, frequency (Hz) and drop of a diode (V): the tuned interfaces by name, at 1 kN.
    against_drops : dict
        By device and force (N): for each rectifying interface its best power (W) at each of DROPS, at 5 Hz; the
        resistor's for comparison.
    paper_load : dict
        By device and frequency: power (W) on R2.
    """

    tuned: dict[tuple[str, float, float], dict[str, Tuned]]
    against_drops: dict[tuple[str, float], dict[str, list[float]]]
    paper_load: dict[tuple[str, float], float]


def devices() -> dict[str, Transducer]:
    """Table V, and the extended model with its leak taken for the meter's, and with the leak in the specimen."""
    p = extended_fit().parameters
    return {"Table V": transducer(), "extended": device(p, leak=False), "extended, leaking": device(p)}


@cache
def survey() -> Survey:
    """All interfaces on all devices."""
    load = Resistor(resistance=experiment()["loads_ohm"][1])
    tuned, drops, paper_load = {}, {}, {}
    for name, one in devices().items():
        for frequency in (1.0, 5.0):
            paper_load[name, frequency] = power(one, load, 1000.0, frequency)
            for drop in (0.0, SCHOTTKY):
                best = [tune(one, interface, 1000.0, frequency, drop) for interface in INTERFACES]
                tuned[name, frequency, drop] = {result.interface.name: result for result in best}
        for force in (500.0, 1000.0):
            drops[name, force] = {
                i.name: [tune(one, i, force, 5.0, drop).power for drop in (DROPS if i.tuned == "V" else DROPS[:1])]
                for i in INTERFACES
                if i.tuned
            }
            drops[name, force]["resistor"] *= len(DROPS)
    return Survey(tuned, drops, paper_load)


def power_per_volt(device: Transducer, force: float, frequency: float) -> float:
    """Largest mean power (W) of any interface for one volt of allowed electrode voltage, W/V.

    Quasi-static and linear, q = C_free v + d F, the work of a cycle is the integral of v d(dF), at most the allowed
    voltage times the charge that the force moves forth and back.
    """
    charge = device.coupling / device.stiffness * (force - experiment()["offset_N"])
    return 2 * charge * frequency
