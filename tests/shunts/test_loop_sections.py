"""Switched loops with resistances that stand beside an inductance or a capacitance."""

import dataclasses

import numpy as np
import pytest
from messages import is_sentence
from oracles.ngspice import needs_ngspice
from scipy.integrate import solve_ivp
from studies import BENCH

from piezoharvest import SSDI, SSDV, BiasFlip, ParallelSSHI, SeriesSSHI, SineForce, System, Transducer, simulate
from piezoharvest.bench.settings import check_shunt
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.curves.loop_sections import LoopSections
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve
from piezoharvest.spice.simulators.comparison import compare
from piezoharvest.study.building import build_shunt

DEVICE, DRIVE = Transducer(**BENCH), SineForce(amplitude=0.02, frequency=50.6)
DC = {"smoothing_capacitance": 1e-7, "load_resistance": 5e5, "diode_drop": 0.2}
LOOP = {"inductance": 0.5, "quality": 6.0}
SWITCHING = {
    SSDI: {}, SSDV: {"source_voltage": 1.0}, ParallelSSHI: DC, SeriesSSHI: DC, BiasFlip: {**DC, "steps": 2},
}  # fmt: skip
RESISTANCE = 400.0
SWING = float(np.sqrt(LOOP["inductance"] * DEVICE.capacitance))  # s
TWO = ("inductance", "capacitance")
BOTH = LoopSections(resistances=(300.0, 500.0), time_constants=(SWING, 0.5 * SWING), beside=TWO)
FIGURES = ("harvested_power", "displacement_amplitude", "voltage_amplitude")


def one(time_constant, beside):
    return LoopSections(resistances=(RESISTANCE,), time_constants=(time_constant,), beside=(beside,))


def steady(shunt):
    found = simulate(System(DEVICE, shunt), DRIVE, attenuation=False)
    assert found.converged, found.message
    assert abs(found.energy["closure"]) < 1e-10
    return found


@pytest.mark.parametrize(("time_constant", "beside"), [(1e-6 * SWING, "capacitance"), (1e7 * SWING, "inductance")])
@pytest.mark.parametrize("kind", SWITCHING, ids=lambda kind: kind.kind)
def test_a_capacitance_that_is_charged_at_once_or_an_inductance_that_is_never_leaves_the_resistance(
    kind, time_constant, beside
):
    plain = kind(**LOOP, **SWITCHING[kind])
    straight = VoltageCurve(currents=(0.0, 1.0), voltages=(0.0, RESISTANCE))
    first = steady(dataclasses.replace(plain, loop_sections=one(time_constant, beside)))
    second = steady(dataclasses.replace(plain, switch_curve=straight))
    for name in FIGURES:
        assert getattr(first, name) == pytest.approx(getattr(second, name), rel=1e-4), name


def test_an_inductance_without_a_resistance_beside_it_is_one_more_of_the_coil():
    """A resistance so large that all of the current goes through the inductance."""
    share, plain = 0.1, SSDI(**LOOP)
    coil, resistance = plain.loop(DEVICE.capacitance)
    huge = 1e4 * resistance
    sections = LoopSections(resistances=(huge,), time_constants=(share * coil / huge,), beside=("inductance",))
    larger = (1.0 + share) * coil
    other = SSDI(inductance=larger, quality=float(np.sqrt(larger / DEVICE.capacitance) / resistance))
    timed = plain.nominal_flip_time(DEVICE.capacitance) / other.nominal_flip_time(DEVICE.capacitance) - 1.0
    first = steady(dataclasses.replace(plain, loop_sections=sections))
    second = steady(dataclasses.replace(other, on_time_error=timed))
    for name in FIGURES[1:]:
        assert getattr(first, name) == pytest.approx(getattr(second, name), rel=1e-3), name


@pytest.mark.parametrize("kind", SWITCHING, ids=lambda kind: kind.kind)
def test_energy_closes_with_sections_of_both_kinds_and_a_curve(kind):
    curve = VoltageCurve(currents=(0.0, 1e-5, 1e-3), voltages=(0.0, 0.1, 0.15))
    plain = steady(kind(**LOOP, **SWITCHING[kind]))
    found = steady(kind(**LOOP, **SWITCHING[kind], loop_sections=BOTH, switch_curve=curve))
    assert found.displacement_amplitude != pytest.approx(plain.displacement_amplitude, rel=1e-4)


def test_an_inversion_is_that_of_an_independent_integration():
    """By the states of the parts themselves: currents of the inductances, and the voltage of the capacitance."""
    m, b, k, T, C = (BENCH[name] for name in ("mass", "damping", "stiffness", "coupling", "capacitance"))
    shunt = SSDI(**LOOP, loop_sections=BOTH)
    coil, own = shunt.loop(C)
    (first, second), (beside, charged) = BOTH.resistances, BOTH.time_constants
    inductance, capacitance = first * beside, charged / second

    def rates(t, y, closed):
        x, u, v, i, j, w = y  # j: current of the inductance; w: voltage of the capacitance
        force = DRIVE.amplitude * np.sin(2 * np.pi * DRIVE.frequency * t)
        across = v - own * i - first * (i - j) - w
        return [
            u, (force - b * u - k * x + T * v) / m, (-i - T * u) / C, across / coil if closed else 0.0,
            first * (i - j) / inductance, (i - w / second) / capacitance,
        ]  # fmt: skip

    def turns(t, y, closed):
        return y[1]

    turns.terminal = True
    found = simulate(System(DEVICE, shunt), DRIVE, transient=0.1, attenuation=False, samples=400)
    t, y, end, voltages = 0.0, np.zeros(6), found.waveforms.time[-1], []
    times, closed = found.waveforms.time, False
    while t < end:
        until = min(end, t + shunt.on_time(C)) if closed else end if t else 1e-3  # at rest it turns, too
        events = None if closed or not t else turns
        run = solve_ivp(
            rates, (t, until), y, "DOP853", dense_output=True, events=events, args=(closed,), rtol=1e-11, atol=1e-15,
            max_step=1e-4, first_step=1e-9,
        )  # fmt: skip
        inside = times[(times >= t) & (times < run.t[-1])]
        voltages += [*run.sol(inside)[2]] if len(inside) else []
        t, y = run.t[-1], run.y[:, -1].copy()
        if closed:
            y[3] = 0.0  # the switch cuts the current
        closed = run.status == 1
    found_voltage = found.waveforms.voltage[: len(voltages)]
    assert np.abs(found_voltage - voltages).max() < 1e-6 * np.abs(found_voltage).max()


@needs_ngspice
@pytest.mark.parametrize(
    "shunt",
    [
        SSDI(**LOOP, loop_sections=BOTH),
        SSDI(**LOOP, loop_sections=BOTH, switch_curve=VoltageCurve(currents=(0.0, 1e-3), voltages=(0.0, 0.2))),
        SeriesSSHI(**DC, **LOOP, loop_sections=one(SWING, "inductance")),
    ],
    ids=("ssdi", "ssdi curved", "series_sshi"),
)
def test_netlists_have_the_sections(shunt):
    figures, trusted = compare(System(DEVICE, shunt), DRIVE)
    assert trusted
    for each in figures:
        assert abs(each.difference) < 0.01, each.name


def test_a_study_gives_them_as_a_table():
    table = {"resistances": ["0.3 kohm", 500.0], "time_constants": [1e-4, 2e-4], "beside": [*TWO]}
    found = build_shunt({"kind": "ssdi", **LOOP, "loop_sections": table}, "shunt").loop_sections
    assert found == LoopSections(resistances=(300.0, 500.0), time_constants=(1e-4, 2e-4), beside=TWO)


WRONG = [
    (lambda: LoopSections(resistances=(), time_constants=(), beside=()), "resistances"),
    (lambda: LoopSections(resistances=(1.0,), time_constants=(), beside=("inductance",)), "time_constants"),
    (lambda: LoopSections(resistances=(1.0,), time_constants=(0.0,), beside=("inductance",)), "time_constants"),
    (lambda: LoopSections(resistances=(-1.0,), time_constants=(1.0,), beside=("inductance",)), "resistances"),
    (lambda: LoopSections(resistances=(1.0,), time_constants=(1.0,), beside=("coil",)), "beside.0"),
    (lambda: SSDI(**LOOP, loop_sections=[1.0]), "loop_sections"),
    (lambda: SSDI(**LOOP, core_resistance=1e5, loop_sections=BOTH), "loop_sections"),
    (lambda: check_shunt(SSDI(**LOOP, loop_sections=BOTH), "shunt"), "shunt.loop_sections"),
]


@pytest.mark.parametrize(("made", "key"), WRONG)
def test_what_is_no_section_is_refused_in_a_sentence(made, key):
    with pytest.raises(ParameterError) as error:
        made()
    assert error.value.key.startswith(key)
    assert is_sentence(str(error.value))
