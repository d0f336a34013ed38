"""Bridge whose dc voltage a tracker holds at a fraction of the open-circuit voltage."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar, Self

import numpy as np

from piezoharvest.description.circuit import Port, Product, Row
from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.harvesting.rectifier import Rectifier


@dataclass(frozen=True, kw_only=True)
class MPPT(Rectifier):
    """Bridge with maximum power point tracking by a `fraction` of the open-circuit voltage.

    The open-circuit voltage is that of the dc side without a load once the motion has settled: the peak of the open
    electrodes' voltage less the diode drops. To sample it, the converter is off for a fraction `sampling_duty` of the
    time; this fraction of the power that the bridge delivers is counted as lost. The best `fraction` is one half if the
    circuit does not affect the motion.

    Raises
    ------
    ParameterError
        Any part of a dc side is given.
    """

    kind: ClassVar[str] = "mppt"
    source: ClassVar[str] = "Esram & Chapman, IEEE Trans. Energy Convers. 22(2), 439-449, 2007, section II-C"
    tracks: ClassVar[bool] = True
    whole_side: ClassVar[bool] = True
    unrecorded: ClassVar[str] = (
        "which takes its voltage from the excitation of a study; for a record use a rectifier with dc_voltage"
    )

    fraction: float = quantity("", "dc voltage as a fraction of the open-circuit one", above=0, below=1)
    sampling_duty: float = quantity(
        "", "fraction of the time that is used for sampling", default=0.0, at_least=0, below=1
    )

    @classmethod
    def assumed(cls, capacitance: float, frequency: float) -> tuple[dict[str, Any], str]:
        return {"fraction": 0.5}, "half of the open-circuit voltage, all the time"

    def _check_dc_side(self) -> None:
        keys = ("smoothing_capacitance", "load_resistance", "dc_voltage", "storage", "initial_dc_voltage")
        found = [key for key in keys if getattr(self, key) is not None]
        if found:
            raise ParameterError(found[0], "found together with a tracker, which is the whole dc side: remove it")

    @property
    def tuned_side(self) -> None:
        return None

    @property
    def discharged(self) -> bool:
        return False

    def tracked(self, open_voltage: Any) -> Self:
        excess: Any = open_voltage - self.path_drop
        found = copy.copy(self)
        found.__dict__["dc_voltage"] = self.fraction * np.where(np.real(excess) > 0, excess, 0.0)
        return found

    def dc_side(self, port: Port, z: SimpleNamespace) -> Row:
        return (0.0 if self.dc_voltage is None else self.dc_voltage) * port.one

    def level_rate(self, sign: int, port: Port, dz: SimpleNamespace) -> Row:
        return 0.0 * port.one

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        powers = super().powers(configuration, port, z)
        kept, missed = (
            [Product(share * p.coefficient, p.first, p.second) for p in powers["harvested"]]
            for share in (1 - self.sampling_duty, self.sampling_duty)
        )
        return {"harvested": kept, "shunt_loss": [*powers["shunt_loss"], *missed]}
