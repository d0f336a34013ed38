"""A transducer with its shunt: the one physical description that all analyses use."""

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
        Default: shorted electrodes.
    """

    transducer: Transducer
    shunt: Shunt = field(default_factory=Short)
