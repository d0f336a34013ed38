"""The lag of switches as a design variable: against grids that know nothing of the search, and figures of one."""

import dataclasses

import numpy as np
import pytest

from piezoharvest.description.excitation import SineForce
from piezoharvest.description.shunts import SECE, SSDI, ParallelSSHI
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.design.tuning.phase import zoom
from piezoharvest.design.tuning.region import Region
from piezoharvest.engine import simulate, simulate_many

# The transducer of designs/bench-rectifier-or-sshi.
BENCH = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
BAND = (48.0, 53.0)
FORCE = 0.02


def power(shunt, frequencies):
    """Powers of a batch of shunts, or of one, at frequencies (n,)."""
    sines = SineForce(amplitude=FORCE, frequency=np.reshape(frequencies, (-1, 1)))
    found = simulate_many(System(BENCH, shunt), sines, np.size(frequencies), attenuation=False)
    assert np.all(found["converged"])
    return found["harvested_power"]


def grid(shunt, frequency, loads, lags):
    """The largest power on a grid of loads and lags, with the smoothing's time constant kept."""
    load, lag = (x.reshape(-1, 1) for x in np.meshgrid(loads, lags))
    keys = {"phase_lag": lag}
    if shunt.kind != "sece":
        smoothing = shunt.smoothing_capacitance * shunt.load_resistance / load
        keys |= {"load_resistance": load, "smoothing_capacitance": smoothing}
    return power(dataclasses.replace(shunt, **keys), np.full(len(lag), frequency)).max()


@pytest.mark.parametrize(("kind", "least"), [("parallel_sshi", 513e-6), ("sece", 462e-6)])
def test_schedule_over_a_band(run, kind, least):
    """At least the mean that a grid outside of the project gives, and no grid point better at any frequency."""
    best = run(BENCH, 50.3, band=BAND, candidates=(kind,)).best
    assert best.converged and best.scheduled_power > least * (1 - 2e-3)
    assert best.scheduled_power > best.harvested_power
    frequencies = np.array([row["frequency"] for row in best.schedule])
    assert np.all((frequencies > BAND[0]) & (frequencies < BAND[1]) & (np.diff(frequencies, prepend=0) > 0))
    for row in best.schedule[1::6]:
        keys = {key: value for key, value in row.items() if key not in ("frequency", "harvested_power")}
        if kind != "sece":
            smoothing = best.shunt.smoothing_capacitance * best.shunt.load_resistance / row["load_resistance"]
            keys["smoothing_capacitance"] = smoothing
        again = simulate(
            System(BENCH, dataclasses.replace(best.shunt, **keys)),
            SineForce(amplitude=FORCE, frequency=row["frequency"]),
        )
        assert row["harvested_power"] == pytest.approx(again.harvested_power, rel=1e-6)
        loads = np.geomspace(3e4, 2e6, 12) if kind != "sece" else [1.0]
        found = grid(best.shunt, row["frequency"], loads, np.linspace(-1.5, 1.5, 13 if kind != "sece" else 150))
        assert row["harvested_power"] > found * (1 - 1e-3)


@pytest.mark.parametrize(
    ("kind", "before"), [pytest.param("parallel_sshi", 381.4e-6, marks=pytest.mark.slow), ("sece", 427.0e-6)]
)
def test_one_lag_over_a_band(run, kind, before):
    """The mean over the band at the lag and load that were found, and around them, with frequencies of their own."""
    free = run(BENCH, 50.3, band=BAND, candidates=(kind,)).best
    fixed = run(BENCH, 50.3, band=BAND, candidates=(kind,), phase_lag="fixed").best
    assert fixed.shunt.phase_lag == 0.0 and fixed.schedule is None and fixed.scheduled_power is None
    assert fixed.harvested_power == pytest.approx(before, rel=1e-3)  # as when lags were not tuned
    assert free.harvested_power > fixed.harvested_power
    nodes, weights = np.polynomial.legendre.leggauss(24)
    nodes, weights = 50.5 + 2.5 * nodes, weights / 2
    assert free.harvested_power == pytest.approx(weights @ power(free.shunt, nodes), rel=1e-4)
    for lag in free.shunt.phase_lag + np.array([-0.5, -0.1, 0.1, 0.5]):
        for factor in (0.8, 1.0, 1.25) if kind != "sece" else (1.0,):
            keys = {"phase_lag": lag}
            if kind != "sece":
                keys["load_resistance"] = factor * free.shunt.load_resistance
            mean = weights @ power(dataclasses.replace(free.shunt, **keys), nodes)
            assert free.harvested_power > mean * (1 - 1e-4)


@pytest.mark.parametrize("frequency", [49.0, pytest.param(52.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["parallel_sshi", "series_sshi", "sece"])
def test_one_frequency(run, kind, frequency):
    best = run(BENCH, frequency, candidates=(kind,)).best
    assert best.schedule is None and best.shunt.phase_lag != 0.0
    loads, lags = np.geomspace(1e4, 2e6, 24), np.linspace(-1.5, 1.5, 25)
    if kind == "sece":
        loads, lags = np.ones(1), np.linspace(-1.5, 1.5, 600)
    assert best.harvested_power > grid(best.shunt, frequency, loads, lags) * (1 - 1e-3)
    fixed = run(BENCH, frequency, candidates=(kind,), phase_lag="fixed").best
    assert best.harvested_power > 1.05 * fixed.harvested_power
    at_zero = grid(best.shunt, frequency, np.geomspace(1e4, 2e6, 200) if kind != "sece" else [1.0], [0.0])
    assert fixed.harvested_power == pytest.approx(at_zero, rel=1e-3)


def test_a_limit_is_kept(run):
    free = run(BENCH, 49.0, candidates=("parallel_sshi",)).best
    limited = run(BENCH, 49.0, candidates=("parallel_sshi",), max_voltage=0.8 * free.voltage_amplitude).best
    assert limited.feasible and limited.voltage_amplitude < 0.8 * free.voltage_amplitude
    assert limited.harvested_power > 0.9 * free.harvested_power  # other loads and lags lose little of the power


def test_damping_keeps_its_lag_unless_asked(run):
    template = SSDI(quality=6.0, flip_time=4e-4, phase_lag=0.3)
    kept = run(BENCH, 50.3, shunts=[template], candidates=("ssdi",), objective="damping").best
    assert kept.shunt == template
    tuned = run(BENCH, 50.3, shunts=[template], candidates=("ssdi",), objective="damping", phase_lag="free").best
    assert tuned.attenuation_db < kept.attenuation_db - 0.1
    found = [simulate(System(BENCH, dataclasses.replace(template, phase_lag=lag)),
                      SineForce(amplitude=FORCE, frequency=50.3)).displacement_amplitude
             for lag in np.linspace(-0.3, 0.3, 25)]  # fmt: skip
    assert tuned.displacement_amplitude < min(found) * (1 + 1e-4)


def test_an_early_template_is_tuned(run):
    template = ParallelSSHI(smoothing_capacitance=1e-5, load_resistance=1e5, quality=6.0, inductance=0.1,
                            phase_lag=-1.0)  # fmt: skip
    late = dataclasses.replace(template, phase_lag=0.0)
    kinds = {"candidates": ("parallel_sshi",)}
    best = [run(BENCH, 51.0, shunts=[shunt], **kinds).best.harvested_power for shunt in (template, late)]
    assert best[0] == pytest.approx(best[1], rel=1e-5)


def test_no_lag_without_a_frequency(run):
    """An angle of the drive is none of a signal of several tones."""
    from piezoharvest.description.excitation import Multisine

    tones = Multisine(amplitudes=(0.02, 0.01), frequencies=(50.0, 52.0), phases=(0.0, 0.0), duration=0.5)
    best = run(BENCH, excitation=tones, shunts=[SECE(hold_off=5e-3)], candidates=("sece",)).best
    assert best.shunt.phase_lag == 0.0 and best.shunt.time_lag > 0.0


def test_zoom_follows_a_curved_valley():
    """Two searches at once, from a start that is further off than the first stencil reaches."""
    optima = np.array([[1.0, -0.5], [-2.0, 0.3]])

    def merits(p, which):
        x, y = (p - optima[which]).T
        return np.cosh(x + 0.3 * y) + np.cosh(2 * y - 0.2 * x)

    region = Region(("load_resistance", "phase_lag"), np.full(2, -5.0), np.full(2, 5.0), np.zeros(2), 0.0)
    best, lowest = zoom(merits, np.zeros((2, 2)), np.array([0.3, 0.2]), region)
    assert best == pytest.approx(optima, abs=2e-3) and lowest == pytest.approx(2.0, abs=1e-5)
