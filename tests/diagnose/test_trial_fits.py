"""Trial fits, which end early, against fits to the end."""

from dataclasses import replace

import numpy as np
import pytest
from diagnose_runs import SIGMA, STEP, campaign, fitted, reading, synthetic

from piezoharvest.description.effects import Clipping, Leakage, Stiffening
from piezoharvest.description.effects.nameless.forms import Corners
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.places import OverTime
from piezoharvest.diagnose.selection.candidate_fits import FIT_TOLERANCE, CandidateFits
from piezoharvest.diagnose.selection.effect_change import EffectChange, names_apart
from piezoharvest.diagnose.selection.score_tests import effect_parameters, extended
from piezoharvest.diagnose.selection.significance import significance, variance_inflation
from piezoharvest.identify.fitting.cost_function import CostFunction
from piezoharvest.identify.fitting.evaluation import whiteners
from piezoharvest.identify.fitting.model import Model, inner_values
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model, prior_of
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.identify.preparation import prepared
from piezoharvest.predict.parameters import parameters_of


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    found = campaign(tmp_path_factory.mktemp("trials"))
    return prepared(found, "fit"), found.transducer


def with_effect(problem, found, start, enough):
    model = extended(found.model, [start], effect_parameters([start]))
    nuisance = nuisance_for_model(problem, found.model, found.nuisance, model)
    return fit(problem, model, nuisance, found.noise, estimate_noise=False, enough=enough)


@pytest.mark.parametrize(
    ("present", "start"),
    [
        (Leakage(resistance=3e7), Leakage(resistance=1e8)),
        (Stiffening(cubic_stiffness=3e18), Stiffening(cubic_stiffness=0.0)),
    ],
    ids=["leakage", "stiffening"],
)
def test_they_end_where_thorough_fits_do(records, present, start):
    problem, found, _ = fitted(*records, [present], seed=1)
    quick = with_effect(problem, found, start, FIT_TOLERANCE)
    thorough = with_effect(problem, found, start, 1e-4)
    assert quick.converged and thorough.converged
    assert quick.cost - thorough.cost < FIT_TOLERANCE
    np.testing.assert_allclose(np.diag(quick.information), np.diag(thorough.information), rtol=0.05)
    assert quick.sums[0].count.tolist() == thorough.sums[0].count.tolist()


def test_the_cost_is_smooth_where_the_stack_follows_quasi_statically(records):
    """What Newton's method leaves of a step's inputs moves it by 1e11 times as much; a descent ends in any dent."""
    problem, found, _ = fitted(*records, [Stiffening(cubic_stiffness=3e18)], seed=8)
    best = with_effect(problem, found, Stiffening(cubic_stiffness=0.0), FIT_TOLERANCE)
    judge = CostFunction(
        problem, whiteners(problem, best.model, best.nuisance, found.noise), *prior_of(problem, best.model)
    )
    values = np.concatenate([inner_values(best.model), *best.nuisance])
    here = judge.at(best.model, best.nuisance, values)
    for k in range(4):
        step = np.zeros(len(values))
        step[k] = 1e-3 / np.sqrt(here.information[k, k])
        costs = [judge.tried(here, values + n * step).cost for n in range(1, 6)]
        # A parabola has no third difference; that of a thousandth of a standard error is 1e-9 at most.
        assert np.abs(np.diff([here.cost, *costs], 3)).max() < 0.01


def test_what_the_data_determines_is_asked_again_beside_an_effect(records):
    """A base fit that lacked the effect may have left out what the data tells, or have kept what it does not."""
    problem, found, _ = fitted(*records, [Leakage(resistance=3e7)], seed=1)
    nominal = replace(records[1], capacitance=1.1 * records[1].capacitance)
    problem = Problem(problem.data, nominal, problem.offset_channels)
    varied = tuple(p for p in parameters_of(nominal, {"force"}) if p.name in ("mass", "stiffness", "coupling"))
    model = extended(replace(found.model, transducer=nominal, parameters=varied), [Leakage(resistance=3e7)], [])
    model = replace(model, parameters=(*varied, *effect_parameters([Leakage(resistance=3e7)])))
    poor = EffectChange(fit(problem, model, noise=found.noise, estimate_noise=False))
    trials = CandidateFits(problem, found, None, lambda text: None)
    better = trials.redetermine(poor)
    names = [parameter.path[-1] for parameter in better.found.model.parameters]
    assert names == ["damping", "stiffness", "coupling", "capacitance", "resistance"]
    assert better.found.model.transducer.mass == nominal.mass
    assert better.found.model.transducer.capacitance == pytest.approx(records[1].capacitance, rel=1e-3)
    assert better.cost < poor.cost - 100.0
    assert trials.redetermine(better) is better


@pytest.mark.parametrize("resistance", [3e7, 3e8])
def test_an_effect_that_gains_by_itself_is_as_significant_as_what_it_gains(records, resistance):
    """The likelihood ratio and Wald's test are one where an effect is small; a line has no strength of its own."""
    problem, found, _ = fitted(*records, [Leakage(resistance=resistance)], seed=1)
    more = with_effect(problem, found, Leakage(resistance=resistance), 1e-4)
    assert significance(more, -1) == pytest.approx(found.cost - more.cost, rel=0.1, abs=3.0)
    assert significance(found, -1) == np.inf


REACHED = 3.1e-6  # m: of the largest one's 3.2e-6
HELD = [
    {"load_resistance": 97.78e3, "excitation": {**STEP, "amplitude": amplitude}}
    for amplitude in (900.0, 700.0, 500.0, 300.0)
]


def ended(records, transducer, scatter, change, start):
    """What the end of a range gains in records with changed displacements, and as how much that counts."""
    rng, made = np.random.default_rng(4), []
    for each in records:
        made.append(reading(synthetic(each, transducer, rng, scatter), "displacement", change))
    problem = Problem(made, transducer, ("displacement",))
    varied = [p for p in parameters_of(transducer, {"force"}) if p.path[0] not in ("mass", "damping")]
    model = Model(transducer, tuple(varied), ("displacement",))
    plain = fit(problem, model, noise=Noise(SIGMA), estimate_noise=False)
    top = max(np.abs(each.values[:, each.channels.index("displacement")]).max() for each in made)
    found = with_effect(problem, plain, Clipping(limit=top - start, channel="displacement"), FIT_TOLERANCE)
    assert found.converged
    gain = plain.cost - found.cost
    return gain, gain / variance_inflation(found, -1)


def test_rounding_of_a_held_load_does_not_count_as_the_end_of_a_range(tmp_path):
    """All readings of a plateau are off by the same: far more than white noise for what is fitted to them."""
    found = campaign(tmp_path, records=HELD)
    records, step = prepared(found, "fit"), 4 * SIGMA["displacement"]
    loud, gain = ended(records, found.transducer, 0.3, lambda x: step * np.round(x / step), 0.1 * step)
    assert loud > 40.0
    assert gain < 4.0
    _, gain = ended(records, found.transducer, 1.0, lambda x: np.minimum(x, REACHED), 0.0)
    assert gain > 1000.0


def test_laws_of_the_same_name_are_told_apart_by_their_inputs():
    """The planned experiment was to tell "parameter.damping table" from "parameter.damping table"."""
    first, second = (
        Law(place=OverTime("damping", of), form=Corners(knots=(1.0,), kinks=(0.1,)))
        for of in ("amplitude", "displacement_amplitude")
    )
    leakage = Leakage(resistance=1e6)
    assert names_apart((leakage, first), (leakage, second)) == ("leakage", "parameter.damping table of amplitude")
    assert names_apart((first,), (leakage,)) == ("parameter.damping table",)
