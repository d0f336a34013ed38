"""Evaluation of a chunk of designs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.study import Study
from piezoharvest.sweep.place import place
from piezoharvest.sweep.table import paths, wanted_outputs

Answers = dict[str, np.ndarray]


def evaluate(study: Study, values: np.ndarray) -> Answers:
    """Simulate a chunk of designs with every shunt of the study.

    Parameters
    ----------
    study : Study
    values : (n, p) array
        Values of the swept parameters, a row for each design.

    Returns
    -------
    dict of (n, shunts) array
        "converged" (bool) and the outputs of the study; NaN where there is no answer.
    """
    found = [_answers(study, shunt, values) for shunt in range(len(study.shunts))]
    return {name: np.column_stack([answers[name] for answers in found]) for name in found[0]}


def _answers(study: Study, shunt: int, values: np.ndarray) -> Answers:
    """Answers with one shunt.

    A batch that cannot be built is halved down to single designs: those that are not physical have no answer, and some
    components can only be built one at a time.
    """
    from piezoharvest.engine import simulate_many  # numba: only where designs are simulated

    designs, wanted = len(values), wanted_outputs(study)
    parts = [*values.T[:, :, np.newaxis]] if designs > 1 else values[0].tolist()
    try:
        system, excitation = place(study, shunt, paths(study), parts)
        found = simulate_many(system, excitation, designs, attenuation="attenuation_db" in wanted)
    except ValueError as error:
        if designs > 1:
            halves = [_answers(study, shunt, half) for half in (values[: designs // 2], values[designs // 2 :])]
            return {name: np.concatenate([half[name] for half in halves]) for name in halves[0]}
        if not isinstance(error, ParameterError | np.linalg.LinAlgError):
            raise
        found = {"converged": np.zeros(1, bool)}
    converged = np.asarray(found["converged"], bool)
    return {"converged": converged, **{name: _output(found, name) for name in wanted}}


def _output(found: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """An output; an energy that is not in the ledger is zero wherever there is an answer."""
    if name in found:
        return np.asarray(found[name], float)
    answered = np.isfinite(found.get("energy.mechanical_in", np.full(len(found["converged"]), np.nan)))
    return np.where(answered & name.startswith("energy."), 0.0, np.nan)
