"""What an effect is: physics beside the lumped model, switched on by name, absent at its null value."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self, TypeAlias

import numpy as np

from piezoharvest.description.circuit import Product
from piezoharvest.description.parameters import Component
from piezoharvest.description.protocol import CampaignSizes, EnergyRows, EquationBuilder
from piezoharvest.description.shunts.base import Shunt

Channel: TypeAlias = Literal["force", "base_acceleration", "displacement", "voltage", "current"]


@dataclass(frozen=True, kw_only=True)
class Effect(Component):
    """A physical effect in the specimen, its sensors or its wiring.

    Subclasses give `name`, `source`, `looks` (what it looks like in the data) and `told_by` (the experiment that tells
    it from its look-alikes), and override where they act: `act` in the equations, `connect` in the load, `late`, `span`
    and `line` in a channel. Records are predicted with all of them. `simulate` takes `act` and `connect`, the linear
    view what small motions feel of these; `stores` and `losses` tell where the energy of what is linear goes, products
    and powers account for themselves.
    """

    name: ClassVar[str]
    source: ClassVar[str]
    looks: ClassVar[str] = ""
    told_by: ClassVar[str] = ""

    def act(self, specimen: EquationBuilder) -> None:
        """Add terms to the equations of the specimen."""

    def stores(self, terms: EnergyRows) -> Sequence[Product]:
        """Energy in J that the effect holds beside that of the lumped model: k x^2/2, C v_t^2/2 and so on."""
        return ()

    def losses(self, terms: EnergyRows) -> Sequence[Product]:
        """Power in W that the effect takes and does not give back; negative for a source."""
        return ()

    def connect(self, shunt: Shunt) -> Shunt:
        """What is really connected where a label says `shunt`."""
        return shunt

    def late(self, channel: str) -> float:
        """Seconds by which a channel comes late."""
        return 0.0

    def span(self, channel: str) -> float:
        """Largest value that a channel passes, in its SI unit."""
        return float("inf")

    def line(self, channel: str) -> float | None:
        """Frequency in Hz of a line on a channel, whose phase is another one in every record."""
        return None

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        """Start values over the plausible range, for the `diagnose.scales.Scene` of a campaign.

        The strength is at its null where the effect grows smoothly from there.
        """
        raise NotImplementedError

    def shown(self, scales: CampaignSizes) -> bool:
        """Whether the records of a `diagnose.scales.Scene` can show the effect with these values.

        Outside (a time constant far longer than the records, a threshold that is never reached) a fit only uses it for
        what it is like there, which is something else.
        """
        return True

    @property
    def absent(self) -> bool:
        """Whether it is at its null value, in every design of a batch."""
        fields = (field for field in dataclasses.fields(self) if field.metadata.get("null") is not None)
        return any(bool(np.all(np.equal(getattr(self, f.name), f.metadata["null"]))) for f in fields)

    @classmethod
    def strength(cls) -> dataclasses.Field[Any]:
        """The field that has a null value."""
        return next(field for field in dataclasses.fields(cls) if field.metadata.get("null") is not None)
