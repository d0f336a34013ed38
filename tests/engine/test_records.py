"""Sampled drives: straight pieces between samples, in which a stiff stack rings many times."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import reference_device, reference_engine
from oracles.reference import simulate as reference
from scipy.linalg import expm
from studies import LOOP, STOPS, bench, distance, objects

from piezoharvest import Hysteresis, Record, Resistor, System, Transducer, simulate
from piezoharvest.description.effects import BiasCurrent
from piezoharvest.description.excitation import Ramps
from piezoharvest.engine.lowering.lower import lower
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.run import Machine
from piezoharvest.engine.steady_search import check

# A stack of 22 kHz under records of 1 kHz (Goldfarb & Celanovic, 1997).
STACK = {"mass": 0.0158, "damping": 1250.0, "stiffness": 3.125e8, "coupling": 7.822, "capacitance": 3.2e-6}
THREE = {"thresholds": [2e-6, 6e-6, 1.2e-5], "weights": [4e4, 3e4, 2e4]}
RATE = 1000.0
LOADS = (100.0, 2e3)
WAVES = {"drive": "force", "displacement": "x", "velocity": "u", "voltage": "v", "current": "i", "charge": "q"}


class Sampled(reference_device.Excitation):
    """First-order hold of samples for the oracle, which starts anew at every one."""

    def __init__(self, table):
        if table["kind"] != "samples":
            super().__init__(table)
            return
        self.kind, self.base, self.frequency, self.period = table["kind"], False, None, None
        self.values, self.rate = np.asarray(table["values"]), table["rate"]
        self.offset = float(self.values[0])
        self.times = np.arange(len(self.values)) / self.rate
        self.duration, self.breaks = float(self.times[-1]), self.times.tolist()
        self.size = float(np.abs(self.values).max())

    def piece(self, start, end):
        if self.kind != "samples":
            return super().piece(start, end)
        n = min(int(np.searchsorted(self.times, 0.5 * (start + end), side="right")), len(self.values) - 1) - 1
        slope = (self.values[n + 1] - self.values[n]) * self.rate
        return lambda t: float(self.values[n] + slope * (t - self.times[n]))


def rough(seed, samples=14, force=2000.0):
    """A few reversals with noise on every sample."""
    rng = np.random.default_rng(seed)
    slow = np.interp(np.arange(samples), np.linspace(0, samples - 1, 5), [0.0, 1.0, -0.8, 0.9, -0.3])
    return force * (slow + 0.15 * rng.normal(size=samples))


def record_of(values, folder, rate=RATE):
    """The record as users have it: a column of a file, to the last digit."""
    file = folder / "record.csv"
    file.write_text("force\n" + "\n".join(repr(float(value)) for value in values) + "\n", encoding="utf-8")
    return Record(file=str(file), column="force", sample_rate=rate)


def stack(load):
    hysteresis = Hysteresis(thresholds=tuple(THREE["thresholds"]), weights=tuple(THREE["weights"]))
    return System(Transducer(**STACK, hysteresis=hysteresis), Resistor(resistance=load))


def oracle(monkeypatch, values, load, times, **options):
    monkeypatch.setattr(reference_engine, "Excitation", Sampled)
    study = {
        "transducer": {**STACK, "hysteresis": THREE},
        "excitation": {"kind": "samples", "values": values, "rate": RATE},
        "shunts": [{"kind": "resistor", "resistance": load}],
    }
    return reference(study, 0, duration=(len(values) - 1) / RATE, times=times, **options)


def compare(waves, wanted, tolerance):
    for ours, theirs in WAVES.items():
        found, oracle_wave = waves[ours], getattr(wanted, theirs)
        size = np.abs(oracle_wave).max()
        error = np.abs(found - oracle_wave).max()
        assert error <= tolerance * size, f"{ours} off by {error / size:.1e}"


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_record_against_the_oracle(seed, load, tmp_path, monkeypatch):
    values = rough(seed)
    found = simulate(stack(load), record_of(values, tmp_path), samples=64)
    assert found.converged, found.message
    assert found.energy["closure"] < 1e-10
    wanted = oracle(monkeypatch, values, load, found.waveforms.time)
    compare({name: getattr(found.waveforms, name) for name in WAVES}, wanted, 1e-8)
    # Reversals of the charge by more than the thresholds: all operators slip both ways.
    slips = [name for _, name in wanted.events if name.endswith("_slips")]
    assert {f"stop_{j}_slips" for j in range(3)} == set(slips) and len(slips) >= 5
    assert found.waveforms.event_names.count("hysteresis slips") == len(slips)
    assert found.energy["hysteresis"] == pytest.approx(wanted.energy["hysteresis"], rel=1e-8)
    assert found.energy["harvested"] == pytest.approx(wanted.energy["harvested"], rel=1e-8)


def test_record_against_an_implicit_oracle(tmp_path, monkeypatch):
    """Radau, whose errors are of another kind."""
    values = rough(2, samples=5)
    found = simulate(stack(LOADS[0]), record_of(values, tmp_path), samples=16)
    wanted = oracle(monkeypatch, values, LOADS[0], found.waveforms.time, method="Radau", rtol=1e-9)
    compare({name: getattr(found.waveforms, name) for name in WAVES}, wanted, 1e-5)


@pytest.mark.parametrize("load", LOADS)
def test_machine_sampled_at_the_record_s_own_times(load, tmp_path, monkeypatch):
    values = rough(3)
    times = np.arange(len(values)) / RATE
    lowered = lower(stack(load), record_of(values, tmp_path))
    machine = Machine(lowered)
    state = machine.state(sample_time=times)
    check(machine.run(state, times[-1]))
    wanted = oracle(monkeypatch, values, load, times)
    compare({name: state.samples[:, pg.OUTPUTS.index(name)] for name in WAVES}, wanted, 1e-8)
    # In several runs, that end within pieces.
    pieces = machine.state(sample_time=times)
    for end in (*np.sort(np.random.default_rng(0).uniform(0, times[-1], 9)), times[-1]):
        check(machine.run(pieces, end))
    size = np.abs(state.samples).max(axis=0)
    # The acceleration is a small difference of the forces on the mass.
    size[pg.OUTPUTS.index("acceleration")] *= 1e2
    assert np.all(np.abs(pieces.samples - state.samples).max(axis=0) <= 1e-10 * size)


def cut(signal, pieces, rng):
    """The same signal, every straight piece in several of unequal length."""
    times, starts, slopes = [], [], []
    for begin, end, start, slope in zip(signal.times, signal.times[1:], signal.starts, signal.slopes, strict=False):
        inner = np.sort(rng.uniform(0.02, 0.98, pieces - 1)) * (end - begin)
        for offset in (0.0, *inner):
            times.append(begin + offset)
            starts.append(start + slope * offset)
            slopes.append(slope)
    return Ramps(np.array([*times, signal.times[-1]]), np.array(starts), np.array(slopes))


def sizes(transducer, force):
    """What a force makes of every output at least, so that zero by nature need be zero to rounding only."""
    static = force / transducer.stiffness
    rate = np.sqrt(transducer.stiffness / transducer.mass)
    charge = abs(transducer.coupling) * static
    voltage = charge / transducer.capacitance
    known = {
        "drive": force, "displacement": static, "velocity": rate * static, "current": rate * charge, "charge": charge,
        "acceleration": 1e5 * rate**2 * static,  # a small difference of the forces on the mass
    }  # fmt: skip
    return np.array([known.get(name, voltage) for name in pg.OUTPUTS])


def check_cut(system, excitation, rng, tolerance=1e-9):
    """Samples, extremes and energies do not depend on how the straight pieces are cut."""
    lowered = lower(system, excitation)
    assert isinstance(lowered.signal, Ramps)
    end = float(lowered.signal.times[-1])
    times, outcomes = np.linspace(0.0, end, 301), []
    for signal in (lowered.signal, cut(lowered.signal, 7, rng)):
        machine = Machine(lowered._replace(signal=signal), ledger=True)
        state = machine.state(sample_time=times, track=True)
        check(machine.run(state, end))
        outcomes.append((state.samples.copy(), state.extremes.T.copy(), state.energy.copy()))
    force = np.abs(excitation.values).max()
    small = 1e-3 * sizes(system.transducer, force)
    watched = small[[pg.OUTPUTS.index("displacement"), pg.OUTPUTS.index("voltage")]]
    work = force * watched[0]
    for wanted, found, floor in zip(*outcomes, (small, watched, work), strict=True):
        assert np.all(np.abs(found - wanted) <= tolerance * np.maximum(np.abs(wanted).max(axis=0), floor))


@settings(max_examples=40, deadline=None)
@given(
    values=st.lists(st.floats(-3000, 3000).map(lambda value: round(value, 6)), min_size=3, max_size=25),
    load=st.sampled_from([10.0, 100.0, 2e3, 1e6]),
    seed=st.integers(0, 10**6),
)
def test_cutting_the_pieces_changes_nothing_for_the_stack(tmp_path_factory, values, load, seed):
    record = record_of(values, tmp_path_factory.mktemp("records"))
    check_cut(stack(load), record, np.random.default_rng(seed))


SHUNTS = {
    "resistor": {"kind": "resistor", "resistance": 8e4},
    "rectifier": {"kind": "rectifier", "smoothing_capacitance": 1e-7, "load_resistance": 1e5, "diode_drop": 0.2},
    "parallel_sshi": {"kind": "parallel_sshi", "smoothing_capacitance": 1e-7, "load_resistance": 1e5, **LOOP},
    "series_sshi": {"kind": "series_sshi", "smoothing_capacitance": 1e-7, "load_resistance": 1e5, **LOOP},
    "sece": {"kind": "sece", "hold_off": 2e-3},
}


@settings(max_examples=30, deadline=None)
@given(kind=st.sampled_from(sorted(SHUNTS)), seed=st.integers(0, 10**6), hysteretic=st.booleans())
def test_cutting_the_pieces_changes_nothing_for_any_shunt(tmp_path_factory, kind, seed, hysteretic):
    rng = np.random.default_rng(seed)
    values = 0.1 * rng.normal(size=60).cumsum()
    record = record_of(values, tmp_path_factory.mktemp("records"), rate=500.0)
    system, _ = objects(bench(SHUNTS[kind], hysteresis=STOPS) if hysteretic else bench(SHUNTS[kind]))
    check_cut(system, record, rng, 1e-8)


def test_a_record_that_is_constant_keeps_the_equilibrium(tmp_path):
    found = simulate(stack(LOADS[0]), record_of([500.0] * 20, tmp_path))
    static = 500.0 / STACK["stiffness"]
    assert distance(found.waveforms.displacement, np.full(len(found.waveforms.time), static)) < 1e-12
    assert np.abs(found.waveforms.voltage).max() < 1e-12 * STACK["coupling"] * static / STACK["capacitance"]


def tables_of(machine, slot):
    """Matrix, guards and bounds of the deviation of a mode, and its longest step, as the engine holds them."""
    L, P = machine.L, machine.P
    rows, columns, forms, block = L[pg.ROWS], L[pg.COLUMNS], L[tb.FORMS], L[tb.TABLES] + slot * L[tb.BLOCK]

    def matrix(place, height):
        return P[block + L[place] :][: height * columns].reshape(columns, height).T

    return matrix(tb.MATRIX, rows), matrix(tb.VALUES, forms), matrix(tb.DEVIATION, forms), P[block + L[tb.STEPS]]


@pytest.mark.parametrize("load", LOADS)
def test_bound_of_the_deviation_within_a_step(load, tmp_path):
    """Between two samples a guard stays as close to a line as the bound says, ringing or held by a large force."""
    machine = Machine(lower(stack(load), record_of(rough(3), tmp_path)))
    state = machine.state()
    check(machine.run(state, 13 / RATE))
    rng, a = np.random.default_rng(1), machine.L[pg.A]
    assert machine.L[tb.CLAMPED] > 2
    for slot in range(machine.L[tb.CLAMPED]):
        matrix, values, deviation, step = tables_of(machine, slot)
        shares = np.linspace(0, 1, 401)
        flow = expm(matrix * step / 400)
        ringing = rng.normal(size=(20, len(matrix))) * (np.arange(len(matrix)) < a)
        # Of a motion that the structure only follows, what rings is taken away.
        calm = [vector - np.linalg.pinv(matrix @ matrix, rcond=1e-9) @ matrix @ matrix @ vector for vector in ringing]
        for z in (*ringing, *calm):
            states = [z]
            for _ in shares[1:]:
                states.append(flow @ states[-1])
            waves = np.array(states) @ values.T
            line = waves[0] + shares[:, None] * (waves[-1] - waves[0])
            rounding = 1e-11 * np.abs(values) @ np.abs(states).max(axis=0)
            assert np.all(np.abs(waves - line).max(axis=0) <= deviation @ np.abs(matrix @ matrix @ z) + rounding)


def test_tables_of_digits(tmp_path):
    """What a digit in a place of a number of finest steps does is the exponential of so many of them."""
    machine = Machine(lower(stack(LOADS[0]), record_of(rough(3), tmp_path)))
    check(machine.run(machine.state(), 13 / RATE))
    L, P = machine.L, machine.P
    rows, columns = L[pg.ROWS], L[pg.COLUMNS]
    for slot in range(L[tb.CLAMPED]):
        block, finest = L[tb.TABLES] + slot * L[tb.BLOCK], L[L[tb.SLOTS] + slot * L[tb.SLOT] + tb.FINEST_LEVEL]
        matrix, short = tables_of(machine, slot)[0], P[block + L[tb.STEPS] + finest]
        assert finest > 2 * tb.DIGIT_BITS
        for count in range(1, 2**finest + 1):
            place = 0 if count <= tb.LARGEST else (count.bit_length() - 1) // tb.DIGIT_BITS
            digit, rest = divmod(count, 2 ** (tb.DIGIT_BITS * place))
            if rest:
                continue
            at = block + L[tb.DIGITS] + (tb.LARGEST * place + digit - 1) * rows * columns
            found, wanted = P[at : at + rows * columns].reshape(columns, rows).T, expm(matrix * count * short)
            assert np.abs(found + np.eye(rows) - wanted).max() <= 1e-11 * np.abs(wanted).max()


def test_constant_is_carried_only_where_something_is_constant(tmp_path):
    """And a constant too small to matter gives what the smaller matrices give."""
    record, bare = record_of(rough(0), tmp_path), stack(100.0)
    biased = replace(bare, transducer=replace(bare.transducer, effects=(BiasCurrent(current=1e-18),)))
    without, carried = (lower(system, record).program.rate for system in (bare, biased))
    assert without.shape[-1] == without.shape[-2] + 2
    assert carried.shape[-1] == carried.shape[-2] + 3
    first, second = (simulate(system, record) for system in (bare, biased))
    assert first.events_per_period == second.events_per_period
    for name in WAVES:
        found, wanted = getattr(first.waveforms, name), getattr(second.waveforms, name)
        assert np.abs(found - wanted).max() <= 1e-9 * np.abs(wanted).max()
