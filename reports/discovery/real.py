"""What a search for laws finds in the measured data sets of ../shared/data, which are not copied."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from piezoharvest.diagnose import Diagnosis, diagnose, thresholds
from piezoharvest.diagnose.discovery.result import as_json
from piezoharvest.output import write_table, write_text
from piezoharvest.records import load_campaign
from reports.actuators import mirror
from reports.actuators.data import DATA, LEVELS, MIRROR_RATE, STACK_RATE, Loops, minor_loops, multisines, sine
from reports.actuators.diagnosed import BAND, MIRROR_MODEL, OPERATORS, STACK_MODEL

EVERY = 4  # sample of the stack's: 50 a second of motions of about 1 Hz
MIRROR_EVERY = 8  # sample of the mirror's after the band pass, 800 a second
_CHANNELS = """
[channels]
voltage = {{ column = "v", unit = "V", gain = {gain} }}
displacement = {{ column = "x", unit = "m" }}
"""
_RECORD = """
[[records]]
file = "{file}.csv"
role = "{role}"
drive = "voltage"
sample_rate = {rate}
"""
LIMITS = {
    "stack": "imposed voltage, displacement alone: no current, so that electrodes, load and charge are not seen; every "
    "fourth sample",
    "mirror": "one of three inputs and outputs, what the other two do taken off by the frequency responses of the "
    "level; 20 to 200 Hz",
}


def write_real(path: Path) -> None:
    """Diagnose the measured data, one after the other, and write what was found after each."""
    rows: list[dict[str, Any]] = []
    for name, limits, found in _diagnosed():
        rows.append({"name": name, "limits": limits, **_row(found)})
        write_text(json.dumps(rows, indent=1, allow_nan=False) + "\n", path)


def there() -> bool:
    """True if the data are beside the project."""
    return DATA.exists()


def _diagnosed() -> Iterator[tuple[str, str, Diagnosis]]:
    yield from _stack()
    yield from _mirror()


def _stack() -> Iterator[tuple[str, str, Diagnosis]]:
    """Fitted to the sine, judged on the minor loops: without and with hysteresis."""
    with tempfile.TemporaryDirectory() as folder:
        for file, loops in (("sine", sine()), ("minor", minor_loops())):
            write_table(_columns(loops), Path(folder) / f"{file}.csv")
        entries = _CHANNELS.format(gain=33.0) + "".join(
            _RECORD.format(file=file, role=role, rate=STACK_RATE / EVERY)
            for file, role in (("sine", "fit"), ("minor", "validate"))
        )
        for name, model in (("linear", STACK_MODEL), ("three stop operators", STACK_MODEL + OPERATORS)):
            yield f"stack, {name}", LIMITS["stack"], _of(model + entries, Path(folder))


def _mirror() -> Iterator[tuple[str, str, Diagnosis]]:
    """Fitted at the lowest and the highest level, judged at the one between."""
    with tempfile.TemporaryDirectory() as folder:
        for level in LEVELS:
            write_table(_band(level), Path(folder) / f"{level}.csv")
        entries = _CHANNELS.format(gain=1.0) + "".join(
            _RECORD.format(file=level, role=role, rate=MIRROR_RATE / MIRROR_EVERY)
            for level, role in zip(LEVELS, ("fit", "validate", "fit"), strict=True)
        )
        yield "mirror, one mode, 100 to 300 mV", LIMITS["mirror"], _of(MIRROR_MODEL + entries, Path(folder))


def _of(text: str, folder: Path) -> Diagnosis:
    write_text(text, folder / "campaign.toml")
    return diagnose(load_campaign(folder / "campaign.toml"))


def _columns(loops: Loops) -> dict[str, np.ndarray]:
    return {"v": loops.voltage[::EVERY], "x": 1e-6 * loops.displacement[::EVERY]}


def _band(level: int) -> dict[str, np.ndarray]:
    """First voltage and displacement of a realisation in the band, without what the other inputs do."""
    records, response = multisines(level, "train"), mirror.response(level)
    u, y = (np.fft.rfft(values[:, :, 0, :].mean(axis=-1), axis=0) for values in records)
    inside = (response.frequency > BAND[0]) & (response.frequency < BAND[1])
    lines = np.rint(response.frequency[inside] * len(records.voltage) / MIRROR_RATE).astype(int)
    others = np.einsum("fi,fi->f", response.response[inside, 0, 1:], u[lines, 1:])
    kept = {"v": (lines, u[lines, 0]), "x": (lines, y[lines, 0] - others)}
    count = len(records.voltage) // MIRROR_EVERY
    found = {}
    for name, (where, values) in kept.items():
        spectrum = np.zeros(count // 2 + 1, complex)
        spectrum[where] = values / MIRROR_EVERY
        found[name] = np.fft.irfft(spectrum, count)
    return found


def _row(found: Diagnosis) -> dict[str, Any]:
    quality = (found.validation_before.rms, found.validation_after.rms, found.validation_after.noise)
    words = [named.effect.name for named in found.effects]
    for law in found.discovery:
        words.append(f"{law.place} of {law.law.place.input}: {law.formula} (gain {law.gain:.2f})")
        alike = [f"{r.place} of {r.input}" for r in law.rivals if r.log_odds > -thresholds.MIN_LOG_ODDS]
        words += [f"not told from {' and '.join(alike)}"] if alike else []
    return {
        "verdict": found.verdict, "found": "; ".join(words).replace("_", " ") or "nothing",
        "rms": [1e6 * each["displacement"] for each in quality],
        "laws": [as_json(law) for law in found.discovery],
    }  # fmt: skip
