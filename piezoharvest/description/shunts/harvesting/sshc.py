"""Synchronised switch harvesting on capacitors: the voltage is inverted by capacitors instead of a coil."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.staged import StagedFlip, position_of

MOST_CAPACITORS = 8
# Time constants R C that a phase lasts where its time is not given: exp(-10) of the voltage is left by the short, the
# square of that or less by a capacitor in series with C. Longer phases would begin to miss the extremum.
SETTLING = 10.0
# Where nothing is given: capacitors as C, which invert 2/3 of the voltage, in a short share of the period.
ASSUMED_CAPACITORS, ASSUMED_SHARE = 4, 1 / 100


@dataclass(frozen=True, kw_only=True)
class SSHC(StagedFlip):
    """Synchronised switch harvesting on capacitors: capacitors take the charge at an extremum and return it inverted.

    Each of the n capacitors is connected to the electrodes for one phase, from the first to the last. The electrodes
    are then short-circuited, and the capacitors follow in reverse order with opposite sign: 2 n + 1 phases of equal
    length. `switch_resistance` is the resistance of the closed path in every phase. Capacitors equal to C invert n/(n +
    2) of the voltage, much larger ones n/(n + 1). With one capacitor, in three phases, this is the flipping- or
    flying-capacitor rectifier of Chen, Law, Mak, Ki & Martins (IEEE J. Solid-State Circuits 52(12), 3168-3180, 2017).
    """

    kind: ClassVar[str] = "sshc"
    source: ClassVar[str] = "Du & Seshia, IEEE J. Solid-State Circuits 52(10), 2733-2742, 2017"

    flip_capacitances: tuple[float, ...] = quantity(
        "F", "capacitances of the switched capacitors, in order, one to eight", above=0
    )
    switch_resistance: float = quantity("ohm", "resistance of the closed switches of a phase", above=0)
    phase_time: float | None = quantity("s", "duration of a phase; default: 10 R C", default=None, above=0)
    on_time_error: float = quantity("", "relative error of the duration of the phases", default=0.0, above=-1)

    def __post_init__(self) -> None:
        super().__post_init__()
        count = len(self.flip_capacitances)
        if not 1 <= count <= MOST_CAPACITORS:
            message = f"found {count} capacitors, allowed are 1 to {MOST_CAPACITORS}"
            raise ParameterError("flip_capacitances", message)

    @classmethod
    def assumed(cls, capacitance: float, frequency: float) -> tuple[dict[str, Any], str]:
        phases = 2 * ASSUMED_CAPACITORS + 1
        resistance = ASSUMED_SHARE / frequency / (phases * SETTLING * capacitance)
        values = {"flip_capacitances": (capacitance,) * ASSUMED_CAPACITORS, "switch_resistance": resistance}
        return values, f"{ASSUMED_CAPACITORS} capacitors of {capacitance:.3g} F, switches of {resistance:.3g} ohm"

    @property
    def stages(self) -> tuple[str, ...]:
        numbers = range(1, len(self.flip_capacitances) + 1)
        return (*(f"share{n}" for n in numbers), "short", *(f"refill{n}" for n in reversed(numbers)))

    def on_time(self, capacitance: float) -> float:
        """Seconds that all phases of a flip last."""
        phase: Any = SETTLING * self.switch_resistance * capacitance if self.phase_time is None else self.phase_time
        return len(self.stages) * (1 + self.on_time_error) * phase

    def inversion(self, capacitance: float) -> float:
        """Share of the voltage that a flip inverts once the capacitors have settled, the strain at rest."""
        decay = np.exp(-self.on_time(capacitance) / len(self.stages) / self.switch_resistance / capacitance)
        # Voltages (electrodes, capacitors) as linear forms of the initial ones.
        forms = np.eye(1 + len(self.flip_capacitances))
        for phase in self.stages:
            if phase == "short":
                forms[0] *= decay
                continue
            n, sign = int(phase[-1]), 1.0 if phase.startswith("share") else -1.0
            part = self.flip_capacitances[n - 1]
            difference = (1 - decay ** ((capacitance + part) / part)) * (forms[0] - sign * forms[n])
            forms[0] = forms[0] - part / (capacitance + part) * difference
            forms[n] = forms[n] + sign * capacitance / (capacitance + part) * difference
        settled = np.linalg.solve(np.eye(len(forms) - 1) - forms[1:, 1:], forms[1:, 0])
        return float(-forms[0] @ [1.0, *settled])

    def states(self, capacitance: float) -> tuple[State, ...]:
        capacitors = (State(f"flip_{n}", c, odd=False) for n, c in enumerate(self.flip_capacitances, 1))
        return (*capacitors, *self.bridge_states())

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        across, connected, side = self._path(position_of(configuration), port, z)
        charging = [
            c * getattr(dz, f"flip_{n}") - (side * across / self.switch_resistance if n == connected else 0.0)
            for n, c in enumerate(self.flip_capacitances, 1)
        ]
        _, rectified = self.bridge(configuration, port, z)
        return [self.port_equation(configuration, port, z, dz), *charging, *self.dc_equations(rectified, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        across, _, _ = self._path(position_of(configuration), port, z)
        powers = self.bridge_powers(self.bridge(configuration, port, z)[1], port, z)
        powers["shunt_loss"] += [Product(1 / self.switch_resistance, across, across), *self.leads_loss(port, z)]
        return powers

    def switched_current(self, position: str, port: Port, z: SimpleNamespace) -> Row:
        return self._path(position, port, z)[0] / self.switch_resistance

    def _path(self, position: str, port: Port, z: SimpleNamespace) -> tuple[Row, int, int]:
        """Voltage across the closed switches, and the connected capacitor (0: none) with the sign of its connection."""
        if position == "open":
            return 0.0 * port.one, 0, 0
        if position.endswith("short"):
            return port.v, 0, 0
        n, side = int(position[-1]), 1 if position[0] == "+" else -1
        side = side if "share" in position else -side
        return port.v - side * getattr(z, f"flip_{n}"), n, side
