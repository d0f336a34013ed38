"""Trials of laws without a name (`make discovery`): their equations, sizes, plan, how they are judged, and the page."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from piezoharvest import diagnose, load_campaign
from reports.discovery import others, trials
from reports.discovery.campaigns import KINDS, UNSEEN, Sizes, Trial, channels, make, write
from reports.discovery.equations import Drive, play, true_channels
from reports.discovery.laws import LAWS, draw
from reports.discovery.page import write_page
from reports.discovery.plan import SIGMAS, plan
from reports.discovery.summary import share


@pytest.mark.parametrize("kind", KINDS)
def test_a_specimen_without_laws_moves_as_the_matrix_exponential_has_it(kind):
    on, rate, count = KINDS[kind].nominal, 500.0, 40
    f, a, load = 48.0, 0.02, 1e5
    w = 2 * np.pi * f
    # The sine is a part of the state: x, x', v, sin, cos.
    m, b, k, T, C = on.mass, on.damping, on.stiffness, on.coupling, on.capacitance
    A = np.array([[0, 1, 0, 0, 0], [-k / m, -b / m, T / m, a / m, 0], [0, -T / C, -1 / (load * C), 0, 0],
                  [0, 0, 0, 0, w], [0, 0, 0, -w, 0]])  # fmt: skip
    state, step = np.array([0.0, 0.0, 0.0, 0.0, 1.0]), expm(A / rate)
    wanted = [state]
    for _ in range(count - 1):
        wanted.append(step @ wanted[-1])
    found = true_channels(on, Drive((a,), (f,)), load, count / rate, rate, stiff=KINDS[kind].stiff)
    for channel, column in (("displacement", 0), ("voltage", 2)):
        exact = np.array(wanted)[:, column]
        assert np.abs(found[channel] - exact).max() < 1e-5 * np.ptp(exact), channel
    assert found["current"] == pytest.approx(found["voltage"] / load)


def test_a_law_of_the_spring_is_felt_as_one():
    on = replace(KINDS["beam"].nominal, laws={"spring": lambda x: 50.0 * x})
    stiffer = replace(KINDS["beam"].nominal, stiffness=KINDS["beam"].nominal.stiffness + 50.0)
    drive = Drive((0.02,), (48.0,))
    one, other = (true_channels(each, drive, 1e5, 0.05, 2000.0, stiff=False) for each in (on, stiffer))
    assert np.abs(one["voltage"] - other["voltage"]).max() < 1e-7 * np.ptp(other["voltage"])


def test_a_backlash_follows_at_a_distance():
    assert play(np.array([0.0, 1.0, 0.5, 0.0, -2.0, -2.0]), 0.25).tolist() == [0.0, 0.75, 0.75, 0.25, -1.75, -1.75]


@pytest.mark.parametrize("name", LAWS)
def test_a_law_is_zero_at_zero_and_takes_energy_at_a_port(name):
    z = np.linspace(-1.0, 1.0, 101)
    for seed in range(5):
        of = draw(name, np.random.default_rng(seed), passive=True).of
        assert abs(of(np.zeros(1))[0]) < 1e-12
        assert np.all(z * of(z) >= 0.0)
        assert np.ptp(draw(name, np.random.default_rng(seed), passive=False).of(z)) > 0.0


@pytest.fixture
def short(monkeypatch):
    """Records of a quarter of a second, which are soon integrated."""
    for name, kind in KINDS.items():
        monkeypatch.setitem(KINDS, name, kind._replace(duration=0.25 * kind.duration))


def test_a_size_is_what_is_left_beside_all_parameters(short):
    made = make(Trial("law", "power", "spring", 40.0, 11))
    bare = replace(made, specimen=replace(made.specimen, laws={}))
    sizes = Sizes(bare)
    assert sizes.of(made.specimen) == pytest.approx(40.0, rel=0.06)
    harder = replace(bare.specimen, stiffness=bare.specimen.stiffness * 1.0001)
    whole = np.concatenate([(a[c] - b[c]) / made.kind.noise[c]
                            for a, b in zip(channels(harder, bare)[:2], channels(bare.specimen, bare)[:2], strict=True)
                            for c in ("displacement", "voltage", "current")])  # fmt: skip
    assert sizes.of(harder) < 0.01 * np.linalg.norm(whole)  # a parameter takes it


def test_the_record_by_which_all_are_judged_is_no_part_of_the_campaign(tmp_path, short):
    campaign, everything = write(make(Trial("healthy", seed=3)), tmp_path)
    assert UNSEEN not in campaign.read_text()
    assert UNSEEN in everything.read_text()


def test_held_out_seeds_are_none_that_code_may_be_changed_for_and_a_first_part_has_all_sizes():
    development, held_out = (plan(held_out=flag) for flag in (False, True))
    assert not {trial.seed for trial in development} & {trial.seed for trial in held_out}
    assert len({trial.key for trial in held_out}) == len(held_out) == 12 * 6 * 5 * 5 + 300 + 60 + 40
    first = [trial.sigma for trial in held_out[:100] if trial.kind == "law"]
    assert all(abs(first.count(sigma) - len(first) / len(SIGMAS)) <= 1 for sigma in SIGMAS)


def found(verdict, *sites, effects=(), rivals=(), alternatives=()):
    """A diagnosis as far as it is judged."""
    laws = [
        SimpleNamespace(
            place=place, gain=1.0 - 0.1 * n, law=SimpleNamespace(place=SimpleNamespace(input=of)),
            rivals=[SimpleNamespace(place=p, input=i) for p, i in rivals],
        )
        for n, (place, of) in enumerate(sites)
    ]  # fmt: skip
    named = [SimpleNamespace(effect=SimpleNamespace(name=name)) for name in effects]
    return SimpleNamespace(verdict=verdict, discovery=laws, effects=named, alternatives=alternatives)


LOAD, SPRING = ("load", "voltage"), ("spring", "displacement")
BESIDE = trials.named(Trial("pair", "knee", "load"))  # the known effect of such a pair


@pytest.mark.parametrize(
    ("kind", "answer", "outcome"),
    [("law", found("new_effect", LOAD), "right"),
     ("law", found("new_effect", SPRING), "wrong"),
     ("law", found("new_effect", SPRING, LOAD), "wrong"),
     ("law", found("new_effect", ("load", "displacement")), "wrong"),
     ("law", found("effect", effects=("leakage",)), "wrong"),
     ("law", found("effect", effects=("load_error",)), "kin"),
     ("law", found("new_effect", LOAD, effects=("leakage",)), "wrong"),
     ("law", found("ambiguous", SPRING, rivals=(LOAD,)), "among"),
     ("law", found("ambiguous", SPRING), "missed"),
     ("law", found("ambiguous", effects=("stiffening",), alternatives=(("load table",),)), "among"),
     ("law", found("ambiguous", effects=("load_error",), alternatives=(("spring table",),)), "among"),
     ("law", found("ambiguous", effects=("stiffening",), alternatives=(("coupling table",),)), "missed"),
     ("pair", found("new_effect", LOAD, effects=(BESIDE,)), "right"),
     ("pair", found("new_effect", LOAD), "wrong"),
     ("pair", found("effect", effects=("load_error", BESIDE)), "kin"),
     ("law", found("unexplained"), "missed"),
     ("law", found("adequate"), "missed"),
     ("healthy", found("adequate"), "right"),
     ("healthy", found("unexplained"), "alarm"),
     ("healthy", found("new_effect", LOAD), "wrong"),
     ("impossible", found("unexplained"), "right"),
     ("impossible", found("new_effect", LOAD), "wrong")],
)  # fmt: skip
def test_an_answer_is_judged_by_the_place_of_the_law_that_gains_most(kind, answer, outcome):
    made = SimpleNamespace(trial=Trial(kind, "knee", "load"), site=LOAD)
    assert trials.outcome_of(made, answer) == outcome


def test_a_curve_is_judged_by_its_own_band_but_for_a_straight_line_of_the_model():
    x, std = np.linspace(-1.0, 1.0, 41), np.full(41, 0.01)
    at = lambda place: SimpleNamespace(site=(place, ""), law=lambda x: x**3)  # noqa: E731
    assert trials.banded(x, x**3 + 0.02, std, at("load")) == 1.0
    assert trials.banded(x, x**3 + 0.04, std, at("load")) == 0.0
    assert trials.banded(x, x**3 + 0.3 * x, std, at("spring")) == 1.0
    assert trials.banded(x, x**3 + 0.3 * x, std, at("load")) < 0.2


@pytest.mark.skipif(not others.available(), reason="needs the packages of the extra `discovery`: pysindy, scikit-learn")
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning" if others.available() else "default")
@pytest.mark.parametrize("method", ["_sparse", "_gaussian"])
def test_other_methods_find_a_square_of_one_signal(method):
    rng = np.random.default_rng(2)
    x, far = (rng.standard_normal((n, len(others.SIGNALS))) for n in (800, 200))
    predicted, of, explained = getattr(others, method)(x, 5.0 * x[:, 1] ** 2 + rng.standard_normal(800), far)
    assert of == others.SIGNALS[1]
    assert np.std(predicted - 5.0 * far[:, 1] ** 2) < 2.0
    assert explained > 1000.0


@pytest.mark.slow
def test_a_random_expression_at_the_capacitor_is_found_there():
    result = trials.attempt(Trial("law", "expression_1", "charge", 200.0, 1030364))
    assert result["outcome"] == "right", result
    assert result["truth"]["site"] == ["capacitor", "voltage"]
    assert result["gain"] > 0.95


def test_intervals_are_exact():
    assert share([True] * 10) == {"right": 10, "count": 10, "low": pytest.approx(0.025 ** (1 / 10)), "high": 1.0}
    assert share([]) is None


def row(**changes):
    other = {name: {"right": True, "gain": 0.3} for name in ("sparse regression", "gaussian process")}
    trial = Trial("law", "fifth", "load", 40.0, 7)
    curve = {"input": [-1.0, 0.0, 1.0], "value": [-1.0, 0.0, 1.0], "std": [0.1, 0.1, 0.1]}
    return {
        "key": trial.key, **vars(trial), "outcome": "right", "right": True, "banded": 1.0, "formula_right": True,
        "inside": [True, False], "gain": 0.99, "cpu": 12.0, "power_error": [0.1, 0.001], "others": other,
        "truth": {"site": ["load", "voltage"], "size": 1.0, "strength": 1.0},
        "found": [{"place": "load", "input": "voltage", "form": "polynomial", "gain": 0.99, "curve": curve}],
    } | changes  # fmt: skip


@pytest.mark.parametrize("rows", [[], [row(), row(sigma=8.0, outcome="missed", right=False, found=[]),
                                       row(outcome="failed", right=False, error="Error: none", found=[])]])  # fmt: skip
def test_the_page_tells_what_was_run(rows, tmp_path):
    text = write_page(rows, rows, tmp_path).read_text()
    assert f"{len(rows)} {'held-out' if rows else 'development'} campaigns of a plan of 2200" in text
    assert (tmp_path / "gallery.png").exists() == bool(rows)
    if rows:
        assert "1 to 99 %" in text  # of two laws of 40 sigma, one is right
        assert "1 ended with an error" in text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "law", "place", "seed", "passed_for"),
    [("pair", "exponential", "electrodes", 1_950_101, "dielectric_relaxation"),
     # A formula of which the records tell one parameter nothing was in between here: its information is singular.
     ("pair", "langevin", "reading", 1_950_105, "coupling_drift"),
     ("law", "even_power", "spring", 1_900_081, "nonlinear_coupling")],
)  # fmt: skip
def test_a_law_that_passed_for_a_known_effect(kind, law, place, seed, passed_for, tmp_path):
    """The effect explains the campaign as far as residual tests see, and less of a record with a larger drive."""
    made = make(Trial(kind, law, place, 100.0 if kind == "pair" else 40.0, seed))
    campaign, _ = map(load_campaign, write(made, tmp_path))
    found = diagnose(campaign)
    assert [passed_for] != [named.effect.name for named in found.effects] or found.verdict == "ambiguous"
    assert trials.outcome_of(made, found) in ("right", "kin", "among")
