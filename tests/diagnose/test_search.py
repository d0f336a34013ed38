"""The search for effects: what it remembers, what it gives up, and how it comes back from a false minimum."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from diagnose_runs import campaign, fitted
from selection import with_slow

from piezoharvest.description.effects import (
    BiasCurrent,
    Clipping,
    Leakage,
    NonlinearCoupling,
    Stiffening,
    VoltageDependentCapacitance,
    registered,
)
from piezoharvest.diagnose import diagnose
from piezoharvest.diagnose.selection.candidate_fits import CandidateFits
from piezoharvest.diagnose.selection.effect_change import EffectChange
from piezoharvest.diagnose.selection.score_tests import extended
from piezoharvest.diagnose.selection.stepwise_selection import Searcher
from piezoharvest.diagnose.thresholds import MAX_EFFECTS, MIN_UNDOUBTED_GAIN
from piezoharvest.identify.fitting import levenberg_marquardt
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.preparation import prepared
from piezoharvest.predict.parameters import put

PRESENT = BiasCurrent(current=2e-8), Leakage(resistance=1e7)


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    """Search through records with two effects, and the full fit with both."""
    found = campaign(tmp_path_factory.mktemp("search"))
    problem, base, _ = fitted(prepared(found, "fit"), found.transducer, PRESENT, seed=7)
    trials = CandidateFits(problem, base, [type(effect) for effect in PRESENT], lambda text: None)
    return trials, EffectChange(Searcher(trials).run().final)


def test_a_descent_too_slow_for_its_aim_is_given_up(searched, monkeypatch):
    trials, now = searched
    away = replace(now.found.model, transducer=put(now.found.model.transducer, ("stiffness",), 2.5e8))

    def again(aim):
        return fit(trials.problem, away, now.found.nuisance, now.found.noise, estimate_noise=False, aim=aim)

    monkeypatch.setattr(levenberg_marquardt, "RATE_ITERATIONS", 1)
    hopeless, reached = again(-1e12), again(now.cost + 1.0)
    assert not hopeless.converged
    assert hopeless.message.startswith("given up")
    assert hopeless.cost > reached.cost
    assert reached.converged, reached.message
    assert reached.cost == pytest.approx(now.cost, abs=0.5)


def test_sets_of_effects_are_fitted_once_and_the_best_fit_is_kept(searched):
    trials, now = searched
    assert sorted(now.effects) == ["bias_current", "leakage"]
    before = len(trials.fit_records)
    less = trials.best_without(now, 1)
    assert len(trials.fit_records) == before  # that one was found on the way
    assert less is not None
    assert less.effects == now.effects[:1]
    worse = replace(less, found=replace(less.found, cost=less.cost + 10.0))
    trials.remember(worse)
    assert trials.best_without(now, 1) is less


def test_a_search_comes_back_from_a_false_minimum(searched):
    """Capacitance at three times its value, all else fitted to that: held at its nominal value it is better."""
    trials, now = searched
    model = now.found.model
    held = replace(
        model,
        transducer=put(model.transducer, ("capacitance",), 3.0 * model.transducer.capacitance),
        parameters=tuple(p for p in model.parameters if p.path != ("capacitance",)),
    )
    false = fit(trials.problem, held, now.found.nuisance, now.found.noise, estimate_noise=False)
    assert false.cost > now.cost + 1e3
    strayed = replace(false, model=replace(false.model, parameters=model.parameters))
    back, held = Searcher(trials)._with_nominal_values(EffectChange(strayed))
    assert back.cost == pytest.approx(now.cost, abs=1.0)
    assert held is None


@pytest.mark.parametrize(
    "hidden",
    [
        pytest.param({}, id="healthy"),
        pytest.param({"bias_current": {"current": 1e-6}}, id="another effect", marks=pytest.mark.slow),
    ],
)
def test_an_effect_that_spoils_unseen_records_is_chance_where_nothing_is_left_without_it(tmp_path, monkeypatch, hidden):
    """A search that ends with a range too small for the record that was not fitted."""
    told, run = [], Searcher.run

    def misled(searcher):
        found, base = run(searcher), searcher.trials.base
        unseen = max(abs(record["displacement"]).max() for record in measured.of_role("validate"))
        cut = extended(base.model, [Clipping(limit=0.98 * unseen, channel="displacement")], [])
        return replace(found, nested=(replace(base, model=cut),), order=cut.transducer.effects, p_values=(1e-9,))

    monkeypatch.setattr(Searcher, "run", misled)
    measured = campaign(tmp_path, hidden)
    found = diagnose(measured, told.append, library=[Leakage])
    chance = [text for text in told if text.startswith("clipping was chance")]
    if hidden:
        assert found.verdict == "unexplained"
        assert [named.effect.name for named in found.effects] == ["clipping"]
        assert not chance
    else:
        assert found.verdict == "adequate"
        assert found.effects == ()
        assert found.validation_after.rms == found.validation_before.rms
        assert len(chance) == 1


HIDDEN = {
    "charge": VoltageDependentCapacitance(beta=3e-3),
    "force": Stiffening(cubic_stiffness=6e17),
    "coupling": NonlinearCoupling(quadratic_coupling=5e4),
}


@pytest.mark.parametrize(
    "effect", with_slow(HIDDEN.values(), slow=lambda effect: effect is not HIDDEN["charge"]), ids=HIDDEN
)
def test_a_search_ends_where_nothing_in_the_library_is_the_cause(tmp_path, effect):
    """What its stand-in leaves is as large as before; with the effect itself in the library nothing is left."""
    measured = campaign(tmp_path)
    problem, base, _ = fitted(prepared(measured, "fit"), measured.transducer, [effect], seed=3)
    ends = "the largest excess of the residuals over the noise remains: no known effect explains it"
    for library in ([cls for cls in registered().values() if cls is not type(effect)], list(registered().values())):
        told = []
        found = Searcher(CandidateFits(problem, base, library, told.append)).run()
        if type(effect) in library:
            assert [each.name for each in found.order] == [effect.name]
            assert not found.left
            assert ends not in told
        else:
            stand_ins = [text for text in told if text.startswith("found ")]
            assert 0 < len(stand_ins) < MAX_EFFECTS  # one more with each
            # Nothing is tried after that, but what is uncertain may go.
            *gone, last = told[told.index(ends) + 1 :]
            assert all(text.endswith("standard errors of zero") for text in gone)
            assert last == "testing the residuals"
            assert len(found.order) < MAX_EFFECTS
            assert found.left


@pytest.mark.parametrize(
    ("gain", "left", "wald", "taken"), [(50.0, 5.0, 50.0, True), (50.0, 49.9, 50.0, False), (500.0, 5.0, 500.0, False),
                                        (500.0, 5.0, 0.3, True)],
    ids=["to a better minimum", "by itself", "by far", "by far, though hardly told from none"],
)  # fmt: skip
def test_a_model_that_was_caught_is_taken_from_where_a_small_effect_has_led(monkeypatch, gain, left, wald, taken):
    """`left` is what the effect still gains beside the model without it that is fitted from there.

    An effect whose strength its own standard error exceeds owes its gain to something else, however large that is.
    """
    made = []
    monkeypatch.setattr("piezoharvest.diagnose.selection.stepwise_selection.significance", lambda found, n: wald)
    less = SimpleNamespace(cost=1000.0 - gain + left, effects=())
    trials = SimpleNamespace(fit_without=lambda now, n: made.append((now.effects, n)), best_without=lambda now, n: less)
    before = SimpleNamespace(cost=1000.0)
    now = SimpleNamespace(cost=1000.0 - gain, effects=("clipping", "load_error"), found=None)
    found = Searcher(trials)._restarted_without(before, now)
    assert found is (less if taken else None)
    assert made == ([(("clipping", "load_error"), 1)] if min(gain, wald) <= MIN_UNDOUBTED_GAIN else [])
