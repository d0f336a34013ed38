"""Catalogue of transducers from data sheets and papers, and of materials: one TOML file each, named by the file.

A file holds `name`, `source` and `note` (values read, values derived and how) and a [transducer] table with the
same keys as in a study; those in `materials/` a [material] table.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

_SUFFIX = ".toml"


def toml_files(folder: str = "") -> dict[str, Traversable]:
    """TOML files of a folder beside this module, by the names of what is in them."""
    files = sorted(resources.files(__name__).joinpath(folder).iterdir(), key=lambda file: file.name)
    return {file.name.removesuffix(_SUFFIX): file for file in files if file.name.endswith(_SUFFIX)}


def content(file: Traversable) -> dict[str, Any]:
    """Tables of a file of `toml_files`."""
    return tomllib.loads(file.read_text(encoding="utf-8"))


def names() -> tuple[str, ...]:
    """Names of all entries."""
    return tuple(toml_files())


def materials() -> tuple[str, ...]:
    """Names of all materials."""
    return tuple(toml_files("materials"))


def material(name: str) -> dict[str, Any]:
    """Content of a material's file: name, source, note and the table `material` (SI units).

    Raises
    ------
    KeyError
        There is no such material.
    """
    return content(toml_files("materials")[name])


def entry(name: str) -> dict[str, Any]:
    """Content of an entry: name, source, note and the table `transducer`.

    Raises
    ------
    KeyError
        There is no such entry.
    """
    return content(toml_files()[name])


def transducer_table(name: str) -> dict[str, Any]:
    """Table [transducer] of an entry, with its full name.

    Raises
    ------
    KeyError
        There is no such entry.
    """
    found = entry(name)
    return {"name": found["name"], **found["transducer"]}


def merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with the keys of `over`; tables are merged, everything else is replaced."""
    both = {k: merged(base[k], v) for k, v in over.items() if isinstance(v, dict) and isinstance(base.get(k), dict)}
    return {**base, **over, **both}
