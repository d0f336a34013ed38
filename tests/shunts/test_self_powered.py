"""Electronic breakers: closed forms at a prescribed displacement, where they start, and netlists."""

import math

import numpy as np
import pytest
from oracles.ngspice import needs_ngspice
from scipy.linalg import expm
from scipy.optimize import brentq
from studies import BENCH

from piezoharvest import (
    SelfPoweredSECE,
    SelfPoweredSeriesSSHI,
    SelfPoweredSSDI,
    SelfPoweredSSHI,
    SineForce,
    System,
    Transducer,
    simulate,
)
from piezoharvest.description.shunts.storage import Storage
from piezoharvest.spice.simulators.comparison import compare

# So weakly coupled that no shunt can change the displacement; flips of a 1e-6th of the period, and envelope capacitors
# that take next to nothing.
FREQUENCY, CAPACITANCE, COUPLING, FORCE = 20.0, 40e-9, 2e-5, 100.0
OMEGA = 2 * math.pi * FREQUENCY
STIFF = Transducer(mass=0.63, damping=480.0, stiffness=1e6, coupling=COUPLING, capacitance=CAPACITANCE)
DRIVE = SineForce(amplitude=FORCE, frequency=FREQUENCY)
V_OC = COUPLING * FORCE / abs(1e6 - 0.63 * OMEGA**2 + 480j * OMEGA) / CAPACITANCE
THRESHOLD, DROP, QUALITY = 0.06 * V_OC, 0.02 * V_OC, 5.0
KEYS = {
    "flip_time": 1e-6 / FREQUENCY, "quality": QUALITY, "envelope_capacitance": 1e-8 * CAPACITANCE,
    "threshold": THRESHOLD, "diode_drop": DROP,
}  # fmt: skip
COS = 1 - (THRESHOLD + DROP) / V_OC  # of the lag
INVERTED = math.exp(-math.pi / math.sqrt(4 * QUALITY**2 - 1))  # of a damped half swing
CLOSE = 5e-6  # in a flip strain moves on by a share of 2 pi 1e-6
KINDS = [SelfPoweredSSHI, SelfPoweredSeriesSSHI, SelfPoweredSECE, SelfPoweredSSDI]


def behind(kind, voltage):
    """A circuit of a kind, with a constant dc voltage where it has one."""
    bridged = issubclass(kind, SelfPoweredSSHI | SelfPoweredSeriesSSHI)
    return kind(**KEYS, **({"dc_voltage": voltage} if bridged else {}))


def steady(shunt, drive=DRIVE, **keys):
    found = simulate(System(STIFF, shunt), drive, attenuation=False, **keys)
    assert found.converged, found.message
    assert abs(found.energy["closure"]) < 1e-10
    return found


def after_flip(voltage, level):
    """Voltage after half a swing about a level."""
    return level - INVERTED * (voltage - level)


@pytest.mark.parametrize("kind", KINDS)
def test_lag_follows_from_threshold_and_drop(kind):
    waves = steady(behind(kind, 0.4 * V_OC), samples=20000).waveforms
    closes = [t for name, t in zip(waves.event_names, waves.event_times, strict=True) if name == "switch closes"]
    assert len(closes) == 2
    extrema = waves.time[np.flatnonzero(np.diff(np.sign(waves.velocity)))]
    lags = [OMEGA * min(abs(t - turned) for turned in extrema) for t in closes]
    assert lags == pytest.approx([math.acos(COS)] * 2, abs=2 * math.pi / 20000)


@pytest.mark.parametrize("share", [0.8, 1.5])
def test_parallel(share):
    """It rests at the dc side's, falls by threshold and drop, swings about the drop; strain does the rest."""
    dc = share * V_OC
    held = dc + 2 * DROP
    left = after_flip(held - THRESHOLD - DROP, DROP)
    wanted = 2 * FREQUENCY * dc * CAPACITANCE * (V_OC * (1 + COS) - held - left)
    assert steady(behind(SelfPoweredSSHI, dc)).harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


def test_a_breaker_has_a_drop_of_its_own():
    """The swing is about it; what detects and rectifies keeps that of a diode."""
    dc, own = 0.8 * V_OC, 3 * DROP
    held = dc + 2 * DROP
    left = after_flip(held - THRESHOLD - DROP, own)
    wanted = 2 * FREQUENCY * dc * CAPACITANCE * (V_OC * (1 + COS) - held - left)
    found = steady(SelfPoweredSSHI(**KEYS, dc_voltage=dc, breaker_drop=own))
    assert found.harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)
    assert found.least_switching_voltage == pytest.approx(THRESHOLD + 4 * DROP)
    level = 0.2 * V_OC + 2 * DROP + own
    fires = (2 * V_OC * COS - level * (1 + INVERTED)) / (1 - INVERTED)
    wanted = 2 * FREQUENCY * 0.2 * V_OC * CAPACITANCE * (fires - after_flip(fires, level))
    found = steady(SelfPoweredSeriesSSHI(**KEYS, dc_voltage=0.2 * V_OC, breaker_drop=own))
    assert found.harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_series(share):
    dc = share * V_OC
    level = dc + 3 * DROP
    fires = (2 * V_OC * COS - level * (1 + INVERTED)) / (1 - INVERTED)
    wanted = 2 * FREQUENCY * dc * CAPACITANCE * (fires - after_flip(fires, level))
    assert steady(behind(SelfPoweredSeriesSSHI, dc)).harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


def test_extraction():
    """From empty electrodes the voltage rises by V_oc (1 + cos phi), and has fallen by threshold and drop."""
    fires = 2 * V_OC * COS
    shunt = SelfPoweredSECE(**{**KEYS, "quality": 1e8}, efficiency=0.8)
    wanted = 2 * FREQUENCY * 0.8 * CAPACITANCE * (0.5 * fires**2 - 2 * DROP * fires)
    assert steady(shunt).harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


def test_a_switch_with_a_resistance_inverts_less():
    """As in a parallel SSHI: the quality is that of the loop with its switch."""
    keys = {"inductance": 0.1, "quality": 5.0, "switch_resistance": 100.0, "dc_voltage": 1.0}
    root = math.sqrt(0.1 / CAPACITANCE)
    found = SelfPoweredSSHI(**keys, envelope_capacitance=1e-9, threshold=0.6).inversion(CAPACITANCE)
    assert found == pytest.approx(math.exp(-math.pi / 2 * (1 / 5.0 + 100.0 / root)), rel=1e-12)


def test_damping():
    """The peak is what a breaker fires at, with threshold and drop."""
    fires = (2 * V_OC * COS - DROP * (1 + INVERTED)) / (1 - INVERTED)
    found = steady(behind(SelfPoweredSSDI, 0.0))
    assert found.voltage_amplitude == pytest.approx(fires + THRESHOLD + DROP, rel=CLOSE, abs=0)
    assert found.harvested_power == 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_least_amplitude(kind):
    """Below it no breaker passes a current, above it one does."""
    shunt = behind(kind, 0.0)
    least = steady(shunt).least_switching_voltage
    assert least == pytest.approx(THRESHOLD + {SelfPoweredSeriesSSHI: 4, SelfPoweredSECE: 3}.get(kind, 2) * DROP)
    flips = []
    for share in (0.98, 1.02):
        # A bridge without a voltage behind it would hold the electrodes: the leads are free until one breaker closes.
        free = behind(kind, 2 * V_OC if kind is SelfPoweredSSHI else 0.0)
        found = steady(free, SineForce(amplitude=share * least / V_OC * FORCE, frequency=FREQUENCY))
        flips.append(found.voltage_amplitude / (share * least) > 1.005 or found.harvested_power > 0)
    assert flips == [False, True]


def test_what_is_at_rest_says_so():
    found = simulate(
        System(STIFF, behind(SelfPoweredSSDI, 0.0)), SineForce(amplitude=0.01 * FORCE, frequency=FREQUENCY)
    )
    assert "no breaker closes" in found.message


# Envelope capacitors that take something: while the voltage falls, that of maxima is beside C once its junction pulls
# it, that of minima all the way, as it begins to be charged where the breaker closes.
BESIDE = 1 / 20  # of C


def pulled_swing(fires, level, within=True):
    """Voltage that a swing about a level ends at, from where a breaker closes, with its sign changed.

    The capacitor of maxima is pulled within the swing, or not.
    """
    # Units of sqrt(L C) and sqrt(L/C): c w' = -i, i' = w - i/Q.
    now = np.array([fires - level, 0.0])
    for beside, below in ((1, -THRESHOLD - level), (2 if within else 1, None)):
        rates = np.array([[0.0, -1 / (1 + beside * BESIDE)], [1.0, -1 / QUALITY]])

        def at(time, rates=rates, begins=now):
            return expm(rates * time) @ begins

        def left(time, at=at, below=below):
            return at(time)[1] if below is None else below - at(time)[0]

        now = at(brentq(left, 1e-3, 3.3 if below is None else 2.6, xtol=1e-14))
    return -(now[0] + level)


def fires_at(after):
    """Voltage at which a breaker closes, if it does so `after` a swing from there."""
    return brentq(lambda fires: after(fires) - fires, 2 * V_OC, 6 * V_OC, xtol=1e-14)


def after_the_swing(fires, level):
    """Strain adds to the voltage that a swing has left, up to the peak, and takes threshold and drop from that."""
    return pulled_swing(fires, level) + V_OC * (1 + COS) / (1 + 2 * BESIDE) - THRESHOLD - DROP


BEHIND = {**KEYS, "envelope_capacitance": BESIDE * CAPACITANCE}


def test_capacitors_pulled_below_zero_in_damping():
    fires = fires_at(lambda fires: after_the_swing(fires, DROP))
    found = steady(SelfPoweredSSDI(**BEHIND))
    assert found.voltage_amplitude == pytest.approx(fires + THRESHOLD + DROP, rel=CLOSE, abs=0)


def test_capacitors_pulled_below_zero_in_series():
    dc = 0.4 * V_OC
    level = dc + 3 * DROP
    fires = fires_at(lambda fires: after_the_swing(fires, level))
    passes = (1 + BESIDE) * (fires + THRESHOLD) + (1 + 2 * BESIDE) * (pulled_swing(fires, level) - THRESHOLD)
    wanted = 2 * FREQUENCY * dc * CAPACITANCE * passes
    found = steady(SelfPoweredSeriesSSHI(**BEHIND, dc_voltage=dc))
    assert found.harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


def test_capacitors_pulled_below_zero_beside_a_bridge():
    dc = 0.8 * V_OC
    held = dc + 2 * DROP
    left = pulled_swing(held - THRESHOLD - DROP, DROP)
    wanted = 2 * FREQUENCY * dc * CAPACITANCE * (V_OC * (1 + COS) - (1 + 2 * BESIDE) * (held - left))
    found = steady(SelfPoweredSSHI(**BEHIND, dc_voltage=dc))
    assert found.harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


def test_a_resistance_of_the_base_pulls_a_capacitor_after_the_swing():
    """It takes thousands of swings for that, but less than the bridge conducts: the junction rests with that."""
    dc = 0.8 * V_OC
    held = dc + 2 * DROP
    left = pulled_swing(held - THRESHOLD - DROP, DROP, within=False)
    pulled = BESIDE * (held - THRESHOLD)
    wanted = 2 * FREQUENCY * dc * CAPACITANCE * (V_OC * (1 + COS) - (1 + BESIDE) * (held - left) - pulled)
    resistance = 0.02 / (OMEGA * BEHIND["envelope_capacitance"])
    found = steady(SelfPoweredSSHI(**BEHIND, dc_voltage=dc, base_resistance=resistance))
    assert found.harvested_power == pytest.approx(wanted, rel=1e-4, abs=0)


@pytest.mark.parametrize("resistance", [1e3, 220e3])
def test_a_junction_rests_with_a_bridge(resistance):
    """At a voltage that a bridge holds, its current decays to rounding, which would let it block and conduct."""
    shunt = SelfPoweredSSHI(
        inductance=0.1, quality=5.0, envelope_capacitance=2e-9, threshold=0.17, diode_drop=0.5, breaker_drop=0.65,
        switch_resistance=30.0, dc_voltage=15.0, base_resistance=resistance,
    )  # fmt: skip
    omega = 2 * math.pi * 42.0
    force = 20.0 * CAPACITANCE / COUPLING * abs(1e6 - 0.63 * omega**2 + 480j * omega)
    steady(shunt, SineForce(amplitude=force, frequency=42.0))


def test_capacitors_pulled_below_zero_after_an_extraction():
    """The capacitor of minima is charged from where a breaker closes on; that of maxima is pulled from V_th on."""
    peak = (2 * V_OC - THRESHOLD - DROP + BESIDE * THRESHOLD) / (1 + 2 * BESIDE)
    fires = peak - THRESHOLD - DROP
    wanted = 2 * FREQUENCY * (1 + BESIDE) * CAPACITANCE * (0.5 * fires**2 - 2 * DROP * fires)
    found = steady(SelfPoweredSECE(**{**BEHIND, "quality": 1e8}))
    assert found.voltage_amplitude == pytest.approx(peak, rel=CLOSE, abs=0)
    assert found.harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


def test_a_capacitor_that_is_not_charged_above_zero_closes_nothing():
    """Charged and pulled by less than the drop of its diode, it loses that and the threshold in each period."""
    keys = {**BEHIND, "diode_drop": 1.1 * V_OC, "threshold": 0.1 * V_OC}
    found = steady(SelfPoweredSSDI(**keys))
    both = keys["diode_drop"] + keys["threshold"]
    peak = (V_OC + BESIDE * both) / (1 + 2 * BESIDE)
    assert "no breaker closes" in found.message
    assert found.voltage_amplitude == pytest.approx(peak, rel=1e-7, abs=0)
    lost = 2 * BESIDE * CAPACITANCE * (2 * peak - both) * both
    assert found.energy["shunt_loss"] == pytest.approx(lost, rel=1e-7, abs=0)


def test_envelope_capacitors_cost_what_they_hold():
    """With larger ones less is harvested."""
    capacitors = [share * CAPACITANCE for share in (1e-6, 1e-2, 1e-1)]
    shunts = [SelfPoweredSSHI(**{**KEYS, "envelope_capacitance": each}, dc_voltage=V_OC) for each in capacitors]
    powers = [steady(shunt).harvested_power for shunt in shunts]
    assert powers == sorted(powers, reverse=True) and powers[2] < 0.99 * powers[0]


@pytest.mark.parametrize("kind", [SelfPoweredSSHI, SelfPoweredSECE])
def test_consumption_is_taken_from_the_harvest(kind):
    plain = steady(behind(kind, V_OC))
    takes = 0.1 * plain.harvested_power
    keys = {**KEYS, "consumption": takes, **({"dc_voltage": V_OC} if kind is SelfPoweredSSHI else {})}
    assert steady(kind(**keys)).harvested_power == pytest.approx(0.9 * plain.harvested_power, rel=1e-6, abs=0)


@pytest.mark.parametrize("kind", [SelfPoweredSSHI, SelfPoweredSeriesSSHI])
def test_breakers_charge_a_store(kind):
    """From an empty store to the supply that it feeds."""
    keys = {"quality": 5.0, "inductance": 0.1, "envelope_capacitance": 1e-9, "threshold": 0.6, "diode_drop": 0.3}
    storage = Storage(turn_on=2.0, turn_off=1.0, power=1e-3)
    system = System(Transducer(**BENCH), kind(**keys, smoothing_capacitance=1e-6, storage=storage))
    found = simulate(system, SineForce(amplitude=0.02, frequency=50.6), transient=0.6, attenuation=False)
    assert found.converged, found.message
    assert abs(found.energy["closure"]) < 1e-10
    assert found.time_to_turn_on is not None and found.energy["harvested"] > 0


# A coil with a core: the swing by a matrix exponential, until no current passes the breaker.
CORE = 4.0  # over sqrt(L/C)


def cored_swing():
    """Shares of a voltage that a swing leaves where the current ends, and of the energy in L where it is zero."""
    # Units of sqrt(L C) and sqrt(L/C): u' = -i, i_L' = R_c (i - i_L), i = (u + R_c i_L)/(R + R_c).
    through = np.array([1.0, CORE]) / (1 / QUALITY + CORE)
    rates = np.array([-through, CORE * (through - [0.0, 1.0])])

    def at(time):
        return expm(rates * time) @ [1.0, 0.0]

    ends = brentq(lambda time: through @ at(time), 1.0, 4.0, xtol=1e-14)
    empty = brentq(lambda time: at(time)[0], 0.5, 3.0, xtol=1e-14)
    return -at(ends)[0], at(empty)[1] ** 2


def cored(**keys):
    root = math.sqrt((1e-6 / FREQUENCY / math.pi) ** 2 * (1 - 0.25 / QUALITY**2)) / CAPACITANCE
    return {**KEYS, "core_resistance": CORE * root, **keys}


def test_a_core_takes_its_share_of_an_inversion():
    share, _ = cored_swing()
    assert 0.3 < share < INVERTED - 0.1
    fires = (2 * V_OC * COS - DROP * (1 + share)) / (1 - share)
    damped = steady(SelfPoweredSSDI(**cored()))
    assert damped.voltage_amplitude == pytest.approx(fires + THRESHOLD + DROP, rel=CLOSE, abs=0)
    dc = 0.8 * V_OC
    held = dc + 2 * DROP
    left = DROP - share * (held - THRESHOLD - 2 * DROP)
    wanted = 2 * FREQUENCY * dc * CAPACITANCE * (V_OC * (1 + COS) - held - left)
    found = steady(SelfPoweredSSHI(**cored(dc_voltage=dc)))
    assert found.harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


def test_a_core_takes_its_share_in_series():
    share, _ = cored_swing()
    level = 0.4 * V_OC + 3 * DROP
    fires = (2 * V_OC * COS - level * (1 + share)) / (1 - share)
    wanted = 2 * FREQUENCY * 0.4 * V_OC * CAPACITANCE * (1 + share) * (fires - level)
    found = steady(SelfPoweredSeriesSSHI(**cored(dc_voltage=0.4 * V_OC)))
    assert found.harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


def test_a_core_takes_its_share_of_what_is_extracted():
    _, held = cored_swing()
    fires = 2 * V_OC * (1 - THRESHOLD / V_OC)
    wanted = 2 * FREQUENCY * held * CAPACITANCE * fires**2 / 2
    found = steady(SelfPoweredSECE(**cored(diode_drop=0.0)))
    assert found.harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize(("core", "base"), [(None, 0.0), (1e4, 0.0), (None, 2e5)])
@pytest.mark.parametrize("kind", KINDS)
def test_against_ngspice(kind, core, base):
    keys = {"quality": 5.0, "inductance": 0.1, "envelope_capacitance": 1e-9, "threshold": 0.6, "diode_drop": 0.3}
    keys |= {"breaker_drop": 0.5 if core else None, "base_resistance": base}
    dc = {SelfPoweredSSHI: {"dc_voltage": 5.0}, SelfPoweredSeriesSSHI: {"dc_voltage": 3.0}}.get(kind, {})
    system = System(Transducer(**BENCH), kind(**keys, **dc, core_resistance=core))
    figures, trusted = compare(system, SineForce(amplitude=0.02, frequency=50.6))
    assert trusted
    for figure in figures:
        assert abs(figure.difference) < 0.01, figure
