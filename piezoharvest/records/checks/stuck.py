"""Channels that do not move when they should: constant throughout, clipped at an end of their range, frozen between."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from piezoharvest.description.shunts import LinearShunt, Open, Short
from piezoharvest.records.checks.frozen import go_on, jumps, piled, unlikely
from piezoharvest.records.checks.level import Level, flat_runs, level_of
from piezoharvest.records.finding import Finding, shifted
from piezoharvest.records.record import Record, Signal

_SHORTEST_FROZEN = 8
_HUMP = 6.0  # resolutions that a rounded top goes on beyond where it is cut off
_BLOCKED = 0.2  # of the drive's range
# Resolutions: the rounded top of a sampled signal falls by 3 within half of its length, the flattest by 15.
_CORNER = 16.0

_Judged = tuple[np.ndarray, np.ndarray]  # runs that are no rest (runs, 2), and whether that is beyond doubt


def constant(record: Record) -> Iterator[Finding]:
    """Channels with the same value throughout."""
    silent = _silent(record)
    for channel, signal in record.signals.items():
        if signal.values.min() < signal.values.max() or channel in silent:
            continue
        which = "the drive at" if channel == record.drive else "a dead channel,"
        message = f"found {which} {signal.values[0]:.6g} throughout, allowed is one that changes"
        rows = shifted([(0, len(record) - 1)], signal.first_row)
        yield Finding("error", "constant", signal.file, channel, rows, message)


def _silent(record: Record) -> set[str]:
    """Channels that may well be at rest: voltage across a short, current through nothing, force on a free actuator.

    Behind switches and diodes voltages are held and currents blocked.
    """
    if record.drive == "voltage":
        return {"force"}
    if not isinstance(record.shunt, LinearShunt):
        return {"voltage", "current"}
    return {"voltage"} if isinstance(record.shunt, Short) else {"current"} if isinstance(record.shunt, Open) else set()


def standing_still(record: Record) -> Iterator[Finding]:
    """Stretches of exactly equal values that neither the signal's own course nor a resting drive explains."""
    flat = {channel: flat_runs(signal.values) for channel, signal in record.signals.items()}
    levels = {channel: level_of(record[channel], runs_of) for channel, runs_of in flat.items()}
    for channel, signal in record.signals.items():
        if levels[channel].range == 0 or channel in _silent(record):
            continue
        judge = _drive_stuck if channel == record.drive else _response_stuck
        found, sure = judge(record, channel, flat[channel], levels)
        values = record[channel]
        thin = piled(values, levels[channel])
        other = ~np.isin(values[found[:, 0]], values[thin[:, 0]])
        ranges, sure = np.concatenate((found[other], thin)), np.append(sure[other], np.zeros(len(thin), bool))
        yield from _findings(signal, channel, ranges, sure)


def _findings(signal: Signal, channel: str, ranges: np.ndarray, sure: np.ndarray) -> Iterator[Finding]:
    """Clipped where the value is the largest or the least of the record, frozen elsewhere."""
    values = signal.values
    at = values[ranges[:, 0]]
    for limit, side in ((values.max(), "largest"), (values.min(), "least")):
        clipped = ranges[at == limit]
        if len(clipped):
            count = int(np.sum(clipped[:, 1] - clipped[:, 0] + 1))
            found = f"found {count} samples pinned at the {side} value, {limit:.6g}"
            message = f"{found}, allowed is a range that is not used up"
            yield Finding("warning", "clipped", signal.file, channel, shifted(clipped, signal.first_row), message)
    inner = (at != values.max()) & (at != values.min())
    for sure_of_it, frozen in ((True, ranges[inner & sure]), (False, ranges[inner & ~sure])):
        if len(frozen):
            count = int(np.sum(frozen[:, 1] - frozen[:, 0] + 1))
            found = f"found {count} samples that stand still while the others go on"
            rows = shifted(frozen, signal.first_row)
            message = f"{found}, allowed is a channel that is alive"
            yield Finding("error" if sure_of_it else "warning", "frozen", signal.file, channel, rows, message)


def _response_stuck(record: Record, channel: str, flat: np.ndarray, levels: dict[str, Level]) -> _Judged:
    """Runs of a response in which its noise stops, or that are entered and left by a corner, while the drive goes on.

    The corner alone is no proof: a joint may stick.
    """
    values, drive = record[channel], record[record.drive]
    level, of_drive = levels[channel], levels[record.drive]
    begin, end = flat.T
    length = end - begin + 1
    if level.noisy:
        resting = _bend(drive, begin, end) == 0
        found = flat[unlikely(flat, values, level) & ~resting]
        return found, np.ones(len(found), bool)
    half = np.clip(length // 2, 1, 20)
    inside = (begin >= half) & (end + half < len(values))
    before, after = np.maximum(begin - half, 0), np.minimum(end + half, len(values) - 1)
    top = values[begin]
    fall = np.minimum(np.abs(values[before] - top), np.abs(values[after] - top))
    corner = inside & (fall > _CORNER * level.resolution)
    extreme = (top == values.max()) | (top == values.min())
    enough = extreme | (length >= _SHORTEST_FROZEN)
    # What the response would show of the drive's bend were three resolutions at most: it may well be at rest.
    tolerance = max(8 * of_drive.noise, 3 * level.resolution * of_drive.range / level.range)
    # Hysteresis that sticks keeps charge from moving for a while, whatever the drive does.
    blocked = of_drive.range * _BLOCKED * (channel in ("voltage", "current")) * ~extreme
    found = flat[corner & enough & (_bend(drive, begin, end) > np.maximum(tolerance, blocked))]
    return found, np.zeros(len(found), bool)


def _bend(drive: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """How far the drive is from a straight line through its values at both ends of a run."""
    bend = np.zeros(len(begin))
    for part in (0.25, 0.5, 0.75):
        inner = begin + (part * (end - begin)).astype(int)
        chord = drive[begin] + (drive[end] - drive[begin]) * (inner - begin) / (end - begin)
        bend = np.maximum(bend, np.abs(drive[inner] - chord))
    return bend


def _drive_stuck(record: Record, channel: str, flat: np.ndarray, levels: dict[str, Level]) -> _Judged:
    """Runs of the drive that are no rest: it may rest wherever it likes, unless the responses go on.

    Before and after a burst, and at zero, a drive is a command. Without noise, a drive that is clipped is told from one
    that is held by its flanks: those of a rounded top go on as a parabola, those of a ramp are straight. With noise, a
    drive that stops is dead beyond doubt where all responses go on and it comes back elsewhere.
    """
    values, level = record[channel], levels[channel]
    at = values[flat[:, 0]]
    flat = flat[(at != values[0]) & (at != values[-1]) & (at != 0)]
    if level.noisy:
        flat = flat[unlikely(flat, values, level)]
        extreme = np.isin(values[flat[:, 0]], (values.max(), values.min()))
        found = flat[[end or go_on(record, run[0], run[1], levels) for end, run in zip(extreme, flat, strict=True)]]
        return found, np.array([jumps(values, run[0], run[1]) for run in found], bool)
    extreme = flat[np.isin(values[flat[:, 0]], (values.max(), values.min()))]
    kept = [run for run in extreme if _rounded(values, run[0], run[1], level.resolution)]
    return np.array(kept, dtype=int).reshape(-1, 2), np.zeros(len(kept), bool)


def _rounded(values: np.ndarray, begin: int, end: int, resolution: float) -> bool:
    """Whether the flanks beside a run are those of a parabola whose top the run has cut off."""
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
    return bool(parabola < 0.5 * tent and bend * hump < 0 and abs(hump) > max(_HUMP * resolution, 5 * parabola))
