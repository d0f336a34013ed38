"""A law without a name at a place, as an effect like any other: engine, predictions, SPICE and linear view take it."""

from __future__ import annotations

from dataclasses import dataclass

from piezoharvest.description.effects.base import Effect
from piezoharvest.description.effects.nameless.forms import Form
from piezoharvest.description.effects.nameless.places import Place
from piezoharvest.description.protocol import EquationBuilder


@dataclass(frozen=True, kw_only=True)
class Law(Effect):
    """A function of one input that is added at a place; none of the library, as its name is that of the object."""

    place: Place
    form: Form

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The place, and the form of the function: "load knee"."""
        return f"{self.place.name} {self.form.word}"

    @property
    def of_specimen(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """False for what a sensor shows."""
        return not self.place.name.startswith("reading.")

    @property
    def absent(self) -> bool:
        """True if the function is zero everywhere."""
        return self.form.absent

    def act(self, specimen: EquationBuilder) -> None:
        self.place.add(specimen, self.form)
