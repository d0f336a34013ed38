"""A shunt defined in a user's own script is as good as one of the package's."""

import gc
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from studies import BENCH, DRIVE, LOOP

from piezoharvest import linearize_shunt
from piezoharvest.description import shunts
from piezoharvest.description.circuit import Guard, Product, State
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.switching import InductiveSwitch
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine import simulate
from piezoharvest.exchange import shunt_from
from piezoharvest.linear import frequency_response
from piezoharvest.spice import export_spice

DEVICE = Transducer(**BENCH)
DRIVE = SineForce(amplitude=DRIVE["amplitude"], frequency=DRIVE["frequency"])


@pytest.fixture(autouse=True)
def forgotten_afterwards():
    yield
    gc.collect()  # classes refer to themselves; what is collected is no longer registered
    assert not [kind for kind in shunts.registered() if kind.startswith("my_")]


def test_voltage_limiter_is_a_bridge_onto_a_constant_voltage():
    @dataclass(frozen=True, kw_only=True)
    class Limiter(shunts.Shunt):
        """Two Zener diodes back to back."""

        kind: ClassVar[str] = "my_limiter"
        source: ClassVar[str] = "a user's notebook"
        limit: float = quantity("V", "largest electrode voltage", above=0)

        def configurations(self):
            return ("free", "held+", "held-")

        def equations(self, configuration, port, z, dz):
            return [port.i if configuration == "free" else port.dv]

        def powers(self, configuration, port, z):
            sign = {"free": 0, "held+": 1, "held-": -1}[configuration]
            return {"shunt_loss": [Product(sign * self.limit, port.one, port.i)]}

        def guards(self, configuration, port, z):
            if configuration == "free":
                return [Guard(s * port.v - self.limit * port.one, f"held{m}") for s, m in ((1, "+"), (-1, "-"))]
            return [Guard(-port.i if configuration == "held+" else port.i, "free")]

    assert shunts.registered()["my_limiter"] is Limiter
    found = simulate(System(DEVICE, Limiter(limit=2.0)), DRIVE)
    wanted = simulate(System(DEVICE, shunts.Rectifier(dc_voltage=2.0)), DRIVE)
    assert found.converged, found.message
    assert found.shunt == "my_limiter"
    assert found.voltage_amplitude == pytest.approx(2.0, rel=1e-9)
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-10)
    assert found.energy["shunt_loss"] == pytest.approx(wanted.energy["harvested"], rel=1e-9)
    assert found.harvested_power == 0.0


def test_linear_circuit_is_simulated_and_has_a_frequency_response():
    @dataclass(frozen=True, kw_only=True)
    class ResistiveDivider(shunts.LinearShunt):
        """A load behind a long cable: series resistance, then capacitance and load in parallel."""

        kind: ClassVar[str] = "my_cable"
        source: ClassVar[str] = "a user's notebook"
        series: float = quantity("ohm", "of the cable", above=0)
        capacitance: float = quantity("F", "of the cable", above=0)
        resistance: float = quantity("ohm", "load", above=0)

        def states(self, capacitance):
            return (State("voltage", self.capacitance),)

        def equations(self, configuration, port, z, dz):
            into = self.capacitance * dz.voltage + z.voltage / self.resistance
            return [port.v - z.voltage - self.series * port.i, port.i - into]

        def powers(self, configuration, port, z):
            load = Product(1 / self.resistance, z.voltage, z.voltage)
            return {"harvested": [load], "shunt_loss": [Product(self.series, port.i, port.i)]}

    system = System(DEVICE, ResistiveDivider(series=1e4, capacitance=20e-9, resistance=1e5))
    network = System(DEVICE, shunts.Network(netlist="R1 1 2 10k\nC1 2 0 20n\nR2 2 0 100k load"))
    found, wanted = simulate(system, DRIVE), simulate(network, DRIVE)
    assert found.harvested_power == pytest.approx(wanted.harvested_power, rel=1e-10)
    assert found.energy["shunt_loss"] == pytest.approx(wanted.energy["shunt_loss"], rel=1e-9)
    response = frequency_response(system, [DRIVE.frequency])
    assert found.harvested_power == pytest.approx(DRIVE.amplitude**2 * response.harvested_power[0], rel=1e-9)


def test_switched_circuit_takes_its_timing_from_the_package():
    @dataclass(frozen=True, kw_only=True)
    class Twin(InductiveSwitch):
        """SSDI with its resistance counted as a load."""

        kind: ClassVar[str] = "my_ssdi"
        source: ClassVar[str] = "a user's notebook"

        def states(self, capacitance):
            return (State("current", self.loop(capacitance)[0]),)

        def configurations(self):
            return ("apart", "joined")

        def equations(self, configuration, port, z, dz):
            joined = configuration == "joined"
            return [port.i - self.loop_current(joined, port, z), self.loop_equation(joined, port.v, port, z, dz)]

        def powers(self, configuration, port, z):
            return {"harvested": [Product(self.loop(port.capacitance)[1], z.current, z.current)]}

        def closed(self, configuration, polarity):
            return "joined"

        def opened(self, configuration):
            return "apart"

    found = simulate(System(DEVICE, Twin(**LOOP)), DRIVE)
    wanted = simulate(System(DEVICE, shunts.SSDI(**LOOP)), DRIVE)
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-10)
    total = found.energy["harvested"] + found.energy["shunt_loss"]
    assert total == pytest.approx(wanted.energy["shunt_loss"], rel=1e-9)
    assert np.all(np.isfinite(found.waveforms.voltage))


def test_a_linear_circuit_is_exported_as_the_network_of_its_admittance():
    """The message named the kinds of the package only, with no way for a kind of one's own."""

    @dataclass(frozen=True, kw_only=True)
    class LossyCapacitor(shunts.LinearShunt):
        """Capacitance with a series resistance."""

        kind: ClassVar[str] = "my_lossy_capacitor"
        source: ClassVar[str] = "a user's notebook"
        capacitance: float = quantity("F", "capacitance", above=0)
        resistance: float = quantity("ohm", "series resistance", above=0)

        def states(self, capacitance):
            return (State("voltage", self.capacitance),)

        def equations(self, configuration, port, z, dz):
            return [self.resistance * port.i + z.voltage - port.v, self.capacitance * dz.voltage - port.i]

        def powers(self, configuration, port, z):
            return {"harvested": [Product(self.resistance, port.i, port.i)]}

    shunt = LossyCapacitor(capacitance=1e-7, resistance=1e5)
    with pytest.raises(ParameterError, match=r"shunt_from\(linearize_shunt\(...\)\) makes a network of it"):
        export_spice(DEVICE, shunt, DRIVE)
    network = shunt_from(linearize_shunt(shunt))
    assert "shunt: network" in export_spice(DEVICE, network, DRIVE)
    found, wanted = (simulate(System(DEVICE, each), DRIVE).voltage_amplitude for each in (network, shunt))
    assert found == pytest.approx(wanted, rel=1e-6)
