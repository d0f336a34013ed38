"""Hook of mkdocs: adds the pages that are made from the code, the navigation to them, and the schemas."""

import json
import sys
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parent))  # mkdocs runs this file by itself

from made_from_code import reference, schema

_PAGES = reference.pages()


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put a page for each shunt and effect behind the overview of its kind."""
    for section in config.nav or []:
        for title, entries in section.items():
            if title in ("Shunts", "Effects"):
                folder = title.lower()
                entries += sorted(page for page in _PAGES if page.startswith(f"{folder}/") and page not in entries)
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what is made from the code."""
    for path, text in _PAGES.items():
        files.append(File.generated(config, path, content=text))
    for name, made in (("study", schema.study()), ("campaign", schema.campaign())):
        files.append(File.generated(config, f"schemas/{name}.json", content=json.dumps(made, indent=1)))
    return files
