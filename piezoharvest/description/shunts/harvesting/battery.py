"""Full-wave diode bridge into a battery."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.base import Leads
from piezoharvest.description.shunts.harvesting.rectifier import Rectifier

CELL = 3.7  # V, nominal, of one lithium-ion cell


@dataclass(frozen=True, kw_only=True)
class Battery(Rectifier):
    """Diode bridge that charges a battery: a constant `dc_voltage` behind an internal resistance.

    Power that charges the battery is harvested; the internal resistance, in series with the diodes, is a loss. The
    voltage of the dc side is the battery's open-circuit voltage. It is a given value, which a design does not tune.

    Raises
    ------
    ParameterError
        A load or a smoothing capacitance is given, or no dc voltage.
    """

    kind: ClassVar[str] = "battery"
    source: ClassVar[str] = "Sodano, Inman & Park, J. Intell. Mater. Syst. Struct. 16(10), 799-807, 2005"
    whole_side: ClassVar[bool] = True

    dc_voltage: float = quantity("V", "open-circuit voltage of the battery", at_least=0)
    internal_resistance: float = quantity(
        "ohm", "internal resistance of the battery", default=0.0, at_least=0, other_law_at_zero=True
    )

    @classmethod
    def assumed_if_named(cls, leads: Leads, values: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
        return {"dc_voltage": CELL}, f"a lithium-ion cell of {CELL} V"

    def __post_init__(self) -> None:
        for key in ("smoothing_capacitance", "load_resistance"):
            if getattr(self, key) is not None:
                raise ParameterError(key, "found together with a battery, which is the whole dc side: remove it")
        super().__post_init__()

    @property
    def tuned_side(self) -> None:
        return None

    @property
    def discharged(self) -> bool:
        return True

    @property
    def path_resistance(self) -> Any:
        return self.diodes * self.diode_resistance + self.internal_resistance
