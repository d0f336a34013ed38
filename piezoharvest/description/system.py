"""A transducer with what is connected to it: the one physical description that every view starts from."""

from __future__ import annotations

from dataclasses import dataclass, field

from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.linear.short import Short
from piezoharvest.description.transducer import Transducer


@dataclass(frozen=True)
class System:
    """A transducer and its shunt.

    Parameters
    ----------
    transducer : Transducer
    shunt : Shunt
        Shorted electrodes unless given.
    """

    transducer: Transducer
    shunt: Shunt = field(default_factory=Short)
