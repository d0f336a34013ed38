"""From waveforms to samples: noise, steps of the sensors and of the converter, ranges, seeds."""

import numpy as np
import pytest
from bench_runs import LOAD, OPEN, SHORT, SINE, STACK, study
from scipy.stats import kstest

from piezoharvest.bench import Bench, measure
from piezoharvest.bench.sensors import channels, sample

COLUMNS = {"force": "force_N", "displacement": "displacement_m", "voltage": "voltage_V", "current": "current_A"}


def record(*arguments, **bench):
    return measure(study(*arguments, **{"duration": 1.0, **bench})).records[0]


@pytest.fixture(scope="module")
def plain():
    """The default bench for ten seconds."""
    return record(duration=10.0)


def test_the_set_up_is_the_papers():
    bench = Bench()
    assert bench.sample_rate == 1000.0
    assert bench.laser.resolution == 0.03e-6
    assert (bench.current_sense.resistance, bench.current_sense.gain) == (100.0, 50.0)
    assert (bench.converter.bits, bench.converter.range) == (16, 10.0)
    assert bench.load_cell.sensitivity * 25e3 == pytest.approx(bench.converter.range)


@pytest.mark.parametrize("channel", COLUMNS)
def test_noise_is_what_the_campaign_says(plain, channel):
    """Noise and both steps together have the standard deviation that is told, and leave no offset."""
    noise = plain.columns[COLUMNS[channel]] - plain.waves.sensed(channel)
    sigma = channels(Bench(), base=False)[channel].sigma(Bench().converter)
    assert noise.std() == pytest.approx(sigma, rel=0.03)
    assert abs(noise.mean()) < 4 * sigma / np.sqrt(len(noise))
    # white: no sample knows of the next
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.04


def test_every_sample_is_a_code_of_the_converter(plain):
    for channel, line in channels(Bench(), base=False).items():
        codes = plain.columns[COLUMNS[channel]] * line.sensitivity / (20.0 / 2**16)
        assert np.abs(codes - np.round(codes)).max() < 1e-6
        assert np.ptp(codes) > 100


def test_the_laser_has_steps_of_its_own():
    """With a fine converter what is left are multiples of the resolution."""
    found = record(converter={"bits": 32}, laser={"resolution": 3e-8})
    steps = found.columns["displacement_m"] / 3e-8
    assert np.abs(steps - np.round(steps)).max() < 1e-4
    error = found.columns["displacement_m"] - found.waves.reading
    smooth = record(converter={"bits": 32}, laser={"resolution": 0.0})
    noise = smooth.columns["displacement_m"] - smooth.waves.reading
    assert error.std() == pytest.approx(np.hypot(noise.std(), 3e-8 / np.sqrt(12)), rel=0.05)


def test_rounding_alone_is_uniform():
    """Without noise the error of a moving channel is even between -1/2 and 1/2 of the converter's step."""
    found = record(buffer={"noise": 0.0})
    error = (found.columns["voltage_V"] - found.waves.voltage) / (20.0 / 2**16)
    assert np.abs(error).max() <= 0.5 + 1e-9
    assert kstest(error, "uniform", (-0.5, 1.0)).pvalue > 1e-3


def test_range_is_that_of_the_converter_and_said():
    found = record(buffer={"gain": 5.0})
    assert found.columns["voltage_V"].max() == pytest.approx((10.0 - 20.0 / 2**16) / 5.0)
    assert found.columns["voltage_V"].min() == pytest.approx(-10.0 / 5.0)
    (warning,) = found.warnings
    assert warning.startswith("voltage: ")
    assert warning.endswith("samples exceed the range of the A/D converter: lower bench.buffer.gain")


def test_a_channel_that_hardly_moves_is_said():
    fine = {
        "current_sense": {"gain": 2000.0, "noise": 0.0}, "laser": {"sensitivity": 1e6, "noise": 0.0},
        "buffer": {"gain": 10.0, "noise": 0.0},
    }  # fmt: skip
    (warning,) = record({**SINE, "amplitude": 2.0}, **fine).warnings
    assert warning.startswith("force: spans only ")
    assert warning.endswith("steps of the A/D converter: raise bench.load_cell.sensitivity")


def test_noise_above_the_signal_is_said():
    """A sine of 0.1 N is 0.0707 N rms, a seventh of the load cell's noise."""
    found = record({**SINE, "amplitude": 0.1}, laser={"noise": 0.0}, buffer={"noise": 0.0}, channels=["voltage"])
    (warning,) = [text for text in found.warnings if text.startswith("force")]
    assert "0.5 N (rms), is 7.07 times the signal" in warning
    assert warning.endswith("lower the noise of bench.load_cell")


def test_open_electrodes_carry_no_current():
    found = record(SINE, OPEN)
    assert not found.waves.current.any()
    assert found.columns["current_A"].any()  # noise
    assert not found.warnings


def test_a_short_is_the_sense_resistor():
    found = record(SINE, SHORT)
    assert found.setup.shunt.kind == "resistor"
    assert found.setup.shunt.resistance == 100.0
    assert np.allclose(found.waves.voltage, 100.0 * found.waves.current)


def test_buffers_load_the_electrodes():
    held = {"kind": "step_force", "amplitude": 1000.0, "duration": 100.0}
    transducer = {key: value for key, value in STACK.items() if key != "hysteresis"}
    found = record(held, OPEN, transducer, buffer={"input_resistance": 1e5})
    soft = transducer["capacitance"] + transducer["coupling"] ** 2 / transducer["stiffness"]
    v = found.waves.voltage
    assert np.log(v[100] / v[600]) == pytest.approx(0.5 / (1e5 * soft), rel=1e-6)


def test_base_excitation_has_an_accelerometer():
    base = {"kind": "sine_base", "amplitude": 20.0, "frequency": 5.0}
    found = record(base, LOAD)
    assert list(found.columns) == ["time_s", "base_acceleration_m_per_s2", "displacement_m", "voltage_V", "current_A"]
    noise = found.columns["base_acceleration_m_per_s2"] - 20.0 * np.sin(2 * np.pi * 5.0 * found.columns["time_s"])
    assert noise.std() == pytest.approx(
        channels(Bench(), base=True)["base_acceleration"].sigma(Bench().converter), rel=0.1
    )


def test_seeds():
    """The same seed gives the same samples; another one, another record and another channel give other noise."""
    two = [{"load_resistance": 5e4}, {"load_resistance": 5e4}]
    first, again, other = (measure(study(records=two, duration=0.5, seed=seed)).records for seed in (1, 1, 2))
    for column, values in first[0].columns.items():
        assert np.array_equal(values, again[0].columns[column])
        if column != "time_s":
            assert not np.array_equal(values, other[0].columns[column])
            assert not np.array_equal(values, first[1].columns[column])
    noise = [first[0].columns[c] - first[0].waves.sensed(n) for n, c in COLUMNS.items()]
    assert np.abs(np.corrcoef(noise) - np.eye(4)).max() < 0.2
    # settings of one channel leave the others' noise alone
    louder = measure(study(records=two, duration=0.5, seed=1, buffer={"noise": 0.1})).records[0].columns
    assert np.array_equal(louder["force_N"], first[0].columns["force_N"])
    assert np.array_equal(louder["current_A"], first[0].columns["current_A"])


def test_what_is_above_half_the_sample_rate_folds():
    """There is no anti-alias filter: 990 Hz sampled at 1 kHz is 10 Hz."""
    bench = Bench()
    time = np.arange(1000) / 1000.0
    line = channels(bench, base=False)["force"]._replace(noise=0.0)
    rng = np.random.default_rng(0)
    fast, _ = sample("force", line, time, 1000 * np.sin(2 * np.pi * 990.0 * time), bench.converter, (), rng)
    slow, _ = sample("force", line, time, -1000 * np.sin(2 * np.pi * 10.0 * time), bench.converter, (), rng)
    assert np.abs(fast - slow).max() < 1.0
