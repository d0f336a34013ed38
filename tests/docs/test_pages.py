"""Every block of the tutorials, how-to pages and README does what it says, in order, in a folder of its own."""

import gc
import math
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from piezoharvest.cli import main
from piezoharvest.description import shunts
from piezoharvest.records.reading.entries import build_entry

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```(\w+)(?: title=\"([^\"]+)\")?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SLOW = {"docs/how-to/records.md", "docs/how-to/tolerance.md", "docs/how-to/uncertainty.md"}  # and all tutorials
PAGES = [str(path.relative_to(ROOT)) for path in (
    ROOT / "README.md", *sorted((ROOT / "docs/tutorials").glob("*.md")), *sorted((ROOT / "docs/how-to").glob("*.md")),
)]  # fmt: skip
# Figures on a page and in an output that are the same within this share: those of other versions of NumPy, SciPy and
# ngspice differ in their last digits.
SAME = 0.02


@pytest.fixture(autouse=True)
def forgotten():
    """Forget the components of a page: the library of other tests is the package's."""
    yield
    gc.collect()
    assert not any(cls.__module__ == "page" for cls in shunts.registered().values())


def close(shown, word):
    """True if a word of a page is that of an output, or a number near it."""
    if shown == word:
        return True
    try:
        return math.isclose(float(shown), float(word), rel_tol=SAME)
    except ValueError:
        return False


def stands_in(line, lines):
    """True if the words of a line of a page are those of a line of an output, in their order; "..." is any words."""
    shown, gap, _ = line.partition("...")
    wanted = shown.split()
    for words in map(str.split, lines):
        words = words[: len(wanted)] if gap else words
        if len(words) == len(wanted) and all(map(close, wanted, words)):
            return True
    return False


def test_a_line_that_was_not_printed_is_found():
    printed = [" mass   250.1 ± 0.03 g   0.011 %", "other"]
    assert stands_in("mass 250 ± 0.03 g ...", printed) and stands_in("other", printed)
    assert not any(stands_in(line, printed) for line in ("mass 260 ...", "mass 250 ± 0.03 g", "others", "other 1"))


def run(command, output, capfd):
    program, *arguments = shlex.split(command, comments=True)
    assert program == "piezoharvest"
    if "--effects" in arguments:  # what such a file defines would stay in the library of this process
        done = subprocess.run([sys.executable, "-m", program, *arguments], check=False)
        status = done.returncode
    else:
        status = main(arguments)
    output[:] = (shown := capfd.readouterr()).out.splitlines()
    assert status == 0, (command, shown.err)


def marks(page):
    return pytest.mark.slow if page in SLOW or page.startswith("docs/tutorials/") else ()


@pytest.mark.parametrize("page", [pytest.param(page, marks=marks(page)) for page in PAGES])
def test_blocks(page, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    names, output, text = {"__name__": "page"}, [], (ROOT / page).read_text()
    if "--check" in text and shutil.which("ngspice") is None:
        pytest.skip("ngspice is not installed")
    for language, title, block in BLOCK.findall(text):
        if title:
            Path(title).write_text(block)
        elif language == "toml":  # a part of a file
            tables = tomllib.loads(block)
            for entry in (
                *tables.get("records", ()),
                *(e for one in tables.get("specimens", ()) for e in one["records"]),
            ):
                build_entry(entry, "records")
        elif language == "python":
            exec(compile(block, page, "exec"), names)
            output[:] = capfd.readouterr().out.splitlines()
        elif language == "console":
            for line in re.findall(r"^\$ (piezoharvest .*)$", block, re.MULTILINE):
                run(line, output, capfd)
        elif language == "text":  # what the block before prints, with gaps
            for line in filter(str.strip, block.splitlines()):
                assert stands_in(line, output), (line, output)
