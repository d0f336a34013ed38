"""Electronic breakers: two switches that close where the electrode voltage has passed a maximum or a minimum."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.real_coil import WoundCoil
from piezoharvest.description.shunts.switching import SwitchedCoil

NEITHER = "none"
ASSUMED_SHARE = (
    1 / 20
)  # of the clamped capacitance: a tenth costs a noticeable part, a fortieth hardly drives a transistor
ASSUMED_THRESHOLD = 0.6  # V, between base and emitter


class Breakers(NamedTuple):
    """Configuration of both breakers and of a bridge beside them.

    Attributes
    ----------
    position : "open", "high", "low", "spent_high" or "spent_low"
        Which breaker has closed: the one that found a maximum, or a minimum; or whose current has ended.
    charged : "none", "h", "l" or "hl"
        Envelope capacitors with a charge.
    envelope : "idle", "rise" or "fall"
        Whether the voltage charges the one of maxima or that of minima.
    bridge : "", "+" or "-"
        Sign of the voltage at which a bridge beside them conducts.
    """

    position: str
    charged: str
    envelope: str
    bridge: str

    @property
    def name(self) -> str:
        """Name of the configuration."""
        return f"{self.position} {self.charged} {self.envelope}{self.bridge}"

    @property
    def sign(self) -> int:
        """Sign of the voltage at which the breaker that has closed conducts, 0 if none has."""
        return {"high": 1, "low": -1}.get(self.position, 0)

    @property
    def charging(self) -> bool:
        """Whether an envelope capacitor is being charged."""
        return self.envelope != "idle"

    @property
    def exists(self) -> bool:
        """Whether the breakers can be so: one that is closed keeps its capacitor empty, and signs agree."""
        empty = "" if self.position == "open" else "h" if self.position.endswith("high") else "l"
        wanted, against = {"idle": ("", " "), "rise": ("h", "-"), "fall": ("l", "+")}[self.envelope]
        return not (empty and empty in self.charged) and wanted in self.charged and self.bridge != against

    def charge(self, which: str) -> str:
        """The charged capacitors with another one."""
        return "".join(each for each in "hl" if each in self.charged or each == which)

    def discharge(self, which: str) -> str:
        """The charged capacitors without one of them."""
        return self.charged.replace(which, "") or NEITHER


def breakers_of(configuration: str) -> Breakers:
    """State of the breakers from the name of a configuration."""
    position, charged, last = configuration.split(" ")
    envelope = last.rstrip("+-")
    return Breakers(position, charged, envelope, last[len(envelope) :])


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
    in one direction only; the breaker opens when the current ends. Its capacitor stays empty until the voltage has
    fallen below the drop of the diode in front of it. Below the open-circuit voltage `least_voltage`, a breaker closes
    without any current: the circuit does not start.

    While the voltage rises above the diode drop, it charges an envelope capacitor in parallel with C. `consumption` is
    further power of the control, subtracted from what is harvested.
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
        every = (
            Breakers(position, charged, envelope, bridge)
            for position in ("open", "high", "low", "spent_high", "spent_low")
            for charged in (NEITHER, "h", "l", "hl")
            for envelope in ("idle", "rise", "fall")
            for bridge in self.bridge_marks
        )
        return tuple(breakers.name for breakers in every if breakers.exists)

    def possible_states(self, voltage: Any) -> Mapping[str, tuple[Any, Any]]:
        # Above the upper limit its breaker would have closed and used up the charge.
        found = {
            f"envelope_{which}": (
                _positive(sign * voltage - self.diode_drop),
                _positive(sign * voltage + self.threshold),
            )
            for which, sign in (("high", 1), ("low", -1))
        }
        return {**super().possible_states(voltage), **found}

    def guessed_states(self, voltage: float, rate: float) -> Mapping[str, float]:
        """Envelopes that follow the voltage, or halfway between what it is and what would close a breaker."""
        found = dict(super().guessed_states(voltage, rate))
        for which, sign in (("high", 1), ("low", -1)):
            low, high = self.possible_states(voltage)[f"envelope_{which}"]
            falls = sign * voltage > 0.0 > sign * rate
            found[f"envelope_{which}"] = float(0.5 * (low + high) if falls else low)
        return found

    def begun(self, voltage: float, states: Mapping[str, float]) -> str:
        charged = "".join(which[0] for which in ("high", "low") if states[f"envelope_{which}"] > 0.0)
        return Breakers("open", charged or NEITHER, "idle", "").name

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
        charging = self.envelope_capacitance if breakers.charging else 0.0
        return self.path_current(breakers, port, z) + charging * port.dv

    def breaker_equations(self, breakers: Breakers, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> list[Row]:
        """Equations of the states of the breakers."""
        sign = breakers.sign
        drive, coil = self._drive(sign, port, z), self.real_coil(port.capacitance)
        high = dz.envelope_high - (port.dv if breakers.envelope == "rise" else 0.0)
        low = dz.envelope_low + (port.dv if breakers.envelope == "fall" else 0.0)
        return [*coil.equations(sign != 0, drive, port, z, dz, self.line(sign)), high, low]

    def breaker_losses(self, breakers: Breakers, port: Port, z: SimpleNamespace) -> list[Product]:
        """Power in the coil's resistance and core and in the diodes of breakers and envelopes."""
        sign = breakers.sign
        drive, coil = self._drive(sign, port, z), self.real_coil(port.capacitance)
        losses = coil.losses(sign != 0, drive, port, z, self.line(sign))
        if sign and np.any(self.drop_of_path):
            current = self.path_current(breakers, port, z)
            losses.append(Product(sign * self.drop_of_path, port.one, current))
        if breakers.charging and np.any(self.diode_drop):
            direction = 1.0 if breakers.envelope == "rise" else -1.0
            losses.append(Product(direction * self.diode_drop * self.envelope_capacitance, port.one, port.dv))
        return losses

    def control(self, port: Port) -> list[Product]:
        return [Product(self.consumption, port.one, port.one)] if np.any(self.consumption) else []

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        breakers = breakers_of(configuration)
        return [*self._switching(breakers, port, z), *self.following(breakers, port, z)]

    def _switching(self, breakers: Breakers, port: Port, z: SimpleNamespace) -> list[Guard]:
        """A breaker closes where the voltage has left the envelope, and opens where its current ends."""
        if breakers.sign:
            after = breakers._replace(position=f"spent_{breakers.position}")
            current = self.path_current(breakers, port, z)
            ended = self.real_coil(port.capacitance).ended
            return [Guard(-breakers.sign * current, after.name, ended, event="switch opens")]
        if breakers.position != "open":
            sign = 1 if breakers.position == "spent_high" else -1
            fallen = self.diode_drop * port.one - sign * port.v
            return [Guard(fallen, breakers._replace(position="open").name, event="")]
        found: list[Guard] = []
        for which, position, follows, sign in (("h", "high", "rise", 1), ("l", "low", "fall", -1)):
            if which in breakers.charged and breakers.envelope != follows:
                fallen = getattr(z, f"envelope_{position}") - sign * port.v - self.threshold * port.one
                after = breakers._replace(position=position, charged=breakers.discharge(which))
                found.append(Guard(fallen, after.name, f"envelope_{position}", event="switch closes"))
        return found

    def _drive(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        """Voltage across the coil with what resists in line."""
        return sign * self.path_excess(sign, port, z)

    def following(self, breakers: Breakers, port: Port, z: SimpleNamespace) -> list[Guard]:
        """Envelope capacitors begin to follow the voltage, and cease to where it turns."""
        if breakers.charging:
            turns = -port.dv if breakers.envelope == "rise" else port.dv
            return [Guard(turns, breakers._replace(envelope="idle").name, conducts=False)]
        found: list[Guard] = []
        for which, position, follows, sign in (("h", "high", "rise", 1), ("l", "low", "fall", -1)):
            after = breakers._replace(envelope=follows, charged=breakers.charge(which))
            if after.exists:
                excess = sign * port.v - getattr(z, f"envelope_{position}") - self.diode_drop * port.one
                found.append(Guard(excess, after.name, conducts=True))
        return found
