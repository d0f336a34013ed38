"""Which laws are fitted, which effects beside them are dropped, and which get the name of a known effect."""

from collections import defaultdict
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from nameless import Drive, Laws, nameless_campaign

from piezoharvest import Transducer, progress
from piezoharvest.description.effects import (
    Clipping,
    ContactCompliance,
    CouplingDrift,
    Creep,
    DielectricRelaxation,
    DisplacementLag,
    Friction,
    Leakage,
    NonlinearCoupling,
    Stiffening,
    VoltageDependentCapacitance,
)
from piezoharvest.description.effects.nameless.forms import Corners, Hertz, Knee, Line, Monomial
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Play, Relaxation
from piezoharvest.description.effects.nameless.places import (
    Capacitor,
    Coupling,
    Damper,
    Electrodes,
    Load,
    OverTime,
    Reading,
    Spring,
)
from piezoharvest.description.shunts import Resistor
from piezoharvest.diagnose.discovery import fits_of_laws, halving, verdict
from piezoharvest.diagnose.discovery import search as searching
from piezoharvest.diagnose.discovery.forms.known import known_effects
from piezoharvest.diagnose.discovery.law_fits import ScoredLaw
from piezoharvest.diagnose.discovery.search import FITS, promising, search, search_campaign
from piezoharvest.diagnose.discovery.tables.smoothness import Smoothness
from piezoharvest.diagnose.discovery.verdict import found_laws, without_riders
from piezoharvest.diagnose.selection import stepwise_selection
from piezoharvest.diagnose.selection.candidate_fits import FitRecord
from piezoharvest.diagnose.selection.effect_change import EffectChange
from piezoharvest.diagnose.selection.score_tests import effect_parameters, extended
from piezoharvest.diagnose.thresholds import LARGE_MISFIT
from piezoharvest.identify.fitting.levenberg_marquardt import GIVEN_UP
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model
from piezoharvest.identify.identification import identify
from piezoharvest.identify.preparation import prepared
from piezoharvest.predict.discrete_model import setting_of
from piezoharvest.predict.prediction import Prediction
from piezoharvest.threads import single_threaded

DEVICE = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1e-3, "capacitance": 40e-9}
COUNT, RATE = 400, 4000.0  # samples, Hz
NAMED = [
    (Law(place=Spring(), form=Monomial(factor=0.05, scale=1e-3, exponent=3)), Stiffening),
    (Law(place=Spring(), form=Line(factor=30.0), memory=Play(threshold=1e-5)), Friction),
    (Law(place=Spring(), form=Line(factor=-90.0), memory=Relaxation(time_constant=0.2)), Creep),
    (Law(place=Capacitor(), form=Monomial(factor=1e-9, scale=2.0, exponent=3)), VoltageDependentCapacitance),
    (Law(place=Capacitor(), form=Line(factor=4e-9), memory=Relaxation(time_constant=0.2)), DielectricRelaxation),
    (Law(place=Coupling(), form=Monomial(factor=1e-7, scale=1e-3)), NonlinearCoupling),
    (Law(place=Electrodes(), form=Line(factor=2e-6)), Leakage),
    (Law(place=OverTime("coupling"), form=Line(factor=1.0)), CouplingDrift),
    (Law(place=Reading("displacement", "force"), form=Hertz(factor=1e-6, exponent=2 / 3, scale=0.02, odd=False)),
     ContactCompliance),
]  # fmt: skip


def predicted(effect):
    drive = 0.015 + 0.02 * np.sin(2 * np.pi * 48.0 * np.arange(COUNT) / RATE)  # pressed and pulled
    setting = setting_of("force", Resistor(resistance=1e5), 1.0 / RATE, drive)
    run = Prediction(Transducer(**DEVICE, effects=(effect,)), setting, relaxed=True)
    (block,) = run.blocks(False, channels=["displacement", "voltage", "current"])
    return block.values


@pytest.mark.parametrize(("law", "name"), NAMED, ids=lambda each: getattr(each, "__name__", ""))
def test_a_law_that_is_a_known_effect_is_called_so_and_acts_alike(law, name):
    (effect,) = known_effects(law, Transducer(**DEVICE), (COUNT - 1) / RATE)
    assert type(effect) is name
    mine, its, plain = predicted(law), predicted(effect), predicted(Leakage(resistance=1e15))
    size = np.ptp(its, axis=0)
    assert np.all(np.abs(mine - its).max(axis=0) < 1e-9 * size)
    assert np.any(np.abs(its - plain).max(axis=0) > 1e-4 * size)  # it matters


def test_sensors_that_cut_off_or_lag_have_names():
    device = Transducer(**DEVICE)
    cut = Law(place=Reading("voltage", "voltage"), form=Knee(factor=-1.0, knee=3.0))
    assert list(known_effects(cut, device)) == [Clipping(limit=3.0, channel="voltage")]
    late = Law(
        place=Reading("displacement", "displacement"), form=Line(factor=1.0),
        memory=Relaxation(time_constant=0.01, behind=True),
    )  # fmt: skip
    assert list(known_effects(late, device)) == [DisplacementLag(time_constant=0.01)]


def test_what_no_file_has_or_has_with_another_sign_gets_no_name():
    device = Transducer(**DEVICE)
    assert not list(known_effects(Law(place=Load(), form=Knee(factor=1e-6, knee=2.0)), device))
    assert not list(known_effects(Law(place=Electrodes(), form=Line(factor=-1e-6)), device))


def scored(place, gain):
    law = Law(place=place, form=Line(factor=0.0))
    return ScoredLaw(law, np.zeros(1), Smoothness(1.0, gain))


def test_where_the_misfit_is_large_the_best_start_of_each_place_is_fitted():
    many = [scored(Reading("voltage", of), 1e6 - n) for n, of in enumerate(("force", "current", "time", "voltage"))]
    many += [scored(Reading("current", of), 1e5 - n) for n, of in enumerate(("force", "current", "time"))]
    poor = [scored(place, 8e4 - n) for n, place in enumerate((Load(), Spring(), Damper()))]
    few = promising([*many, *poor], 99.0)
    assert len(few) == FITS
    assert not {"load", "spring"} & {each.law.place.name for each in few}
    all_of_them = [each.law.place.name for each in promising([*many, *poor], 101.0)]
    assert set(all_of_them) == {"reading.voltage", "reading.current", "load", "spring", "damper"}
    assert all_of_them.count("reading.current") == 1  # its best start


@single_threaded
def _beside_a_rider(campaign):
    before = identify(campaign, offsets=("displacement",))
    problem = Problem(prepared(before.campaign, "fit"), before.campaign.transducer, before.offsets)
    base, rider = before.found, Stiffening(cubic_stiffness=0.0)
    model = extended(base.model, [rider], effect_parameters([rider], 0))
    start = fit(problem, model, nuisance_for_model(problem, base.model, base.nuisance, model), base.noise)
    laws = found_laws(campaign, before, problem, start, lambda text: None)
    return laws, *without_riders(campaign, before, problem, laws, (0,), lambda text: None)


@pytest.mark.parametrize("aim", [np.inf, 80.0])
def test_places_are_chosen_by_what_a_few_iterations_explain(monkeypatch, aim):
    """Not by their scores: the law with the least one goes down fastest; one that explains nothing goes at once.

    So does one whose fit is given up beside a law that is as good as the right one.
    """
    places = [Spring(), Damper(), Electrodes(), Load(), Capacitor(), Coupling()]
    smoothness = Smoothness(deviation=1.0, gain=1.0)
    scored = [ScoredLaw(Law(place=place, form=Line(factor=0.0)), np.ones(1), smoothness) for place in places]
    rates = dict(zip((place.name for place in places), (0.0, 1.0, 2.0, 3.0, 4.0, 9.0), strict=True))
    done = []

    def at(name, most):
        done.append((name, most))
        cost = 100.0 - rates[name] * most
        return SimpleNamespace(name=name, found=SimpleNamespace(cost=cost, message=GIVEN_UP if cost > aim else ""))

    monkeypatch.setattr(halving, "fitted", lambda problem, start, law, *_: at(law.place.name, _[-1]))
    monkeypatch.setattr(halving, "continued", lambda problem, start, begun, aim, most: at(begun.name, most))
    start: Any = SimpleNamespace(cost=100.0)
    problem: Any = None
    found = halving.halved(problem, start, scored, 2, lambda message: None, aim)
    few, more = halving.ROUNDS
    best = ["coupling", "capacitor", "load"] if aim == np.inf else ["coupling"]
    assert done == [*((place.name, few) for place in places), *((name, more) for name in best)]
    assert [each.law.place.name for each, _ in found] == best[:2]


def test_what_unseen_records_have_denied_is_not_sought_again():
    """From another start the same place was found, and a second law beside it sought for minutes, once more."""

    def found_at(place, cost):
        law = Law(place=place, form=Knee(factor=1.0, knee=0.1))
        fitted = SimpleNamespace(found=fit_with(cost, law), law=law, place=place, form=law.form)
        return SimpleNamespace(best=fitted, table=fitted, final=fitted.found)

    ways: Any = [found_at(Spring(), 1e3), found_at(Spring(), 1e3), found_at(Load(), 1e3), found_at(Spring(), 500.0)]
    denied, said, none = [], [], None
    found = [
        verdict._sought_anew(lambda *_, each=each: each, denied, none, none, said.append)  # pyright: ignore
        for each in ways
    ]
    assert found == [ways[0], None, *ways[2:]]
    assert len(said) == 1


@pytest.mark.parametrize(("form", "engine", "left", "coarse"), [
    (Corners(knots=(0.1,), kinks=(1.0,)), False, 1.001, True), (Corners(knots=(0.1,), kinks=(1.0,)), True, 1.1, False),
    (Knee(factor=1.0, knee=0.1), False, 1.001, False), (Knee(factor=1.0, knee=0.1), True, 1.001, True),
])  # fmt: skip
def test_what_is_left_between_the_corners_of_a_broken_line_is_no_second_law(form, engine, left, coarse):
    """One that explains nearly all was followed by a search for a second law of four minutes.

    The engine has curves as broken lines, too.
    """
    squares, problem = ((2e6, 1e6), (left * 1e6, 1e6)), SimpleNamespace(needs_engine=engine)
    laws: Any = SimpleNamespace(found=(SimpleNamespace(best=SimpleNamespace(form=form)),), squares=squares)
    assert verdict._is_coarse(problem, laws) == coarse  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(("engine", "count", "misfit", "ends"), [
    (True, 2, 2.0, True), (True, 1, 2.0, False), (True, 2, 0.5, False), (False, 2, 2.0, False),
])  # fmt: skip
def test_behind_circuits_no_third_effect_is_sought_where_two_leave_much(monkeypatch, engine, count, misfit, ends):
    base = fit_with(0.0)
    monkeypatch.setattr(stepwise_selection, "mean_square", lambda found: misfit * LARGE_MISFIT)
    trials: Any = SimpleNamespace(base=base, problem=SimpleNamespace(needs_engine=engine))
    now: Any = EffectChange(fit_with(0.0, *[Leakage(resistance=1e6)] * count))
    assert stepwise_selection.Searcher(trials)._stays_large(now) == ends


def test_places_are_counted_as_they_are_scored_and_tried(monkeypatch):
    """Behind diodes a search took minutes without a word."""
    monkeypatch.setattr(progress, "EVERY", 0.0)
    smoothness, places, said = Smoothness(deviation=1.0, gain=100.0), [Spring(), Damper(), Coupling()], []
    replaced = {
        "mean_square": 1.0, "visited_inputs": defaultdict(lambda: np.zeros(1)), "campaign_scales": None,
        "_first_form": Line(factor=0.0), "_memories": [], "fitted": None,
    }  # fmt: skip
    for name, value in replaced.items():
        for module in (searching, fits_of_laws):
            monkeypatch.setattr(module, name, lambda *_, value=value: value, raising=False)
    monkeypatch.setattr(searching, "score", lambda problem, start, law, visited: ScoredLaw(law, visited, smoothness))
    problem: Any = SimpleNamespace(needs_engine=True, data=())
    start: Any = SimpleNamespace(cost=1000.0)
    assert searching.search(problem, start, said.append, lambda *_: places) is None
    assert [progress.line(text).split(", ")[0] for text in said] == [
        "scoring laws: 1 of 3 places", "scoring laws: 2 of 3 places",
        "trying laws: 1 of at most 3 places", "trying laws: 2 of at most 3 places",
    ]  # fmt: skip


def test_one_effect_that_explains_most_is_kept_beside_a_law_though_the_search_has_dropped_it(monkeypatch):
    """Of two that explain as much the one with fewer parameters; where the misfit is small there is no need."""
    base: Any = fit_with(1000.0)
    records = [
        ("dielectric_relaxation", -801.0),
        ("leakage", -800.0),
        ("load_error", -200.0),
        ("creep + leakage", -900.0),
    ]
    done: Any = SimpleNamespace(
        base=base, final=base, given_effects=0, fits=[FitRecord(name, change, 1.0) for name, change in records]
    )
    starts = {
        Leakage: Leakage(resistance=1e6),
        DielectricRelaxation: DielectricRelaxation(capacitance=1e-9, time_constant=0.1),
    }
    monkeypatch.setattr(verdict, "starts_of", lambda scales, found, kinds: [starts[kind] for kind in kinds])
    monkeypatch.setattr(verdict, "campaign_scales", lambda data, found: None)
    monkeypatch.setattr(verdict, "excess_of", lambda found: found.cost)
    trials: Any = SimpleNamespace(
        problem=SimpleNamespace(data=()), extended=lambda now, effect, aim: EffectChange(fit_with(200.0, effect))
    )
    for large, ways in ((True, [search_campaign, search]), (False, [])):
        monkeypatch.setattr(verdict, "mean_square", lambda found, large=large: 2.0 * LARGE_MISFIT if large else 1.0)
        found = list(verdict._beside_one_effect(trials, done))
        assert [seek for seek, _ in found] == ways
        assert all(begun.model.transducer.effects == (starts[Leakage],) for _, begun in found)
    monkeypatch.setattr(verdict, "mean_square", lambda found: 2.0 * LARGE_MISFIT)
    done.final = fit_with(200.0, starts[Leakage])  # it is begun with anyway
    assert not list(verdict._beside_one_effect(trials, done))


def fit_with(cost, *effects) -> Any:
    """A fit of a model with effects, as far as a search for laws looks at it."""
    return SimpleNamespace(cost=cost, model=SimpleNamespace(transducer=SimpleNamespace(effects=effects)))


def test_an_effect_that_does_nothing_for_unseen_records_beside_a_law_is_dropped(tmp_path):
    """A load that conducts beyond 2.19 V, with a stiffening that was found while the load was not known."""
    records = [
        (Drive((450.0,), (4.0,), 550.0), 97780.0), (Drive((300.0, 150.0), (3.0, 7.3), 500.0), 51430.0),
        (Drive((350.0,), (5.0,), 450.0), 97780.0),
    ]  # fmt: skip
    laws = Laws(load=lambda v: 5e-5 * np.sign(v) * np.maximum(np.abs(v) - 2.19, 0.0))
    with_it, without, kept = _beside_a_rider(
        nameless_campaign(tmp_path, "stack", laws, records, rate=400.0, duration=1.0)
    )
    assert with_it.found[-1].final.model.transducer.effects[0].name == "stiffening"
    (law,) = without.found[-1].final.model.transducer.effects
    assert (law.name, kept) == ("load knee", {})
    assert law.form.knee == pytest.approx(2.19, abs=0.01)
    assert without.squares[-1][0] < 1.01 * with_it.squares[-1][0]
