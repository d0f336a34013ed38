"""Performance limits of a transducer with any interface: power limits, and the figures of its two-port."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from piezoharvest.description.excitation import Excitation, Tones
from piezoharvest.description.transducer import Transducer
from piezoharvest.linear import resonances


@dataclass(frozen=True)
class Limit:
    """Upper limit of the power of any interface in W, with its formula."""

    power: float
    formula: str


def hysteretic(transducer: Transducer) -> bool:
    """True if there is hysteresis of any effect."""
    return transducer.hysteresis is not None and transducer.hysteresis.stiffness > 0


def power_limit(transducer: Transducer, excitation: Excitation) -> Limit | None:
    """Upper limit of the power that any interface can extract from tones; None if it is unbounded or unknown.

    Notes
    -----
    The mean of F u - b u^2 is at most F^2/(8 b) for a sine of peak F, whatever the velocity u: the limit of REFERENCE
    section 3. Every mode takes its own share of the force, and tones of different frequencies add up; the sum over
    modes and tones is an upper limit, although it cannot always be reached.
    """
    square, words = _mean_square(excitation)
    if square is None:
        return None
    modes = transducer.all_modes
    gains = [mode.base_mass if excitation.base else mode.force_participation for mode in modes]
    driven = [(gain, mode.damping) for gain, mode in zip(gains, modes, strict=True) if gain]
    if not driven or min(damping for _, damping in driven) <= 0:
        return None
    total = sum(gain**2 / (4 * damping) for gain, damping in driven)
    formula = words.replace("F", "(m a)") if excitation.base else words
    return Limit(float(square * total), f"sum over modes of {formula}" if len(driven) > 1 else formula)


def _mean_square(excitation: Excitation) -> tuple[float | None, str]:
    """Mean square of the driving tones, and the limit's formula for one mode; None for other signals."""
    signal = excitation.signal() if excitation.period is not None else None
    if not isinstance(signal, Tones):
        return None, ""
    phasors: dict[float, complex] = {}
    for frequency, amplitude, phase in zip(*np.broadcast_arrays(*signal[:3]), strict=True):
        phasors[float(frequency)] = phasors.get(float(frequency), 0) + amplitude * np.exp(1j * phase)
    square = 0.5 * sum(abs(phasor) ** 2 for phasor in phasors.values())
    return float(square), "F²/(8 b)" if len(phasors) == 1 else "sum over tones of F²/(8 b)"


def white_input(transducer: Transducer, excitation: Excitation) -> float | None:
    """Power in W supplied by white noise of the excitation's density, whatever the shunt; None for other excitations.

    A white force of one-sided density S, intensity S/2, gives S/(4 m) to every mode (REFERENCE section 3).
    """
    psd = getattr(excitation, "psd", None)
    if psd is None:
        return None
    gains = [(m.base_mass if excitation.base else m.force_participation, m.mass) for m in transducer.all_modes]
    return float(psd * sum(gain**2 / (4 * mass) for gain, mass in gains))


@dataclass(frozen=True)
class ModeFigures:
    """Figures of one mode's two-port; frequencies in Hz.

    Attributes
    ----------
    short_circuit, open_circuit : float
        Undamped resonances with the electrodes 0 shorted and open, further ones open.
    all_shorted : float
        That with all electrodes shorted: the mode's alone, but for hysteresis that sticks.
    coupling_squared : float
        k_e^2 = (w_oc^2 - w_sc^2)/w_sc^2.
    quality : float
        Mechanical quality Q_m = sqrt(k m)/b, infinite without damping.
    """

    short_circuit: float
    open_circuit: float
    all_shorted: float
    coupling_squared: float
    quality: float

    @property
    def merit(self) -> float:
        """k_e^2 Q_m: from 2 on a resistor reaches the limit of power, from pi on a rectifier."""
        return self.coupling_squared * self.quality


def mode_figures(transducer: Transducer, operating_point: str = "stick") -> tuple[ModeFigures, ...]:
    """Figures of all modes; `operating_point` is "stick" or "slip", the state of the hysteresis."""
    found = resonances(transducer, operating_point=operating_point)
    short, opened = found.short_circuit.undamped, found.open_circuit.undamped
    # With shorts across them, further electrodes add nothing to the stiffness: as if there were none.
    alone = dataclasses.replace(transducer, electrodes=())
    shorted = resonances(alone, operating_point=operating_point).short_circuit.undamped
    modes = sorted(transducer.all_modes, key=lambda mode: mode.stiffness / mode.mass)
    quality = [
        np.sqrt(mode.stiffness * mode.mass) / mode.damping if mode.damping > 0 else float("inf") for mode in modes
    ]
    return tuple(
        ModeFigures(float(sc), float(oc), float(all_sc), float((oc**2 - sc**2) / sc**2), float(q))
        for sc, oc, all_sc, q in zip(short, opened, shorted, quality, strict=True)
    )
