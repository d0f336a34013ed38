"""Campaigns in a folder: which files they are, and what their diagnoses depend on."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from piezoharvest import __version__
from piezoharvest.study import StudyError

OF_CAMPAIGNS = ("records", "specimens")  # keys that no other file of this package has


def campaigns_in(folder: Path) -> list[Path]:
    """Campaign files in a folder and in those inside of it, in the order of their paths.

    A file that is no TOML at all is taken for one, so that its error is told; studies and saved specimens are not.

    Raises
    ------
    StudyError
        There is no such folder, or no campaign in it.
    """
    if not folder.is_dir():
        raise StudyError(folder, "", "there is no such folder")
    found = [path for path in sorted(folder.rglob("*.toml")) if path.is_file() and _may_be_one(path)]
    if not found:
        raise StudyError(folder, "", "found no campaign (a .toml file with tables [[records]]) in this folder")
    return found


def _may_be_one(path: Path) -> bool:
    try:
        return any(key in _read(path) for key in OF_CAMPAIGNS)
    except (OSError, ValueError):
        return True


def _read(path: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        return tomllib.load(file)


def fingerprint(path: Path, effects: list[Path]) -> str:
    """Hash of all that a diagnosis depends on: the campaign, the files it names, effect files, the version."""
    found = hashlib.sha256(__version__.encode())
    for file in (path, *effects, *_named(path)):
        found.update(file.name.encode())
        if file.is_file():
            with file.open("rb") as stream:
                found.update(hashlib.file_digest(stream, "sha256").digest())
    return found.hexdigest()[:32]


def _named(path: Path) -> list[Path]:
    """Files that a campaign names in any of its tables."""
    try:
        texts = sorted(set(_texts(_read(path))))
        return [file for file in (path.parent / text for text in texts if len(text) < 1000) if file.is_file()]
    except (OSError, ValueError):
        return []


def _texts(value: Any) -> Iterator[str]:
    """All texts of a table and of those inside of it."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for each in value:
            yield from _texts(each)
    elif isinstance(value, str):
        yield value
