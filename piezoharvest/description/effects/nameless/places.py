"""Places of the model at which a law without a name may act: its input, and what it adds there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Product, Row
from piezoharvest.description.effects.nameless.forms import Form, Line
from piezoharvest.description.effects.nameless.memory import CHARGE, DIRECT, RATE, Memory
from piezoharvest.description.effects.nameless.numbers import Numbers
from piezoharvest.description.effects.nameless.sizes import SIZES, RecordSizes
from piezoharvest.description.parameters import Component, altered, check_choice
from piezoharvest.description.protocol import EnergyRows, EquationBuilder, SpecimenRows
from piezoharvest.description.shunts.base import Shunt

UNITS = {
    "force": "N", "base_acceleration": "m/s^2", "displacement": "m", "velocity": "m/s", "acceleration": "m/s^2",
    "voltage": "V", "current": "A", "dc_voltage": "V", "dc_current": "A", "time": "s", "amplitude": "",
    "frequency": "Hz", "displacement_amplitude": "m", "campaign_time": "s", "diode_current": "A", "loop_current": "A",
}  # fmt: skip
CHANNELS = (
    "force", "base_acceleration", "displacement", "velocity", "acceleration", "voltage", "current", "dc_voltage",
    "dc_current",
)  # fmt: skip
LEAST_LEFT = 1e-7  # of a load's current that does not lag in a simulation: rounding of it is 1e-9 then
INPUTS = (*CHANNELS, *(f"{channel}_rate" for channel in CHANNELS), "time", "campaign_time")


def input_unit(name: str) -> str:
    """Unit of an input by its name: that of a channel or of its rate, s of time since the record began.

    An amplitude is in the unit of the record's drive.
    """
    return UNITS[name] if name in UNITS else f"{UNITS[name.removesuffix('_rate')]}/s"


def input_row(specimen: EquationBuilder, name: str) -> Row | None:
    """Row of an input; None where the model has none: an imposed voltage has no force, a force no acceleration.

    Nor has a simulation a time in a campaign.
    """
    if name == "campaign_time":
        if specimen.size is None or np.isnan((sizes := RecordSizes(*specimen.size)).begin):
            return None
        return sizes.begin * specimen.one + sizes.length * specimen.time
    rows = {
        "displacement": specimen.x, "velocity": specimen.u, "displacement_rate": specimen.u, "voltage": specimen.v,
        "current": specimen.i, "time": specimen.elapsed, specimen.drive_name: specimen.drive,
        f"{specimen.drive_name}_rate": specimen.drive_rate,
    }  # fmt: skip
    return rows.get(name, specimen.further.get(name))


@dataclass(frozen=True)
class Place(Component):
    """A place of the model.

    Subclasses define `name`, `input` (its name), `unit` of what a law adds, and `add`; ports also `rows`. Where `bent`
    the linear part of a law is that of a parameter of the model: a law that is a straight line is none.
    """

    name: ClassVar[str]
    input: ClassVar[str]
    unit: ClassVar[str]
    bent: ClassVar[bool] = True
    needs_slope: ClassVar[bool] = False
    port: ClassVar[str] = ""  # how power follows from a law here (`memory`); empty where none does
    in_circuit: ClassVar[bool] = False  # a law acts by `connect`
    of_sensor: ClassVar[bool] = False  # a law changes what a sensor shows, not the specimen

    def rows(self, terms: SpecimenRows) -> tuple[Row, Row]:
        """Rows of the input of a port and of its rate."""
        raise NotImplementedError

    @property
    def input_unit(self) -> str:
        """Unit of the input."""
        return input_unit(self.input)

    def add(self, specimen: EquationBuilder, form: Form) -> None:
        """Add a law here to the equations of a specimen."""
        raise NotImplementedError

    def simulated(self, form: Form) -> Form:
        """The function that a simulation takes for one."""
        return form

    def check(self, form: Form, memory: Memory | None) -> None:
        """Raise `ParameterError` unless a law here can be such a function, of what such a memory makes of the input."""

    def connect(self, shunt: Shunt, form: Form, memory: Memory | None) -> Shunt:
        """Return the circuit that a law here makes of one."""
        return shunt

    def stores(self, terms: EnergyRows, form: Form, memory: Memory | None) -> Sequence[Product]:
        """Energy (J) that a law here stores, beside that of elements, of which the engine keeps an account."""
        factor = form.proportional
        if memory is not None:
            return memory.stores(self.port, factor, terms, self.rows(terms)[0]) if self.port else ()
        if self.port not in (RATE, CHARGE) or not np.any(factor):
            return ()
        x, _ = self.rows(terms)
        return [Product(0.5 * factor, x, x)]

    def losses(self, terms: EnergyRows, form: Form, memory: Memory | None) -> Sequence[Product]:
        """Power (W) that it takes, likewise."""
        factor = form.proportional
        if memory is not None:
            return memory.losses(self.port, factor, terms, *self.rows(terms)) if self.port else ()
        if self.port != DIRECT or not np.any(factor):
            return ()
        x, _ = self.rows(terms)
        return [Product(factor, x, x)]


@dataclass(frozen=True)
class Spring(Place):
    """Force (N) beside k x of the first mode."""

    name: ClassVar[str] = "spring"
    input: ClassVar[str] = "displacement"
    unit: ClassVar[str] = "N"
    port: ClassVar[str] = RATE

    def rows(self, terms: SpecimenRows) -> tuple[Row, Row]:
        return terms.x, terms.u

    def add(self, specimen: EquationBuilder, form: Form) -> None:
        specimen.push(-form.row(specimen, specimen.x))


@dataclass(frozen=True)
class Damper(Place):
    """Force (N) beside b x' of the first mode."""

    name: ClassVar[str] = "damper"
    input: ClassVar[str] = "velocity"
    unit: ClassVar[str] = "N"
    port: ClassVar[str] = DIRECT

    def rows(self, terms: SpecimenRows) -> tuple[Row, Row]:
        return terms.u, 0.0 * terms.u

    def add(self, specimen: EquationBuilder, form: Form) -> None:
        specimen.push(-form.row(specimen, specimen.u))


@dataclass(frozen=True)
class Electrodes(Place):
    """Current (A) that leaves the node beside the load."""

    name: ClassVar[str] = "electrodes"
    input: ClassVar[str] = "voltage"
    unit: ClassVar[str] = "A"
    bent: ClassVar[bool] = False  # a straight line is a leakage, which is no parameter of the model
    port: ClassVar[str] = DIRECT

    def rows(self, terms: SpecimenRows) -> tuple[Row, Row]:
        return terms.v, 0.0 * terms.v

    def add(self, specimen: EquationBuilder, form: Form) -> None:
        specimen.draw(form.row(specimen, specimen.v))


@dataclass(frozen=True)
class Load(Place):
    """Current (A) through the load beside that of its label, seen by the sensor of the current."""

    name: ClassVar[str] = "load"
    input: ClassVar[str] = "voltage"
    unit: ClassVar[str] = "A"
    bent: ClassVar[bool] = False
    port: ClassVar[str] = DIRECT

    def rows(self, terms: SpecimenRows) -> tuple[Row, Row]:
        return terms.v, 0.0 * terms.v

    def add(self, specimen: EquationBuilder, form: Form) -> None:
        specimen.conduct(form.row(specimen, specimen.v))


@dataclass(frozen=True)
class LoadCurrent(Place):
    """Current (A) through the load beside that of its label, of which it is a function: a load that follows late.

    The label's is v/R; of functions without a memory that of the voltage is the same.
    """

    name: ClassVar[str] = "load"
    input: ClassVar[str] = "current"
    unit: ClassVar[str] = "A"
    bent: ClassVar[bool] = False

    def rows(self, terms: SpecimenRows) -> tuple[Row, Row]:
        return terms.i, 0.0 * terms.i

    def simulated(self, form: Form) -> Form:
        """The same but for where all of the current lags: a simulation has the label's from what is left of it."""
        if isinstance(form, Line) and np.any(np.abs(1.0 - form.factor) < LEAST_LEFT):
            return altered(form, factor=np.where(np.abs(1.0 - form.factor) < LEAST_LEFT, 1.0 - LEAST_LEFT, form.factor))
        return form

    def add(self, specimen: EquationBuilder, form: Form) -> None:
        specimen.conduct(form.row(specimen, specimen.i))

    def losses(self, terms: EnergyRows, form: Form, memory: Memory | None) -> Sequence[Product]:
        """Power of what is added under the voltage; the input is another current, so that this is no port."""
        if memory is None:
            return ()
        return [Product(self.simulated(form).proportional, terms.v, memory.made(terms, terms.i))]


@dataclass(frozen=True)
class Capacitor(Place):
    """Charge (C) beside C v_t."""

    name: ClassVar[str] = "capacitor"
    input: ClassVar[str] = "voltage"
    unit: ClassVar[str] = "C"
    port: ClassVar[str] = CHARGE

    def rows(self, terms: SpecimenRows) -> tuple[Row, Row]:
        return terms.v_t, 0.0 * terms.v_t

    def add(self, specimen: EquationBuilder, form: Form) -> None:
        specimen.charge(form.row(specimen, specimen.v_t))


@dataclass(frozen=True)
class Coupling(Place):
    """Charge q_t(x) (C) beside T x of the first mode, and the force q_t'(x) v_t that follows from the same energy.

    Source: Maugin, Nonlinear Electromechanical Effects and Applications, 1985 (reciprocity).
    """

    name: ClassVar[str] = "coupling"
    input: ClassVar[str] = "displacement"
    unit: ClassVar[str] = "C"
    needs_slope: ClassVar[bool] = True

    def add(self, specimen: EquationBuilder, form: Form) -> None:
        specimen.charge(form.row(specimen, specimen.x))
        specimen.push(specimen.product(form.slope(specimen, specimen.x), specimen.v_t))


@dataclass(frozen=True)
class Reading(Place):
    """What the sensor of a channel shows beside the true value: a function of it, of another one, a rate, or time.

    Of the channel that drives a record it is a function of what is shown, and the rest acts on the specimen.
    """

    bent: ClassVar[bool] = False  # a straight line is a gain, or crosstalk, of which the model has none
    of_sensor: ClassVar[bool] = True

    channel: str
    of: str

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("channel", self.channel, CHANNELS)
        check_choice("of", self.of, INPUTS)

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """`reading.` and the channel."""
        return f"reading.{self.channel}"

    @property
    def input(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Name of the input."""
        return self.of

    @property
    def unit(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Unit of the channel."""
        return UNITS[self.channel]

    def add(self, specimen: EquationBuilder, form: Form) -> None:
        x = input_row(specimen, self.of)
        if x is not None:
            specimen.read(form.row(specimen, x), self.channel)


@dataclass(frozen=True)
class GainOverTime(Place):
    """Relative change of what the sensor of a channel shows, over the time of a record or of the campaign.

    Of the channel that drives a record it is one of what is shown, as a reading's law is.
    """

    unit: ClassVar[str] = ""
    bent: ClassVar[bool] = False
    of_sensor: ClassVar[bool] = True

    channel: str
    of: str = "time"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("channel", self.channel, CHANNELS)
        check_choice("of", self.of, TIMES)

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """`parameter.`, the channel and `_gain`."""
        return f"parameter.{self.channel}_gain"

    @property
    def input(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Which time."""
        return self.of

    def add(self, specimen: EquationBuilder, form: Form) -> None:
        time, shown = input_row(specimen, self.of), input_row(specimen, self.channel)
        if time is not None and shown is not None:
            specimen.read(specimen.product(form.row(specimen, time), shown), self.channel)


@dataclass(frozen=True)
class OverTime(Place):
    """Relative change of a parameter over the time of a record or of the campaign, or with a size of the record.

    A simulation has no time in a campaign: there a parameter is what it is at its beginning.
    """

    parameter: str
    of: str = "time"
    unit: ClassVar[str] = ""
    bent: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("parameter", self.parameter, PARAMETERS_OVER_TIME)
        check_choice("of", self.of, (*TIMES, *SIZES))

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """`parameter.` and the name."""
        return f"parameter.{self.parameter}"

    @property
    def input(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """What it changes with."""
        return self.of

    def add(self, specimen: EquationBuilder, form: Form) -> None:
        device = specimen.transducer
        changed = self._product(specimen, form)
        if changed is None:
            return
        if self.parameter == "stiffness":
            specimen.push(-device.stiffness * changed(specimen.x))
        elif self.parameter == "damping":
            specimen.push(-device.damping * changed(specimen.u))
        elif self.parameter == "capacitance":
            specimen.charge(device.capacitance * changed(specimen.v_t))
        else:
            specimen.charge(device.coupling * changed(specimen.x))
            specimen.push(device.coupling * changed(specimen.v_t))

    def stores(self, terms: EnergyRows, form: Form, memory: Memory | None) -> Sequence[Product]:
        number, device = self._number(terms.size, form), terms.transducer
        if number is None:
            return ()
        if self.parameter == "stiffness":
            return [Product(0.5 * device.stiffness * number, terms.x, terms.x)]
        return [Product(0.5 * device.capacitance * number, terms.v_t, terms.v_t)] * (self.parameter == "capacitance")

    def losses(self, terms: EnergyRows, form: Form, memory: Memory | None) -> Sequence[Product]:
        number = self._number(terms.size, form)
        if number is None or self.parameter != "damping":
            return ()
        return [Product(terms.transducer.damping * number, terms.u, terms.u)]

    def _product(self, specimen: EquationBuilder, form: Form) -> Callable[[Row], Row] | None:
        """The relative change times a row: in a record one number, but over time; None where that is not known."""
        if self.of in TIMES:
            time = input_row(specimen, self.of)
            if time is None:
                return None
            change = form.row(specimen, time)
            return lambda row: specimen.product(change, row)
        number = self._number(specimen.size, form)
        return None if number is None else lambda row: number * row

    def _number(self, size: Any, form: Form) -> Any:
        """The relative change in a record; None over time, and where the size is not known."""
        if self.of in TIMES or size is None:
            return None
        numbers: Any = Numbers()
        value = np.asarray(getattr(RecordSizes(*size), self.of), float)
        return None if np.any(np.isnan(value)) else form.row(numbers, value)


TIMES = ("time", "campaign_time")
PARAMETERS_OVER_TIME = ("stiffness", "damping", "coupling", "capacitance")
