"""Parts in line with a coil that lag behind its current: resistances beside an inductance or a capacitance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from piezoharvest.description.circuit import Product, Row, State
from piezoharvest.description.parameters import Component, ParameterError, described, quantity

Beside = Literal["inductance", "capacitance"]


class Section(NamedTuple):
    """A resistance R with an inductance R tau or a capacitance tau/R in parallel, in line with a current i.

    Its state y has the unit of a current, tau y' + y = i. It is that of the inductance, whose voltage is R (i - y), or
    the voltage of the capacitance over R, which is R y. Both store R tau y^2/2.
    """

    name: str
    resistance: Any
    time_constant: Any
    beside: Beside

    def state(self, odd: bool, inductance: Any) -> State:
        """Its state, of the size that the current of an inductance (H) in line has."""
        return State(self.name, self.resistance * self.time_constant, odd, like=inductance, only_closed=True)

    def equation(self, i: Row, y: Row, dy: Row) -> Row:
        """What is zero for its state."""
        return self.time_constant * dy + y - i

    def voltage(self, i: Row, y: Row) -> Row:
        """Voltage across it, V."""
        return self.resistance * self._resistive(i, y, self.beside == "inductance")

    def loss(self, i: Row, y: Row) -> Product:
        """Power in its resistance."""
        through = self._resistive(i, y, self.beside == "inductance")
        return Product(self.resistance, through, through)

    @staticmethod
    def _resistive(i: Row, y: Row, inductive: bool) -> Row:
        """Current through its resistance, A."""
        return i - y if inductive else y


@dataclass(frozen=True, kw_only=True)
class LoopSections(Component):
    """Sections in line with the coil of a switched loop, each a resistance beside an inductance or a capacitance.

    Beside an inductance R tau, a resistance R is felt by what is faster than tau only, as eddy currents in the core and
    in the winding are. Beside a capacitance tau/R it is felt by what is slower. A sum of such sections is Foster's form
    of any passive impedance of resistances with inductances, or with capacitances.

    Source: Foster, Bell Syst. Tech. J. 3, 259-267, 1924.

    Raises
    ------
    ParameterError
        There is no section, or there are not as many of one key as of the others.
    """

    resistances: tuple[float, ...] = quantity("ohm", "resistance of each section", at_least=0)
    time_constants: tuple[float, ...] = quantity("s", "time constant of each section", above=0)
    beside: tuple[Beside, ...] = described('what is beside each resistance: "inductance" or "capacitance"')

    def __post_init__(self) -> None:
        super().__post_init__()
        count = len(self.resistances)
        if not count:
            raise ParameterError("resistances", "found none, give at least one")
        for key in ("time_constants", "beside"):
            if len(getattr(self, key)) != count:
                found = f"found {len(getattr(self, key))}"
                raise ParameterError(key, f"{found}, must be as many as resistances ({count})")
        for n, each in enumerate(self.beside):
            if each not in ("inductance", "capacitance"):
                raise ParameterError(f"beside.{n}", f"found {each!r}, allowed are 'inductance' and 'capacitance'")

    @classmethod
    def stepped(cls, resistance: Any, time_constant: Any, beside: Beside) -> LoopSections:
        """One section whose numbers may have complex steps, one for each design of a batch; they are not checked."""
        sections = cls.__new__(cls)
        values = {"resistances": (resistance,), "time_constants": (time_constant,), "beside": (beside,)}
        sections.__dict__.update(values)
        return sections

    def plus(self, other: LoopSections) -> LoopSections:
        """The sections of both."""
        both = {name: getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__}
        found = type(self).__new__(type(self))
        found.__dict__.update(both)
        return found

    @property
    def each(self) -> tuple[Section, ...]:
        """The sections one by one."""
        values = zip(self.resistances, self.time_constants, self.beside, strict=True)
        return tuple(Section(f"section{n}", *each) for n, each in enumerate(values, 1))
