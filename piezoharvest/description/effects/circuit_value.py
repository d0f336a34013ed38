"""A value of the circuits in a campaign that is fitted instead of taken from the label."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.base import Shunt


class _Unregistered:
    """Gives a name without registering it: users name the value in a record's shunt, not among the effects."""

    name: ClassVar[str] = "circuit_value"
    source: ClassVar[str] = "the campaign"


@dataclass(frozen=True, kw_only=True)
class CircuitValue(_Unregistered, Effect):
    """Another value of a key in every circuit of a kind whose label says the nominal one.

    Attributes
    ----------
    kind, key : str
        Kind of the circuit and its key.
    label : float
        Nominal value.
    value : float
        SI, as the circuit's own key.
    """

    kind: str
    key: str
    label: float
    value: float = quantity("", "value of the part in the circuit")

    def connect(self, shunt: Shunt) -> Shunt:
        if getattr(shunt, "kind", None) != self.kind or getattr(shunt, self.key) != self.label:
            return shunt
        return dataclasses.replace(shunt, **{self.key: self.value})

    @property
    def absent(self) -> bool:
        """True, as it adds no equation."""
        return True

    @property
    def title(self) -> str:
        """Name in results: "parallel_sshi.quality"."""
        return f"{self.kind}.{self.key}"


def circuit_values(shunt: Shunt, keys: Sequence[str], where: str) -> tuple[CircuitValue, ...]:
    """Values of a circuit that are to be fitted.

    Raises
    ------
    ParameterError
        A key is not one of the circuit's numbers, or the circuit does not use it.
    """
    numbers = [field.name for field in dataclasses.fields(shunt) if "unit" in field.metadata]
    given = [name for name in numbers if isinstance(getattr(shunt, name), int | float)]
    found: list[CircuitValue] = []
    for key in keys:
        if key not in given:
            allowed = f"allowed are the numbers of this {shunt.kind}: {', '.join(given) or 'it has none'}"
            raise ParameterError(f"{where}.fit", f"found {str(key)[:80]!r}, {allowed}")
        value = float(getattr(shunt, key))
        found.append(CircuitValue(kind=shunt.kind, key=key, label=value, value=value))
    return tuple(found)
