"""What a finding of the audit is: words with gaps, and the numbers that fill them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

WORDS = Path(__file__).parent / "findings.toml"
Confidence = Literal["certain", "likely", "undecidable"]


@dataclass(frozen=True)
class Finding:
    """A claim about the printed numbers, with the arithmetic that shows it.

    Attributes
    ----------
    name : str
        Unique.
    subject : tuple of str
        Tables, equations or sections that it is about.
    claim : str
    evidence : str
        The arithmetic, with its numbers.
    confidence : "certain", "likely" or "undecidable"
        Of the claim; "undecidable": the paper leaves both readings open, which the claim then names.
    consequence : str
        What it means for the paper's conclusions.
    supported : bool
        Whether the numbers, as computed from the data files, do show what the claim says.
    alternatives : str
        Other readings of the same numbers, and what speaks against them.
    numbers : dict
        What the words quote, in the units that the keys name; two numbers are the least and the largest.
    """

    name: str
    subject: tuple[str, ...]
    claim: str
    evidence: str
    confidence: Confidence
    consequence: str
    supported: bool
    alternatives: str
    numbers: dict[str, Any]


@cache
def _words() -> dict[str, dict[str, Any]]:
    return tomllib.loads(WORDS.read_text(encoding="utf-8"))


def finding(name: str, supported: bool | np.bool, /, **numbers: Any) -> Finding:
    """The finding of this name, its words from findings.toml with the numbers put in.

    Raises
    ------
    KeyError
        There are no words of this name, or they name a number that is not given.
    """
    entry = _words()[name]
    keys = ("claim", "evidence", "consequence", "alternatives")
    texts = {key: entry.get(key, "").strip().format(**numbers) for key in keys}
    return Finding(
        name=name,
        subject=tuple(entry["subject"]),
        confidence=entry["confidence"],
        supported=bool(supported),
        numbers=numbers,
        **texts,
    )


def span(values: Iterable[float]) -> list[float]:
    """The least and the largest."""
    found = [float(value) for value in values]
    return [min(found), max(found)]


def mean(values: Iterable[float]) -> float:
    """Arithmetic mean."""
    return float(np.mean(list(values)))
