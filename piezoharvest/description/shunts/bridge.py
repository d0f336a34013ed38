"""Diodes with a smoothing capacitor or a constant voltage behind them: base of rectifying shunts."""

from __future__ import annotations

import copy
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar, Self

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.parameters import ParameterError, check_kind, described, quantity
from piezoharvest.description.shunts.base import Shunt, too_low
from piezoharvest.description.shunts.curves.load_curve import LoadCurve
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve
from piezoharvest.description.shunts.storage import Storage

MOST_VOLTS = 1e6  # of a capacitor at the beginning: beyond it the engine finds no end of a first conduction


@dataclass(frozen=True, kw_only=True)
class Bridge(Shunt):
    """Diodes in front of a smoothing capacitor with a load, or of a constant voltage. By default a full bridge.

    A conducting diode drops `diode_drop` plus `diode_resistance` times its current; a blocking one leaks as the
    conductance `diode_leakage`. In a full bridge the dc side lies, by symmetry, halfway between the electrodes, so the
    leakage of all four diodes is one such conductance across the electrodes and one across the dc side, to which
    `dc_leakage` adds. Beyond a few n k T/q a blocking diode also passes its saturation current `diode_saturation`
    backwards. Of a path's two ends one blocks always: what the diodes on both sides take of the leads cancels, and the
    dc side loses one such current for each diode of a path. Below `saturation_voltage` it is in proportion to the
    dc voltage (`piezoharvest.description.shunts.saturation`). The power that maintains a constant dc voltage against
    all this is not counted, except that of a battery.

    Circuits with other diodes change `diodes`, the number in a path, and `level`, the voltage at which they stop. The
    name of a conducting configuration ends in the sign of the electrode voltage, as in "open+".

    A smoothing capacitor may have a series resistance (ESR), `smoothing_resistance`; its leakage is `dc_leakage`. The
    dc voltage is then that of the capacitor without this resistance, whose mean over a period is the same. A supply
    sees the voltage outside, which is lower by the resistance times the current drawn.

    A smoothing capacitor may start at `initial_dc_voltage`. With a table `storage`, it feeds a supply in addition to or
    instead of the load resistance (`piezoharvest.description.shunts.stored`). With a table `load_curve`, what is in
    parallel with the load resistance takes a current that is a broken line over the voltage of the load; its power is
    harvested, too.

    Raises
    ------
    ParameterError
        Neither a smoothing capacitance with a load nor a dc voltage is given, or both; the initial voltage is above
        that at which the storage is protected; or a smoothing resistance or a load curve is given where it has no part.
    """

    diodes: ClassVar[int] = 2
    supplied: ClassVar[tuple[Any, Any]] = (0.0, 0.0)  # A and S, of what else is at the dc side (`supplying`)
    low: ClassVar[bool] = False  # the dc voltage is below `saturation_voltage`
    capacitors: ClassVar[int] = 1  # in series across the dc side
    whole_side: ClassVar[bool] = False  # the circuit is the whole dc side, without load or capacitor
    gain: ClassVar[float] = 1.0  # dc voltage over that of a full bridge at the same voltage of the electrodes

    smoothing_capacitance: float | None = quantity("F", "smoothing capacitance", default=None, above=0)
    load_resistance: float | None = quantity("ohm", "load resistance behind the bridge", default=None, above=0)
    dc_voltage: float | None = quantity(
        "V", "constant dc voltage instead of a capacitor and load", default=None, at_least=0
    )
    diode_drop: float = quantity("V", "forward drop of one diode", default=0.0, at_least=0)
    diode_resistance: float = quantity(
        "ohm", "series resistance of one diode", default=0.0, at_least=0, other_law_at_zero=True
    )
    diode_leakage: float = quantity("S", "reverse conductance of one diode", default=0.0, at_least=0)
    diode_saturation: float = quantity("A", "saturation current of one diode, backwards", default=0.0, at_least=0)
    saturation_voltage: float = quantity(
        "V", "dc voltage, a few n k T/q, from which on blocking diodes pass all of it", default=0.1, above=0
    )
    dc_leakage: float = quantity(
        "S", "conductance across the dc side, in parallel with the load", default=0.0, at_least=0
    )
    smoothing_resistance: float = quantity(
        "ohm", "series resistance of the smoothing capacitor", default=0.0, at_least=0, other_law_at_zero=True
    )
    initial_dc_voltage: float | None = quantity(
        "V", "dc voltage at the start of a transient; default: 0", default=None, at_least=0, at_most=MOST_VOLTS
    )
    storage: Storage | None = None
    diode_curve: VoltageCurve | None = described(
        "forward voltage of one diode over its current, beside diode_drop and diode_resistance", default=None
    )
    load_curve: LoadCurve | None = described(
        "current of the load over its voltage, beside that through load_resistance", default=None
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_dc_side()
        if self.diode_curve is not None:
            check_kind("diode_curve", self.diode_curve, VoltageCurve)
            self._check_curve(self.diode_curve)
        if self.load_curve is not None:
            check_kind("load_curve", self.load_curve, LoadCurve)
            self._check_load_curve(self.load_curve)
        limit: Any = np.inf if self.storage is None else np.real(self.storage.limit)
        begins: Any = 0.0 if self.initial_dc_voltage is None else np.real(self.initial_dc_voltage)
        if np.any(begins > limit):
            found = f"found {np.max(begins):g} V"
            allowed = f"must be at most storage.max_voltage ({np.min(limit):g} V)"
            raise ParameterError("initial_dc_voltage", f"{found}, {allowed}")

        if np.any(np.real(self.smoothing_resistance)):
            self._check_smoothing_resistance()

    def _check_curve(self, curve: VoltageCurve) -> None:
        if self.storage is not None:
            raise ParameterError("diode_curve", "found together with storage, which goes with straight diodes only")
        if np.any(curve.rises <= 0):
            found = f"found {list(curve.voltages)}, must increase (what does not is part of diode_drop)"
            raise ParameterError("diode_curve.voltages", found)

    def _check_load_curve(self, curve: LoadCurve) -> None:
        if self.load_resistance is None or self.storage is not None:
            beside = "storage, whose supply is the load" if self.storage is not None else "dc_voltage"
            raise ParameterError("load_curve", f"found together with {beside}; it belongs to a load_resistance")
        conductances = [np.real(curve.piece(k)[1] + self._all_conductance) for k in range(curve.pieces)]
        if np.any(1.0 + np.real(self.dc_resistance) * np.min(conductances) <= 0.0):
            allowed = "must not fall by more than the smoothing_resistance lets settle"
            raise ParameterError("load_curve.currents", f"found {list(curve.currents)}, {allowed}")

    def _check_smoothing_resistance(self) -> None:
        why = None
        if self.smoothing_capacitance is None:
            why = "but belongs to a smoothing_capacitance"
        elif self.storage is not None:
            most: Any = np.real(self.storage.most_resistance)
            if np.any(np.real(self.smoothing_resistance) >= most):
                why = f"must be less than {np.min(most):.4g} ohm, with which the supply stays on"
        if why:
            raise ParameterError("smoothing_resistance", f"found {np.max(self.smoothing_resistance):g} ohm, {why}")

    def _check_dc_side(self) -> None:
        keys = ["smoothing_capacitance", "load_resistance", "dc_voltage"]
        given = [key for key in keys if getattr(self, key) is not None]
        if given == ["dc_voltage"]:
            for unused in ("storage", "initial_dc_voltage"):
                if getattr(self, unused) is not None:
                    raise ParameterError(
                        unused, "found together with dc_voltage, but belongs to a smoothing_capacitance"
                    )
        elif given != keys[:2] and not (self.storage is not None and given == keys[:1]):
            raise ParameterError(
                given[-1] if given else "smoothing_capacitance",
                f"found {' and '.join(given) or 'no dc side'}, "
                "give smoothing_capacitance with load_resistance or a table storage, or dc_voltage alone",
            )

    def remark(self, events: Collection[str], dc_voltage: float) -> str:
        # With a mean below turn_off a supply that was on has turned off, and turns on again where the motion repeats.
        off = self.storage is not None and "supply turns on" not in events and dc_voltage < self.storage.turn_off
        if not (off and self.storage and self.load_resistance is not None):
            return ""
        found = f"the supply is not on, whose turn_on is {self.storage.turn_on:g} V"
        return f"{found}: the dc voltage is {dc_voltage:.4g} V, and all that is harvested is that of load_resistance"

    def why_nothing(self, events: Collection[str], voltage: float) -> str:
        if self.dc_voltage == 0:
            return "nothing is harvested: dc_voltage is 0 V, to which no power is delivered"
        if self.storage is not None and self.storage.power and "supply turns on" not in events:
            return f"nothing is harvested: the supply is not on, whose turn_on is {self.storage.turn_on:g} V"
        if "diodes conduct" not in events:
            against = [] if self.dc_voltage is None else [f"dc_voltage = {self.dc_voltage:g} V"]
            against += ["the drops of the diodes"] if self.path_drop or self.diode_curve is not None else []
            return too_low(voltage, f"{' and '.join(against)}, so that no diode conducts") if against else ""
        return ""

    def bridge_states(self) -> tuple[State, ...]:
        """The smoothing capacitor's voltage, if there is one."""
        if self.smoothing_capacitance is None:
            return ()
        begins = 0.0 if self.initial_dc_voltage is None else self.initial_dc_voltage
        return (State("dc", self.dc_capacitance, odd=False, initial=begins),)

    def possible_states(self, voltage: Any) -> Mapping[str, tuple[Any, Any]]:
        """Of the smoothing capacitor: below zero, as noise may put it, ideal diodes would conduct both ways."""
        if self.smoothing_capacitance is None:
            return {}
        return {"dc": (0.0, np.inf if self.storage is None else self.storage.limit)}

    @property
    def dc_capacitance(self) -> Any:
        """Capacitance across the whole dc side, F."""
        return self.smoothing_capacitance

    def dc_side(self, port: Port, z: SimpleNamespace) -> Row:
        """Voltage behind the bridge."""
        return z.dc if self.dc_voltage is None else self.dc_voltage * port.one

    def level(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        """Voltage that `sign` times that of the electrodes has to exceed by the drops for diodes to conduct."""
        return self.terminal(0.0 * port.one, port, z)

    def level_rate(self, sign: int, port: Port, dz: SimpleNamespace) -> Row:
        """Rate of that voltage."""
        return dz.dc if self.dc_voltage is None else 0.0 * port.one

    def dc_equations(self, rectified: Row, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> list[Row]:
        """Current balance of the smoothing capacitor, charged by the `rectified` current."""
        if self.smoothing_capacitance is None:
            return []
        return [self.dc_capacitance * dz.dc - self.charging(rectified, port, z)]

    def charging(self, rectified: Row, port: Port, z: SimpleNamespace) -> Row:
        """Current into the smoothing capacitor."""
        return self.divided(rectified - self._drawn * port.one - self._all_conductance * z.dc)

    def supplying(self, current: Any, conductance: Any) -> Self:
        """The circuit where something takes a current (A) and a conductance (S) times the voltage of the dc side."""
        found = copy.copy(self)
        object.__setattr__(found, "supplied", (current, conductance))
        return found

    @property
    def saturated(self) -> tuple[Any, Any]:
        """Current (A) and conductance (S) with which saturated diodes discharge the dc side."""
        current = self.diodes * self.diode_saturation if self.discharged else 0.0
        return (0.0, current / self.saturation_voltage) if self.low else (current, 0.0)

    @property
    def _drawn(self) -> Any:
        """Constant part of the current that leaves the dc side, A."""
        return self.saturated[0] + self.supplied[0]

    @property
    def _all_conductance(self) -> Any:
        """What discharges the smoothing capacitor, with the load, S."""
        load = 0.0 if self.load_resistance is None else 1.0 / self.load_resistance
        return self.dc_conductance + load + self.saturated[1] + self.supplied[1]

    def divided(self, what: Any) -> Any:
        """What is left of a voltage or a current behind the series resistance of the smoothing capacitor."""
        if not np.any(self.smoothing_resistance):
            return what
        return what / (1.0 + self.dc_resistance * self._all_conductance)

    def terminal(self, rectified: Row, port: Port, z: SimpleNamespace) -> Row:
        """Voltage across the load: that of the smoothing capacitor with what its series resistance adds."""
        if not np.any(self.smoothing_resistance):
            return self.dc_side(port, z)
        return self.divided(self.dc_side(port, z) + self.dc_resistance * (rectified - self._drawn * port.one))

    @property
    def dc_resistance(self) -> Any:
        """Resistance in series with the capacitance across the whole dc side, ohm."""
        return self.smoothing_resistance

    def resistance(self, sign: int) -> Any:
        """Resistance between the leads and what `level` is of while diodes of this sign conduct, ohm."""
        return self.path_resistance + self.divided(self.dc_resistance)

    @property
    def dc_conductance(self) -> Any:
        """What discharges the dc side beside the load and saturated diodes, S."""
        return self.diode_leakage + self.dc_leakage if self.discharged else 0.0

    @property
    def discharged(self) -> bool:
        """Whether what the dc side loses is taken from its power; else it is held at its voltage against that."""
        return self.dc_voltage is None

    def leak(self, port: Port, z: SimpleNamespace) -> Row:
        """Current that passes the diodes backwards at the leads."""
        return self.diode_leakage * port.v

    def forward(self, port: Port, z: SimpleNamespace) -> Row:
        """Current into diodes across the leads, less what passes them backwards."""
        return port.i - self.leak(port, z)

    @property
    def tuned_side(self) -> str | None:
        """Name of the key of the dc side that a design tunes."""
        return next((key for key in ("load_resistance", "dc_voltage") if getattr(self, key) is not None), None)

    def inversion(self, capacitance: float) -> Any:
        """Share of the electrode voltage that is inverted at an extremum; -1 where it is kept."""
        return -1.0

    @property
    def path_drop(self) -> Any:
        """Forward voltage of all diodes of a path at no current, V."""
        return self.diodes * self.diode_drop

    @property
    def path_resistance(self) -> Any:
        """Series resistance of a path, ohm."""
        return self.diodes * self.diode_resistance

    def conduction(self, sign: int, rectified: Row, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Row:
        """Port's equation while diodes conduct: the excess of the voltage drops at their resistance.

        Without one it is the derivative of the excess, which the guard has left at zero.
        """
        held = port.dv - sign * self.level_rate(sign, port, dz)
        resistance = self.resistance(sign)
        resistive = np.real(resistance) > 0
        if not np.any(resistive):
            return held
        return np.where(resistive, self.excess(sign, port, z) - resistance * rectified, held)

    def excess(self, sign: int, port: Port, z: SimpleNamespace) -> Row:
        """Electrode voltage in excess of the threshold at which the diodes of one sign conduct."""
        return sign * port.v - self.level(sign, port, z) - self.path_drop * port.one

    def bridge_powers(self, rectified: Row, port: Port, z: SimpleNamespace) -> dict[str, list[Product]]:
        """Power into the load and into what lies behind the diodes and in them, from the `rectified` current."""
        dc = self.terminal(rectified, port, z)
        taken = self.dc_loss(dc, port)
        lost = [*self.path_loss(rectified, port), *taken, *self.capacitor_loss(rectified, port, z)]
        if self.load_resistance is not None:
            harvested = [Product(1.0 / self.load_resistance, dc, dc)]
        elif self.storage is not None:
            harvested = []
        else:
            harvested = [Product(1.0, dc, rectified), *(Product(-p.coefficient, p.first, p.second) for p in taken)]
        return {"harvested": harvested, "shunt_loss": lost}

    def capacitor_loss(self, rectified: Row, port: Port, z: SimpleNamespace) -> list[Product]:
        """Power in the series resistance of the smoothing capacitor."""
        if not np.any(self.smoothing_resistance):
            return []
        charging = self.charging(rectified, port, z)
        return [Product(self.dc_resistance, charging, charging)]

    def dc_loss(self, dc: Row, port: Port) -> list[Product]:
        """Power of what discharges the dc side beside the load, at the voltage `dc` of that."""
        current, conductance = self.saturated
        conductance = conductance + self.dc_conductance
        lost = [Product(conductance, dc, dc)] if np.any(conductance) else []
        return [*lost, Product(current, dc, port.one)] if np.any(current) else lost

    def path_loss(self, rectified: Row, port: Port) -> list[Product]:
        """Power in the conducting diodes."""
        lost = [Product(self.path_drop, port.one, rectified)]
        if np.any(self.path_resistance):
            lost.append(Product(self.path_resistance, rectified, rectified))
        return lost

    def leads_loss(self, port: Port, z: SimpleNamespace) -> list[Product]:
        """Power of what passes the diodes backwards between the leads."""
        return [Product(self.diode_leakage, port.v, port.v)] if np.any(self.diode_leakage) else []


def charging_current(shunt: Bridge, configuration: str, port: Port, z: SimpleNamespace) -> Row:
    """Current into the smoothing capacitor in a configuration: what arrives, less what leaves its side."""
    at_rest = SimpleNamespace(**{name: 0.0 * port.one for name in vars(z)})
    return -shunt.equations(configuration, port, z, at_rest)[balance_of_capacitor(shunt, port)]


def balance_of_capacitor(shunt: Bridge, port: Port) -> int:
    """Place of the capacitor's balance of currents among the equations: behind the port's, in the order of states."""
    return 1 + [state.name for state in shunt.states(port.capacitance)].index("dc")


def sign_of(configuration: str) -> int:
    """+1 or -1 for a conducting configuration, 0 for a blocking one."""
    return {"+": 1, "-": -1}.get(configuration[-1], 0)


def diode_guards(
    shunt: Bridge, configuration: str, rectified: Row, port: Port, z: SimpleNamespace, cut: str | None = None
) -> list[Guard]:
    """Guards: conduction starts where the voltage exceeds the dc side's, and stops where the rectified current ends.

    Behind a resistance the current is told by the voltage across that: as the difference of what flows beside it, large
    currents next to a winding, its rounding would let diodes block that have just begun to conduct.
    """
    sign = sign_of(configuration)
    if sign:
        resistance = shunt.resistance(sign)
        resistive = np.real(resistance) > 0
        if np.any(resistive):
            by_voltage = shunt.excess(sign, port, z) / np.where(resistive, resistance, 1.0)
            rectified = np.where(resistive, by_voltage, rectified)
        return [Guard(-rectified, configuration[:-1], cut)]
    return [Guard(shunt.excess(s, port, z), configuration + mark) for s, mark in ((1, "+"), (-1, "-"))]
