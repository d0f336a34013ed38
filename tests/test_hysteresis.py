"""Stop and play operators, their inverse, and the laws that make them Prandtl-Ishlinskii hysteresis."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezoharvest.description.hysteresis import Hysteresis, play, stop
from piezoharvest.description.parameters import ParameterError

paths = st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=25).map(np.array)
thresholds = st.floats(0.05, 2.0)


@st.composite
def hystereses(draw, zeros=True):
    """Up to four operators in units of 1 C and 1 V/C, some of them possibly without weight."""
    steps = draw(st.lists(st.floats(0.05, 1.0), min_size=1, max_size=4))
    positive = st.floats(0.1, 3.0)
    weight = st.one_of(st.just(0.0), positive) if zeros else positive
    weights = draw(st.lists(weight, min_size=len(steps), max_size=len(steps)))
    return Hysteresis(thresholds=tuple(np.cumsum(steps)), weights=tuple(weights))


def refined(path, count=400):
    """The same piecewise linear path on a fine grid that keeps its corners."""
    return np.interp(np.linspace(0, len(path) - 1, count * (len(path) - 1) + 1), np.arange(len(path)), path)


@given(paths, thresholds)
def test_stop_plus_play_is_the_signal(path, r):
    assert stop(path, r, initial=path[0]) + play(path, r) == pytest.approx(path, abs=1e-14)
    assert np.all(np.abs(stop(path, r)) <= r)


@given(paths, thresholds)
def test_operators_depend_only_on_the_corners_of_the_path(path, r):
    fine = refined(path, 7)
    assert stop(fine, r)[::7] == pytest.approx(stop(path, r), abs=1e-13)
    assert play(fine, r)[::7] == pytest.approx(play(path, r), abs=1e-13)


@given(paths, hystereses())
def test_voltage_is_odd_and_rate_independent(path, hysteresis):
    assert hysteresis.voltage(-path) == pytest.approx(-hysteresis.voltage(path), abs=1e-13)
    assert hysteresis.voltage(np.repeat(path, 3))[::3] == pytest.approx(hysteresis.voltage(path), abs=1e-13)


@given(paths, hystereses())
def test_wiping_out(path, hysteresis):
    """A larger excursion wipes the memory of all smaller ones before it."""
    limit = np.max(np.abs(path)) + 0.1
    tail = np.array([limit, -limit, 0.3 * limit, -0.7 * limit, 0.9 * limit])
    with_history = hysteresis.voltage(np.concatenate((path, tail)))[-len(tail) :]
    assert with_history == pytest.approx(hysteresis.voltage(tail), abs=1e-12)


@given(hystereses(), st.floats(-1.0, 0.0), st.floats(0.05, 2.0), st.floats(0.5, 6.0))
def test_congruency(hysteresis, low, span, outer):
    """Loops between the same two charges have the same shape whatever went before; they are only shifted."""
    loop = low + span * np.concatenate((np.linspace(0, 1, 20), np.linspace(1, 0, 20)))

    def shape(history):
        v = hysteresis.voltage(np.concatenate((history, loop[:1], loop, loop)))[-len(loop) :]
        return v - v[0]

    assert shape([outer]) == pytest.approx(shape([-outer]), abs=1e-12)


@settings(max_examples=60)
@given(hystereses(), st.floats(0.1, 4.0))
def test_loss_is_the_area_of_the_loop(hysteresis, amplitude):
    charge = refined(amplitude * np.array([1.0, -1.0, 1.0, -1.0, 1.0]))
    voltage = hysteresis.voltage(charge)
    half = len(charge) // 2
    area = np.trapezoid(voltage[half:], charge[half:])
    loss = hysteresis.loss_per_cycle(amplitude)
    assert area == pytest.approx(loss, abs=2e-4 * hysteresis.stiffness * amplitude**2 + 1e-15)
    assert np.pi * amplitude**2 * hysteresis.describing_function(amplitude).imag == pytest.approx(loss, abs=1e-13)


@given(paths, hystereses(), st.floats(0.1, 5.0))
def test_charge_from_voltage_is_the_exact_inverse(path, hysteresis, capacitance):
    voltage = path / capacitance + hysteresis.voltage(path)
    assert hysteresis.charge(voltage, capacitance) == pytest.approx(path, abs=1e-12 * max(1, np.max(np.abs(path))))
    charge = hysteresis.charge(path, capacitance)
    assert charge / capacitance + hysteresis.voltage(charge) == pytest.approx(path, abs=1e-11)


@given(paths, hystereses(zeros=False))
def test_charge_from_voltage_alone(path, hysteresis):
    """Without capacitance the inverse exists up to saturation, that is, with the outermost operator still sticking."""
    limit = np.dot(hysteresis.weights, hysteresis.thresholds)
    voltage = 0.999 * limit * path / max(3.0, np.max(np.abs(path)))
    charge = hysteresis.charge(voltage)
    assert hysteresis.voltage(charge) == pytest.approx(voltage, abs=1e-12 * limit)


@pytest.mark.parametrize("weights", [(5e5, 1.5e6, 0.0), (0.0, 1.5e6, 5e5), (0.0, 2e6, 0.0)])
def test_operators_without_weight_change_nothing_in_the_inverse(weights):
    hysteresis = Hysteresis(thresholds=(1e-7, 3e-7, 7e-7), weights=weights)
    kept = [(r, w) for r, w in zip(hysteresis.thresholds, weights, strict=True) if w]
    without = Hysteresis(thresholds=tuple(r for r, _ in kept), weights=tuple(w for _, w in kept))
    limit = np.dot(weights, hysteresis.thresholds)
    voltage = limit * np.array([0.3, -0.8, 0.9, 0.0, -0.95])
    for capacitance in (None, 3.2e-6):
        assert hysteresis.charge(voltage, capacitance) == pytest.approx(without.charge(voltage, capacitance), rel=1e-12)
    assert hysteresis.voltage(hysteresis.charge(voltage)) == pytest.approx(voltage, rel=1e-12)


def test_no_operators_and_no_weights():
    none = Hysteresis(thresholds=(), weights=())
    assert none.stiffness == 0 and none.loss_per_cycle(1.0) == 0 and none.describing_function(1.0) == 0
    assert none.charge(np.array([2.0, -1.0]), 0.5) == pytest.approx([1.0, -0.5])
    flat = Hysteresis(thresholds=(1.0,), weights=(0.0,))
    assert flat.charge(np.array([2.0, -1.0]), 0.5) == pytest.approx([1.0, -0.5])
    with pytest.raises(ParameterError, match="must be at most 0 V"):
        flat.charge(np.array([0.1]))


def test_voltage_beyond_saturation_is_refused():
    hysteresis = Hysteresis(thresholds=(1.0, 2.0), weights=(1.0, 2.0))
    assert hysteresis.charge(np.array([5.0])) == pytest.approx([2.0])
    with pytest.raises(ParameterError, match=r"voltage: found 5\.1 V, must be at most 5 V"):
        hysteresis.charge(np.array([5.1]))


def test_paper_parameters_on_the_virgin_curve():
    """Table V: at 0.7 uC all three have slipped: 0.5*0.1 + 1.5*0.3 + 0.5*0.7 V."""
    hysteresis = Hysteresis(thresholds=(0.1e-6, 0.3e-6, 0.7e-6), weights=(0.5e6, 1.5e6, 0.5e6))
    charge = np.array([0.05e-6, 0.1e-6, 0.3e-6, 0.7e-6, 2e-6])
    assert hysteresis.voltage(charge) == pytest.approx([0.125, 0.25, 0.65, 0.85, 0.85])
    corners, slopes = hysteresis.inverse()
    assert corners == pytest.approx([0.0, 0.25, 0.65])
    assert np.cumsum(slopes) == pytest.approx(1 / np.array([2.5e6, 2.0e6, 0.5e6]))


@pytest.mark.parametrize("amplitude", [0.5, 1.0, 1.3, 2.0, 7.0, 100.0])
def test_describing_function_is_the_fundamental_of_the_stop(amplitude):
    """Fourier coefficient over the second period of a fine sine, both corners of the loop sampled."""
    n = 4096
    angle = 2 * np.pi * np.arange(3 * n) / n
    hysteresis = Hysteresis(thresholds=(1.0, 1.8), weights=(2.0, 0.7))
    voltage = hysteresis.voltage(amplitude * np.sin(angle))[-n:]
    fundamental = 2j * np.mean(voltage * np.exp(-1j * angle[-n:])) / amplitude
    assert hysteresis.describing_function(amplitude) == pytest.approx(fundamental, rel=3e-6)


@pytest.mark.parametrize(
    ("thresholds", "weights", "message"),
    [
        ((1.0, 2.0), (1.0,), "weights: found 1 for 2 thresholds"),
        ((2.0, 1.0), (1.0, 1.0), "thresholds: found 1.0 after 2.0, allowed are increasing"),
        ((1.0,), (-1.0,), "weights: found -1.0, must be a finite number at least 0"),
        ((0.0,), (1.0,), "thresholds: found 0.0, must be a finite number greater than 0"),
    ],
)
def test_bad_operators_are_refused(thresholds, weights, message):
    with pytest.raises(ParameterError, match=message):
        Hysteresis(thresholds=thresholds, weights=weights)
