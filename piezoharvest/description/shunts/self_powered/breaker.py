"""Electronic breakers: two switches that close where the electrode voltage has passed a maximum or a minimum."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.real_coil import WoundCoil
from piezoharvest.description.shunts.self_powered.breaker_states import (
    CHARGED,
    EMPTY,
    HELD,
    PULLED,
    SIDES,
    SPENT,
    Breakers,
    breakers_of,
)
from piezoharvest.description.shunts.switching import SwitchedCoil

ASSUMED_SHARE = (
    1 / 20
)  # of the clamped capacitance: a tenth costs a noticeable part, a fortieth hardly drives a transistor
ASSUMED_THRESHOLD = 0.6  # V, between base and emitter
# A junction behind a resistance conducts again at so much more than its threshold, as a share of the negative voltage
# that its capacitor has: while the voltage rests, it would else block and conduct by rounding alone, without end.
AGAIN = 1e-6


def _positive(voltage: Any) -> Any:
    """A voltage, or zero where it is negative; it may have a complex step."""
    return voltage if np.real(voltage) > 0.0 else 0.0


@dataclass(frozen=True, kw_only=True)
class ElectronicBreaker(SwitchedCoil, WoundCoil):
    """Coil with two electronic breakers in its loop, one for each sign of the voltage.

    A diode charges an envelope capacitor to the peak of the voltage less its drop. The breaker closes when the voltage
    has fallen below that of the capacitor by `threshold`, the base-emitter voltage of a transistor. The lag of the
    switch follows from this: at a constant amplitude the voltage falls as V_oc (1 - cos phi), so cos phi = 1 -
    (threshold + diode_drop)/V_oc. Closing uses up the charge of the capacitor. A diode lets current through the breaker
    in one direction only; the breaker opens when the current ends. Its capacitor is not charged again until the voltage
    has fallen below the drop of the diode in front of it. Below the open-circuit voltage `least_voltage`, a breaker
    closes without any current: the circuit does not start.

    Where the voltage falls below zero by `threshold`, the junction between base and emitter conducts, and pulls the
    empty capacitor below zero with it. There it stays when the voltage turns, until that has risen by threshold and
    drop of the diode, which then charges the capacitor from this negative voltage on. So while the voltage rises, the
    capacitor of its maxima, which is charged, and that of its minima, which is pulled, are both in parallel with C. A
    breaker closes only if its capacitor has a positive voltage. `base_resistance` is in line with the junction, and
    keeps the capacitor out of the swing if it is large: it is pulled after that.

    `consumption` is further power of the control, subtracted from what is harvested.
    """

    mirrors: ClassVar[bool] = False  # half waves exchange the states of both envelope capacitors
    bridge_marks: ClassVar[tuple[str, ...]] = ("",)
    path_diodes: ClassVar[int] = 1  # in the path of a breaker

    envelope_capacitance: float = quantity("F", "capacitance of the envelope detector", above=0)
    threshold: float = quantity("V", "voltage drop from the peak at which the breaker closes", at_least=0)
    diode_drop: float = quantity("V", "forward drop of one diode", default=0.0, at_least=0)
    breaker_drop: float | None = quantity(
        "V", "forward voltage of the diode and transistor of a breaker; default: that of one diode", default=None,
        at_least=0,
    )  # fmt: skip
    base_resistance: float = quantity(
        "ohm", "resistance in line with the base of the transistor that finds the extremum", default=0.0, at_least=0,
        other_law_at_zero=True,
    )  # fmt: skip
    consumption: float = quantity("W", "further power that the control consumes", default=0.0, at_least=0)

    @classmethod
    def assumed(cls, capacitance: float, frequency: float) -> tuple[dict[str, Any], str]:
        values = {"envelope_capacitance": ASSUMED_SHARE * capacitance, "threshold": ASSUMED_THRESHOLD}
        return (
            values,
            f"envelope capacitors of {values['envelope_capacitance']:.3g} F, transistors of {ASSUMED_THRESHOLD} V",
        )

    def inversion(self, capacitance: float) -> Any:
        return super().inversion(capacitance) * self.charge_share(capacitance)

    @property
    def least_voltage(self) -> Any:
        """Open-circuit voltage amplitude above which a breaker passes a current, V; any store being empty."""
        return self.threshold + self.diode_drop + self.drop_of_path

    @property
    def drop_of_path(self) -> Any:
        """Forward voltage of all that is in the path of a breaker, V."""
        own = self.diode_drop if self.breaker_drop is None else self.breaker_drop
        return own + (self.path_diodes - 1) * self.diode_drop

    def figures(self, states: Mapping[str, float]) -> Mapping[str, float]:
        return {"least_switching_voltage": float(self.least_voltage)}

    def remark(self, events: Collection[str], dc_voltage: float) -> str:
        if "switch closes" in events:
            return super().remark(events, dc_voltage)
        return f"no breaker closes: they need an open-circuit voltage of {float(self.least_voltage):.4g} V at least"

    def breaker_states(self, capacitance: float) -> tuple[State, ...]:
        """Current of the coil, and voltages of both envelope capacitors."""
        held = (State(f"envelope_{which}", self.envelope_capacitance, odd=False) for which in ("high", "low"))
        return (*self.real_coil(capacitance).states(), *held)

    def configurations(self) -> tuple[str, ...]:
        states = (EMPTY, HELD, CHARGED, PULLED, SPENT)
        every = product(("open", "high", "low"), states, states, self.bridge_marks)
        return tuple(breakers.name for each in every if self.possible(breakers := Breakers(*each)))

    def possible(self, breakers: Breakers) -> bool:
        """Whether this circuit can be so."""
        return breakers.exists

    def possible_states(self, voltage: Any) -> Mapping[str, tuple[Any, Any]]:
        # Below the lower limit its diode would have charged it. Above the upper one its breaker would have closed and
        # used up the charge, or the junction would have pulled it; a resistance of the base leaves that until later.
        found: dict[str, tuple[Any, Any]] = {}
        for which, sign in SIDES:
            most = sign * voltage + self.threshold
            if np.any(np.real(self.base_resistance) > 0):
                most = _positive(most)
            found[f"envelope_{which}"] = (sign * voltage - self.diode_drop, most)
        return {**super().possible_states(voltage), **found}

    def guessed_states(self, voltage: float, rate: float) -> Mapping[str, float]:
        """Envelopes that follow the voltage, or halfway between what it is and what would close a breaker."""
        found = dict(super().guessed_states(voltage, rate))
        for which, sign in SIDES:
            low, high = self.possible_states(voltage)[f"envelope_{which}"]
            if sign * rate >= 0.0:
                found[f"envelope_{which}"] = float(low)
            else:
                found[f"envelope_{which}"] = float(0.5 * (low + high) if sign * voltage > 0.0 else min(high, 0.0))
        return found

    def begun(self, voltage: float, states: Mapping[str, float]) -> str:
        high, low = (HELD if states[f"envelope_{which}"] > 0.0 else EMPTY for which, _ in SIDES)
        return Breakers("open", high, low, "").name

    def path_excess(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        """Voltage that drives the current of the breaker of this sign."""
        return sign * port.v - self.drop_of_path * port.one

    def line(self, sign: int) -> Any:
        """Resistance in the path of the breaker of this sign, in addition to that of the loop, ohm."""
        return 0.0

    def path_current(self, breakers: Breakers, port: Port, z: SimpleNamespace) -> Row:
        """Current through the breaker that is closed, in the direction of a positive voltage."""
        sign = breakers.sign
        return self.real_coil(port.capacitance).current(sign != 0, self._drive(sign, port, z), port, z, self.line(sign))

    def breaker_current(self, breakers: Breakers, port: Port, z: SimpleNamespace) -> Row:
        """Current of the coil and of the envelope capacitors, out of the electrodes."""
        current = self.path_current(breakers, port, z)
        for _ in breakers.where(CHARGED):
            current = current + self.envelope_capacitance * port.dv
        for which, sign in breakers.where(PULLED):
            current = current - sign * self._of_junction(which, sign, port, z)
        return current

    def _of_junction(self, which: str, sign: int, port: Port, z: SimpleNamespace) -> Row:
        """Current out of an envelope capacitor through its junction, which conducts.

        Without a resistance it is what keeps the capacitor at the voltage of the electrodes and the threshold.
        """
        resistance, keeps = self.base_resistance, -sign * self.envelope_capacitance * port.dv
        resistive = np.real(resistance) > 0
        if not np.any(resistive):
            return keeps
        return np.where(resistive, self._fallen(which, sign, port, z) / np.where(resistive, resistance, 1.0), keeps)

    def _fallen(self, which: str, sign: int, port: Port, z: SimpleNamespace) -> Row:
        """By how much the voltage is further below an envelope than the threshold."""
        return getattr(z, f"envelope_{which}") - sign * port.v - self.threshold * port.one

    def breaker_equations(self, breakers: Breakers, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> list[Row]:
        """Equations of the states of the breakers."""
        drive, coil = self._drive(breakers.sign, port, z), self.real_coil(port.capacitance)
        found = [*coil.equations(breakers.sign != 0, drive, port, z, dz, self.line(breakers.sign))]
        for which, sign in SIDES:
            rate = getattr(dz, f"envelope_{which}")
            if breakers.of(which) == CHARGED:
                rate = rate - sign * port.dv
            elif breakers.of(which) == PULLED:
                rate = rate + self._of_junction(which, sign, port, z) / self.envelope_capacitance
            found.append(rate)
        return found

    def breaker_losses(self, breakers: Breakers, port: Port, z: SimpleNamespace) -> list[Product]:
        """Power in the coil's resistance and core, and in diodes and junctions of breakers and envelopes."""
        sign = breakers.sign
        drive, coil = self._drive(sign, port, z), self.real_coil(port.capacitance)
        losses = coil.losses(sign != 0, drive, port, z, self.line(sign))
        if sign and np.any(self.drop_of_path):
            current = self.path_current(breakers, port, z)
            losses.append(Product(sign * self.drop_of_path, port.one, current))
        for _, side in breakers.where(CHARGED):
            losses.append(Product(side * self.diode_drop * self.envelope_capacitance, port.one, port.dv))
        for which, side in breakers.where(PULLED):
            current = self._of_junction(which, side, port, z)
            losses.append(Product(self.threshold, port.one, current))
            losses.append(Product(self.base_resistance, current, current))
        return [loss for loss in losses if np.any(loss.coefficient)]

    def control(self, port: Port) -> list[Product]:
        return [Product(self.consumption, port.one, port.one)] if np.any(self.consumption) else []

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        breakers = breakers_of(configuration)
        found: list[Guard] = []
        if breakers.sign:
            current = self.path_current(breakers, port, z)
            ended = self.real_coil(port.capacitance).ended
            after = breakers._replace(position="open")
            found.append(Guard(-breakers.sign * current, after.name, ended, event="switch opens"))
        for which, sign in SIDES:
            found += self._of_envelope(breakers, which, sign, port, z)
        return found

    def _of_envelope(
        self, breakers: Breakers, which: str, sign: int, port: Port, z: SimpleNamespace
    ) -> Iterator[Guard]:
        """What becomes of one envelope capacitor."""
        state = breakers.of(which)
        if state in (CHARGED, PULLED):
            yield self._turning(breakers, which, sign, port, z)
        if state == SPENT and breakers.position != which:
            yield Guard(self.diode_drop * port.one - sign * port.v, breakers.put(which, EMPTY).name, event="")
        if state == HELD and breakers.ready:
            after = breakers.put(which, SPENT)._replace(position=which)
            yield Guard(self._fallen(which, sign, port, z), after.name, f"envelope_{which}", event="switch closes")
            # One that holds a positive voltage has closed its breaker by then.
            below = -sign * port.v - self.threshold * port.one
            yield Guard(below, breakers.put(which, EMPTY).name, event="")
        after = breakers.put(which, PULLED)
        if (state == EMPTY or (state == SPENT and breakers.position == which)) and self.possible(after):
            again = np.where(np.real(self.base_resistance) > 0, AGAIN, 0.0) * getattr(z, f"envelope_{which}")
            yield Guard(self._fallen(which, sign, port, z) + again, after.name, conducts=True)
        after = breakers.put(which, CHARGED)
        if state in (EMPTY, HELD) and self.possible(after):
            excess = sign * port.v - getattr(z, f"envelope_{which}") - self.diode_drop * port.one
            yield Guard(excess, after.name, conducts=True)

    def _turning(self, breakers: Breakers, which: str, sign: int, port: Port, z: SimpleNamespace) -> Guard:
        """An envelope capacitor ceases to follow the voltage where that turns, or where its junction's current ends."""
        after = breakers.rest_from(which).name
        if breakers.of(which) == CHARGED:
            return Guard(-sign * port.dv, after, conducts=False)
        return Guard(-self._of_junction(which, sign, port, z), after, conducts=False)

    def _drive(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        """Voltage across the coil with what resists in line."""
        return sign * self.path_excess(sign, port, z)
