"""Events of signals that are small beside what else is in the state: what is rounding is judged by their own terms."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from piezoharvest import SICE, Mode, Rectifier, SineBase, SineForce, System, Transducer, simulate


def test_extrema_far_below_the_drop_of_the_diodes_are_found():
    """A random study: 3 nV beside diodes of 0.26 V that never conduct, so that of SICE the inversions are left."""
    m, b, k, coupling, c = 1.7289e-06, 8.688e-04, 5.3867350e09, 3.6933446, 3.740795e-07
    loop, resistance, force, omega = 2.98284e-16, 5.34e-05, 1.03777e-05, 2 * math.pi * 263564.833
    device = Transducer(mass=m, damping=b, stiffness=k, coupling=coupling, capacitance=c)
    shunt = SICE(inductance=loop, quality=math.sqrt(loop / c) / resistance, diode_drop=0.26, hold_off=0.0)
    drive = SineForce(amplitude=force, frequency=omega / (2 * math.pi), offset=force)
    waves = simulate(System(device, shunt), drive, transient=2.5 / drive.frequency, samples=640).waveforms

    # Deviation from rest (x, u, charge, current of the loop), with the drive's sine and cosine.
    motion = [-(k + coupling**2 / c) / m, -b / m, coupling / c / m, 0, force / m, 0]
    sine, cosine = [0, 0, 0, 0, 0, omega], [0, 0, 0, 0, -omega, 0]
    still = np.array([[0, 1, 0, 0, 0, 0], motion, [0] * 6, [0] * 6, sine, cosine])
    swings = np.array([*still[:2], [0, 0, 0, -1, 0, 0],
                       [-coupling / c / loop, 0, 1 / c / loop, -resistance / loop, 0, 0], sine, cosine])  # fmt: skip
    damped = math.sqrt(1 / (loop * c) - (resistance / (2 * loop)) ** 2)
    charging = math.atan2(damped, -resistance / (2 * loop)) / damped  # until the coil would have emptied the electrodes
    found, closes = _with_actions(still, swings, math.pi / damped, charging, waves.time, rising=force / m)
    assert len(closes) > 40  # the structure rings 34 times as fast as the drive
    voltage = (found[:, 2] - coupling * found[:, 0]) / c
    outside = np.array([np.all(np.abs(closes - t) > 1e-3 / drive.frequency) for t in waves.time])
    np.testing.assert_allclose(waves.voltage[outside], voltage[outside], rtol=0, atol=1e-5 * np.abs(voltage).max())


def _with_actions(still, swings, on_time, charging, times, rising):
    """States at instants, and when the switch closes: after a minimum for a swing, after a maximum for nothing."""
    y, now, side, actions = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), 0.0, math.copysign(1.0, rising), []
    found, step, blind = np.empty((len(times), 6)), times[1] / 16, 0.0
    found[0] = y
    whole = expm(still * step)
    for n, end in enumerate(times[1:], 1):
        while end - now > 1e-9 * step:
            length = min(step, end - now)
            ahead = (whole if length == step else expm(still * length)) @ y
            if side * ahead[1] >= 0.0:
                y, now = ahead, now + length
                continue
            at = brentq(lambda t, y=y: (expm(still * t) @ y)[1], 0.0, length, xtol=1e-14 * times[-1])
            y, now, kind, side = expm(still * at) @ y, now + at, side, -side
            if now < blind:
                continue
            actions.append(now)
            blind = now + (charging if kind > 0 else on_time)
            if kind < 0:
                y, now = expm(swings * on_time) @ y, blind
                y[3] = 0.0
        found[n] = expm(still * (end - now)) @ y
    return found, np.array(actions)


def test_a_bridge_does_not_conduct_backwards_behind_a_tiny_capacitor():
    """A random study, simplified: the current is a millionth of what the open voltage would drive, and is rectified."""
    device = Transducer(
        mass=1.06e-4, damping=19.8, stiffness=0.2304, coupling=1.126e-10, capacitance=2.793e-13,
        modes=(Mode(mass=8.82e-10, damping=324982.0, stiffness=0.0487, coupling=1.2984e-13, force_participation=1.0),),
    )  # fmt: skip
    leak = 9.7565e-08
    shunt = Rectifier(smoothing_capacitance=5.8927e-17, load_resistance=1 / leak, diode_leakage=3.959e-11)
    drive = SineBase(amplitude=4.808e6, frequency=0.019657)
    waves = simulate(System(device, shunt), drive, transient=8 / drive.frequency, samples=64).waveforms

    # The voltage acts back on the motion by 1e-13, and the capacitors follow the current within 3e-6 of 8 s.
    first, second, omega = *device.all_modes, 2 * math.pi * drive.frequency

    def motion(t, y):
        push = -drive.amplitude * math.sin(omega * t)
        return [part for x, u, mode in ((*y[:2], first), (*y[2:], second))
                for part in (u, push - (mode.damping * u + mode.stiffness * x) / mode.mass)]  # fmt: skip

    found = solve_ivp(motion, (0, waves.time[-1]), np.zeros(4), "Radau", t_eval=waves.time, rtol=1e-9, atol=1e-12)
    current = -(first.coupling * found.y[1] + second.coupling * found.y[3])
    voltage = current / (leak + 2 * shunt.diode_leakage)
    near = np.abs(voltage) < 1e-2 * np.abs(voltage).max()  # of zero, where diodes block for a moment
    assert near.mean() < 0.02
    np.testing.assert_allclose(waves.dc_voltage[~near], np.abs(voltage)[~near], rtol=0, atol=1e-5 * voltage.max())


@pytest.mark.parametrize("drop", [1e-3, 1.0, 1e3])
def test_what_never_conducts_changes_nothing(drop):
    """The drop of diodes that stay blocked may be any number of decades above the voltage."""
    device = Transducer(mass=0.01, damping=0.05, stiffness=1000.0, coupling=1e-3, capacitance=4e-8)
    drive = SineForce(amplitude=1e-12, frequency=50.0, offset=1e-12)

    def voltage(drop):
        system = System(device, SICE(inductance=0.01, quality=5.0, diode_drop=drop))
        return simulate(system, drive, transient=0.2, samples=64).waveforms.voltage

    least = voltage(1e-6)
    assert 0.0 < np.abs(least).max() < 1e-6
    np.testing.assert_allclose(voltage(drop), least, rtol=0, atol=1e-9 * np.abs(least).max())
