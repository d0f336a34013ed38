"""Parts that can be bought: the series, joint rounding against brute force, worst cases against random samples."""

import dataclasses
import json
import re
from itertools import product
from math import inf
from pathlib import Path

import numpy as np
import pytest
from pages import figures_on_the_page_only

from piezoharvest.cli.tables import print_design
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import ParallelSSHI, Rectifier, SeriesRL
from piezoharvest.description.system import System
from piezoharvest.description.tolerance import Tolerance
from piezoharvest.description.transducer import Transducer
from piezoharvest.design import design
from piezoharvest.design.parts.series import series_of
from piezoharvest.engine import simulate
from piezoharvest.linear import frequency_response
from piezoharvest.report import write_report
from piezoharvest.report.units import decibel, engineering
from piezoharvest.study import DesignOptions, Study

FORCE, BAND = 0.02, (46.0, 57.0)
BEAM = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
E12 = "1.0 1.2 1.5 1.8 2.2 2.7 3.3 3.9 4.7 5.6 6.8 8.2"
E96 = """
100 102 105 107 110 113 115 118 121 124 127 130 133 137 140 143 147 150 154 158 162 165 169 174 178 182 187 191
196 200 205 210 215 221 226 232 237 243 249 255 261 267 274 280 287 294 301 309 316 324 332 340 348 357 365 374
383 392 402 412 422 432 442 453 464 475 487 499 511 523 536 549 562 576 590 604 619 634 649 665 681 698 715 732
750 768 787 806 825 845 866 887 909 931 953 976
"""  # as printed in IEC 60063


def amplitude(transducer, shunt, frequencies):
    """Displacement (..., f) in m of one design or of a batch."""
    return FORCE * np.abs(frequency_response(System(transducer, shunt), np.asarray(frequencies)).displacement)


def power(transducer, shunt, frequency=50.6):
    return FORCE**2 * frequency_response(System(transducer, shunt), [frequency]).harvested_power[..., 0]


def height(transducer, shunt):
    """Largest displacement over the band, m, on a grid that is fine beside the width of all peaks."""
    return amplitude(transducer, shunt, np.linspace(*BAND, 221)).max(-1)


def batch(shunt, columns):
    """The shunt with columns of values by key."""
    return dataclasses.replace(shunt, **{name: np.asarray(x)[:, None] for name, x in columns.items()})


def neighbourhood(series, ideal, reach):
    """All combinations within so many steps of each ideal value, as columns."""
    sides = [[series.value(series.nearest(v) + step) for step in range(-reach, reach + 1)] for v in ideal.values()]
    return dict(zip(ideal, np.array(list(product(*sides))).T, strict=True))


def singly(series, ideal):
    """Each value rounded on its own."""
    return {name: series.value(series.nearest(value)) for name, value in ideal.items()}


class TestSeries:
    def test_values_of_the_standard(self):
        assert series_of("E96").mantissas == tuple(f"{text[0]}.{text[1:]}" for text in E96.split())
        assert series_of("E48").mantissas == series_of("E96").mantissas[::2]
        assert series_of("E192").mantissas[::2] == series_of("E96").mantissas
        assert series_of("E192").mantissas[185] == "9.20" and series_of("E192").mantissas[-1] == "9.88"
        assert series_of("E12").mantissas == tuple(E12.split())
        assert series_of("E6").mantissas == series_of("E12").mantissas[::2]
        assert series_of("E3").mantissas == ("1.0", "2.2", "4.7")

    @pytest.mark.parametrize(
        ("name", "tolerance"),
        [("E3", 0.4), ("E6", 0.2), ("E12", 0.1), ("E24", 0.05), ("E48", 0.02), ("E96", 0.01), ("E192", 0.005)],
    )
    def test_tolerances_cover_the_gaps(self, name, tolerance):
        series = series_of(name)
        assert series.tolerance == tolerance and len(series.mantissas) == int(name[1:])
        values = [series.value(n) for n in range(-len(series.mantissas), len(series.mantissas))]
        assert values == sorted(values) and len(set(values)) == len(values)

    @pytest.mark.parametrize("name", ["E3", "E24", "E96", "E192"])
    def test_numbers_and_values(self, name):
        series = series_of(name)
        for number in range(-12 * len(series.mantissas), 7 * len(series.mantissas), 1 if len(name) < 4 else 5):
            value = series.value(number)
            assert series.below(value) == series.nearest(value) == number
            assert series.below(value * 1.0001) == number and series.below(value * 0.9999) == number - 1

    def test_values_are_those_printed_on_parts(self):
        assert series_of("E24").value(-9 * 24 + 16) == 4.7e-9 and series_of("E96").value(5 * 96 + 1) == 102e3
        assert series_of("E24").nearest(9.56) == 24 and series_of("E24").nearest(9.52) == 23


@pytest.mark.parametrize("series", ["E6", "E12", "E24"])
@pytest.mark.parametrize("kind", ["series_rl", "series_rlc"])
def test_no_combination_around_is_better_at_one_frequency(host, run, kind, series):
    transducer = host(0.01, 80)
    candidate = run(transducer, 50.6, candidates=(kind,), parts=series).best
    parts = candidate.parts
    around = neighbourhood(series_of(series), parts.ideal, 8 if kind == "series_rl" else 6)
    best = power(transducer, batch(candidate.shunt, around)).max()
    one_by_one = power(transducer, dataclasses.replace(candidate.shunt, **singly(series_of(series), parts.ideal)))
    # In the flat optimum of three parts more distant combinations differ by less than parts do.
    assert candidate.harvested_power >= best * (1 - (1e-6 if kind == "series_rl" else 1e-4))
    assert candidate.harvested_power >= one_by_one * (1 - 1e-6)
    ideal = power(transducer, dataclasses.replace(candidate.shunt, **parts.ideal))
    assert parts.cost == pytest.approx(1 - candidate.harvested_power / ideal, abs=1e-6)


@pytest.mark.slow
def test_no_combination_around_is_better_in_a_band(host, run):
    """And the worst case is that of 2000 designs within the tolerance."""
    transducer = host(0.05, 60)
    found = run(transducer, 50.0, objective="damping", band=BAND, candidates=("series_rl",), parts="E12").best
    parts = found.parts
    around = neighbourhood(series_of("E12"), parts.ideal, 5)
    assert height(transducer, found.shunt) <= height(transducer, batch(found.shunt, around)).min() * (1 + 1e-4)
    ideal = height(transducer, dataclasses.replace(found.shunt, **parts.ideal))
    assert (
        parts.cost == pytest.approx(20 * np.log10(height(transducer, found.shunt) / ideal), abs=1e-3) and parts.cost > 0
    )
    rng = np.random.default_rng(1)
    spread = {n: v * rng.uniform(0.9, 1.1, 2000) for n, v in found.parts.values.items()}
    shift = 20 * np.log10(height(transducer, batch(found.shunt, spread)).max() / height(transducer, found.shunt))
    assert shift - 1e-3 <= found.parts.worst - found.attenuation_db <= shift + 0.1


@pytest.mark.slow
def test_three_parts_in_a_band(host, run):
    """A search over the 729 combinations within four steps finds none that is better by 0.1 %."""
    transducer = host(0.05, 60)
    found = run(transducer, 50.0, objective="damping", band=BAND, candidates=("parallel_rlc",), parts="E6").best
    around = neighbourhood(series_of("E6"), found.parts.ideal, 4)
    coarse = np.linspace(*BAND, 45)
    rough = amplitude(transducer, batch(found.shunt, around), coarse).max(-1)
    first = {name: x[np.argsort(rough)[:50]] for name, x in around.items()}
    assert height(transducer, found.shunt) <= height(transducer, batch(found.shunt, first)).min() * 1.001


@pytest.mark.parametrize(("kind", "gain"), [("series_rl", 1.04), ("parallel_rlc", 1.2)])
def test_joint_rounding_is_better_than_one_by_one(host, run, kind, gain):
    """Where the coil cannot be in tune more resistance pays, and where a capacitor can bring it there, another one."""
    transducer = host(0.01, 80)
    found = run(transducer, 49.5, candidates=(kind,), parts="E6").best
    alone = singly(series_of("E6"), found.parts.ideal)
    assert found.parts.values != alone
    assert found.harvested_power > gain * power(transducer, dataclasses.replace(found.shunt, **alone), 49.5)


def test_limits_hold_for_what_is_bought(host, run):
    transducer, options = host(0.1, 50), {"candidates": ("resistor", "series_rl", "rectifier")}
    free = run(transducer, 50.6, **options)
    limit = 0.6 * min(c.voltage_amplitude for c in free.candidates)
    result = run(transducer, 50.6, max_voltage=limit, max_inductance=50.0, parts="E3", **options)
    for candidate in result.candidates:
        assert candidate.feasible and candidate.voltage_amplitude <= limit
        assert getattr(candidate.shunt, "inductance", 0.0) <= 50.0


@pytest.mark.parametrize("series", ["E3", "E192"])
def test_smallest_and_largest_series(host, run, series):
    transducer = host(0.05, 60)
    found = run(transducer, 50.6, candidates=("series_rl",), parts=series).best
    values, table = found.parts.values, series_of(series)
    assert {name: getattr(found.shunt, name) for name in values} == values
    assert all(table.value(table.nearest(value)) == value for value in values.values())
    assert found.parts.tolerance == table.tolerance
    assert -1e-4 < found.parts.cost < (0.2 if series == "E3" else 1e-4)
    assert found.parts.worst < found.harvested_power


@pytest.mark.parametrize("series", ["E3", "E12"])
def test_worst_case_of_ten_thousand(host, run, series):
    """No sample is worse, and some come near."""
    transducer = host(0.02, 200)
    found = run(transducer, 50.6, candidates=("series_rl", "series_rlc"), parts=series)
    rng = np.random.default_rng(1)
    for candidate in found.candidates:
        parts = candidate.parts
        spread = {n: v * rng.uniform(1 - parts.tolerance, 1 + parts.tolerance, 10_000) for n, v in parts.values.items()}
        samples = power(transducer, batch(candidate.shunt, spread))
        assert parts.worst <= samples.min() * (1 + 1e-6)
        assert parts.worst == pytest.approx(samples.min(), rel=0.2)
        worst = dataclasses.replace(candidate.shunt, **parts.worst_values)
        assert parts.worst == pytest.approx(power(transducer, worst), rel=1e-6)
        for name, value in parts.values.items():
            assert abs(parts.worst_values[name] / value - 1) <= parts.tolerance + 1e-12


def test_worst_case_within_the_box(host, run):
    """Beside resonance a wide tolerance holds the inductance that brings the structure into resonance."""
    transducer = host(0.1, 200)
    template = SeriesRL(inductance=200.0, resistance=1e4)
    found = run(
        transducer, 47.0, objective="damping", candidates=("series_rl",), shunts=[template], parts="E12",
        parts_tolerance=0.6,
    ).best  # fmt: skip
    rng = np.random.default_rng(1)
    spread = {n: v * rng.uniform(0.4, 1.6, 10_000) for n, v in found.parts.values.items()}
    samples = amplitude(transducer, batch(found.shunt, spread), [47.0])[:, 0]
    worst = amplitude(transducer, dataclasses.replace(found.shunt, **found.parts.worst_values), [47.0])[0]
    assert worst >= samples.max() and worst == pytest.approx(samples.max(), rel=0.1)
    rise = 20 * np.log10(worst / amplitude(transducer, found.shunt, [47.0])[0])
    assert found.parts.worst - found.attenuation_db == pytest.approx(rise, abs=1e-6)
    inside = [abs(found.parts.worst_values[n] / v - 1) < 0.599 for n, v in found.parts.values.items()]
    assert any(inside)


@pytest.mark.parametrize("kind", ["rectifier", pytest.param("parallel_sshi", marks=pytest.mark.slow)])
def test_worst_case_of_a_bridge(host, run, kind):
    """Only the load is rounded and varies; what the template gives is kept."""
    transducer = host(0.05, 60)
    cls = {"rectifier": Rectifier, "parallel_sshi": ParallelSSHI}[kind]
    more = {"quality": 6.0, "inductance": 0.4} if kind == "parallel_sshi" else {}
    template = cls(load_resistance=1e5, smoothing_capacitance=1.7e-5, **more)
    found = run(transducer, 50.6, candidates=(kind,), shunts=[template], parts="E6").best
    parts = found.parts
    assert set(parts.values) == {"load_resistance"} and found.shunt.smoothing_capacitance == 1.7e-5

    def at(load):
        shunt = dataclasses.replace(found.shunt, load_resistance=load)
        return simulate(System(transducer, shunt), SineForce(amplitude=FORCE, frequency=50.6)).harvested_power

    series = series_of("E6")
    near = [series.value(series.nearest(parts.ideal["load_resistance"]) + step) for step in (-2, -1, 0, 1, 2)]
    assert found.harvested_power == pytest.approx(max(map(at, near)), rel=1e-6)
    loads = parts.values["load_resistance"] * np.random.default_rng(1).uniform(0.8, 1.2, 200)
    samples = [at(load) for load in loads]
    assert min(samples) * 0.99 < parts.worst <= min(samples) * (1 + 1e-6)


def test_hysteresis_is_judged_by_simulation(host, run):
    stops = Hysteresis(thresholds=(1e-7, 3e-7), weights=(5e6, 1.5e7))
    transducer = host(0.1, 50, hysteresis=stops)
    found = run(transducer, 50.6, candidates=("series_rl",), parts="E6").best

    def at(values):
        shunt = dataclasses.replace(found.shunt, **values)
        return simulate(System(transducer, shunt), SineForce(amplitude=FORCE, frequency=50.6)).harvested_power

    around = neighbourhood(series_of("E6"), found.parts.ideal, 2)
    each = [dict(zip(around, map(float, row), strict=True)) for row in zip(*around.values(), strict=True)]
    assert found.harvested_power >= max(map(at, each)) * (1 - 1e-4)
    rng = np.random.default_rng(1)
    samples = [at({n: v * rng.uniform(0.8, 1.2) for n, v in found.parts.values.items()}) for _ in range(150)]
    assert found.parts.worst <= min(samples) * (1 + 1e-4)


def test_json_is_the_interface(host, run):
    transducer = host(0.05, 60)
    template = Rectifier(dc_voltage=5.0)
    options = {"shunts": [template], "candidates": ("series_rl", "rectifier", "open")}
    result = run(transducer, 50.6, parts="E24", parts_tolerance=0.01, **options)
    entries = {e["shunt"]["kind"]: e for e in json.loads(json.dumps(result.as_json()))["candidates"]}
    assert entries["rectifier"]["parts"] is None and entries["open"]["parts"] is None  # no part is tuned
    parts = entries["series_rl"]["parts"]
    assert set(parts) == {"series", "ideal", "values", "cost", "tolerance", "worst_case"}
    assert parts["series"] == "E24" and parts["tolerance"] == 0.01
    assert set(parts["ideal"]) == set(parts["values"]) == {"inductance", "resistance"}
    assert parts["values"] == {name: entries["series_rl"]["shunt"][name] for name in parts["values"]}
    assert set(parts["worst_case"]) == {"harvested_power", "values", "converged"} and parts["worst_case"]["converged"]
    assert 0 < parts["worst_case"]["harvested_power"] < entries["series_rl"]["harvested_power"]
    exact = run(transducer, 50.6, parts="E24", parts_tolerance=0.0, **options).as_json()["candidates"]
    same = next(e for e in exact if e["shunt"]["kind"] == "series_rl")
    assert same["parts"]["worst_case"]["harvested_power"] == pytest.approx(same["harvested_power"], rel=1e-9)
    assert all(e["parts"] is None for e in run(transducer, 50.6, **options).as_json()["candidates"])


def test_design_that_may_not_simulate_more(host, run, monkeypatch):
    """The search ends with the budget, and says so."""
    monkeypatch.setattr("piezoharvest.design.parts.choice._SHARE", 0.0)
    found = run(host(0.05, 60), 50.6, candidates=("rectifier",), parts="E6")
    assert not found.best.parts.complete and found.best.converged
    assert any("rounding them needs more simulations" in note for note in found.notes)


@pytest.mark.parametrize("tolerance", [-0.1, 1.0, inf])
def test_tolerances_that_are_none(tolerance):
    with pytest.raises(ParameterError, match="parts_tolerance"):
        DesignOptions(parts="E24", parts_tolerance=tolerance)


def test_tolerance_without_series():
    with pytest.raises(ParameterError, match=r"parts_tolerance: found 0.05 without parts"):
        DesignOptions(parts_tolerance=0.05)


@pytest.mark.parametrize(
    ("objective", "words"),
    [("harvest", "smallest power"), pytest.param("damping", "least damping", marks=pytest.mark.slow)],
)
def test_table_and_report(host, tmp_path, capsys, objective, words):
    """Both show ideal and bought values, cost and worst case."""
    options = DesignOptions(objective=objective, candidates=("series_rl", "open"), parts="E6", parts_tolerance=0.1)
    excitation = SineForce(amplitude=FORCE, frequency=49.5)
    study = Study(
        title="", path=Path("study.toml"), transducer=host(0.01, 80), shunts=(), excitation=excitation, design=options
    )
    result = design(study)
    parts = next(c.parts for c in result.candidates if c.parts)
    with figures_on_the_page_only():
        page = write_report(study, result, tmp_path).read_text(encoding="utf-8")
    table = re.search(r'<table class="bought">.*?</table>', page, re.DOTALL)
    assert table and words in page and "E6, ±10\u202f%" in page
    assert f"<strong>{engineering(parts.values['inductance'], 'H', exact=True)}</strong>" in table[0]
    assert engineering(parts.ideal["inductance"], "H", 4) in table[0] and "open" not in table[0]
    worst = engineering(parts.worst, "W") if objective == "harvest" else decibel(parts.worst)
    assert f">{worst}<" in table[0]
    print_design("", result.as_json())
    printed = capsys.readouterr().out
    assert f"inductance = {parts.values['inductance']:g} H (ideal {parts.ideal['inductance']:.1f} H)" in printed
    assert "E6" in printed and "within" in printed


def test_what_parts_are_not_chosen_for_is_said(host, run):
    options = {"candidates": ("resistor",), "tolerance": Tolerance(stiffness=0.01), "worst_case": True}
    notes = run(host(0.1, 40), objective="trade_off", parts="E12", **options).notes
    assert any("front" in note and "E12" in note for note in notes)


@pytest.mark.parametrize(("damping", "unit", "far"), [(False, "%", "6.400"), (True, "dB", "0.06400")])
def test_gaps_have_a_unit_and_no_rounding_noise(capsys, damping, unit, far):
    rows = [
        {
            "shunt": {"kind": kind},
            "converged": True,
            "harvested_power": 1e-3,
            "attenuation_db": -3.0,
            "gap_to_bound": gap,
        }
        for kind, gap in (("series_rl", 9.4e-15), ("resistor", 0.064))
    ]
    print_design("", {"candidates": rows, "bound": {}, "trade_off": []}, damping=damping)
    lines = capsys.readouterr().out.splitlines()
    (header,) = [line for line in lines if line.startswith("candidate")]
    near, other = ([line.split()[-1] for line in lines if line.startswith(kind)] for kind in ("series_rl", "resistor"))
    assert header.split()[-2:] == [unit, "keys"] and (near, other) == (["0"], [far])


class TestWorstCase:
    """Of a tolerance, parts are chosen for the worst case: they were those of the best nominal figure."""

    @pytest.mark.parametrize(
        ("kind", "series", "reach"),
        [("series_rl", "E6", 3), ("series_rl", "E12", 5), ("resistor", "E3", 3)],
    )
    def test_no_parts_of_a_linear_shunt_have_a_better_worst_case(self, kind, series, reach):
        asked = DesignOptions(candidates=(kind,), parts=series, worst_case=True, tolerance=Tolerance(stiffness=0.05))
        study = Study(transducer=BEAM, excitation=SineForce(amplitude=FORCE, frequency=50.6), design=asked)
        result = design(study, lambda text: None)
        (found,) = result.candidates
        tried = batch(found.shunt, neighbourhood(series_of(series), found.parts.ideal, reach))
        box = BEAM.stiffness * np.linspace(0.95, 1.05, 41)
        worst = np.min([power(dataclasses.replace(BEAM, stiffness=k), tried) for k in box], axis=0)
        assert found.worst_case.figures.harvested_power == pytest.approx(worst.max(), rel=1e-6)
        assert not any("chosen for the nominal values" in note for note in result.notes)

    @pytest.mark.slow
    def test_those_of_an_inverting_circuit_are_no_worse_than_any_load_beside_them(self):
        """Chosen by the nominal power, the load lost two fifths of the worst one."""
        asked = DesignOptions(
            candidates=("parallel_sshi",), parts="E3", worst_case=True, tolerance=Tolerance(stiffness=0.05)
        )
        study = Study(transducer=BEAM, excitation=SineForce(amplitude=FORCE, frequency=50.6), design=asked)
        (found,) = design(study, lambda text: None).candidates
        loads = neighbourhood(series_of("E3"), found.parts.ideal, 2)["load_resistance"]
        corners = [dataclasses.replace(BEAM, stiffness=BEAM.stiffness * factor) for factor in (0.95, 1.05)]
        shunts = [dataclasses.replace(found.shunt, load_resistance=float(load)) for load in loads]
        worst = [min(simulate(System(c, s), study.excitation).harvested_power for c in corners) for s in shunts]
        assert found.worst_case.figures.harvested_power >= max(worst) * (1 - 1e-3)
