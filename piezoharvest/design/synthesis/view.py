"""The linear two-port with ladders across it, faster than by the equations of the whole system."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from piezoharvest.description.shunts import Shunt
from piezoharvest.design.bound.port import ElectrodePort, PortValues
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.synthesis.ladder import LOAD, Ladder, chain
from piezoharvest.linear import FrequencyResponse

_MOST_KNOWN = 64  # sets of frequencies: those of the operation come again and again, those of peaks do not


@dataclass(frozen=True, eq=False)
class LadderView(LinearView):
    """Two-port in its operation, on which ladders are evaluated by their chain of arms."""

    _known: dict[bytes, PortValues] = field(default_factory=dict)

    @classmethod
    def of(cls, view: LinearView) -> LadderView:
        """The same transducer, operation and amplitude."""
        return cls(view.transducer, view.operation, view.goal, view.amplitude)

    def response(self, shunt: Shunt, frequencies: Any) -> FrequencyResponse:
        """Response to a unit drive."""
        if not isinstance(shunt, Ladder):
            return super().response(shunt, frequencies)
        frequencies = np.asarray(frequencies, float)
        s, at = 2j * np.pi * frequencies, self._port(frequencies)
        voltage, current = chain(shunt, s)
        # Per ampere through the load the electrodes give `current` at `voltage`; without load they have at.voltage.
        load = at.voltage / (at.impedance * current + voltage)
        return self._filled(
            frequencies, displacement=at.displacement + at.influence / at.voltage * current * load,
            voltage=voltage * load, current=current * load,
            harvested_power=0.5 * getattr(shunt, LOAD) * np.abs(load) ** 2,
        )  # fmt: skip

    def _filled(self, frequencies: np.ndarray, **found: np.ndarray) -> FrequencyResponse:
        s = 2j * np.pi * frequencies
        unused = np.full(frequencies.shape, np.nan)
        return FrequencyResponse(
            frequencies=frequencies, velocity=s * found["displacement"], charge=-found["current"] / s,
            mechanical_power=unused, base=self.operation.base, **found,
        )  # fmt: skip

    def _port(self, frequencies: np.ndarray) -> PortValues:
        """Values of the electrodes, kept: tuning asks for the same frequencies again and again."""
        key = frequencies.tobytes()
        if key not in self._known:
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            self._known[key] = ElectrodePort(self).at(2 * np.pi * frequencies)
        return self._known[key]
