"""What `make docs` checks with mkdocs is checked here as far as it goes without: files, links, navigation."""

import posixpath
import re
from pathlib import Path

import pytest
from made_from_code import commands, project, reference

ROOT = Path(__file__).parents[2]
MADE = {**reference.pages(), "reference/commands.md": commands.page(), **project.gallery(), **project.decisions()}
WRITTEN = {path.relative_to(ROOT / "docs").as_posix(): path.read_text() for path in (ROOT / "docs").rglob("*.md")}
PAGES = {**MADE, **WRITTEN}
OTHERS = {*project.reports(), *(path.relative_to(ROOT / "docs").as_posix() for path in ROOT.glob("docs/pictures/*"))}


def links(text):
    text = re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)
    return [link for link in re.findall(r"\]\(([^)\s]+)\)", text) if not link.startswith("http")]


@pytest.mark.parametrize("page", sorted(PAGES))
def test_links_of_a_page_lead_somewhere(page):
    files = [link.partition("#")[0] for link in links(PAGES[page]) if not link.startswith("#")]
    places = [posixpath.normpath(posixpath.join(posixpath.dirname(page), file)) for file in files]
    assert [place for place in places if place not in PAGES and place not in OTHERS and place != "decisions"] == []


def test_links_of_the_readme_lead_somewhere():
    found = links((ROOT / "README.md").read_text())
    assert len(found) > 10
    assert [link for link in found if not (ROOT / link).exists()] == []


def test_the_navigation_has_every_page_that_was_written():
    named = set(re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text()))
    assert named <= PAGES.keys()
    assert {page for page in WRITTEN if not page.startswith("decisions/")} <= named


def test_the_picture_of_the_readme_is_small():
    assert (ROOT / "docs/pictures/demo.png").stat().st_size < 60_000


def test_commands_are_all_on_their_page():
    from piezoharvest.cli import app

    names = [command.name or command.callback.__name__ for command in app.registered_commands]
    assert len(names) > 9
    assert [name for name in names if f"## piezoharvest {name}\n" not in MADE["reference/commands.md"]] == []
