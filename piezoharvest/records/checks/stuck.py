"""Checks for channels that wrongly stand still: constant throughout, clipped at an end of their range, or frozen."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.shunts import LinearShunt, Open, Short
from piezoharvest.records.checks.frozen import longer_than_noise, responses_move, resumes_elsewhere, runs_at_limits
from piezoharvest.records.checks.level import Level, flat_runs, level_of
from piezoharvest.records.finding import Finding, shifted
from piezoharvest.records.record import Record, Signal

_MIN_FROZEN = 8
_MIN_CLIPPED_HEIGHT = 6.0  # resolutions by which a clipped rounded top exceeds the limit
_BLOCKED_RANGE = 0.2  # of the drive's range
# Resolutions: the rounded top of a sampled signal falls by 3 within half of the run's length, the flattest by 15.
_MIN_CORNER = 16.0

_FaultyRuns = tuple[np.ndarray, np.ndarray]  # faulty runs (runs, 2), and a mask of those that are certain


def constant(record: Record) -> Iterator[Finding]:
    """Check for channels with the same value throughout."""
    silent = _may_be_constant(record)
    for channel, signal in record.signals.items():
        if signal.values.min() < signal.values.max() or channel in silent:
            continue
        which = "the drive" if channel == record.drive else "the channel"
        message = f"found {signal.values[0]:.6g} in all samples, but {which} must change"
        rows = shifted([(0, len(record) - 1)], signal.first_row)
        yield Finding("error", "constant", signal.file, channel, rows, message)


def _may_be_constant(record: Record) -> set[str]:
    """Channels that may be constant: voltage across a short, current of an open circuit, force on a free actuator.

    Behind switches and diodes voltages are held and currents blocked; a switch may never act.
    """
    if record.drive == "voltage":
        return {"force", "gate"}
    if not isinstance(record.shunt, LinearShunt):
        return {"voltage", "current", "dc_voltage", "dc_current", "gate"}
    return {"voltage"} if isinstance(record.shunt, Short) else {"current"} if isinstance(record.shunt, Open) else set()


def standing_still(record: Record) -> Iterator[Finding]:
    """Check for runs of exactly equal values that neither the signal itself nor a resting drive explains."""
    flat = {channel: flat_runs(signal.values) for channel, signal in record.signals.items()}
    levels = {channel: level_of(record[channel], runs_of) for channel, runs_of in flat.items()}
    for channel, signal in record.signals.items():
        if levels[channel].range == 0:
            continue
        held, values = channel in _may_be_constant(record), record[channel]
        judge = _drive_stuck if channel == record.drive else _nothing if held else _response_stuck
        found, sure = judge(record, channel, flat[channel], levels)
        thin = runs_at_limits(values, levels[channel], held=held)
        other = ~np.isin(values[found[:, 0]], values[thin[:, 0]])
        ranges, sure = np.concatenate((found[other], thin)), np.append(sure[other], np.zeros(len(thin), bool))
        yield from _findings(signal, channel, ranges, sure)


def _findings(signal: Signal, channel: str, ranges: np.ndarray, sure: np.ndarray) -> Iterator[Finding]:
    """Findings for runs: clipped at the largest or the least value of the record, frozen elsewhere."""
    values = signal.values
    at = values[ranges[:, 0]]
    for limit, side in ((values.max(), "largest"), (values.min(), "smallest")):
        clipped = ranges[at == limit]
        if len(clipped):
            count = int(np.sum(clipped[:, 1] - clipped[:, 0] + 1))
            found = f"found {counted(count, 'sample')} pinned at the {side} value, {limit:.6g}"
            message = f"{found}; likely the range of the sensor or converter is exceeded"
            yield Finding("warning", "clipped", signal.file, channel, shifted(clipped, signal.first_row), message)
    inner = (at != values.max()) & (at != values.min())
    for sure_of_it, frozen in ((True, ranges[inner & sure]), (False, ranges[inner & ~sure])):
        if len(frozen):
            count = int(np.sum(frozen[:, 1] - frozen[:, 0] + 1))
            found = f"found {counted(count, 'equal sample')} in a row while other channels change"
            rows = shifted(frozen, signal.first_row)
            message = f"{found}; likely a dead channel"
            yield Finding("error" if sure_of_it else "warning", "frozen", signal.file, channel, rows, message)


def _nothing(record: Record, channel: str, flat: np.ndarray, levels: dict[str, Level]) -> _FaultyRuns:
    """No run of a channel that may stand still."""
    return flat[:0], np.zeros(0, bool)


def _response_stuck(record: Record, channel: str, flat: np.ndarray, levels: dict[str, Level]) -> _FaultyRuns:
    """Runs of a response without its noise, or with a corner at both ends, while the drive moves.

    A corner alone is no proof: a joint may stick.
    """
    values, drive = record[channel], record[record.drive]
    level, of_drive = levels[channel], levels[record.drive]
    begin, end = flat.T
    length = end - begin + 1
    if level.noisy:
        resting = _curvature(drive, begin, end) == 0
        found = flat[longer_than_noise(flat, values, level) & ~resting]
        return found, np.ones(len(found), bool)
    half = np.clip(length // 2, 1, 20)
    inside = (begin >= half) & (end + half < len(values))
    before, after = np.maximum(begin - half, 0), np.minimum(end + half, len(values) - 1)
    top = values[begin]
    fall = np.minimum(np.abs(values[before] - top), np.abs(values[after] - top))
    corner = inside & (fall > _MIN_CORNER * level.resolution)
    extreme = (top == values.max()) | (top == values.min())
    enough = extreme | (length >= _MIN_FROZEN)
    # Below this tolerance the response to the drive's curvature is three resolutions at most: it may be at rest.
    tolerance = max(8 * of_drive.noise, 3 * level.resolution * of_drive.range / level.range)
    # Hysteresis that sticks keeps charge from moving for a while, whatever the drive does.
    blocked = of_drive.range * _BLOCKED_RANGE * (channel in ("voltage", "current")) * ~extreme
    found = flat[corner & enough & (_curvature(drive, begin, end) > np.maximum(tolerance, blocked))]
    return found, np.zeros(len(found), bool)


def _curvature(drive: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Deviation of the drive from a straight line through its values at both ends of a run."""
    bend = np.zeros(len(begin))
    for part in (0.25, 0.5, 0.75):
        inner = begin + (part * (end - begin)).astype(int)
        chord = drive[begin] + (drive[end] - drive[begin]) * (inner - begin) / (end - begin)
        bend = np.maximum(bend, np.abs(drive[inner] - chord))
    return bend


def _drive_stuck(record: Record, channel: str, flat: np.ndarray, levels: dict[str, Level]) -> _FaultyRuns:
    """Runs in which the drive is faulty: it may rest at any value, unless the responses keep moving.

    Rest before and after a burst, and at zero, is intended. Without noise, a clipped drive differs from a drive at rest
    by its flanks: those of a rounded top are a parabola, those of a ramp are straight. With noise, a drive that stops
    is certainly dead if all responses keep moving and it resumes at another value.
    """
    values, level = record[channel], levels[channel]
    at = values[flat[:, 0]]
    flat = flat[(at != values[0]) & (at != values[-1]) & (at != 0)]
    if level.noisy:
        flat = flat[longer_than_noise(flat, values, level)]
        extreme = np.isin(values[flat[:, 0]], (values.max(), values.min()))
        found = flat[
            [end or responses_move(record, run[0], run[1], levels) for end, run in zip(extreme, flat, strict=True)]
        ]
        return found, np.array([resumes_elsewhere(values, run[0], run[1]) for run in found], bool)
    extreme = flat[np.isin(values[flat[:, 0]], (values.max(), values.min()))]
    kept = [run for run in extreme if _rounded(values, run[0], run[1], level.resolution)]
    return np.array(kept, dtype=int).reshape(-1, 2), np.zeros(len(kept), bool)


def _rounded(values: np.ndarray, begin: int, end: int, resolution: float) -> bool:
    """True if the flanks beside a run are those of a parabola with its top clipped."""
    width = max((end - begin + 1) // 2, 3)
    if begin < width or end + width >= len(values):
        return False
    flank = np.unique(np.linspace(1, width, 50).astype(int))
    index = np.concatenate((begin - flank, end + flank))
    t = (index - (begin + end) / 2) / (end - begin + 1)
    y = values[index] - values[begin]
    residual = []
    for shape in (t**2, np.abs(t)):
        basis = np.column_stack((shape, t, np.ones_like(t)))
        coefficients = np.linalg.lstsq(basis, y, rcond=None)[0]
        residual.append((float(np.sqrt(np.mean((basis @ coefficients - y) ** 2))), coefficients))
    (parabola, (bend, _, hump)), (tent, _) = residual
    return bool(
        parabola < 0.5 * tent and bend * hump < 0 and abs(hump) > max(_MIN_CLIPPED_HEIGHT * resolution, 5 * parabola)
    )
