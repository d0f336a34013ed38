"""Powers of the linear, quasi-static transducer in closed form: far below resonance, force is all that moves it.

With d = T/k and the free capacitance C + T^2/k the leads carry i = d F' + C_free v', and the specimen's displacement is
F/k - d v, with v the voltage that a rising force makes. Beside the load there may be a leak and slow polarisation. All
arguments of a row are arrays over rows. The engine gives the same numbers (tests/test_paper.py).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_RAMP = np.linspace(0.0, 1.0, 129)
_CYCLE = np.linspace(0.0, 2 * np.pi, 721)


class Circuit(NamedTuple):
    """Linear transducer seen from its leads.

    Attributes
    ----------
    charge : float
        d = T/k, C/N.
    capacitance : float
        Free capacitance C + T^2/k, F.
    leak : float
        Conductance beside the load, S.
    slow_capacitance, slow_time : float
        Series R-C branch across the leads: its capacitance (F) and time constant (s).
    """

    charge: float
    capacitance: float
    leak: float = 0.0
    slow_capacitance: float = 0.0
    slow_time: float = 1.0

    def voltage_per_force(self, frequency: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Complex voltage over force of a sine, V/N."""
        s = 2j * np.pi * frequency
        slow = self.slow_capacitance * s / (1 + self.slow_time * s)
        return self.charge * s / (1 / load + self.leak + self.capacitance * s + slow)

    def modes(self, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poles and residues, (rows, 2), of voltage over charge rate, (1 + t s)/((g + C s)(1 + t s) + C_slow s)."""
        t, conductance = self.slow_time, 1 / load + self.leak
        a = self.capacitance * t
        b = t * conductance + self.capacitance + self.slow_capacitance
        # The larger root without cancellation, the other from their product.
        large = -(b + np.sqrt(b * b - 4 * a * conductance)) / (2 * a)
        poles = np.stack([large, conductance / (a * large)], axis=-1)
        return poles, (1 + t * poles) / (a * (poles - poles[:, ::-1]))


class Contact(NamedTuple):
    """Displacement that the sensor reads, of specimen (with shorted leads) and joint.

    Attributes
    ----------
    compliance : float
        1/k of the specimen, m/N.
    hertz : float
        Joint that adds hertz F^(2/3), m/N^(2/3).
    seat, seat_force : float
        Joint that adds seat (1 - exp(-F/seat_force)), m and N.
    cubic : float
        Of the specimen itself: x = compliance F (1 - cubic F^2), 1/N^2.
    """

    compliance: float
    hertz: float = 0.0
    seat: float = 0.0
    seat_force: float = 1.0
    cubic: float = 0.0

    def displacement(self, force: np.ndarray) -> np.ndarray:
        """Displacement at a force >= 0, m."""
        own = self.compliance * force * (1 - self.cubic * force**2)
        return own + self.hertz * np.cbrt(force) ** 2 - self.seat * np.expm1(-force / self.seat_force)


def sine(circuit: Circuit, amplitude: np.ndarray, frequency: np.ndarray, load: np.ndarray) -> tuple[np.ndarray, ...]:
    """Energy of one period (J) and peak power (W) in the load under a force of the given amplitude (N)."""
    peak = np.abs(amplitude * circuit.voltage_per_force(frequency, load)) ** 2 / load
    return peak / (2 * frequency), peak


def _ramp_gains(circuit: Circuit, height: np.ndarray, load: np.ndarray, rise_time: float):
    """Poles, and gains with which the voltage on a ramp of the force is sum gain (1 - exp(pole t)), (rows, 2) each."""
    poles, residues = circuit.modes(load)
    return poles, -circuit.charge * (height / rise_time)[:, None] * residues / poles


def step(
    circuit: Circuit, height: np.ndarray, load: np.ndarray, rise_time: float, hold: float
) -> tuple[np.ndarray, ...]:
    """Energy (J) of a step held for `hold` s and released, and peak power (W), in the load; ramps of `rise_time` s."""
    poles, gain = _ramp_gains(circuit, height, load, rise_time)
    left = -gain * np.expm1(poles * rise_time)  # after the ramp v = sum left exp(pole t)
    pair = poles[:, :, None] + poles[:, None, :]
    bow = np.expm1(poles * rise_time) / poles
    on_ramp = rise_time - bow[:, :, None] - bow[:, None, :] + np.expm1(pair * rise_time) / pair
    held = np.expm1(pair * (hold - rise_time)) / pair
    squares = gain[:, :, None] * gain[:, None, :] * on_ramp + left[:, :, None] * left[:, None, :] * held
    voltage = _ramp_voltage(poles, gain, rise_time)
    return 2 * squares.sum(axis=(1, 2)) / load, np.max(voltage**2, axis=1) / load


def _ramp_voltage(poles: np.ndarray, gain: np.ndarray, rise_time: float) -> np.ndarray:
    """Voltage along a ramp, (rows, times)."""
    return np.einsum("ni,nit->nt", gain, -np.expm1(poles[:, :, None] * rise_time * _RAMP))


def sine_by_magnitude(
    contact: Contact, circuit: Circuit, low: np.ndarray, high: np.ndarray, frequency: np.ndarray, load: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Integral of |F x'| over one period (J), and peak of F x' (W), of a force between low and high (N)."""
    half = 0.5 * (high - low)
    force = (0.5 * (high + low))[:, None] + half[:, None] * np.sin(_CYCLE)
    phasor = half * circuit.charge * circuit.voltage_per_force(frequency, load)
    back = np.imag(phasor[:, None] * np.exp(1j * _CYCLE))
    power = force * np.gradient(contact.displacement(force) - back, _CYCLE, axis=1)
    return np.trapezoid(np.abs(power), _CYCLE, axis=1), 2 * np.pi * frequency * np.max(power, axis=1)


def step_by_magnitude(
    contact: Contact, circuit: Circuit, height: np.ndarray, load: np.ndarray, rise_time: float
) -> tuple[np.ndarray, np.ndarray]:
    """Integral of |F x'| over load, hold and release (J), and peak of F x' (W), of a force from zero to height (N)."""
    poles, gain = _ramp_gains(circuit, height, load, rise_time)
    back = circuit.charge * _ramp_voltage(poles, gain, rise_time)
    force = height[:, None] * _RAMP
    reading = contact.displacement(force)
    loading, release = reading - back, reading[:, ::-1] + back
    work = np.trapezoid(force, loading, axis=1) - np.trapezoid(force[:, ::-1], release, axis=1)
    # While the force is held the voltage goes, and the specimen yields as far as it was held back.
    work += height * np.abs(back[:, -1])
    return work, np.max(force * np.gradient(loading, rise_time * _RAMP, axis=1), axis=1)
