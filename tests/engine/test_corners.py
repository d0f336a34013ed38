"""Piecewise laws in the engine: a step ends at every corner, so that they are exact."""

import inspect
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from piezoharvest import Resistor, SineForce, System, Transducer, simulate
from piezoharvest.description.effects.nameless.curves import CODES, CURVES, PARITIES, SLOPES_AT_REST
from piezoharvest.description.effects.nameless.forms import Bends, Corners, DeadZone, Knee, TwoKnees
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.places import Electrodes, Spring
from piezoharvest.engine.motion import curves
from piezoharvest.equations.pieces import broken_line

BEAM = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1e-3, "capacitance": 40e-9}
LOAD, DRIVE, FREQUENCY = 1e5, 0.02, 50.0
# Each with its force in plain arithmetic, for an integration that asks for it at a hundred thousand single instants.
TRUE = [
    (Knee(factor=300.0, knee=0.0, sides=1), lambda x: 300.0 * max(x, 0.0)),  # a breathing crack
    (Knee(factor=300.0, knee=1e-7, sides=-1), lambda x: -300.0 * max(1e-7 - x, 0.0)),
    (Knee(factor=3000.0, knee=1e-5), lambda x: 3000.0 * (max(x - 1e-5, 0.0) - max(-x - 1e-5, 0.0))),
    (DeadZone(factor=-60.0, zone=1e-4), lambda x: -60.0 * min(max(x, -1e-4), 1e-4)),
    (
        TwoKnees(factor=3000.0, second=800.0, upper=2e-5, lower=-5e-5),
        lambda x: 3000.0 * max(x - 2e-5, 0.0) + 800.0 * min(x + 5e-5, 0.0),
    ),
    (
        Corners(knots=(0.0, 5e-5, 1e-4, -5e-5), kinks=(100.0, -200.0, 500.0, 80.0)),
        lambda x: (
            100.0 * max(x, 0.0) - 200.0 * max(x - 5e-5, 0.0) + 500.0 * max(x - 1e-4, 0.0) + 80.0 * max(-5e-5 - x, 0.0)
        ),
    ),
    (
        Bends(knots=(0.0, -0.0, 1e-4), kinks=(3e5, 1e5, -2e5)),
        lambda x: 1.5e5 * max(x, 0.0) ** 2 + 0.5e5 * max(-x, 0.0) ** 2 - 1e5 * max(x - 1e-4, 0.0) ** 2,
    ),
]
FORMS = [form for form, _ in TRUE]


def moved(spring, t):
    """Displacement and voltage from rest, by DOP853 in steps far shorter than a corner is passed in."""
    m, b, k, T, C = BEAM.values()

    def slopes(t, y):
        x, u, v = y.tolist()
        force = DRIVE * math.sin(2 * math.pi * FREQUENCY * t) - b * u - k * x + T * v - spring(x)
        return [u, force / m, -(v / LOAD + T * u) / C]

    run = solve_ivp(slopes, (0.0, t[-1]), [0.0] * 3, "DOP853", t, rtol=1e-11, atol=1e-16, max_step=2e-5)
    return run.y[0], run.y[2]


@pytest.mark.parametrize(("form", "spring"), TRUE, ids=[form.word for form in FORMS])
def test_values_of_a_piecewise_form_are_its_formula(form, spring):
    x = np.linspace(-3e-4, 3e-4, 601)
    assert np.real(form.values(x)) == pytest.approx(np.array([spring(float(each)) for each in x]), rel=1e-12, abs=1e-18)


@pytest.mark.parametrize(("form", "spring"), TRUE, ids=[form.word for form in FORMS])
def test_a_piecewise_spring_moves_as_an_independent_integration(form, spring):
    system = System(Transducer(**BEAM, effects=(Law(place=Spring(), form=form),)), Resistor(resistance=LOAD))
    run = simulate(system, SineForce(amplitude=DRIVE, frequency=FREQUENCY), transient=0.1, samples=200)
    waves = run.waveforms
    x, v = moved(spring, waves.time)
    for found, true in ((waves.displacement, x), (waves.voltage, v)):
        assert np.abs(found - true).max() < 1e-7 * np.ptp(true)


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.word)
def test_its_steady_state_closes_its_energy(form):
    system = System(Transducer(**BEAM, effects=(Law(place=Spring(), form=form),)), Resistor(resistance=LOAD))
    run = simulate(system, SineForce(amplitude=DRIVE, frequency=FREQUENCY))
    assert run.converged, run.message
    assert abs(run.energy["closure"]) < 1e-11


def test_a_leakage_to_one_side_is_not_taken_for_a_symmetric_one():
    """Its corner at zero has no constant; half a period later the motion is another one."""
    law = Law(place=Electrodes(), form=Corners(knots=(0.0,), kinks=(4e-5,)))
    system = System(Transducer(**BEAM, effects=(law,)), Resistor(resistance=LOAD))
    run = simulate(system, SineForce(amplitude=DRIVE, frequency=FREQUENCY))
    v = run.waveforms.voltage
    assert run.converged
    assert -v.min() > 1.2 * v.max()
    assert abs(run.energy["closure"]) < 1e-11


@pytest.mark.parametrize("name", CODES)
def test_a_compiled_curve_and_its_derivatives_are_those_of_numpy(name):
    step, code, plain = 1e-30, CODES[name], {}
    exec(inspect.getsource(curves).replace("@inlined", ""), plain)  # as Python
    for z in (-30.0, -3.0, -0.3, -0.05, -1e-4, 1e-4, 0.02, 0.11, 0.7, 4.0, 19.0, 25.0):
        value, slope, bend = plain["curve_of"](code, z)
        true = CURVES[name](np.complex128(z + 1j * step))
        assert value == pytest.approx(true.real, rel=1e-9, abs=1e-12)
        assert slope == pytest.approx(true.imag / step, rel=1e-7, abs=1e-12)
        h = 1e-5 * max(abs(z), 1.0) if abs(z) > 0.01 else 1e-6
        above, below = (CURVES[name](np.complex128(z + d + 1j * step)).imag / step for d in (h, -h))
        if abs(z) > 0.01:
            assert bend == pytest.approx((above - below) / (2.0 * h), rel=1e-3, abs=1e-6)
    sign = PARITIES[code]
    mirrored = CURVES[name](np.float64(-0.7)), CURVES[name](np.float64(0.7))
    assert (mirrored[0] == pytest.approx(sign * mirrored[1])) == bool(sign)
    at_rest = CURVES[name](np.complex128(1e-12 + 1j * step)).imag / step
    assert SLOPES_AT_REST[code] == pytest.approx(0.0 if name == "coulomb" else at_rest, abs=1e-11)


def test_pieces_are_the_sum_of_their_corners():
    x = np.linspace(-3.0, 3.0, 61)
    corners = [(1.0, 0.5, 2.0), (-1.0, -1.0, 0.7), (1.0, 2.0, -3.0)]
    for order in (1, 2):
        sums = sum(c * np.maximum(s * (x - k), 0.0) ** order / order for s, k, c in corners)
        pieces = broken_line(corners, order)
        np.testing.assert_allclose([pieces.value(each) for each in x], sums, atol=1e-14)
    assert broken_line([(1.0, 1.0, 2.0), (-1.0, -1.0, -2.0)]).parity == -1
    assert broken_line([(1.0, 1.0, 2.0), (-1.0, -1.0, 2.0)]).parity == 1
    assert broken_line([(1.0, 0.0, 2.0)]).parity == 0
