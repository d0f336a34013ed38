"""Random specimens on the virtual bench: campaigns like the paper's, identified from wrong nominal values."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from piezoharvest.bench import measure, write_campaign
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.transducer import Transducer
from piezoharvest.identify import identify
from piezoharvest.predict.parameters import value_at
from piezoharvest.records import load_campaign
from piezoharvest.study import Study, load_study

STUDY = Path(__file__).parents[2] / "designs" / "paper_campaign" / "study.toml"
OFF = 0.3  # largest relative error of a nominal value
_SINGLE = ("mass", "damping", "stiffness", "coupling", "capacitance")


def specimen(nominal: Transducer, seed: int, off: float = OFF) -> Transducer:
    """Specimen whose parameters lie anywhere within `off` of the nominal ones, each by a draw of its own."""
    rng = np.random.default_rng([seed, 7])

    def drawn(value: float) -> float:
        return value * rng.uniform(1.0 - off, 1.0 + off)

    values: dict[str, Any] = {key: drawn(getattr(nominal, key)) for key in _SINGLE}
    if nominal.hysteresis is not None:
        thresholds = tuple(map(drawn, nominal.hysteresis.thresholds))
        values["hysteresis"] = Hysteresis(thresholds=thresholds, weights=tuple(map(drawn, nominal.hysteresis.weights)))
    return replace(nominal, **values)


def campaign_of(seed: int, folder: Path, off: float = OFF) -> tuple[Path, Transducer]:
    """Measure a specimen and write its campaign, whose nominal values are those of the study.

    Returns
    -------
    Path
        The campaign file.
    Transducer
        What stood on the bench.
    """
    study: Study = load_study(STUDY)
    bench = {**study.bench, "seed": seed, "nominal_error": 0.0}
    truth = specimen(study.transducer, seed, off)
    measured = measure(replace(study, transducer=truth, bench=bench))
    return write_campaign(replace(measured, nominal=study.transducer), folder), truth


def identified(seed: int, off: float = OFF) -> Mapping[str, Any]:
    """Measure and identify a specimen: values and standard errors against the truth, and how long the fit took.

    Times are without the import and compilation, which a first call pays.
    """
    with tempfile.TemporaryDirectory() as folder:
        path, truth = campaign_of(seed, Path(folder) / "campaign", off)
        campaign = load_campaign(path)
        cpu, wall = time.process_time(), time.perf_counter()
        found = identify(campaign)
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    parameters = {
        e.parameter.name: {
            "truth": float(value_at(truth, e.parameter.path)), "nominal": e.nominal, "value": e.value,
            "std": e.std, "identifiable": e.identifiable,
        }
        for e in found.estimates
    }  # fmt: skip
    return {
        "seed": seed, "parameters": parameters, "converged": found.converged, "message": found.message,
        "cost": found.found.cost, "cpu": cpu, "wall": wall,
        "rms": dict(found.validation.rms), "noise": dict(found.validation.noise),
    }  # fmt: skip
