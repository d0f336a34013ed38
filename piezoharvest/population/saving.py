"""Specimen files of several specimens: one of the kind, with its spread as the uncertainty, and one of each."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from piezoharvest.identify.saving import Estimated, save
from piezoharvest.population.pooling import Pooled, kind_as_fit
from piezoharvest.records.specimens import SpecimenSet


def save_all(
    together: Pooled, estimates: Sequence[Sequence[Estimated]], specimens: SpecimenSet, path: str | Path, **source: Any
) -> list[Path]:
    """Write the specimen file of the kind, and beside it one of each specimen; return the paths.

    A study of the kind's file with its uncertainty is one of a specimen that was not measured.

    Parameters
    ----------
    together : Pooled
    estimates : sequence of sequences of Estimate
        Of each specimen.
    specimens : SpecimenSet
    path : str or Path
        Of the kind's file; that of a specimen has its name added.
    **source
        Added to the tables `source`.

    Raises
    ------
    OutputError
        A file cannot be written.
    """
    path = Path(path)
    kind = next(n for n in range(len(together.fits)) if n not in together.apart)
    records = tuple(record for campaign in specimens.campaigns for record in campaign.records)
    every = replace(specimens.campaigns[kind], title=specimens.title, records=records)
    mean, scatter = kind_as_fit(together, kind)
    save(mean, estimates[kind], every, path, scatter, **source, specimens=list(specimens.names))
    paths = [path]
    for n, campaign in enumerate(specimens.campaigns):
        paths.append(path.with_stem(f"{path.stem}_{_file_name(specimens.names, n)}"))
        save(together.fits[n], estimates[n], campaign, paths[-1], together.scatter[n], **source)
    return paths


def _file_name(names: Sequence[str], n: int) -> str:
    """A specimen's name as part of a file's; its number where another one has the same."""
    plain = [re.sub(r"[^\w-]+", "_", name) for name in names]
    return plain[n] if plain.count(plain[n]) == 1 else f"{plain[n]}_{n + 1}"
