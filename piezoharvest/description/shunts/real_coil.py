"""Real coils in switched loops: the loss of a core, and the capacitance of a winding."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import ParameterError, described, quantity
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve
from piezoharvest.description.shunts.switching import InductiveSwitch, SwitchedLoop


@dataclass(frozen=True, kw_only=True)
class CoredCoil(SwitchedLoop):
    """A coil whose core may lose energy: a resistance beside the inductance, behind that of the loop.

    The switch is timed as for the loop without it. When it opens, the core takes what is left in the coil. Where diodes
    in line block before that, the current of the inductance goes on in the core alone.
    """

    core_resistance: float | None = quantity(
        "ohm", "resistance in parallel with the inductance, the loss of the core; None: no loss", default=None, above=0
    )

    def coil_states(self, capacitance: float) -> tuple[State, ...]:
        """States of the coil."""
        return (State("current", self.loop(capacitance)[0]),)

    @property
    def ended(self) -> str | None:
        """State that is zero where the current into the coil ends."""
        return "current" if self.core_resistance is None else None

    def cored_current(self, closed: bool, drive: Row, port: Port, z: SimpleNamespace, line: Any = 0.0) -> Row:
        """Current into the loop under the voltage `drive`, of the inductance and of what is beside it.

        `line` is a resistance in line beside that of the loop, ohm.
        """
        if self.core_resistance is None or not closed:
            return self.loop_current(closed, port, z)
        resistance = self.loop(port.capacitance)[1] + line
        return (drive + self.core_resistance * z.current) / (resistance + self.core_resistance)

    def cored_equations(
        self, closed: bool, drive: Row, port: Port, z: SimpleNamespace, dz: SimpleNamespace, line: Any = 0.0
    ) -> list[Row]:
        """L di/dt = R_c (current into the loop - i), without a core as `loop_equation`; one for each state."""
        if self.core_resistance is None:
            return [self.loop_equation(closed, drive - line * z.current, port, z, dz)]
        in_core = self.cored_current(closed, drive, port, z, line) - z.current
        return [self.loop(port.capacitance)[0] * dz.current - self.core_resistance * in_core]

    def cored_losses(self, closed: bool, drive: Row, port: Port, z: SimpleNamespace, line: Any = 0.0) -> list[Product]:
        """Power in the resistance of the loop and in the core, but not in that in line."""
        resistance = self.loop(port.capacitance)[1]
        if self.core_resistance is None:
            drop, further = self.in_line
            lost = [Product(resistance + further, z.current, z.current)]
            return [*lost, Product(drop, port.one, z.current)] if np.any(drop) else lost
        current = self.cored_current(closed, drive, port, z, line)
        in_core = current - z.current
        return [Product(resistance, current, current), Product(self.core_resistance, in_core, in_core)]

    def blocked_voltage(self, z: SimpleNamespace) -> Row | float:
        """Voltage that the coil has by itself, while diodes in line block, V."""
        return 0.0 if self.core_resistance is None else -self.core_resistance * z.current


@dataclass(frozen=True, kw_only=True)
class CoredSwitch(InductiveSwitch, CoredCoil):
    """A switched inductance that inverts the electrode voltage, with a core that may lose energy.

    Whatever the direction of its current, the closed switch takes what a table `switch_curve` has at that current,
    beside the resistance of the loop. It is timed as without this voltage.

    Raises
    ------
    ParameterError
        A curve of the switch does not begin at 0 V, or is given together with a core or a self-resonance.
    """

    switch_curve: VoltageCurve | None = described(
        "voltage of the closed switch over its current, beside the resistance of the loop", default=None
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.switch_curve is None:
            return
        if np.any(self.switch_curve.voltages[0]):
            raise ParameterError("switch_curve.voltages", f"found {self.switch_curve.voltages[0]} V at 0 A, must be 0")
        for key in ("core_resistance", "self_resonance"):
            if getattr(self, key, None) is not None:
                raise ParameterError("switch_curve", f"found together with {key}, give one of the two")


@dataclass(frozen=True, kw_only=True)
class WoundSwitch(CoredSwitch):
    """A switched coil whose winding may have a capacitance, C_w = 1/((2 pi f_r)^2 L) at the self-resonance f_r.

    It lies beside the inductance with the resistance of the winding, which is that given by `quality`, and both behind
    the switch. When this closes, the capacitance takes its charge through `switch_resistance`: of the energy of the
    electrodes, half of V^2 C C_w/(C + C_w) is lost, whatever that resistance. Then C + C_w swing, while the switch is
    timed as without C_w. When it opens, no current is cut: C_w and the inductance ring on by themselves, until winding
    and core have taken their energy, C_w V^2/2 and what the inductance had.

    The equivalent circuit is that of Massarini & Kazimierczuk, IEEE Trans. Power Electron. 12(4), 671-676, 1997.

    Raises
    ------
    ParameterError
        A self-resonance is given without a resistance of the switch.
    """

    self_resonance: float | None = quantity(
        "Hz",
        "frequency at which the capacitance of the winding resonates with the inductance; None: no capacitance",
        default=None,
        above=0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.self_resonance is not None and self.switch_resistance is None:
            found = "found without a switch_resistance, through which the capacitance of the winding is charged"
            raise ParameterError("self_resonance", f"{found}: give both")
        if self.self_resonance is not None and np.any(np.real(self.contact_resistance) == 0):
            found = "found 0 together with a self_resonance, whose capacitance would be charged at once"
            raise ParameterError("switch_resistance", f"{found}, must be greater than 0 ohm")

    @property
    def contact_resistance(self) -> Any:
        """Resistance of the closed switch, ohm."""
        return 0.0 if self.switch_resistance is None else self.switch_resistance

    def stray_capacitance(self, capacitance: float) -> Any:
        """Capacitance of the winding, F; only with a self-resonance."""
        assert self.self_resonance is not None
        return 1.0 / ((2 * np.pi * self.self_resonance) ** 2 * self.loop(capacitance)[0])

    def winding_resistance(self, capacitance: float) -> Any:
        """Resistance of the winding, that of the loop less that of the switch, ohm."""
        return self.loop(capacitance)[1] - self.contact_resistance

    def coil_states(self, capacitance: float) -> tuple[State, ...]:
        if self.self_resonance is None:
            return super().coil_states(capacitance)
        # Not "current": a switch that opens does not cut it.
        return (State("inductor", self.loop(capacitance)[0]), State("winding", self.stray_capacitance(capacitance)))

    @property
    def ended(self) -> str | None:
        return super().ended if self.self_resonance is None else None

    def cored_current(self, closed: bool, drive: Row, port: Port, z: SimpleNamespace, line: Any = 0.0) -> Row:
        if self.self_resonance is None:
            return super().cored_current(closed, drive, port, z, line)
        return (drive - z.winding) / (self.contact_resistance + line) if closed else 0.0 * port.one

    def cored_equations(
        self, closed: bool, drive: Row, port: Port, z: SimpleNamespace, dz: SimpleNamespace, line: Any = 0.0
    ) -> list[Row]:
        if self.self_resonance is None:
            return super().cored_equations(closed, drive, port, z, dz, line)
        current, wound = self.cored_current(closed, drive, port, z, line), self._wound_current(port, z)
        across = z.winding - self.winding_resistance(port.capacitance) * wound
        return [
            self.loop(port.capacitance)[0] * dz.inductor - across,
            self.stray_capacitance(port.capacitance) * dz.winding - (current - wound),
        ]

    def cored_losses(self, closed: bool, drive: Row, port: Port, z: SimpleNamespace, line: Any = 0.0) -> list[Product]:
        if self.self_resonance is None:
            return super().cored_losses(closed, drive, port, z, line)
        current, wound = self.cored_current(closed, drive, port, z, line), self._wound_current(port, z)
        lost = [
            Product(self.contact_resistance, current, current),
            Product(self.winding_resistance(port.capacitance), wound, wound),
        ]
        if self.core_resistance is not None:
            lost.append(Product(self.core_resistance, wound - z.inductor, wound - z.inductor))
        return lost

    def blocked_voltage(self, z: SimpleNamespace) -> Row | float:
        return super().blocked_voltage(z) if self.self_resonance is None else z.winding

    def inversion(self, capacitance: float) -> Any:
        inverted = super().inversion(capacitance)
        if self.self_resonance is None:
            return inverted
        return inverted * capacitance / (capacitance + self.stray_capacitance(capacitance))

    def _wound_current(self, port: Port, z: SimpleNamespace) -> Row:
        """Current through the winding, of the inductance and of its core."""
        if self.core_resistance is None:
            return z.inductor
        both = self.winding_resistance(port.capacitance) + self.core_resistance
        return (z.winding + self.core_resistance * z.inductor) / both
