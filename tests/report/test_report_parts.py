"""Numbers, limits and places that a report is made of."""

import dataclasses
import re
import zlib
from contextlib import suppress
from io import BytesIO

import numpy as np
import pytest
from fontTools.ttLib import TTFont
from report_studies import STUDIES, designed, study_of
from selection import with_slow

from piezoharvest import progress
from piezoharvest.description.excitation import Multisine, RandomForce, SineBase, SineForce, StepForce
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import SECE, ParallelSSHI, Rectifier, Resistor
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Mode, Transducer
from piezoharvest.engine import simulate
from piezoharvest.report import sweeps, units
from piezoharvest.report.figures import style
from piezoharvest.report.figures.curves import power_along_loads
from piezoharvest.report.frame.cell_labels import with_labels
from piezoharvest.report.gallery import Gallery
from piezoharvest.report.limits import mode_figures, power_limit, white_input
from piezoharvest.report.spans import loads, resonance_span, sweep_span
from piezoharvest.report.subjects import subjects_of
from piezoharvest.report.sweeps import CurveTracer, _coarse_to_fine

BEAM = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
FORCE = SineForce(amplitude=0.02, frequency=50.6)
BRIDGES = "bridge on a stack", "bridge over a band"


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (98122.0, "ohm", "98.1 kΩ"), (0.01, "kg", "10.0 g"), (0.0628, "N s/m", "62.8 mN·s/m"),
        (1e-3, "N/V", "1.00 mN/V"), (999.96, "W", "1.00 kW"), (0.0, "W", "0 W"), (-3e-5, "m", "−30.0 µm"),
        (2.0, "m/s^2", "2.00 m/s²"),
        (0.1, "N^2/Hz", "0.100 N²/Hz"), (float("nan"), "W", "–"), (None, "W", "–"), (5e5, "V/C", "500 kV/C"),
        (1e-20, "W", "1.00·10⁻⁵ fW"), (0.9995, "s", "1.00 s"), (0.05, "dB", "0.0500 dB"),
    ],
)  # fmt: skip
def test_engineering_notation(value, unit, text):
    assert units.engineering(value, unit) == text.replace(" ", units.SPACE)


def test_given_numbers_have_no_zeros_at_their_end():
    assert units.quantity_text(6.0, "") == "6"
    assert units.quantity_text((1e-7, 3e-7), "C") == f"100, 300{units.SPACE}nC"


@pytest.mark.parametrize(("value", "text"), [(-12.34, "−12.3 dB"), (0.8, "+0.8 dB"), (-0.01, "0.0 dB"), (np.nan, "–")])
def test_decibels_have_a_sign(value, text):
    assert units.decibel(value) == text.replace(" ", units.SPACE)


class TestLimit:
    def test_formula(self):
        assert power_limit(BEAM, FORCE).power == pytest.approx(0.02**2 / (8 * 0.0628))
        base = SineBase(amplitude=2.0, frequency=50.6)
        assert power_limit(BEAM, base).power == pytest.approx((0.01 * 2) ** 2 / (8 * 0.0628))

    def test_modes_and_tones_add_up(self):
        mode = Mode(mass=0.01, damping=0.1, stiffness=4e4, coupling=5e-4, force_participation=0.5)
        both = power_limit(dataclasses.replace(BEAM, modes=(mode,)), FORCE).power
        assert both == pytest.approx(0.02**2 / 8 * (1 / 0.0628 + 0.25 / 0.1))
        tones = Multisine(amplitudes=(0.02, 0.01), frequencies=(50.0, 60.0), phases=(0.0, 1.0), duration=1.0)
        assert power_limit(BEAM, tones).power == pytest.approx((0.02**2 + 0.01**2) / (8 * 0.0628))

    def test_none_where_nothing_limits(self):
        assert power_limit(dataclasses.replace(BEAM, damping=0.0), FORCE) is None
        assert power_limit(BEAM, StepForce(amplitude=1.0, duration=1.0)) is None

    def test_noise(self):
        noise = RandomForce(psd=2e-4, band=(1.0, 200.0), duration=10.0, seed=0)
        assert power_limit(BEAM, noise) is None
        assert white_input(BEAM, noise) == pytest.approx(2e-4 / 0.04)
        assert white_input(BEAM, FORCE) is None

    @pytest.mark.parametrize("frequency", [45.0, 50.0, 50.6, 51.2])
    @pytest.mark.parametrize(
        "shunt",
        [
            Resistor(resistance=8e4), SECE(), Rectifier(dc_voltage=4.0),
            ParallelSSHI(inductance=0.1, quality=20.0, dc_voltage=10.0),
        ],
        ids=lambda shunt: shunt.kind,
    )  # fmt: skip
    def test_nothing_exceeds_it(self, shunt, frequency):
        drive = dataclasses.replace(FORCE, frequency=frequency)
        found = simulate(System(BEAM, shunt), drive)
        assert found.harvested_power <= power_limit(BEAM, drive).power * (1 + 1e-9)

    def test_figures_of_the_mode(self):
        (mode,) = mode_figures(BEAM)
        assert mode.coupling_squared == pytest.approx(BEAM.coupling_squared)
        assert mode.quality == pytest.approx(np.sqrt(986.96 * 0.01) / 0.0628)


class TestSpans:
    def test_drive_and_band_are_inside(self):
        for name in ("bench", "band"):
            study = study_of(name)
            span = sweep_span(study)
            assert span == resonance_span(study)
            for f in (study.excitation.frequency, *(study.design.band or ())):
                assert span.low < f < span.high

    def test_a_band_with_several_modes_is_shown_whole(self):
        study = study_of("band")
        wide = dataclasses.replace(study, design=dataclasses.replace(study.design, band=(15.0, 600.0)))
        span = sweep_span(wide)
        assert span.low < 15.0 < 600.0 < span.high
        assert span.logarithmic

    def test_far_from_resonance_the_drive_is_looked_at(self):
        assert sweep_span(study_of("stack")) == (50.0, 5000.0, True)

    def test_loads_hold_the_tuned_ones(self):
        study, result = designed("bench")
        subjects = subjects_of(result.candidates)
        grid = loads(subjects, study, 9)
        for s in subjects:
            if s.load_field:
                assert grid[0] < getattr(s.shunt, s.load_field) < grid[-1]

    def test_kinds_that_come_twice_are_told_apart(self):
        _, result = designed("step")
        first, second = result.candidates
        assert [s.label for s in subjects_of((first, second, first))][0::2] == [
            f"{first.shunt.kind} (1)",
            f"{first.shunt.kind} (2)",
        ]


class TestSweeps:
    @pytest.mark.parametrize(
        "name", with_slow(["bench", "stack", "band", *BRIDGES], slow=lambda name: name not in ("bench", "stack"))
    )
    def test_curves_go_through_the_tuned_point(self, name):
        study, result = designed(name)
        subjects = subjects_of(result.candidates)
        bench = CurveTracer(study)
        curves = bench.along_loads(subjects, loads(subjects, study, 5))
        assert {c.subject.label for c in curves} == {s.label for s in subjects if s.load_field}
        for curve in curves:
            tuned = curve.x == getattr(curve.subject.shunt, curve.subject.load_field)
            assert curve.harvested[tuned] == pytest.approx(curve.subject.candidate.harvested_power, rel=2e-3)

    @pytest.mark.parametrize("scale, shown", [(1.0, "linear"), (0.05, "log")])
    def test_powers_far_apart_have_a_logarithmic_axis_that_holds_all_tuned_points(self, scale, shown):
        """The least candidate's curve is seen, whatever the best one harvests."""
        study, result = designed("bench")
        subjects = [s for s in subjects_of(result.candidates) if s.load_field]
        curves = CurveTracer(study).along_loads(subjects, loads(subjects, study, 5))
        least = min(curves, key=lambda curve: curve.harvested.max())
        lower = dataclasses.replace(least, harvested=scale * least.harvested)
        figure = power_along_loads([*(c for c in curves if c is not least), lower], [], None)
        power, efficiency = figure.axes
        assert power.get_yscale() == efficiency.get_yscale() == shown
        assert power.get_ylabel() == ("harvested power in µW" if shown == "linear" else "harvested power")
        if shown == "log":
            assert 0 < power.get_ylim()[0] < 0.1 * lower.harvested.max() < power.get_ylim()[1]
        assert efficiency.get_ylim()[0] < 100 * lower.efficiency.max() < efficiency.get_ylim()[1]

    def test_two_port_and_simulation_agree(self):
        study, result = designed("bench")
        subjects = [s for s in subjects_of(result.candidates) if s.linear]
        frequencies = np.array([49.0, 50.6, 52.0])
        bench = CurveTracer(study)
        for curve in bench.along_frequencies(subjects, frequencies, frequencies):
            assert curve.exact
            for n, frequency in enumerate(frequencies):
                point = bench.simulated(curve.subject.shunt, dataclasses.replace(study.excitation, frequency=frequency))
                assert point == pytest.approx((
                    curve.harvested[n], curve.mechanical[n], curve.displacement[n], curve.attenuation[n]
                ), rel=1e-6, abs=1e-9)  # fmt: skip

    @pytest.mark.parametrize("together", [True, False])
    def test_points_simulated_together_are_those_of_one(self, monkeypatch, together):
        """Whether all of them can be, or one of them is refused."""
        study, result = designed("bench")
        bench, switched = CurveTracer(study), [s for s in subjects_of(result.candidates) if s.switched]
        frequencies = np.array([48.0, 50.0, 50.6, 53.0, 60.0])
        if not together:

            def refuse(*_, **__):
                raise ParameterError("frequency", "found one that is refused")

            monkeypatch.setattr(sweeps, "simulate_many", refuse)
        curves = bench.along_frequencies(switched, frequencies, frequencies)
        assert [curve.subject for curve in curves] == switched
        for curve in curves:
            assert not curve.exact
            for n, frequency in enumerate(frequencies):
                point = bench.simulated(curve.subject.shunt, dataclasses.replace(study.excitation, frequency=frequency))
                assert point == pytest.approx((
                    curve.harvested[n], curve.mechanical[n], curve.displacement[n], curve.attenuation[n]
                ), rel=1e-8, abs=1e-9)  # fmt: skip

    def test_with_hysteresis_nothing_is_taken_for_linear(self):
        study, result = designed("stack")
        assert not any(CurveTracer(study).exact(s) for s in subjects_of(result.candidates))

    def test_time_is_kept(self):
        study, result = designed("bench")
        bench, switched = CurveTracer(study, budget=0.0), [s for s in subjects_of(result.candidates) if s.switched]
        assert bench.along_frequencies(switched, np.linspace(49, 51, 50), np.empty(0)) == []
        assert bench.cut_short

    @pytest.mark.parametrize("count", [0, 1, 2, 3, 7, 34])
    def test_order_is_coarse_to_fine_and_complete(self, count):
        places = [round(share * (count - 1)) for share in _coarse_to_fine(count)]
        assert set(range(count)) <= set(places) or count == 0


def test_studies_cover_what_the_interface_names():
    assert {excitation["kind"] for _, excitation, _ in STUDIES.values()} >= {"sine_base", "step_force", "random_base"}


class TestCellLabels:
    """What narrow screens show beside the cells of a table."""

    TABLE = (
        "<table><thead><tr><th></th><th>of &lt;it&gt;</th><th>displace&shy;ment</th></tr></thead><tbody>"
        '<tr><th scope="row" rowspan="2">a</th><td>1</td><td class="n">2</td></tr><tr><td>3</td><td>4</td></tr>'
        "<tr><th>b</th><td>5</td><td>6</td><td>7</td></tr></tbody></table>"
    )

    def test_are_the_headings_of_the_columns_below_spanning_cells_too(self):
        found = re.findall(r'<td(?: class="n")?(?: data-label="([^"]*)")?>(\d)', with_labels(self.TABLE))
        it, size = "of &lt;it&gt;", "displacement"
        assert found == [(it, "1"), (size, "2"), (it, "3"), (size, "4"), (it, "5"), (size, "6"), ("", "7")]

    def test_a_long_cell_is_a_sentence(self):
        words = "the voltage decays faster than <b>through</b> the load alone"
        table = f"<table><thead><tr><th>a</th><th>b</th></tr></thead><tr><td>short</td><td>{words}</td></tr></table>"
        assert f'<td data-label="a">short</td><td class="sentence" data-label="b">{words}' in with_labels(table)

    def test_a_table_without_a_head_stays_as_it_is(self):
        plain = "<p>a</p><table><tr><td>1</td></tr></table>"
        assert with_labels(plain) == plain


def test_fonts_of_a_pdf_file_have_its_letters_and_no_tables_that_join_them():
    """The tables are for programs that set text, and half of the time that a file takes."""

    @style.styled
    def draw():
        figure, axes = style.grid_of_axes(1, height=2.0)
        axes.set_xlabel("power Ω·µF⁻¹")
        return figure

    figure, streams = draw(), (BytesIO(), BytesIO())
    style.write_png(figure, streams[0])
    style.write_pdf(figure, streams[1])
    fonts = []
    for raw in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", streams[1].getvalue(), re.S):
        with suppress(zlib.error):
            content = zlib.decompress(raw)
            fonts += [TTFont(BytesIO(content))] if content[:4] == b"\0\1\0\0" else []
    assert fonts
    assert all("glyf" in font and not {"GSUB", "GPOS", "GDEF"} & set(font.keys()) for font in fonts)
    assert {"p", "w", "Omega"} <= {glyph for font in fonts for glyph in font.getGlyphOrder()}


def test_a_report_tells_how_many_of_its_figures_are_drawn(monkeypatch):
    monkeypatch.setattr(progress, "EVERY", 0.0)
    study, result = designed("step")
    with progress.followed((said := []).append):
        drawn = list(Gallery(study, subjects_of(result.candidates), result=result).pictures())
    assert drawn and said[4].line.startswith("drawing: 5 of 10 kinds of figures, about ")
