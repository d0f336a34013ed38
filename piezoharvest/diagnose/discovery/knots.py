"""Corners of a law's table, placed by the data: where the records have been, and evenly over that range.

Source: Ruppert, Wand & Carroll, Semiparametric Regression, 2003, section 5.5 (knots at quantiles).
"""

from __future__ import annotations

import numpy as np

from piezoharvest.description.effects.nameless.forms import Bends, Corners
from piezoharvest.description.effects.nameless.places import Place

KNOTS = 11  # the ends included: the smoothness is by the prior, so that more would only cost time
ENDS = (0.002, 0.998)  # quantiles of the visited inputs between which corners lie
KNOTS_OF_CAMPAIGN = 16  # over the time of a campaign, whose records may be many
NEAR_ZERO = 0.5  # of the mean distance of two corners: one that is nearer to zero is put there


def table_for(
    place: Place, visited: np.ndarray, *, smooth: bool = False, remembered: bool = False
) -> Corners | Bends | None:
    """A table without kinks yet; None where the input does not move.

    It is a broken line, or a quadratic spline where the place needs a slope or it shall be smooth. Of what a memory
    makes of the input a straight line is no parameter of the model.
    """
    low, high = map(float, np.quantile(visited, ENDS))
    if not high > low:
        return None
    if place.input == "campaign_time":  # between the records nothing is known
        inner = np.unique(np.quantile(visited, np.linspace(*ENDS, KNOTS_OF_CAMPAIGN)))[1:-1]
    else:
        knots = 0.5 * (np.quantile(visited, np.linspace(*ENDS, KNOTS)) + np.linspace(low, high, KNOTS))
        near = np.abs(knots) < NEAR_ZERO * (high - low) / KNOTS
        inner = knots[1:-1][~near[1:-1]]
    smooth = smooth or place.needs_slope
    if smooth or remembered or not place.bent:
        # The first piece is a straight line from zero, or from the end of the range.
        first = [0.0] * (high > 0.0 and low <= 0.0) + [-0.0] * (low < 0.0 and high >= 0.0)
        first += [low] * (low > 0.0) + [high] * (high < 0.0)
    else:
        first = [0.0] * (low < 0.0 < high)
    chosen = tuple(float(k) for k in (*first, *inner))
    kind = Bends if smooth else Corners
    return kind(knots=chosen, kinks=(0.0,) * len(chosen))
