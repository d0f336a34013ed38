"""Catalogue of transducers from data sheets and papers, and of materials: one TOML file each, named by the file.

A file holds `name`, `source` and `note` (values read, values derived and how) and a [transducer] table with the
same keys as in a study; those in `materials/` a [material] table.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib import resources
from typing import Any

_SUFFIX = ".toml"


def names() -> tuple[str, ...]:
    """Names of all entries."""
    files = (file.name for file in resources.files(__name__).iterdir())
    return tuple(sorted(name.removesuffix(_SUFFIX) for name in files if name.endswith(_SUFFIX)))


def materials() -> tuple[str, ...]:
    """Names of all materials."""
    files = (file.name for file in resources.files(__name__).joinpath("materials").iterdir())
    return tuple(sorted(name.removesuffix(_SUFFIX) for name in files if name.endswith(_SUFFIX)))


def material(name: str) -> dict[str, Any]:
    """Content of a material's file: name, source, note and the table `material` (SI units).

    Raises
    ------
    KeyError
        There is no such material.
    """
    if name not in materials():
        raise KeyError(name)
    file = resources.files(__name__).joinpath("materials", name + _SUFFIX)
    return tomllib.loads(file.read_text(encoding="utf-8"))


def entry(name: str) -> dict[str, Any]:
    """Content of an entry: name, source, note and the table `transducer`.

    Raises
    ------
    KeyError
        There is no such entry.
    """
    if name not in names():
        raise KeyError(name)
    return tomllib.loads(resources.files(__name__).joinpath(name + _SUFFIX).read_text(encoding="utf-8"))


def transducer_table(name: str, over: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Table [transducer] of an entry, with its full name, overridden by the keys of `over`, table by table.

    Raises
    ------
    KeyError
        There is no such entry.
    """
    found = entry(name)
    return _merged({"name": found["name"], **found["transducer"]}, over or {})


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with the keys of `over`; tables are merged, everything else is replaced."""
    both = {k: _merged(base[k], v) for k, v in over.items() if isinstance(v, dict) and isinstance(base.get(k), dict)}
    return {**base, **over, **both}
