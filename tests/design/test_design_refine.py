"""Tuning on the engine: by its gradient from two parts on, without derivatives where there are none."""

import numpy as np
import pytest

from piezoharvest.description.excitation import Multisine, SineForce
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.shunts import ParallelRL, Resistor, SeriesRL
from piezoharvest.description.system import System
from piezoharvest.design import trial as trials
from piezoharvest.design.drafts import Draft
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import operation_of
from piezoharvest.design.trial import Trial
from piezoharvest.design.tuning.refine import refine
from piezoharvest.design.tuning.region import Region
from piezoharvest.design.tuning.starts import Host, Start
from piezoharvest.engine import NoGradientError, simulate
from piezoharvest.linear import TwoPort
from piezoharvest.study import DesignOptions

FORCE = 0.02
STOPS = Hysteresis(thresholds=(1e-7, 3e-7), weights=(5e6, 1.5e7))
BY_GRADIENT = "SLSQP with the gradient of the simulator"


def sine(frequency):
    return SineForce(amplitude=FORCE, frequency=frequency)


def trial_of(transducer, excitation, **options):
    """Trial of shunts; what is tuned does not depend on the two-port's view of the hysteresis."""
    options = DesignOptions(**options)
    operation = operation_of(excitation, options.band, transducer)
    return Trial(LinearView(transducer, operation, Goal(options)).working())


def tune(trial, shunt, **limits):
    """Tune a shunt's parts from the values that it has."""
    names = tuple(name for name in ("inductance", "resistance") if hasattr(shunt, name))
    draft = Draft(shunt, names)
    region = Region.of(draft, Host.of(trial.view), limits.get("max_inductance"))
    return refine(trial, draft, Start("a guess", draft.first()), region)


def simulated(trial, shunt):
    return simulate(System(trial.view.transducer, shunt), trial.view.operation.excitation, samples=8)


def central(figure, shunt, step=1e-4):
    """Derivatives of the logarithm of a figure by those of the parts, by differences of simulations."""

    def at(name, sign):
        others = {"inductance": shunt.inductance, "resistance": shunt.resistance}
        return np.log(figure(type(shunt)(**{**others, name: others[name] * np.exp(sign * step)})))

    return np.array([(at(name, 1) - at(name, -1)) / (2 * step) for name in ("inductance", "resistance")])


def around(shunt, width, count=9):
    """Shunts on a grid about one."""
    factors = np.exp(np.linspace(-width, width, count))
    return [type(shunt)(inductance=shunt.inductance * a, resistance=shunt.resistance * b)
            for a in factors for b in factors]  # fmt: skip


@pytest.mark.parametrize("options", [{}, {"min_attenuation_db": 3.0}, {"band": (45.0, 56.0)}])
def test_slopes(host, options):
    """Against central differences of the figures of simulations, at one frequency and as the mean over a band."""
    trial = trial_of(host(0.1, 10, hysteresis=STOPS), sine(50.6), **options)
    shunt = SeriesRL(inductance=80.0, resistance=7e4)
    figures, slopes = trial.tangent(shunt, ("inductance", "resistance"))
    plain = trial.figures(shunt)
    assert figures.harvested_power == pytest.approx(plain.harvested_power, rel=1e-9)
    names = ["harvested_power"]
    if "band" not in options:
        names += ["displacement_amplitude", "voltage_amplitude"]
    if "min_attenuation_db" in options:
        assert figures.attenuation_db == pytest.approx(plain.attenuation_db, abs=1e-9)
    for name in names:
        expected = central(lambda s, name=name: getattr(trial.figures(s), name), shunt)
        assert getattr(slopes, name) == pytest.approx(expected, rel=1e-4, abs=1e-6)


def test_resonant_load_is_the_conjugate_match(host):
    """From a start 30 % off, the engine alone finds R + jwL = Z* of the leads and F^2/(8 b)."""
    transducer, frequency = host(0.025, 80), 50.6
    impedance = TwoPort.of(transducer, frequency).impedance()[0]
    exact = SeriesRL(inductance=-impedance.imag / (2 * np.pi * frequency), resistance=impedance.real)
    trial = trial_of(transducer, sine(frequency))
    found = tune(trial, SeriesRL(inductance=1.3 * exact.inductance, resistance=0.7 * exact.resistance))
    assert found.method == BY_GRADIENT
    assert found.shunt.inductance == pytest.approx(exact.inductance, rel=1e-3)
    assert found.shunt.resistance == pytest.approx(exact.resistance, rel=1e-3)
    assert np.exp(-found.merit) == pytest.approx(FORCE**2 / (8 * transducer.damping), rel=1e-6)


def test_resistor_in_weak_coupling(host):
    """R = 1/(C w), by the line search of a single part."""
    transducer, frequency = host(1e-6, 50), 60.0
    load = 1 / (transducer.capacitance * 2 * np.pi * frequency)
    found = tune(trial_of(transducer, sine(frequency)), Resistor(resistance=1.8 * load))
    assert found.method == "line search with the simulator"
    assert found.shunt.resistance == pytest.approx(load, rel=2e-3)


@pytest.mark.parametrize("kind", [SeriesRL, ParallelRL])
def test_gradient_vanishes_and_nothing_near_is_better(host, run, kind):
    """With hysteresis, where no closed form is left."""
    transducer = host(0.1, 50, hysteresis=STOPS)
    best = run(transducer, 50.6, candidates=(kind.kind,)).best
    assert best.method.endswith(BY_GRADIENT)
    trial = trial_of(transducer, sine(50.6))

    def power(shunt):
        return simulated(trial, shunt).harvested_power

    assert central(power, best.shunt) == pytest.approx([0, 0], abs=5e-4)
    for width in (0.02, 0.5):
        assert best.harvested_power >= max(map(power, around(best.shunt, width))) * (1 - 1e-7)


def test_active_limit(host, run):
    """The limit is reached, and of the loads around that keep it none does better."""
    transducer, limit = host(0.1, 50, hysteresis=STOPS), 3.0
    best = run(transducer, 50.6, candidates=("series_rl",), max_voltage=limit).best
    assert best.method.endswith(BY_GRADIENT) and best.feasible
    assert best.voltage_amplitude == pytest.approx(limit * (1 - 1e-3), rel=1e-5)
    trial = trial_of(transducer, sine(50.6))
    found = [simulated(trial, shunt) for shunt in around(best.shunt, 0.3)]
    allowed = [r.harvested_power for r in found if r.voltage_amplitude <= limit * (1 - 1e-3)]
    assert len(allowed) > 10 and best.harvested_power >= max(allowed) * (1 - 1e-5)


@pytest.mark.parametrize("options", [{}, {"objective": "damping"}, {"max_voltage": 3.0}, {"min_power": 1.0}])
def test_fewer_simulations_than_without_derivatives(host, options, monkeypatch):
    """And an answer that is no worse; without gradients the simplex still finds one, and says so."""
    transducer, guess = host(0.1, 50, hysteresis=STOPS), SeriesRL(inductance=100.0, resistance=5e4)
    by_gradient = tune(trial_of(transducer, sine(50.6), **options), guess)

    def none(*_):
        raise NoGradientError("not today")

    monkeypatch.setattr(trials, "gradient", none)
    without = tune(trial_of(transducer, sine(50.6), **options), guess)
    assert (by_gradient.method, without.method) == (BY_GRADIENT, "simplex search with the simulator")
    assert by_gradient.iterations < without.iterations
    assert by_gradient.merit <= without.merit + 1e-6


def test_no_gradient_where_figures_have_kinks(host):
    """The worst peak of a band, and tones that act at once."""
    transducer, shunt, parts = host(0.1, 10), SeriesRL(inductance=80.0, resistance=7e4), ("inductance", "resistance")
    tones = Multisine(amplitudes=(0.02, 0.01), frequencies=(50.0, 52.0), phases=(0.0, 1.0), duration=0.5)
    band = (45.0, 56.0)
    for trial in (
        trial_of(transducer, sine(50.6), band=band, objective="damping"),
        trial_of(transducer, sine(50.6), band=band, max_voltage=10.0),
        trial_of(transducer, tones),
    ):
        with pytest.raises(NoGradientError):
            trial.tangent(shunt, parts)
        assert trial.simulations == 0
