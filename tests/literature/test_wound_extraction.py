"""Windings of coils that extract charge, and of those behind electronic breakers: closed forms, DOP853."""

import math

import numpy as np
import pytest
from messages import is_sentence
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq
from studies import BENCH

from piezoharvest import SineForce, System, Transducer, simulate
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import (
    ESSH,
    SCSECE,
    SECE,
    SICE,
    SSDS,
    SelfPoweredSECE,
    SelfPoweredSeriesSSHI,
    SelfPoweredSSDI,
    SelfPoweredSSHI,
)
from piezoharvest.design.goal import largest_inductance

# So weakly coupled (k_e^2 = 1e-8) that no shunt can change the displacement; flips of a 1e-6th of the period, after
# which a winding rings out within a 1e-4th.
FREQUENCY, CAPACITANCE, COUPLING = 20.0, 40e-9, 2e-5
OMEGA = 2 * math.pi * FREQUENCY
STIFF = Transducer(mass=0.63, damping=480.0, stiffness=1e6, coupling=COUPLING, capacitance=CAPACITANCE)
V_OC = COUPLING * 100.0 / abs(1e6 - 0.63 * OMEGA**2 + 480j * OMEGA) / CAPACITANCE
QUALITY = 6.0
INDUCTANCE = (1e-6 / FREQUENCY / math.pi) ** 2 / CAPACITANCE
ROOT = math.sqrt(INDUCTANCE / CAPACITANCE)
WINDING, SWITCH, CORE = ROOT / QUALITY, 0.2 * ROOT, 5 * ROOT
STRAY = CAPACITANCE / 10
COIL = {
    "inductance": INDUCTANCE, "quality": QUALITY, "switch_resistance": SWITCH,
    "self_resonance": 1 / (2 * math.pi * math.sqrt(STRAY * INDUCTANCE)),
}  # fmt: skip
CLOSE = 1e-5  # in a flip strain moves on by a share of 2 pi 1e-6
each_core = pytest.mark.parametrize("core", [None, CORE], ids=["no core", "core"])


def loop(core, capacitance=CAPACITANCE, inductance=INDUCTANCE, line=0.0):
    """Rates of the capacitance's voltage, of the current of L and of the winding's voltage, and the current's row."""
    into = np.array([1.0, 0.0, -1.0]) / (SWITCH + line)
    wound = np.array([0.0, core, 1.0]) / (WINDING + core) if core else np.array([0.0, 1.0, 0.0])
    across = np.array([0.0, 0.0, 1.0]) - WINDING * wound
    return np.array([-into / capacitance, across / inductance, (into - wound) / STRAY]), into


def after(time, core, **parts):
    """The same after a while, from one volt."""
    return expm(loop(core, **parts)[0] * time)[:, 0]


def timed(length):
    """Seconds for which the switch is closed: timed for the loop without core and winding."""
    decay = (WINDING + SWITCH) / (2 * INDUCTANCE)
    damped = math.sqrt(1 / (INDUCTANCE * CAPACITANCE) - decay**2)
    return math.pi / damped if length == "swing" else (0.5 * math.pi + math.atan(decay / damped)) / damped


def held(state):
    """Energy of the coil over that of the electrodes at one volt."""
    return (INDUCTANCE * state[1] ** 2 + STRAY * state[2] ** 2) / CAPACITANCE


def steady(shunt):
    found = simulate(System(STIFF, shunt), SineForce(amplitude=100.0, frequency=FREQUENCY), attenuation=False)
    assert found.converged, found.message
    assert abs(found.energy["closure"]) < 1e-10
    return found


@each_core
def test_extraction(core):
    """C and C_w share the voltage, swing, and are not empty when the switch opens; all of the coil goes to the load."""
    left = after(timed("empty"), core)
    voltage = 2 * V_OC / (1 + left[0])
    wanted = 2 * FREQUENCY * 0.8 * held(left) * CAPACITANCE * voltage**2 / 2
    found = steady(SECE(**COIL, core_resistance=core, efficiency=0.8))
    assert found.harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)
    plain = steady(SECE(**{**COIL, "self_resonance": None}, core_resistance=core, efficiency=0.8))
    assert found.harvested_power < 0.97 * plain.harvested_power  # charging the winding costs C_w/(C + C_w)/2 and more


@each_core
def test_short_after_extraction(core):
    """The electrodes are empty after the short, whatever the extraction left."""
    left = after(timed("empty"), core)
    short = 1e-5 / FREQUENCY  # 1e-5 of the period: 150 time constants
    wanted = 2 * FREQUENCY * held(left) * CAPACITANCE * (2 * V_OC) ** 2 / 2
    found = steady(SCSECE(**COIL, core_resistance=core, short_time=short))
    assert found.harvested_power == pytest.approx(wanted, rel=1e-4, abs=0)


@each_core
def test_inversion_and_extraction(core):
    inverted, left = -after(timed("swing"), core)[0], after(timed("empty"), core)
    voltage = 2 * V_OC * (1 + inverted) / (1 + inverted * left[0])
    wanted = FREQUENCY * held(left) * CAPACITANCE * voltage**2 / 2
    found = steady(SICE(**COIL, core_resistance=core))
    assert found.harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


@each_core
def test_emptying(core):
    """The energy that is not on the electrodes any more is lost, in the end."""
    left = after(timed("empty"), core)[0]
    voltage = 2 * V_OC / (1 + left)
    found = steady(SSDS(**COIL, core_resistance=core))
    assert found.energy["shunt_loss"] == pytest.approx(CAPACITANCE * voltage**2 * (1 - left**2), rel=CLOSE, abs=0)


# --- electronic breakers: until the current through the breaker ends ---

THRESHOLD, DROP = 0.06 * V_OC, 0.02 * V_OC
COS = 1 - (THRESHOLD + DROP) / V_OC
BREAKER = {**COIL, "envelope_capacitance": 1e-6 * CAPACITANCE, "threshold": THRESHOLD, "diode_drop": DROP}


def breaks(core, **parts):
    """State where the current ends, and time at which the electrodes are empty."""
    rates, into = loop(core, **parts)
    unit = timed("swing")
    return brentq(lambda t: into @ (expm(rates * t) @ [1.0, 0.0, 0.0]), 0.3 * unit, 1.4 * unit, xtol=1e-14 * unit)


@each_core
def test_breakers_invert(core):
    share = -after(breaks(core), core)[0]
    fires = (2 * V_OC * COS - DROP * (1 + share)) / (1 - share)
    damped = steady(SelfPoweredSSDI(**BREAKER, core_resistance=core))
    assert damped.voltage_amplitude == pytest.approx(fires + THRESHOLD + DROP, rel=CLOSE, abs=0)
    dc = 0.8 * V_OC
    left = DROP - share * (dc + 2 * DROP - THRESHOLD - 2 * DROP)
    wanted = 2 * FREQUENCY * dc * CAPACITANCE * (V_OC * (1 + COS) - (dc + 2 * DROP) - left)
    found = steady(SelfPoweredSSHI(**BREAKER, core_resistance=core, dc_voltage=dc))
    assert found.harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


@each_core
def test_breakers_in_series(core):
    line = 0.1 * ROOT
    share = -after(breaks(core, line=line), core, line=line)[0]
    level = 0.4 * V_OC + 3 * DROP
    fires = (2 * V_OC * COS - level * (1 + share)) / (1 - share)
    wanted = 2 * FREQUENCY * 0.4 * V_OC * CAPACITANCE * (1 + share) * (fires - level)
    shunt = SelfPoweredSeriesSSHI(**BREAKER, core_resistance=core, dc_voltage=0.4 * V_OC, diode_resistance=line / 2)
    assert steady(shunt).harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


@each_core
def test_breakers_extract(core):
    """What is in the inductance where the electrodes are empty goes to the load."""
    unit = timed("swing")
    empty = brentq(lambda t: after(t, core)[0], 0.2 * unit, unit, xtol=1e-14 * unit)
    share = INDUCTANCE * after(empty, core)[1] ** 2 / CAPACITANCE
    fires = 2 * V_OC * (1 - THRESHOLD / V_OC)
    wanted = 2 * FREQUENCY * share * CAPACITANCE * fires**2 / 2
    shunt = SelfPoweredSECE(**{**BREAKER, "diode_drop": 0.0}, core_resistance=core)
    assert steady(shunt).harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


# --- the second coil of ESSH, which an intermediate capacitor at a voltage of its own feeds ---


@each_core
def test_second_coil(core):
    """What a transfer takes, and what it leaves of the intermediate voltage, is that of its loop."""
    between = 3 * CAPACITANCE
    second = {
        "second_inductance": INDUCTANCE, "second_quality": math.sqrt(INDUCTANCE / between) / WINDING,
        "second_switch_resistance": SWITCH, "second_self_resonance": COIL["self_resonance"],
        "second_core_resistance": core, "residual": 0.5, "intermediate_capacitance": between,
    }  # fmt: skip
    shunt = ESSH(inductance=INDUCTANCE, quality=QUALITY, on_time_error=0.3, **second)
    left = after(math.acos(0.5) * math.sqrt(INDUCTANCE * between), core, capacitance=between)
    # First stage, ideal coil of this quality in line with both capacitors: the current ends after half a swing.
    both = CAPACITANCE * between / (CAPACITANCE + between)
    decay = WINDING / (2 * INDUCTANCE)
    q = math.exp(-decay * math.pi / math.sqrt(1 / (INDUCTANCE * both) - decay**2))

    def charged(residual):
        """Voltages before and after the first stage, from what the transfer before has left."""
        # V falls by (1 + q) (V - W) both/C to V_left, by which W rises by C/between; V = 2 V_oc - V_left.
        step = (1 + q) * both
        fired = (V_OC - step / (2 * CAPACITANCE) * residual) / (1 - step / (2 * CAPACITANCE))
        peak = residual + step / between * (fired - residual)
        return fired, peak

    residual = brentq(lambda w: left[0] * charged(w)[1] - w, 0.0, 3 * V_OC)
    peak = charged(residual)[1]
    energy = INDUCTANCE * left[1] ** 2 + STRAY * left[2] ** 2
    wanted = 2 * FREQUENCY * energy * peak**2 / 2
    assert steady(shunt).harvested_power == pytest.approx(wanted, rel=CLOSE, abs=0)


# --- the bench from rest: so long that the bridge blocks, and conducts again where the winding has rung ---

DRIVE = SineForce(amplitude=0.02, frequency=50.6)
LOOP = {"inductance": 0.1, "quality": 50.0, "switch_resistance": 1500.0, "self_resonance": 6e3}
KEYS = {"diode_drop": 0.05, "diode_resistance": 50.0, "on_time_error": 2.0}
R_WINDING, C_WINDING = math.sqrt(0.1 / BENCH["capacitance"]) / 50.0, 1 / ((2 * math.pi * 6e3) ** 2 * 0.1)


def event(function, direction):
    def found(t, z):
        return function(z)

    found.terminal, found.direction = True, direction
    return found


def from_rest(length, closed):
    """Parts of a run: x, u, v, i, w; with the energy that the load has when the switch opens, and times of conducting.

    The bridge conducts with the sign s of the voltage at the extremum: i = (v - s 0.1 - w)/1600 ohm. Once v has been
    zero, i = (-s 0.1 - w)/1550 ohm goes round through all of it, and 50 ohm short the electrodes.
    """

    def current(z, s):
        return (-s * 0.1 - z[4]) / 1550.0 if empty else (z[2] - s * 0.1 - z[4]) / 1600.0

    def rates(s):
        def found(t, z):
            into = current(z, s) if s else 0.0
            drawn = z[2] / 50.0 if s and empty else into
            force = DRIVE.amplitude * math.sin(2 * math.pi * DRIVE.frequency * t)
            push = force + BENCH["coupling"] * z[2] - BENCH["damping"] * z[1] - BENCH["stiffness"] * z[0]
            strain, drop = -BENCH["coupling"] * z[1], z[4] - R_WINDING * z[3]
            rise = (strain - drawn) / BENCH["capacitance"]
            return [z[1], push / BENCH["mass"], rise, drop / 0.1, (into - z[3]) / C_WINDING]

        return found

    t, z, parts, delivered, turning, again = 0.0, np.zeros(5), [], 0.0, -1, 0
    side, conducts, opens, empty = 0, False, math.inf, False
    while t < length:
        events = [event(lambda z, s=side, d=conducts: s * current(z, s), -1 if conducts else 1)]
        if conducts and not empty:
            events.append(event(lambda z, s=side: s * z[2], -1))
        if opens == math.inf:
            events = [event(lambda z: z[1], turning)]
        part = solve_ivp(
            rates(side if conducts else 0), (t, min(length, opens)), z, "Radau" if conducts and empty else "DOP853",
            events=events, rtol=1e-11, atol=[1e-16, 1e-13, 1e-10, 1e-14, 1e-10], max_step=2e-3, dense_output=True,
        )  # fmt: skip
        parts.append(part.sol)
        t, z = part.t[-1], part.y[:, -1].copy()
        happened = part.t_events[0].size > 0
        if opens == math.inf and happened:
            side, opens, empty = (-1 if turning < 0 else 1), t + closed, False
            conducts, turning = side * current(z, side) > 0, -turning
        elif happened:
            conducts = not conducts
            again += conducts
        elif len(part.t_events) > 1 and part.t_events[1].size:
            empty = True
        elif opens < math.inf and t >= opens:
            delivered += 0.1 * z[3] ** 2 / 2 + C_WINDING * z[4] ** 2 / 2
            z[3:], side, conducts, opens = 0.0, 0, False, math.inf
    return parts, delivered, again


def test_a_winding_rings_behind_the_bridge():
    shunt, length = SECE(**LOOP, **KEYS), 0.08
    closed = shunt.on_time(BENCH["capacitance"])
    found = simulate(System(Transducer(**BENCH), shunt), DRIVE, transient=length, samples=4000, attenuation=False)
    assert abs(found.energy["closure"]) < 1e-10
    parts, delivered, again = from_rest(length, closed)
    assert again > 2  # else nothing is tested
    waves = found.waveforms
    for part in parts:
        here = (waves.time > part.t_min + 1e-7) & (waves.time < part.t_max - 1e-7)
        if here.any():
            x, _, v, _, _ = part(waves.time[here])
            np.testing.assert_allclose(
                waves.displacement[here], x, rtol=0, atol=1e-7 * np.abs(waves.displacement).max()
            )
            np.testing.assert_allclose(waves.voltage[here], v, rtol=0, atol=1e-6 * np.abs(waves.voltage).max())
    assert found.energy["harvested"] == pytest.approx(delivered, rel=1e-6, abs=0)


@pytest.mark.parametrize("kind", [SECE, SSDS])
@pytest.mark.parametrize("key", ["self_resonance", "switch_resistance"])
def test_parts_of_a_coil_that_is_not_there_are_refused(kind, key):
    with pytest.raises(ParameterError) as caught:
        kind(**{"switch_resistance": 10.0, key: 1e4})
    assert caught.value.key == "switch_resistance"
    assert is_sentence(caught.value.message)


def test_a_second_winding_needs_a_second_switch():
    with pytest.raises(ParameterError) as caught:
        ESSH(
            inductance=0.1, quality=5.0, intermediate_capacitance=1e-7, second_inductance=0.1, second_quality=5.0,
            residual=0.5, second_self_resonance=1e5,
        )  # fmt: skip
    assert caught.value.key == "second_self_resonance"
    assert "second_switch_resistance" in caught.value.message
    assert is_sentence(caught.value.message)


@pytest.mark.parametrize("shunt", [SECE(**LOOP), SICE(**LOOP), SSDS(**LOOP), SECE(inductance=0.1, quality=5.0)])
def test_a_limit_of_inductance_knows_every_coil(shunt):
    assert largest_inductance(shunt, BENCH["capacitance"]) == 0.1
