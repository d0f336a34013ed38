"""The periodic drive of a record in steady state as an excitation of the engine."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from piezoharvest.description.effects.nameless.sizes import RecordSizes
from piezoharvest.description.excitation import Excitation, Tones
from piezoharvest.records.harmonics import Harmonics


@dataclass(frozen=True, kw_only=True)
class PeriodicDrive(Excitation):
    """Drive of a record: a force in N, or a base acceleration in m/s^2.

    It stands for no key of a study, so it has no kind.
    """

    harmonics: Harmonics = field(repr=False, compare=False)
    size: RecordSizes | None = None  # type: ignore[misc]
    base: bool = False  # type: ignore[misc]

    @property
    def period(self) -> float:
        """Period, s."""
        return self.harmonics.period

    @property
    def rest(self) -> float:
        """The constant, under which the structure was before it moved."""
        return self.harmonics.offset

    @property
    def antisymmetric(self) -> bool:
        """True if there are odd harmonics alone."""
        return self.harmonics.offset == 0.0 and bool(np.all(self.harmonics.orders % 2 == 1))

    def signal(self) -> Tones:
        """Constant and harmonics; Re c exp(j a) = |c| sin(a + arg c + pi/2)."""
        found = self.harmonics
        phases = np.angle(found.sizes) + 0.5 * np.pi
        return Tones(found.frequency * found.orders, np.abs(found.sizes), phases, found.offset)
