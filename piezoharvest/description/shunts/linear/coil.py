"""A real coil: inductance beside the loss of its core, in line with the winding, whose capacitance is across both."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from piezoharvest.description.circuit import Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.base import LinearShunt


@dataclass(frozen=True, kw_only=True)
class WoundShunt(LinearShunt):
    """A circuit with one coil; without these keys the coil is ideal.

    The equivalent circuit is that of Massarini & Kazimierczuk, IEEE Trans. Power Electron. 12(4), 671-676, 1997, with a
    core loss as a resistance beside the inductance (Snelling, Soft Ferrites, 2nd ed., 1988).
    """

    inductance: float = quantity("H", "inductance", above=0)
    winding_resistance: float | None = quantity(
        "ohm", "resistance of the winding; default: no loss", default=None, at_least=0
    )
    core_resistance: float | None = quantity(
        "ohm",
        "resistance in parallel with the inductance, the loss of the core; default: no loss",
        default=None,
        above=0,
    )
    self_resonance: float | None = quantity(
        "Hz",
        "frequency at which the capacitance of the winding resonates with the inductance; default: no capacitance",
        default=None,
        above=0,
    )

    @property
    def winding(self) -> Any:
        """Resistance of the winding, ohm."""
        return 0.0 if self.winding_resistance is None else self.winding_resistance

    @property
    def is_ideal(self) -> bool:
        """True if the coil is an inductance and nothing else."""
        return self.winding_resistance is self.core_resistance is self.self_resonance is None

    @property
    def stray_capacitance(self) -> Any:
        """Capacitance of the winding, F; only with a self-resonance."""
        assert self.self_resonance is not None
        return 1.0 / ((2 * np.pi * self.self_resonance) ** 2 * self.inductance)

    def coil_states(self) -> tuple[State, ...]:
        """Current of the inductance, and the voltage across the coil where its winding has a capacitance."""
        current = State("current", self.inductance)
        return (current,) if self.self_resonance is None else (current, State("winding", self.stray_capacitance))

    def coil(self, series: Any, voltage: Row, z: SimpleNamespace, dz: SimpleNamespace) -> list[Row]:
        """Equation of the inductance behind a resistance in series with it, that of the winding included.

        Parameters
        ----------
        series : float
            ohm.
        voltage : Row
            Across both, V.
        """
        if self.core_resistance is not None:
            current = self.winding_current(series, voltage, z)
            return [self.inductance * dz.current - self.core_resistance * (current - z.current)]
        return [self.inductance * dz.current + series * z.current - voltage]

    def winding_current(self, series: Any, voltage: Row, z: SimpleNamespace) -> Row:
        """Current through the winding, A, as that of the inductance and its core; arguments as for `coil`."""
        if self.core_resistance is not None:
            return (voltage + self.core_resistance * z.current) / (series + self.core_resistance)
        return z.current

    def coil_losses(self, current: Row, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        """Losses of winding and core for a current through the winding; none of an ideal coil."""
        found: list[Product] = []
        if self.winding_resistance is not None:
            found.append(Product(self.winding_resistance, current, current))
        if self.core_resistance is not None:
            lost = current - z.current
            found.append(Product(self.core_resistance, lost, lost))
        return {"shunt_loss": found} if found else {}
