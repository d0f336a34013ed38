"""Switches whose control lives on the dc side: until that has a voltage, the circuit is a plain rectifier."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row
from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.base import ExtendedCircuit, Shunt, own_configuration
from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.switching import SynchronisedShunt

COLD, WARM = "cold", "warm"
REACHED = 1e-9  # of the voltage to start at, within which it is reached: a capacitor that begins with it is warm


@dataclass(frozen=True, kw_only=True)
class StartedSwitch(SynchronisedShunt, Bridge):
    """Bridge in parallel with a synchronised switch, whose control the smoothing capacitor may power (cold start).

    With a `start_voltage`, the switch does not act until the dc voltage has reached it. Once the dc voltage has fallen
    to `stop_voltage`, the switch waits for the start voltage again. The control draws `control_power`.

    Raises
    ------
    ParameterError
        One of the two voltages is given without a smoothing capacitor, or the stop voltage without a start voltage or
        not below it.
    """

    start_voltage: float | None = quantity(
        "V", "dc voltage at which the control starts; default: it always works", default=None, above=0
    )
    stop_voltage: float | None = quantity(
        "V", "dc voltage at which the control stops; default: never", default=None, at_least=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start_voltage is None and self.stop_voltage is not None:
            raise ParameterError("stop_voltage", "found without start_voltage, give both")
        if self.start_voltage is not None and self.smoothing_capacitance is None:
            raise ParameterError(
                "start_voltage", "found together with dc_voltage, but belongs to a smoothing_capacitance"
            )
        if self.start_voltage is not None and self.stop_voltage is not None:
            start, stop = np.real(self.start_voltage), np.real(self.stop_voltage)
            if np.any(stop >= start):
                allowed = f"must be less than start_voltage ({np.min(start):g} V)"
                raise ParameterError("stop_voltage", f"found {np.max(stop):g} V, {allowed}")


def with_start(whole: Shunt, shunt: Shunt) -> Shunt:
    """The `whole` circuit, of which `shunt` may have a control that starts cold, with that."""
    if isinstance(shunt, StartedSwitch) and shunt.start_voltage is not None:
        return ColdStart(circuit=whole, start=shunt.start_voltage, stop=shunt.stop_voltage)
    return whole


@dataclass(frozen=True, kw_only=True)
class ColdStart(ExtendedCircuit):
    """A circuit whose control the dc side powers: its switch waits ("cold open+") or acts ("warm open+")."""

    start: Any
    stop: Any

    def configurations(self) -> tuple[str, ...]:
        return self._powered(self.circuit.configurations())

    def alike(self) -> tuple[str, ...]:
        return self._powered(self.circuit.alike())

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        return self.circuit.equations(own_configuration(configuration), port, z, dz)

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        return self.circuit.powers(own_configuration(configuration), port, z)

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        power, own = configuration.split(" ", 1)
        guards = [
            guard._replace(target=f"{power} {guard.target}", conducts=guard.begins_to_conduct)
            for guard in self.circuit.guards(own, port, z)
        ]
        if power == COLD:
            reached = z.dc - (1 - REACHED) * self.start * port.one
            guards.append(Guard(reached, f"{WARM} {own}", event="switch is powered"))
        elif self.stop is not None and self._waits(own):
            guards.append(Guard(self.stop * port.one - z.dc, f"{COLD} {own}", event="switch loses its power"))
        return guards

    def closed(self, configuration: str, polarity: int) -> str:
        if configuration.startswith(COLD):
            return configuration
        return f"{WARM} {self.circuit.closed(own_configuration(configuration), polarity)}"

    def opened(self, configuration: str) -> str:
        power, own = configuration.split(" ", 1)
        return f"{power} {self.circuit.opened(own)}"

    def _powered(self, every: tuple[str, ...]) -> tuple[str, ...]:
        """Configurations of the circuit while its switch waits, and while it acts."""
        return (*(f"{COLD} {own}" for own in every if self._waits(own)), *(f"{WARM} {own}" for own in every))

    def _waits(self, own: str) -> bool:
        """Whether the switch is open in a configuration of the circuit."""
        return self.circuit.opened(own) == own
