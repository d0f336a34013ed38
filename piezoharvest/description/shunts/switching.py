"""Switches synchronised with the extrema of the transducer's displacement: base of the switched shunts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, Self, cast

import numpy as np

from piezoharvest.description.circuit import Port, Product, Row, Switch
from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.base import Shunt


@dataclass(frozen=True, kw_only=True)
class SynchronisedShunt(Shunt):
    """A shunt whose switch acts at the extrema of sum T_i x_i, late or early by a lag.

    The delay of a comparator is a `time_lag`. Driving the switch takes `gate_energy` each time it closes or goes on to
    its next stage; comparator and clock take `control_power` continuously. Both are losses, and harvested power is net
    of them: negative if they take more than the circuit delivers.
    """

    phase_lag: float = quantity(
        "rad",
        "angle of the excitation from the extremum to the action; negative is early",
        default=0.0,
        above=-np.pi,
        below=np.pi,
    )
    time_lag: float = quantity(
        "s", "time from the extremum to the action, such as a comparator's delay; negative is early", default=0.0
    )
    hold_off: float | None = quantity("s", "least time between two actions of the switch", default=None, at_least=0)
    detector_threshold: float = quantity(
        "V", "electrode voltage at an extremum below which the switch does not act", default=0.0, at_least=0
    )
    gate_energy: float = quantity("J", "energy that each action of the switch consumes", default=0.0, at_least=0)
    control_power: float = quantity("W", "power that the control consumes continuously", default=0.0, at_least=0)

    def control(self, port: Port) -> list[Product]:
        return [Product(self.control_power, port.one, port.one)] if np.any(self.control_power) else []

    def on_time(self, capacitance: float) -> float:
        """Seconds that the switch stays closed; 0 where it acts at once."""
        return 0.0

    def harvested_share(self) -> float:
        """Share of the extracted energy that is harvested."""
        return 0.0

    def extraction_drop(self) -> float:
        """Voltage in V that diodes take in the path of extracted charge."""
        return 0.0

    def switch(self, capacitance: float, period: float | None) -> Switch:
        """Timing for an excitation of this period (s), or of none."""
        lag: Any = self.time_lag
        if period is None and np.any(np.real(self.phase_lag) != 0):
            raise ParameterError(
                "phase_lag",
                f"found {self.phase_lag} for an excitation without a frequency, which needs time_lag (s) instead",
            )
        if period is not None:
            lag = lag + self.phase_lag * period / (2 * np.pi)
        hold_off = self.hold_off if self.hold_off is not None else (0.25 * period if period is not None else 0.0)
        real: Any = np.real(lag)
        early: Any = real < 0
        if np.any(early):
            if period is None or np.any(real <= -0.5 * period):
                allowed = "early (below 0) only for a periodic excitation, and by less than half its period"
                raise ParameterError("time_lag", f"found {np.min(real):g} s, must be {allowed}")
            # The next extremum is half a period after the last one, of the other kind.
            lag = cast(Any, np.where(early, 0.5 * period + lag, lag))
        return Switch(
            lag, self.on_time(capacitance), hold_off, early, self.harvested_share(), self.extraction_drop(),
            self.detector_threshold, self.gate_energy,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class SwitchedLoop(Shunt):
    """A loop with an inductance that a switch closes."""

    switch_resistance: float | None = quantity(
        "ohm",
        "resistance of the closed switch, in addition to that given by quality; default: none",
        default=None,
        at_least=0,
    )

    def loop(self, capacitance: float) -> tuple[Any, Any]:
        """Inductance (H) and resistance (ohm) of the loop with the clamped capacitance (F)."""
        raise NotImplementedError

    def loop_current(self, closed: bool, port: Port, z: SimpleNamespace) -> Row:
        """Current in the loop: the state `current` while closed, zero while open."""
        return z.current if closed else 0.0 * port.one

    def loop_equation(self, closed: bool, drive: Row, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Row:
        """L di/dt + R i = drive while closed; the current stays zero while open."""
        if not closed:
            return dz.current
        inductance, resistance = self.loop(port.capacitance)
        return inductance * dz.current + resistance * z.current - drive

    def with_switch(self, inductance: Any, resistance: Any, capacitance: Any) -> Any:
        """Resistance (ohm) of the loop: that of the coil and that of the switch.

        Raises
        ------
        ParameterError
            With the resistance of the switch the voltage does not swing.
        """
        if self.switch_resistance is None:
            return resistance
        root: Any = np.sqrt(inductance / capacitance)
        whole: Any = resistance + self.switch_resistance
        if np.any(np.real(root / whole) <= 0.5):
            limit: Any = np.real(2 * root - resistance)
            most = float(np.min(limit))
            allowed = f"must be less than {most:.4g} ohm, with which the voltage swings"
            raise ParameterError("switch_resistance", f"found {self.switch_resistance} ohm, {allowed}")
        return whole


@dataclass(frozen=True, kw_only=True)
class SwitchedCoil(SwitchedLoop):
    """A switched inductance with the losses of its loop.

    Raises
    ------
    ParameterError
        Neither or both of inductance and flip time are given.
    """

    quality: float = quantity("", "quality of the switched loop, Q_i = sqrt(L/C)/R", above=0.5)
    inductance: float | None = quantity("H", "inductance of the switched loop", default=None, above=0)
    flip_time: float | None = quantity(
        "s", "time of an inversion (damped half period), instead of inductance", default=None, above=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.inductance is None) == (self.flip_time is None):
            found = "neither inductance nor" if self.inductance is None else "both inductance and"
            raise ParameterError("inductance", f"found {found} flip_time, give one of the two")
        if self.switch_resistance is not None and self.flip_time is not None:
            raise ParameterError("switch_resistance", "found together with flip_time, but belongs to an inductance")

    def loop(self, capacitance: float) -> tuple[float, float]:
        """Inductance (H) and resistance (ohm) of the loop with the clamped capacitance (F).

        Raises
        ------
        ParameterError
            With the resistance of the switch the voltage does not swing.
        """
        if self.inductance is not None:
            inductance = self.inductance
        else:
            assert self.flip_time is not None  # one of the two is given: __post_init__
            inductance = (self.flip_time / np.pi) ** 2 * (1 - 0.25 / self.quality**2) / capacitance
        resistance = np.sqrt(inductance / capacitance) / self.quality
        return inductance, self.with_switch(inductance, resistance, capacitance)

    def loop_quality(self, capacitance: Any) -> Any:
        """Quality sqrt(L/C)/R of the loop with its switch; raises as `loop`."""
        inductance, resistance = self.loop(capacitance)
        return np.sqrt(inductance / capacitance) / resistance

    def inversion(self, capacitance: float) -> Any:
        """Fraction of the voltage that half a swing leaves, inverted: exp(-pi/(2 Q)), Q that of the closed loop."""
        return np.exp(-np.pi / (2 * self.loop_quality(capacitance)))

    def nominal_flip_time(self, capacitance: float) -> float:
        """Damped half period pi/w_d in s, w_d^2 = 1/(L C) - (R/(2 L))^2."""
        inductance, resistance = self.loop(capacitance)
        return np.pi / np.sqrt(1 / (inductance * capacitance) - (resistance / (2 * inductance)) ** 2)

    def emptying_time(self, capacitance: float) -> Any:
        """Seconds after which the loop alone has taken the voltage to zero: (pi/2 + atan(R/(2 L w_d)))/w_d."""
        return emptying_time(*self.loop(capacitance), capacitance)


@dataclass(frozen=True, kw_only=True)
class InductiveSwitch(SynchronisedShunt, SwitchedCoil):
    """A switched inductance that inverts the electrode voltage at the extrema."""

    on_time_error: float = quantity(
        "", "relative error of the time for which the switch is closed", default=0.0, above=-1
    )

    def swing_time(self, capacitance: float) -> float:
        """Seconds for which the switch lets the voltage swing."""
        return (1 + self.on_time_error) * self.nominal_flip_time(capacitance)

    def on_time(self, capacitance: float) -> float:
        """Seconds that the switch stays closed."""
        return self.swing_time(capacitance)

    def beside(self, capacitance: Any, actual: Any) -> Self:
        """The same loop beside another capacitance (F): coil, resistance and on time stay those for `capacitance`."""
        inductance, _ = self.loop(capacitance)
        quality = self.quality * np.sqrt(capacitance / actual)  # of the same resistance of the coil
        moved = replace(self, inductance=inductance, flip_time=None, quality=quality, on_time_error=0.0)
        return replace(moved, on_time_error=self.swing_time(capacitance) / moved.nominal_flip_time(actual) - 1)


@dataclass(frozen=True, kw_only=True)
class EmptyingSwitch(SynchronisedShunt, SwitchedLoop):
    """A switch that discharges the electrodes at the extrema, instantly or, with an `inductance`, through a coil.

    With a coil it stays closed until the loop alone would have emptied the electrodes, a quarter of a period, longer or
    shorter by `on_time_error`, which has no effect without a coil.

    Raises
    ------
    ParameterError
        An inductance is given without a quality, or a quality, a switch resistance, a core or a winding without an
        inductance.
    """

    inductance: float | None = quantity(
        "H", "inductance of the extraction path; default: none, the charge moves instantly", default=None, above=0
    )
    quality: float | None = quantity(
        "", "quality of the extraction path with the clamped capacitance C, sqrt(L/C)/R", default=None, above=0.5
    )
    on_time_error: float = quantity(
        "", "relative error of the time for which the switch is closed", default=0.0, above=-1
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.inductance is None) != (self.quality is None):
            missing = "quality" if self.quality is None else "inductance"
            raise ParameterError(missing, "missing key, inductance and quality belong together: give both or neither")
        for key in ("switch_resistance", "core_resistance", "self_resonance"):
            if self.at_once and getattr(self, key, None) is not None:
                raise ParameterError(key, "found without an inductance, with which the switch does not act at once")

    @property
    def at_once(self) -> bool:
        """True without a coil."""
        return self.inductance is None

    def loop(self, capacitance: float) -> tuple[Any, Any]:
        """Inductance (H) and resistance (ohm) of the path."""
        assert self.inductance is not None and self.quality is not None  # they are asked for where there is a coil
        resistance = np.sqrt(self.inductance / capacitance) / self.quality
        return self.inductance, self.with_switch(self.inductance, resistance, capacitance)

    def on_time(self, capacitance: float) -> Any:
        """Seconds that the switch stays closed."""
        return 0.0 if self.at_once else (1 + self.on_time_error) * emptying_time(*self.loop(capacitance), capacitance)


def emptying_time(inductance: Any, resistance: Any, capacitance: Any) -> Any:
    """Seconds after which a capacitance has discharged through an inductance and a resistance, the first time."""
    decay = resistance / (2 * inductance)
    damped = np.sqrt(1 / (inductance * capacitance) - decay**2)
    return (0.5 * np.pi + np.arctan(decay / damped)) / damped
