"""Loads behind a bridge whose current is a broken line over their voltage."""

import numpy as np
import pytest
from messages import is_sentence
from oracles.ngspice import needs_ngspice
from scipy.integrate import solve_ivp
from studies import BENCH

from piezoharvest import (
    BiasFlip,
    Doubler,
    HalfWave,
    ParallelSSHI,
    Rectifier,
    SelfPoweredSSHI,
    SeriesSSHI,
    SineForce,
    Storage,
    System,
    Transducer,
    simulate,
)
from piezoharvest.description.catalogue.parts import parts
from piezoharvest.description.diode import exponential_curve
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.curves.load_curve import LoadCurve
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve
from piezoharvest.spice.simulators.comparison import compare

DEVICE, DRIVE = Transducer(**BENCH), SineForce(amplitude=0.02, frequency=50.6)
DC = {"smoothing_capacitance": 1e-7, "diode_drop": 0.2}
LOAD, OTHER = 8e5, 1.6e6  # ohm
LOOP = {"inductance": 0.5, "quality": 6.0}
BREAKER = {"envelope_capacitance": 1e-9, "threshold": 0.6}
KINDS = {
    Rectifier: {}, HalfWave: {}, Doubler: {}, ParallelSSHI: LOOP, SeriesSSHI: LOOP, BiasFlip: LOOP,
    SelfPoweredSSHI: {**LOOP, **BREAKER},
}  # fmt: skip


def steady(shunt):
    found = simulate(System(DEVICE, shunt), DRIVE, attenuation=False, samples=4000)
    assert found.converged, found.message
    assert abs(found.energy["closure"]) < 1e-9
    return found


def straight(*voltages):
    return LoadCurve(voltages=(0.0, *voltages), currents=(0.0, *(each / OTHER for each in voltages)))


@pytest.mark.parametrize("resistance", [0.0, 2e3])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.kind)
def test_a_straight_curve_is_a_further_resistance(kind, resistance):
    given = {**DC, **KINDS[kind], "smoothing_resistance": resistance}
    found = steady(kind(**given, load_resistance=LOAD, load_curve=straight(0.7, 1.5, 4.0)))
    wanted = steady(kind(**given, load_resistance=1.0 / (1.0 / LOAD + 1.0 / OTHER)))
    for name in ("harvested_power", "displacement_amplitude", "voltage_amplitude", "dc_voltage"):
        assert getattr(found, name) == pytest.approx(getattr(wanted, name), rel=1e-9), name


@pytest.mark.parametrize("resistance", [0.0, 2e3])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.kind)
def test_energy_closes_and_all_that_the_load_takes_is_harvested(kind, resistance):
    given = {**DC, **KINDS[kind], "smoothing_resistance": resistance, "load_resistance": LOAD}
    top = steady(kind(**given)).dc_voltage
    voltages, currents = top * np.array([0.0, 0.5, 0.7, 0.8, 1.0]), top / LOAD * np.array([0.0, 0.0, 0.2, 0.1, 0.4])
    curve = LoadCurve(voltages=tuple(voltages), currents=tuple(currents))
    found = steady(kind(**given, load_curve=curve))
    assert found.dc_voltage < 0.97 * top
    if not resistance:  # of the waveform, which has a corner at every event
        v = found.waveforms.dc_voltage[:-1]
        taken = np.mean(v**2 / LOAD + v * np.array([curve.at(each) for each in v]))
        assert found.harvested_power == pytest.approx(taken, rel=1e-3)


def test_a_rectifier_follows_an_integrator_with_the_same_load():
    """DOP853 with events: m x'' + b x' + k x = F + T v, C v' + T x' = -i, C_s v_dc' = |i| - v_dc/R - g(v_dc)."""
    m, b, k, T, C = (BENCH[name] for name in ("mass", "damping", "stiffness", "coupling", "capacitance"))
    store, drop = DC["smoothing_capacitance"], 2.0 * DC["diode_drop"]
    top = 0.9 * steady(Rectifier(**DC, load_resistance=LOAD)).dc_voltage
    curve = LoadCurve(voltages=(0.0, 0.4 * top, 0.7 * top, top), currents=(0.0, 0.0, 3e-6, 5e-6))

    def drain(dc):
        return dc / LOAD + curve.at(dc)

    def rates(t, y, side):
        x, u, v, dc = y
        force = DRIVE.amplitude * np.sin(2 * np.pi * DRIVE.frequency * t)
        motion = [u, (force - b * u - k * x + T * v) / m]
        if not side:
            return [*motion, -T * u / C, -drain(dc) / store]
        rise = (-side * T * u - drain(dc)) / (C + store)
        return [*motion, side * rise, rise]

    def changes(t, y, side):
        return store * rates(t, y, side)[3] + drain(y[3]) if side else y[3] + drop - abs(y[2])

    changes.terminal, changes.direction = True, -1.0
    shunt = Rectifier(**DC, load_resistance=LOAD, load_curve=curve)
    wave = simulate(System(DEVICE, shunt), DRIVE, transient=0.4, attenuation=False, samples=400).waveforms
    t, y, side, found = 0.0, np.zeros(4), 0, []
    while True:
        run = solve_ivp(
            rates, (t, wave.time[-1]), y, "DOP853", wave.time[wave.time >= t], args=(side,), events=changes,
            rtol=1e-11, atol=1e-15, max_step=2e-4,
        )  # fmt: skip
        found.append(run.y)
        if run.status == 0:
            break
        t, y = run.t_events[0][-1], run.y_events[0][-1]
        side = 0 if side else int(np.sign(y[2]))
    true = np.concatenate(found, axis=1)
    assert true[3].max() > 0.8 * top  # three of its pieces are visited
    for name, row in (("displacement", 0), ("voltage", 2), ("dc_voltage", 3)):
        assert np.abs(getattr(wave, name) - true[row]).max() < 1e-7 * np.abs(true[row]).max(), name


def test_load_and_diodes_may_have_a_curve_each():
    diode = VoltageCurve(currents=(0.0, 1e-6, 5e-6, 2e-5), voltages=(0.0, 0.15, 0.25, 0.3))
    for kind in (Rectifier, ParallelSSHI):
        given = {**DC, **KINDS[kind], "load_resistance": LOAD, "load_curve": straight(0.7, 1.5)}
        assert steady(kind(**given, diode_curve=diode)).dc_voltage < 0.999 * steady(kind(**given)).dc_voltage


@needs_ngspice
@pytest.mark.parametrize(
    ("kind", "diodes"),
    [(Rectifier, None), (Doubler, None), (ParallelSSHI, None), (Rectifier, "BAT54"), (Doubler, "BAT54")],
)
def test_ngspice_agrees(kind, diodes):
    part = diodes and parts("diode")[diodes]
    law = part and exponential_curve(*(part[key] for key in ("saturation_current", "emission", "series_resistance")))
    shunt = kind(
        **{**DC, "diode_drop": 0.0 if diodes else 0.2}, diode_curve=law, **KINDS[kind], load_resistance=LOAD,
        load_curve=LoadCurve(voltages=(0.0, 0.5, 1.0), currents=(0.0, 0.0, 3e-6)),
    )  # fmt: skip
    figures, trusted = compare(System(DEVICE, shunt), DRIVE, diodes=diodes)
    assert trusted
    for each in figures:
        assert abs(each.difference) < 0.01, each.name


WRONG = [
    (lambda: LoadCurve(voltages=(0.0,), currents=(0.0,)), "voltages"),
    (lambda: LoadCurve(voltages=(1.0, 2.0), currents=(0.0, 0.1)), "voltages"),
    (lambda: LoadCurve(voltages=(0.0, 1.0), currents=(0.0, 0.1, 0.2)), "currents"),
    (lambda: LoadCurve(voltages=(0.0, 1.0), currents=(1e-3, 0.1)), "currents"),
    (lambda: LoadCurve(voltages=(0.0, 1.0, 2.0), currents=(0.0, 0.2, 0.1)), "currents"),
    (lambda: Rectifier(dc_voltage=3.0, load_curve=straight(1.0)), "load_curve"),
    (lambda: Rectifier(**DC, storage=Storage(turn_on=3.0, turn_off=2.0, power=1e-6), load_curve=straight(1.0)),
     "load_curve"),
    (lambda: Rectifier(**DC, load_resistance=LOAD, load_curve=[[0.0, 1.0]]), "load_curve"),
    (lambda: Rectifier(**DC, load_resistance=LOAD, smoothing_resistance=1e4, load_curve=LoadCurve(
        voltages=(0.0, 1.0, 1.1, 2.0), currents=(0.0, 1e-3, 0.0, 0.0))), "load_curve.currents"),
]  # fmt: skip


@pytest.mark.parametrize(("made", "key"), WRONG)
def test_what_is_no_curve_is_refused_in_a_sentence(made, key):
    with pytest.raises(ParameterError) as error:
        made()
    assert error.value.key.startswith(key)
    assert is_sentence(str(error.value))
