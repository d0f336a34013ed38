"""Motion that begins under a preload with effects that bend: its first extremum is none of the beginning."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from piezoharvest import SSDI, NonlinearCoupling, SineForce, System, Transducer, simulate

MASS, DAMPING, STIFFNESS, COUPLING, CAPACITANCE = 0.01, 0.06, 1000.0, 1e-3, 4e-8
FORCE, FREQUENCY = 0.05, 45.0


def first_extremum(quadratic):
    """Time of the first extremum (s) of open electrodes under a preload and a sine, from rest: DOP853."""
    rest, omega = FORCE / STIFFNESS, 2 * math.pi * FREQUENCY

    def strain_charge(x):
        return COUPLING * x + quadratic * x**2

    def motion(t, y):
        voltage = (strain_charge(rest) - strain_charge(y[0])) / CAPACITANCE
        force = FORCE * (1 + math.sin(omega * t)) + (COUPLING + 2 * quadratic * y[0]) * voltage
        return y[1], (force - DAMPING * y[1] - STIFFNESS * y[0]) / MASS

    def stops(t, y):
        return y[1] if t > 1e-4 / FREQUENCY else 1.0

    found = solve_ivp(motion, (0, 1 / FREQUENCY), (rest, 0.0), "DOP853", events=stops, rtol=1e-12, atol=1e-16)
    return found.t_events[0][0]


@pytest.mark.parametrize("quadratic", [-2.0, 2.0])
def test_a_switch_acts_first_at_the_first_extremum(quadratic):
    effects = (NonlinearCoupling(quadratic_coupling=quadratic),)
    device = Transducer(
        mass=MASS, damping=DAMPING, stiffness=STIFFNESS, coupling=COUPLING, capacitance=CAPACITANCE, effects=effects
    )
    shunt = SSDI(inductance=0.01, quality=5.0)
    drive = SineForce(amplitude=FORCE, frequency=FREQUENCY, offset=FORCE)
    waves = simulate(System(device, shunt), drive, transient=1 / FREQUENCY, samples=4000).waveforms
    acts = np.flatnonzero(waves.current)[0]
    assert waves.time[acts - 1] <= first_extremum(quadratic) < waves.time[acts]
