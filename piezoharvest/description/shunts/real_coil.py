"""Real coils in switched loops: resistance, loss of the core, capacitance of the winding."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from piezoharvest.description.circuit import Number, Port, Product, Row, State
from piezoharvest.description.parameters import ParameterError, check_kind, described, quantity
from piezoharvest.description.shunts.curves.loop_sections import LoopSections, Section
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve
from piezoharvest.description.shunts.switching import InductiveSwitch, SwitchedLoop


class RealCoil(NamedTuple):
    """A coil in line with a switch, in the equivalent circuit of Massarini & Kazimierczuk (1997).

    Inductance and core side by side, the resistance of the winding in series with both, and the capacitance of the
    winding across all of it. Without that capacitance the resistance of the switch is part of `resistance`.

    Attributes
    ----------
    names : (str, str)
        Names of its states: the current of the inductance (A), and the voltage across the winding (V).
    inductance, resistance : float
        H and ohm.
    core : float or None
        Resistance in parallel with the inductance, ohm; None if the core has no loss.
    stray : float or None
        Capacitance of the winding, F; None if it has none.
    contact : float
        Resistance of the closed switch, ohm, through which the winding is charged.
    in_line : (float, float)
        Voltage (V) and resistance (ohm) in line with a coil without core and winding: a piece of a switch's curve.
    sections : tuple of Section
        Further parts in line with such a coil.
    """

    names: tuple[str, str]
    inductance: Any
    resistance: Any
    core: Any | None = None
    stray: Any | None = None
    contact: Any = 0.0
    in_line: tuple[Any, Any] = (0.0, 0.0)
    sections: tuple[Section, ...] = ()

    @property
    def ended(self) -> str | None:
        """State that is zero when no current flows into the coil; None if its current goes on in core or winding."""
        return self.names[0] if self.core is None and self.stray is None else None

    def states(self, recovered: Number | None = None, odd: bool = True) -> tuple[State, ...]:
        """States of the coil; `recovered` is the share of their energy that the load gets when they are cut."""
        inductor = State(self.names[0], self.inductance, odd, recovered, only_closed=True)
        if self.stray is not None:
            return inductor, State(self.names[1], self.stray, odd, recovered, only_closed=True)
        return inductor, *(section.state(odd, self.inductance) for section in self.sections)

    def current(self, connected: bool, drive: Row, port: Port, z: SimpleNamespace, line: Any = 0.0) -> Row:
        """Current into the coil under the voltage `drive`, A; `line` is a further resistance in series, ohm."""
        if not connected:
            return 0.0 * port.one
        if self.stray is not None:
            return (drive - self._winding(z)) / (self.contact + line)
        if self.core is not None:
            return (drive + self.core * self._inductor(z)) / (self.resistance + line + self.core)
        return self._inductor(z)

    def equations(
        self, connected: bool, drive: Row, port: Port, z: SimpleNamespace, dz: SimpleNamespace, line: Any = 0.0
    ) -> list[Row]:
        """One equation for each state.

        L i' = u across the inductance, which is that across the core, R_c (j - i) with the current j of the winding;
        C_w w' = current into the coil - j. Without core and winding, i stays as it is while nothing is connected, and
        sections in line with it go on by themselves.
        """
        change = self.inductance * getattr(dz, self.names[0])
        into = self.current(connected, drive, port, z, line)
        if self.stray is not None:
            wound = self._wound(z)
            across = self._winding(z) - self.resistance * wound
            return [change - across, self.stray * getattr(dz, self.names[1]) - (into - wound)]
        if self.core is not None:
            return [change - self.core * (into - self._inductor(z))]
        lagging = [(each, getattr(z, each.name)) for each in self.sections]
        own = [each.equation(into, y, getattr(dz, each.name)) for each, y in lagging]
        if not connected:
            return [getattr(dz, self.names[0]), *own]
        drop, further = self.in_line
        beyond = drop * port.one + sum(each.voltage(into, y) for each, y in lagging)
        return [change + (self.resistance + further + line) * into + beyond - drive, *own]

    def losses(self, connected: bool, drive: Row, port: Port, z: SimpleNamespace, line: Any = 0.0) -> list[Product]:
        """Power in winding, core, switch and sections, but not in the further resistance `line`."""
        into = self.current(connected, drive, port, z, line)
        wound = into if self.stray is None else self._wound(z)
        drop, further = self.in_line
        lost = [Product(self.resistance + further, wound, wound)]
        lost += [section.loss(into, getattr(z, section.name)) for section in self.sections]
        if np.any(drop):
            lost.append(Product(drop, port.one, wound))
        if self.stray is not None:
            lost.append(Product(self.contact, into, into))
        if self.core is not None:
            lost.append(Product(self.core, wound - self._inductor(z), wound - self._inductor(z)))
        return lost

    def blocked_voltage(self, z: SimpleNamespace) -> Row | float:
        """Voltage across the coil while diodes in series block, V."""
        if self.stray is not None:
            return self._winding(z)
        if self.core is not None:
            return -self.core * self._inductor(z)
        return sum(each.voltage(0.0 * self._inductor(z), getattr(z, each.name)) for each in self.sections)

    def _inductor(self, z: SimpleNamespace) -> Row:
        return getattr(z, self.names[0])

    def _winding(self, z: SimpleNamespace) -> Row:
        return getattr(z, self.names[1])

    def _wound(self, z: SimpleNamespace) -> Row:
        """Current through the winding: that of the inductance and its core."""
        if self.core is None:
            return self._inductor(z)
        return (self._winding(z) + self.core * self._inductor(z)) / (self.resistance + self.core)


def winding_capacitance(self_resonance: Any, inductance: Any) -> Any:
    """Capacitance (F) that resonates with an inductance (H) at a frequency (Hz)."""
    return 1.0 / ((2 * np.pi * self_resonance) ** 2 * inductance)


@dataclass(frozen=True, kw_only=True)
class WoundCoil(SwitchedLoop):
    """A switched loop whose coil may have core loss and a self-resonance.

    `core_resistance` is in parallel with the inductance. At the self-resonance f_r the inductance resonates with the
    capacitance of the winding, C_w = 1/((2 pi f_r)^2 L), which is in parallel with inductance, core and winding
    resistance (that given by `quality`). The switch is in series with all of them.

    When the switch closes, the electrodes charge C_w through `switch_resistance`, which costs V^2 C C_w/(C + C_w)/2
    whatever that resistance; then C + C_w swing with the inductance. The switch is timed for C alone. When it opens, no
    current is cut: inductance, core and C_w ring down by themselves, until winding and core have absorbed the energy.
    A core without C_w absorbs the energy of the inductance in the same way. If diodes in series block earlier, this
    begins there.

    The equivalent circuit is that of Massarini & Kazimierczuk, IEEE Trans. Power Electron. 12(4), 671-676, 1997.

    Raises
    ------
    ParameterError
        A self-resonance is given without a resistance of the switch.
    """

    in_line: ClassVar[tuple[Any, Any]] = (0.0, 0.0)  # V and ohm, beside the resistance of the loop (`curved`)

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

    def __post_init__(self) -> None:
        super().__post_init__()
        check_winding(self.self_resonance, self.switch_resistance)

    def stray_capacitance(self, capacitance: float) -> Any:
        """Capacitance of the winding, F; only with a self-resonance."""
        assert self.self_resonance is not None
        return winding_capacitance(self.self_resonance, self.loop(capacitance)[0])

    def charge_share(self, capacitance: float) -> Any:
        """Share of the voltage that is left when C has charged the winding, C/(C + C_w)."""
        if self.self_resonance is None:
            return 1.0
        return capacitance / (capacitance + self.stray_capacitance(capacitance))

    @property
    def sections(self) -> tuple[Section, ...]:
        """Parts in line with the coil beside its resistance."""
        return ()

    def real_coil(self, capacitance: float) -> RealCoil:
        """The coil of the loop with the clamped capacitance (F)."""
        inductance, resistance = self.loop(capacitance)
        if self.self_resonance is None:
            names, core = ("current", ""), self.core_resistance
            return RealCoil(names, inductance, resistance, core, in_line=self.in_line, sections=self.sections)
        # Its current is no "current": a switch that opens does not cut it.
        stray, contact = self.stray_capacitance(capacitance), self.switch_resistance
        own = resistance - contact
        return RealCoil(("inductor", "winding"), inductance, own, self.core_resistance, stray, contact)


def check_winding(self_resonance: Any, switch_resistance: Any, prefix: str = "") -> None:
    """Raise ParameterError if the capacitance of a winding would be charged through nothing."""
    if self_resonance is None:
        return
    if switch_resistance is None:
        found = f"found without a {prefix}switch_resistance, through which the capacitance of the winding is charged"
        raise ParameterError(f"{prefix}self_resonance", f"{found}: give both")
    if np.any(np.real(switch_resistance) == 0):
        found = f"found 0 together with a {prefix}self_resonance, whose capacitance would be charged at once"
        raise ParameterError(f"{prefix}switch_resistance", f"{found}, must be greater than 0 ohm")


@dataclass(frozen=True, kw_only=True)
class WoundSwitch(InductiveSwitch, WoundCoil):
    """A switched real coil that inverts the electrode voltage.

    Whatever the direction of its current, the closed switch takes what a table `switch_curve` has at that current,
    beside the resistance of the loop, and `loop_sections` take what lags behind it. The switch is timed as without
    these voltages.

    Raises
    ------
    ParameterError
        A curve of the switch does not begin at 0 V, or a curve or sections are given together with a core or a
        self-resonance.
    """

    switch_curve: VoltageCurve | None = described(
        "voltage of the closed switch over its current, beside the resistance of the loop", default=None
    )

    loop_sections: LoopSections | None = described(
        "resistances in line with the coil, each beside an inductance or a capacitance", default=None
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, kind in (("switch_curve", VoltageCurve), ("loop_sections", LoopSections)):
            if getattr(self, name) is None:
                continue
            check_kind(name, getattr(self, name), kind)
            for key in ("core_resistance", "self_resonance"):
                if getattr(self, key) is not None:
                    raise ParameterError(name, f"found together with {key}, give one of the two")
        if self.switch_curve is not None and np.any(np.real(self.switch_curve.voltages[0])):
            raise ParameterError("switch_curve.voltages", f"found {self.switch_curve.voltages[0]} V at 0 A, must be 0")

    @property
    def sections(self) -> tuple[Section, ...]:
        return () if self.loop_sections is None else self.loop_sections.each

    def inversion(self, capacitance: float) -> Any:
        return super().inversion(capacitance) * self.charge_share(capacitance)
