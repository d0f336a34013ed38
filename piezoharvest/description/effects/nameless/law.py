"""A law without a name at a place, as an effect like any other: engine, predictions, SPICE and linear view take it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from piezoharvest.description.circuit import Product, Row
from piezoharvest.description.effects.base import Effect
from piezoharvest.description.effects.nameless.forms import Form, Line
from piezoharvest.description.effects.nameless.memory import CHARGE, Delay, LaggingFunction, Memory, Play
from piezoharvest.description.effects.nameless.places import Place, Reading
from piezoharvest.description.effects.nameless.sizes import SIZES
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.protocol import EnergyRows, EquationBuilder
from piezoharvest.description.shunts.base import Shunt


@dataclass(frozen=True, kw_only=True)
class Remembered(Form):
    """A function of an input with a memory."""

    form: Form
    memory: Memory
    of: str

    def row(self, specimen: EquationBuilder, x: Row) -> Row:
        return self.memory.law(specimen, x, self.of, self.form.row)


@dataclass(frozen=True, kw_only=True)
class Law(Effect):
    """A function of one input that is added at a place; none of the library, as its name is that of the object.

    With a memory it is a function of what that makes of the input, or follows late itself.
    """

    delay_path: ClassVar[tuple[str, ...]] = ("memory", "delay")

    place: Place
    form: Form
    memory: Memory | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.memory, Play) and self.place.port == CHARGE and not isinstance(self.form, Line):
            found = f"found {self.form.word} with a play of the {self.place.name}"
            raise ParameterError("form", f"{found}, must be linear: only its charge is known then")
        if isinstance(self.memory, Play) and self.memory.follows and not self.place.of_sensor:
            raise ParameterError("memory.follows", f"found true at the {self.place.name}, allowed in a reading only")
        if isinstance(self.memory, LaggingFunction) and not (self.place.port or self.place.of_sensor):
            found = f"found a function that lags at the {self.place.name}"
            raise ParameterError("memory", f"{found}, allowed at ports, where power is known, and in readings")
        self.place.check(self.form, self.memory)

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The place, and its memory or the form of the function, or both: "load knee", "spring play"."""
        if self.memory is None:
            return f"{self.place.name} {self.form.word}"
        kind = self.memory.kind.replace("_", " ")
        return f"{self.place.name} {kind}" + (f" {self.form.word}" if self.bends_memory else "")

    @property
    def bends_memory(self) -> bool:
        """True if it is no straight line of what its memory makes of the input."""
        return self.memory is not None and not isinstance(self.form, Line)

    @property
    def bent(self) -> bool:
        """True if the linear part of the function is that of a parameter of the model."""
        return self.place.bent and self.memory is None

    @property
    def of_specimen(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """False for what a sensor shows."""
        return not self.place.of_sensor

    @property
    def of_drive(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """True if the input is a size of the record, or when it was made."""
        return self.place.input in (*SIZES, "campaign_time")

    @property
    def absent(self) -> bool:
        """True if the function is zero everywhere."""
        return not np.any(self.memory.delay) if isinstance(self.memory, Delay) else self.form.absent

    @property
    def passive_sign(self) -> int:
        """Sign of the factor of a memory at a port that takes energy and gives none; 0 where any is allowed."""
        return self.memory.sign_at(self.place.port) if self.memory is not None else 0

    def act(self, specimen: EquationBuilder) -> None:
        if isinstance(self.memory, Delay) or not (self.of_specimen or specimen.reads):
            return
        form = self.form if specimen.reads else self.place.simulated(self.form)
        if isinstance(self.memory, Play) and self.place.port == CHARGE:
            assert isinstance(form, Line)
            specimen.charge(self.memory.charge(specimen, form.factor))
            return
        if self.memory is not None:
            form = Remembered(form=form, memory=self.memory, of=self.place.input)
        self.place.add(specimen, form)

    def connect(self, shunt: Shunt) -> Shunt:
        return shunt if self.absent else self.place.connect(shunt, self.form, self.memory)

    @property
    def changes_circuit(self) -> bool:
        """True at a place in the circuit."""
        return self.place.in_circuit

    def stores(self, terms: EnergyRows) -> Sequence[Product]:
        return self.place.stores(terms, self.form, self.memory)

    def losses(self, terms: EnergyRows) -> Sequence[Product]:
        return self.place.losses(terms, self.form, self.memory)

    def late(self, channel: str) -> float:
        mine = isinstance(self.place, Reading) and self.place.channel == channel
        return self.memory.delay if mine and isinstance(self.memory, Delay) else 0.0

    def delays(self, channel: str) -> bool:
        return isinstance(self.memory, Delay) and isinstance(self.place, Reading) and self.place.channel == channel
