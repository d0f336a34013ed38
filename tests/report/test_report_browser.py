"""The report in a real browser: headless Chromium opens it and shows what is there."""

import re

import matplotlib.image
import numpy as np
import pytest
from report_studies import report, untrusted_report
from selection import with_slow

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
