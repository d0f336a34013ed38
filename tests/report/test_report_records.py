"""Figures of measured records: every channel has its panel, and what was found is named where it is."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO
from types import MappingProxyType

import numpy as np
import pytest

from piezoharvest.description.shunts import Resistor
from piezoharvest.records import Finding, FrequencyRecord, Record, Signal
from piezoharvest.report.figures.style import Powers, grid_of_axes, inline_svg, write_png
from piezoharvest.report.records import record_figure


def record(count=5000, **values):
    time = np.arange(count) / 1000
    signals = {"force": 500 * np.sin(12 * time), "displacement": 1e-6 * np.sin(12 * time), "voltage": np.cos(12 * time)}
    signals |= values
    return Record(
        name="run.csv", key="records.0", role="fit", drive="force", shunt=Resistor(resistance=1e5), start_time=0.0,
        time=Signal(time, None, "run.csv", "time_s", 2),
        signals=MappingProxyType({name: Signal(v, None, "run.csv", name, 2) for name, v in signals.items()}),
    )  # fmt: skip


def finding(channel, rows, check="clipped", severity="warning"):
    return Finding(severity, check, "run.csv", channel, rows, "found what it is, must be what it should be")


def texts(axes):
    return [text.get_text() for text in axes.texts]


def spans(axes, width):
    """Shaded ranges of a panel in the unit of its axis."""
    return sorted((p.get_x(), p.get_x() + p.get_width()) for p in axes.patches if p.get_width() < width)


def test_one_panel_for_each_channel(tmp_path):
    figure = record_figure(record())
    assert [axes.get_ylabel().split("\n")[0] for axes in figure.axes] == ["force (drive)", "displacement", "voltage"]
    assert [axes.get_ylabel().split("\n")[1] for axes in figure.axes] == ["in N", "in µm", "in V"]
    assert figure.axes[-1].get_xlabel() == "time in s"
    assert "nothing found" in figure.get_suptitle()
    write_png(figure, tmp_path / "record.png")
    assert (tmp_path / "record.png").stat().st_size > 20_000


def test_findings_are_shaded_and_named_where_they_are():
    figure = record_figure(record(), [finding("voltage", ((1002, 1501), (2002, 2501)))])
    force, displacement, voltage = figure.axes
    assert texts(force) == texts(displacement) == []
    assert texts(voltage) == ["clipped"]
    np.testing.assert_allclose(spans(voltage, 1.0), [(1.0, 1.499), (2.0, 2.499)], atol=1e-9)
    assert "warning: clipped: voltage, rows 1002-1501, 2002-2501: found what it is" in figure.get_suptitle()


def test_a_fault_of_time_is_shaded_in_all_panels():
    of = record()
    time = of.time.values.copy()
    time[3000:] -= 1.0
    broken = Record(**{**vars(of), "time": Signal(time, None, "run.csv", "time_s", 2)})
    figure = record_figure(broken, [finding("time", ((3002, 3002),), "backward time", "error")])
    assert all(len(axes.patches) == 1 for axes in figure.axes)
    assert [texts(axes) for axes in figure.axes] == [["backward time"], [], []]
    assert figure.axes[-1].get_xlabel() == "row"
    (begin, end) = spans(figure.axes[0], 100)[0]
    assert begin < 3002 < end


def test_values_that_are_not_numbers_leave_a_gap(tmp_path):
    values = np.cos(np.arange(5000) / 80)
    values[1000:3000] = np.nan
    figure = record_figure(record(voltage=values), [finding("voltage", ((1002, 3001),), "nan", "error")])
    y = figure.axes[2].lines[0].get_ydata()
    assert 0.3 < np.mean(np.isnan(y)) < 0.5
    write_png(figure, tmp_path / "record.png")


def test_no_spike_is_lost_in_a_long_record():
    values = np.zeros(1_000_000)
    values[123_456] = 7.0
    count = len(values)
    figure = record_figure(record(count, voltage=values))
    line = figure.axes[2].lines[0]
    assert len(line.get_ydata()) < 10_000
    assert np.max(line.get_ydata()) == 7.0


def test_many_findings_are_counted():
    found = [finding("voltage", ((n, n),), f"check {n}") for n in range(2, 12)]
    title = record_figure(record(), found).get_suptitle()
    assert "check 2" in title
    assert title.endswith("and 4 more")


@pytest.mark.parametrize(("kind", "panels"), [("frf", 3), ("impedance", 2)])
def test_frequency_records(tmp_path, kind, panels):
    f = np.geomspace(1, 1000, 200)
    response = 1 / (1 - (f / 100) ** 2 + 0.02j * f / 100)
    frf = kind == "frf"
    of = FrequencyRecord(
        name="frf.csv", key="records.0", role="validate", kind=kind, input="force" if frf else "current",
        output="displacement" if frf else "voltage", shunt=None, mechanical="free", start_time=0.0, frequency=f,
        response=response, coherence=np.ones(200) if frf else None, columns={}, first_row=2,
    )  # fmt: skip
    figure = record_figure(of, [finding("response", ((2, 201),), "unit", "error")])
    assert len(figure.axes) == panels
    assert figure.axes[0].get_ylabel() == ("displacement / force\nin dB re 1 m/N" if frf else "impedance\nin dB re 1 Ω")
    np.testing.assert_allclose(figure.axes[0].lines[0].get_ydata(), 20 * np.log10(np.abs(response)))
    assert texts(figure.axes[0]) == ["unit"]
    write_png(figure, tmp_path / "frf.png")


# What mathtext, SVG, HTML and the font stumble over, each in the name of a file and in what a check says.
NAMES = [
    "run_$x^{2$.csv", "$", "$$", r"$\frac{$ \$", "a_b^c\\d.csv",
    "--><script>alert(1)</script>.csv", "two\nlines\t.csv", "测量.csv",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("error")
def test_names_of_files_are_drawn_as_they_are(name):
    said = Finding("warning", name, name, "force", ((5, 9),), f"found {name}, must be another")
    figure = record_figure(replace(record(), name=name), [said])
    stream = BytesIO()
    write_png(figure, stream)
    assert stream.getvalue().startswith(b"\x89PNG")
    title = figure.get_suptitle().split("\n")[0]
    assert title == name.replace("\n", r"\n").replace("\t", r"\t") + " (fit)"
    svg = inline_svg(figure, "record", name)
    assert "<script" not in svg
    assert svg.count("<!--") == svg.count("-->")


def test_powers_are_plain_text():
    axis = grid_of_axes(1, height=2.0)[1].xaxis
    axis._set_axes_scale("log")
    axis.set_view_interval(1e-9, 1e-3)
    ticks = Powers()
    ticks.set_axis(axis)
    assert ticks(1e-9) == "10⁻⁹"
    axis.set_view_interval(1e-9, 4e-9)
    ticks = Powers(labelOnlyBase=False)
    ticks.set_axis(axis)
    assert ticks(2e-9) == "2×10⁻⁹"
