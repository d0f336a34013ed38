"""Results of a simulation."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from piezoharvest.description.excitation import Excitation, SineBase, SineForce
from piezoharvest.description.transducer import Transducer


@dataclass(frozen=True, eq=False)
class Waveforms:
    """Signals on a common time base, in SI units and the signs of docs/equations.md.

    Attributes
    ----------
    time : (n,) array
        s; one period in the steady state, the whole run in a transient.
    drive : (n,) array
        Force in N, or base acceleration in m/s^2.
    displacement, velocity : (n,) array
        Participation-weighted sum of the modes, m and m/s.
    voltage, current : (n,) array
        Electrode voltage v_p in V and load current i = -dq_p/dt (less what effects draw) in A.
    charge : (n,) array
        q_p in C.
    hysteresis_voltage : (n,) array
        v_h in V.
    dc_voltage : (n,) array
        Behind the bridge, V; zero without a bridge.
    acceleration : (n,) array
        Second derivative of the displacement, m/s^2.
    event_times : (e,) array
        s, increasing.
    event_names : tuple of str
        "switch closes", "switch opens", "diodes conduct", "diodes block", "voltage extracted", "hysteresis slips" or
        "hysteresis sticks", one for each event time.
    """

    time: np.ndarray
    drive: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    voltage: np.ndarray
    current: np.ndarray
    charge: np.ndarray
    hysteresis_voltage: np.ndarray
    dc_voltage: np.ndarray
    acceleration: np.ndarray
    event_times: np.ndarray
    event_names: tuple[str, ...]

    def __eq__(self, other: object) -> bool:
        """True if all samples and events are equal; NaN equals NaN."""
        if not isinstance(other, Waveforms):
            return NotImplemented
        return self.event_names == other.event_names and all(
            np.array_equal(getattr(self, each.name), getattr(other, each.name), equal_nan=True)
            for each in fields(self)
            if each.name != "event_names"
        )


@dataclass(frozen=True)
class Response:
    """Outcome of one simulation: averages over one period, or over the whole of a transient.

    Attributes
    ----------
    shunt : str
        Kind of the shunt.
    converged : bool
        The steady state was reached (a transient: it ran to its end) and energy closes.
    message : str
        Remarks: the reason why it did not converge, an unstable steady state, ...; may be empty.
    period : float
        Period in s, or the length of the transient.
    harvested_power, mechanical_power : float
        Mean power into the load, and mean power that the excitation delivers, W.
    displacement_amplitude, voltage_amplitude : float
        Half of peak to peak, m and V.
    dc_voltage : float
        Mean voltage behind the bridge, V.
    attenuation_db : float
        20 log10 of the displacement amplitude relative to the short circuit; NaN if there is none, with the reason in
        `message`.
    energy : dict
        Per period in J: "mechanical_in", "harvested", "damping", "hysteresis", "shunt_loss", where they occur "source"
        (delivered by an active part) and the energy that each effect takes by its name (negative for a source);
        "stored" (change, transients only) and "closure" (relative imbalance of these entries).
    events_per_period : int
        Changes of the circuit's configuration and of the hysteresis operators.
    periods_evaluated : int
        Periods simulated to find the result.
    displacement_rms : float or None
        Root mean square of the displacement about its mean, m; None but for noise and recorded signals.
    standard_error : dict or None
        Standard errors of "harvested_power" (W) and "displacement_rms" (m), as averages of a piece of a stationary
        signal, by batch means; NaN where the run is shorter than nine decays of the motion. None for other excitations.
    figure_of_merit : float
        P/(C V_oc^2 f): see `figure_of_merit`; NaN but in the steady state of one mode under a sine.
    exhausted : bool
        The simulation was stopped because it exceeded the work limit (`engine.work_limit`).
    """

    shunt: str
    converged: bool
    message: str
    period: float
    harvested_power: float
    mechanical_power: float
    displacement_amplitude: float
    voltage_amplitude: float
    dc_voltage: float
    attenuation_db: float
    energy: dict[str, float]
    events_per_period: int
    periods_evaluated: int
    waveforms: Waveforms | None = field(default=None, repr=False)
    exhausted: bool = False
    displacement_rms: float | None = None
    standard_error: dict[str, float] | None = None
    figure_of_merit: float = float("nan")

    @property
    def efficiency(self) -> float:
        """Harvested over mechanical power, P_out/P_in; 0 where no power comes in."""
        return self.harvested_power / self.mechanical_power if self.mechanical_power > 0 else 0.0


def has_merit(transducer: Transducer, excitation: Excitation) -> bool:
    """True if there is a figure of merit: for one mode under one sine."""
    return not transducer.modes and isinstance(excitation, SineForce | SineBase)


def figure_of_merit(power: Any, displacement: Any, transducer: Transducer, excitation: Excitation) -> Any:
    """Harvested power over C V_oc^2 f, what a bridge with ideal diodes harvests at most where the coupling is weak.

    V_oc = T U/C is the voltage of open electrodes at the displacement amplitude U that the circuit leaves: the figure
    compares circuits at the same motion, and does not count what they take of it (Ramadass & Chandrakasan 2010;
    Sanchez et al., IEEE J. Solid-State Circuits 51(12), 2016).

    Parameters
    ----------
    power, displacement : float or array
        W, m.

    Returns
    -------
    float or array
        NaN where nothing moves, and for further modes or an excitation that is not one sine.
    """
    if not has_merit(transducer, excitation):
        return np.nan * np.asarray(power)
    assert isinstance(excitation, SineForce | SineBase)  # has_merit
    coupling, capacitance, frequency = (
        np.squeeze(value, axis=-1) if np.ndim(value) else value
        for value in (transducer.coupling, transducer.capacitance, excitation.frequency)
    )
    with np.errstate(all="ignore"):  # the motion of what is unstable has any size
        unit = (coupling * np.asarray(displacement, dtype=float)) ** 2 / capacitance * frequency
        return np.where(unit > 0, power / unit, np.nan)
