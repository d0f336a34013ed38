"""Power and energy from records: closed forms, the cycle they belong to, and uncertainty by Monte Carlo."""

import numpy as np
import pytest
from bench_runs import LOAD, STACK, study, waves
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson, simpson
from scipy.signal import butter, sosfreqz

from piezoharvest.bench import measure
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.parameters import ParameterError
from piezoharvest.records.power import analyse, cycle_boundaries
from piezoharvest.records.weights import gradient_transposed, simpson_weights, smooth, smooth_transposed

RATE, F0, X0, PHASE, V0, R = 1000.0, 200.0, 0.7e-6, 0.05, 3.0, 1e5
SIGMA = {"force": 0.5, "displacement": 1.2e-8, "voltage": 1.5e-3, "current": 3e-8}


def sine(frequency=3.0, length=4.0):
    """Force with a preload, a displacement that is late by PHASE, and a resistive load."""
    time = np.arange(round(length * RATE)) / RATE
    angle = 2 * np.pi * frequency * time
    voltage = V0 * np.sin(angle)
    return time, 300 + F0 * np.sin(angle), 1e-6 + X0 * np.sin(angle - PHASE), voltage, voltage / R


def noisy(signals, rng):
    time, *rest = signals
    return [time, *(s + sigma * rng.standard_normal(len(s)) for s, sigma in zip(rest, SIGMA.values(), strict=True))]


@pytest.mark.parametrize("frequency", [1.0, 3.0, 7.3])
def test_energies_of_a_sine(frequency):
    """Net pi F x sin(phi) a cycle; a preload adds nothing to it, and much to what goes in and comes back."""
    found = analyse(*sine(frequency), frequency=frequency)
    settled = slice(1, None)  # in the first cycle the low-pass settles
    # Central differences read sin(w h)/(w h) low.
    step = 2 * np.pi * frequency / RATE
    net = np.pi * F0 * X0 * np.sin(PHASE) * np.sin(step) / step
    response = np.abs(sosfreqz(butter(3, 100.0, fs=RATE, output="sos"), [frequency], fs=RATE)[1][0]) ** 2
    assert found.mechanical.cycles.net[settled] == pytest.approx(net * response, rel=1e-4)
    assert found.electrical.cycles.net == pytest.approx(V0**2 / (2 * R * frequency), rel=1e-6)
    assert found.electrical.cycles.returned == pytest.approx(0.0, abs=1e-15)
    assert found.electrical.cycles.peak_power == pytest.approx(V0**2 / R, rel=1e-3)
    # F x' with F = 300 + F0 sin: by the integral of its positive part.
    fine = np.linspace(0, 1 / frequency, 200_001)
    angle = 2 * np.pi * frequency * fine
    power = (300 + F0 * np.sin(angle)) * X0 * 2 * np.pi * frequency * np.cos(angle - PHASE)
    assert found.mechanical.cycles.supplied[settled] == pytest.approx(simpson(np.maximum(power, 0), x=fine), rel=2e-3)
    assert found.mechanical.cycles.returned[settled] == pytest.approx(simpson(np.maximum(-power, 0), x=fine), rel=2e-3)
    for cycles in (found.mechanical.cycles, found.electrical.cycles):
        assert cycles.net == pytest.approx(cycles.supplied - cycles.returned)


def test_the_record_is_the_sum_of_its_cycles():
    time, *signals = (s[:3001] for s in sine(2.0))  # three seconds hold six whole cycles
    found = analyse(time, *signals, frequency=2.0)
    for port in (found.mechanical, found.electrical):
        assert port.record.net == pytest.approx(port.cycles.net.sum(), rel=1e-9)
        assert len(port.cycles.net) == 6


def test_what_the_stack_takes_in_is_lost_or_harvested():
    """Over a settled cycle: damping, the loops of the hysteresis (4 w r (A - r)) and the load."""
    found = waves(length=2.4, rate=4000.0)  # the load discharges the start within 0.2 s
    power = analyse(
        found.time, found.drive, found.displacement, found.voltage, found.current, frequency=5.0, cutoff=900
    )
    charge = 0.5 * np.ptp(found.states[8800:, 2])
    damping = np.pi * STACK["damping"] * 2 * np.pi * 5.0 * (0.5 * np.ptp(found.displacement[8800:])) ** 2
    lost = Hysteresis(**STACK["hysteresis"]).loss_per_cycle(charge) + damping
    net, harvested = power.mechanical.cycles.net[-1], power.electrical.cycles.net[-1]
    assert net == pytest.approx(lost + harvested, rel=1e-3)
    assert 0.2 < harvested / net < 0.8
    # What goes in and comes back is the spring's, stiffened by T^2/C since the load takes little of the charge:
    # F^2/(2 k) between 100 and 1000 N, a hundred times the net energy.
    stiffness = STACK["stiffness"] + STACK["coupling"] ** 2 / STACK["capacitance"]
    assert power.mechanical.cycles.returned[-1] == pytest.approx((1000**2 - 100**2) / (2 * stiffness), rel=0.01)
    assert power.mechanical.cycles.returned[-1] > 50 * net


@pytest.mark.slow
def test_uncertainty_by_monte_carlo():
    """The stated standard deviations are those of many records with other noise."""
    rng, signals = np.random.default_rng(0), sine(length=1.5)
    draws = [analyse(*noisy(signals, rng), frequency=3.0, sigma=SIGMA) for _ in range(400)]
    for port in ("mechanical", "electrical"):
        for span, place in (("cycles", 3), ("record", 0)):
            found = [getattr(getattr(draw, port), span) for draw in draws]
            scatter = np.std([energy.net[place] for energy in found])
            # 400 draws know a standard deviation to 3.5 %.
            assert np.mean([energy.net_std[place] for energy in found]) == pytest.approx(scatter, rel=0.12)


def test_uncertainty_without_noise_is_none():
    found = analyse(*sine(), frequency=3.0)
    assert not found.mechanical.cycles.net_std.any()
    assert not found.electrical.record.returned_std.any()


def test_noise_of_an_idle_port_is_covered():
    """A held load takes no power: what noise makes of it lies within what is stated."""
    rng, time = np.random.default_rng(1), np.arange(3000) / RATE
    idle = time, np.full(3000, 500.0), np.full(3000, 1e-6), np.zeros(3000), np.zeros(3000)
    draws = [analyse(*noisy(idle, rng), sigma=SIGMA).mechanical.record for _ in range(60)]
    for kind in ("net", "supplied", "returned"):
        pull = np.array([getattr(d, kind)[0] / getattr(d, f"{kind}_std")[0] for d in draws])
        assert np.sqrt(np.mean(pull**2)) < 2.5


def test_cycles_begin_where_the_drive_rises_through_its_middle():
    time, force, *_ = sine(3.0)
    shifted = 300 + F0 * np.sin(2 * np.pi * 3.0 * (time - 0.0871))
    wanted = 0.0871 + np.arange(12) / 3.0
    assert cycle_boundaries(time, shifted) == pytest.approx(wanted, abs=1e-6)
    noisy_force = shifted + 5.0 * np.random.default_rng(0).standard_normal(len(time))
    assert cycle_boundaries(time, noisy_force) == pytest.approx(wanted, abs=5e-3)
    assert cycle_boundaries(time, force, 3.0) == pytest.approx(np.arange(12) / 3.0)


def test_a_load_step_is_one_cycle():
    """Load and release count as one, as in the paper's tables; its mean level does not matter."""
    excitation = {"kind": "step_force", "amplitude": 900.0, "offset": 100.0, "duration": 0.5, "rise_time": 0.05}
    record = measure(study(excitation, LOAD)).records[0]
    columns = list(record.columns.values())
    found = analyse(*columns, sigma=SIGMA)
    assert found.boundaries == pytest.approx([0.0, 0.999])
    assert len(found.electrical.cycles.net) == 1
    true = simpson(record.waves.voltage * record.waves.current, x=columns[0])
    assert found.electrical.cycles.net[0] == pytest.approx(true, abs=4 * found.electrical.cycles.net_std[0])


def test_force_and_velocity_lag_alike():
    """At 60 Hz the low-pass takes 100 degrees off both, and the power between them is not changed but for its size."""
    frequency = 60.0
    time, force, displacement, *rest = sine(frequency)
    found = analyse(time, force - 300, displacement, *rest, frequency=frequency)
    response = np.abs(sosfreqz(butter(3, 100.0, fs=RATE, output="sos"), [frequency], fs=RATE)[1][0]) ** 2
    step = 2 * np.pi * frequency / RATE
    wanted = np.pi * F0 * X0 * np.sin(PHASE) * response * np.sin(step) / step
    assert found.mechanical.cycles.net[20:].mean() == pytest.approx(wanted, rel=1e-3)


@pytest.mark.parametrize("count", [4, 5, 10, 11])
def test_weights_are_simpsons(count):
    y = np.random.default_rng(count).normal(size=count)
    assert simpson_weights(count, count - 1) @ y == pytest.approx(simpson(y, dx=1.0), rel=1e-12)
    steps = cumulative_simpson(y, dx=1.0, initial=0.0)
    for end in range(0, count, 2):
        assert simpson_weights(count, end) @ y == pytest.approx(steps[end], rel=1e-12)


@given(count=st.integers(4, 40), share=st.floats(0, 1), roots=st.tuples(st.floats(-5, 5), st.floats(-5, 5)))
def test_weights_are_exact_for_parabolas_wherever_they_end(count, share, roots):
    parabola = np.poly1d(roots, r=True)
    end = share * (count - 1)
    wanted = parabola.integ()(end)
    assert simpson_weights(count, end) @ parabola(np.arange(count)) == pytest.approx(wanted, abs=1e-9 * count**3)


def test_transposes():
    """<w, A s> = <A' w, s> for the filter and for the derivative."""
    rng, low_pass = np.random.default_rng(0), butter(3, 100.0, fs=RATE, output="sos")
    signal, weights = rng.normal(size=(2, 300))
    assert weights @ smooth(low_pass, signal) == pytest.approx(smooth_transposed(low_pass, weights) @ signal, rel=1e-9)
    assert weights @ np.gradient(signal, 0.01) == pytest.approx(gradient_transposed(weights, 0.01) @ signal, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"force": np.ones(7)},
            r"force: found an array of shape \(7,\), must be one-dimensional, of four samples or more",
        ),
        ({"voltage": np.full(4000, np.nan)}, "voltage: found nan, allowed are finite numbers"),
        ({"time": np.arange(4000.0) ** 2}, "time: the samples are not equally spaced"),
        ({"time": np.zeros(4000)}, "time: the samples are not equally spaced"),
        ({"cutoff": 600.0}, "cutoff: found 600.0 Hz, must be a frequency below 500 Hz"),
        ({"frequency": -1.0}, "frequency: found -1.0, must be a finite number greater than 0 Hz"),
    ],
)
def test_wrong_input_is_one_sentence(change, message):
    names = ("time", "force", "displacement", "voltage", "current")
    with pytest.raises(ParameterError, match=message):
        analyse(**{**dict(zip(names, sine(), strict=True)), **change})
