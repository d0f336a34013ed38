"""Check for single outliers: a glitch of a converter, a truncated number at the end of a file."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d

from piezoharvest.counting import counted
from piezoharvest.description.shunts import LinearShunt
from piezoharvest.records.checks.level import flat_runs, level_of
from piezoharvest.records.finding import Finding, runs, shifted
from piezoharvest.records.record import Record

_MAX_SPIKE = 3  # samples of a spike
_MAX_SHARE = 1e-3  # of all samples
_NEIGHBOURHOOD = 4 * _MAX_SPIKE + 1  # samples
_MIN_HEIGHT = 20.0  # resolutions
_MAX_MOTION = 5.0  # times the median motion within that many samples
_MIN_CURVATURE_RATIO = 3.0  # times the curvature of the channel nearby


def spikes(record: Record) -> Iterator[Finding]:
    """Check for samples that jump and return at once while no other channel moves more than usual.

    Behind switches and diodes currents flow in pulses, and also under a staircase whose steps are hidden by noise:
    frequent outliers are not glitches.
    """
    if record.shunt is not None and not isinstance(record.shunt, LinearShunt):
        return
    if len(record) < 4 * _MAX_SPIKE:
        return
    resolution = {c: level_of(s.values, flat_runs(s.values)).resolution for c, s in record.signals.items()}
    moves = {c: _moving(s.values) for c, s in record.signals.items()}
    for channel, signal in record.signals.items():
        others = [moves[c] for c in record.signals if c != channel]
        far = _outliers(signal.values, resolution[channel]) & ~np.any(others, axis=0)
        found = runs(far)
        found = found[found[:, 1] - found[:, 0] < _MAX_SPIKE]
        count = int(np.sum(found[:, 1] - found[:, 0] + 1))
        if others and 0 < count <= max(_MAX_SHARE * len(record), _MAX_SPIKE):
            message = (
                f"found {counted(count, 'sample')} far from the others while no other channel changes; likely spikes"
            )
            yield Finding("warning", "spike", signal.file, channel, shifted(found, signal.first_row), message)


def _outliers(values: np.ndarray, resolution: float) -> np.ndarray:
    """Mask of samples whose distance from the median of their neighbours is large against the curvature of these."""
    smooth = median_filter(values, 2 * _MAX_SPIKE + 1, mode="mirror")
    side = _MAX_SPIKE + 1
    wide = np.pad(smooth, side, mode="reflect", reflect_type="odd")
    bend = maximum_filter1d(np.abs(wide[: -2 * side] - 2 * smooth + wide[2 * side :]), _NEIGHBOURHOOD)
    far = np.abs(values - smooth) > np.maximum(_MIN_HEIGHT * resolution, _MIN_CURVATURE_RATIO * bend)
    far[:_MAX_SPIKE] = False  # the drive may start suddenly
    return far


def _moving(values: np.ndarray) -> np.ndarray:
    """Mask of samples around which a channel moves more than usual."""
    motion = maximum_filter1d(values, _NEIGHBOURHOOD) - minimum_filter1d(values, _NEIGHBOURHOOD)
    return motion > _MAX_MOTION * np.median(motion)
