"""What a storage capacitor supplies: a buck stage behind an undervoltage lockout, for a load of given power."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from piezoharvest.description.circuit import Row
from piezoharvest.description.parameters import Component, ParameterError, described, quantity
from piezoharvest.description.shunts.duty_cycle import LoadPhase
from piezoharvest.description.shunts.efficiency_curve import EfficiencyCurve

# Ratio of the ends of a piece of the load's line, at most: of the power, 2.2e-4 lies between a chord and what it stands
# for, and the mean over a piece is exact.
PIECE = 1.03
# Pieces below and above `turn_on`, at most, so that what begins at a high voltage finds its piece within the number of
# events that the engine allows at one instant; wider pieces lie above three times `turn_on` only.
MOST_PIECES = 40
PROTECTION = 4.0  # times `turn_on`: the protection where none is given, as 20 V for 5 V in the source


@dataclass(frozen=True, kw_only=True)
class Storage(Component):
    """The smoothing capacitor as a store: a supply with a lockout that takes a constant power from it.

    The supply turns on where the voltage v of the dc side reaches `turn_on`, and off where it falls to `turn_off`.
    While it is on, its load has the constant `power`, so that i = power/(efficiency v) leaves the store. This is a line
    of straight pieces between voltages in a constant ratio, with which the engine is exact; each piece takes as long to
    discharge the store as the constant power does. A protection takes what would charge it above `max_voltage`.

    A load with `phases` wakes, sends and sleeps: while the supply is on they follow each other, each with a power
    beside the constant one. An `efficiency_curve` replaces `efficiency`; over the voltage it holds at the
    ends of the pieces.

    Where the store has a resistance in series, the voltage of the supply is the one outside, and `max_voltage` that of
    the capacitor itself.

    Source: LTC3588-1 data sheet, Analog Devices, 2010: a buck converter, a lockout of 5 and 4 V, a shunt at 20 V.

    Raises
    ------
    ParameterError
        `turn_off` is not below `turn_on`, or `max_voltage` not above it; no phase sends; or there are two efficiencies.
    """

    turn_on: float = quantity("V", "dc voltage at which the supply turns on", above=0)
    turn_off: float = quantity("V", "dc voltage at which the supply turns off", above=0)
    power: float = quantity("W", "power of the load while the supply is on", default=0.0, at_least=0)
    efficiency: float = quantity("", "efficiency of the converter before the load", default=1.0, above=0, at_most=1)
    max_voltage: float | None = quantity(
        "V", "dc voltage to which a protection limits the store; default: four times turn_on", default=None, above=0
    )
    phases: tuple[LoadPhase, ...] = described("phases of a load that wakes, sends and sleeps, in order", default=())
    efficiency_curve: EfficiencyCurve | None = described(
        "efficiency that depends on power or voltage, a table instead of efficiency", default=None
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if np.any(np.real(self.turn_off) >= np.real(self.turn_on)):
            allowed = f"must be less than turn_on ({np.min(np.real(self.turn_on)):g} V)"
            raise ParameterError("turn_off", f"found {np.max(np.real(self.turn_off)):g} V, {allowed}")
        limit: Any = np.real(self.limit)
        if np.any(limit <= np.real(self.turn_on)):
            allowed = f"must be more than turn_on ({np.max(np.real(self.turn_on)):g} V)"
            raise ParameterError("max_voltage", f"found {np.min(limit):g} V, {allowed}")
        if self.phases and not any(phase.sends for phase in self.phases):
            raise ParameterError(
                "phases", "found none with sends = true, needs one, after which a packet has been sent"
            )
        if self.efficiency_curve is not None and np.any(np.real(self.efficiency) != 1):
            raise ParameterError("efficiency", "found together with efficiency_curve, give one of the two")

    @property
    def limit(self) -> Any:
        """Voltage of the protection, V."""
        return PROTECTION * self.turn_on if self.max_voltage is None else self.max_voltage

    @property
    def most_resistance(self) -> Any:
        """Resistance in series with the store (ohm) with which the supply would turn off by what it draws itself.

        Having turned off it would then turn on again at once.
        """
        voltage: Any = np.minimum(np.real(self.turn_on - self.turn_off), np.real(self.turn_off))
        phases = range(max(1, len(self.phases)))
        drawn = [np.real(self.power_in(n) / self.efficiency_at(self.turn_off, n)) for n in phases]
        most: Any = np.max(np.stack(np.broadcast_arrays(*drawn)), axis=0)
        with np.errstate(divide="ignore"):
            return voltage * np.real(self.turn_off) / most

    @cached_property
    def knots(self) -> tuple[list[Any], int]:
        """Voltages (V) at which the pieces of the load's line begin and end, and the place of `turn_on` among them."""
        below, above = (_pieces(high / low) for low, high in self._ranges())
        (first, middle), (_, last) = self._ranges()
        lower = [first * (middle / first) ** (k / below) for k in range(below)]
        upper = [middle * (last / middle) ** (k / above) for k in range(above)]
        return [*lower, *upper, last], below

    def _ranges(self) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        return (self.turn_off, self.turn_on), (self.turn_on, self.limit)

    def power_in(self, phase: int) -> Any:
        """Power of the load (W) while the supply is on; the number of the phase is of no effect without phases."""
        return self.power + (self.phases[phase].power if self.phases else 0.0)

    def efficiency_at(self, voltage: Any, phase: int) -> Any:
        """Efficiency of the converter at a voltage (V) of the store."""
        if self.efficiency_curve is None:
            return self.efficiency
        return self.efficiency_curve.at(self.power_in(phase), voltage)

    def share(self, piece: int, phase: int) -> Any:
        """Share of what leaves the store on a piece of the line that reaches the load."""
        knots, _ = self.knots
        return self.efficiency_at(0.5 * (knots[piece] + knots[piece + 1]), phase)

    def line(self, piece: int, phase: int = 0) -> tuple[Any, Any]:
        """Current (A) and conductance (S, mostly negative) of a piece of the line: i = current + conductance * v.

        A chord of 1/v takes more than the constant power inside; its scale makes up for that in the time in which
        the power alone discharges the store from its upper to its lower end.
        """
        if (piece, phase) not in self._lines:
            self._lines[piece, phase] = self._line(piece, phase)
        return self._lines[piece, phase]

    @cached_property
    def _lines(self) -> dict[tuple[int, int], tuple[Any, Any]]:
        """Lines that were asked for: each of them is for every configuration of the circuit, several times."""
        return {}

    def _line(self, piece: int, phase: int) -> tuple[Any, Any]:
        knots, below = self.knots
        low, high = knots[piece], knots[piece + 1]
        own, lower = _scale(high / low), _scale(knots[below] / knots[below - 1])
        # The line must not jump up at `turn_on`: a store in balance there would be led from one side to the other.
        scale: Any = own if piece < below else cast(Any, np.where(np.real(own) > np.real(lower), lower, own))
        at_low, at_high = (self.power_in(phase) / self.efficiency_at(end, phase) * scale for end in (low, high))
        slope = (at_high * low - at_low * high) / (high - low) / (low * high)
        return at_low / low - slope * low, slope

    def load(self, piece: int, phase: int, v: Row, one: Row) -> Row:
        """Current that leaves the store at its voltage `v` on a piece of the line, in a phase."""
        current, conductance = self.line(piece, phase)
        return current * one + conductance * v


def _scale(ratio: Any) -> Any:
    """Time in which a chord of 1/v discharges a store between two voltages, over that of 1/v itself."""
    return 2 * ratio * np.log(ratio) / (ratio**2 - 1)


def _pieces(ratio: Any) -> int:
    """Number of pieces for a ratio of the voltages at the ends; in a batch of designs that of the largest."""
    real: Any = np.real(ratio)
    return int(np.clip(np.ceil(np.log(np.max(real)) / np.log(PIECE)), 1, MOST_PIECES))
