"""Switched coils with the capacitance of their winding: closed forms, and DOP853 with events."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from messages import is_sentence
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from studies import BENCH, bench, solve

from piezoharvest import SineForce, System, Transducer, gradient, simulate
from piezoharvest.bench.settings import check_shunt
from piezoharvest.bench.solver import CIRCUITS, Model, integrate
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import SSDI, BiasFlip, ParallelSSHI, SeriesSSHI
from piezoharvest.study import build_shunt

# So weakly coupled (k_e^2 = 1e-12) that no shunt can change the displacement; flips of a 1e-6th of the period, after
# which the winding rings out within a 1e-4th.
FREQUENCY, CAPACITANCE, COUPLING = 20.0, 40e-9, 2e-7
OMEGA = 2 * math.pi * FREQUENCY
STIFF = Transducer(mass=0.63, damping=480.0, stiffness=1e6, coupling=COUPLING, capacitance=CAPACITANCE)
V_OC = COUPLING * 100.0 / abs(1e6 - 0.63 * OMEGA**2 + 480j * OMEGA) / CAPACITANCE
QUALITY = 6.0
INDUCTANCE = (1e-6 / FREQUENCY / math.pi) ** 2 / CAPACITANCE
ROOT = math.sqrt(INDUCTANCE / CAPACITANCE)
WINDING = ROOT / QUALITY
RINGS = 2e8  # rad/s, 3 times that of the loop: C_w = C/10
STRAY = 1 / (RINGS**2 * INDUCTANCE)
BOTH = CAPACITANCE + STRAY


def coil(switch, **more):
    return {
        "inductance": INDUCTANCE, "quality": QUALITY, "switch_resistance": switch,
        "self_resonance": RINGS / (2 * math.pi), **more,
    }  # fmt: skip


def swing_time(resistance):
    return math.pi / math.sqrt(1 / (INDUCTANCE * CAPACITANCE) - (resistance / (2 * INDUCTANCE)) ** 2)


def inverted(switch, core):
    """Share of the voltage that the loop inverts by itself: v, the current of L and the voltage w of the winding."""
    into = np.array([1.0, 0.0, -1.0]) / switch
    wound = np.array([0.0, core, 1.0]) / (WINDING + core) if core else np.array([0.0, 1.0, 0.0])
    across = np.array([0.0, 0.0, 1.0]) - WINDING * wound
    rates = np.array([-into / CAPACITANCE, across / INDUCTANCE, (into - wound) / STRAY])
    return -expm(rates * swing_time(WINDING + switch))[0, 0]


@pytest.mark.parametrize(("switch", "core"), [(0.1 * ROOT, None), (0.3 * ROOT, 5 * ROOT)])
def test_inversion_is_that_of_the_loop(switch, core):
    share = inverted(switch, core)
    assert share < math.exp(-math.pi * (WINDING + switch) / (2 * ROOT)) - 0.05  # that of a coil without a winding
    voltage = 0.8 * V_OC
    wanted = 2 * FREQUENCY * voltage * CAPACITANCE * (2 * V_OC - voltage * (1 - share))
    for cls, more in ((ParallelSSHI, {}), (BiasFlip, {"steps": 1})):
        shunt = cls(dc_voltage=voltage, **coil(switch, core_resistance=core), **more)
        found = simulate(System(STIFF, shunt), SineForce(amplitude=100.0, frequency=FREQUENCY))
        assert found.converged
        assert abs(found.energy["closure"]) < 1e-10
        assert found.harvested_power == pytest.approx(wanted, rel=1e-5, abs=0)


def test_quick_charge_of_a_winding_shares_the_voltage():
    """Through hardly a resistance C and C_w are at V C/(C + C_w) at once, and swing together from there."""
    switch = 1e-3 * ROOT
    decay = WINDING / (2 * INDUCTANCE)
    damped = math.sqrt(1 / (INDUCTANCE * BOTH) - decay**2)
    share = CAPACITANCE / BOTH * math.exp(-decay * math.pi / damped)
    longer = math.pi / damped / swing_time(WINDING + switch) - 1
    voltage = 0.8 * V_OC
    wanted = 2 * FREQUENCY * voltage * CAPACITANCE * (2 * V_OC - voltage * (1 - share))
    shunt = ParallelSSHI(dc_voltage=voltage, **coil(switch, on_time_error=longer))
    found = simulate(System(STIFF, shunt), SineForce(amplitude=100.0, frequency=FREQUENCY))
    assert found.harvested_power == pytest.approx(wanted, rel=1e-3, abs=0)
    # What design begins with, for a switch that is timed as without a winding.
    assert shunt.inversion(CAPACITANCE) == pytest.approx(share, rel=0.02)


# --- the whole bench, written out ---

DRIVE = SineForce(amplitude=0.02, frequency=50.6)
LOOP = {"inductance": 0.1, "quality": 5.0, "switch_resistance": 200.0, "self_resonance": 8e3}
R_WINDING = math.sqrt(0.1 / BENCH["capacitance"]) / 5.0
C_WINDING = 1 / ((2 * math.pi * 8e3) ** 2 * 0.1)
CLOSED = math.pi / math.sqrt(1 / (0.1 * BENCH["capacitance"]) - ((R_WINDING + 200.0) / 0.2) ** 2)


def crossing(function, direction):
    def event(t, z):
        return function(z)

    event.terminal, event.direction = True, direction
    return event


def from_rest(length, closed, line=0.0, opposing=None, core=None, winding=True):
    """Times, and x, u, v, i, w there; between the coil and the switch there may be a bridge to a dc voltage.

    A core is a resistance beside the inductance; without a winding's capacitance, w stays at zero.

    The switch closes where u crosses zero, for `closed` seconds. While it is closed the bridge blocks, or conducts with
    one sign.
    """
    through = 200.0 + line

    def current(z, sign):
        return (z[2] - z[4] - sign * opposing) / through if opposing else (z[2] - z[4]) / through

    def rates(sign):
        def found(t, z):
            x, u, v, i, w = z.tolist()
            into = current(z, sign) if sign is not None else 0.0
            force = DRIVE.amplitude * math.sin(2 * math.pi * DRIVE.frequency * t)
            push = force + BENCH["coupling"] * v - BENCH["damping"] * u - BENCH["stiffness"] * x
            strain = -BENCH["coupling"] * u
            if winding:
                wound = (w + core * i) / (R_WINDING + core) if core else i
                drop, charging = w - R_WINDING * wound, (into - wound) / C_WINDING
            else:
                into = (v + core * i) / (R_WINDING + through + core) if sign is not None else 0.0
                drop, charging = core * (into - i), 0.0
            return [u, push / BENCH["mass"], (strain - into) / BENCH["capacitance"], drop / 0.1, charging]

        return found

    t, z, opens, turning, sign, waves = 0.0, np.zeros(5), math.inf, -1, None, []
    while t < length:
        begins = [crossing(lambda z, s=s: s * (z[2] - z[4]) - opposing, 1) for s in (1, -1)] if opposing else []
        if opens < math.inf:
            watched = begins if sign is None else [crossing(lambda z, s=sign: s * current(z, s), -1)]
            watched = watched if opposing else []
        else:
            watched = [crossing(lambda z: z[1], turning)]
        end = min(length, opens)
        part = solve_ivp(
            rates(sign), (t, end), z, "DOP853", events=watched or None, rtol=1e-11,
            atol=[1e-16, 1e-13, 1e-10, 1e-14, 1e-10], max_step=2e-3, dense_output=True,
        )  # fmt: skip
        waves.append(part.sol)
        t, z = part.t[-1], part.y[:, -1]
        happened = [n for n, times in enumerate(part.t_events or []) if times.size]
        if opens < math.inf and happened and opposing:
            sign = (1, -1)[happened[0]] if sign is None else None
        elif opens < math.inf:
            sign, opens = None, math.inf
        elif happened:
            opens, turning = t + closed, -turning
            sign = None if opposing else 0
            if opposing and abs(z[2] - z[4]) > opposing:
                sign = 1 if z[2] > z[4] else -1
    return waves


@pytest.mark.parametrize(
    ("shunt", "closed", "keys"),
    [
        (SSDI(**LOOP), CLOSED, {}),
        (SSDI(**LOOP, on_time_error=-0.3), 0.7 * CLOSED, {}),
        # So long that the winding, ringing while the diodes block, sends a part back through them.
        (
            SeriesSSHI(**LOOP, dc_voltage=0.5, diode_drop=0.1, diode_resistance=50.0, on_time_error=0.5),
            1.5 * CLOSED,
            {"line": 100.0, "opposing": 0.7},
        ),
    ],
    ids=["ssdi", "opened early", "series_sshi"],
)
def test_runs_from_rest(shunt, closed, keys):
    length = 0.08
    found = simulate(System(Transducer(**BENCH), shunt), DRIVE, transient=length, samples=4000, attenuation=False)
    waves = found.waveforms
    assert abs(found.energy["closure"]) < 1e-10
    parts = from_rest(length, closed, **keys)
    assert len(parts) > 15
    edges = [part.t_min for part in parts] + [length]
    for part, (begin, end) in zip(parts, pairwise(edges), strict=True):
        here = (waves.time > begin + 1e-7) & (waves.time < end - 1e-7)
        if here.any():
            x, _, v, _, _ = part(waves.time[here])
            np.testing.assert_allclose(
                waves.displacement[here], x, rtol=0, atol=1e-7 * np.abs(waves.displacement).max()
            )
            np.testing.assert_allclose(waves.voltage[here], v, rtol=0, atol=1e-6 * np.abs(waves.voltage).max())


@pytest.mark.parametrize(
    ("share", "keys"),
    [(1.0, {}), (0.7, {}), (1.0, {"core": 1e4}), (0.8, {"core": 1e4, "winding": False})],
    ids=["winding", "opened early", "core and winding", "core"],
)
def test_runs_from_rest_on_the_bench(share, keys):
    loop = LOOP if keys.get("winding", True) else {**LOOP, "self_resonance": None}
    shunt, length = SSDI(**loop, on_time_error=share - 1.0, core_resistance=keys.get("core")), 0.08
    model = Model(Transducer(**BENCH), CIRCUITS["ssdi"](shunt), base=False)
    waves = integrate(model, DRIVE, np.arange(1601) * 5e-5)
    parts = from_rest(length, share * CLOSED, **keys)
    edges = [part.t_min for part in parts] + [length]
    # An extremum is located to a nanosecond, as the velocity is known to 1e-6: within a flip, so is all that follows.
    # What pushes with twice the voltage for so long at each extremum moves the mass from then on.
    late = 1e-9
    push = 2 * np.abs(waves.voltage).max() * BENCH["coupling"] * late / math.sqrt(BENCH["stiffness"] * BENCH["mass"])
    for flips, (part, (begin, end)) in enumerate(zip(parts, pairwise(edges), strict=True)):
        here = (waves.time > begin + 1e-7) & (waves.time < end - 1e-7)
        if here.any():
            times = waves.time[here]
            x, _, v, _, _ = part(times)
            slope = np.abs(part(times + 1e-8)[2] - part(times - 1e-8)[2]) / 2e-8
            exact = 1e-7 * np.abs(waves.displacement).max()
            assert np.all(np.abs(waves.displacement[here] - x) < exact + flips * push)
            assert np.all(np.abs(waves.voltage[here] - v) < 1e-6 * np.abs(waves.voltage).max() + late * slope)


def test_far_resonance_changes_nothing():
    far = SSDI(**{**LOOP, "self_resonance": 3e6})
    plain = dataclasses.replace(far, self_resonance=None)
    found, wanted = (simulate(System(Transducer(**BENCH), shunt), DRIVE) for shunt in (far, plain))
    assert found.displacement_amplitude == pytest.approx(wanted.displacement_amplitude, rel=1e-4)


def test_gradient_of_a_self_resonance():
    shunt = SSDI(**LOOP)
    found = gradient(System(Transducer(**BENCH), shunt), DRIVE)
    slope = found.by["displacement_amplitude"][found.quantities.index("shunt.self_resonance")]
    more, less = (
        simulate(System(Transducer(**BENCH), dataclasses.replace(shunt, self_resonance=8e3 + step)), DRIVE)
        for step in (1.0, -1.0)
    )
    assert slope == pytest.approx((more.displacement_amplitude - less.displacement_amplitude) / 2.0, rel=1e-5)


@pytest.mark.parametrize(
    ("keys", "key"),
    [
        ({"inductance": 0.1}, "self_resonance"),
        ({"flip_time": 1e-4}, "self_resonance"),
        ({"inductance": 0.1, "switch_resistance": 0.0}, "switch_resistance"),
    ],
)
def test_a_winding_behind_nothing_is_refused(keys, key):
    with pytest.raises(ParameterError) as caught:
        SSDI(quality=5.0, self_resonance=1e5, **keys)
    assert caught.value.key == key
    assert is_sentence(caught.value.message)


def test_the_virtual_bench_has_no_winding_in_line_with_a_bridge():
    check_shunt(SSDI(**LOOP), "shunts.0")
    with pytest.raises(ParameterError, match="only ideal ones in series_sshi"):
        check_shunt(SeriesSSHI(**LOOP, dc_voltage=1.0), "shunts.0")


def test_the_same_coil_beside_another_capacitance():
    shunt = ParallelSSHI(**LOOP, dc_voltage=1.0)
    moved = shunt.beside(40e-9, 60e-9)
    assert moved.loop(60e-9) == pytest.approx(shunt.loop(40e-9), rel=1e-12)
    assert moved.on_time(60e-9) == pytest.approx(shunt.on_time(40e-9), rel=1e-12)
    assert moved.stray_capacitance(60e-9) == pytest.approx(shunt.stray_capacitance(40e-9), rel=1e-12)


@pytest.mark.parametrize("resistance", [1e5, 3e6])
@pytest.mark.parametrize("esr", [0.0, 10.0])
def test_a_large_resistance_of_the_diodes_beside_a_winding(resistance, esr):
    """Against the bench: the bridge's current is what is left of that of the winding, a millionth of it."""
    sine = {"kind": "sine_force", "amplitude": 0.02, "frequency": 50.6}
    wound = {"inductance": 0.01, "quality": 10.0, "self_resonance": 2e4, "switch_resistance": 5.0}
    side = {"smoothing_capacitance": 1e-6, "load_resistance": 1e6, "diode_resistance": resistance, "diode_drop": 0.3}
    shunt = {"kind": "parallel_sshi", **wound, **side, "smoothing_resistance": esr}
    found = solve(bench(shunt, sine))
    assert found.converged
    assert found.energy["closure"] < 1e-9
    if not esr:  # which the bench has not
        run = solve(bench(shunt, sine), transient=0.1, samples=64).waveforms
        circuit = build_shunt(shunt)
        model = Model(Transducer(**BENCH), CIRCUITS["parallel_sshi"](circuit), base=False)
        wanted = integrate(model, SineForce(amplitude=0.02, frequency=50.6), run.time)
        assert np.abs(wanted.dc_voltage - run.dc_voltage).max() < 1e-6 * wanted.dc_voltage.max()
