"""The specimen file of a fit: what it has identified, how well, and from which data."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

import numpy as np

import piezoharvest
from piezoharvest.description.effects.nameless.kinds import in_a_path
from piezoharvest.description.figures.base import POSITIVE_COUPLING
from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import covariance
from piezoharvest.predict.parameters import Parameter, value_at
from piezoharvest.records.campaign import Campaign
from piezoharvest.records.record import Record
from piezoharvest.specimen import Specimen, write_specimen


class Estimated(Protocol):
    """An estimate as far as a file needs it."""

    @property
    def parameter(self) -> Parameter:
        """What is estimated."""
        ...

    @property
    def identifiable(self) -> bool:
        """True if the data determine it."""
        ...

    @property
    def experiment(self) -> str:
        """The measurement that would determine it."""
        ...

    @property
    def note(self) -> str:
        """Remark, such as that the sign is the nominal one; empty if there is none."""
        ...


def save(
    found: Fit,
    estimates: Sequence[Estimated],
    campaign: Campaign,
    path: str | Path,
    scatter: np.ndarray | None = None,
    **source: Any,
) -> None:
    """Write the specimen of a fit as TOML, completely or not at all; `source` is added to the table of that name.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    write_specimen(specimen_of(found, estimates, campaign, scatter, **source), path, campaign.title)


def specimen_of(
    found: Fit, estimates: Sequence[Estimated], campaign: Campaign, scatter: np.ndarray | None = None, **source: Any
) -> Specimen:
    """Specimen of a fit: its transducer without errors of sensors, and the covariance of what was fitted of it.

    The covariance of all parameters of the fit is `scatter`, where there is a better one than its own.
    """
    scatter = covariance(found) if scatter is None else scatter
    fitted = found.model.transducer
    own = [n for n, effect in enumerate(fitted.effects) if effect.of_specimen]
    places = [k for k, p in enumerate(found.model.parameters) if p.path[0] != "effects" or p.path[1] in own]
    parameters = [found.model.parameters[k] for k in places]
    numbers = [float(np.real(value_at(fitted, parameter.path))) for parameter in parameters]
    slopes = [parameter.derivative(value) for parameter, value in zip(parameters, numbers, strict=True)]
    names = [_name(parameter, fitted) for parameter in parameters]
    transducer = replace(fitted, effects=tuple(fitted.effects[n] for n in own), quasi_static=bool(campaign.unknown))
    if all(e.identifiable for e in estimates):  # what was assumed is behind the nominal values, of which none is left
        signs = [text for text in transducer.assumptions if text == POSITIVE_COUPLING]
        transducer = replace(transducer, assumptions=tuple(signs) if any(e.note for e in estimates) else ())
    return Specimen(
        values=dict(zip(names, numbers, strict=True)),
        covariance=scatter[np.ix_(places, places)] * np.outer(slopes, slopes),
        scaling=tuple(parameter.scaling for parameter in parameters),
        transducer=_sorted(transducer),
        lacking={e.parameter.name: e.experiment for e in estimates if not e.identifiable},
        measurement=tuple(effect for n, effect in enumerate(fitted.effects) if n not in own),
        unknown=campaign.unknown,
        source={**source, **_source(campaign)},
    )


def _name(parameter: Parameter, transducer: Transducer) -> str:
    """Path of a parameter in a specimen file: effects by name, operators in the order of their thresholds."""
    words = [str(part) for part in parameter.path]
    if parameter.path[0] == "effects":
        words[1] = in_a_path(transducer.effects[int(words[1])].name)
    elif parameter.path[0] == "hysteresis" and transducer.hysteresis is not None:
        words[2] = str(int(np.argsort(np.argsort(transducer.hysteresis.thresholds))[int(words[2])]))
    return ".".join(words)


def _sorted(transducer: Transducer) -> Transducer:
    """The transducer with its operators in the order of their thresholds, which a fit may have changed."""
    if transducer.hysteresis is None:
        return transducer
    pairs = sorted(zip(transducer.hysteresis.thresholds, transducer.hysteresis.weights, strict=True))
    thresholds, weights = zip(*pairs, strict=True)
    return replace(transducer, hysteresis=replace(transducer.hysteresis, thresholds=thresholds, weights=weights))


def _source(campaign: Campaign) -> dict[str, Any]:
    """Campaign and data files with their hashes, version and date."""
    names: dict[str, str] = {}
    for record in campaign.records:
        signals = [record.time, *record.signals.values()] if isinstance(record, Record) else []
        names |= {name: record.role for name in (record.name, *(signal.file for signal in signals))}
    folder = campaign.path.parent
    files = [{"file": name, "role": role, "sha256": _hash(folder / name)} for name, role in names.items()]
    return {
        "campaign": str(campaign.path),
        "campaign_sha256": _hash(campaign.path),
        "files": files,
        "version": piezoharvest.__version__,
        "date": datetime.now(UTC).replace(microsecond=0),
    }


def _hash(path: Path) -> str:
    """SHA-256 of a file; empty where it has gone since it was read, or never was one."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return ""
