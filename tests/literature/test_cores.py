"""Coils with a core loss in switched circuits: the loop by itself as a matrix exponential."""

import math

import numpy as np
import pytest
from messages import is_sentence
from scipy.linalg import expm
from scipy.optimize import brentq

from piezoharvest import SineForce, System, Transducer, simulate
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import DSSH, SECE, SICE, SSDS, BiasFlip, ParallelSSHI, SeriesSSHI

# So weakly coupled (k_e^2 = 1e-12) that no shunt can change the displacement; flips of a 1e-5th of the period.
FREQUENCY, CAPACITANCE, COUPLING = 20.0, 40e-9, 2e-7
OMEGA = 2 * math.pi * FREQUENCY
DRIVE = SineForce(amplitude=100.0, frequency=FREQUENCY)
STIFF = Transducer(mass=0.63, damping=480.0, stiffness=1e6, coupling=COUPLING, capacitance=CAPACITANCE)
V_OC = COUPLING * 100.0 / abs(1e6 - 0.63 * OMEGA**2 + 480j * OMEGA) / CAPACITANCE
QUALITY = 6.0
INDUCTANCE = (1e-5 / FREQUENCY / math.pi) ** 2 * (1 - 0.25 / QUALITY**2) / CAPACITANCE
ROOT = math.sqrt(INDUCTANCE / CAPACITANCE)
RESISTANCE, CORE = ROOT / QUALITY, 5.0 * ROOT
COIL = {"inductance": INDUCTANCE, "quality": QUALITY, "core_resistance": CORE}
DECAY = RESISTANCE / (2 * INDUCTANCE)
DAMPED = math.sqrt(1 / (INDUCTANCE * CAPACITANCE) - DECAY**2)  # the switch is timed as without a core
SWING, EMPTYING = math.pi / DAMPED, (0.5 * math.pi + math.atan(DECAY / DAMPED)) / DAMPED


def loop(line=0.0, opposing=math.inf, core=CORE):
    """Rates of the voltage, of the current of L and of the voltage u of a capacitor in line, and the current's row."""
    # i = (v - u + R_c i_L)/(R + R_c); C v' = -i, L i_L' = R_c (i - i_L), C_2 u' = i.
    through = np.array([1.0, core, -1.0]) / (RESISTANCE + line + core)
    return np.array([-through / CAPACITANCE, core * (through - [0, 1, 0]) / INDUCTANCE, through / opposing]), through


def after(time, state, **parts):
    return expm(loop(**parts)[0] * time) @ state


def power(shunt):
    response = simulate(System(STIFF, shunt), DRIVE)
    assert response.converged, response.message
    assert abs(response.energy["closure"]) < 1e-10
    return response.harvested_power


LEFT = after(EMPTYING, [1.0, 0.0, 0.0])[0]  # voltage that emptying from one volt leaves: with a core, it is beyond zero
# A bridge does not let it pass zero: the coil's current goes round through its diodes until the switch opens.
EMPTY = brentq(lambda time: after(time, [1.0, 0.0, 0.0])[0], 0.5 * EMPTYING, EMPTYING)
ROUND = RESISTANCE * CORE / (RESISTANCE + CORE) / INDUCTANCE  # 1/s, decay of the current that goes round
HELD = INDUCTANCE / CAPACITANCE * (after(EMPTY, [1.0, 0.0, 0.0])[1] * math.exp(-ROUND * (EMPTYING - EMPTY))) ** 2
INVERTED = -after(SWING, [1.0, 0.0, 0.0])[0]


def test_extraction():
    wanted = 2 * FREQUENCY * HELD * CAPACITANCE * (2 * V_OC) ** 2 / 2
    assert power(SECE(**COIL)) == pytest.approx(wanted, rel=1e-5, abs=0)
    assert 0.3 < HELD < 0.7


@pytest.mark.parametrize("core", [math.inf, CORE], ids=["no core", "core"])
@pytest.mark.parametrize("diode", [0.0, 0.3 * RESISTANCE])
@pytest.mark.parametrize("error", [0.1, 0.5])
def test_a_bridge_that_is_closed_too_long(error, diode, core):
    """The coil cannot invert the voltage through a bridge: L i' = -(R + R_d) i - 2 V_d once the electrodes are empty.

    Beside the core, R_c, the current of the winding is (R_c i - 2 V_d)/(R + R_d + R_c).
    """
    drop = 0.02 * V_OC
    line, begin = 2 * diode, [2 * V_OC - 2 * drop, 0.0, 0.0]  # v - 2 V_d rings
    real = CORE if core == CORE else 1e7 * ROOT
    parts = {"line": line, "core": real}
    empty = brentq(lambda time: after(time, begin, **parts)[0] + 2 * drop, 0.5 * EMPTYING, 2 * EMPTYING)
    whole = RESISTANCE + diode
    gone, level = whole * real / (whole + real) / INDUCTANCE, 2 * drop / whole
    rest = (1 + error) * EMPTYING - empty
    assert rest > 0
    left = (after(empty, begin, **parts)[1] + level) * math.exp(-gone * rest) - level
    coil = COIL if core == CORE else {**COIL, "core_resistance": None}
    shunt = SECE(**coil, diode_drop=drop, diode_resistance=diode, on_time_error=error, efficiency=0.8)
    assert power(shunt) == pytest.approx(2 * FREQUENCY * 0.8 * INDUCTANCE * left**2 / 2, rel=1e-5, abs=0)


def test_emptying():
    voltage = 2 * V_OC / (1 + LEFT)  # of what is left strain takes its part before the next one
    response = simulate(System(STIFF, SSDS(**COIL)), DRIVE)
    wanted = CAPACITANCE * voltage**2 * (1 - LEFT**2)  # of two actions
    assert response.energy["shunt_loss"] == pytest.approx(wanted, rel=1e-5, abs=0)
    assert abs(response.energy["closure"]) < 1e-10


def test_extraction_from_an_inverted_voltage():
    voltage = 2 * V_OC * (1 + INVERTED)
    wanted = FREQUENCY * HELD * CAPACITANCE * voltage**2 / 2
    assert power(SICE(**COIL)) == pytest.approx(wanted, rel=1e-5, abs=0)


def test_bias_flip_of_one_step_inverts_as_the_loop():
    voltage = 0.8 * V_OC
    wanted = 2 * FREQUENCY * voltage * CAPACITANCE * (2 * V_OC - voltage * (1 - INVERTED))
    for shunt in (BiasFlip(steps=1, dc_voltage=voltage, **COIL), ParallelSSHI(dc_voltage=voltage, **COIL)):
        assert power(shunt) == pytest.approx(wanted, rel=1e-5, abs=0)


def test_bias_flips():
    """Three steps about b, 0 and -b, b being where the first takes as much charge as the last one gives back."""
    period = expm(loop()[0] * SWING)

    def swing(begins, bias):
        return bias + (period @ [begins - bias, 0.0, 0.0])[0]

    def unequal(bias):
        first = swing(1.0, bias)
        second = swing(first, 0.0)
        return (1.0 - first) - (second - swing(second, -bias))

    bias = brentq(unequal, 0.0, 1.0)
    inverted = -swing(swing(swing(1.0, bias), 0.0), -bias)
    voltage = 0.8 * V_OC
    wanted = 2 * FREQUENCY * voltage * CAPACITANCE * (2 * V_OC - voltage * (1 - inverted))
    found = power(BiasFlip(steps=3, dc_voltage=voltage, **COIL))
    assert found == pytest.approx(wanted, rel=1e-4, abs=0)
    assert inverted > INVERTED + 0.1


@pytest.mark.parametrize("line", [0.0, 0.1 * ROOT])
def test_series_loop_ends_where_its_current_does(line):
    """From V to -W about a dc voltage, until the current through the diodes is zero; V = W + 2 V_oc."""
    dc, drop = 0.4 * V_OC, 0.05 * V_OC

    def ends(voltage):
        state, through = np.array([voltage - dc - 2 * drop, 0.0, 0.0]), loop(line)[1]
        last = brentq(lambda t: through @ after(t, state, line=line), 0.3 * SWING, 1.2 * SWING)
        return after(last, state, line=line)[0] + dc + 2 * drop

    voltage = brentq(lambda v: v + ends(v) - 2 * V_OC, V_OC, 20 * V_OC)
    wanted = 2 * FREQUENCY * dc * CAPACITANCE * (voltage - ends(voltage))
    shunt = SeriesSSHI(dc_voltage=dc, diode_drop=drop, diode_resistance=line / 2, **COIL)
    assert power(shunt) == pytest.approx(wanted, rel=1e-5, abs=0)


def test_double_switch():
    """The same into a capacitor, whose energy is what is harvested."""
    between = 3 * CAPACITANCE
    through = loop(opposing=between)[1]

    def ends(voltage):
        state = np.array([voltage, 0.0, 0.0])
        last = brentq(lambda t: through @ after(t, state, opposing=between), 0.3 * SWING, 1.2 * SWING)
        return after(last, state, opposing=between)

    voltage = brentq(lambda v: v + ends(v)[0] - 2 * V_OC, V_OC, 20 * V_OC)
    wanted = 2 * FREQUENCY * between * ends(voltage)[2] ** 2 / 2
    assert power(DSSH(intermediate_capacitance=between, on_time_error=0.3, **COIL)) == pytest.approx(wanted, rel=1e-5)


@pytest.mark.parametrize("kind", [SECE, SSDS])
def test_a_core_without_a_coil_is_refused(kind):
    with pytest.raises(ParameterError) as caught:
        kind(core_resistance=1e4)
    assert caught.value.key == "core_resistance"
    assert is_sentence(caught.value.message)
