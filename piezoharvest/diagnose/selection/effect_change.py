"""A fit of a model with one effect more or less, and what identifies its effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from piezoharvest.description.effects import Effect
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.diagnose import thresholds
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.model import Model
from piezoharvest.predict.parameters import put


@dataclass(frozen=True)
class EffectChange:
    """A fit of a model with one effect more or less.

    Attributes
    ----------
    found : Fit
    begun : int
        Number of initial states of effects that are fitted, of all records.
    """

    found: Fit
    begun: int = 0

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the model's effects."""
        return tuple(effect.name for effect in self.found.model.transducer.effects)

    @property
    def cost(self) -> float:
        """-2 ln L up to a constant."""
        return self.found.cost

    @property
    def fair_cost(self) -> float:
        """Cost plus two per parameter of effects (Akaike), for comparing sets of different sizes."""
        model = self.found.model
        fitted = sum(parameter.path[0] == "effects" for parameter in model.parameters)
        scanned = sum(effect.scanned for effect in model.transducer.effects)
        return self.cost + 2.0 * (fitted + scanned + self.begun)


def names_apart(effects: Sequence[Effect], others: Sequence[Effect]) -> tuple[str, ...]:
    """Names of effects, of a law with its input where one of the others has its name.

    A parameter may change with one size of the drive or with another.
    """
    names = {other.name for other in others if other not in effects}
    return tuple(
        f"{each.name} of {each.place.input}" if isinstance(each, Law) and each.name in names else each.name
        for each in effects
    )


def cost_to_reach(others: Sequence[EffectChange]) -> float:
    """Cost that another fit has to reach to be of interest beside these."""
    return min((other.fair_cost for other in others), default=np.inf) + thresholds.CLOSE_COST


def effect_key(effect: Effect) -> str:
    """Identity of an effect in fits: its name with its channel or label."""
    labels = [field.name for field in fields(effect) if field.default is None or "unit" not in field.metadata]
    return " ".join([effect.name, *(str(getattr(effect, name)) for name in labels)])


def effect_keys(model: Model) -> tuple[str, ...]:
    """Identities of a model's effects."""
    return tuple(effect_key(effect) for effect in model.transducer.effects)


def model_without(model: Model, n: int) -> Model:
    """Model without its n-th effect."""
    effects = model.transducer.effects
    kept = [k for k in range(len(effects)) if k != n]
    parameters = []
    for parameter in model.parameters:
        if parameter.path[0] != "effects":
            parameters.append(parameter)
        elif parameter.path[1] in kept:
            path = ("effects", kept.index(parameter.path[1]), *parameter.path[2:])
            parameters.append(replace(parameter, path=path))
    transducer = put(model.transducer, ("effects",), tuple(effects[k] for k in kept))
    return replace(model, transducer=transducer, parameters=tuple(parameters))
