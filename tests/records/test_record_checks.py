"""Checks of raw data: healthy records raise no alarm, and every fault that is planted is found where it is."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from messages import is_sentence
from record_cases import (
    BENCH,
    STACK,
    actuator,
    everything,
    generator,
    measured,
    record,
    resistor,
    rows,
    sine,
    stack_sine,
    with_values,
)

from piezoharvest.description.shunts import SSDI, Open, Resistor, Short
from piezoharvest.records.checks import check
from piezoharvest.records.checks.stated import stated_noise
from piezoharvest.records.finding import runs
from piezoharvest.study import build_transducer

CAPACITANCE = 3.2e-6  # of the stack


def found(of, device):
    """What the checks find, by name and channel."""
    return {(finding.check, finding.channel): finding for finding in check(of, device)}


def only(of, device, name, channel, severity):
    """The one finding that there should be."""
    all_found = check(of, device)
    assert [(f.check, f.channel, f.severity) for f in all_found] == [(name, channel, severity)], all_found
    assert is_sentence(all_found[0].message)
    return all_found[0]


def hold(amplitude):
    """A load that is held for 3 s and released."""
    return {"kind": "step_force", "amplitude": amplitude, "duration": 3.0, "rise_time": 0.05, "offset": 100.0}


EXCITATIONS = {
    "sine": lambda draw, span: sine(draw(st.sampled_from([1.0, 2.0, 5.0]))),
    "step": lambda draw, span: {
        "kind": "step_force", "amplitude": draw(st.sampled_from([500.0, -750.0, 1250.0])), "duration": span / 2,
        "rise_time": draw(st.sampled_from([0.0, 0.01, 0.2])), "offset": draw(st.sampled_from([0.0, 100.0])),
    },
    "multisine": lambda draw, span: {
        "kind": "multisine", "amplitudes": [300.0, 200.0, 100.0], "frequencies": [1.0, 3.0, 7.0],
        "phases": [0.0, 1.0, draw(st.sampled_from([0.0, 2.0, 4.0]))], "duration": 1.0,
    },
    "random": lambda draw, span: {
        "kind": "random_force", "psd": 100.0, "band": [0.5, 12.0], "duration": span,
        "seed": draw(st.integers(0, 1)),
    },
}  # fmt: skip


@st.composite
def generators(draw):
    """Force experiments on the paper's stack: every load long enough for its time constant."""
    shunt = draw(st.sampled_from([resistor(51.43e3), resistor(97e3), resistor(1e6), resistor(13e6), {"kind": "open"},
                                  {"kind": "short"}, {"kind": "rectifier", "smoothing_capacitance": 1e-5,
                                                      "load_resistance": 1e6}]))  # fmt: skip
    span = max(4.0, np.ceil(1.2 * CAPACITANCE * shunt["resistance"])) if shunt["kind"] == "resistor" else 4.0
    # A ramp on a stack in short circuit takes the engine seconds.
    kinds = sorted(EXCITATIONS) if shunt["kind"] != "short" else ["multisine", "random", "sine"]
    excitation = EXCITATIONS[draw(st.sampled_from(kinds))](draw, span)
    return generator(STACK, shunt, excitation, duration=span, rate=1000.0 if span < 10 else 200.0)


@st.composite
def benches(draw):
    """Base and force experiments on a weakly damped harvester, at and beside its resonance near 50 Hz."""
    inductor = {"kind": "series_rl", "inductance": 250.0, "resistance": 1e4}
    switched = {"kind": "parallel_sshi", "inductance": 0.1, "quality": 5.0, "dc_voltage": 5.0}
    passive = [resistor(97e3), resistor(13e6), {"kind": "open"}, {"kind": "short"}, inductor]
    shunt = draw(st.sampled_from([*passive, switched]))
    what = draw(st.sampled_from(["force", "base"]))
    level = {"force": 0.02, "base": 2.0}[what]
    frequency = draw(st.sampled_from([10.0, 30.0, 49.0, 50.0, 50.6, 52.0, 60.0, 80.0]))
    tone = {"kind": f"sine_{what}", "amplitude": level, "frequency": frequency}
    noise = {"kind": f"random_{what}", "psd": level**2 / 100, "band": [5.0, 100.0], "duration": 3.0, "seed": 3}
    return generator(BENCH, shunt, draw(st.sampled_from([tone, noise])), duration=3.0, rate=2000.0)


@st.composite
def actuators(draw):
    """Voltage experiments on the paper's stack."""
    rate, time = 200.0, np.arange(2000) / 200.0
    shape = draw(st.sampled_from(["sine", "triangle", "growing", "staircase", "burst"]))
    wave = {
        "sine": np.sin(2 * np.pi * time),
        "triangle": 2 * np.abs(2 * (time % 1.0) - 1) - 1,
        "growing": np.minimum(time / 8, 1.0) * np.sin(2 * np.pi * time),
        "staircase": np.floor(4 * np.minimum(time, 10 - time)) / 16,
        "burst": np.where((time > 2) & (time < 8), np.sin(2 * np.pi * 3 * time), 0.0),
    }[shape]
    voltage = draw(st.sampled_from([10.0, 100.0])) * (wave + draw(st.sampled_from([0.0, 1.0])))
    return actuator(STACK, voltage, rate)


@st.composite
def healthy(draw):
    """Any of these with noise, a converter, and channels that were not measured."""
    clean, device = draw(st.one_of(generators(), benches(), actuators()))
    noise, bits = draw(
        st.sampled_from([(0.0, None), (0.0, 12), (0.0, 16), (1e-4, 12), (1e-3, 16), (0.02, 16), (0.1, None)])
    )
    missing = draw(st.sets(st.sampled_from(sorted(clean.responses)), max_size=len(clean.responses) - 1))
    return measured(clean, noise=noise, bits=bits, seed=draw(st.integers(0, 3)), without=missing), device


class TestHealthy:
    @settings(max_examples=100, deadline=None)
    @given(healthy())
    def test_nothing_is_found(self, case):
        of, device = case
        assert check(of, device) == ()

    @pytest.mark.parametrize("bits", [14, 16])
    def test_every_period_may_reach_the_same_extreme(self, bits):
        # A sine of 200 samples a period, no noise: hysteresis turns, and its corner is taken for noise.
        clean, device = generator(STACK, resistor(51.43e3), sine(5.0), duration=4.0, rate=1000.0)
        assert check(measured(clean, bits=bits), device) == ()

    def test_displacement_may_be_the_drive(self):
        of, device = stack_sine()
        signals = dict(of.signals)
        assert (
            check(record(of["time"], {c: s.values for c, s in signals.items()}, "displacement", of.shunt), device) == ()
        )

    @pytest.mark.parametrize("shift", [0.7, 1.4])
    def test_nominal_values_may_be_wrong(self, shift):
        clean, _ = generator(BENCH, resistor(), sine(50.0, 0.02, 0.0), duration=3.0, rate=2000.0)
        nominal = {**BENCH, "mass": BENCH["mass"] * shift, "damping": 0.2, "coupling": 2e-3, "capacitance": 25e-9}
        assert check(measured(clean, noise=1e-3), build_transducer(nominal)) == ()

    def test_time_stamps_may_be_rounded(self):
        of, device = stack_sine()
        assert check(with_values(of, time=np.round(of["time"] + 0.00037, 4)), device) == ()


class TestRawSamples:
    @pytest.mark.parametrize("channel", ["force", "displacement", "voltage", "current"])
    @pytest.mark.parametrize("value", [np.nan, np.inf])
    def test_not_a_number(self, channel, value):
        of, device = stack_sine()
        values = of[channel].copy()
        values[[100, 101, 102, 4000]] = value
        finding = only(with_values(of, **{channel: values}), device, "nan", channel, "error")
        assert finding.rows == rows(100, 102) + rows(4000, 4000)

    def test_gap(self):
        of, device = stack_sine()
        time = of["time"].copy()
        time[1000:] += 0.1
        finding = only(with_values(of, time=time), device, "gap", "time", "error")
        assert finding.rows == rows(1000, 1000)
        assert "0.101 s where 0.001 s is usual" in finding.message

    def test_repeated(self):
        of, device = stack_sine()
        time = of["time"].copy()
        time[[50, 51]] = time[49]
        all_found = found(with_values(of, time=time), device)
        assert all_found["repeated time", "time"].rows == rows(50, 51)

    def test_backward(self):
        of, device = stack_sine()
        time = of["time"].copy()
        time[2000:] -= 1.0
        finding = only(with_values(of, time=time), device, "backward time", "time", "error")
        assert finding.rows == rows(2000, 2000)

    def test_uneven(self):
        of, device = stack_sine()
        time = of["time"].copy()
        time[300:310] += 4e-4
        finding = only(with_values(of, time=time), device, "uneven time", "time", "warning")
        assert finding.rows == rows(300, 309)

    @pytest.mark.parametrize("channel", ["force", "displacement", "voltage", "current"])
    def test_constant(self, channel):
        of, device = stack_sine()
        finding = only(with_values(of, **{channel: np.full(len(of), -317.2)}), device, "constant", channel, "error")
        assert finding.rows == everything(of)

    @pytest.mark.parametrize(("shunt", "channel"), [(Short(), "voltage"), (Open(), "current")])
    def test_nothing_across_a_short_is_no_fault(self, shunt, channel):
        of, device = generator(STACK, {"kind": shunt.kind}, sine(), duration=5.0)
        assert check(with_values(of, **{channel: np.zeros(len(of))}), device) == ()

    def test_runs(self):
        assert runs(np.array([True, False, False, True, True])).tolist() == [[0, 0], [3, 4]]
        assert runs(np.zeros(3, bool)).tolist() == []
        assert runs(np.ones(3, bool)).tolist() == [[0, 2]]
        assert runs(np.zeros(0, bool)).tolist() == []


class TestStuck:
    @pytest.mark.parametrize("channel", ["force", "displacement", "voltage", "current"])
    @pytest.mark.parametrize("noise", [2e-3, 0.02])
    def test_clipped(self, channel, noise):
        of, device = stack_sine(noise=noise)
        values = of[channel]
        limit = values.max() - 0.1 * np.ptp(values)
        finding = only(with_values(of, **{channel: np.minimum(values, limit)}), device, "clipped", channel, "warning")
        covered = np.concatenate([np.arange(first, last + 1) for first, last in finding.rows]) - 2
        assert np.all(values[covered] >= limit)
        assert len(covered) > 0.8 * np.sum(values > limit)
        assert f"{limit:.6g}" in finding.message

    @pytest.mark.parametrize("channel", ["force", "displacement", "voltage", "current"])
    @pytest.mark.parametrize("bits", [None, 12])
    def test_an_end_of_the_range_that_only_noise_reaches(self, channel, bits):
        """Single samples far apart: no run of equal ones gives them away, but there are too many at one value."""
        of, device = stack_sine(noise=0.01)
        values = of[channel]
        if bits:
            step = np.ptp(values) / 2**bits
            values = step * np.round(values / step)
        limit = np.sort(values)[-60]
        assert check(with_values(of, **{channel: values}), device) == ()
        finding = only(with_values(of, **{channel: np.minimum(values, limit)}), device, "clipped", channel, "warning")
        covered = np.concatenate([np.arange(first, last + 1) for first, last in finding.rows]) - 2
        assert covered.tolist() == np.flatnonzero(values >= limit).tolist()

    @pytest.mark.parametrize("channel", ["displacement", "voltage", "current"])
    def test_clipped_without_noise(self, channel):
        of, device = stack_sine(noise=0.0)
        values = of[channel]
        clipped = np.maximum(values, values.min() + 0.05 * np.ptp(values))
        only(with_values(of, **{channel: clipped}), device, "clipped", channel, "warning")

    def test_clipped_drive_without_noise_is_told_by_its_flanks(self):
        clean, device = generator(STACK, resistor(), sine(), duration=5.0)
        only(with_values(clean, force=np.minimum(clean["force"], 960.0)), device, "clipped", "force", "warning")

    @pytest.mark.parametrize("channel", ["force", "displacement", "voltage", "current"])
    def test_frozen(self, channel):
        of, device = stack_sine()
        values = of[channel].copy()
        values[2100:2200] = values[2100]
        finding = only(with_values(of, **{channel: values}), device, "frozen", channel, "error")
        assert finding.rows == rows(2100, 2199)

    @pytest.mark.parametrize("channel", ["displacement", "voltage", "current"])
    def test_frozen_to_the_end(self, channel):
        of, device = stack_sine()
        values = of[channel].copy()
        values[3000:] = values[3000]
        finding = only(with_values(of, **{channel: values}), device, "frozen", channel, "error")
        assert finding.rows == rows(3000, 4999)

    @pytest.mark.parametrize("excitation", [sine(), sine(0.5), hold(900.0)])
    def test_clipped_load_cell_of_little_noise(self, excitation):
        """Noise of half a step of the converter, of which a good part of the record shows nothing."""
        clean, device = generator(STACK, resistor(), excitation, duration=6.0)
        step, rng = 50e3 / 2**16, np.random.default_rng(0)
        noisy = np.round((clean["force"] + 0.6 * step * rng.normal(size=len(clean))) / step) * step
        assert check(with_values(clean, force=noisy), device) == ()
        finding = only(with_values(clean, force=np.minimum(noisy, 700.0)), device, "clipped", "force", "warning")
        covered = sum(last - first + 1 for first, last in finding.rows)
        assert covered > 0.9 * np.sum(noisy > 700.0)

    def test_a_response_that_stops_at_a_corner_without_noise_may_stick(self):
        of, device = stack_sine(noise=0.0)
        values = of["displacement"].copy()
        values[2100:2200] = values[2100]
        finding = only(with_values(of, displacement=values), device, "frozen", "displacement", "warning")
        assert finding.rows == rows(2100, 2199)

    @pytest.mark.parametrize("noise", [0.0, 1e-4])
    @pytest.mark.parametrize("seed", range(4))
    def test_a_response_that_grows_from_rest_is_not_frozen(self, noise, seed):
        """Little of the current is seen by a coarse converter at first; later on its own course looks like noise."""
        time = np.arange(2000) / 200.0
        of, device = actuator(STACK, 10.0 * np.minimum(time / 8, 1.0) * np.sin(2 * np.pi * time), 200.0)
        assert check(measured(of, noise=noise, bits=12, seed=seed), device) == ()

    @pytest.mark.parametrize("creep", [0.0, 0.03])
    def test_a_noisy_command_that_is_held_is_not_frozen(self, creep):
        """A generator with dither that holds its level for a while, and an actuator that creeps meanwhile."""
        time, rng = np.arange(2000) / 200.0, np.random.default_rng(0)
        phase = np.concatenate((np.linspace(0, 4.3, 900), np.full(300, 4.3), np.linspace(4.3, 8, 800)))
        voltage = 50.0 + 40.0 * np.sin(2 * np.pi * phase)
        of, device = actuator(STACK, voltage, 200.0)
        voltage = voltage + 0.05 * rng.normal(size=2000)
        voltage[900:1200] = voltage[899]
        crept = creep * np.ptp(of["displacement"]) * np.clip((time - 4.5) / 1.5, 0, 1)
        of = measured(with_values(of, displacement=of["displacement"] + crept), noise=1e-3, without=("current",))
        assert check(with_values(of, voltage=voltage), device) == ()

    def test_a_hold_is_not_frozen(self):
        """A servo that holds exactly, and a sensor that resolves little."""
        of, device = generator(STACK, resistor(), hold(1000.0), duration=6.0)
        coarse = 3e-8 * np.round(of["displacement"] / 3e-8)
        assert check(with_values(of, displacement=coarse), device) == ()


class TestSpikes:
    @pytest.mark.parametrize("channel", ["force", "displacement", "voltage", "current"])
    @pytest.mark.parametrize(("noise", "size"), [(0.0, 0.2), (1e-3, 0.3), (0.02, 2.0)])
    @pytest.mark.parametrize("at", [[777], [2500, 2501, 2502], [100, 3000]])
    def test_samples_that_leap_away_and_come_back(self, channel, noise, size, at):
        of, device = stack_sine(noise=noise)
        values = of[channel].copy()
        values[at] += size * np.ptp(values)
        finding = only(with_values(of, **{channel: values}), device, "spike", channel, "warning")
        covered = np.concatenate([np.arange(first, last + 1) for first, last in finding.rows]) - 2
        assert covered.tolist() == at

    @pytest.mark.parametrize("noise", [0.0, 1e-3, 0.02])
    def test_a_last_number_that_is_cut_off(self, noise):
        """6.1e-05 becomes 6.1: the last line of a copy that was not finished."""
        of, device = stack_sine(noise=noise)
        values = of["current"].copy()
        values[-1] = 6.1
        all_found = found(with_values(of, current=values), device)
        assert all_found["spike", "current"].rows == rows(len(of) - 1, len(of) - 1)

    @pytest.mark.parametrize(("height", "is_cut"), [(1.5, True), (0.9, False)])
    def test_short_pulses_of_a_switched_circuit_that_a_converter_cuts_off(self, height, is_cut):
        """One sample of each pulse, of unequal heights, of which half are above 10 V at 16 bits; and all below it."""
        of, device = stack_sine()
        rng, step = np.random.default_rng(3), 20.0 / 2**16
        pulses = np.zeros(len(of))
        pulses[20::40] = height * 10.0 * rng.uniform(0.5, 1.0, len(pulses[20::40]))
        codes = np.clip(np.round((pulses + 2e-4 * rng.standard_normal(len(pulses))) / step), -(2**15), 2**15 - 1)
        behind = replace(of, shunt=SSDI(inductance=0.1, quality=5.0))
        switched = with_values(behind, voltage=codes * step)
        assert {key: f.severity for key, f in found(switched, device).items() if key[1] == "voltage"} == (
            {("clipped", "voltage"): "warning"} if is_cut else {}
        )

    def test_a_pulse_that_others_follow_is_none(self):
        of, device = generator(STACK, resistor(1e3), hold(900.0), duration=6.0)
        assert ("spike", "current") not in found(measured(of, noise=1e-4), device)


class TestAgainstTheModel:
    @pytest.mark.parametrize("channel", ["displacement", "voltage", "current"])
    @pytest.mark.parametrize(("factor", "unit"), [(1e3, "m"), (1e6, "u"), (1e-3, "k"), (1e9, "n")])
    def test_unit(self, channel, factor, unit):
        of, device = stack_sine()
        finding = only(with_values(of, **{channel: factor * of[channel]}), device, "unit", channel, "error")
        assert finding.rows == everything(of)
        symbol = {"displacement": "m", "voltage": "V", "current": "A"}[channel]
        assert f"is it {unit}{symbol}?" in finding.message

    @pytest.mark.parametrize(("stated", "unit"), [(1e-3, "V"), (1e3, "V"), (1e-6, "mV")])
    def test_unit_beside_the_one_that_was_stated(self, stated, unit):
        """A file in V that is said to be in mV, or in kV, is in V."""
        of, device = stack_sine()
        off = with_values(of, voltage=of["voltage"] * (stated if unit == "V" else 1e-3))
        taken = replace(off, signals={**off.signals, "voltage": replace(off.signals["voltage"], factor=stated)})
        assert f"is it {unit}?" in only(taken, device, "unit", "voltage", "error").message

    def test_a_displacement_of_3_m(self):
        of, device = stack_sine()
        assert ("unit", "displacement") in found(with_values(of, displacement=of["displacement"] * 1e6), device)

    @pytest.mark.parametrize(
        "shunt",
        [{"kind": "rectifier", "smoothing_capacitance": 1e-6, "load_resistance": 1e6},
         {"kind": "parallel_sshi", "inductance": 0.1, "quality": 5.0, "dc_voltage": 5.0},
         {"kind": "ssdi", "inductance": 0.1, "quality": 5.0}],
        ids=lambda shunt: shunt["kind"],
    )  # fmt: skip
    @pytest.mark.parametrize("frequency", [50.0, 47.3])
    def test_a_current_behind_diodes_and_switches_in_milliamperes(self, shunt, frequency):
        """Displacement and voltage tell how much charge there is; samples that hit the pulse of an inversion do not."""
        clean, device = generator(BENCH, shunt, sine(frequency, 0.02, 0.0), duration=3.0, rate=2000.0)
        of = measured(clean, noise=1e-3, bits=16)
        assert check(of, device) == ()
        if shunt["kind"] != "ssdi":  # there the current is but such pulses
            finding = only(with_values(of, current=1e3 * of["current"]), device, "unit", "current", "error")
            assert "is it mA?" in finding.message

    @pytest.mark.parametrize(("factor", "unit"), [(1e-3, "kN"), (1e3, "mN")])
    def test_unit_of_the_drive(self, factor, unit):
        of, device = stack_sine()
        finding = only(with_values(of, force=factor * of["force"]), device, "unit", "force", "error")
        assert f"is it {unit}?" in finding.message

    @pytest.mark.parametrize("without", [(), ("current",), ("displacement", "current")])
    @pytest.mark.parametrize("power", [3, 6, 9, 12])
    def test_a_load_with_a_wrong_prefix(self, power, without):
        """1 mohm for 1 Mohm makes the voltage 1e9 too large: no one measures nV."""
        clean, device = generator(BENCH, resistor(1e6), sine(47.0, 0.02, 0.0), duration=2.0, rate=2000.0)
        of = measured(clean, noise=1e-3, without=without)
        assert check(of, device) == ()
        wrong = replace(of, shunt=Resistor(resistance=10.0 ** (6 - power)))
        message = only(wrong, device, "unit", "voltage", "error").message
        load = f"a wrong prefix of the load resistance (found {10.0 ** (6 - power):g} ohm, 1e+06 ohm would do"
        assert load in message
        assert ("likely a wrong unit" in message) == (power <= 6)  # mV and uV are as likely
        assert "nV" not in message

    def test_a_load_with_too_large_a_prefix(self):
        clean, device = generator(BENCH, resistor(1e4), sine(47.0, 0.02, 0.0), duration=2.0, rate=2000.0)
        of = measured(clean, noise=1e-3)
        wrong = replace(of, shunt=Resistor(resistance=1e13))
        assert "likely a wrong prefix of the load resistance (found 1e+13 ohm, 10000 ohm" in (
            found(wrong, device)["unit", "current"].message
        )
        voltage = replace(measured(clean, without=("current",)), shunt=Resistor(resistance=1e13))
        assert "; likely a wrong prefix of the load resistance, 1e+13 ohm" in (
            found(voltage, device)["too short", "time"].message
        )

    def test_another_value_of_the_load_with_a_wrong_prefix(self):
        shunt = {"kind": "series_rl", "resistance": 1e4, "inductance": 50.0}
        clean, device = generator(BENCH, shunt, sine(47.0, 0.02, 0.0), duration=2.0, rate=2000.0)
        wrong = replace(measured(clean, noise=1e-3), shunt=replace(clean.shunt, inductance=5e7))
        messages = [finding.message for finding in check(wrong, device)]
        assert any("a wrong prefix of the inductance of the load (found 5e+07 H, 50 H" in text for text in messages)

    def test_a_wrong_unit_that_no_load_explains(self):
        of, device = stack_sine()
        message = only(with_values(of, displacement=1e3 * of["displacement"]), device, "unit", "displacement", "error")
        assert "load" not in message.message

    @pytest.mark.parametrize("channel", ["displacement", "voltage", "current"])
    def test_sign(self, channel):
        of, device = stack_sine()
        finding = only(with_values(of, **{channel: -of[channel]}), device, "sign", channel, "error")
        assert finding.rows == everything(of)

    def test_leads_of_the_other_polarity_are_one_fault_with_two_cures(self):
        """Which lead is the positive one is free: a coupling below zero is as right as gains below zero."""
        of, device = stack_sine()
        turned = with_values(of, voltage=-of["voltage"], current=-of["current"])
        finding = only(turned, device, "sign", "voltage", "error")
        for part in ("voltage and current", "coupling below zero", "voltage = {", "current = {"):
            assert part in finding.message
        assert check(turned, device.reversed_leads) == ()

    def test_sign_of_the_drive(self):
        of, device = stack_sine()
        only(with_values(of, force=-of["force"]), device, "sign", "force", "error")

    def test_sign_at_a_resonance_can_be_told_by_many_lines_only(self):
        noise = {"kind": "random_force", "psd": 1e-6, "band": [5.0, 100.0], "duration": 3.0, "seed": 3}
        broad, device = generator(BENCH, resistor(), noise, duration=3.0, rate=2000.0)
        only(with_values(broad, displacement=-broad["displacement"]), device, "sign", "displacement", "error")
        one, device = generator(BENCH, resistor(), sine(50.0, 0.02, 0.0), duration=3.0, rate=2000.0)
        assert check(with_values(one, displacement=-one["displacement"]), device) == ()

    @pytest.mark.parametrize("pair", [("displacement", "voltage"), ("voltage", "current"), ("force", "displacement"),
                                      ("force", "voltage"), ("force", "current")])  # fmt: skip
    def test_swapped(self, pair):
        of, device = stack_sine()
        one, other = pair
        finding = only(with_values(of, **{one: of[other], other: of[one]}), device, "swapped", one, "error")
        assert one in finding.message
        assert other in finding.message

    @pytest.mark.parametrize("pair", list(combinations(("force", "displacement", "voltage"), 2)))
    def test_swapped_of_three_channels(self, pair):
        """A response whose amplitude is only just allowed beside an exchanged drive does not rule the exchange out."""
        noise = {"kind": "random_force", "psd": 1e-6, "band": [20.0, 100.0], "duration": 3.0, "seed": 3}
        of, device = generator(BENCH, resistor(), noise, duration=3.0, rate=2000.0)
        of, (one, other) = measured(of, noise=1e-3, without=("current",)), pair
        (finding,) = check(with_values(of, **{one: of[other], other: of[one]}), device)
        assert finding.check == "swapped"
        assert one in finding.message
        assert other in finding.message

    def test_swapped_channels_of_like_numbers(self):
        """A displacement in m and a current in A may be of the same size: only their phases are wrong."""
        noise = {"kind": "random_force", "psd": 1e-6, "band": [20.0, 100.0], "duration": 3.0, "seed": 3}
        of, device = generator(BENCH, resistor(), noise, duration=3.0, rate=2000.0)
        scale = np.std(of["displacement"]) / np.std(of["current"])
        assert 1 / 30 < scale < 30
        only(with_values(of, displacement=of["current"], current=of["displacement"]), device, "swapped",
             "displacement", "error")  # fmt: skip

    def test_swapped_channels_of_an_actuator(self):
        time = np.arange(2000) / 200.0
        of, device = actuator(STACK, 50 + 50 * np.sin(2 * np.pi * time), 200.0)
        of = measured(of, noise=1e-3, without=("current",))
        swapped = with_values(of, voltage=of["displacement"], displacement=of["voltage"])
        assert {name for name, _ in found(swapped, device)} == {"swapped"}

    @pytest.mark.parametrize("channel", ["displacement", "voltage", "current"])
    def test_dead(self, channel):
        of, device = stack_sine()
        noise = 1e-4 * np.std(of[channel]) * np.random.default_rng(1).normal(size=len(of))
        only(with_values(of, **{channel: 7e-4 * np.std(of[channel]) + noise}), device, "dead", channel, "error")

    @pytest.mark.parametrize("seed", range(20))
    def test_a_decay_beside_a_drive_at_rest_is_not_judged_by_the_noise_of_the_drive(self, seed):
        rng, device = np.random.default_rng(seed), build_transducer(BENCH)
        stiffness = device.stiffness + device.coupling**2 / device.capacitance  # of open electrodes
        rate, decay = np.sqrt(stiffness / device.mass), 0.5 * device.damping / device.mass
        time = np.arange(2000) / 2000.0
        displacement = 1e-4 * np.exp(-decay * time) * np.cos(rate * time)
        values = {
            "force": 1e-5 * rng.normal(size=len(time)),
            "displacement": displacement + 1e-8 * rng.normal(size=len(time)),
            "voltage": -device.coupling / device.capacitance * displacement + 1e-4 * rng.normal(size=len(time)),
        }
        assert check(record(time, values, "force", Open()), device) == ()

    def test_small_signals_in_noise_are_not_judged(self):
        of, device = stack_sine()
        noise = 100 * np.std(of["current"]) * np.random.default_rng(1).normal(size=len(of))
        assert check(with_values(of, current=of["current"] + noise), device) == ()

    def test_current_into_the_leads_is_told(self):
        time = np.arange(2000) / 200.0
        of, device = actuator(STACK, 50 + 50 * np.sin(2 * np.pi * time), 200.0)
        finding = only(with_values(of, current=-of["current"]), device, "sign", "current", "error")
        assert "out of the transducer" in finding.message


class TestHum:
    @pytest.mark.parametrize("channel", ["force", "displacement", "voltage", "current"])
    @pytest.mark.parametrize("mains", [50.0, 60.0, 49.95])
    def test_found(self, channel, mains):
        of, device = stack_sine()
        hum = 0.03 * np.std(of[channel]) * np.sin(2 * np.pi * mains * of["time"] + 1.0)
        finding = only(with_values(of, **{channel: of[channel] + hum}), device, "mains hum", channel, "warning")
        assert finding.rows == everything(of)

    def test_ringing_at_50_hz_is_none(self):
        of, device = generator(BENCH, {"kind": "open"}, sine(38.0, 0.02, 0.0), duration=4.0, rate=2000.0)
        assert check(measured(of, noise=1e-3), device) == ()

    def test_a_drive_at_50_hz_is_none(self):
        tones = {"amplitudes": [300.0, 30.0], "frequencies": [4.0, 50.0], "phases": [0.0, 1.0], "duration": 1.0}
        of, device = generator(STACK, resistor(), {"kind": "multisine", **tones}, duration=4.0)
        assert check(measured(of, noise=1e-3), device) == ()


class TestDynamics:
    def test_too_short(self):
        of, device = generator(STACK, resistor(13e6), sine(), duration=5.0)
        finding = only(measured(of, noise=1e-3), device, "too short", "time", "warning")
        assert finding.rows == everything(of)
        slowest = 13e6 * (device.capacitance + device.coupling**2 / device.stiffness)  # clamped C with T^2/k beside it
        assert f"{slowest:.4g} s" in finding.message

    @pytest.mark.parametrize(("rate", "warned"), [(105.0, True), (110.0, True), (130.0, False), (250.0, False)])
    def test_sampled_too_slowly(self, rate, warned):
        """Up to 0.4 of the sample rate, a drive of limited bandwidth is known between its samples."""
        of, device = generator(BENCH, resistor(), sine(45.0, 0.02, 0.0), duration=4.0, rate=rate)
        if warned:
            assert f"{rate:.6g} Hz" in only(of, device, "sample rate", "force", "warning").message
        else:
            assert check(of, device) == ()

    def test_sampled_too_slowly_behind_diodes(self):
        bridge = {"kind": "rectifier", "smoothing_capacitance": 1e-6, "load_resistance": 1e6}
        of, device = generator(BENCH, bridge, sine(45.0, 0.02, 0.0), duration=4.0, rate=250.0)
        assert "straight lines" in only(of, device, "sample rate", "force", "warning").message

    def test_sampled_below_the_resonance_that_the_drive_reaches(self):
        """At 55 Hz a sine of 50.6 Hz looks like one of 4.4 Hz."""
        of, device = generator(BENCH, resistor(), sine(50.6, 0.02, 0.0), duration=4.0, rate=55.0)
        all_found = found(of, device)
        assert ("sample rate", "force") in all_found

    def test_resonance_far_above_a_slow_drive_is_no_fault(self):
        """The paper's stack: 22 kHz, sampled at 1 kHz."""
        of, device = stack_sine()
        assert device.short_circuit_frequency > 20 * of.sample_rate
        assert check(of, device) == ()


@pytest.mark.parametrize("excitation", [sine(), sine(5.0), hold(1250.0)], ids=["sine", "fast", "step"])
def test_noise_that_is_stated_in_another_unit(excitation):
    clean, device = generator(STACK, resistor(), excitation, duration=6.0)
    of = measured(clean, noise=2e-3, bits=16)
    sigma = {channel: 2e-3 * float(np.std(clean[channel])) for channel in of.signals}

    def stated(factor):
        signals = {c: replace(s, sigma=sigma[c] * (factor if c == "voltage" else 1.0)) for c, s in of.signals.items()}
        return replace(of, signals=signals)

    assert check(stated(1.0), device) == check(of, device) == ()
    assert only(stated(1e-3), device, "sigma", "voltage", "warning").message.startswith("found noise")
    message = only(stated(2e3), device, "sigma", "voltage", "warning").message
    assert message.startswith("found a sigma 4 times the standard deviation of all samples")


@pytest.mark.parametrize("seed", range(3))
def test_noise_far_below_a_drive_that_begins_and_ends_at_once(seed):
    """Tones up to 2.5 kHz at 40 kHz, cut anywhere, 80 dB above noise that is stated rightly or a hundred times less."""
    random = np.random.default_rng(seed)
    clean, _ = generator(STACK, resistor(), sine(), duration=0.125)
    time = np.arange(5000) / 40e3
    frequency, phase = random.uniform(500.0, 2500.0, (64, 1)), random.uniform(0.0, 2.0 * np.pi, (64, 1))
    force = np.sin(2.0 * np.pi * frequency * time + phase).sum(axis=0)
    sigma = 1e-4 * np.std(force)
    for factor, found in ((1.0, 0), (0.01, 1)):
        signal = replace(
            clean.signals["force"], values=force + sigma * random.standard_normal(5000), sigma=factor * sigma
        )
        of = replace(clean, time=replace(clean.time, values=time), signals={"force": signal})
        assert len(list(stated_noise(of))) == found
