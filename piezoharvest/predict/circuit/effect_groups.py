"""Derivatives with respect to effects at their null values, a few effects at a time.

Their states have no influence on the specimen, nor on each other; all in one system would cost by the square of their
number.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from piezoharvest.predict.parameters import Parameter, put
from piezoharvest.predict.prediction import Block

if TYPE_CHECKING:
    from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction

GROUP = 4  # effects at a time


def by_groups(of: CircuitPrediction, channels: Sequence[str], size: int, derivatives: bool) -> Iterator[Block]:
    """Blocks of a prediction; values are those without the effects that have no influence by themselves."""
    felt, count = of.felt, len(of.transducer.effects)
    own = [k for k, parameter in enumerate(of.parameters) if _effect(parameter, -1) < felt]
    nuisance = range(len(of.parameters), len(of.parameters) + len(of.nuisance))
    parts = [(_part(of, range(felt), own, begin_given=False), [*own, *nuisance])]
    for first in range(felt, count, GROUP) if derivatives else ():
        group = range(first, min(first + GROUP, count))
        lanes = [k for k, parameter in enumerate(of.parameters) if _effect(parameter, -1) in group]
        if lanes:
            parts.append((_part(of, [*range(felt), *group], lanes, begin_given=True), lanes))
    runs = [part.blocks(derivatives, size, channels) for part, _ in parts]
    for blocks in zip(*runs, strict=True):
        begin, values = blocks[0].begin, blocks[0].values
        slopes = np.zeros((*values.shape, len(of.parameters) + len(of.nuisance) if derivatives else 0))
        for block, (_, lanes) in zip(blocks, parts, strict=True) if derivatives else ():
            slopes[..., lanes] = block.derivatives
        yield Block(begin, values, slopes, None)


def _effect(parameter: Parameter, otherwise: int) -> int:
    """Index of the effect that a parameter belongs to."""
    return int(parameter.path[1]) if parameter.path[0] == "effects" else otherwise


def _part(
    of: CircuitPrediction, effects: Sequence[int], lanes: Sequence[int], *, begin_given: bool
) -> CircuitPrediction:
    """Prediction with some of the effects and some of the parameters."""
    kept = list(effects)
    device = put(of.transducer, ("effects",), tuple(of.transducer.effects[n] for n in kept))

    def renumbered(parameter: Parameter) -> Parameter:
        n = _effect(parameter, -1)
        if n < 0:
            return parameter
        return replace(parameter, path=("effects", kept.index(n), *parameter.path[2:]))

    parameters = [renumbered(of.parameters[k]) for k in lanes]
    return type(of)(
        device, of.setting, parameters, of.nuisance, relaxed=of.relaxed, systems=of.systems, begin_given=begin_given,
        under_way=of.under_way,
    )  # fmt: skip
