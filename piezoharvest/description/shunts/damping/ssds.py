"""Synchronised switch damping on short circuit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.switching import SynchronisedShunt, emptying_time


@dataclass(frozen=True, kw_only=True)
class SSDS(SynchronisedShunt):
    """At every extremum the electrodes are shorted for an instant: the voltage goes to zero, its energy is lost.

    With the `inductance` and `quality` of a real path the switch stays closed until that alone would have emptied the
    electrodes, a quarter of a swing, longer or shorter by `on_time_error`; the current that it then cuts is lost.
    Closed for half a swing instead, the same path is SSDI. Without an inductance that error changes nothing.

    Raises
    ------
    ParameterError
        An inductance is given without a quality, or a quality without one.
    """

    kind: ClassVar[str] = "ssds"
    source: ClassVar[str] = "Richard, Guyomar, Audigier & Ching, Proc. SPIE 3672, 104-111, 1999"

    inductance: float | None = quantity("H", "inductance of the short; default: at once", default=None, above=0)
    quality: float | None = quantity("", "quality of the short with C, sqrt(L/C)/R", default=None, above=0.5)
    on_time_error: float = quantity("", "relative error of the time for which it is closed", default=0.0, above=-1)

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.inductance is None) != (self.quality is None):
            missing = "quality" if self.quality is None else "inductance"
            raise ParameterError(missing, "missing key, inductance and quality belong together: give both or neither")

    def loop(self, capacitance: float) -> tuple[Any, Any]:
        """Inductance (H) and resistance (ohm) of the short."""
        assert self.inductance is not None and self.quality is not None  # they are asked for where there is one
        return self.inductance, np.sqrt(self.inductance / capacitance) / self.quality

    def on_time(self, capacitance: float) -> Any:
        if self.inductance is None:
            return 0.0
        return (1 + self.on_time_error) * emptying_time(*self.loop(capacitance), capacitance)

    def states(self, capacitance: float) -> tuple[State, ...]:
        return () if self.inductance is None else (State("current", self.inductance),)

    def configurations(self) -> tuple[str, ...]:
        return ("linear",) if self.inductance is None else ("open", "closed")

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        if self.inductance is None:
            return [port.i]
        if configuration == "open":
            return [port.i, dz.current]
        inductance, resistance = self.loop(port.capacitance)
        return [port.i - z.current, inductance * dz.current + resistance * z.current - port.v]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        if configuration != "closed":
            return {}
        return {"shunt_loss": [Product(self.loop(port.capacitance)[1], z.current, z.current)]}

    def closed(self, configuration: str, polarity: int) -> str:
        return configuration if self.inductance is None else "closed"

    def opened(self, configuration: str) -> str:
        return configuration if self.inductance is None else "open"
