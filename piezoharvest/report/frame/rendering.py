"""Pages from their templates."""

from __future__ import annotations

import platform
import re
from functools import cache
from importlib import resources
from importlib.metadata import version
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined, Template
from markupsafe import Markup, escape

import piezoharvest
from piezoharvest.report.frame.cell_labels import with_labels


def page(template: str, **values: Any) -> str:
    """A page from its template, by file name, and its values; what all pages have is added."""
    known = {"version": piezoharvest.__version__, "environment": _environment()}
    return with_labels(_template(template).render(**known, **values))


def _environment() -> str:
    """What a result may depend on besides the package: Python, the packages that compute, the machine."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba"))
    return f"Python {platform.python_version()}, {packages}, {platform.system()} {platform.machine()}"


@cache
def _template(name: str) -> Template:
    """Template of a page, by file name."""
    folder = resources.files("piezoharvest.report").joinpath("templates")
    loader = FunctionLoader(lambda part: folder.joinpath(part).read_text(encoding="utf-8"))
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["subscripts"] = _subscripts
    return environment.get_template(name)


def _subscripts(text: str) -> Markup:
    """Text in which symbols such as k_e have subscripts."""
    return Markup(re.sub(r"\b([A-Za-z])_([A-Za-z]+)", r"\1<sub>\2</sub>", str(escape(text))))
