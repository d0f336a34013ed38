"""States of both electronic breakers together, and of a bridge beside them, as configurations of a circuit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

SIDES = (("high", 1), ("low", -1))  # breakers, and the sign of the voltage that each has to do with
# Of an envelope capacitor: it holds a positive voltage, is charged by the voltage, holds none or a negative one, is
# pulled down with the voltage by the junction of its breaker, or that has just used its charge.
HELD, CHARGED, EMPTY, PULLED, SPENT = "held", "charged", "empty", "pulled", "spent"


class Breakers(NamedTuple):
    """Configuration of both breakers and of a bridge beside them.

    Attributes
    ----------
    position : "open", "high" or "low"
        Which breaker is closed: the one that found a maximum, or a minimum.
    high, low : "empty", "held", "charged", "pulled" or "spent"
        What the envelope capacitors of maxima and of minima do.
    bridge : "", "+" or "-"
        Sign of the voltage at which a bridge beside them conducts.
    """

    position: str
    high: str
    low: str
    bridge: str

    @property
    def name(self) -> str:
        """Name of the configuration."""
        return f"{self.position} {self.high} {self.low}{self.bridge}"

    @property
    def sign(self) -> int:
        """Sign of the voltage at which the breaker that is closed conducts, 0 if none is."""
        return {"high": 1, "low": -1}.get(self.position, 0)

    @property
    def exists(self) -> bool:
        """Whether the breakers can be so.

        One that is closed keeps its capacitor from being charged. The voltage cannot rise and fall at the same time,
        and pulls a capacitor below zero on one side of zero only.
        """
        if self.position != "open" and self.of(self.position) not in (SPENT, PULLED):
            return False
        if self.high == self.low and self.high in (CHARGED, PULLED, SPENT):
            return False
        if (self.position == "high" and self.low == SPENT) or (self.position == "low" and self.high == SPENT):
            return False
        return not (self.high == PULLED and self.bridge == "+") and not (self.low == PULLED and self.bridge == "-")

    @property
    def ready(self) -> bool:
        """Whether a breaker may close: the other one keeps it from that until its capacitor may be charged again."""
        return self.position == "open" and SPENT not in (self.high, self.low)

    def of(self, which: str) -> str:
        """State of the envelope capacitor of a breaker, "high" or "low"."""
        return self.high if which == "high" else self.low

    def where(self, state: str) -> Iterator[tuple[str, int]]:
        """Breakers whose envelope capacitors are in a state, with their signs."""
        return ((which, sign) for which, sign in SIDES if self.of(which) == state)

    def put(self, which: str, state: str) -> Breakers:
        """The same with another state of one envelope capacitor."""
        return self._replace(high=state) if which == "high" else self._replace(low=state)

    def rest_from(self, which: str) -> Breakers:
        """The same where the voltage that an envelope capacitor follows rests, or turns."""
        if self.of(which) == CHARGED:
            return self.put(which, HELD)
        return self.put(which, SPENT if self.position == which else EMPTY)


def breakers_of(configuration: str) -> Breakers:
    """State of the breakers from the name of a configuration."""
    position, high, last = configuration.split(" ")
    low = last.rstrip("+-")
    return Breakers(position, high, low, last[len(low) :])
