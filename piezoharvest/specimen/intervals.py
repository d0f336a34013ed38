"""Intervals of simulated figures from the covariance of an identified specimen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.excitation import Excitation
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.switching import InductiveSwitch
from piezoharvest.description.system import System
from piezoharvest.engine.batch import one_of, simulate_many
from piezoharvest.engine.simulation import simulate
from piezoharvest.progress import Stage, silent
from piezoharvest.specimen.draws import drawn
from piezoharvest.specimen.file import Specimen

FIGURES = (
    "harvested_power", "mechanical_power", "efficiency", "displacement_amplitude", "voltage_amplitude", "dc_voltage",
    "attenuation_db", "figure_of_merit",
)  # fmt: skip
QUANTILES = {"p5": 0.05, "p50": 0.5, "p95": 0.95}
SEED = 1  # of all draws: the same specimens for every shunt, so that differences between shunts are theirs


def intervals(
    specimen: Specimen,
    shunt: Shunt,
    excitation: Excitation,
    samples: int,
    transient: float | None = None,
    progress: Callable[[str], object] = silent,
) -> dict[str, Any]:
    """Distribution of the figures of a simulation over draws of the specimen.

    Parameters
    ----------
    specimen : Specimen
        With a transducer.
    shunt : Shunt
        A switched loop keeps the coil, resistance and on time that it has for the identified capacitance.
    excitation : Excitation
    samples : int
        Number of draws.
    transient : float, optional
        Simulate from rest for so many seconds instead of the periodic steady state.
    progress : callable, optional
        Takes messages on how far long work is.

    Returns
    -------
    dict
        `samples`, `converged` (draws with a result, from which the rest is) and for each figure `mean`, `std`, `p5`,
        `p50` and `p95`; None where no draw has a result.

    Raises
    ------
    ParameterError
        A component does not allow a drawn value.
    """
    batch = drawn(specimen, samples, SEED)
    assert specimen.transducer is not None
    if isinstance(shunt, InductiveSwitch):
        shunt = shunt.beside(specimen.transducer.capacitance, batch.capacitance)
    system = System(batch, shunt)
    # The corners of a law stand elsewhere in each draw, where a batch has them in common.
    batched = not any(isinstance(effect, Law) for effect in batch.effects)
    if transient is None and excitation.period is not None and batched:
        columns = simulate_many(system, excitation, samples, progress=progress)
    else:
        columns = _one_by_one(system, excitation, samples, transient, progress)
    right = columns["converged"]
    found = {name: _distribution(columns[name][right & np.isfinite(columns[name])]) for name in FIGURES}
    return {"samples": samples, "converged": int(np.count_nonzero(right)), **found}


def _one_by_one(
    system: System,
    excitation: Excitation,
    samples: int,
    transient: float | None,
    progress: Callable[[str], object],
) -> Mapping[str, np.ndarray]:
    stage, responses = Stage(progress, system.shunt.kind, "draws"), []
    for n in stage.over(range(samples)):
        responses.append(simulate(one_of(system, n), excitation, transient=transient, samples=1))
    columns = {name: np.array([getattr(r, name) for r in responses], float) for name in FIGURES}
    return {**columns, "converged": np.array([r.converged for r in responses], bool)}


def _distribution(values: np.ndarray) -> dict[str, float] | None:
    if not len(values):
        return None
    quantiles = np.quantile(values, list(QUANTILES.values())).tolist()
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return {"mean": float(np.mean(values)), "std": spread, **dict(zip(QUANTILES, quantiles, strict=True))}
