"""A storage capacitor from its first charge to the supply that it feeds: closed forms, and ngspice."""

import dataclasses

import numpy as np
import pytest
from messages import is_sentence
from oracles.ngspice import needs_ngspice
from scipy.integrate import quad
from studies import BENCH

from piezoharvest import (
    Doubler,
    EfficiencyCurve,
    LoadPhase,
    ParallelSSHI,
    Rectifier,
    SineForce,
    System,
    Transducer,
    simulate,
    simulate_many,
)
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.base import each_of
from piezoharvest.description.shunts.cold_start import ColdStart
from piezoharvest.description.shunts.saturation import Saturated
from piezoharvest.description.shunts.storage import Storage
from piezoharvest.description.shunts.stored import Stored, with_supply
from piezoharvest.engine.lowering.lower import lower
from piezoharvest.spice.simulators.comparison import compare
from piezoharvest.study import load_study

DEVICE = Transducer(**BENCH)
STILL, DRIVE = (SineForce(amplitude=force, frequency=50.6) for force in (0.0, 0.02))
SUPPLY = Storage(turn_on=4.5, turn_off=3.0, power=1e-3, efficiency=0.8)
STORE = 1e-4
NODE = (
    LoadPhase(power=2e-4, duration=0.03),
    LoadPhase(power=2e-3, duration=0.005, sends=True),
    LoadPhase(power=1e-5, duration=0.11),
)
OVER_POWER = EfficiencyCurve(powers=(1e-6, 1e-4, 1e-2), efficiencies=(0.4, 0.7, 0.9))
OVER_VOLTAGE = EfficiencyCurve(voltages=(3.0, 3.8, 5.0), efficiencies=(0.6, 0.75, 0.8))


def transient(shunt, length, drive=STILL, **keys):
    found = simulate(System(DEVICE, shunt), drive, transient=length, attenuation=False, **keys)
    assert found.converged, found.message
    assert abs(found.energy["closure"]) < 1e-10
    return found


def times(found, event):
    names, when = found.waveforms.event_names, found.waveforms.event_times
    return [t for name, t in zip(names, when, strict=True) if name == event]


@pytest.mark.parametrize("leakage", [0.0, 1e-6, 1e-4])
@pytest.mark.parametrize("begins", [4.5, 8.0])
def test_store_that_discharges_on_its_own(leakage, begins):
    """C/2 d(v^2)/dt = -P/efficiency - G v^2, whatever the power is replaced by in between."""
    shunt = Rectifier(
        smoothing_capacitance=STORE, initial_dc_voltage=begins, dc_leakage=leakage, storage=SUPPLY
    )  # fmt: skip
    drawn, on = SUPPLY.power / SUPPLY.efficiency, begins**2 - SUPPLY.turn_off**2
    wanted = 0.5 * STORE * on / drawn
    if leakage:
        ends = (leakage * v**2 + drawn for v in (begins, SUPPLY.turn_off))
        wanted = 0.5 * STORE / leakage * np.log(np.divide(*ends))
    found = transient(shunt, 2.0 * wanted)
    # From the middle of a piece on, the power is right to 2e-4 only for as long as that piece lasts.
    assert times(found, "supply turns off") == [pytest.approx(wanted, rel=1e-6 if begins == 4.5 else 1e-5)]
    assert found.time_to_turn_on == 0.0
    assert found.energy["harvested"] == pytest.approx(SUPPLY.power * wanted, rel=1e-5)


def test_store_that_keeps_its_charge():
    found = transient(Rectifier(smoothing_capacitance=STORE, initial_dc_voltage=2.0, storage=SUPPLY), 1.0)
    assert found.energy_stored == pytest.approx(0.5 * STORE * 4.0, rel=1e-12)
    assert (found.time_to_turn_on, found.wakes_per_hour) == (None, 0.0)


def test_initial_voltage_decays_in_a_load_resistance():
    found = transient(
        Rectifier(
            smoothing_capacitance=STORE, load_resistance=1e3, initial_dc_voltage=4.0,
            storage=Storage(turn_on=5.0, turn_off=1.0),
        ),
        0.1,
    )  # fmt: skip
    wanted = 4.0 * np.exp(-found.waveforms.time / 0.1)
    np.testing.assert_allclose(found.waveforms.dc_voltage, wanted, rtol=1e-9)


def test_wakes_come_at_the_energy_that_the_store_gives():
    """Between two wakes the load has what the store loses, and what comes in meanwhile: energy balance of cycles."""
    shunt = Rectifier(smoothing_capacitance=1e-6, storage=SUPPLY)
    found = transient(shunt, 4.0, DRIVE)
    on, off = times(found, "supply turns on"), times(found, "supply turns off")
    assert found.time_to_turn_on == on[0]
    assert found.wakes_per_hour == pytest.approx(3600 * len(on) / 4.0)
    lasted = sum(b - a for a, b in zip(on, off, strict=False))
    assert found.energy["harvested"] == pytest.approx(SUPPLY.power * lasted, rel=1e-3)
    assert np.diff(on).min() > 0
    v = found.waveforms.dc_voltage[found.waveforms.time > on[0]]
    assert v.max() <= SUPPLY.turn_on * (1 + 1e-2) and v.min() >= SUPPLY.turn_off * (1 - 1e-2)


def test_node_that_wakes_sends_and_sleeps_until_its_store_is_empty():
    """C/2 (v_on^2 - v_off^2) pays for the phases, each at its power plus the constant one over its efficiency."""
    storage = Storage(turn_on=4.5, turn_off=4.0, power=2e-6, phases=NODE, efficiency_curve=OVER_POWER, max_voltage=5.0)
    found = transient(Rectifier(smoothing_capacitance=STORE, initial_dc_voltage=4.5, storage=storage), 2.5)
    left, ends, packets, delivered = 0.5 * STORE * (4.5**2 - 4.0**2), 0.0, 0, 0.0
    logarithms = np.log10(OVER_POWER.powers or ())
    while left > 0:
        for phase in NODE:
            power = phase.power + 2e-6
            drawn = power / np.interp(np.log10(power), logarithms, OVER_POWER.efficiencies)
            lasts = min(phase.duration, left / drawn)
            left, ends, delivered = left - drawn * lasts, ends + lasts, delivered + power * lasts
            packets += phase.sends and lasts == phase.duration
    assert times(found, "supply turns off") == [pytest.approx(ends, rel=1e-4)]
    assert len(times(found, "packet is sent")) == packets == found.packets_per_hour * 2.5 / 3600
    assert found.energy["harvested"] == pytest.approx(delivered, rel=1e-4)


def test_efficiency_over_the_voltage():
    """C v dv = -P/eta(v) dt; between the ends of the pieces the curve is right to 3e-4."""
    storage = Storage(turn_on=4.5, turn_off=3.0, power=1e-3, efficiency_curve=OVER_VOLTAGE, max_voltage=5.0)
    wanted = STORE / 1e-3 * quad(lambda v: v * np.interp(v, (3.0, 3.8, 5.0), (0.6, 0.75, 0.8)), 3.0, 4.5)[0]
    found = transient(Rectifier(smoothing_capacitance=STORE, initial_dc_voltage=4.5, storage=storage), 2 * wanted)
    assert times(found, "supply turns off") == [pytest.approx(wanted, rel=3e-4)]
    assert found.energy["harvested"] == pytest.approx(1e-3 * wanted, rel=3e-4)


def test_protection_takes_what_is_too_much():
    storage = dataclasses.replace(SUPPLY, power=1e-5, max_voltage=6.0)
    found = transient(Rectifier(smoothing_capacitance=1e-6, storage=storage), 4.0, DRIVE)
    assert found.waveforms.dc_voltage.max() == pytest.approx(6.0, rel=1e-9)
    assert "store is full" in found.waveforms.event_names
    steady = simulate(System(DEVICE, Rectifier(smoothing_capacitance=1e-6, storage=storage)), DRIVE)
    assert steady.converged, steady.message
    assert steady.harvested_power == pytest.approx(1e-5, rel=1e-3)


def test_many_designs_are_those_of_one():
    powers = np.array([[1e-5], [2e-5]])
    storage = Storage(turn_on=1.0, turn_off=0.5, power=powers, max_voltage=12.0)
    system = System(DEVICE, Rectifier(smoothing_capacitance=1e-6, storage=storage))
    found = simulate_many(system, DRIVE, 2, attenuation=False)
    assert found["converged"].all()
    np.testing.assert_allclose(found["harvested_power"], powers[:, 0], rtol=1e-3)


FULL_SOON = dataclasses.replace(SUPPLY, max_voltage=5.0, phases=NODE, efficiency_curve=OVER_POWER, efficiency=1.0)
BATCH = dataclasses.replace(SUPPLY, power=np.array([[1e-3], [2e-3]]), max_voltage=np.array([[5.0], [6.0]]))


@pytest.mark.parametrize(
    "shunt",
    [
        Rectifier(smoothing_capacitance=STORE, storage=SUPPLY),
        Rectifier(smoothing_capacitance=STORE, smoothing_resistance=10.0, diode_resistance=20.0, storage=FULL_SOON),
        Rectifier(smoothing_capacitance=STORE, diode_saturation=1e-8, storage=FULL_SOON),
        Rectifier(smoothing_capacitance=STORE, diode_resistance=20.0, storage=BATCH),
        Rectifier(smoothing_capacitance=STORE, storage=Storage(turn_on=4.5, turn_off=4.4, max_voltage=4.6)),
        ParallelSSHI(
            smoothing_capacitance=STORE, inductance=0.1, quality=8.0, diode_drop=0.3, storage=FULL_SOON,
            start_voltage=4.0, stop_voltage=2.5,
        ),
    ],
)  # fmt: skip
def test_supplies_that_are_alike_have_the_equations_of_each(shunt, monkeypatch):
    """To the last bit, however many are asked for at once."""
    system = System(DEVICE, shunt)
    together = lower(system, DRIVE)
    for cls in (Stored, ColdStart, Saturated):
        monkeypatch.setattr(cls, "alike", cls.configurations)
    apart = lower(system, DRIVE)
    assert together.configurations == apart.configurations
    for name, one, other in zip(apart.program._fields, together.program, apart.program, strict=True):
        np.testing.assert_array_equal(one, other, err_msg=name)


def test_half_a_thousand_configurations_are_asked_for_by_a_few_names():
    storage = dataclasses.replace(FULL_SOON, max_voltage=None)
    whole = with_supply(Rectifier(smoothing_capacitance=STORE, storage=storage))
    every = [each for name in whole.alike() for each in each_of(name)]
    assert sorted(every) == sorted(whole.configurations())
    assert len(every) > 10 * len(whole.alike())


@pytest.mark.parametrize(
    "key, changes",
    [
        ("turn_off", {"storage": {"turn_on": 3.0, "turn_off": 3.0}}),
        ("max_voltage", {"storage": {"turn_on": 3.0, "turn_off": 2.0, "max_voltage": 2.5}}),
        ("initial_dc_voltage", {"initial_dc_voltage": 20.0, "storage": {"turn_on": 3.0, "turn_off": 2.0}}),
        ("storage", {"smoothing_capacitance": None, "dc_voltage": 1.0, "storage": {"turn_on": 3.0, "turn_off": 2.0}}),
        ("initial_dc_voltage", {"smoothing_capacitance": None, "dc_voltage": 1.0, "initial_dc_voltage": 2.0}),
        ("smoothing_capacitance", {"initial_dc_voltage": 2.0}),
        ("phases", {"storage": {"turn_on": 3.0, "turn_off": 2.0, "phases": NODE[:1]}}),
        (
            "efficiency",
            {"storage": {"turn_on": 3.0, "turn_off": 2.0, "efficiency": 0.9, "efficiency_curve": OVER_POWER}},
        ),
    ],
)
def test_what_is_refused(key, changes):
    keys = {"smoothing_capacitance": STORE, **changes}
    with pytest.raises(ParameterError) as caught:
        Rectifier(**{**keys, **({"storage": Storage(**keys["storage"])} if "storage" in keys else {})})
    assert caught.value.key == key
    assert is_sentence(caught.value.message)


@pytest.mark.parametrize(
    "key, keys",
    [
        ("powers", {"powers": (1.0, 2.0), "voltages": (1.0, 2.0)}),
        ("powers", {}),
        ("powers", {"powers": (1.0, 2.0, 3.0)}),
        ("voltages", {"voltages": (2.0, 1.0)}),
    ],
)
def test_curves_that_are_refused(key, keys):
    with pytest.raises(ParameterError) as caught:
        EfficiencyCurve(efficiencies=(0.5, 0.9), **keys)
    assert caught.value.key == key
    assert is_sentence(caught.value.message)


def test_from_a_file(tmp_path):
    (tmp_path / "study.toml").write_text(
        "[transducer]\nmass = 0.01\ndamping = 0.06\nstiffness = 986.0\ncoupling = 1e-3\ncapacitance = 4e-8\n"
        '[excitation]\nkind = "sine_force"\namplitude = 0.02\nfrequency = 50.6\n'
        '[[shunts]]\nkind = "rectifier"\nsmoothing_capacitance = 1e-6\ninitial_dc_voltage = 1.0\n'
        "[shunts.storage]\nturn_on = 4.5\nturn_off = 3.0\npower = 1e-3\n"
        '[[shunts.storage.phases]]\npower = "0.2 mW"\nduration = "5 ms"\nsends = true\n'
        "[shunts.storage.efficiency_curve]\nvoltages = [3.0, 5.0]\nefficiencies = [0.6, 0.8]\n"
    )
    storage = load_study(tmp_path / "study.toml").shunts[0].storage
    assert storage.phases == (LoadPhase(power=2e-4, duration=5e-3, sends=True),)
    curve = EfficiencyCurve(voltages=(3.0, 5.0), efficiencies=(0.6, 0.8))
    assert (storage.turn_on, storage.efficiency_curve) == (4.5, curve)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("kind", [Doubler, ParallelSSHI])
def test_against_ngspice(kind):
    loop = {"inductance": 0.1, "quality": 5.0} if kind is ParallelSSHI else {}
    storage = dataclasses.replace(SUPPLY, power=5e-5, max_voltage=6.0) if kind is Doubler else SUPPLY
    shunt = kind(smoothing_capacitance=1e-6, initial_dc_voltage=2.0, storage=storage, **loop)
    figures, trusted = compare(System(DEVICE, shunt), DRIVE)
    assert trusted
    for figure in figures:
        assert abs(figure.difference) < 0.01, figure


@pytest.mark.slow
@needs_ngspice
def test_node_against_ngspice():
    storage = Storage(turn_on=4.5, turn_off=3.0, power=2e-6, phases=NODE, efficiency_curve=OVER_VOLTAGE)
    shunt = Rectifier(smoothing_capacitance=5e-6, initial_dc_voltage=4.0, storage=storage)
    figures, trusted = compare(System(DEVICE, shunt), DRIVE)
    assert trusted
    for figure in figures:
        assert abs(figure.difference) < 0.01, figure


RESISTANCE = 300.0  # the supply draws 0.42 mA just before it turns off: 0.125 V


def test_a_resistance_in_series_turns_the_supply_off_sooner():
    """C v_c' = -i with P/efficiency = i (v_c - r i): the supply sees what is left, by quadrature."""
    drawn = SUPPLY.power / SUPPLY.efficiency
    shunt = Rectifier(
        smoothing_capacitance=STORE, initial_dc_voltage=6.0, smoothing_resistance=RESISTANCE, storage=SUPPLY
    )  # fmt: skip

    def current(inside):
        return (inside - np.sqrt(inside**2 - 4 * RESISTANCE * drawn)) / (2 * RESISTANCE)

    last = SUPPLY.turn_off + RESISTANCE * drawn / SUPPLY.turn_off
    wanted = STORE * quad(lambda v: 1 / current(v), last, 6.0, epsabs=0)[0]
    found = transient(shunt, 1.5 * wanted)
    (off,) = times(found, "supply turns off")
    assert off == pytest.approx(wanted, rel=1e-4)
    assert off < 0.97 * 0.5 * STORE * (36.0 - SUPPLY.turn_off**2) / drawn
    assert found.energy_stored == pytest.approx(0.5 * STORE * last**2, rel=1e-4)
    assert found.energy["harvested"] == pytest.approx(SUPPLY.power * wanted, rel=1e-4)
    lost = RESISTANCE * quad(lambda v: STORE * current(v), last, 6.0, epsabs=0)[0]
    assert found.energy["shunt_loss"] == pytest.approx(lost + drawn * 0.2 * wanted, rel=1e-4)


def test_without_a_resistance_it_is_the_limit_of_a_small_one():
    shunt = Rectifier(smoothing_capacitance=5e-6, initial_dc_voltage=4.0, storage=SUPPLY)
    without, small = (transient(dataclasses.replace(shunt, smoothing_resistance=r), 3.0, DRIVE) for r in (0.0, 1.0))
    assert small.harvested_power == pytest.approx(without.harvested_power, rel=1e-3)


@pytest.mark.parametrize("change", [{"turn_off": 4.4}, {"phases": (LoadPhase(power=0.05, duration=0.01, sends=True),)}])
def test_a_resistance_with_which_it_cannot_stay_on_is_refused(change):
    storage = dataclasses.replace(SUPPLY, **change)
    with pytest.raises(ParameterError) as caught:
        Rectifier(smoothing_capacitance=STORE, smoothing_resistance=RESISTANCE + 100.0, storage=storage)
    assert caught.value.key == "smoothing_resistance"
    assert is_sentence(caught.value.message)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("kind", [Rectifier, ParallelSSHI])
def test_a_resistance_in_series_against_ngspice(kind):
    loop = {"inductance": 0.1, "quality": 5.0} if kind is ParallelSSHI else {}
    shunt = kind(
        smoothing_capacitance=2e-6, initial_dc_voltage=4.0, smoothing_resistance=1500.0, diode_drop=0.3,
        storage=dataclasses.replace(SUPPLY, power=3e-4, max_voltage=8.0), **loop,
    )  # fmt: skip
    figures, trusted = compare(System(DEVICE, shunt), DRIVE)
    assert trusted
    for figure in figures:
        assert abs(figure.difference) < 0.01, figure
