"""Resonant shunt: inductance and resistance in parallel."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

import numpy as np

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.linear.coil import WoundShunt


@dataclass(frozen=True, kw_only=True)
class ParallelRL(WoundShunt):
    """Inductor and resistor in parallel across the electrodes.

    Raises
    ------
    ParameterError
        The coil has a self-resonance, but no winding resistance.
    """

    kind: ClassVar[str] = "parallel_rl"
    source: ClassVar[str] = "Wu, Proc. SPIE 2720, 259-269, 1996"

    resistance: float = quantity("ohm", "parallel resistance", above=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.self_resonance is not None and np.any(np.real(self.winding) == 0):
            found = "found 0 with a self-resonance, whose capacitance would be across the electrodes"
            raise ParameterError("winding_resistance", f"{found}, must be a number greater than 0 ohm")

    def states(self, capacitance: float) -> tuple[State, ...]:
        return self.coil_states()

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        current, coil = self.coil(self.winding, port.v, z, dz)
        return [self.resistance * (port.i - current) - port.v, *coil]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        current = self.coil_current(self.winding, port.v, z)
        return {"harvested": [Product(1.0 / self.resistance, port.v, port.v)], **self.coil_losses(current, z)}
