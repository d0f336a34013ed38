"""The front between harvested power and damping: nothing dominates it, its ends are the designs for one objective."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from piezoharvest.description.excitation import Multisine, SineForce
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.shunts import SSDI, SeriesRL
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Mode, Transducer
from piezoharvest.design.front.point import Front, FrontPoint, nondominated, overall
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import operation_of
from piezoharvest.design.tuning.region import values_at
from piezoharvest.engine import simulate_many
from piezoharvest.report import write_report
from piezoharvest.report.gallery import Gallery
from piezoharvest.study import DesignOptions, Study, build_shunt

BENCH = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
BAND = (48.0, 53.0)
PROMISE = 1e-3  # of either figure: by less a random design may be better


def beaten_by(front, power, level):
    """Largest share by which random designs are better than a point of a front in both figures."""
    p, x = (np.array([getattr(q, name) for q in front.points]) for name in ("harvested_power", "attenuation_db"))
    more, less = power[:, None] / p - 1, (x - level[:, None]) * np.log(10) / 20
    return np.max(np.minimum(more, less))


def front_of(result, kind):
    (found,) = (front for front in result.fronts if front.kind == kind)
    return found


def random_points(front, count):
    """Random values of the free fields, half of them all over and half near the front, as coordinates (n, d)."""
    rng = np.random.default_rng(3)
    logs = np.log([[getattr(p.shunt, name) for name in front.free] for p in front.points])
    low, high = logs.min(axis=0) - 1, logs.max(axis=0) + 1
    near = logs[rng.integers(len(logs), size=count // 2)]
    near = near + rng.normal(size=near.shape) * np.exp(rng.uniform(np.log(1e-3), np.log(0.3), (len(near), 1)))
    return np.vstack((rng.uniform(low, high, (count // 2, len(low))), near))


@pytest.mark.parametrize(
    ("kind", "band"),
    [
        ("series_rl", None),
        pytest.param("parallel_rl", None, marks=pytest.mark.slow),
        pytest.param("series_rl", BAND, marks=pytest.mark.slow),
    ],
)
def test_no_random_linear_design_dominates(run, kind, band):
    front = front_of(run(BENCH, 50.6, objective="trade_off", band=band, candidates=(kind,)), kind)
    assert len(front.points) > 15
    view = LinearView(
        BENCH, operation_of(SineForce(amplitude=0.02, frequency=50.6), band, BENCH), Goal(DesignOptions())
    )
    grid = np.array([50.6]) if band is None else np.linspace(*band, 401)
    power, level = [], []
    for part in np.array_split(random_points(front, 10_000), 20):
        found = view.levels(dataclasses.replace(front.points[0].shunt, **values_at(front.free, part)), grid)
        power.append(found.power)
        level.append(20 * np.log10(found.displacement.max(axis=-1) / view.shorted))
    assert beaten_by(front, np.concatenate(power), np.concatenate(level)) < PROMISE


@pytest.mark.parametrize("kind", ["rectifier", pytest.param("parallel_sshi", marks=pytest.mark.slow)])
def test_no_random_switched_design_dominates(run, kind):
    front = front_of(run(BENCH, 50.6, objective="trade_off", candidates=(kind,)), kind)
    assert len(front.points) > 15
    rng = np.random.default_rng(3)
    at = np.array([[getattr(p.shunt, name) for name in front.free] for p in front.points])
    at = at[rng.integers(len(at), size=2000)]
    loads = at[:, 0] * np.exp(rng.normal(scale=0.2, size=len(at)))
    more = {"load_resistance": loads[:, None], "smoothing_capacitance": 100 / 50.6 / loads[:, None]}
    if kind == "parallel_sshi":
        more["phase_lag"] = (at[:, 1] + rng.normal(scale=0.1, size=len(at)))[:, None]
    shunt = dataclasses.replace(front.points[0].shunt, **more)
    found = simulate_many(System(BENCH, shunt), SineForce(amplitude=0.02, frequency=50.6), len(at))
    trusted = found["converged"] > 0
    assert np.mean(trusted) > 0.99
    assert beaten_by(front, found["harvested_power"][trusted], found["attenuation_db"][trusted]) < PROMISE


@pytest.mark.parametrize("band", [None, pytest.param((49.0, 52.0), marks=pytest.mark.slow)])
def test_ends_are_the_designs_for_one_objective(run, band):
    kind = "series_rl"
    result = run(BENCH, 50.6, objective="trade_off", band=band, candidates=(kind,))
    first, *_, last = front_of(result, kind).points
    harvest = run(BENCH, 50.6, objective="harvest", band=band, candidates=(kind,)).best
    damping = run(BENCH, 50.6, objective="damping", band=band, candidates=(kind,)).best
    assert first.harvested_power == pytest.approx(harvest.harvested_power, rel=1e-3)
    assert first.attenuation_db == pytest.approx(harvest.attenuation_db, abs=0.01)
    assert last.attenuation_db == pytest.approx(damping.attenuation_db, abs=0.01)
    assert result.best.shunt == harvest.shunt


@pytest.mark.slow
def test_one_part_varies_between_the_ends(run):
    result = run(BENCH, 50.6, objective="trade_off", candidates=("resistor", "rectifier"))
    for kind in ("resistor", "rectifier"):
        front = front_of(result, kind)
        damping = run(BENCH, 50.6, objective="damping", candidates=(kind,)).best
        assert front.points[0].harvested_power == pytest.approx(
            next(c.harvested_power for c in result.candidates if c.shunt.kind == kind), rel=1e-4
        )
        assert front.points[-1].attenuation_db == pytest.approx(damping.attenuation_db, abs=0.01)


def test_json_and_order(run):
    result = run(BENCH, 50.6, objective="trade_off", candidates=("series_rl", "rectifier", "ssdi", "short"))
    data = json.loads(json.dumps(result.as_json(), allow_nan=False))
    for point in data["trade_off"]:
        assert set(point) == {"kind", "shunt", "harvested_power", "attenuation_db"}
        assert build_shunt(point["shunt"]).kind == point["kind"]
    powers, levels = zip(*((p["harvested_power"], p["attenuation_db"]) for p in data["trade_off"]), strict=True)
    assert list(powers) == sorted(powers, reverse=True) and list(levels) == sorted(levels, reverse=True)
    assert {front["kind"] for front in data["fronts"]} == {"series_rl", "rectifier", "ssdi", "short"}
    ranked = [c["harvested_power"] for c in data["candidates"]]
    assert ranked == sorted(ranked, reverse=True)
    # What harvests nothing is a point.
    for kind in ("ssdi", "short"):
        (point,) = front_of(result, kind).points
        assert point.harvested_power == 0
    bound = data["bound"]
    assert max(powers) <= bound["harvested_power"] * (1 + 1e-6)


def test_lag_of_what_harvests_nothing_is_tuned_for_damping(run):
    template = SSDI(quality=6.0, flip_time=4e-4)
    free = run(BENCH, 50.6, objective="trade_off", phase_lag="free", candidates=("ssdi",), shunts=[template])
    fixed = run(BENCH, 50.6, objective="trade_off", candidates=("ssdi",), shunts=[template])
    assert free.best.attenuation_db <= fixed.best.attenuation_db + 1e-3


@pytest.mark.slow
def test_hysteresis(run):
    host = dataclasses.replace(BENCH, hysteresis=Hysteresis(thresholds=(1e-7, 3e-7), weights=(5e5, 1.5e6)))
    result = run(host, 50.6, objective="trade_off", candidates=("series_rl",))
    front = front_of(result, "series_rl")
    assert len(front.points) > 15
    point = front.points[len(front.points) // 2]
    excitation = SineForce(amplitude=0.02, frequency=50.6)
    values = {name: getattr(point.shunt, name) * np.ones((1, 1)) for name in front.free}
    shunt = dataclasses.replace(point.shunt, **values)
    again = simulate_many(System(host, shunt), excitation, 1)
    assert point.harvested_power == pytest.approx(float(again["harvested_power"][0]), rel=1e-5)
    assert point.attenuation_db == pytest.approx(float(again["attenuation_db"][0]), abs=1e-3)


@pytest.mark.slow
def test_limits_cut_the_front(run):
    kinds = {"objective": "trade_off", "candidates": ("series_rl", "rectifier")}
    result = run(BENCH, 50.6, **kinds, min_power=3e-4, min_attenuation_db=4.0)
    points = result.trade_off
    assert len(points) > 5
    assert all(p.harvested_power >= 3e-4 and p.attenuation_db <= -4.0 for p in points)
    assert {p.shunt.kind for p in points} == {"series_rl"}  # a rectifier damps too little
    assert any(note.startswith("rectifier") and "front" in note for note in result.notes)


def test_limits_that_nothing_keeps(run):
    result = run(BENCH, 50.6, objective="trade_off", candidates=("series_rl",), min_power=1.0)
    assert result.trade_off == () and result.as_json()["trade_off"] == []
    assert result.notes[0] == "no candidate meets all limits"


def point(power, level):
    return FrontPoint(SeriesRL(inductance=1.0, resistance=1.0), power, level)


def test_dominance():
    assert nondominated([1, 2, 3, 3], [-5, -4, -4, -3]) == [2, 0]
    front = Front.of("series_rl", ("resistance",), [point(1.0, -1.0), point(0.5, -10.0), point(0.4, -9.0)])
    assert [p.harvested_power for p in front.points] == [1.0, 0.5]
    # Interpolated from point to point, constant below, nothing beyond.
    assert front.attenuation_at(0.1) == -10.0 and front.attenuation_at(1.1) == np.inf
    assert -10.0 < front.attenuation_at(0.75) < -1.0


def test_fewer_parts_stand_where_kinds_tie():
    simple = Front("resistor", ("resistance",), (point(1.0, -1.0), point(0.5, -10.0)))
    same = Front("series_rl", ("inductance", "resistance"), (point(1.0, -1.0), point(0.5, -10.0)))
    better = Front("series_rlc", ("a", "b", "c"), (point(0.6, -12.0),))
    assert overall([same, simple]) == simple.points
    assert overall([better, simple]) == (simple.points[0], better.points[0])
    assert overall([]) == ()


def test_report_shows_front_and_table(run, tmp_path, monkeypatch):
    monkeypatch.setattr(Gallery, "pictures", Gallery._front)  # the others have tests of their own
    options = DesignOptions(objective="trade_off", candidates=("resistor", "rectifier", "ssdi"))
    excitation, path = SineForce(amplitude=0.02, frequency=50.6), Path("study.toml")
    study = Study(title="", path=path, transducer=BENCH, shunts=(), excitation=excitation, design=options)
    result = run(BENCH, 50.6, objective="trade_off", candidates=options.candidates)
    page = write_report(study, result, tmp_path).read_text(encoding="utf-8")
    assert (tmp_path / "trade-off.png").stat().st_size > 1000
    section = page[page.index('<section id="trade-off">') :]
    section = section[: section.index("</section>")]
    assert 'id="figure-trade-off"' in section and section.count('<tr data-kind="resistor"') > 10
    assert "Fronts of all kinds" in section and '<tr data-kind="ssdi"' in section
    without = write_report(study, dataclasses.replace(result, fronts=()), tmp_path / "other")
    assert "trade-off" not in without.read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_branch_for_each_of_two_modes(run):
    second = Mode(mass=0.01, stiffness=9 * 986.96, damping=0.06, coupling=2e-3)
    tones = Multisine(amplitudes=(0.02, 0.02), frequencies=(50.0, 151.0), phases=(0.0, 0.5), duration=1.0)
    transducer = dataclasses.replace(BENCH, modes=(second,))
    found = front_of(
        run(transducer, excitation=tones, objective="trade_off", candidates=("parallel_branches",)), "parallel_branches"
    )
    assert len(found.points) > 5
    assert all(len(point.shunt.inductances) == 2 for point in found.points)
