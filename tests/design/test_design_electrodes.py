"""Designs with shunts at several pairs of electrodes, and at further ones, against equations written down here."""

import dataclasses
import json

import numpy as np
import pytest
from messages import is_sentence
from scipy.optimize import minimize

from piezoharvest.cli import main
from piezoharvest.description.excitation import SineBase, SineForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import ParallelSSHI, Resistor, SeriesRL
from piezoharvest.description.system import System
from piezoharvest.description.tolerance import Tolerance
from piezoharvest.description.transducer import Electrode, Mode, Transducer
from piezoharvest.design.bound.several import most_power
from piezoharvest.engine import simulate

FORCE = 0.02
MASS, DAMPING, STIFFNESS = np.diag([0.01, 0.01]), np.diag([0.0628, 0.1]), np.diag([986.96, 4000.0])
COUPLING, CAPACITANCE = np.array([[1e-3, -4e-4], [3e-4, 1.2e-3]]), np.array([40e-9, 30e-9])
SHARES = np.array([1.0, 0.7])  # of the force and of the displacement that is read
TWO = Transducer(
    mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9,
    modes=(Mode(mass=0.01, damping=0.1, stiffness=4000.0, coupling=-4e-4, force_participation=0.7),),
    electrodes=(Electrode(capacitance=30e-9, coupling=(3e-4, 1.2e-3)),),
)  # fmt: skip
RL = {"inductance": 200.0, "resistance": 2e4}
BOTH = SeriesRL(**RL, others=(SeriesRL(**RL, electrode=1),))


def phasors(frequencies, impedances):
    """Displacement (f,) and electrode voltages (f, 2) for 1 N, with an impedance (f, 2) at each pair of electrodes."""
    s = 2j * np.pi * np.asarray(frequencies)[:, None, None]
    mechanics = STIFFNESS + s * DAMPING + s**2 * MASS
    top = np.concatenate((mechanics, np.broadcast_to(-COUPLING.T, mechanics.shape)), axis=-1)
    loads = s * np.diag(CAPACITANCE) + np.eye(2) / np.asarray(impedances)[:, :, None]
    matrix = np.concatenate((top, np.concatenate((s * COUPLING, loads), axis=-1)), axis=-2)
    force = np.broadcast_to([*SHARES, 0.0, 0.0], (len(matrix), 4))[..., None]
    found = np.linalg.solve(matrix, force)[..., 0]
    return found[:, :2] @ SHARES, found[:, 2:]


def coils(values, frequencies):
    """Impedances (f, 2) of two coils with resistances, from the logarithms of L0, R0, L1, R1."""
    one, two = np.exp(values[:2]), np.exp(values[2:])
    omega = 2 * np.pi * np.asarray(frequencies)
    return np.column_stack([resistance + 1j * omega * inductance for inductance, resistance in (one, two)])


def values_of(shunt):
    return np.log([each for one in (shunt, *shunt.others) for each in (one.inductance, one.resistance)])


@pytest.mark.slow
def test_both_coils_are_tuned_for_the_least_peak(run):
    """As good as the best of many searches by a simplex from random values, and each figure as these equations say."""
    band = (40.0, 120.0)
    found = run(TWO, shunts=(BOTH,), objective="damping", band=band, candidates=("series_rl",)).best
    grid = np.linspace(*band, 4001)

    def peak(values):
        return np.log(np.max(np.abs(phasors(grid, coils(values, grid))[0])))

    random = np.random.default_rng(1)
    starts = [values_of(BOTH) + random.uniform(-1.5, 1.5, 4) for _ in range(6)]
    options = {"maxfev": 600, "xatol": 1e-4, "fatol": 1e-7}
    best = min((minimize(peak, start, method="Nelder-Mead", options=options) for start in starts), key=lambda r: r.fun)
    mine = peak(values_of(found.shunt))
    assert mine <= best.fun + 1e-4
    assert found.displacement_amplitude == pytest.approx(FORCE * np.exp(mine), rel=1e-4)
    assert found.gap_to_bound is None
    alone = run(TWO, shunts=(SeriesRL(**RL),), objective="damping", band=band, candidates=("series_rl",)).best
    assert found.displacement_amplitude < alone.displacement_amplitude


def test_the_sum_of_both_loads_is_what_is_harvested(run):
    frequency = 75.0
    found = run(TWO, frequency, shunts=(BOTH,), candidates=("series_rl",))
    best = found.best
    impedances = coils(values_of(best.shunt), [frequency])
    voltages = FORCE * phasors([frequency], impedances)[1]
    wanted = 0.5 * np.sum(np.real(impedances) * np.abs(voltages / impedances) ** 2)
    assert best.harvested_power == pytest.approx(wanted, rel=1e-6)
    assert best.response.harvested_power == pytest.approx(wanted, rel=1e-6)
    # No two coils of this quality draw more, by a search over all of them.
    assert wanted == pytest.approx(most_by_search(frequency), rel=1e-4)
    assert wanted <= found.bound.harvested_power * (1 + 1e-9)


def most_by_search(frequency):
    """Power into two coils of quality 100 with resistances, by a simplex search from random values."""

    def lost(logs):
        reactance = np.exp(logs[2:])
        loads = np.exp(logs[:2]) + reactance * (0.01 + 1j)
        voltages = FORCE * phasors([frequency], [loads])[1][0]
        return -1e6 * 0.5 * np.sum(np.real(loads) * np.abs(voltages / loads) ** 2)

    random = np.random.default_rng(2)
    starts = [random.uniform(7, 13, 4) for _ in range(12)]
    options = {"maxfev": 4000, "xatol": 1e-7, "fatol": 1e-10}
    return -min(minimize(lost, start, method="Nelder-Mead", options=options).fun for start in starts) / 1e6


@pytest.mark.parametrize("frequency", [30.0, 51.0, 75.0, 101.0])
def test_bound_is_the_match_of_a_multi_port(frequency):
    """v^H (Re Z)^-1 v/8, with the impedance matrix of both pairs and their open-circuit voltages."""
    omega = 2 * np.pi * frequency
    mobile = np.linalg.inv(STIFFNESS + 1j * omega * DAMPING - omega**2 * MASS + np.zeros((2, 2)))
    admittance = 1j * omega * (np.diag(CAPACITANCE) + COUPLING @ mobile @ COUPLING.T)
    voltage = -np.linalg.solve(admittance, 1j * omega * COUPLING @ mobile @ SHARES)
    resistance = np.real(np.linalg.inv(admittance))
    wanted = np.real(voltage.conj() @ np.linalg.solve(resistance, voltage)) / 8
    assert most_power(TWO, np.array([omega]), False, (0, 1))[0] == pytest.approx(wanted, rel=1e-6)
    # With as many pairs as modes all that the dampers let pass: sum f^2/(8 b).
    assert wanted == pytest.approx(np.sum(SHARES**2 / np.diag(DAMPING)) / 8, rel=1e-6)


def test_bound_at_one_of_the_pairs_is_that_of_a_design_there(run):
    found = run(TWO, 101.0, shunts=(SeriesRL(**RL, electrode=1),), candidates=("series_rl",))
    alone = FORCE**2 * most_power(TWO, 2 * np.pi * np.array([101.0]), False, (1,))[0]
    assert found.bound.harvested_power == pytest.approx(alone, rel=1e-9)
    assert found.best.harvested_power == pytest.approx(alone, rel=1e-6)
    assert found.best.shunt.electrode == 1
    again = simulate(System(TWO, found.best.shunt), SineForce(amplitude=FORCE, frequency=101.0))
    assert again.harvested_power == pytest.approx(found.best.harvested_power, rel=1e-9)
    assert again.attenuation_db == pytest.approx(found.best.attenuation_db, rel=1e-6)


def test_bound_with_base_excitation_and_more_pairs_than_modes():
    three = dataclasses.replace(TWO, electrodes=(*TWO.electrodes, Electrode(capacitance=1e-8, coupling=(2e-4, 5e-4))))
    wanted = 0.01**2 * np.sum(1 / np.diag(DAMPING)) / 8
    found = most_power(three, 2 * np.pi * np.array([20.0, 60.0]), True, (0, 1, 2))
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_kinds_without_a_table_are_where_the_first_shunt_is(run):
    found = run(TWO, 60.0, shunts=(BOTH,), candidates=("resistor", "rectifier"))
    assert {each.shunt.kind for each in found.candidates} == {"resistor", "rectifier"}
    assert all(each.shunt.taken == (0, 1) for each in found.candidates)
    assert all(0 < each.harvested_power <= found.bound.any_interface for each in found.candidates)


def test_a_bridge_beside_a_coil_is_tuned_with_it(run):
    """The load, and the coil at the other electrodes: no step of 10 % of either gives more."""
    template = ParallelSSHI(
        load_resistance=2e5, smoothing_capacitance=1e-5, inductance=0.1, quality=5.0,
        others=(Resistor(resistance=1e5, electrode=1),),
    )  # fmt: skip
    options = {"candidates": ("parallel_sshi",), "phase_lag": "fixed"}
    best = run(TWO, 60.0, shunts=(template,), **options).best
    drive = SineForce(amplitude=FORCE, frequency=60.0)
    (other,) = best.shunt.others
    assert other.resistance != 1e5
    for factor in (0.9, 1.1):
        moved = (
            dataclasses.replace(best.shunt, load_resistance=best.shunt.load_resistance * factor),
            dataclasses.replace(
                best.shunt, others=(dataclasses.replace(other, resistance=other.resistance * factor),)
            ),
        )  # fmt: skip
        for shunt in moved:
            power = simulate(System(TWO, shunt), drive, attenuation=False).harvested_power
            assert power < best.harvested_power * (1 + 1e-6)


def test_a_bridge_at_further_electrodes_is_that_of_the_structure_seen_from_there(run):
    """The same plate with its pairs of electrodes listed in the other order has the same best load and lag."""
    other_order = Transducer(
        mass=0.01, damping=0.0628, stiffness=986.96, coupling=3e-4, capacitance=30e-9,
        modes=(Mode(mass=0.01, damping=0.1, stiffness=4000.0, coupling=1.2e-3, force_participation=0.7),),
        electrodes=(Electrode(capacitance=40e-9, coupling=(1e-3, -4e-4)),),
    )  # fmt: skip
    keys = {"load_resistance": 2e5, "smoothing_capacitance": 1e-5, "inductance": 0.1, "quality": 5.0}
    one = run(TWO, 101.0, shunts=(ParallelSSHI(**keys, electrode=1),), candidates=("parallel_sshi",))
    two = run(other_order, 101.0, shunts=(ParallelSSHI(**keys),), candidates=("parallel_sshi",))
    assert one.best.shunt.electrode == 1
    assert one.best.shunt.load_resistance == pytest.approx(two.best.shunt.load_resistance, rel=1e-6)
    assert one.best.harvested_power == pytest.approx(two.best.harvested_power, rel=1e-9)
    assert one.bound.harvested_power == pytest.approx(two.bound.harvested_power, rel=1e-9)


def test_parts_of_a_series_at_each(run):
    found = run(TWO, 75.0, shunts=(BOTH,), candidates=("series_rl",), parts="E12").best
    e12 = [1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3, 3.9, 4.7, 5.6, 6.8, 8.2]
    for value in np.exp(values_of(found.shunt)):
        mantissa = value / 10 ** np.floor(np.log10(value) + 1e-9)
        assert np.min(np.abs(np.array(e12) - mantissa)) < 1e-6
    assert set(found.parts.values) == {"inductance", "resistance", "others.0.inductance", "others.0.resistance"}


@pytest.mark.slow
def test_front_between_power_and_damping(run):
    found = run(TWO, 51.0, shunts=(BOTH,), candidates=("series_rl",), objective="trade_off")
    first, last = found.trade_off[0], found.trade_off[-1]
    assert first.harvested_power > last.harvested_power
    assert first.attenuation_db > last.attenuation_db
    for point in (first, last):
        impedances = coils(values_of(point.shunt), [51.0])
        voltages = FORCE * phasors([51.0], impedances)[1]
        power = 0.5 * np.sum(np.real(impedances) * np.abs(voltages / impedances) ** 2)
        assert point.harvested_power == pytest.approx(power, rel=1e-5)


def test_base_acceleration(run):
    drive = SineBase(amplitude=1.0, frequency=60.0)
    found = run(TWO, excitation=drive, shunts=(BOTH,), candidates=("resistor",)).best
    again = simulate(System(TWO, found.shunt), drive)
    assert found.harvested_power == pytest.approx(again.harvested_power, rel=1e-6)


@pytest.mark.parametrize(
    "changes, options, key",
    [
        ({"hysteresis": True}, {}, "shunts.0.electrode"),
        ({}, {"tolerance": Tolerance(stiffness=0.05)}, "shunts.0.electrode"),
    ],
)
def test_where_a_design_cannot_be(run, changes, options, key):
    from piezoharvest.description.hysteresis import Hysteresis

    own = {"hysteresis": Hysteresis(thresholds=(1e-7,), weights=(5e5,))} if changes else {}
    with pytest.raises(ParameterError) as caught:
        run(
            dataclasses.replace(TWO, **own), shunts=(SeriesRL(**RL, electrode=1),), candidates=("series_rl",), **options
        )
    assert caught.value.key == key
    assert is_sentence(caught.value.message)


def test_one_free_frequency_for_both(tmp_path, capsys):
    """The frequency of the drive that is best with both loads tuned is where they draw most, by these equations."""
    (tmp_path / "study.toml").write_text(STUDY)
    assert main(["design", str(tmp_path / "study.toml"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    (best,) = found["candidates"]
    assert best["shunt"]["others"][0]["kind"] == "resistor"
    loads = np.array([[best["shunt"]["resistance"], best["shunt"]["others"][0]["resistance"]]])

    def power(frequency, loads):
        voltages = FORCE * phasors([frequency], loads)[1]
        return 0.5 * float(np.sum(np.abs(voltages) ** 2 / loads))

    assert best["harvested_power"] == pytest.approx(power(best["frequency"], loads), rel=1e-6)
    for frequency in np.linspace(45.0, 58.0, 27):
        most = -minimize(
            lambda logs, f=frequency: -1e6 * power(f, np.exp(logs)[None]), np.log(loads[0]), method="Nelder-Mead"
        ).fun
        assert most * 1e-6 <= best["harvested_power"] * (1 + 1e-4)
    assert found["bound"]["harvested_power"] is None


STUDY = """
[transducer]
mass = 0.010
damping = 0.0628
stiffness = 986.96
coupling = 1.0e-3
capacitance = 40e-9
[[transducer.modes]]
mass = 0.010
damping = 0.1
stiffness = 4000.0
coupling = -4e-4
force_participation = 0.7
[[transducer.electrodes]]
capacitance = 30e-9
coupling = [3e-4, 1.2e-3]
[excitation]
kind = "sine_force"
amplitude = 0.02
frequency = "free"
[design]
band = [45.0, 58.0]
candidates = ["resistor"]
[[shunts]]
kind = "resistor"
resistance = 1e5
[[shunts.others]]
kind = "resistor"
electrode = 1
resistance = 1e5
"""
