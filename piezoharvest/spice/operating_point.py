"""Operating point of a netlist: the devices, and magnitudes and times to which smooth elements are adapted."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from piezoharvest.description.excitation import Excitation, Ramps, Tones
from piezoharvest.description.shunts import Open, Shunt
from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine.lowering.lower import lower
from piezoharvest.equations.terms import Terms
from piezoharvest.spice.deck import number
from piezoharvest.spice.steady_start import SteadyStart


class OperatingPoint(NamedTuple):
    """Devices around the shunt in a netlist, with expected magnitudes.

    Attributes
    ----------
    transducer : Transducer
    excitation : Excitation
    signal : Tones or Ramps
        The excitation's signal.
    omega : float
        Angular frequency of the drive in rad/s, of the first mode where the excitation has none.
    voltage : float
        Expected electrode voltage, V, within a factor of about ten.
    terms : Terms
        Terms of the effects.
    begins : dict of str to float
        Initial states, by name, SI: those of the steady state, else of the equilibrium.
    start : SteadyStart or None
        The steady state in which it begins.
    diodes : str or None
        Model of real diodes in a bridge.
    cold : bool
        Pulses of the switch need a control that the dc side powers.
    taken : tuple of int
        Numbers of the electrodes that have a shunt; of the first one are the circuit's voltage and current.
    resistance : float or None
        Of a load whose current effects may depend on, ohm: one that is a resistor at electrode 0.
    """

    transducer: Transducer
    excitation: Excitation
    signal: Tones | Ramps
    omega: float
    voltage: float
    terms: Terms
    begins: dict[str, float]
    start: SteadyStart | None = None
    diodes: str | None = None
    cold: bool = False
    taken: tuple[int, ...] = (0,)
    resistance: float | None = None

    @property
    def capacitance(self) -> float:
        """Clamped capacitance of the shunt's electrodes, F."""
        return self.transducer.all_electrodes[self.taken[0]].capacitance

    def across(self, number: int) -> float:
        """Initial voltage of the clamped capacitance of electrodes, V."""
        if number == 0 and self.taken[0] == 0:
            return self.initial("v_t")
        electrode = self.transducer.all_electrodes[number]
        moved = sum(coupling * self.initial(f"x{n}") for n, coupling in enumerate(electrode.couplings, 1))
        return (self.initial(f"q{number or ''}") - moved) / electrode.capacitance

    def of_other(self, other: Shunt) -> OperatingPoint:
        """The point as another shunt sees it, at further electrodes: its states under their own names."""
        prefix = f"electrode{other.electrode}_"
        own = {n.removeprefix(prefix): value for n, value in self.begins.items() if n.startswith(prefix)}
        return self._replace(begins=own, taken=(other.electrode,))

    def initial(self, name: str) -> float:
        """Initial value of a state, zero if it is none."""
        return self.begins.get(name, 0.0)

    def condition(self, name: str) -> str:
        """Initial condition of an element whose voltage or current is a state."""
        return f"IC={number(self.initial(name))}"

    @property
    def length(self) -> float:
        """Length of a non-periodic excitation in s."""
        assert self.excitation.length is not None
        return self.excitation.length

    @property
    def current(self) -> float:
        """Expected current through the clamped capacitance, A."""
        return self.omega * self.capacitance * self.voltage


class NetlistCircuit(NamedTuple):
    """Properties of a shunt's part of the netlist that the rest depends on.

    Attributes
    ----------
    harvested : str
        Expression of the power into the load, W.
    dc : str
        Expression of the voltage behind the bridge, V.
    fastest : float
        Length of the shortest pulse, s; infinite without pulses.
    slowest : float
        Longest time constant of the shunt, s.
    """

    harvested: str = "0"
    dc: str = "0"
    fastest: float = float("inf")
    slowest: float = 0.0


def estimate_operating_point(
    system: System, excitation: Excitation, dc_start: float, start: SteadyStart | None = None
) -> OperatingPoint:
    """Estimate the magnitudes of voltage and current in a system that begins in a steady state, or at rest."""
    transducer = system.transducer
    signal = excitation.signal()
    own = 2 * np.pi * transducer.open_circuit_frequency
    if isinstance(signal, Tones):
        frequencies, amplitudes = (
            signal.frequencies,
            np.broadcast_to(np.abs(signal.amplitudes), signal.frequencies.shape),
        )
        omega = 2 * np.pi * float(frequencies[np.argmax(amplitudes)])
        tones = [(2 * np.pi * f, a) for f, a in zip(frequencies, amplitudes, strict=True)]
    else:
        # A sudden load displaces a mode twice as far as a slow one.
        omega, tones = own, [(0.0, 2 * float(np.max(np.abs(signal.starts))))]
    voltage = sum(_voltage(system, excitation.base, w, a) for w, a in tones)
    # An endless signal without a period is refused with its length, below.
    record = None if excitation.period is not None else excitation.length or 0.0
    drive, loaded = "base_acceleration" if excitation.base else "force", system.shunt.loaded
    terms = Terms(transducer, drive, record=record, size=excitation.size, loaded=loaded)
    begins = start.values if start else _rest(system, excitation) | {"dc": dc_start}
    most = max(voltage, dc_start) or 1.0
    shunt, taken = system.shunt, system.shunt.taken
    resistance = shunt.resistance if isinstance(shunt, Resistor) and taken[0] == 0 else None
    return OperatingPoint(
        transducer, excitation, signal, omega, most, terms, begins, start, taken=taken, resistance=resistance
    )


def _rest(system: System, excitation: Excitation) -> dict[str, float]:
    """States in the equilibrium under the static part of the excitation, the electrodes relaxed."""
    first, *others = (Open(electrode=number) for number in system.shunt.taken)
    lowered = lower(System(system.transducer, replace(first, others=tuple(others))), excitation)
    values = lowered.program.equilibrium * lowered.program.scale
    return dict(zip(lowered.states, map(float, values), strict=True))


def _voltage(system: System, base: bool, omega: float, amplitude: float) -> float:
    """Open-circuit voltage at the displacement under the damping of a matched load, V."""
    charge, electrode = 0.0, system.electrode
    for mode, coupling in zip(system.transducer.all_modes, electrode.couplings, strict=True):
        gain = mode.base_mass if base else abs(mode.force_participation)
        loss = omega * mode.damping + coupling**2 / (2 * electrode.capacitance)
        elasticity = abs(mode.stiffness - mode.mass * omega**2 + 1j * loss)
        charge += abs(coupling) * gain * amplitude / elasticity
    return charge / electrode.capacitance
