"""Bridge beside a switch that inverts the voltage in several stages of equal length: base of such shunts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from piezoharvest.description.circuit import Guard, Port, Row
from piezoharvest.description.shunts.bridge import diode_guards, sign_of
from piezoharvest.description.shunts.cold_start import StartedSwitch


@dataclass(frozen=True, kw_only=True)
class StagedFlip(StartedSwitch):
    """An inversion in several stages at every extremum, beside a bridge, which may conduct in any of them.

    The name of a configuration is "open" or that of a stage with the sign of the voltage before the flip in front of
    it, and behind it the sign of the conducting diodes, as in "+short-".
    """

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of the stages of a flip, in order."""
        raise NotImplementedError

    def switched_current(self, position: str, port: Port, z: SimpleNamespace) -> Row:
        """Current of the switch, beside the bridge, in a position of the switch: "open", or a stage with its sign."""
        raise NotImplementedError

    def stage(self, configuration: str, capacitance: float) -> Any:
        return 1.0 / len(self.stages)

    def configurations(self) -> tuple[str, ...]:
        switched = (f"{sign}{stage}" for sign in "+-" for stage in self.stages)
        return tuple(name + mark for name in ("open", *switched) for mark in ("", "+", "-"))

    def bridge(self, configuration: str, port: Port, z: SimpleNamespace) -> tuple[int, Row]:
        """Sign of the conducting diodes, and the current through them towards the dc side."""
        sign = sign_of(configuration)
        return sign, sign * (self.forward(port, z) - self.switched_current(position_of(configuration), port, z))

    def port_equation(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Row:
        """Equation of the electrodes."""
        sign, rectified = self.bridge(configuration, port, z)
        if sign:
            return self.conduction(sign, rectified, port, z, dz)
        return self.forward(port, z) - self.switched_current(position_of(configuration), port, z)

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        return diode_guards(self, configuration, self.bridge(configuration, port, z)[1], port, z)

    def closed(self, configuration: str, polarity: int) -> str:
        # The voltage is lowest at a maximum of sum T_i x_i.
        return configuration.replace("open", f"{'-' if polarity > 0 else '+'}{self.stages[0]}")

    def opened(self, configuration: str) -> str:
        position = position_of(configuration)
        if position == "open":
            return configuration
        after = self.stages.index(position[1:]) + 1
        name = f"{position[0]}{self.stages[after]}" if after < len(self.stages) else "open"
        return name + configuration[len(position) :]


def position_of(configuration: str) -> str:
    """Position of the switch: a configuration without the sign of the conducting diodes."""
    return configuration[:-1] if sign_of(configuration) else configuration
