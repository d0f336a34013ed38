"""Series of preferred values of resistors, capacitors and inductors, with their tolerances.

Source: IEC 60063:2015, Preferred number series for resistors and capacitors.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cache

# Not all are powers of 10^(1/24) rounded: 2.7 to 4.7 and 8.2 are older than the rule. E12, E6 and E3 are every second,
# fourth and eighth of them.
_E24 = (
    "1.0", "1.1", "1.2", "1.3", "1.5", "1.6", "1.8", "2.0", "2.2", "2.4", "2.7", "3.0",
    "3.3", "3.6", "3.9", "4.3", "4.7", "5.1", "5.6", "6.2", "6.8", "7.5", "8.2", "9.1",
)  # fmt: skip
_E192_EXCEPTION = {"9.19": "9.20"}  # the one number of E192 that is not 10^(n/192) rounded
# Relative. E3 is for parts of more than 20 %: twice that is assumed, as for electrolytic capacitors.
_TOLERANCES = {"E3": 0.4, "E6": 0.2, "E12": 0.1, "E24": 0.05, "E48": 0.02, "E96": 0.01, "E192": 0.005}
_SAME = 1e-9  # relative: a value this close below a preferred one is that one


@dataclass(frozen=True)
class Series:
    """Preferred values, numbered through all decades: number 0 is 1, and as many follow in each decade as E says.

    Attributes
    ----------
    name : str
        "E3" to "E192".
    mantissas : tuple of str
        Values of one decade, as decimal numbers.
    tolerance : float
        Relative tolerance of the parts that the series is made for.
    """

    name: str
    mantissas: tuple[str, ...]
    tolerance: float

    def value(self, number: int) -> float:
        """The preferred value of a number."""
        decade, place = divmod(number, len(self.mantissas))
        return float(f"{self.mantissas[place]}e{decade}")

    def below(self, value: float) -> int:
        """Number of the largest preferred value that is not above a value."""
        decade = math.floor(math.log10(value))
        size = value / 10.0**decade * (1 + _SAME)
        return decade * len(self.mantissas) + bisect_right([*map(float, self.mantissas), 10.0], size) - 1

    def nearest(self, value: float) -> int:
        """Number of the preferred value that is nearest to a value, by ratio."""
        low = self.below(value)
        return low if value**2 <= self.value(low) * self.value(low + 1) else low + 1


@cache
def series_of(name: str) -> Series:
    """Series of preferred values by its name."""
    count = int(name[1:])
    if count <= len(_E24):
        mantissas = _E24[:: len(_E24) // count]
    else:
        rounded = [f"{10 ** (n / count):.2f}" for n in range(count)]
        mantissas = tuple(_E192_EXCEPTION.get(text, text) for text in rounded)
    return Series(name, mantissas, _TOLERANCES[name])
