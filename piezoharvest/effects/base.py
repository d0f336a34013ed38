"""What an effect is: physics beside the lumped model, switched on by name, absent at its null value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

from piezoharvest.circuit import Port, Product, Row, State
from piezoharvest.parameters import Component


@dataclass(frozen=True, kw_only=True)
class Effect(Component):
    """A physical effect in the electrical domain of the transducer, as linear equations.

    Subclasses give `name` and `source`, and override what they change.
    """

    name: ClassVar[str]
    source: ClassVar[str]

    def states(self) -> tuple[State, ...]:
        """Own states, with their storage coefficients."""
        return ()

    def current(self, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Row:
        """Current in A drawn from the electrodes beside the load and the transducer."""
        return 0.0 * port.one

    def equations(self, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        """Residuals, zero along every motion, one for each own state."""
        return ()

    def act(self, specimen: Any) -> None:
        """Add terms to the equations of a `predict.specimen.Specimen`."""

    def connect(self, shunt: Any) -> Any:
        """What is really connected where a label says `shunt`."""
        return shunt

    def losses(self, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Product]:
        """Power in W that the effect dissipates."""
        return ()
