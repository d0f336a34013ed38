"""Transducers with their data-sheet or paper source: one TOML file each, called by the file's name.

A file holds `name`, `source` and `note` (what was read, what was derived and how) and a [transducer] table with the
keys that a study's has.
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


def entry(name: str) -> dict[str, Any]:
    """Content of an entry: name, source, note and the table `transducer`.

    Raises
    ------
    KeyError
        There is no entry of this name.
    """
    if name not in names():
        raise KeyError(name)
    return tomllib.loads(resources.files(__name__).joinpath(name + _SUFFIX).read_text(encoding="utf-8"))


def transducer_table(name: str, over: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Table [transducer] of an entry, with its full name, overridden by the keys of `over`: tables key by key.

    Raises
    ------
    KeyError
        There is no entry of this name.
    """
    found = entry(name)
    return _merged({"name": found["name"], **found["transducer"]}, over or {})


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with the keys of `over`; tables are merged, everything else is replaced."""
    both = {k: _merged(base[k], v) for k, v in over.items() if isinstance(v, dict) and isinstance(base.get(k), dict)}
    return {**base, **over, **both}
