"""What an effect is: physics beside the lumped model, switched on by name, absent at its null value."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

from piezoharvest.circuit import Port, Product, Row, State
from piezoharvest.parameters import Component


@dataclass(frozen=True, kw_only=True)
class Effect(Component):
    """A physical effect in the specimen, its sensors or its wiring.

    Subclasses give `name`, `source`, `looks` (what it looks like in the data) and `told_by` (the experiment that tells it from
    its look-alikes), and override where they act: `act` in the equations, `connect` in the load, `late`, `span` and
    `line` in a channel. A record is predicted with all of them. What `simulate` and the linear view can do with an
    effect, it says by `states`, `current`, `equations` and `losses`.
    """

    name: ClassVar[str]
    source: ClassVar[str]
    looks: ClassVar[str] = ""
    told_by: ClassVar[str] = ""

    def act(self, specimen: Any) -> None:
        """Add terms to the equations of a `predict.specimen.Specimen`."""

    def connect(self, shunt: Any) -> Any:
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
    def starts(cls, scene: Any) -> Iterator[Effect]:
        """Start values over the plausible range, for the `diagnose.scene.Scene` of a campaign.

        The strength is at its null where the effect grows smoothly from there.
        """
        raise NotImplementedError

    @property
    def at_the_electrodes(self) -> bool:
        """Whether `simulate` and the linear view can do with it: it draws a current, and that is all."""
        return type(self).current is not Effect.current

    @classmethod
    def strength(cls) -> dataclasses.Field:
        """The field that has a null value."""
        return next(field for field in dataclasses.fields(cls) if field.metadata.get("null") is not None)

    def states(self) -> tuple[State, ...]:
        """Own states, with their storage coefficients."""
        return ()

    def current(self, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Row:
        """Current in A drawn from the electrodes beside the load and the transducer."""
        return 0.0 * port.one

    def equations(self, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        """Residuals, zero along every motion, one for each own state."""
        return ()

    def losses(self, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Product]:
        """Power in W that the effect dissipates."""
        return ()
