"""Single samples far off those beside them: a glitch of a converter, a number that is cut off at the end of a file."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d

from piezoharvest.description.shunts import LinearShunt
from piezoharvest.records.checks.level import flat_runs, level_of
from piezoharvest.records.finding import Finding, counted, runs, shifted
from piezoharvest.records.record import Record

_LONGEST = 3  # samples of a spike
_RARE = 1e-3  # of all samples
_NEARBY = 4 * _LONGEST + 1  # samples
_STANDS_OUT = 20.0  # resolutions
_MOVES = 5.0  # times the median motion in so many samples
_BEYOND = 3.0  # times how far a channel bends nearby


def spikes(record: Record) -> Iterator[Finding]:
    """Samples that leap away and come back at once while no other channel moves more than it usually does.

    Behind switches and diodes currents flow in pulses, and so they do under a staircase whose steps noise hides: what
    comes often is no glitch.
    """
    if record.shunt is not None and not isinstance(record.shunt, LinearShunt):
        return
    if len(record) < 4 * _LONGEST:
        return
    resolution = {c: level_of(s.values, flat_runs(s.values)).resolution for c, s in record.signals.items()}
    moves = {c: _moves(s.values) for c, s in record.signals.items()}
    for channel, signal in record.signals.items():
        others = [moves[c] for c in record.signals if c != channel]
        far = _far(signal.values, resolution[channel]) & ~np.any(others, axis=0)
        found = runs(far)
        found = found[found[:, 1] - found[:, 0] < _LONGEST]
        count = int(np.sum(found[:, 1] - found[:, 0] + 1))
        if others and 0 < count <= max(_RARE * len(record), _LONGEST):
            message = f"found {counted(count, 'sample')} far off the others while nothing else moves, allowed are none"
            yield Finding("warning", "spike", signal.file, channel, shifted(found, signal.first_row), message)


def _far(values: np.ndarray, resolution: float) -> np.ndarray:
    """Where samples are far off the median of those beside them, which bend less from one side to the other."""
    smooth = median_filter(values, 2 * _LONGEST + 1, mode="mirror")
    side = _LONGEST + 1
    wide = np.pad(smooth, side, mode="reflect", reflect_type="odd")
    bend = maximum_filter1d(np.abs(wide[: -2 * side] - 2 * smooth + wide[2 * side :]), _NEARBY)
    far = np.abs(values - smooth) > np.maximum(_STANDS_OUT * resolution, _BEYOND * bend)
    far[:_LONGEST] = False  # a drive may come upon a specimen at rest
    return far


def _moves(values: np.ndarray) -> np.ndarray:
    """Where a channel moves more than it usually does within a few samples."""
    motion = maximum_filter1d(values, _NEARBY) - minimum_filter1d(values, _NEARBY)
    return motion > _MOVES * np.median(motion)
