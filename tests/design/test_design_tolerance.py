"""Tolerances of a design: keys and files, worst cases against brute force, certificates, tuning for the worst case."""

import dataclasses
import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from piezoharvest.cli.tables import print_design
from piezoharvest.description.excitation import SineBase, SineForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import (
    SECE,
    SSDI,
    NegativeCapacitance,
    Network,
    ParallelBranches,
    ParallelRL,
    ParallelSSHI,
    Rectifier,
    Resistor,
    SeriesRL,
    SeriesRLC,
)
from piezoharvest.description.system import System
from piezoharvest.description.tolerance import Tolerance
from piezoharvest.description.transducer import Mode
from piezoharvest.design import design
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import operation_of
from piezoharvest.design.parts.worst_case import WorstCase, objective_of
from piezoharvest.design.robust.box import Box
from piezoharvest.design.robust.certificate.enclosure import Enclosure
from piezoharvest.design.robust.certificate.forms import AffineForm
from piezoharvest.design.robust.certificate.search import GAP, certify
from piezoharvest.design.robust.space import ToleranceSpace
from piezoharvest.design.robust.specimen import region_of
from piezoharvest.engine import simulate
from piezoharvest.engine.work_limit import Budget
from piezoharvest.linear import frequency_response
from piezoharvest.report import write_report
from piezoharvest.report.subjects import subjects_of
from piezoharvest.report.tolerance.worst_cases import worst_case_text, worst_cases
from piezoharvest.specimen import Specimen, write_specimen
from piezoharvest.study import DesignOptions, Study, study_from

FORCE, FREQUENCY, BAND = 0.02, 50.6, (46.0, 57.0)
THREE = {"stiffness": 0.05, "capacitance": 0.1, "load": 0.05}


def scaled(transducer, factors):
    """The transducer with factors of its quantities, each a number or a column: written without the box."""
    values = {n: getattr(transducer, n) * np.asarray(f)[..., None] for n, f in factors.items()}
    return dataclasses.replace(transducer, **{n: x.item() if x.size == 1 else x for n, x in values.items()})


def drawn(widths, count, seed=1):
    """Random factors by name within half-widths, uniform."""
    rng = np.random.default_rng(seed)
    return {name: 1 + width * rng.uniform(-1, 1, count) for name, width in widths.items()}


def powers(transducer, shunt, factors, frequency=FREQUENCY):
    """Power (n,) in W at random points of three tolerances."""
    load = shunt.resistance * np.asarray(factors["load"])[:, None]
    rest = {n: f for n, f in factors.items() if n != "load"}
    system = System(scaled(transducer, rest), dataclasses.replace(shunt, resistance=load))
    return FORCE**2 * frequency_response(system, [frequency]).harvested_power[:, 0]


def space_of(transducer, shunt, tolerance, *, objective="harvest", band=None, excitation=None, exact=True, **limits):
    goal = Goal(DesignOptions(objective=objective, band=band, **limits))
    excitation = excitation or SineForce(amplitude=FORCE, frequency=FREQUENCY)
    view = LinearView(transducer, operation_of(excitation, band, transducer), goal)
    view = dataclasses.replace(view, reference=view.shorted)
    return ToleranceSpace(Box.of(Tolerance(**tolerance), shunt, view.operation), view, shunt, exact, Budget(10**11))


TABLES = {
    "transducer": {"mass": 0.01, "damping": 0.06, "stiffness": 987.0, "coupling": 1e-3, "capacitance": 40e-9},
    "excitation": {"kind": "sine_force", "amplitude": 0.02, "frequency": 50.6},
}


class TestKeys:
    def options(self, tolerance, **more):
        return study_from({**TABLES, "design": {"tolerance": tolerance, **more}}, Path("dir/study.toml")).design

    def test_half_widths(self):
        found = self.options({"stiffness": 0.05, "load_resistance": 0.1, "mass": 0.0}, worst_case=True)
        assert found.worst_case and found.tolerance.widths == {"stiffness": 0.05, "load": 0.1}
        assert self.options({"from": "specimen.toml"}).tolerance.from_ == str(Path("dir/specimen.toml"))

    @pytest.mark.parametrize(
        ("table", "key", "words"),
        [
            ({"stifness": 0.1}, "stifness", "did you mean 'stiffness'"),
            ({"stiffness": -0.1}, "stiffness", "found -0.1, must be a finite number at least 0 and less than 1"),
            ({"mass": 1.0}, "mass", "less than 1"),
            ({}, "stiffness", "at least one half-width or from"),
            ({"load": 0.1, "load_resistance": 0.1}, "load_resistance", "together with load"),
            ({"temperature": 40.0}, "temperature", "temperature_coefficient_capacitance"),
            ({"temperature_coefficient_capacitance": 0.004}, "temperature", "missing key"),
            (
                {"temperature": 40.0, "temperature_coefficient_stiffness": -0.03},
                "temperature_coefficient_stiffness",
                "less than one over that temperature",
            ),
        ],
    )
    def test_errors_name_the_key(self, table, key, words):
        with pytest.raises(ParameterError) as error:
            self.options(table)
        assert error.value.key == f"design.tolerance.{key}" and words in error.value.message

    def test_worst_case_needs_a_tolerance(self):
        with pytest.raises(ParameterError, match=r"worst_case: found true without a tolerance"):
            DesignOptions(worst_case=True)

    def test_a_band_holds_its_frequencies(self, host, run):
        with pytest.raises(ParameterError, match=r"design.tolerance.frequency: found 0.01 with a band"):
            run(host(0.05, 60), candidates=("resistor",), band=BAND, tolerance=Tolerance(frequency=0.01))


ESTIMATES = {"stiffness": (1000.0, 10.0), "capacitance": (4e-8, 1e-9)}


def _line(pair):
    return f"{pair[0]} = {pair[1]}"


class TestSpecimen:
    def file(self, tmp_path, name, parameters):
        path = tmp_path / name
        if path.suffix == ".json":
            path.write_text(json.dumps({"parameters": parameters}))
        else:
            rows = [line for n, row in parameters.items() for line in (f'[parameters."{n}"]', *map(_line, row.items()))]
            path.write_text("\n".join(rows))
        return Tolerance(from_=str(path))

    @pytest.mark.parametrize("name", ["specimen.toml", "specimen.json"])
    def test_region_without_correlations(self, tmp_path, name):
        """Semi-axes of 95 % for two quantities: sqrt(-2 ln 0.05) standard errors."""
        rows = {n: {"value": v, "std": s} for n, (v, s) in ESTIMATES.items()}
        tolerance = self.file(tmp_path, name, {**rows, "hysteresis threshold 1": {"value": 1e-7, "std": 1e-9}})
        region = region_of(tolerance)
        assert region.names == ("stiffness", "capacitance")
        wanted = -2 * np.log(0.05) * np.diag([0.01**2, 0.025**2])
        assert region.spread @ region.spread.T == pytest.approx(wanted, rel=1e-12)
        assert region_of(dataclasses.replace(tolerance, stiffness=0.3)).names == ("capacitance",)
        wider = region_of(dataclasses.replace(tolerance, level=0.99))
        assert wider.radius == pytest.approx(np.sqrt(-2 * np.log(0.01)))

    def test_draws_are_those_of_the_gaussian_within_it(self, tmp_path):
        rows = {n: {"value": v, "std": s} for n, (v, s) in ESTIMATES.items()}
        region = region_of(self.file(tmp_path, "specimen.toml", rows))
        points = region.drawn(np.random.default_rng(3), 20000)
        assert np.all(np.sum(points**2, axis=1) <= 1)
        # Share of the inner half: P(r^2 < radius^2/4) / 0.95 of chi-square with two degrees of freedom.
        inner = -np.expm1(-(region.radius**2) / 8) / 0.95
        assert np.mean(np.sum(points**2, axis=1) < 0.25) == pytest.approx(inner, abs=0.015)

    @pytest.mark.parametrize(
        ("row", "words"),
        [
            ({"value": 1000.0}, "specimen.toml has no standard error of stiffness"),
            ({"value": 1000.0, "std": -1.0}, r"parameters.stiffness: found -1.0"),
            ({"value": 1000.0, "std": 600.0}, "leaves stiffness open"),
            ({"value": 0.0, "std": 1.0}, "has 0.0 as stiffness"),
        ],
    )
    def test_files_that_lack_something(self, tmp_path, row, words):
        with pytest.raises(ParameterError, match=f"design.tolerance.from: .*{words}"):
            region_of(self.file(tmp_path, "specimen.toml", {"stiffness": row}))

    def test_files_that_are_none(self, tmp_path):
        with pytest.raises(ParameterError, match=r"absent.toml: .*cannot be read"):
            region_of(Tolerance(from_=str(tmp_path / "absent.toml")))
        with pytest.raises(ParameterError, match=r"holds none of stiffness"):
            region_of(self.file(tmp_path, "specimen.json", {}))
        with pytest.raises(ParameterError, match=r"level: found 0.9 without from"):
            Tolerance(stiffness=0.1, level=0.9)

    def test_design_with_correlations(self, tmp_path, host, run):
        """The worst case is that of a million points on the ellipsoid, by the closed form; far from that of a box."""
        transducer = host(0.05, 60)
        names, errors = ("stiffness", "mass", "capacitance"), np.array([0.02, 0.02, 0.05])
        values = np.array([getattr(transducer, name) for name in names])
        # The resonance is known ten times as well as stiffness and mass.
        correlation = np.array([[1.0, 0.99, 0.0], [0.99, 1.0, 0.0], [0.0, 0.0, 1.0]])
        covariance = correlation * np.outer(errors * values, errors * values)
        path = tmp_path / "specimen.toml"
        specimen = Specimen(dict(zip(names, values, strict=True)), covariance, ("linear",) * 3, transducer)
        write_specimen(specimen, path)
        options = {"candidates": ("resistor",), "tolerance": Tolerance(from_=str(path))}
        candidate = run(transducer, FREQUENCY, **options).best
        case, resistance = candidate.worst_case, candidate.shunt.resistance
        directions = np.random.default_rng(1).standard_normal((1_000_000, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        root = np.linalg.cholesky(correlation * np.outer(errors, errors))
        k, m, c = (values * (1 + np.sqrt(chi2.ppf(0.95, 3)) * directions @ root.T)).T
        power = _resistor_power(k, m, c, transducer, resistance)
        assert case.worst == pytest.approx(power.min(), rel=2e-3) and case.worst <= power.min() * (1 + 1e-9)
        assert case.certified <= case.worst and case.gap < 0.05
        assert set(case.corner) == set(names)
        deviations = np.array([case.corner[name] for name in names])
        assert deviations @ np.linalg.solve(root @ root.T, deviations) <= chi2.ppf(0.95, 3) * (1 + 1e-9)
        box = Tolerance(stiffness=0.04, mass=0.04, capacitance=0.1)
        assert run(transducer, FREQUENCY, **{**options, "tolerance": box}).best.worst_case.worst < 0.7 * case.worst


def _resistor_power(k, m, c, transducer, resistance):
    """Mean power in a resistor: (F^2/2) |w T R / ((k - m w^2 + j w b)(1 + j w R C) + j w R T^2)|^2 / R."""
    w, coupling = 2 * np.pi * FREQUENCY, transducer.coupling
    moving = (k - m * w**2 + 1j * w * transducer.damping) * (1 + 1j * w * resistance * c)
    voltage = w * coupling * resistance / np.abs(moving + 1j * w * resistance * coupling**2)
    return 0.5 * FORCE**2 * voltage**2 / resistance


class TestBox:
    def test_deviations_multiply(self, host):
        transducer = host(0.05, 60, modes=(Mode(mass=0.02, damping=0.1, stiffness=5e4, coupling=1e-4),))
        tolerance = {
            "stiffness": 0.1, "capacitance": 0.2, "temperature": 40.0, "temperature_coefficient_capacitance": 0.004,
            "temperature_coefficient_coupling": -0.001,
        }  # fmt: skip
        space = space_of(transducer, Resistor(resistance=1e5), tolerance)
        assert space.box.names == ("stiffness", "capacitance", "temperature")
        moved = space.box.transducer(transducer, np.array([0.1, -0.2, 40.0]))
        assert moved.capacitance == pytest.approx(0.8 * 1.16 * transducer.capacitance, rel=1e-14)
        assert moved.coupling == pytest.approx(0.96 * transducer.coupling, rel=1e-14)
        assert moved.modes[0].stiffness == pytest.approx(1.1 * 5e4) and moved.modes[0].coupling == pytest.approx(9.6e-5)
        assert moved.mass == transducer.mass

    def test_a_switched_loop_stays_as_it_was_made(self, host):
        """Its coil, its resistance and its on time are those chosen for the nominal capacitance."""
        transducer, shunt = host(0.05, 60), ParallelSSHI(
            load_resistance=3e5, smoothing_capacitance=1e-5, quality=6.0, inductance=0.4, on_time_error=0.02
        )  # fmt: skip
        space = space_of(transducer, shunt, {"capacitance": 0.2})
        for deviation in (-0.2, 0.1):
            point = np.array([deviation])
            moved, actual = space.shunt_at(point), transducer.capacitance * (1 + deviation)
            assert moved.loop(actual) == pytest.approx(shunt.loop(transducer.capacitance), rel=1e-12)
            assert moved.on_time(actual) == pytest.approx(shunt.on_time(transducer.capacitance), rel=1e-12)

    @pytest.mark.parametrize(
        ("shunt", "objective"),
        [
            (ParallelSSHI(load_resistance=3e5, smoothing_capacitance=1e-5, quality=6.0, inductance=0.4), "harvest"),
            (SSDI(quality=6.0, flip_time=4e-4), "damping"),
            (SECE(phase_lag=-0.2), "harvest"),
        ],
    )
    def test_slopes_by_simulation(self, host, shunt, objective):
        tolerance = {
            "stiffness": 0.05, "mass": 0.05, "damping": 0.2, "coupling": 0.1, "capacitance": 0.1, "load": 0.1,
            "frequency": 0.01, "temperature": 20.0, "temperature_coefficient_capacitance": 0.004,
        }  # fmt: skip
        modes = (Mode(mass=0.02, damping=0.1, stiffness=5e4, coupling=1e-4),)
        space = space_of(host(0.05, 60, modes=modes), shunt, tolerance, objective=objective, exact=False)
        point = 0.3 * space.box.widths
        _, slopes = space.tangent(point)
        name = "harvested_power" if objective == "harvest" else "displacement_amplitude"
        for n, width in enumerate(space.box.widths):
            step = np.zeros(len(point))
            step[n] = 1e-3 * width
            ahead, behind = (np.log(getattr(space.figures(point + s), name)) for s in (step, -step))
            by_difference = (ahead - behind) / (2 * step[n])
            assert getattr(slopes, name)[n] == pytest.approx(by_difference, rel=2e-3, abs=1e-4 / width)


class TestForms:
    """Products, inverses and solutions hold what they enclose, and err by the square of the box."""

    @pytest.mark.parametrize("radius", [0.02, 0.3])
    def test_enclosures_hold(self, radius):
        rng = np.random.default_rng(1)
        centre, half = rng.uniform(0.8, 1.2, (5, 3)), np.full((5, 3), radius)
        x, y, z = (AffineForm.coordinate(centre, half, n) for n in range(3))
        formed = [x * y * z + x * (1 + 2j), (x * y).inverse() * z, (x + 1j * y).real_product(z * 1j + x)]
        for u in rng.uniform(-1, 1, (200, 3)):
            a, b, c = (centre + u * half).T
            true = [a * b * c + a * (1 + 2j), c / (a * b), np.real((a + 1j * b) * np.conj(c * 1j + a))]
            for form, value in zip(formed, true, strict=True):
                inside = np.abs(value - form.value - form.slope @ u) <= form.rest + 1e-14
                assert np.all(inside)
                assert np.all(np.abs(value) <= form.largest() + 1e-14)
            assert np.all(true[2] >= formed[2].least() - 1e-14)

    def test_rest_falls_with_the_square(self):
        rests = []
        for radius in (0.1, 0.01):
            x = AffineForm.coordinate(np.ones((1, 1)), np.full((1, 1), radius), 0)
            rests.append(float((x * x).inverse().rest[0]))
        assert 80 < rests[0] / rests[1] < 200


BRANCH = "R1 1 2 1e4\nL1 2 3 200\nR2 3 0 3e4 load\nC1 1 0 2e-8"
CIRCUITS = [
    Resistor(resistance=8e4), SeriesRL(inductance=250.0, resistance=2e4), ParallelRL(inductance=250.0, resistance=4e5),
    SeriesRLC(inductance=270.0, resistance=2e4, capacitance=4e-7), Network(netlist=BRANCH),
]  # fmt: skip


PAIRS = [
    *((case, shunt) for case in ("harvest", "damping") for shunt in CIRCUITS), ("harvest in a band", CIRCUITS[1]),
    ("damping in a band", CIRCUITS[1]), ("damping in a band", CIRCUITS[4]),
    ("base", CIRCUITS[0]), ("base", CIRCUITS[3]),
]  # fmt: skip


@pytest.mark.parametrize(("case", "shunt"), PAIRS, ids=[f"{case}, {shunt.kind}" for case, shunt in PAIRS])
def test_certificate_holds_for_random_samples(host, shunt, case):
    """No sample of the box is worse than the certified value, which is near to the worst found."""
    modes = (Mode(mass=0.02, damping=0.2, stiffness=4e4, coupling=5e-4, force_participation=0.5),)
    tolerance = {"stiffness": 0.03, "capacitance": 0.1, "load": 0.05}
    tolerance |= {"temperature": 30.0, "temperature_coefficient_coupling": -0.001} if case == "base" else {}
    space = space_of(
        host(0.05, 60, modes=modes), shunt, tolerance, objective="harvest" if case[0] == "h" else "damping",
        band=BAND if "band" in case else None,
        excitation=SineBase(amplitude=0.5, frequency=50.6) if case == "base" else None,
    )  # fmt: skip
    goal = space.nominal.goal
    search = WorstCase(space, objective_of(goal), lambda: True)
    search.run()
    sign = 1 if goal.damping else -1
    found = certify(Enclosure(space.nominal, shunt, space.box), float(np.exp(sign * search.worst)))
    certified = sign * np.log(found.certified)
    count = 10_000 if "band" not in case else 300
    points = np.random.default_rng(2).uniform(-1, 1, (count, len(space.box.names))) * space.box.widths
    samples = [goal.score(f) for f in space.sampled(points)]
    assert max(samples) <= certified and max(samples) <= search.worst + 1e-9
    assert search.worst <= certified <= search.worst + (GAP if case != "harvest in a band" else 0.05) + 1e-12


@pytest.mark.parametrize("shunt", CIRCUITS[:2], ids=lambda shunt: shunt.kind)
def test_worst_case_at_one_frequency_of_a_grid(host, run, shunt):
    """Of 21 values of each quantity, computed without the box."""
    transducer = host(0.05, 60)
    options = {"shunts": [shunt], "hold": ("inductance", "resistance")}
    found = run(transducer, FREQUENCY, candidates=(shunt.kind,), tolerance=Tolerance(**THREE), **options).best
    case = found.worst_case
    grid = np.array(list(product(*(np.linspace(1 - w, 1 + w, 21) for w in THREE.values())))).T
    values = powers(transducer, shunt, dict(zip(THREE, grid, strict=True)))
    assert case.worst <= values.min() * (1 + 1e-9) and case.worst == pytest.approx(values.min(), rel=1e-3)
    at = {name: np.array([1 + case.corner[name]]) for name in THREE}
    assert powers(transducer, shunt, at)[0] == pytest.approx(case.worst, rel=1e-9)
    assert case.certified <= values.min() and 0 <= case.gap <= 1.1 * GAP and case.converged and not case.samples
    assert found.shunt == shunt and case.nominal_cost == 0


def test_frequency_may_vary(host, run):
    """A worst case within the box: the resonance is on one of the frequencies."""
    transducer, shunt = host(0.05, 60), Resistor(resistance=1e3)
    options = {"candidates": ("resistor",), "shunts": [shunt], "hold": ("resistance",), "objective": "damping"}
    case = run(transducer, 50.6, tolerance=Tolerance(frequency=0.03), **options).best.worst_case
    frequencies = 50.6 * np.linspace(0.97, 1.03, 4001)
    levels = FORCE * np.abs(frequency_response(System(transducer, shunt), frequencies).displacement)
    assert case.figures.displacement_amplitude == pytest.approx(levels.max(), rel=1e-6)
    assert abs(case.corner["frequency"]) < 0.0299
    shorted = FORCE * abs(frequency_response(System(transducer), [50.6]).displacement[0])
    assert case.worst == pytest.approx(20 * np.log10(levels.max() / shorted), abs=1e-4) and case.certified > case.worst


def test_without_width_it_is_the_nominal_design(host, run):
    transducer, options = host(0.05, 60), {"candidates": ("series_rl", "rectifier"), "phase_lag": "fixed"}
    plain = run(transducer, FREQUENCY, **options)
    exact = run(transducer, FREQUENCY, tolerance=Tolerance(stiffness=0.0), worst_case=True, **options)
    for before, after in zip(plain.candidates, exact.candidates, strict=True):
        case = after.worst_case
        assert after.shunt == before.shunt and case.corner == {} and case.nominal_cost == 0
        assert case.worst == pytest.approx(after.harvested_power, rel=1e-6)
        assert case.gap in (None, 0.0)


@pytest.mark.slow
def test_best_in_the_worst_case_in_a_band(host, run):
    """Its worst case is better than the nominal design's, and than that of 60 designs around it."""
    transducer, tolerance = host(0.05, 60), Tolerance(stiffness=0.03, capacitance=0.1)
    options = {"objective": "damping", "band": BAND, "candidates": ("series_rl",), "tolerance": tolerance}
    nominal, robust = (run(transducer, 50.0, worst_case=w, **options).best for w in (False, True))
    assert robust.worst_case.worst < nominal.worst_case.worst - 0.1
    assert robust.attenuation_db - nominal.attenuation_db == pytest.approx(robust.worst_case.nominal_cost, abs=2e-3)
    assert robust.worst_case.nominal_cost > 0 and "points of the box" in robust.method
    assert robust.worst_case.certified <= robust.worst_case.worst + 0.01
    corners = np.array([(a, b) for a, b in product((-1, 1), repeat=2)]) * [0.03, 0.1] + 1
    rng, grid = np.random.default_rng(1), np.linspace(*BAND, 111)
    inductance, resistance = (
        v * np.exp(rng.uniform(-0.1, 0.1, 60)) for v in (robust.shunt.inductance, robust.shunt.resistance)
    )
    batch = SeriesRL(inductance=inductance[:, None], resistance=resistance[:, None])
    worst = np.zeros(60)
    for stiffness, capacitance in corners:
        moved = scaled(transducer, {"stiffness": [stiffness], "capacitance": [capacitance]})
        levels = np.abs(frequency_response(System(moved, batch), grid).displacement).max(-1)
        worst = np.maximum(worst, FORCE * levels)
    # Of the grid's frequencies, and of the corners only, so that these are too good if anything.
    assert robust.worst_case.figures.displacement_amplitude <= worst.min() * 1.001


def test_best_in_the_worst_case_at_one_frequency(host, run):
    """Compared with every resistance of a fine grid: the worst of two corners has a kink there."""
    transducer, tolerance = host(0.05, 60), Tolerance(**THREE)
    options = {"candidates": ("resistor",), "tolerance": tolerance}
    nominal, robust = (run(transducer, FREQUENCY, worst_case=w, **options).best for w in (False, True))
    corners = {n: np.array(x) for n, x in zip(THREE, np.array(list(product((-1, 1), repeat=3))).T, strict=True)}
    factors = {n: 1 + THREE[n] * x for n, x in corners.items()}
    loads = robust.shunt.resistance * np.linspace(0.8, 1.25, 400)
    best = max(powers(transducer, Resistor(resistance=float(r)), factors).min() for r in loads)
    assert robust.worst_case.worst >= best * (1 - 1e-5)
    assert robust.worst_case.worst > nominal.worst_case.worst
    assert robust.harvested_power < nominal.harvested_power


@pytest.mark.parametrize("kind", ["rectifier", "sece"])
def test_worst_case_of_a_switched_circuit(host, run, monkeypatch, kind):
    """No sample is worse, simulated one by one or in the design's own batches."""
    monkeypatch.setattr("piezoharvest.design.robust.robustness._SAMPLES", 400)
    transducer, widths = host(0.05, 60), {"stiffness": 0.04, "capacitance": 0.1}
    template = {"rectifier": Rectifier(load_resistance=1.2e5, smoothing_capacitance=1.7e-5), "sece": SECE()}[kind]
    options = {"shunts": [template], "hold": ("load_resistance", "phase_lag"), "candidates": (kind,)}
    case = run(transducer, FREQUENCY, tolerance=Tolerance(**widths), **options).best.worst_case
    factors = drawn(widths, 40)
    excitation, samples = SineForce(amplitude=FORCE, frequency=FREQUENCY), []
    for n in range(40):
        moved = scaled(transducer, {name: [f[n]] for name, f in factors.items()})
        samples.append(simulate(System(moved, template), excitation, samples=1).harvested_power)
    assert case.worst <= min(samples) * (1 + 1e-6) and case.worst == pytest.approx(min(samples), rel=0.15)
    assert case.samples == 400 and case.worst <= case.sampled * (1 + 1e-6)
    assert case.certified is None and case.converged


def test_switched_circuit_for_its_worst_case(host, run, monkeypatch):
    """The lag and the worst stiffness trade; a grid of lags finds nothing better in the corners."""
    monkeypatch.setattr("piezoharvest.design.robust.robustness._SAMPLES", 200)
    transducer, options = host(0.05, 60), {"candidates": ("sece",), "tolerance": Tolerance(stiffness=0.04)}
    nominal, robust = (run(transducer, FREQUENCY, worst_case=w, **options).best for w in (False, True))
    assert robust.worst_case.worst > 1.1 * nominal.worst_case.worst
    assert robust.harvested_power < nominal.harvested_power
    assert robust.worst_case.nominal_cost == pytest.approx(
        1 - robust.harvested_power / nominal.harvested_power, abs=1e-4
    )
    excitation = SineForce(amplitude=FORCE, frequency=FREQUENCY)
    corners = [scaled(transducer, {"stiffness": [f]}) for f in (0.96, 1.04)]
    for lag in robust.shunt.phase_lag + np.linspace(-0.1, 0.1, 9):
        both = [simulate(System(t, SECE(phase_lag=float(lag))), excitation, samples=1) for t in corners]
        assert min(r.harvested_power for r in both) <= robust.worst_case.worst * (1 + 1e-3)


def test_limits_in_the_worst_corner(host, run):
    """A limit that holds in the middle breaks in a corner, is named, and is kept by the design for the worst case."""
    transducer, tolerance = host(0.05, 60), Tolerance(stiffness=0.02, capacitance=0.05)
    free = run(transducer, FREQUENCY, candidates=("series_rl",)).best
    limits = {"max_voltage": 0.9 * free.voltage_amplitude, "max_displacement": 1.0}
    options = {"candidates": ("series_rl",), "tolerance": tolerance, **limits}
    result = run(transducer, FREQUENCY, **options)
    case = result.best.worst_case
    assert result.best.feasible and case.violates == ("max_voltage",) and case.binds == "max_voltage"
    assert any("max_voltage is not met everywhere" in note for note in result.notes)
    limit = {entry.name: entry for entry in case.limits}["max_voltage"]
    moved = scaled(transducer, {name: [1 + x] for name, x in limit.corner.items()})
    voltage = FORCE * abs(frequency_response(System(moved, result.best.shunt), [FREQUENCY]).voltage[0])
    assert limit.value == pytest.approx(voltage, rel=1e-9) and limit.value > limits["max_voltage"]
    robust = run(transducer, FREQUENCY, worst_case=True, **options).best
    assert robust.feasible and not robust.worst_case.violates and robust.worst_case.binds == "max_voltage"
    assert robust.worst_case.worst > 0


def test_an_active_circuit_that_is_unstable_in_a_corner(host, run):
    transducer = host(0.05, 60)
    template = NegativeCapacitance(capacitance=0.93 * transducer.capacitance, resistance=1e6)
    options = {"shunts": [template], "candidates": ("negative_capacitance",), "objective": "damping"}
    sure = run(transducer, FREQUENCY, tolerance=Tolerance(capacitance=0.01), **options)
    assert sure.best.worst_case.converged
    unsure = run(transducer, FREQUENCY, tolerance=Tolerance(capacitance=0.2), **options)
    assert not unsure.best.worst_case.converged and any("tolerance box is unstable" in note for note in unsure.notes)


@pytest.mark.parametrize("objective", ["harvest", "damping"])
def test_json_and_tables(host, capsys, objective):
    options = DesignOptions(
        objective=objective, candidates=("series_rl", "open"), tolerance=Tolerance(**THREE), worst_case=True,
        max_voltage=100.0,
    )  # fmt: skip
    excitation = SineForce(amplitude=FORCE, frequency=49.5)
    study = Study(
        title="", path=Path("study.toml"), transducer=host(0.05, 60), shunts=(), excitation=excitation, design=options
    )
    result = design(study)
    entries = {e["shunt"]["kind"]: e["worst_case"] for e in json.loads(json.dumps(result.as_json()))["candidates"]}
    case = entries["series_rl"]
    assert {"harvested_power", "attenuation_db", "corner", "certified", "gap", "nominal_cost", "limits"} <= set(case)
    assert set(case["corner"]) == set(THREE) and set(entries["open"]["corner"]) == {"stiffness", "capacitance"}
    assert case["limits"]["max_voltage"]["kept"] and case["binds"] == "max_voltage"
    rows = worst_cases(subjects_of(result.candidates))
    row = next(row for row in rows if row.limits and row.corner[-1][0] == "load")
    assert row.known.startswith("never below" if objective == "harvest" else "never above")
    assert row.limits == [("max voltage: kept, the nearest", True)]
    assert [name for name, _ in row.corner] == list(THREE)
    assert "The least" in worst_case_text(study, subjects_of(result.candidates))
    print_design("", result.as_json())
    assert "worst" in capsys.readouterr().out


def test_page_has_the_table(host, tmp_path, monkeypatch):
    """Without figures, which take seconds."""
    monkeypatch.setattr("piezoharvest.report.pages.Gallery.pictures", lambda gallery: iter(()))
    options = DesignOptions(candidates=("resistor",), tolerance=Tolerance(**THREE), max_voltage=1.0)
    excitation = SineForce(amplitude=FORCE, frequency=49.5)
    study = Study(
        title="", path=Path("a.toml"), transducer=host(0.05, 60), shunts=(), excitation=excitation, design=options
    )
    page = write_report(study, design(study), tmp_path).read_text(encoding="utf-8")
    assert '<table class="worst">' in page and "never below" in page and "max voltage: broken, the nearest" in page


def test_branched_shunt_for_its_worst_case(host, run):
    """Entries of lists are tuned, a sharp tuning gains a third; a load without a key is left out, which is said."""
    transducer = host(0.05, 60, modes=(Mode(mass=0.01, damping=0.2, stiffness=4e4, coupling=5e-4),))
    shunt = ParallelBranches(inductances=(250.0, 7.0), resistances=(2e5, 5e4), capacitances=(4e-7,))
    options = {"shunts": [shunt], "candidates": (shunt.kind,), "hold": ("resistances", "capacitances")}
    tolerance = Tolerance(stiffness=0.03, load=0.1)
    nominal, robust = (run(transducer, 50.6, tolerance=tolerance, worst_case=w, **options) for w in (False, True))
    assert robust.best.shunt.inductances != nominal.best.shunt.inductances
    assert robust.best.worst_case.worst > 1.2 * nominal.best.worst_case.worst
    assert robust.best.worst_case.left_out == ("load",)
    assert any("leaves out load" in note for note in robust.notes)
