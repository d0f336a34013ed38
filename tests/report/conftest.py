"""What holds for the tests of reports."""

import html
import json
import re
import shutil
import subprocess

import pytest

from piezoharvest.design.bound import bounds

OPTIONS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--virtual-time-budget=3000",
]  # fmt: skip
# Run in the page, once it is laid out: sizes of what is drawn, and everything that was fetched from anywhere.
MEASURE = """<script>addEventListener("load", () => {
  const size = element => { const box = element.getBoundingClientRect(); return [box.width, box.height]; };
  const drawn = [...document.querySelectorAll("figure svg")].map(size);
  const images = [...document.images].map(image => [image.naturalWidth, image.naturalHeight]);
  const fetched = performance.getEntriesByType("resource").map(entry => entry.name);
  const wide = document.documentElement.scrollWidth - innerWidth;
  const rows = document.querySelectorAll("tr[data-kind]").length;
  const shown = element => getComputedStyle(element).display !== "none";
  const heads = [...document.querySelectorAll("thead")].filter(shown).length;
  const found = JSON.stringify({drawn, images, fetched, wide, rows, heads, title: document.title});
  document.body.dataset.measured = found;
  parent.postMessage(found, "*");
});</script></body>"""
# The same by the rules for print: rows that may be cut or are higher than a sheet, what is hidden or off the paper.
PRINTED = """<script>addEventListener("load", () => {
  const named = elements => elements.map(element => element.outerHTML.slice(0, 80));
  const box = element => element.getBoundingClientRect();
  const rows = [...document.querySelectorAll("tr")], entries = [...document.querySelectorAll("details > *, td, th")];
  const cut = rows.filter(row => getComputedStyle(row).breakInside !== "avoid" || box(row).height > SHEET);
  const heads = [...document.querySelectorAll("thead")];
  const lost = heads.filter(head => getComputedStyle(head).display !== "table-header-group");
  const hidden = entries.filter(entry => entry.textContent.trim() && !(entry.checkVisibility() && box(entry).height));
  const off = entries.filter(entry => box(entry).right > innerWidth + 1);
  const closed = document.querySelectorAll("details:not([open])").length;
  const found = JSON.stringify({rows: rows.length, closed, cut: named(cut), lost: named(lost), hidden: named(hidden),
                                off: named(off)});
  document.body.dataset.measured = found;
  parent.postMessage(found, "*");
});</script></body>""".replace("SHEET", "1017")  # 269 mm between the margins of A4, in CSS pixels
PAPER = 703  # 186 mm between them
# The page in a frame of any width: windows of chromium are at least 500 pixels wide.
FRAME = """<body><iframe src="measured.html" style="border: 0" width="{width}" height="2000"></iframe><script>
addEventListener("message", event => {{ document.body.dataset.measured = event.data; }});</script></body>"""


@pytest.fixture(autouse=True, scope="session")
def coarse_bound():
    """Bounds on the first mesh alone: the pages show what it gives, how close it is has tests of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bounds, "_MESHES", {kind: meshes[:1] for kind, meshes in bounds._MESHES.items()})
        yield


@pytest.fixture(scope="module")
def browse(tmp_path_factory):
    """Function that opens a page with further options, and gives back what the browser prints."""
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if program is None:
        pytest.skip("chromium is not on the PATH")

    def run(page, *options):
        profile = tmp_path_factory.mktemp("profile")
        command = [program, *OPTIONS, f"--user-data-dir={profile}", *options, page.resolve().as_uri()]
        return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout

    return run


@pytest.fixture
def measured(browse, tmp_path):
    """Function that gives what a script in a copy of the page has measured, at a width of the window in pixels.

    With `printed` by the rules for print, as wide as A4 between its margins.
    """

    def measure(page, width=1200, *, printed=False):
        copy, text = tmp_path / "measured.html", page.read_text(encoding="utf-8")
        if printed:
            text, width = text.replace("@media print", "@media all"), PAPER
        copy.write_text(text.replace("</body>", PRINTED if printed else MEASURE), encoding="utf-8")
        frame = tmp_path / "frame.html"
        frame.write_text(FRAME.format(width=width), encoding="utf-8")
        dom = browse(frame, "--window-size=1400,2000", "--dump-dom")
        found = re.search(r'data-measured="([^"]*)"', dom)
        assert found, dom[-500:]
        return json.loads(html.unescape(found.group(1)))

    return measure
