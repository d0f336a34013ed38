"""Diodes and closed switches whose voltage is a broken line over their current."""

import dataclasses

import numpy as np
import pytest
from messages import is_sentence
from oracles.ngspice import needs_ngspice
from scipy.integrate import solve_ivp
from studies import BENCH

from piezoharvest import (
    SSDI,
    SSDV,
    BiasFlip,
    Doubler,
    HalfWave,
    ParallelSSHI,
    Rectifier,
    SelfPoweredSSHI,
    SeriesSSHI,
    SineForce,
    System,
    Transducer,
    simulate,
)
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve
from piezoharvest.spice.simulators.comparison import compare

DEVICE, DRIVE = Transducer(**BENCH), SineForce(amplitude=0.02, frequency=50.6)
DC = {"smoothing_capacitance": 1e-7, "load_resistance": 5e5, "diode_drop": 0.2}
LOOP = {"inductance": 0.5, "quality": 6.0}
RECTIFYING = {Rectifier: {}, HalfWave: {}, Doubler: {}, ParallelSSHI: LOOP, SeriesSSHI: LOOP, BiasFlip: LOOP}
SWITCHING = {
    SSDI: {}, SSDV: {"source_voltage": 1.0}, ParallelSSHI: DC, SeriesSSHI: DC, BiasFlip: {**DC, "steps": 2},
}  # fmt: skip
CURVE = VoltageCurve(currents=(0.0, 1e-6, 5e-6, 2e-5), voltages=(0.0, 0.15, 0.25, 0.3))


def straight(resistance, currents):
    return VoltageCurve(currents=currents, voltages=tuple(resistance * each for each in currents))


def steady(shunt):
    found = simulate(System(DEVICE, shunt), DRIVE, attenuation=False)
    assert found.converged, found.message
    assert abs(found.energy["closure"]) < 1e-9
    return found


def same(first, second, tolerance=1e-9):
    for name in ("harvested_power", "displacement_amplitude", "voltage_amplitude"):
        assert getattr(first, name) == pytest.approx(getattr(second, name), rel=tolerance), name


@pytest.mark.parametrize("kind", RECTIFYING, ids=lambda kind: kind.kind)
def test_diodes_with_a_straight_curve_are_diodes_with_a_resistance(kind):
    curve = straight(3000.0, (0.0, 1e-6, 5e-6, 2e-5))
    same(
        steady(kind(**DC, **RECTIFYING[kind], diode_curve=curve)),
        steady(kind(**DC, **RECTIFYING[kind], diode_resistance=3000.0)),
    )


@pytest.mark.parametrize("kind", SWITCHING, ids=lambda kind: kind.kind)
def test_a_switch_with_a_straight_curve_is_one_with_a_resistance(kind):
    """It is timed as without the curve: the same time for a lower quality is another relative error of it."""
    added = 400.0
    plain = kind(**LOOP, **SWITCHING[kind])
    coil, resistance = plain.loop(DEVICE.capacitance)
    lower = dataclasses.replace(plain, quality=np.sqrt(coil / DEVICE.capacitance) / (resistance + added))
    timed = plain.nominal_flip_time(DEVICE.capacitance) / lower.nominal_flip_time(DEVICE.capacitance) - 1.0
    if kind is BiasFlip:  # whose steps have loops of their own
        timed = plain.on_time(DEVICE.capacitance) / lower.on_time(DEVICE.capacitance) - 1.0
    lower = dataclasses.replace(lower, on_time_error=timed)
    same(steady(dataclasses.replace(plain, switch_curve=straight(added, (0.0, 1e-4, 1e-3)))), steady(lower), 1e-6)


@pytest.mark.parametrize("kind", RECTIFYING, ids=lambda kind: kind.kind)
def test_energy_closes_with_a_bent_curve_and_takes_more_than_without(kind):
    plain, bent = (steady(kind(**DC, **RECTIFYING[kind], diode_curve=curve)) for curve in (None, CURVE))
    assert bent.dc_voltage < 0.99 * plain.dc_voltage


def test_diodes_and_the_switch_may_have_a_curve_each():
    switch = {"switch_curve": VoltageCurve(currents=(0.0, 1e-5, 1e-3), voltages=(0.0, 0.3, 0.35))}
    for kind in (ParallelSSHI, SeriesSSHI, BiasFlip):
        one = steady(kind(**DC, **LOOP, diode_curve=CURVE))
        assert steady(kind(**DC, **LOOP, diode_curve=CURVE, **switch)).dc_voltage < 0.999 * one.dc_voltage


def test_a_rectifier_follows_an_integrator_with_the_same_curve():
    """Radau on the equations with i(v) of the diodes: m x'' + b x' + k x = F + T v, C v' + T x' = -i."""
    m, b, k, T, C = (BENCH[name] for name in ("mass", "damping", "stiffness", "coupling", "capacitance"))
    store, load, drop = DC["smoothing_capacitance"], DC["load_resistance"], 2.0 * DC["diode_drop"]

    def current(excess):  # of a path of two diodes; the last piece goes on
        points = np.array(CURVE.voltages) * 2.0
        beyond = (excess - points[-1]) / (points[-1] - points[-2]) * (CURVE.currents[-1] - CURVE.currents[-2])
        return np.interp(excess, points, CURVE.currents) + max(beyond, 0.0)

    def rates(t, y):
        x, u, v, dc = y.tolist()
        i = current(v - dc - drop) - current(-v - dc - drop)
        force = DRIVE.amplitude * np.sin(2 * np.pi * DRIVE.frequency * t)
        return [u, (force - b * u - k * x + T * v) / m, (-i - T * u) / C, (abs(i) - dc / load) / store]

    found = simulate(
        System(DEVICE, Rectifier(**DC, diode_curve=CURVE)), DRIVE, transient=0.2, attenuation=False, samples=400
    )
    wave = found.waveforms
    run = solve_ivp(
        rates, (0.0, 0.2), np.zeros(4), "Radau", wave.time, rtol=1e-9, atol=1e-13, max_step=1e-4, first_step=1e-7
    )
    for name, row in (("displacement", 0), ("voltage", 2), ("dc_voltage", 3)):
        true = run.y[row]
        assert np.abs(getattr(wave, name) - true).max() < 1e-6 * np.abs(true).max(), name


def test_a_constant_drop_of_the_switch_leaves_less_after_an_inversion():
    """The voltage V swings about the drop d: q (V - d) - d of the other sign is left, with a coil that is fast."""
    drop, fast = 0.4, {"inductance": 1e-5, "quality": 6.0}
    sharp = VoltageCurve(currents=(0.0, 1e-9, 1.0), voltages=(0.0, drop, drop))
    shunt = SSDI(**fast, switch_curve=sharp)
    wave = simulate(System(DEVICE, shunt), DRIVE, attenuation=False, samples=4000).waveforms
    jumps = np.flatnonzero(np.abs(np.diff(wave.voltage)) > 0.8 * np.ptp(wave.voltage))
    assert len(jumps) == 2
    q = np.exp(-np.pi / 12.0)
    for k in jumps:
        before, after = np.abs(wave.voltage[k]), np.abs(wave.voltage[k + 1])
        assert after == pytest.approx(q * (before - drop) - drop, rel=3e-3)


@needs_ngspice
@pytest.mark.parametrize(
    "shunt",
    [
        Rectifier(**DC, diode_curve=CURVE),
        SeriesSSHI(**DC, **LOOP, diode_curve=VoltageCurve(currents=(0.0, 1e-4, 1e-3), voltages=(0.0, 0.2, 0.3))),
        SSDI(**LOOP, switch_curve=VoltageCurve(currents=(0.0, 1e-5, 1e-3), voltages=(0.0, 0.3, 0.5))),
    ],
    ids=lambda shunt: shunt.kind,
)
def test_netlists_have_the_curve(shunt):
    figures, trusted = compare(System(DEVICE, shunt), DRIVE)
    assert trusted
    for each in figures:
        assert abs(each.difference) < 0.01, each.name


WRONG = [
    (lambda: VoltageCurve(currents=(0.0,), voltages=(0.0,)), "currents"),
    (lambda: VoltageCurve(currents=(1e-6, 1e-5), voltages=(0.0, 0.1)), "currents"),
    (lambda: VoltageCurve(currents=(0.0, 1e-5), voltages=(0.0, 0.1, 0.2)), "voltages"),
    (lambda: VoltageCurve(currents=(0.0, 1e-5), voltages=(0.2, 0.1)), "voltages"),
    (lambda: Rectifier(**DC, diode_curve=straight(0.0, (0.0, 1e-6))), "diode_curve.voltages"),
    (lambda: SSDI(**LOOP, switch_curve=VoltageCurve(currents=(0.0, 1e-3), voltages=(0.1, 0.2))), "switch_curve"),
    (lambda: Rectifier(**DC, diode_curve=[[0.0, 0.1]]), "diode_curve"),
    (lambda: SSDI(**LOOP, switch_curve="curve"), "switch_curve"),
    (lambda: SSDI(**LOOP, core_resistance=1e5, switch_curve=straight(10.0, (0.0, 1e-3))), "switch_curve"),
]  # fmt: skip


@pytest.mark.parametrize(("made", "key"), WRONG)
def test_what_is_no_curve_is_refused_in_a_sentence(made, key):
    with pytest.raises(ParameterError) as error:
        made()
    assert error.value.key.startswith(key)
    assert is_sentence(str(error.value))


def test_a_breaker_has_straight_diodes():
    shunt = SelfPoweredSSHI(
        **DC, **LOOP, envelope_capacitance=1e-9, threshold=0.6, diode_curve=straight(100.0, (0.0, 1e-3))
    )
    with pytest.raises(ParameterError, match="straight diodes"):
        simulate(System(DEVICE, shunt), DRIVE)


def test_a_curve_of_too_many_points_is_refused_before_anything_is_set_up():
    many = tuple(np.linspace(0.0, 1e-3, 3000))
    shunt = Rectifier(**DC, diode_curve=VoltageCurve(currents=many, voltages=many))
    with pytest.raises(ParameterError, match="give fewer points") as error:
        simulate(System(DEVICE, shunt), DRIVE)
    assert is_sentence(str(error.value))
