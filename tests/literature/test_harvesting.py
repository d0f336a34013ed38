"""Closed forms of energy harvesting (REFERENCE.md sections 1 to 3) against the engine's steady states."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq, minimize, minimize_scalar
from studies import inversion

from piezoharvest.description.excitation import SineForce
from piezoharvest.description.shunts import (
    SECE,
    NegativeCapacitance,
    ParallelSSHI,
    Rectifier,
    Resistor,
    SeriesRL,
    SeriesSSHI,
)
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine import simulate

# ---- section 1: prescribed displacement ------------------------------------------------------------------------------
# So weakly coupled (k_e^2 = 1e-12) that no shunt can change the displacement; flips of a 1e-5th of the period.

FREQUENCY, CAPACITANCE, COUPLING = 20.0, 40e-9, 2e-7
OMEGA = 2 * math.pi * FREQUENCY
DRIVE = SineForce(amplitude=100.0, frequency=FREQUENCY)
STIFF = Transducer(mass=0.63, damping=480.0, stiffness=1e6, coupling=COUPLING, capacitance=CAPACITANCE)
DISPLACEMENT = 100.0 / abs(1e6 - 0.63 * OMEGA**2 + 480j * OMEGA)
V_OC = COUPLING * DISPLACEMENT / CAPACITANCE
CURRENT = COUPLING * OMEGA * DISPLACEMENT
UNIT = OMEGA * CAPACITANCE * V_OC**2
FLIP = 1e-5 / FREQUENCY
SWITCHED = {"parallel_sshi": ParallelSSHI, "series_sshi": SeriesSSHI}
ROWS = ("resistor", "rectifier", "parallel_sshi", "series_sshi")


def row(kind, rcw, q):
    """P(R) of a row, with R C w given."""
    square = rcw / (CAPACITANCE * OMEGA) * CURRENT**2
    return {
        "resistor": square / (2 * (1 + rcw**2)),
        "rectifier": square / (rcw + math.pi / 2) ** 2,
        "parallel_sshi": 4 * square / (rcw * (1 - q) + math.pi) ** 2,
        "series_sshi": 4 * square * (1 + q) ** 2 / (2 * rcw * (1 + q) + math.pi * (1 - q)) ** 2,
    }[kind]


def optimum(kind, q):
    """Best R C w, the largest power over w C V_oc^2, and the dc voltage over V_oc there."""
    return {
        "resistor": (1.0, 1 / 4, None),
        "rectifier": (math.pi / 2, 1 / (2 * math.pi), 1 / 2),
        "parallel_sshi": (math.pi / (1 - q), 1 / (math.pi * (1 - q)), 1 / (1 - q)),
        "series_sshi": (math.pi * (1 - q) / (2 * (1 + q)), (1 + q) / (2 * math.pi * (1 - q)), 1 / 2),
    }[kind]


def shunt_of(kind, rcw=None, quality=6.0, dc_voltage=None, **keys):
    """Shunt with a load R C w behind a smoothing capacitor of w R C_r = 1e5, or with a constant dc voltage."""
    if kind == "resistor":
        return Resistor(resistance=rcw / (CAPACITANCE * OMEGA))
    if dc_voltage is None:
        resistance = rcw / (CAPACITANCE * OMEGA)
        side = {"load_resistance": resistance, "smoothing_capacitance": 1e5 / (OMEGA * resistance)}
    else:
        side = {"dc_voltage": dc_voltage}
    if kind == "rectifier":
        return Rectifier(**side)
    return SWITCHED[kind](**side, quality=quality, flip_time=FLIP, **keys)


def solved(shunt, transducer=STIFF, drive=DRIVE):
    response = simulate(System(transducer, shunt), drive, samples=16)
    assert response.converged, response.message
    return response


@pytest.mark.parametrize("share", [0.2, 1.0, 4.0])
@pytest.mark.parametrize("kind", ROWS)
def test_power_with_a_load(kind, share):
    q = inversion(6.0)
    rcw = share * optimum(kind, q)[0]
    found = solved(shunt_of(kind, rcw))
    assert found.harvested_power == pytest.approx(row(kind, rcw, q), rel=1e-3)
    assert found.displacement_amplitude == pytest.approx(DISPLACEMENT, rel=1e-6)


@pytest.mark.parametrize("share", [0.3, 1.0, 1.6])
@pytest.mark.parametrize("kind", ROWS[1:])
def test_power_at_constant_dc_voltage(kind, share):
    """P(R) at R = V/I; the mean current falls linearly with the voltage."""
    q = inversion(6.0)
    voltage = share * optimum(kind, q)[2] * V_OC
    found = solved(shunt_of(kind, dc_voltage=voltage))
    rcw = voltage**2 / found.harvested_power * CAPACITANCE * OMEGA
    assert found.harvested_power == pytest.approx(row(kind, rcw, q), rel=1e-3)


@pytest.mark.parametrize("kind", ROWS)
def test_optimum_load(kind):
    q = inversion(6.0)
    best, most, voltage = optimum(kind, q)
    scan = minimize_scalar(
        lambda log: -solved(shunt_of(kind, math.exp(log))).harvested_power / UNIT,
        bracket=(math.log(best) - 0.3, math.log(best) + 0.2),
        tol=1e-5,
    )
    assert -scan.fun == pytest.approx(most, rel=1e-3)
    assert math.exp(scan.x) == pytest.approx(best, rel=3e-3)
    if voltage is not None:
        assert solved(shunt_of(kind, best)).dc_voltage / V_OC == pytest.approx(voltage, rel=1e-3)


@pytest.mark.parametrize("phase_lag", [0.0, 0.5, -0.5])
@pytest.mark.parametrize("efficiency", [1.0, 0.7])
def test_sece(efficiency, phase_lag):
    """2 T^2 w U^2/(pi C) when in time; off by phi it takes at +-cos(phi) what it would at the extrema."""
    found = solved(SECE(efficiency=efficiency, phase_lag=phase_lag))
    wanted = 2 * CURRENT**2 / (math.pi * CAPACITANCE * OMEGA) * efficiency * math.cos(phase_lag) ** 2
    assert found.harvested_power == pytest.approx(wanted, rel=1e-5)
    lost = (1 / efficiency - 1) * wanted * found.period
    assert found.energy["shunt_loss"] == pytest.approx(lost, rel=1e-5, abs=1e-25)


@pytest.mark.parametrize("share", [0.05, 0.3])
def test_sece_through_diodes(share):
    """Each extraction takes the charge C V through two drops, V = 2 T U/C; from V = 4 V_d down nothing is left."""
    voltage = 2 * V_OC
    found = solved(SECE(efficiency=0.8, diode_drop=share * voltage))
    taken = CAPACITANCE * voltage**2 / 2
    left = max(taken - 2 * share * voltage * CAPACITANCE * voltage, 0.0)
    assert found.harvested_power == pytest.approx(0.8 * left * OMEGA / math.pi, rel=1e-5)
    assert found.energy["shunt_loss"] == pytest.approx(2 * (taken - 0.8 * left), rel=1e-5)


@pytest.mark.parametrize("quality", [40.0, 80.0])
@pytest.mark.parametrize("kind", ["parallel_sshi", "series_sshi"])
def test_gain_over_the_rectifier(kind, quality):
    """With q = exp(-pi/(2 Q)), as the literature writes it: at these qualities the difference is below 1e-4."""
    q = math.exp(-math.pi / (2 * quality))
    gain = {"parallel_sshi": 2 / (1 - q), "series_sshi": (1 + q) / (1 - q)}[kind]
    best, rectified = optimum(kind, q)[0], optimum("rectifier", q)[0]
    power = solved(shunt_of(kind, best, quality)).harvested_power
    assert power / solved(shunt_of("rectifier", rectified)).harvested_power == pytest.approx(gain, rel=1e-3)


def best_power(phase_lag, quality=6.0):
    """Power of the parallel SSHI at its best dc voltage: the mean current falls linearly with the voltage."""
    voltage = V_OC / (1 - inversion(quality))
    shares = (0.7, 0.8)
    currents = [
        solved(shunt_of("parallel_sshi", quality=quality, dc_voltage=s * voltage, phase_lag=phase_lag)).harvested_power
        / (s * voltage)
        for s in shares
    ]
    slope = (currents[0] - currents[1]) / ((shares[1] - shares[0]) * voltage)
    return (currents[0] + slope * shares[0] * voltage) ** 2 / (4 * slope)


@pytest.mark.parametrize("phase", [0.1, 0.3, 0.6])
def test_phase_lag_of_parallel_sshi(phase):
    """Late: [((1-q) + (1+q) cos phi)/2]^2; early: cos^2 phi; the dc voltage optimised anew."""
    q, in_time = inversion(6.0), best_power(0.0)
    assert in_time / UNIT == pytest.approx(optimum("parallel_sshi", q)[1], rel=1e-3)
    late = (((1 - q) + (1 + q) * math.cos(phase)) / 2) ** 2
    assert best_power(phase) / in_time == pytest.approx(late, rel=1e-3)
    assert best_power(-phase) / in_time == pytest.approx(math.cos(phase) ** 2, rel=1e-3)


# ---- section 2: equivalent impedance with coupling -------------------------------------------------------------------


def host(coupling_squared, quality, capacitance=40e-9):
    """Transducer of given k_e^2 and Q_m, resonant at 50 Hz."""
    mass = 0.01
    stiffness = mass * (2 * math.pi * 50.0) ** 2
    return Transducer(
        mass=mass,
        damping=math.sqrt(stiffness * mass) / quality,
        stiffness=stiffness,
        coupling=math.sqrt(coupling_squared * stiffness * capacitance),
        capacitance=capacitance,
    )


def impedance(gamma, level, drop, wc):
    """Z, R_h of Liang & Liao at V' = level and V_F' = drop."""
    cosine = 1 - (1 + gamma) * level
    angle = math.acos(cosine)
    real = (1 - cosine) * (4 / (1 + gamma) - 1 + cosine)
    z = (real + 1j * (math.sin(angle) * cosine - angle)) / (math.pi * wc)
    return z, 2 / (math.pi * wc) * (level - drop) * (2 - level * (1 + gamma))


def predicted_power(transducer, omega, force, gamma, dc_voltage, two_drops):
    """Harvested power from the equivalent impedance; the current it is taken at is found with it."""
    tr, voltage = transducer, dc_voltage + two_drops
    machine = tr.damping / tr.coupling**2 + 1j * (omega * tr.mass - tr.stiffness / omega) / tr.coupling**2
    source, wc = force / tr.coupling, omega * tr.capacitance

    def excess(open_voltage):
        z, _ = impedance(gamma, voltage / open_voltage, two_drops / open_voltage, wc)
        return source / abs(machine + z) - wc * open_voltage

    least = voltage * (1 + gamma) / 2
    open_voltage = brentq(excess, least * (1 + 1e-12), 1e4 * least, xtol=1e-13 * least)
    _, harvested = impedance(gamma, voltage / open_voltage, two_drops / open_voltage, wc)
    return 0.5 * (wc * open_voltage) ** 2 * harvested


BETWEEN = [0.0, 0.25, 0.5, 0.75, 1.0]


def between(transducer, share):
    """Frequency in Hz at a share of the way from the short-circuit to the open-circuit resonance."""
    low, high = transducer.short_circuit_frequency, transducer.open_circuit_frequency
    return low + share * (high - low)


@pytest.mark.parametrize("diode_drop", [0.0, 0.15])
@pytest.mark.parametrize("share", BETWEEN)
@pytest.mark.parametrize("coupling_squared", [0.02, 0.2])
def test_equivalent_impedance_of_the_rectifier(coupling_squared, share, diode_drop):
    device = host(coupling_squared, 50.0)
    f = between(device, share)
    # A voltage to which the open electrodes come easily.
    voltage = 0.35 * 0.02 / device.coupling
    found = solved(Rectifier(dc_voltage=voltage, diode_drop=diode_drop), device, SineForce(amplitude=0.02, frequency=f))
    wanted = predicted_power(device, 2 * math.pi * f, 0.02, 1.0, voltage, 2 * diode_drop)
    assert found.harvested_power == pytest.approx(wanted, rel=5e-3)


@pytest.mark.parametrize("diode_drop", [0.0, 0.15])
@pytest.mark.parametrize("share", BETWEEN)
@pytest.mark.parametrize("coupling_squared", [0.005, 0.02])
def test_equivalent_impedance_of_parallel_sshi(coupling_squared, share, diode_drop):
    device = host(coupling_squared, 50.0)
    f = between(device, share)
    voltage = 0.35 * 0.02 / device.coupling
    shunt = ParallelSSHI(dc_voltage=voltage, diode_drop=diode_drop, quality=4.0, flip_time=1e-5 / f)
    found = solved(shunt, device, SineForce(amplitude=0.02, frequency=f))
    gamma = -inversion(4.0)
    wanted = predicted_power(device, 2 * math.pi * f, 0.02, gamma, voltage, 2 * diode_drop)
    assert found.harvested_power == pytest.approx(wanted, rel=5e-3)


@pytest.mark.parametrize("quality", [10.0, 100.0])
def test_equivalent_impedance_of_sece(quality):
    """Z = (4/pi - j)/(w C), at the frequency where the reactances cancel."""
    device = host(0.02, quality)
    omega = 2 * math.pi * device.open_circuit_frequency
    wc = omega * device.capacitance
    machine = (device.damping + 1j * (omega * device.mass - device.stiffness / omega)) / device.coupling**2
    found = solved(SECE(), device, SineForce(amplitude=0.02, frequency=omega / (2 * math.pi)))
    wanted = 0.5 * (0.02 / device.coupling) ** 2 * (4 / math.pi / wc) / abs(machine + (4 / math.pi - 1j) / wc) ** 2
    assert found.harvested_power == pytest.approx(wanted, rel=5e-3)


# ---- section 3: the limit F^2/(8 b) ----------------------------------------------------------------------------------

FORCE = 0.02


def share_of_limit(device, shunt, frequency):
    """Harvested power over F^2/(8 b)."""
    return solved(shunt, device, SineForce(amplitude=FORCE, frequency=frequency)).harvested_power / limit(device)


def limit(device):
    return FORCE**2 / (8 * device.damping)


def any_harvester(rng, device, frequency):
    """A harvesting shunt of any kind near what suits the device."""
    wc = 2 * math.pi * frequency * device.capacitance
    scale = 10 ** rng.uniform(-1.5, 1.5)
    bridge = {"dc_voltage": scale * FORCE / device.coupling, "diode_drop": 0.0}
    lag = float(rng.uniform(-0.5, 0.5))
    loop = {"quality": float(rng.uniform(2, 40)), "flip_time": 0.01 / frequency, "phase_lag": lag}
    resistance = scale / wc
    return [
        Resistor(resistance=resistance),
        SeriesRL(inductance=1 / (2 * math.pi * frequency * wc), resistance=resistance),
        NegativeCapacitance(capacitance=0.7 * device.capacitance, resistance=resistance),
        Rectifier(**bridge),
        ParallelSSHI(**bridge, **loop),
        SeriesSSHI(**bridge, **loop),
        SECE(phase_lag=lag),
    ]


@pytest.mark.parametrize("seed", range(12))
def test_no_interface_draws_more_than_the_limit(seed):
    rng = np.random.default_rng(seed)
    quality = 10 ** rng.uniform(0.5, 2)
    device = host(10 ** rng.uniform(-1, 1) / quality, quality)
    for frequency in (between(device, 0.0), between(device, rng.uniform()), 50 * rng.uniform(0.3, 3)):
        for shunt in any_harvester(rng, device, frequency):
            response = simulate(System(device, shunt), SineForce(amplitude=FORCE, frequency=frequency), samples=16)
            # Whatever converges is bounded; where nothing repeats there is no power to speak of.
            assert not response.converged or response.harvested_power <= limit(device) * (1 + 1e-9), shunt


def most(device, make, start):
    """Largest share of the limit over frequency (as share between the resonances) and log of the shunt's parameter."""
    simplex = [start, [start[0] + 0.1, start[1]], [start[0], start[1] + 0.1]]
    found = minimize(
        lambda p: -share_of_limit(device, make(math.exp(p[1])), between(device, p[0])),
        start,
        method="Nelder-Mead",
        options={"xatol": 3e-3, "fatol": 1e-5, "initial_simplex": simplex},
    )
    return -found.fun


def test_resistor_reaches_the_limit_from_two_on():
    for product, reached in ((2.02, True), (1.0, False), (1.6, False)):
        device = host(product / 1000, 1000.0)
        found = most(device, lambda r: Resistor(resistance=r), (0.5, math.log(1 / (2 * math.pi * 50 * 40e-9))))
        # Below, the resistance seen is at most 1/(2 w C) in series: a matched load's share of the limit.
        ratio = product / 2
        wanted = 1.0 if reached else 4 * ratio / (1 + ratio) ** 2
        assert found == pytest.approx(wanted, rel=2e-3)


def test_rectifier_reaches_the_limit_from_pi_on():
    for product in (1.05 * math.pi, 2.0, 1.0):
        device = host(product / 1000, 1000.0)
        found = most(device, lambda v: Rectifier(dc_voltage=v), (0.5, math.log(0.4 * FORCE / device.coupling)))
        ratio = product / math.pi
        wanted = 1.0 if ratio >= 1 else 4 * ratio / (1 + ratio) ** 2
        assert found == pytest.approx(wanted, rel=2e-3)


@pytest.mark.parametrize("product", [math.pi / 4, 0.3, 2.0, 5.0])
def test_sece_touches_the_limit_at_a_quarter_of_pi_only(product):
    device = host(product / 1000, 1000.0)
    scan = minimize_scalar(
        lambda share: -share_of_limit(device, SECE(), between(device, share)), bounds=(0.0, 2.0), method="bounded",
        options={"xatol": 1e-4},
    )  # fmt: skip
    # The resistance it shows is (4/pi)/(w C) whatever the load: R_m = 1/(w C k_e^2 Q_m) matches at pi/4.
    ratio = product * 4 / math.pi
    assert -scan.fun == pytest.approx(4 * ratio / (1 + ratio) ** 2, rel=3e-3)
