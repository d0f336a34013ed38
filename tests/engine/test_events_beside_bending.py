"""An extremum is located to rounding where a smooth element's output outgrows the states and bends fast."""

import numpy as np
from scipy.integrate import solve_ivp

from piezoharvest import SSDV, NonlinearCoupling, SineForce, System, Transducer, simulate

# The motion makes the coupling's quadratic part 3e4 times the linear one. The slopes and second derivatives of its
# output, which no guard's value has, are then 1e8 times the output: a rounding error of that size hid zeros.
MASS, DAMPING, STIFFNESS = 9.4894248, 0.14334214, 4.9138822e-4
COUPLING, CAPACITANCE = 4.1745307e-4, 1.6682012e-7
QUADRATIC, FORCE, FREQUENCY, HOLD_OFF = 7.93548037e-9, 10926.198, 0.051162379, 4.8
INDUCTANCE, QUALITY, SOURCE, ON_TIME_ERROR, THRESHOLD = 3360767.0, 9423.6088, 3.556816e9, 0.23094042, 1.7639133e7


def closings(count):
    """Times (s) of the first actions of the switch, from rest: DOP853 from event to event."""
    resistance = np.sqrt(INDUCTANCE / CAPACITANCE) / QUALITY
    rate = resistance / (2 * INDUCTANCE)
    on_time = (1 + ON_TIME_ERROR) * np.pi / np.sqrt(1 / (INDUCTANCE * CAPACITANCE) - rate**2)

    def motion(t, y, closed, source):
        x, v, voltage, current = y.tolist()
        slope = COUPLING + 2 * QUADRATIC * x
        force = FORCE * np.sin(2 * np.pi * FREQUENCY * t) + slope * voltage
        into = current if closed else 0.0
        bend = -(voltage + source + resistance * current) / INDUCTANCE if closed else 0.0
        return v, (force - DAMPING * v - STIFFNESS * x) / MASS, (into - slope * v) / CAPACITANCE, bend

    def stops(t, y, *closed):
        return y[1]

    def run(begin, end, state, closed, source, events=None):
        return solve_ivp(motion, (begin, end), state, "DOP853", args=(closed, source), events=events, rtol=1e-12,
                         atol=1e-9, dense_output=True)  # fmt: skip

    found, now, last, state = [], 0.0, 0.0, np.zeros(4)
    while len(found) < count:
        rest = run(now, now + 2 / FREQUENCY, state, False, 0.0, stops)
        k = next(
            k for k, t in enumerate(rest.t_events[0]) if t > last + HOLD_OFF and abs(rest.y_events[0][k][2]) > THRESHOLD
        )
        now = last = rest.t_events[0][k]
        state = rest.y_events[0][k]
        found.append(now)
        loop = run(now, now + on_time, state, True, np.sign(state[2]) * SOURCE)
        now, state = now + on_time, np.append(loop.y[:3, -1], 0.0)
    return np.array(found)


def test_a_switch_acts_at_the_extremum_where_a_coupling_bends_fast():
    device = Transducer(
        mass=MASS, damping=DAMPING, stiffness=STIFFNESS, coupling=COUPLING, capacitance=CAPACITANCE,
        effects=(NonlinearCoupling(quadratic_coupling=QUADRATIC),),
    )  # fmt: skip
    shunt = SSDV(inductance=INDUCTANCE, quality=QUALITY, detector_threshold=THRESHOLD, on_time_error=ON_TIME_ERROR,
                 hold_off=HOLD_OFF, source_voltage=SOURCE)  # fmt: skip
    drive = SineForce(amplitude=FORCE, frequency=FREQUENCY)
    waves = simulate(System(device, shunt), drive, transient=1.6 / FREQUENCY, samples=64).waveforms
    acts = waves.event_times[[name == "switch closes" for name in waves.event_names]]
    np.testing.assert_allclose(acts[:4], closings(4), rtol=1e-9)
