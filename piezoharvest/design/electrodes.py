"""Designs at further electrodes: the structure as the circuits there see it, and their results in the study's numbers.

A circuit is designed where it is at electrodes 0. For one at others these change places with electrodes 0, in the
transducer and in the circuits, as all electrodes are alike but for hysteresis and effects.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import Shunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.design.drafts import Draft
from piezoharvest.design.front import Front
from piezoharvest.design.result import Candidate
from piezoharvest.study import DesignOptions


def check_places(transducer: Transducer, shunts: Sequence[Shunt], options: DesignOptions) -> None:
    """Raise `ParameterError` if a shunt is where a design cannot have it."""
    for n, shunt in enumerate(shunts):
        if not shunt.electrode:
            continue
        own = "hysteresis" if transducer.hysteresis else "effects" if transducer.effects else ""
        if own:
            why = f"must be 0, as the transducer has {own}, beside which a design is at its own electrodes"
            raise ParameterError(f"shunts.{n}.electrode", f"found {shunt.electrode}, {why}")
        if options.tolerance:
            why = "must be 0 beside design.tolerance, which is that of the transducer's own electrodes"
            raise ParameterError(f"shunts.{n}.electrode", f"found {shunt.electrode}, {why}")


def moved(draft: Draft) -> Draft:
    """The draft at electrodes 0, of the structure as its circuit sees it."""
    return dataclasses.replace(draft, shunt=draft.shunt.swapped(draft.shunt.electrode))


def moved_back(candidate: Candidate, number: int) -> Candidate:
    """A candidate at electrodes 0 in the numbers of the study."""
    parts = candidate.parts and dataclasses.replace(candidate.parts, shunt=candidate.parts.shunt.swapped(number))
    return dataclasses.replace(candidate, shunt=candidate.shunt.swapped(number), parts=parts)


def front_back(front: Front, number: int) -> Front:
    """A front at electrodes 0 in the numbers of the study."""
    points = tuple(dataclasses.replace(point, shunt=point.shunt.swapped(number)) for point in front.points)
    return dataclasses.replace(front, points=points)


def about_places(transducer: Transducer, drafts: Sequence[Draft], options: DesignOptions) -> Iterator[str]:
    """Remarks on where the circuits of a design are, in words."""
    if not transducer.electrodes:
        return
    taken = {draft.shunt.taken for draft in drafts}
    if taken == {(0,)}:
        yield (
            "all shunts are at electrode 0, the others being open: a [[shunts]] table with electrode, or with "
            "[[shunts.others]], has them elsewhere, or at several together"
        )
    if len(taken) > 1:
        yield "attenuations are against shorts of the electrodes that each shunt is at, and not all of the same"
    if options.max_voltage is not None and any(len(each) > 1 for each in taken):
        yield "max_voltage is that of the electrodes of the shunt itself, not of those of its others"
