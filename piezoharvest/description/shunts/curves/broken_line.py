"""A table of one quantity over another that rises from zero: linear between its points, and beyond the last one."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.parameters import Component, ParameterError


class BrokenLine(Component):
    """Values over places, under the names that a subclass gives to these two fields.

    Raises
    ------
    ParameterError
        There are fewer than two points, the places do not increase from 0 on, or the values are not as many.
    """

    over: ClassVar[str]  # name of the field with the places of the points
    of: ClassVar[str]  # name of the field with the values there

    def __post_init__(self) -> None:
        super().__post_init__()
        places = [nominal(each) for each in self.places]
        if len(places) < 2 or places[0] != 0 or np.any(np.diff(places) <= 0):
            allowed = "must be at least two numbers that increase from 0 on"
            raise ParameterError(self.over, f"found {places}, {allowed}")
        if len(self.values) != len(places):
            allowed = f"must be as many as {self.over} ({len(places)})"
            raise ParameterError(self.of, f"found {counted(len(self.values), 'number')}, {allowed}")

    @classmethod
    def stepped(cls, places: tuple[Any, ...], values: tuple[Any, ...]) -> Self:
        """A curve whose numbers may have complex steps, one for each design of a batch; they are not checked."""
        curve = cls.__new__(cls)
        curve.__dict__.update({cls.over: places, cls.of: values})
        return curve

    @property
    def places(self) -> tuple[Any, ...]:
        """Places of the points."""
        return getattr(self, self.over)

    @property
    def values(self) -> tuple[Any, ...]:
        """Values at the points."""
        return getattr(self, self.of)

    @property
    def rises(self) -> np.ndarray:
        """Rise of the value in each piece, without complex steps."""
        return np.diff([nominal(each) for each in self.values])

    @property
    def pieces(self) -> int:
        """Number of straight pieces."""
        return len(self.places) - 1

    def piece(self, k: int) -> tuple[Any, Any]:
        """Value at zero and slope of the line that goes through the k-th piece."""
        (x, y), (v, w) = self.places[k : k + 2], self.values[k : k + 2]
        slope = (w - v) / (y - x)
        return v - slope * x, slope

    def plus(self, other: Self) -> Self:
        """The sum of both: with the corners of both, one of two at the same place."""
        places = {nominal(each): each for each in (*self.places, *other.places)}
        corners = tuple(places[key] for key in sorted(places))
        return self.stepped(corners, tuple(self.at(each) + other.at(each) for each in corners))

    def at(self, place: Any) -> Any:
        """Value at one place."""
        k = sum(nominal(place) >= nominal(each) for each in self.places[1:-1])
        value, slope = self.piece(k)
        return value + slope * place


def nominal(value: Any) -> float:
    """A number without its complex steps."""
    return float(np.ravel(np.asarray(value, complex))[0].real)
