"""The search for effects: what it remembers, what it gives up, and how it comes back from a false minimum."""

from dataclasses import replace

import pytest
from diagnose_runs import campaign, fitted

from piezoharvest.diagnose.search import Searcher, Step
from piezoharvest.effects import BiasCurrent, Leakage
from piezoharvest.identify import descent
from piezoharvest.identify.fit import fit
from piezoharvest.identify.identification import prepared
from piezoharvest.predict.parameters import put

PRESENT = BiasCurrent(current=2e-8), Leakage(resistance=1e7)


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    """Search through records with two effects, and the full fit with both."""
    found = campaign(tmp_path_factory.mktemp("search"))
    problem, base, scene = fitted(prepared(found, "fit"), found.transducer, PRESENT, seed=7)
    searcher = Searcher(problem, scene, [type(effect) for effect in PRESENT], lambda text: None)
    now = searcher.run(base).final
    return searcher, Step(now, tuple(effect.name for effect in now.model.transducer.effects))


def test_a_descent_too_slow_for_its_aim_is_given_up(searched, monkeypatch):
    searcher, now = searched
    away = replace(now.found.model, transducer=put(now.found.model.transducer, ("stiffness",), 2.5e8))

    def again(aim):
        return fit(searcher.problem, away, now.found.own, now.found.noise, estimate_noise=False, aim=aim)

    monkeypatch.setattr(descent, "PACE", 1)
    hopeless, reached = again(-1e12), again(now.cost + 1.0)
    assert not hopeless.converged
    assert hopeless.message.startswith("given up")
    assert hopeless.cost > reached.cost
    assert reached.converged, reached.message
    assert reached.cost == pytest.approx(now.cost, abs=0.5)


def test_sets_of_effects_are_fitted_once_and_the_best_fit_is_kept(searched):
    searcher, now = searched
    assert sorted(now.effects) == ["bias_current", "leakage"]
    before = len(searcher.fits)
    less = searcher.without(now, 1)
    assert len(searcher.fits) == before  # that one was found on the way
    assert less is not None
    assert less.effects == now.effects[:1]
    worse = replace(less, found=replace(less.found, cost=less.cost + 10.0))
    searcher._remember(worse)
    assert searcher.without(now, 1) is less


def test_a_search_comes_back_from_a_false_minimum(searched):
    """Capacitance at three times its value, all else fitted to that: held at its nominal value it is better."""
    searcher, now = searched
    model = now.found.model
    held = replace(
        model,
        transducer=put(model.transducer, ("capacitance",), 3.0 * model.transducer.capacitance),
        parameters=tuple(p for p in model.parameters if p.path != ("capacitance",)),
    )
    false = fit(searcher.problem, held, now.found.own, now.found.noise, estimate_noise=False)
    assert false.cost > now.cost + 1e3
    strayed = replace(false, model=replace(false.model, parameters=model.parameters))
    back, stage = searcher._surveyed(Step(strayed, now.effects))
    assert back.cost == pytest.approx(now.cost, abs=1.0)
    assert all(step is back for _, step in stage)
