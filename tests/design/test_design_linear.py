"""Tuning of linear shunts against closed forms and brute force on the frequency response."""

import dataclasses
from itertools import product

import numpy as np
import pytest
from scipy.optimize import differential_evolution, minimize_scalar
from selection import with_slow

from piezoharvest.description.excitation import Multisine, RandomForce
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.shunts import NegativeCapacitance, ParallelRL, Resistor, SeriesRL, Short
from piezoharvest.description.system import System
from piezoharvest.linear import frequency_response

FORCE = 0.02


def response(transducer, shunt, frequencies):
    return frequency_response(System(transducer, shunt), np.asarray(frequencies))


def worst(transducer, shunt, band, count=4001):
    """Largest displacement in a band by a dense grid, for each of a batch of designs."""
    return FORCE * np.max(np.abs(response(transducer, shunt, np.linspace(*band, count)).displacement), axis=-1)


def mean_power(transducer, shunt, band, count=4001):
    f = np.linspace(*band, count)
    power = response(transducer, shunt, f).harvested_power
    return FORCE**2 * np.trapezoid(power, f, axis=-1) / (band[1] - band[0])


def brute_force(figure, make, centre, span):
    """Best of a shunt's parts about typical values by a global method that knows nothing of the problem."""
    names = [name for name, value in centre.items() if isinstance(value, float)]

    def at(logs):
        return figure(make(**{n: centre[n] * np.exp(x)[:, None] for n, x in zip(names, logs, strict=True)}))

    found = differential_evolution(
        at,
        [(-span, span)] * len(names),
        seed=1,
        tol=1e-10,
        maxiter=40,
        vectorized=True,
        updating="deferred",
        polish=False,
    )
    return found.fun


def test_resistor_in_weak_coupling(host, run):
    """R = 1/(C w), P = w C V_oc^2/4 (REFERENCE section 1)."""
    transducer = host(1e-6, 50)
    best = run(transducer, 60.0, candidates=("resistor",)).best
    w = 2 * np.pi * 60
    assert best.shunt.resistance == pytest.approx(1 / (transducer.capacitance * w), rel=1e-3)
    voltage = transducer.coupling * best.displacement_amplitude / transducer.capacitance
    assert best.harvested_power == pytest.approx(w * transducer.capacitance * voltage**2 / 4, rel=1e-5)
    assert best.converged and best.feasible


@pytest.mark.parametrize("seen", [None, -0.5])
def test_a_resistor_adds_the_damping_of_its_formula(host, run, seen):
    """A resistor takes as much of the motion as a damper of T^2 R/(1 + (w R C)^2), wherever that is read."""
    transducer = host(0.1, 50, sensor_participation=seen)
    best = run(transducer, 52.0, objective="damping", candidates=("resistor",)).best
    load, w = best.shunt.resistance, 2 * np.pi * 52.0
    damper = transducer.coupling**2 * load / (1 + (w * load * transducer.capacitance) ** 2)
    ratio = damper / (2 * np.sqrt(transducer.stiffness * transducer.mass))
    assert best.added_damping == pytest.approx(ratio, rel=1e-9)


@pytest.mark.parametrize("frequency", [49.0, 52.0, 55.0])
def test_resistor_in_strong_coupling(host, run, frequency):
    """At one frequency the best load is as large as the impedance of the leads."""
    transducer = host(0.2, 100)
    best = run(transducer, frequency, candidates=("resistor",)).best
    brute = minimize_scalar(
        lambda x: -response(transducer, Resistor(resistance=np.exp(x)), frequency).harvested_power,
        bounds=(5, 20), method="bounded", options={"xatol": 1e-9},
    )  # fmt: skip
    assert best.harvested_power == pytest.approx(-brute.fun * FORCE**2, rel=1e-6)
    assert best.shunt.resistance == pytest.approx(np.exp(brute.x), rel=1e-3)


@pytest.mark.parametrize("kind", ["series_rl", "parallel_rl"])
def test_resonant_load_takes_all_there_is(host, run, kind):
    """A conjugate match reaches F^2/(8 b), where it takes an inductance."""
    transducer = host(0.025, 80)
    best = run(transducer, 50.6, candidates=(kind,)).best
    assert best.harvested_power == pytest.approx(FORCE**2 / (8 * transducer.damping), rel=1e-6)
    assert "conjugate match" in best.start


@pytest.mark.parametrize("k", with_slow([0.1, 0.3, 0.6], slow=lambda k: k != 0.3))
def test_resistor_for_the_smallest_peak(host, run, k):
    """R = 1/(C w_F), peak 2/K^2, for an undamped host (REFERENCE section 4)."""
    transducer = host(k**2)
    band = (50 * (1 - k / 2), 50 * (1 + k))
    best = run(transducer, 50.0, objective="damping", band=band, candidates=("resistor",)).best
    fixed_point = 2 * np.pi * transducer.short_circuit_frequency * np.sqrt(1 + k**2 / 2)
    assert best.shunt.resistance == pytest.approx(1 / (transducer.capacitance * fixed_point), rel=2e-3)
    assert best.displacement_amplitude * transducer.stiffness / FORCE == pytest.approx(2 / k**2, rel=1e-5)


@pytest.mark.parametrize(
    ("k", "kind"),
    with_slow(product([0.1, 0.4], ["series_rl", "parallel_rl"]), slow=lambda k, kind: (k, kind) != (0.4, "series_rl")),
)
def test_resonant_shunt_is_h_infinity_optimal(host, run, kind, k):
    """As good as a global search on a dense grid; two equal peaks; no rule of the literature is better."""
    transducer, band = host(k**2), (50 * (1 - k), 50 * (1 + 2 * k))
    best = run(transducer, 50.0, objective="damping", band=band, candidates=(kind,)).best
    cls = {"series_rl": SeriesRL, "parallel_rl": ParallelRL}[kind]
    found = dataclasses.asdict(best.shunt)
    peak = worst(transducer, best.shunt, band, 20001)
    assert best.displacement_amplitude == pytest.approx(peak, rel=1e-5)
    brute = brute_force(lambda shunt: worst(transducer, shunt, band, 401), cls, found, 0.1)
    assert peak <= brute * (1 + 1e-4)
    f = np.linspace(*band, 20001)
    height = FORCE * np.abs(response(transducer, best.shunt, f).displacement)
    tops = height[1:-1][(height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])]
    assert len(tops) == 2 and tops[0] == pytest.approx(tops[1], rel=1e-4)
    if kind == "series_rl":
        w, c, share = 2 * np.pi * transducer.open_circuit_frequency, transducer.capacitance, k**2 / (1 + k**2)
        yamada = SeriesRL(inductance=1 / (c * w**2), resistance=np.sqrt(3 * share / (2 - share)) / (c * w))
        assert peak < worst(transducer, yamada, band, 8001) < 1.01 * peak


def test_mean_power_over_a_band(host, run):
    transducer, band = host(0.05, 60), (47.0, 55.0)
    result = run(transducer, 50.0, band=band, candidates=("resistor", "series_rl"))
    assert [c.shunt.kind for c in result.candidates] == ["series_rl", "resistor"]
    for candidate, cls in zip(result.candidates, (SeriesRL, Resistor), strict=True):
        exact = mean_power(transducer, candidate.shunt, band)
        assert candidate.harvested_power == pytest.approx(exact, rel=2e-3)
        centre = dataclasses.asdict(candidate.shunt)
        brute = brute_force(lambda shunt: -mean_power(transducer, shunt, band, 401), cls, centre, 1.0)
        assert exact >= -brute * (1 - 1e-4)


@pytest.mark.slow
def test_two_loads_suit_a_band_with_both_resonances(host, run):
    """Over short- and open-circuit resonance the mean power has a maximum near each: the higher one is found."""
    transducer = host(0.5, 300)
    band = (48.0, 61.8)
    loads = np.geomspace(1e3, 1e8, 150)
    means = mean_power(transducer, Resistor(resistance=loads[:, None]), band)
    maxima = np.flatnonzero((means[1:-1] > means[:-2]) & (means[1:-1] >= means[2:])) + 1
    assert len(maxima) == 2
    best = run(transducer, 50.0, band=band, candidates=("resistor",)).best
    assert mean_power(transducer, best.shunt, band) >= means.max() * (1 - 1e-6)


def test_limits_bind(host, run):
    """A limit that is in the way is reached, kept, and costs no more than it must."""
    transducer = host(0.1, 50)
    free = run(transducer, 50.6, candidates=("resistor",)).best
    limit = 0.6 * free.voltage_amplitude
    best = run(transducer, 50.6, candidates=("resistor",), max_voltage=limit).best
    loads = np.geomspace(1e3, 1e8, 100001)[:, None]
    all_loads = response(transducer, Resistor(resistance=loads), [50.6])
    allowed = FORCE * np.abs(all_loads.voltage) <= limit
    assert best.feasible and 0.998 * limit < best.voltage_amplitude <= limit
    assert best.harvested_power == pytest.approx(FORCE**2 * all_loads.harvested_power[allowed].max(), rel=3e-3)

    short = run(transducer, 50.6, candidates=("short",)).best.displacement_amplitude
    for options in ({"min_attenuation_db": -6.0}, {"min_attenuation_db": 6.0}, {"max_displacement": short / 10**0.3}):
        best = run(transducer, 50.6, candidates=("series_rl",), **options).best
        assert best.feasible and best.attenuation_db == pytest.approx(-6, abs=0.02)
        assert best.harvested_power < FORCE**2 / (8 * transducer.damping)


def test_largest_inductance(host, run):
    transducer = host(0.1, 50)
    result = run(transducer, 50.6, candidates=("series_rl", "parallel_rlc"), max_inductance=50.0)
    for candidate in result.candidates:
        assert candidate.feasible and candidate.shunt.inductance <= 50.0 * (1 + 1e-9)
    # More capacitance across the electrodes makes up for a small inductance, at one frequency, altogether.
    assert result.best.shunt.kind == "parallel_rlc"
    assert result.best.harvested_power == pytest.approx(FORCE**2 / (8 * transducer.damping), rel=1e-5)
    assert any("synthetic" in note for note in result.notes)


@pytest.mark.slow
def test_limits_over_a_band(host, run):
    transducer, band = host(0.1, 50), (46.0, 58.0)
    limit = 0.7 * run(transducer, 50.0, band=band, candidates=("series_rl",)).best.voltage_amplitude
    best = run(transducer, 50.0, band=band, candidates=("series_rl",), max_voltage=limit).best
    f = np.linspace(*band, 8001)
    assert best.feasible
    assert FORCE * np.max(np.abs(response(transducer, best.shunt, f).voltage)) == pytest.approx(limit, rel=2e-3)


def test_what_cannot_be_kept(host, run):
    """Nothing gives a watt: candidates are still tuned, ranked, and say what they miss."""
    result = run(host(0.025, 80), 50.6, candidates=("resistor", "series_rl"), min_power=1.0)
    assert [c.violates for c in result.candidates] == [("min_power",)] * 2
    assert result.best.shunt.kind == "series_rl"
    assert "no candidate meets all limits" in result.notes


@pytest.mark.slow
def test_negative_capacitance_keeps_what_the_template_says(host, run):
    """K^2 -> K^2 C/(C - C_n) (REFERENCE section 4)."""
    transducer = host(0.04)
    template = NegativeCapacitance(capacitance=0.5 * transducer.capacitance, resistance=1.0)
    options = {"objective": "damping", "band": (40.0, 65.0), "candidates": ("negative_capacitance",)}
    best = run(transducer, 50.0, shunts=[template], **options).best
    assert best.shunt.capacitance == template.capacitance
    assert best.displacement_amplitude * transducer.stiffness / FORCE == pytest.approx(2 / 0.08, rel=1e-4)


def test_hysteresis_moves_the_optimum(host, run):
    """With slipping stops the tuning goes on where the two-port ends: no other load does better in the simulation."""
    from piezoharvest.description.excitation import SineForce
    from piezoharvest.engine import simulate

    stops = Hysteresis(thresholds=(1e-7, 3e-7), weights=(5e6, 1.5e7))
    transducer = host(0.1, 50, hysteresis=stops)
    result = run(transducer, 50.6, candidates=("resistor",))
    assert "simulator" in result.best.method

    def power(load):
        return simulate(
            System(transducer, Resistor(resistance=load)), SineForce(amplitude=FORCE, frequency=50.6)
        ).harvested_power

    around = result.best.shunt.resistance * np.geomspace(0.1, 10, 61)
    assert result.best.harvested_power >= max(map(power, around)) * (1 - 1e-5)


def test_several_tones(host, run):
    """Linear powers add up tone by tone."""
    transducer = host(0.05, 60)
    tones = Multisine(amplitudes=(0.02, 0.01), frequencies=(50.0, 52.0), phases=(0.0, 1.0), duration=0.5)
    best = run(transducer, excitation=tones, candidates=("resistor",)).best

    def power(load):
        return response(transducer, Resistor(resistance=load), [50.0, 52.0]).harvested_power @ [0.02**2, 0.01**2]

    loads = np.geomspace(1e3, 1e7, 20001)[:, None]
    assert best.harvested_power == pytest.approx(np.max(power(loads)), rel=1e-6)


def test_noise(host, run):
    """Tuned for the expectation of white noise, checked on the realisation; a band is not used with it."""
    transducer, psd = host(0.05, 60), 1e-4
    noise = RandomForce(psd=psd, band=(20.0, 100.0), duration=10.0, seed=1)
    result = run(transducer, excitation=noise, candidates=("resistor",), band=(40.0, 60.0))
    assert any("band is not used" in note for note in result.notes)
    f = np.linspace(20, 100, 2001)
    loads = np.geomspace(3e4, 3e5, 41)
    expected = 2 * psd * np.trapezoid(response(transducer, Resistor(resistance=loads[:, None]), f).harvested_power, f)
    assert result.best.shunt.resistance == pytest.approx(loads[np.argmax(expected)], rel=0.04)
    assert result.best.harvested_power == pytest.approx(np.max(expected), rel=0.5)  # one realisation, from rest


def test_short_circuit_is_the_reference(host, run):
    """Over a band, worst peak against worst peak."""
    transducer, band = host(0.05, 60), (45.0, 58.0)
    best = run(transducer, 50.0, band=band, objective="damping", candidates=("resistor",)).best
    ratio = worst(transducer, best.shunt, band, 20001) / worst(transducer, Short(), band, 40001)
    assert best.attenuation_db == pytest.approx(20 * np.log10(ratio), abs=1e-3)
