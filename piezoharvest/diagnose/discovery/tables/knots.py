"""Corners of a law's table, placed by the data: where the records have been, evenly over that range, or where it bends.

Sources: Ruppert, Wand & Carroll, Semiparametric Regression, 2003, section 5.5 (knots at quantiles); de Boor, A
Practical Guide to Splines, 1978, chapter XII (knots so that each piece bends as much).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from piezoharvest.description.effects.nameless.forms import Bends, Corners, outward
from piezoharvest.description.effects.nameless.places import Place

KNOTS = 11  # the ends included: the smoothness is by the prior, so that more would only cost time
# Of a spline where the engine is needed, whose time rises with the square of their number and more: a law in the
# coupling behind a bridge takes a third of the time of ten corners, and explains 96 % as much.
KNOTS_OF_SPLINE = 7
ENDS = (0.002, 0.998)  # quantiles of the visited inputs between which corners lie
KNOTS_OF_CAMPAIGN = 16  # over the time of a campaign, whose records may be many
EVENLY = 0.2  # share of moved corners that lie evenly: where a table was straight a law may bend within a piece
NEAR_ZERO = 0.5  # of the mean distance of two corners: one that is nearer to zero is put there


def table_for(
    place: Place, visited: np.ndarray, *, smooth: bool = False, remembered: bool = False, in_engine: bool = False
) -> Corners | Bends | None:
    """A table without kinks yet; None where the input does not move.

    It is a broken line, or a quadratic spline where the place needs a slope or it shall be smooth. Of what a memory
    makes of the input a straight line is no parameter of the model. `in_engine`: records need the engine.
    """
    low, high = map(float, np.quantile(visited, ENDS))
    if not high > low:
        return None
    if place.input == "campaign_time":  # between the records nothing is known
        inner = np.unique(np.quantile(visited, np.linspace(*ENDS, KNOTS_OF_CAMPAIGN)))[1:-1]
    else:
        count = KNOTS_OF_SPLINE if in_engine and (smooth or place.needs_slope) else KNOTS
        knots = 0.5 * (np.quantile(visited, np.linspace(*ENDS, count)) + np.linspace(low, high, count))
        near = np.abs(knots) < NEAR_ZERO * (high - low) / count
        inner = knots[1:-1][~near[1:-1]]
    smooth = smooth or place.needs_slope
    first = _first_pieces(low, high, straight=smooth or remembered or not place.bent)
    if place.in_circuit and low > NEAR_ZERO * (high - low) / KNOTS:  # it begins at zero, where no record may have been
        first = [0.0, low]
    chosen = (*first, *map(float, inner))
    kind = Bends if smooth else Corners
    return kind(knots=chosen, kinks=(0.0,) * len(chosen))


def _first_pieces(low: float, high: float, *, straight: bool) -> list[float]:
    """Corner at zero, or where the first piece is a `straight` line those from zero or from the end of the range."""
    if not straight:
        return [0.0] * (low < 0.0 < high)
    first = [0.0] * (high > 0.0 and low <= 0.0) + [-0.0] * (low < 0.0 and high >= 0.0)
    return first + [low] * (low > 0.0) + [high] * (high < 0.0)


def pieces_of(form: Corners | Bends, x: np.ndarray) -> np.ndarray:
    """What each kink of a table adds at inputs (n,), for a kink of one: (n, k)."""
    pieces = np.maximum(outward(form.knots) * (x[:, None] - np.array(form.knots)), 0.0)
    return 0.5 * pieces**2 if isinstance(form, Bends) else pieces


def moved(table: Corners | Bends, visited: np.ndarray) -> Corners | Bends:
    """The table with as many corners elsewhere: where it bends most they are closest, so that each piece bends as much.

    It is about the same function; at the next fit from it corners come closer to where the law has its own.
    """
    low, high = map(float, np.quantile(visited, ENDS))
    knots, order = np.array(table.knots), 3 if isinstance(table, Bends) else 2
    first = np.isin(knots, [0.0, low, high])
    inner = int(np.sum(~first))
    ends = np.unique([low, *knots[(knots > low) & (knots < high)], high])
    change = np.array([np.sum(np.abs(np.array(table.kinks)[knots == end])) for end in ends])
    # Curvature of a piece: the changes at its corners, each over the two pieces that it is between.
    sharp = change / np.convolve(np.concatenate([[0.0], np.diff(ends), [0.0]]), [1.0, 1.0], "valid")
    bends = (sharp[1:] + sharp[:-1]) ** (1.0 / order) * np.diff(ends)
    evenly = np.diff(ends) / (high - low)
    share = EVENLY * evenly + (1.0 - EVENLY) * (bends / bends.sum() if bends.sum() > 0.0 else evenly)
    whole = np.concatenate([[0.0], np.cumsum(share)])
    places = np.interp(np.arange(1, inner + 1) / (inner + 1), whole, ends)
    chosen = (*knots[first].tolist(), *(float(k) for k in places if k != 0.0))
    again = type(table)(knots=chosen, kinks=(0.0,) * len(chosen))
    x = np.unique([*ends, *places, *(0.5 * (ends[1:] + ends[:-1]))])
    kinks = np.linalg.lstsq(pieces_of(again, x), table.values(x))[0]
    return replace(again, kinks=tuple(map(float, kinks)))
