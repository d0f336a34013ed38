"""What a sensor shows of another channel through a filter: between amplifiers, or of a structure that it hangs on."""

import numpy as np
import pytest
from diagnose.swept import campaign
from scipy.signal import lsim

from piezoharvest.description.effects.nameless.memory import Relaxation, Resonance
from piezoharvest.diagnose import diagnose

SIZE = 2e-6  # m/V
TIME_CONSTANT, FREQUENCY, DAMPING = 2e-3, 120.0, 0.05  # s, Hz
OMEGA = 2.0 * np.pi * FREQUENCY


def found_in(numerator, denominator, seed):
    """Law in the displacement's reading, which has the voltage filtered by a transfer function in it."""

    def crosstalk(time, voltage):
        return SIZE * lsim((numerator, denominator), voltage, time)[1]

    found = diagnose(campaign("white", seed, crosstalk=crosstalk))
    assert found.verdict == "new_effect", (found.verdict, found.effects)
    (discovery,) = found.discovery
    assert (discovery.law.place.name, discovery.law.place.input) == ("reading.displacement", "voltage")
    assert discovery.gain > 0.95
    return discovery.law


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_low_frequencies_of_the_voltage(seed):
    law = found_in([1.0], [TIME_CONSTANT, 1.0], seed)
    assert isinstance(law.memory, Relaxation) and not law.memory.behind
    assert law.memory.time_constant == pytest.approx(TIME_CONSTANT, rel=0.02)
    assert law.form.factor == pytest.approx(SIZE, rel=0.02)


@pytest.mark.slow
def test_high_frequencies_of_the_voltage():
    law = found_in([TIME_CONSTANT, 0.0], [TIME_CONSTANT, 1.0], 3)
    assert isinstance(law.memory, Relaxation) and law.memory.behind  # its lag minus the voltage
    assert law.memory.time_constant == pytest.approx(TIME_CONSTANT, rel=0.02)
    assert law.form.factor == pytest.approx(-SIZE, rel=0.02)


def test_a_resonance_that_the_voltage_excites():
    law = found_in([OMEGA**2], [1.0, 2.0 * DAMPING * OMEGA, OMEGA**2], 4)
    assert isinstance(law.memory, Resonance)
    assert law.memory.frequency == pytest.approx(FREQUENCY, rel=2e-3)
    assert law.memory.damping_ratio == pytest.approx(DAMPING, rel=0.03)
    assert law.form.factor == pytest.approx(SIZE, rel=0.02)
