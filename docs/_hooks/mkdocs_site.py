"""Hook of mkdocs: adds the pages that are made from the code, the navigation to them, and the schemas."""

import json
import sys
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

sys.path.insert(0, str(Path(__file__).parent))  # mkdocs runs this file by itself

from made_from_code import cards, commands, effect_figures, equations, figures, project, reference, schema

_DECISIONS = [f"decisions/{path.name}" for path in sorted((project.ROOT / "docs/decisions").glob("*.md"))]
_PAGES = {
    **reference.pages(), "reference/commands.md": commands.page(), **project.gallery(), **project.decisions(),
}  # fmt: skip
_KEYED = ("reference/", "shunts/", "effects/")  # pages with tables of keys
_FOLDERS = {"Shunts": "shunts", "Effects": "effects", "Gallery": "gallery", "Decisions": "decisions"}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages of a folder behind its overview."""
    for section in config.nav or []:
        for title, entries in section.items():
            if title in _FOLDERS:
                pages = sorted({*_PAGES, *_DECISIONS})
                entries += [page for page in pages if page.startswith(f"{_FOLDERS[title]}/") and page not in entries]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what is made from the code, and the kept reports."""
    examples = figures.examples()
    for kind, section in equations.equations(examples):
        _PAGES[f"shunts/{kind}.md"] += section
    for kind, caption, picture in figures.figures(examples):
        _PAGES[f"shunts/{kind}.md"] += f"\n![voltages and current]({kind}.png)\n\n{caption}\n"
        files.append(File.generated(config, f"shunts/{kind}.png", content=picture))
    for name, caption, picture in effect_figures.figures():
        _PAGES[f"effects/{name}.md"] += f"\n![record with and without the effect]({name}.png)\n\n{caption}\n"
        files.append(File.generated(config, f"effects/{name}.png", content=picture))
    for path, text in _PAGES.items():
        files.append(File.generated(config, path, content=text))
    for name, made in (("study", schema.study()), ("campaign", schema.campaign())):
        files.append(File.generated(config, f"schemas/{name}.json", content=json.dumps(made, indent=1)))
    for path, source in project.reports().items():
        files.append(File.generated(config, path, abs_src_path=str(source)))
    return files


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let tables of keys be shown as cards where the window is narrow."""
    return cards.with_headings(html) if page.file.src_uri.startswith(_KEYED) else html
