"""Pages from their templates."""

from __future__ import annotations

import platform
import re
from functools import cache
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import ChoiceLoader, Environment, FileSystemLoader, FunctionLoader, StrictUndefined, Template
from markupsafe import Markup, escape

import piezoharvest
from piezoharvest.report.frame.cell_labels import with_labels


def page(template: str, folder: Path | None = None, **values: Any) -> str:
    """A page from its template, by file name, and its values; what all pages have is added.

    Templates that are not in `folder` are those of this package, so that one elsewhere extends `frame.html.j2`.
    """
    known = {"version": piezoharvest.__version__, "environment": _environment()}
    return with_labels(_template(template, folder).render(**known, **values))


def _environment() -> str:
    """What a result may depend on besides the package: Python, the packages that compute, the machine."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba"))
    return f"Python {platform.python_version()}, {packages}, {platform.system()} {platform.machine()}"


@cache
def _template(name: str, folder: Path | None) -> Template:
    """Template of a page, by file name."""
    templates = resources.files("piezoharvest.report").joinpath("templates")
    own = FunctionLoader(lambda part: templates.joinpath(part).read_text(encoding="utf-8"))
    environment = Environment(
        loader=ChoiceLoader([FileSystemLoader(folder), own]) if folder else own,
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["subscripts"] = _subscripts
    return environment.get_template(name)


def _subscripts(text: str) -> Markup:
    """Text in which symbols such as k_e have subscripts."""
    return Markup(re.sub(r"\b([A-Za-z])_([A-Za-z]+)", r"\1<sub>\2</sub>", str(escape(text))))
