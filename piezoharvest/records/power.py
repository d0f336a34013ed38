"""Power and energy from records, as in section IV.A of the reference paper, with the uncertainty from noise.

Velocity is the differentiated displacement; velocity and force pass the same third-order Butterworth low-pass (100 Hz),
so that both have the same delay. Energies are Simpson integrals of F x' (mechanical, absorbed) and v i (electrical,
delivered to the load). The energy that enters and returns within a cycle is kept apart from the net energy: in a stiff
specimen it is far more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter
from scipy.stats import norm

from piezoharvest.description.parameters import ParameterError
from piezoharvest.records.weights import gradient_transposed, simpson_weights, smooth, smooth_transposed

CUTOFF = 100.0
# Share of its range by which a drive has to leave its middle on either side before a crossing counts.
_DEAD_ZONE = 0.1


@dataclass(frozen=True, eq=False)
class Energy:
    """Energy through one port, for each of some intervals; arrays of shape (intervals,), J.

    Attributes
    ----------
    net : integral of the power
    supplied : integral of the power where it is positive
    returned : integral of the power where it is negative, without its sign: net = supplied - returned
    peak_power : largest power, W
    net_std, returned_std, supplied_std
        Standard uncertainties from the sensors' noise. Noise lets a power of zero take either sign, which
        makes `returned` and `supplied` too large; this expected bias is part of their uncertainty.
    """

    net: np.ndarray
    supplied: np.ndarray
    returned: np.ndarray
    peak_power: np.ndarray
    net_std: np.ndarray
    supplied_std: np.ndarray
    returned_std: np.ndarray


@dataclass(frozen=True, eq=False)
class PortPower:
    """Power at one port over a record, and its energies.

    Attributes
    ----------
    waveform : (n,) array
        W. The mechanical power is delayed by the low-pass.
    cycles, record : Energy
        For each cycle, and for the record as a whole (one interval).
    """

    waveform: np.ndarray
    cycles: Energy
    record: Energy


@dataclass(frozen=True, eq=False)
class PowerAnalysis:
    """Result of `analyse`.

    Attributes
    ----------
    boundaries : (cycles + 1,) array
        Of the cycles, s.
    velocity : (n,) array
        Filtered, m/s.
    mechanical, electrical : PortPower
        Absorbed by the specimen, and delivered to the load.
    """

    boundaries: np.ndarray
    velocity: np.ndarray
    mechanical: PortPower
    electrical: PortPower


def analyse(
    time: np.ndarray,
    force: np.ndarray,
    displacement: np.ndarray,
    voltage: np.ndarray,
    current: np.ndarray,
    *,
    frequency: float | None = None,
    sigma: Mapping[str, float] | None = None,
    cutoff: float = CUTOFF,
) -> PowerAnalysis:
    """Power and energy of a record.

    Parameters
    ----------
    time, force, displacement, voltage, current : (n,) array
        s, equally spaced; N; m; V; A (load current).
    frequency : float, optional
        Frequency of the drive, Hz, for the cycle boundaries, the first of which is the record's beginning; else these
        are where the force rises through its middle, and a record without two such instants is one cycle (a load step).
    sigma : mapping, optional
        Standard deviation of the white noise of "force", "displacement", "voltage", "current"; 0 unless given.
    cutoff : float
        Cut-off frequency of the low-pass, Hz.

    Raises
    ------
    ParameterError
        Arrays differ in length, are not finite or too short; the time is not equally spaced; the cut-off does not fit.
    """
    signals = {"force": force, "displacement": displacement, "voltage": voltage, "current": current}
    time, signals, step = _checked(time, signals, cutoff)
    noise = {name: float((sigma or {}).get(name, 0.0)) for name in signals}
    boundaries = cycle_boundaries(time, signals["force"], frequency, noise["force"])
    low_pass = np.asarray(butter(3, cutoff, fs=1.0 / step, output="sos"))
    velocity = smooth(low_pass, np.gradient(signals["displacement"], step))
    mechanical = _mechanical(signals["force"], velocity, noise["force"], noise["displacement"], low_pass, step)
    electrical = _electrical(signals["voltage"], signals["current"], noise["voltage"], noise["current"])

    def power(port: _PortPower) -> PortPower:
        return PortPower(port.power, _energy(port, time, boundaries), _energy(port, time, time[[0, -1]]))

    return PowerAnalysis(boundaries, velocity, power(mechanical), power(electrical))


def cycle_boundaries(
    time: np.ndarray, drive: np.ndarray, frequency: float | None = None, noise: float = 0.0
) -> np.ndarray:
    """Instants at which cycles begin and end.

    Parameters
    ----------
    time, drive : (n,) array
        s; any unit.
    frequency : float, optional
        Hz; cycles are counted from the first sample. If None, a cycle begins where the drive rises through the middle
        of its range; a crossing counts only if the drive goes from a tenth of the range below to a tenth above.
    noise : float
        Standard deviation of the drive's noise; a crossing must also go from five times this below to five times this
        above.

    Returns
    -------
    (cycles + 1,) array
        The ends of the record, if it does not contain a whole cycle.
    """
    ends = time[[0, -1]]
    if frequency is not None:
        if not 0 < frequency < np.inf:
            raise ParameterError("frequency", f"found {frequency}, must be a finite number greater than 0 Hz")
        count = int((time[-1] - time[0]) * frequency * (1 + 1e-9))
        return time[0] + np.arange(count + 1) / frequency if count else ends
    swing = drive - 0.5 * (drive.max() + drive.min())
    far = np.flatnonzero(np.abs(swing) > max(_DEAD_ZONE * np.ptp(drive), 5.0 * noise))
    rising = np.flatnonzero((swing[far[:-1]] < 0) & (swing[far[1:]] > 0))
    instants = []
    for last, first in zip(far[rising], far[rising + 1], strict=True):
        k = last + int(np.flatnonzero(swing[last:first] <= 0)[-1])
        instants.append(time[k] + (time[k + 1] - time[k]) * swing[k] / (swing[k] - swing[k + 1]))
    return np.array(instants) if len(instants) > 1 else ends


@dataclass(frozen=True, eq=False)
class _PortPower:
    """Power over a record (W), the standard deviation of its noise (W), and that of its integral with given weights."""

    power: np.ndarray
    noise: np.ndarray
    std: Callable[[np.ndarray], float]


def _electrical(voltage: np.ndarray, current: np.ndarray, of_voltage: float, of_current: float) -> _PortPower:
    def std(weights: np.ndarray) -> float:
        square = weights**2
        variance = square @ ((of_voltage * current) ** 2 + (of_current * voltage) ** 2)
        # The measured values contain noise themselves: without this term it would count twice.
        return float(np.sqrt(max(variance - (of_voltage * of_current) ** 2 * square.sum(), 0.0)))

    return _PortPower(voltage * current, np.hypot(of_voltage * current, of_current * voltage), std)


def _mechanical(
    force: np.ndarray, velocity: np.ndarray, of_force: float, of_displacement: float, low_pass: np.ndarray, step: float
) -> _PortPower:
    """Mechanical port of a raw force and a filtered velocity; noise of force and displacement before the filter."""
    force = smooth(low_pass, force)
    pulse = np.zeros(len(force))
    pulse[len(force) // 4] = 1.0
    of_velocity = of_displacement * float(np.linalg.norm(smooth(low_pass, np.gradient(pulse, step))))
    of_smooth_force = of_force * float(np.linalg.norm(smooth(low_pass, pulse)))

    def std(weights: np.ndarray) -> float:
        by_force = smooth_transposed(low_pass, weights * velocity)
        by_displacement = gradient_transposed(smooth_transposed(low_pass, weights * force), step)
        lengths = np.linalg.norm(by_force), np.linalg.norm(by_displacement)
        return float(np.hypot(of_force * lengths[0], of_displacement * lengths[1]))

    return _PortPower(force * velocity, np.hypot(force * of_velocity, velocity * of_smooth_force), std)


def _energy(port: _PortPower, time: np.ndarray, boundaries: np.ndarray) -> Energy:
    """Energies between boundaries."""
    step = (time[-1] - time[0]) / (len(time) - 1)
    to = [step * simpson_weights(len(time), (end - time[0]) / step) for end in boundaries]
    rows = []
    for weights, start, end in zip(np.diff(to, axis=0), boundaries[:-1], boundaries[1:], strict=True):
        back = np.minimum(port.power, 0.0)
        net, returned = weights @ port.power, -weights @ back
        # Expected power of the opposite sign that Gaussian noise causes.
        ratio = np.divide(np.abs(port.power), port.noise, out=np.full(len(time), 30.0), where=port.noise > 0)
        rectified = weights @ (port.noise * (norm.pdf(ratio) - ratio * norm.sf(ratio)))
        stds = [port.std(weights), *(np.hypot(port.std(weights * part), rectified) for part in (back == 0, back < 0))]
        within = (time >= start) & (time <= end)
        rows.append([net, net + returned, returned, port.power[within].max(), *stds])
    return Energy(*np.array(rows).T)


def _checked(
    time: np.ndarray, signals: Mapping[str, np.ndarray], cutoff: float
) -> tuple[np.ndarray, dict[str, np.ndarray], float]:
    """Time and signals as arrays of floats, and the sampling interval; raises `ParameterError`."""
    arrays = {name: np.asarray(values, float) for name, values in {"time": time, **signals}.items()}
    for name, values in arrays.items():
        if values.ndim != 1 or len(values) != len(arrays["time"]) or len(values) < 4:
            found = f"found an array of shape {values.shape}"
            raise ParameterError(
                name, f"{found}, must be one-dimensional, of four samples or more, as many as time has"
            )
        if not np.all(np.isfinite(values)):
            raise ParameterError(name, f"found {values[~np.isfinite(values)][0]}, allowed are finite numbers")
    time = arrays.pop("time")
    step = (time[-1] - time[0]) / (len(time) - 1)
    if not step > 0 or np.any(np.abs(np.diff(time) - step) > 1e-3 * step):
        raise ParameterError("time", "the samples are not equally spaced, but must be")
    if not 0 < cutoff < 0.5 / step:
        raise ParameterError("cutoff", f"found {cutoff} Hz, must be a frequency below {0.5 / step:g} Hz")
    return time, arrays, step
