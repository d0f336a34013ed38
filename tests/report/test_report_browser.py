"""The report in a real browser: headless Chromium opens it and shows what is there."""

import re
from importlib import resources
from io import BytesIO

import matplotlib.image
import numpy as np
import pytest
from report_studies import report, untrusted_report
from selection import with_slow

from piezoharvest.report.figures.style import frequency_axis, grid_of_axes, inline_svg, log_axis, write_png

pytestmark = pytest.mark.browser


def shot(browse, page, file, *options):
    browse(page, f"--screenshot={file}", *options)
    return matplotlib.image.imread(file)[..., :3]


@pytest.mark.parametrize("name", with_slow(["bench", "bridge on a stack", "step"], slow=lambda name: name != "step"))
def test_everything_is_drawn_and_nothing_fetched(measured, name):
    found = measured(report(name))
    assert found["title"].endswith("design report")
    assert found["rows"] >= 2
    assert len(found["drawn"]) == len(list(report(name).parent.glob("*.png")))
    assert all(width > 500 and height > 100 for width, height in found["drawn"])
    assert all(width > 0 for width, _ in found["images"])
    assert found["fetched"] == []
    assert found["wide"] <= 0
    assert found["heads"] > 0


def test_on_a_telephone_tables_are_cards_and_nothing_is_off_the_screen(measured):
    found = measured(report("step"), width=390)
    assert found["wide"] <= 0
    assert found["heads"] == 0
    assert [width for width, _ in found["drawn"]] == [pytest.approx(390, abs=1)] * len(found["drawn"])


def test_dom_of_the_page_as_it_is(browse):
    dom = browse(report("step"), "--dump-dom")
    assert re.search(r"<title>.*design report</title>", dom)
    assert "pointermove" in dom  # values can be read off the curves
    assert dom.count("<svg") == dom.count("</svg>") == dom.count("<figure ")
    assert not re.findall(r'(?:src|href)="(?!#|data:)', dom)


@pytest.mark.slow
def test_what_is_not_to_be_trusted_is_seen(browse):
    dom = browse(untrusted_report(), "--dump-dom")
    assert dom.count('data-converged="false"') == 2
    assert 'role="alert"' in dom


def test_looks_in_light_and_dark(browse, tmp_path):
    size = "--window-size=1200,3000"
    light = shot(browse, report("step"), tmp_path / "light.png", size)
    dark = shot(browse, report("step"), tmp_path / "dark.png", size, "--blink-settings=preferredColorScheme=0")
    assert light.shape == dark.shape == (3000, 1200, 3)
    assert np.median(light) > 0.95
    assert np.median(dark) < 0.2
    for image in (light, dark):
        assert np.std(image) > 0.05
        # Text and figures all the way down.
        assert all(np.std(part) > 0.02 for part in np.split(image, 10))


def test_prints(browse, tmp_path):
    browse(report("step"), "--no-pdf-header-footer", f"--print-to-pdf={tmp_path / 'page.pdf'}")
    pages = len(re.findall(rb"/Type\s*/Page\b", (tmp_path / "page.pdf").read_bytes()))
    assert 3 <= pages <= 14


def test_on_paper_no_row_is_cut_and_no_section_hidden(measured):
    found = measured(report("step"), printed=True)
    assert found["rows"] > 10 and found["closed"] >= 2  # which are open on paper
    assert {name: found[name] for name in ("cut", "lost", "hidden", "off")} == {
        "cut": [], "lost": [], "hidden": [], "off": [],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("rule", "told"),
    [("tr, .scroll:not(:has(tr:nth-child(16))) { break-inside: avoid; }", "cut"),
     ("details::details-content { content-visibility: visible; display: block; }", "hidden")],
)  # fmt: skip
def test_the_test_of_paper_sees_what_is_wrong(measured, tmp_path, rule, told):
    text = report("step").read_text(encoding="utf-8")
    assert rule in text
    (tmp_path / "wrong.html").write_text(text.replace(rule, ""), encoding="utf-8")
    assert measured(tmp_path / "wrong.html", printed=True)[told]


# The pointer is moved to the middle one of the three points of each line.
POINT = """<script>document.body.dataset.read = [...document.querySelectorAll('[id*="axes_"] > [id*="line2d_"] > path')]
  .map(path => {
    const svg = path.ownerSVGElement;
    const [x, y] = path.getAttribute("d").match(/L *([\\d.]+) ([\\d.]+)/).slice(1).map(Number);
    const place = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
    svg.dispatchEvent(new PointerEvent("pointermove", { clientX: place.x, clientY: place.y }));
    return svg.nextSibling.textContent;
  }).join("\\n");</script>"""


def test_values_are_read_off_the_curves(browse, tmp_path):
    """Of a logarithmic, a plain and a scaled axis: what the pointer shows is what was drawn."""
    figure, (upper, lower) = grid_of_axes(2, height=4.0)
    upper.plot([10.0, 2e3, 3e4], [1.0, -2.5, 3.0])
    upper.set(xlabel="load (as tuned)", ylabel="power\nin mW")
    log_axis(upper.xaxis, "Ω")
    lower.plot([1e4, 1.25e4, 2e4], [0.0, 7.5, 5.0])
    frequency_axis(lower, logarithmic=False)
    write_png(figure, BytesIO())  # which fixes the layout
    script = resources.files("piezoharvest.report").joinpath("templates/readings.js").read_text()
    svg = inline_svg(figure, "figure", "test")
    page = tmp_path / "page.html"
    page.write_text(f"<body><figure>{svg}</figure><script>{script}</script>{POINT}</body>", encoding="utf-8")
    shown = re.search(r'data-read="([^"]*)"', browse(page, "--dump-dom"))[1].splitlines()
    words = [re.fullmatch(r"(.*): (-?[\d.]+)(.*)", line).groups() for line in shown]
    assert [(label, unit) for label, _, unit in words] == [
        ("load", " kΩ"), ("power in mW", ""), ("frequency in kHz", ""), ("y", ""),
    ]  # fmt: skip
    # Points have two digits behind the point, of axes a hundred points high.
    assert [float(value) for _, value, _ in words] == pytest.approx([2.0, -2.5, 12.5, 7.5], rel=1e-3)
