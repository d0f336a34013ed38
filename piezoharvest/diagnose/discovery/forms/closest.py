"""The formula of a family that is closest to a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezoharvest.description.effects.nameless.forms import Form
from piezoharvest.description.parameters import ParameterError
from piezoharvest.diagnose.discovery.forms.distance import Distance
from piezoharvest.diagnose.discovery.forms.family import Family
from piezoharvest.diagnose.discovery.forms.knees import bent_best
from piezoharvest.diagnose.discovery.forms.projection import descended


@dataclass(frozen=True)
class FittedFormula:
    """A formula with the values that come closest to the table, and its information criterion there."""

    form: Form
    criterion: float


def closest(distance: Distance, family: Family) -> FittedFormula | None:
    """The member of a family closest to a table; None where none is finite and within its bounds."""
    found = bent_best(distance, family) if family.knees else descended(distance, family, family.starts)
    for n in np.argsort(found.cost):
        if not np.isfinite(found.cost[n]):
            break
        try:
            form = family.member(found.factors[n], found.u[n])
        except ParameterError:
            continue
        return FittedFormula(form, float(found.cost[n]) + family.free * np.log(distance.samples))
    return None
