"""The other sign of an effect that changes nothing to first order: records may tell its size alone.

A switch that opens a little early cuts as much current as one that opens a little late. The fit ends at the sign that
it began with; the other one is fitted as well, from the same size.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.diagnose import thresholds
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.predict.parameters import put, value_at
from piezoharvest.predict.prediction import PredictionError


class OtherSign(NamedTuple):
    """Value of a strength with the other sign, and its probability by the odds of the two fits."""

    value: float
    probability: float

    def spread(self, value: float, error: float) -> float:
        """Standard error of a value with the doubt about its sign in it: that of both, by their probabilities.

        Source: Hoeting, Madigan, Raftery & Volinsky, Stat. Sci. 14(4), 382-401, 1999 (model averaging).
        """
        return float(np.hypot(error, np.sqrt(self.probability) * (value - self.value)))


def turned(problem: Problem, found: Fit, n: int) -> Fit | None:
    """Fit with the other sign of the n-th effect's strength; None where there is none, or it comes back."""
    effect = found.model.transducer.effects[n]
    path = ("effects", n, type(effect).strength().name)
    value = float(np.real(value_at(found.model.transducer, path)))
    try:
        replace(effect, **{str(path[-1]): -value})  # within its bounds
        model = replace(found.model, transducer=put(found.model.transducer, path, -value))
        other = fit(problem, model, found.nuisance, found.noise, white=found.white, estimate_noise=False)
    except (ParameterError, PredictionError, np.linalg.LinAlgError):
        return None
    return other if float(np.real(value_at(other.model.transducer, path))) * value < 0.0 else None


def better_signs(problem: Problem, found: Fit) -> tuple[Fit, dict[str, OtherSign]]:
    """The fit with the likelier signs of all effects that show by their squares, and what the other ones are.

    Returns
    -------
    found : Fit
    others : dict of str to OtherSign
        By the name of the effect; without those that are told (`CLOSE_COST`).
    """
    others = dict[str, OtherSign]()
    for n, effect in enumerate(found.model.transducer.effects):
        other = turned(problem, found, n) if effect.second_order else None
        if other is None:
            continue
        found, other = (other, found) if other.cost < found.cost else (found, other)
        more, name = other.cost - found.cost, type(effect).strength().name
        if more < thresholds.CLOSE_COST:
            value = float(getattr(other.model.transducer.effects[n], name))
            others[effect.name] = OtherSign(value, 1.0 / (1.0 + float(np.exp(0.5 * more))))
    return found, others
