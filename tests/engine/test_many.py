"""Many designs in one call against one design a call."""

import numpy as np
import pytest
from studies import BENCH, STOPS

from piezoharvest import (
    SECE,
    SSDI,
    Hysteresis,
    Leakage,
    Mode,
    ParallelSSHI,
    Rectifier,
    Resistor,
    SeriesSSHI,
    Short,
    SineBase,
    SineForce,
    StepForce,
    System,
    Transducer,
    simulate,
    simulate_many,
)
from piezoharvest.engine.batch import NAMES, one_of
from piezoharvest.engine.entry_point import engine

DESIGNS = 12
FORCE = SineForce(amplitude=0.02, frequency=50.6)


def spread(rng, centre, share=0.3, designs=DESIGNS):
    """Values about a centre, one for each design."""
    return centre * rng.uniform(1 - share, 1 + share, (designs, 1))


def device(rng, **further):
    """A transducer of which every quantity differs from design to design."""
    return Transducer(**{name: spread(rng, value, 0.05) for name, value in BENCH.items()}, **further)


def shunts(rng):
    smooth = {"smoothing_capacitance": spread(rng, 1e-6, 0.9), "load_resistance": spread(rng, 2e5, 0.9)}
    coil = {"inductance": spread(rng, 0.1), "quality": spread(rng, 5.0)}
    return {
        "resistor": Resistor(resistance=spread(rng, 8e4, 0.9)),
        "rectifier": Rectifier(**smooth, diode_drop=spread(rng, 0.3)),
        "rectifier dc": Rectifier(dc_voltage=spread(rng, 3.0)),
        "parallel_sshi": ParallelSSHI(**smooth, **coil, phase_lag=spread(rng, 0.1), on_time_error=spread(rng, 0.1)),
        "series_sshi": SeriesSSHI(**smooth, **coil, diode_drop=spread(rng, 0.1)),
        "sece": SECE(efficiency=spread(rng, 0.7), diode_drop=spread(rng, 0.1), phase_lag=spread(rng, 0.0) - 0.1),
        "ssdi": SSDI(**coil, time_lag=spread(rng, 1e-4)),
    }


KINDS = tuple(shunts(np.random.default_rng(0)))


def thresholds(rng):
    return Hysteresis(
        thresholds=tuple(spread(rng, r, 0.4) for r in STOPS["thresholds"]),
        weights=tuple(spread(rng, w) for w in STOPS["weights"]),
    )


def check(system, excitation, designs=DESIGNS, relative=1e-8):
    """Every column of every design is that of `simulate`; returns the columns."""
    found = simulate_many(system, excitation, designs)
    assert all(np.shape(column) == (designs,) for column in found.values())
    for n in range(designs):
        wanted = simulate(one_of(system, n), one_of(excitation, n), samples=1)
        assert bool(found["converged"][n]) == wanted.converged, wanted.message
        power = max(abs(wanted.mechanical_power), 1e-300)
        floors = {"harvested_power": 1e-6 * power, "efficiency": 1e-6}
        for name in NAMES:
            value = getattr(wanted, name)
            tolerance = relative * max(abs(value), floors.get(name, 1e-9))
            same = np.isnan(value) and np.isnan(found[name][n])  # a figure of merit that two modes have not
            assert same or abs(found[name][n] - value) <= tolerance, (
                f"{name} of design {n}: {found[name][n]}, alone {value}"
            )
        for name, energy in wanted.energy.items():
            if name != "closure":
                error = abs(found[f"energy.{name}"][n] - energy)
                assert error <= relative * max(abs(energy), wanted.energy["mechanical_in"]), name
        assert found["closure"][n] <= 1e-8
    return found


@pytest.mark.parametrize("hysteretic", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_design_by_design(kind, hysteretic):
    """Transducer, hysteresis, excitation and shunt all differ."""
    rng = np.random.default_rng(sum(map(ord, kind)) + hysteretic)
    hysteresis = thresholds(rng) if hysteretic else None
    excitation = SineForce(amplitude=spread(rng, 0.02), frequency=spread(rng, 50.6, 0.02))
    found = check(System(device(rng, hysteresis=hysteresis), shunts(rng)[kind]), excitation)
    assert found["converged"].sum() >= DESIGNS - 1
    assert len(set(found["mechanical_power"])) == DESIGNS


@pytest.mark.parametrize("kind", KINDS)
def test_two_modes_with_effects_on_a_moving_base(kind):
    rng = np.random.default_rng(7)
    second = Mode(mass=0.01, damping=0.6, stiffness=spread(rng, 8e3), coupling=5e-4, force_participation=0.7)
    tr = device(rng, modes=(second,), effects=(Leakage(resistance=spread(rng, 1e8)),), effective_mass=0.013)
    excitation = SineBase(amplitude=spread(rng, 2.0), frequency=50.6, offset=spread(rng, 0.2))
    check(System(tr, shunts(rng)[kind]), excitation)


def test_designs_that_only_differ_in_the_shunt():
    found = check(System(Transducer(**BENCH), Resistor(resistance=np.logspace(2, 7, 9)[:, None])), FORCE, 9)
    # A shunt in which almost nothing flows or drops does not damp.
    assert abs(found["attenuation_db"][0]) < 0.1
    assert found["harvested_power"].argmax() not in (0, 8)


def test_attenuation_is_left_out_where_it_is_not_wanted():
    system = System(Transducer(**BENCH), Resistor(resistance=np.array([[1e4], [1e5]])))
    found = simulate_many(system, FORCE, 2, attenuation=False)
    assert "attenuation_db" not in found


def test_designs_that_do_not_differ():
    """A batch in which no quantity is an array: all designs alike, in the memory layout of all others."""
    system = System(Transducer(**BENCH), Resistor(resistance=1e5))
    found = check(system, FORCE, 3)
    assert len(set(found["harvested_power"])) == 1
    shorted = simulate_many(System(system.transducer, Short()), FORCE, 2)
    assert np.all(np.abs(shorted["attenuation_db"]) < 1e-9)


def test_designs_that_do_not_settle_are_flagged_and_filled():
    """Some designs wander for ever: `simulate` averages over a long run of them, and so must the batch."""
    lag = np.array([[-0.3], [0.0], [-0.3], [0.1]])
    quality = np.array([[42.0], [6.0], [42.0], [6.0]])
    system = System(Transducer(**BENCH), SSDI(inductance=0.01, quality=quality, phase_lag=lag))
    found = simulate_many(system, FORCE, 4)
    assert found["converged"].tolist() == [False, True, False, True]
    for n in range(4):
        wanted = simulate(one_of(system, n), FORCE, samples=1)
        for name in ("mechanical_power", "displacement_amplitude", "voltage_amplitude", "attenuation_db"):
            assert found[name][n] == pytest.approx(getattr(wanted, name), rel=1e-6), name
    # Its neighbours are not affected by a design that fails.
    alone = simulate_many(one_of(system, 1), FORCE, 1)
    assert alone["mechanical_power"][0] == pytest.approx(found["mechanical_power"][1], rel=1e-12)


def test_excitation_without_a_period():
    step = StepForce(amplitude=0.1, duration=0.1)
    system = System(Transducer(**BENCH), Resistor(resistance=np.array([[1e4], [1e5], [1e6]])))
    found = simulate_many(system, step, 3)
    assert found["converged"].all()
    for n in range(3):
        wanted = simulate(one_of(system, n), step, samples=1)
        assert found["harvested_power"][n] == wanted.harvested_power
        assert found["energy.stored"][n] == wanted.energy["stored"]


@pytest.mark.parametrize("kind", KINDS)
def test_batch_of_one(kind):
    rng = np.random.default_rng(3)
    system = one_of(System(device(rng, hysteresis=thresholds(rng)), shunts(rng)[kind]), 0)
    check(system, FORCE, 1)
    # Quantities as arrays of one design are the same.
    shunt = ParallelSSHI(inductance=np.array([[0.1]]), quality=5.0, smoothing_capacitance=1e-6, load_resistance=1e5)
    check(System(system.transducer, shunt), FORCE, 1)


def test_order_does_not_matter():
    """Nothing is carried over from one design to the next: tables, events, states."""
    rng = np.random.default_rng(11)
    system = System(device(rng, hysteresis=thresholds(rng)), shunts(rng)["parallel_sshi"])
    order = rng.permutation(DESIGNS)

    def reordered(part):
        picked = [one_of(part, n) for n in order]
        tr = {name: np.array([[getattr(p.transducer, name)] for p in picked]) for name in BENCH}
        stops = [p.transducer.hysteresis for p in picked]
        by = {
            name: tuple(np.array([[getattr(stop, name)[j]] for stop in stops]) for j in range(2))
            for name in ("thresholds", "weights")
        }
        names = ("smoothing_capacitance", "load_resistance", "inductance", "quality", "phase_lag", "on_time_error")
        shunt = {name: np.array([[getattr(p.shunt, name)] for p in picked]) for name in names}
        return System(Transducer(**tr, hysteresis=Hysteresis(**by)), ParallelSSHI(**shunt))

    first, second = simulate_many(system, FORCE, DESIGNS), simulate_many(reordered(system), FORCE, DESIGNS)
    for name in ("harvested_power", "displacement_amplitude", "periods_evaluated", "events_per_period"):
        assert np.array_equal(first[name][order], second[name], equal_nan=True), name


def test_compiled_once_for_all():
    """Whatever is simulated, the one entry into compiled code has one signature."""
    simulate(System(Transducer(**BENCH)), FORCE)
    before = list(engine.signatures)
    assert len(before) == 1
    rng = np.random.default_rng(5)
    for kind, shunt in shunts(rng).items():
        simulate_many(System(device(rng, hysteresis=thresholds(rng)), shunt), FORCE, DESIGNS)
        simulate(one_of(System(device(rng), shunt), 0), FORCE)
        simulate(one_of(System(device(rng), shunt), 0), FORCE, transient=0.1)
        if kind == "resistor":
            simulate(one_of(System(device(rng), shunt), 0), StepForce(amplitude=0.1, duration=0.1))
    assert engine.signatures == before
