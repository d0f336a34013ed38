"""Fields of components as sliders: their ranges, and the sliders themselves."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from piezoharvest.description.parameters import Component
from piezoharvest.description.paths import found_at
from piezoharvest.study.building import unit_of

if TYPE_CHECKING:
    from bokeh.models import Slider

DECADES = 2.0  # of a slider to either side of a size, as a load or an inductance
STEPS = 400  # of a slider
DIGITS = 4  # of a value on the page, and in a saved study
_INSIDE = 1.001  # of a bound that is not allowed itself


class Knob(NamedTuple):
    """A number that can be moved.

    Attributes
    ----------
    path : str
        Dotted path of the field, such as "shunt.load_resistance".
    unit : str
        SI unit.
    value, low, high : float
        In this unit.
    logarithmic : bool
        True for sizes, which are above zero.
    """

    path: str
    unit: str
    value: float
    low: float
    high: float
    logarithmic: bool = False

    @property
    def label(self) -> str:
        """Name for people."""
        return self.path.partition(".")[2].replace("_", " ").replace(".", ", ")

    def to_slider(self, value: float) -> float:
        """Position of the slider at a value."""
        return math.log10(value) if self.logarithmic else value

    def from_slider(self, position: float) -> float:
        """Value at a position of the slider, with the digits that the page shows."""
        value = float(f"{10.0**position if self.logarithmic else position:.{DIGITS}g}")
        return min(max(value, self.low), self.high)

    def slider(self, title: str = "") -> Slider:
        """Slider of the page, with its label as the title where there is no other."""
        from bokeh.models import Slider

        from piezoharvest.explore.widgets import number_formatter

        low, high = self.to_slider(self.low), self.to_slider(self.high)
        shown = number_formatter(self.unit, logarithm=self.logarithmic)
        return Slider(
            title=title or self.label, start=low, end=high, value=self.to_slider(self.value), step=(high - low) / STEPS,
            format=shown, sizing_mode="stretch_width", name=self.path,
        )  # fmt: skip


def size(component: Component, name: str, path: str, decades: float = DECADES) -> Knob | None:
    """Knob of a field that is a size, over some decades to either side and within its bounds; None if it has none."""
    try:
        value, field = found_at(component, name)
    except KeyError:
        return None
    if not 0 < value < math.inf:
        return None
    least = max(value * 10.0**-decades, field.metadata["at_least"] or 0.0, _INSIDE * (field.metadata["above"] or 0.0))
    most = min(bound for bound in (value * 10.0**decades, field.metadata["at_most"],
                                   (field.metadata["below"] or math.inf) / _INSIDE) if bound is not None)  # fmt: skip
    return Knob(path, unit_of(type(component), field), value, min(least, value), max(most, value), logarithmic=True)


def around(component: Component, name: str, path: str, width: float, *, relative: bool = False) -> Knob | None:
    """Knob of a field that is no size, as an angle or a frequency, by a width to either side; None if it has none."""
    try:
        value, field = found_at(component, name)
    except KeyError:
        return None
    width = width * abs(value) if relative else width
    return Knob(path, unit_of(type(component), field), value, value - width, value + width) if width else None
