"""Closed forms of harvesting circuits at a prescribed displacement, against the engine's steady states."""

import dataclasses
import math

import numpy as np
import pytest

from piezoharvest.description.excitation import RandomForce, SineForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import (
    DSSH,
    ESSH,
    MPPT,
    SCSECE,
    SECE,
    SICE,
    SSHC,
    Battery,
    BiasFlip,
    Doubler,
    HalfWave,
    Open,
    Rectifier,
)
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine import simulate

# So weakly coupled (k_e^2 = 1e-12) that no shunt can change the displacement; flips of a 1e-5th of the period.
FREQUENCY, CAPACITANCE, COUPLING = 20.0, 40e-9, 2e-7
OMEGA = 2 * math.pi * FREQUENCY
DRIVE = SineForce(amplitude=100.0, frequency=FREQUENCY)
STIFF = Transducer(mass=0.63, damping=480.0, stiffness=1e6, coupling=COUPLING, capacitance=CAPACITANCE)
V_OC = COUPLING * 100.0 / abs(1e6 - 0.63 * OMEGA**2 + 480j * OMEGA) / CAPACITANCE
FLIP = 1e-5 / FREQUENCY
CLOSE = 1e-6


def power(shunt):
    response = simulate(System(STIFF, shunt), DRIVE)
    assert response.converged, response.message
    assert abs(response.energy["closure"]) < 1e-10
    return response.harvested_power


def bridge(voltage, inversion=-1.0, drop=0.0):
    """Mean power into a constant voltage: what strain moves in a half period, less what the swing of C takes.

    A bridge without a flip keeps the voltage: inversion -1.
    """
    return 2 * FREQUENCY * voltage * CAPACITANCE * (2 * V_OC - (voltage + drop) * (1 - inversion))


def sshc(capacitances, voltage=None, **keys):
    """Phases of 25 time constants, short beside the period."""
    resistance = FLIP / (2 * len(capacitances) + 1) / 25 / CAPACITANCE
    side = {"dc_voltage": voltage} if voltage is not None else {}
    return SSHC(
        flip_capacitances=capacitances, switch_resistance=resistance, phase_time=25 * resistance * CAPACITANCE, **side,
        **keys,
    )  # fmt: skip


@pytest.mark.parametrize("count", [1, 2, 4, 8])
def test_sshc_with_capacitors_as_the_electrodes(count):
    """n/(n + 2) of the voltage (Du & Seshia 2017, Du et al. 2017)."""
    shunt = sshc((CAPACITANCE,) * count, 1.2 * V_OC)
    assert shunt.inversion(CAPACITANCE) == pytest.approx(count / (count + 2), abs=1e-9)
    assert power(shunt) == pytest.approx(bridge(1.2 * V_OC, count / (count + 2)), rel=CLOSE, abs=0)


@pytest.mark.parametrize("ratio", [0.3, 1.0, 5.0, 1e4])
def test_sshc_with_one_capacitor_of_any_size(ratio):
    """Shared, shorted, given back: v' = -r/(1 + 2 r) v with r = C_k/C (Du 2019), one half for a very large one."""
    wanted = ratio / (1 + 2 * ratio)
    shunt = sshc((ratio * CAPACITANCE,), V_OC)
    assert shunt.inversion(CAPACITANCE) == pytest.approx(wanted, abs=1e-9)
    if ratio < 100:  # a larger one takes as many periods to settle
        assert power(shunt) == pytest.approx(bridge(V_OC, wanted), rel=CLOSE, abs=0)


def test_sshc_that_does_not_settle_in_its_phases():
    """The voltage that is left by phases of a time constant, from the power, against the recursion of the flips."""
    shunt = SSHC(
        flip_capacitances=(CAPACITANCE,) * 2, switch_resistance=FLIP / 5 / CAPACITANCE, phase_time=FLIP / 5,
        dc_voltage=V_OC,
    )  # fmt: skip
    v, flips = 1.0, np.zeros(2)
    left, kept = math.exp(-1), math.exp(-2)
    for _ in range(200):
        v = 1.0
        for k, side in ((0, 1), (1, 1), (None, 0), (1, -1), (0, -1)):
            if k is None:
                v *= left
                continue
            mean, half = 0.5 * (v + side * flips[k]), 0.5 * (v - side * flips[k])
            v, flips[k] = mean + kept * half, side * (mean - kept * half)
    assert power(shunt) == pytest.approx(bridge(V_OC, -v), rel=1e-5)  # the strain moves on in 1e-5 of the period


@pytest.mark.parametrize("share", [0.3, 1.0, 1.6])
@pytest.mark.parametrize("cls", [HalfWave, Doubler])
def test_twice_the_voltage_of_a_bridge(cls, share):
    """Power f C V (2 V_oc - V): as behind a bridge, at twice its voltage (Ramadass & Chandrakasan 2010)."""
    voltage = share * V_OC
    wanted = FREQUENCY * CAPACITANCE * voltage * (2 * V_OC - voltage)
    assert power(cls(dc_voltage=voltage)) == pytest.approx(wanted, rel=CLOSE, abs=0)
    assert power(Rectifier(dc_voltage=0.5 * voltage)) == pytest.approx(wanted, rel=CLOSE, abs=0)


@pytest.mark.parametrize("cls", [HalfWave, Doubler])
def test_drops_of_one_diode_in_each_half_wave(cls):
    voltage, drop = 0.8 * V_OC, 0.1 * V_OC
    wanted = FREQUENCY * CAPACITANCE * voltage * (2 * V_OC - voltage - 2 * drop)
    assert power(cls(dc_voltage=voltage, diode_drop=drop)) == pytest.approx(wanted, rel=CLOSE, abs=0)


@pytest.mark.parametrize("cls", [HalfWave, Doubler])
def test_load_behind_large_capacitors(cls):
    """V = 2 V_oc f C R/(1 + f C R), by the balance of charge."""
    load = 0.7 / (FREQUENCY * CAPACITANCE)
    found = power(cls(load_resistance=load, smoothing_capacitance=1e6 / (FREQUENCY * load)))
    voltage = 2 * V_OC * 0.7 / 1.7
    assert found == pytest.approx(voltage**2 / load, rel=1e-5)  # ripple of 1e-6


@pytest.mark.parametrize("share", [1e-3, 0.3, 3.0])
def test_resistance_of_diodes_or_of_a_battery(share):
    """Conduction from v = V on: tau v' + v = V + R I sin(w t) until the current ends; integrated in closed form."""
    voltage, resistance = 0.5 * V_OC, share / (OMEGA * CAPACITANCE)
    wanted = resistive_bridge(voltage, resistance)
    found = power(Rectifier(dc_voltage=voltage, diode_resistance=0.5 * resistance))
    assert found == pytest.approx(wanted, rel=CLOSE, abs=0)
    found = power(Battery(dc_voltage=voltage, diode_resistance=0.2 * resistance, internal_resistance=0.6 * resistance))
    assert found == pytest.approx(wanted, rel=CLOSE, abs=0)


def resistive_bridge(voltage, resistance):
    """Power into a constant voltage behind a resistance: the current and its end by the root of one equation."""
    from scipy.optimize import brentq

    tau, peak = resistance * CAPACITANCE, OMEGA * CAPACITANCE * V_OC

    def forced(t):
        return resistance * peak * (math.sin(OMEGA * t) - OMEGA * tau * math.cos(OMEGA * t)) / (1 + (OMEGA * tau) ** 2)

    def excess(t, begin):
        return forced(t) - forced(begin) * math.exp(-(t - begin) / tau)

    def mismatch(begin):
        # In the half period of positive strain current, conduction ends at `end`; from the mirror image of that, at -V,
        # the voltage rises to V at `begin`.
        end = brentq(lambda t: excess(t, begin), math.pi / OMEGA, 1.999 * math.pi / OMEGA)
        last = end - math.pi / OMEGA
        return math.cos(OMEGA * last) - math.cos(OMEGA * begin) - 2 * voltage / V_OC

    begin = brentq(mismatch, 1e-3 / OMEGA, 0.999 * math.pi / OMEGA)
    end = brentq(lambda t: excess(t, begin), math.pi / OMEGA, 1.999 * math.pi / OMEGA)
    charge = CAPACITANCE * V_OC * (math.cos(OMEGA * begin) - math.cos(OMEGA * end))
    return 2 * FREQUENCY * voltage * charge


# Coils whose half swing takes a 1e-5th of the period. With a = R/(2 L w_d) a swing inverts to exp(-pi a), and what a
# coil holds when it has emptied the electrodes is C V^2/2 exp(-2 a (pi/2 + atan a)): the damped oscillator.
QUALITY = 6.0
COIL = {"inductance": (FLIP / math.pi) ** 2 * (1 - 0.25 / QUALITY**2) / CAPACITANCE, "quality": QUALITY}
DECAY = 1 / math.sqrt(4 * QUALITY**2 - 1)
INVERTS = math.exp(-math.pi * DECAY)
HELD = math.exp(-2 * DECAY * (math.pi / 2 + math.atan(DECAY)))


@pytest.mark.parametrize("steps", [1, 2, 3, 4, 8])
def test_bias_flips(steps):
    """Equal steps: (1 - q_n)/(1 + q_n) = (1 - q)/(1 + q)/n."""
    lost = (1 - INVERTS) / (1 + INVERTS) / steps
    wanted = bridge(1.5 * V_OC, (1 - lost) / (1 + lost))
    assert power(BiasFlip(steps=steps, dc_voltage=1.5 * V_OC, **COIL)) == pytest.approx(wanted, rel=CLOSE, abs=0)


def test_extraction_through_a_coil():
    """Twice a period from 2 V_oc (Lefeuvre et al. 2005), less what the coil's resistance takes."""
    wanted = 4 * FREQUENCY * CAPACITANCE * V_OC**2
    assert power(SECE()) == pytest.approx(wanted, rel=CLOSE, abs=0)
    assert power(SECE(**COIL, efficiency=0.8)) == pytest.approx(0.8 * HELD * wanted, rel=CLOSE, abs=0)


@pytest.mark.parametrize("phase_lag", [0.4, -0.4])
def test_phase_shifted_extraction_through_a_coil(phase_lag):
    """Off by phi, the voltage is that of strain between two actions: 2 V_oc cos(phi)."""
    wanted = 4 * FREQUENCY * CAPACITANCE * (V_OC * math.cos(phase_lag)) ** 2 * HELD
    # The strain does not rest any more while the charge is extracted: first order in its time.
    assert power(SECE(**COIL, phase_lag=phase_lag)) == pytest.approx(wanted, rel=2e-5)


def test_inversion_and_extraction():
    """Once a period from 2 V_oc (1 + q) (Lallart et al. 2017)."""
    wanted = FREQUENCY * 0.5 * CAPACITANCE * (2 * V_OC * (1 + INVERTS)) ** 2 * HELD
    assert power(SICE(**COIL)) == pytest.approx(wanted, rel=CLOSE, abs=0)


@pytest.mark.parametrize("angle", [0.3, 1.2])
def test_extraction_and_short_circuit(angle):
    """The strain moves on from the end of the short: V_oc (1 + cos(theta)) to the next extremum (Morel et al. 2018)."""
    emptying = FLIP / math.pi * (math.pi / 2 + math.atan(DECAY))
    theta = angle + OMEGA * emptying
    wanted = FREQUENCY * CAPACITANCE * (V_OC * (1 + math.cos(theta))) ** 2 * HELD
    found = power(SCSECE(**COIL, short_time=angle / OMEGA))
    assert found == pytest.approx(wanted, rel=1e-5, abs=0)  # in a flip strain moves on by such a share


@pytest.mark.parametrize("ratio", [0.5, 3.0])
def test_double_switch(ratio):
    """Swings into the empty intermediate capacitor, between which strain adds 2 V_oc (Lallart et al. 2008)."""
    series = ratio / (1 + ratio)  # of C and the intermediate capacitor, over C
    inductance, resistance = COIL["inductance"], math.sqrt(COIL["inductance"] / CAPACITANCE) / QUALITY
    decay = resistance / (2 * inductance)
    swing = math.sqrt(1 / (inductance * series * CAPACITANCE) - decay**2)
    taken = series * (1 + math.exp(-math.pi * decay / swing))  # charge over C V
    # V = 2 V_oc + (taken - 1) V: the rest is of the other sign.
    before = 2 * V_OC / (2 - taken)
    voltage = taken * before / ratio
    wanted = 2 * FREQUENCY * 0.5 * ratio * CAPACITANCE * voltage**2
    assert power(DSSH(**COIL, intermediate_capacitance=ratio * CAPACITANCE)) == pytest.approx(wanted, rel=CLOSE, abs=0)


@pytest.mark.parametrize("residual", [0.0, 0.6])
def test_double_switch_that_leaves_a_part(residual):
    """As above, with W on the intermediate capacitor at first: it then swings from W + taken (V - W) to that residual.

    The second coil has next to no losses: its energy is C_int/2 (1 - residual^2) of the square of the higher voltage.
    """
    ratio = 2.0
    series = ratio / (1 + ratio)
    inductance, resistance = COIL["inductance"], math.sqrt(COIL["inductance"] / CAPACITANCE) / QUALITY
    decay = resistance / (2 * inductance)
    swing = math.sqrt(1 / (inductance * series * CAPACITANCE) - decay**2)
    taken = series * (1 + math.exp(-math.pi * decay / swing))
    # V = 2 V_oc - V + taken (V - W), U = W + taken/ratio (V - W), W = residual U.
    balance = [[2 - taken, 0, taken], [-taken / ratio, 1, taken / ratio - 1], [0, -residual, 1]]
    _, upper, lower = np.linalg.solve(balance, [2 * V_OC, 0, 0])
    wanted = FREQUENCY * ratio * CAPACITANCE * (upper**2 - lower**2)
    shunt = ESSH(
        **COIL, intermediate_capacitance=ratio * CAPACITANCE, second_inductance=COIL["inductance"], second_quality=1e9,
        residual=residual,
    )  # fmt: skip
    assert power(shunt) == pytest.approx(wanted, rel=CLOSE, abs=0)


def test_a_battery_is_the_whole_dc_side():
    with pytest.raises(ParameterError, match="found together with a battery") as caught:
        Battery(dc_voltage=3.0, load_resistance=1e5)
    assert caught.value.key == "load_resistance"


@pytest.mark.parametrize("drop", [0.0, 0.05])
@pytest.mark.parametrize("fraction", [0.3, 0.5])
def test_tracker_at_a_fraction_of_the_open_circuit_voltage(fraction, drop):
    """Without a load the dc side comes to the peak less two drops; sampling takes its share of the time."""
    shunt = MPPT(fraction=fraction, sampling_duty=0.02, diode_drop=drop * V_OC)
    wanted = 0.98 * bridge(fraction * (1 - 2 * drop) * V_OC, drop=2 * drop * V_OC)
    assert power(shunt) == pytest.approx(wanted, rel=CLOSE, abs=0)


def test_tracker_beside_strong_coupling_holds_what_open_electrodes_come_to():
    device, drive = dataclasses.replace(STIFF, coupling=20 * COUPLING), SineForce(amplitude=100.0, frequency=190.0)
    opened = simulate(System(device, Open()), drive).voltage_amplitude
    found = simulate(System(device, MPPT(fraction=0.4)), drive)
    assert found.dc_voltage == pytest.approx(0.4 * opened, rel=1e-9)
    held = simulate(System(device, Rectifier(dc_voltage=found.dc_voltage)), drive)
    assert found.harvested_power == pytest.approx(held.harvested_power, rel=1e-9)


@pytest.mark.parametrize("given", [{"dc_voltage": 1.0}, {"load_resistance": 1e5}, {"initial_dc_voltage": 1.0}])
def test_a_tracker_is_the_whole_dc_side(given):
    with pytest.raises(ParameterError, match="found together with a tracker") as caught:
        MPPT(fraction=0.5, **given)
    assert caught.value.key == next(iter(given))


def test_a_tracker_needs_a_voltage_that_settles():
    """Without damping, at the resonance of open electrodes to the last digit: the matrix of the motion is singular."""
    device = Transducer(
        mass=0.011117614829344395, damping=0.0, stiffness=182506.33457273108, coupling=0.002896544995354967,
        capacitance=1.469789319287755e-09,
    )  # fmt: skip
    drive = SineForce(amplitude=0.1255691238004806, frequency=654.8487369202002)
    with pytest.raises(ParameterError, match="found none at the resonance of the open electrodes") as caught:
        simulate(System(device, MPPT(fraction=0.5)), drive)
    assert caught.value.key == "transducer.damping"


def test_a_tracker_needs_a_sine():
    noise = RandomForce(psd=1.0, band=(10.0, 20.0), duration=1.0, seed=1)
    with pytest.raises(ParameterError, match="found mppt under random_force"):
        simulate(System(STIFF, MPPT(fraction=0.5)), noise)
