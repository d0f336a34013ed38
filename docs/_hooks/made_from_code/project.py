"""Pages of what lies beside the documentation: worked studies, decisions, and kept reports."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]
_KEPT = (".html", ".png")  # what a page of reports/ consists of


def gallery() -> dict[str, str]:
    """Pages of designs/, from the README of each, with its study."""
    found = {}
    for readme in sorted(ROOT.glob("designs/*/README.md")):
        studies = "".join(
            f'\n??? example "{path.name}"\n\n    ```toml\n{_indented(path.read_text())}    ```\n'
            for path in sorted(readme.parent.glob("*.toml"))
        )
        found[f"gallery/{readme.parent.name}.md"] = readme.read_text() + studies
    rows = "".join(f"| [{_title(text)}]({path.split('/')[1]}) | {_decides(text)} |\n" for path, text in found.items())
    head = (
        "# Gallery\n\nWorked studies, which lie in `designs/` with all their files.\n\n| study | decides |\n|---|---|\n"
    )
    return {"gallery/index.md": head + rows, **found}


def decisions() -> dict[str, str]:
    """Overview of docs/decisions."""
    pages = sorted((ROOT / "docs/decisions").glob("*.md"))
    rows = "".join(f"- [{_title(path.read_text())}]({path.name})\n" for path in pages)
    return {"decisions/index.md": f"# Decisions\n\nReasons for large choices, and what was tried.\n\n{rows}"}


def reports() -> dict[str, Path]:
    """Files of the kept reports by their place in the site."""
    files = [path for path in ROOT.glob("reports/*/*") if path.suffix in _KEPT]
    return {path.relative_to(ROOT).as_posix(): path for path in sorted(files)}


def _title(text: str) -> str:
    return text.splitlines()[0].removeprefix("# ")


def _decides(text: str) -> str:
    """The sentence of a worked study that says what it decides."""
    sentence = r"decides((?:\([^()]*\)|[.:](?=\S)|[^.:(])*)"  # brackets may hold full stops
    found = re.search(sentence, text, re.IGNORECASE)
    return " ".join(found[1].split()) if found else ""


def _indented(text: str) -> str:
    return "".join(f"    {line}".rstrip() + "\n" for line in text.splitlines())
