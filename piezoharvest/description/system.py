"""A transducer with its shunt: the one physical description that all analyses use."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from piezoharvest.description.parameters import ParameterError, check_kind
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.linear.open import Open
from piezoharvest.description.shunts.linear.short import Short
from piezoharvest.description.transducer import Pair, Transducer


@dataclass(frozen=True)
class System:
    """A transducer and its shunt.

    Parameters
    ----------
    transducer : Transducer
    shunt : Shunt
        Default: shorted electrodes.

    Raises
    ------
    ParameterError
        The shunt is at electrodes that the transducer has not got.
    """

    transducer: Transducer
    shunt: Shunt = field(default_factory=Short)

    def __post_init__(self) -> None:
        check_kind("transducer", self.transducer, Transducer)
        check_kind("shunt", self.shunt, Shunt, "such as Resistor(resistance=1e5)")
        most = len(self.transducer.electrodes)
        for place, number in enumerate(self.shunt.taken):
            if number > most:
                key = f"others.{place - 1}.electrode" if place else "electrode"
                allowed = f"a number from 0 to {most}" if most else "0: the transducer has no further electrodes"
                raise ParameterError(key, f"found {number}, must be {allowed}")

    @property
    def electrode(self) -> Pair:
        """The electrodes of the shunt, of whose others it is not."""
        return self.transducer.all_electrodes[self.shunt.electrode]

    @property
    def opened(self) -> System:
        """The transducer with the electrodes of the shunt open, and its others where they are."""
        return System(self.transducer, Open(electrode=self.shunt.electrode, others=self.shunt.others))

    @property
    def shorted(self) -> System:
        """The transducer with all electrodes shorted that have a shunt: the reference of attenuation."""
        first, *others = (Short(electrode=number) for number in self.shunt.taken)
        return System(self.transducer, replace(first, others=tuple(others)))
