"""What every report of a design has: its figures, each drawn and shown once, and a page that stands alone."""

import re

import matplotlib.image
import numpy as np
import pytest
from report_studies import TITLE, Page, designed, pictures, report
from selection import with_slow

ALWAYS = {"energy.png", "bode.png"}
FIGURES = {
    "bench": {"power-load.png", "power-frequency.png", "damping.png"},
    "stack": {"power-load.png", "power-frequency.png", "damping.png", "hysteresis.png"},
    "bridge on a stack": {"power-load.png", "power-frequency.png", "damping.png", "hysteresis.png"},
    "band": {"power-load.png", "power-frequency.png", "damping.png"},
    "bridge over a band": {"power-load.png", "power-frequency.png", "damping.png"},
    "step": {"power-load.png", "damping.png"},
    "noise": {"power-load.png", "damping.png"},
}


@pytest.mark.parametrize("name", with_slow(FIGURES, slow=lambda name: name != "band"))
class TestEveryReport:
    def test_figures_lie_beside_the_page(self, name):
        found = pictures(report(name))
        assert {file for file in found if not file.startswith("waveforms-")} == ALWAYS | FIGURES[name]
        assert any(file.startswith("waveforms-1-") for file in found)

    def test_figures_show_something(self, name):
        for file in report(name).parent.glob("*.png"):
            image = matplotlib.image.imread(file)[..., :3]
            height, width, _ = image.shape
            assert width > 1000, file
            assert height > 250, file
            assert np.std(image) > 0.05, file
            # Nothing is cut off: the outermost pixels are paper, but for lines that end at the edge of the axes.
            edges = np.concatenate((image[0], image[-1], image[:, 0]))
            assert np.min(edges) == 1.0, file

    def test_page_holds_every_figure_once(self, name):
        page = Page(report(name))
        named = [attributes["id"] for attributes in page.all("figure")]
        assert {f"{figure.removeprefix('figure-')}.png" for figure in named} == pictures(report(name))
        assert len(page.all("svg")) == len(named)
        assert all(svg["aria-label"] for svg in page.all("svg"))
        numbers = [int(n) for n in re.findall(r"Figure (\d+)\.", page.text)]
        assert numbers == list(range(1, len(named) + 1))

    def test_page_stands_alone(self, name):
        page = Page(report(name))
        assert "http" not in page.source
        assert "url(//" not in page.source
        assert page.all("script") == [{}]  # that of the readings, which is in the page
        links = [value for _, attributes in page.tags for key, value in attributes.items() if key in ("src", "href")]
        assert all(link.startswith(("#", "data:")) for link in links)
        ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
        inner = set(re.findall(r'(?:href="#|url\(#)([^")]+)', page.source))
        assert inner <= set(ids)
        svg_free = re.sub(r"<svg.*?</svg>", "", page.source, flags=re.S)
        ids = re.findall(r'\bid="([^"]+)"', svg_free)
        assert len(ids) == len(set(ids))

    def test_title_and_ranking(self, name):
        page, (_, result) = Page(report(name)), designed(name)
        assert TITLE in page.text
        assert "<beam>" not in page.source
        rows = [row for row in page.all("tr") if "data-kind" in row]
        assert [row["data-kind"] for row in rows] == [c.shunt.kind for c in result.candidates]
        assert all(row["data-converged"] == "true" for row in rows)
        assert "not converged" not in page.text
        headings = page.source.split('class="ranking"')[1].split("</thead>")[0].replace("\u00ad", "")
        damping = re.findall(r'<th class="n">([^<]*)', headings)[0] == "against shorted"
        study, _ = designed(name)
        assert damping == (study.design is not None and study.design.objective == "damping")
        assert ("added damping" in headings) == (
            damping and any(c.added_damping is not None for c in result.candidates)
        )
        body = page.source.split('class="ranking"')[1].split("</tbody>")[0]
        cells = re.findall(r"<tr data-kind.*?</tr>", body, flags=re.S)
        columns = zip(*(re.findall(r'<td class="n"[^>]*>([^<]*)</td>', row) for row in cells), strict=True)
        assert not any(all(cell == "\u2013" for cell in column) for column in list(columns)[:-1])
