"""Results of a simulation."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from piezoharvest.description.excitation import Excitation, SineBase, SineForce
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.notebook import Row, Shown, axes_for, extent, frame

# Figures of a response with their units, as notebooks show them.
_FIGURES = {
    "harvested_power": "W", "mechanical_power": "W", "efficiency": "", "figure_of_merit": "",
    "displacement_amplitude": "m", "voltage_amplitude": "V", "dc_voltage": "V", "attenuation_db": "dB", "period": "s",
    "displacement_rms": "m",
}  # fmt: skip
# Signals of waveforms with their units.
_UNITS = {
    "time": "s", "drive": "N or m/s^2", "displacement": "m", "velocity": "m/s", "voltage": "V", "current": "A",
    "charge": "C", "hysteresis_voltage": "V", "dc_voltage": "V", "acceleration": "m/s^2",
}  # fmt: skip

FAILED = "simulation failed:"  # begins the message of a response without results, whose figures are all 0


@dataclass(frozen=True, eq=False, repr=False)
class Waveforms(Shown):
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
        One for each event time: "switch closes", "switch opens", "switch steps on", "controller acts",
        "diodes conduct", "diodes block", "voltage extracted", "hysteresis slips", "hysteresis sticks",
        "supply turns on", "supply turns off", "store is full", "packet is sent",
        "switch is powered" or "switch loses its power".
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

    @property
    def heading(self) -> str:
        """How many samples and events it has, and over which time."""
        n, events = len(self.time), len(self.event_times)
        span = f" over {self.time[-1] - self.time[0]:.4g} s" if n else ""
        return f"{n} sample{'' if n == 1 else 's'}{span}, {events} event{'' if events == 1 else 's'}"

    @property
    def rows(self) -> list[Row]:
        """The range of each signal."""
        return [extent(name, unit, getattr(self, name)) for name, unit in _UNITS.items()]

    def to_frame(self) -> Any:
        """The signals over the time (s) as a `pandas.DataFrame`, in SI units; raises `ImportError`."""
        return frame({name: getattr(self, name) for name in _UNITS}).set_index("time")

    def __eq__(self, other: object) -> bool:
        """True if all samples and events are equal; NaN equals NaN."""
        if not isinstance(other, Waveforms):
            return NotImplemented
        return self.event_names == other.event_names and all(
            np.array_equal(getattr(self, each.name), getattr(other, each.name), equal_nan=True)
            for each in fields(self)
            if each.name != "event_names"
        )


@dataclass(frozen=True, repr=False)
class Response(Shown):
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
    energy_stored : float or None
        Energy in the smoothing capacitor at the end of the run, J; None without one.
    time_to_turn_on : float or None
        Time after which the supply of a storage turned on first, s; None where it did not, and in a steady state.
    wakes_per_hour : float or None
        How often it turned on, for each hour; None without a storage.
    packets_per_hour : float or None
        How many packets its load sent, for each hour; None without a load that has phases.
    time_to_start : float or None
        Time after which the control of a switch that the dc side powers worked first, s; None as `time_to_turn_on`.
    least_switching_voltage : float or None
        Amplitude of the open-circuit voltage above which a switch that powers itself acts, V; None for other switches.
    adapted_inductance : float or None
        Inductance of a coil that adapts itself, at the end of the run, H; None for other circuits.
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
    energy_stored: float | None = None
    time_to_turn_on: float | None = None
    wakes_per_hour: float | None = None
    packets_per_hour: float | None = None
    time_to_start: float | None = None
    least_switching_voltage: float | None = None
    adapted_inductance: float | None = None

    @property
    def heading(self) -> str:
        """Kind of the shunt, power, displacement, and whether to trust them."""
        trusted = "converged" if self.converged else f"not to be trusted: {self.message or 'did not converge'}"
        return f"{self.shunt}, {self.harvested_power:.4g} W, {self.displacement_amplitude:.4g} m, {trusted}"

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The figures, one a row."""
        found = [{"figure": name, "value": getattr(self, name), "unit": unit} for name, unit in _FIGURES.items()]
        return [row for row in found if row["value"] is not None]

    def to_frame(self) -> Any:
        """Waveforms as a `pandas.DataFrame` over the time in s; the figures where there are none."""
        if self.waveforms is None:
            return super().to_frame()
        return self.waveforms.to_frame()

    def plot(self, ax: Any = None) -> Any:
        """Draw the voltages over time into axes of matplotlib, or, in a new figure, the displacement above them.

        Returns
        -------
        Axes or list of Axes
            The axes given, or those of the new figure.

        Raises
        ------
        ValueError
            The response has no waveforms.
        """
        if self.waveforms is None:
            raise ValueError("this response has no waveforms to plot")
        waveforms, axes = self.waveforms, axes_for(ax, 2, sharex=True)
        if ax is None:
            axes[0].plot(waveforms.time, waveforms.displacement)
            axes[0].set_ylabel("displacement in m")
        axes[-1].plot(waveforms.time, waveforms.voltage, label="electrodes")
        if np.any(waveforms.dc_voltage):
            axes[-1].plot(waveforms.time, waveforms.dc_voltage, label="behind the bridge")
            axes[-1].legend()
        axes[-1].set(xlabel="time in s", ylabel="voltage in V")
        return ax if ax is not None else axes

    @property
    def efficiency(self) -> float:
        """Harvested over mechanical power, P_out/P_in; 0 where no power comes in."""
        return self.harvested_power / self.mechanical_power if self.mechanical_power > 0 else 0.0


def has_merit(transducer: Transducer, excitation: Excitation) -> bool:
    """True if there is a figure of merit: for one mode under one sine."""
    return not transducer.modes and isinstance(excitation, SineForce | SineBase)


def figure_of_merit(power: Any, displacement: Any, system: System, excitation: Excitation) -> Any:
    """Harvested power over C V_oc^2 f, what a bridge with ideal diodes harvests at most where the coupling is weak.

    V_oc = T U/C is the voltage of open electrodes at the amplitude U of the mode that the circuit leaves: the figure
    compares circuits at the same motion, and does not count what they take of it (Ramadass & Chandrakasan 2010;
    Sanchez et al., IEEE J. Solid-State Circuits 51(12), 2016).

    Parameters
    ----------
    power, displacement : float or array
        W, m; the displacement is that which is read.

    Returns
    -------
    float or array
        NaN where nothing moves, and for further modes or an excitation that is not one sine.
    """
    if not has_merit(system.transducer, excitation):
        return np.nan * np.asarray(power)
    assert isinstance(excitation, SineForce | SineBase)  # has_merit
    electrode, seen = system.electrode, system.transducer.all_modes[0].seen
    coupling, capacitance, seen, frequency = (
        np.squeeze(value, axis=-1) if np.ndim(value) else value
        for value in (electrode.couplings[0], electrode.capacitance, seen, excitation.frequency)
    )
    with np.errstate(all="ignore"):  # the motion of what is unstable has any size
        unit = (coupling * np.asarray(displacement, dtype=float) / seen) ** 2 / capacitance * frequency
        return np.where(unit > 0, power / unit, np.nan)
