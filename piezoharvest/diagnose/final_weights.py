"""Parameters of the extended model, with the weights that measured responses have once the effects are in it."""

from __future__ import annotations

from dataclasses import replace

from piezoharvest.diagnose.extended_estimates import estimates_with_effects
from piezoharvest.diagnose.named_effects import values_of
from piezoharvest.diagnose.result import Diagnosis
from piezoharvest.diagnose.validation import validated
from piezoharvest.identify.identification import with_final_weights
from piezoharvest.identify.residual_quality import combined_quality, judged


def finally_weighted(found: Diagnosis) -> Diagnosis:
    """The diagnosis, with parameters fitted anew where responses had less weight because effects were missing.

    A search keeps the weights of the model without effects, so that all of its fits can be compared. With a response
    that this one missed by a hundred times its noise, standard errors would be a hundred times too large.
    """
    search = found.search
    if not search.nested or found.discovery:
        return found
    final = with_final_weights(found.problem, search.final)
    if final is search.final or not final.converged:
        return found
    last = replace(search, nested=(*search.nested[:-1], final))
    values = {effect.name: values_of(found.problem, last, n)[0] for n, effect in enumerate(search.order)}
    unseen, (check,) = validated(found.campaign, found.before, [final])
    return replace(
        found, search=last, estimates=tuple(estimates_with_effects(found.before, final)),
        effects=tuple(replace(each, values=values.get(each.effect.name, each.values)) for each in found.effects),
        validation_after=combined_quality(judged(unseen.data, check)),
    )  # fmt: skip
