"""Parallel synchronised bias-flip: the voltage is inverted in several steps, each through the coil about a bias."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar, Literal, get_args

import numpy as np

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import ParameterError, described, quantity
from piezoharvest.description.shunts.real_coil import WoundSwitch
from piezoharvest.description.shunts.staged import StagedFlip, position_of

Steps = Literal[3, 1, 2, 4, 5, 6, 7, 8]
# A bias capacitance where none is given, over C: as good as the constant source that it stands for, as the power then
# is right to 1e-6. From rest it would need as many periods to settle; a smaller one settles sooner.
STIFFNESS = 1e5


@dataclass(frozen=True, kw_only=True)
class BiasFlip(WoundSwitch, StagedFlip):
    """Parallel synchronised bias-flip: the voltage is inverted in `steps` half swings about bias voltages.

    Each step lasts for half a damped period of its own loop, longer or shorter by `on_time_error`. Step k and step n +
    1 - k use the same bias capacitor with opposite signs; with an odd number of steps the middle one has none. A
    capacitor is charged in the first of its steps and discharged in the second, so its voltage settles where all steps
    are equal. If a single step inverts the fraction q of the voltage, n steps invert q_n, where (1 - q_n)/(1 + q_n) =
    (1 - q)/(1 + q)/n. With one step the circuit is a parallel SSHI. `inductance` and `quality` are those of the coil
    with C.
    """

    kind: ClassVar[str] = "bias_flip"
    source: ClassVar[str] = "Liang, Zhao & Yang, IEEE Trans. Power Electron. 34(1), 275-286, 2019"

    steps: Steps = described("number of steps of one inversion", default=3)
    bias_capacitance: float | None = quantity(
        "F", "capacitance of each bias capacitor; default: 1e5 C", default=None, above=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.steps not in get_args(Steps):
            raise ParameterError("steps", f"found {self.steps}, allowed are 1 to {max(get_args(Steps))}")

    @property
    def stages(self) -> tuple[str, ...]:
        return tuple(f"step{k}" for k in range(1, self.steps + 1))

    def on_time(self, capacitance: float) -> float:
        """Seconds that all steps last."""
        return (1 + self.on_time_error) * sum(self.step_time(stage, capacitance) for stage in self.stages)

    def step_time(self, stage: str, capacitance: float) -> Any:
        """Damped half period of a step's loop, with its bias capacitor in line, s."""
        connected, _ = self._capacitor(f"+{stage}")
        bias = 1 / self._bias_capacitance(capacitance) if connected else 0.0
        inductance, resistance = self.loop(capacitance)
        return np.pi / np.sqrt((1 / capacitance + bias) / inductance - (resistance / (2 * inductance)) ** 2)

    def stage(self, configuration: str, capacitance: float) -> Any:
        position = position_of(configuration)
        if position == "open":
            return 1.0
        return self.step_time(position[1:], capacitance) * (1 + self.on_time_error) / self.on_time(capacitance)

    def inversion(self, capacitance: float) -> Any:
        q = super().inversion(capacitance)
        lost = (1 - q) / (1 + q) / self.steps
        return (1 - lost) / (1 + lost)

    def states(self, capacitance: float) -> tuple[State, ...]:
        bias = self._bias_capacitance(capacitance)
        capacitors = (State(f"bias_{k}", bias, odd=False) for k in range(1, self.steps // 2 + 1))
        return (*self.real_coil(capacitance).states(), *capacitors, *self.bridge_states())

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        position, bias = position_of(configuration), self._bias_capacitance(port.capacitance)
        connected, side = self._capacitor(position)
        drive = self._drive(position, port, z)
        coil = self.real_coil(port.capacitance).equations(position != "open", drive, port, z, dz)
        current = self.switched_current(position, port, z)
        charging = [
            bias * getattr(dz, f"bias_{k}") - (side * current if k == connected else 0.0)
            for k in range(1, self.steps // 2 + 1)
        ]
        _, rectified = self.bridge(configuration, port, z)
        dc = self.dc_equations(rectified, port, z, dz)
        return [self.port_equation(configuration, port, z, dz), *coil, *charging, *dc]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        powers = self.bridge_powers(self.bridge(configuration, port, z)[1], port, z)
        powers["shunt_loss"] += self.leads_loss(port, z)
        position = position_of(configuration)
        drive = self._drive(position, port, z)
        powers["shunt_loss"] += self.real_coil(port.capacitance).losses(position != "open", drive, port, z)
        return powers

    def switched_current(self, position: str, port: Port, z: SimpleNamespace) -> Row:
        drive = self._drive(position, port, z)
        return self.real_coil(port.capacitance).current(position != "open", drive, port, z)

    def _drive(self, position: str, port: Port, z: SimpleNamespace) -> Row:
        """Voltage across the coil in a position of the switch."""
        connected, side = self._capacitor(position)
        return port.v - side * getattr(z, f"bias_{connected}") if connected else port.v

    def _bias_capacitance(self, capacitance: float) -> Any:
        return STIFFNESS * capacitance if self.bias_capacitance is None else self.bias_capacitance

    def _capacitor(self, position: str) -> tuple[int, int]:
        """Number of the bias capacitor in line (0: none), and the sign with which it opposes the voltage."""
        if position == "open":
            return 0, 0
        k, side = int(position[-1]), 1 if position[0] == "+" else -1
        if 2 * k == self.steps + 1:
            return 0, 0
        return (k, side) if 2 * k <= self.steps else (self.steps + 1 - k, -side)
