"""Base class of effects: physics beyond the lumped model, enabled by name, absent at a null value."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self, TypeAlias

import numpy as np

from piezoharvest.description.circuit import Product
from piezoharvest.description.parameters import AS_LABELLED, Component
from piezoharvest.description.protocol import CampaignSizes, EnergyRows, EquationBuilder
from piezoharvest.description.shunts.base import Shunt

Channel: TypeAlias = Literal[
    "force", "base_acceleration", "displacement", "velocity", "acceleration", "voltage", "current", "dc_voltage",
    "dc_current",
]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Effect(Component):
    """A physical effect in the specimen, its sensors or its wiring.

    `of_specimen` is False for an error of sensors or labels, which no other set-up has.

    Subclasses define `name`, `source`, `looks` (appearance in the data) and `told_by` (the experiment that
    distinguishes it from similar effects), and override the places where they act: `act` in the equations, `connect` in
    the load, `late`, `span` and `line` in a channel. Records are predicted with all of them. `simulate` uses `act` and
    `connect`, the linear view their small-signal part; `stores` and `losses` give the energy of linear terms, while
    products and powers account for themselves.
    """

    name: ClassVar[str]
    source: ClassVar[str]
    looks: ClassVar[str] = ""
    told_by: ClassVar[str] = ""
    second_order: ClassVar[bool] = False  # what it changes goes with the square of its strength
    # Its strength decides which events there are: it has no derivative anywhere, and values are tried instead.
    scanned: ClassVar[bool] = False
    of_specimen: ClassVar[bool] = True
    places: ClassVar[tuple[str, ...]] = ()  # see `acts_at`
    same_law: ClassVar[str] = ""  # name of the effect that it is, expressed in other quantities
    of_drive: ClassVar[bool] = False  # it depends on the amplitude or the frequency of a record's drive
    delay_path: ClassVar[tuple[str, ...]] = ("delay",)  # to the value that `late` returns

    @property
    def acts_at(self) -> tuple[str, ...]:
        """Names of the places of laws without a name at which it acts: such a law is the effect with more freedom."""
        return self.places

    def act(self, specimen: EquationBuilder) -> None:
        """Add terms to the equations of the specimen."""

    def stores(self, terms: EnergyRows) -> Sequence[Product]:
        """Energy in J held in addition to the lumped model's: k x^2/2, C v_t^2/2 and so on."""
        return ()

    def losses(self, terms: EnergyRows) -> Sequence[Product]:
        """Power in W that the effect dissipates; negative for a source."""
        return ()

    def connect(self, shunt: Shunt) -> Shunt:
        """The circuit that is really connected where the label says `shunt`."""
        return shunt

    @property
    def changes_circuit(self) -> bool:
        """True if it may connect another circuit than that of the label."""
        return type(self).connect is not Effect.connect

    @classmethod
    def acts_on(cls, shunt: Shunt | None) -> bool:
        """True if records behind this circuit (None under an imposed voltage) can show the effect.

        Elsewhere it is no candidate of a diagnosis; one that acts by `connect` alone leaves such a circuit as it is.
        """
        return True

    def late(self, channel: str) -> float:
        """Delay of a channel in s."""
        return 0.0

    def delays(self, channel: str) -> bool:
        """True if the effect may delay a channel, even if its delay is zero at present."""
        if type(self).late is Effect.late:
            return False
        moved = copy.copy(self)
        object.__setattr__(moved, self.delay_path[0], 1.0)
        return moved.late(channel) == 1.0

    def span(self, channel: str) -> float:
        """Largest value that a channel can read, in its SI unit."""
        return float("inf")

    def line(self, channel: str) -> float | None:
        """Frequency in Hz of a spectral line on a channel, whose phase differs between records."""
        return None

    @classmethod
    def starts(cls, scales: CampaignSizes) -> Iterator[Self]:
        """Start values over the plausible range, in a campaign.

        The strength is at its null where the effect grows smoothly from it.
        """
        raise NotImplementedError

    def shown(self, scales: CampaignSizes) -> bool:
        """True if the records of a campaign can show the effect with these values.

        With other values (a time constant far longer than the records, a threshold that is never reached) the effect
        behaves like another one, and a fit would use it as that.
        """
        return True

    @property
    def absent(self) -> bool:
        """True if it is at its null value, or at all of them, in every design of a batch."""
        fields = (f for f in dataclasses.fields(self) if f.metadata.get("null") not in (None, AS_LABELLED))
        at_null = [bool(np.all(np.equal(getattr(self, f.name), f.metadata["null"]))) for f in fields]
        return bool(at_null) and all(at_null)

    @classmethod
    def strength(cls) -> dataclasses.Field[Any]:
        """The field with a null value, the first of several."""
        return next(field for field in dataclasses.fields(cls) if field.metadata.get("null") is not None)
