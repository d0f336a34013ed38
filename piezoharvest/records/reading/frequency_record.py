"""Reading of a frequency response or an impedance from its entry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.shunts import Shunt
from piezoharvest.readers import MissingColumnError, Reader, ReadError
from piezoharvest.readers.base import shown
from piezoharvest.records.errors import CampaignError
from piezoharvest.records.finding import Finding, runs, shifted
from piezoharvest.records.reading.channels import ChannelSource
from piezoharvest.records.reading.entries import RESPONSE_COLUMNS, FrfEntry, ImpedanceEntry, Sources, response_units
from piezoharvest.records.reading.files import Files
from piezoharvest.records.reading.impedance_forms import FORMS, QUANTITIES, impedance
from piezoharvest.records.reading.known_columns import known_column
from piezoharvest.records.record import FrequencyRecord

_TURN = 6.5  # rad: a phase between -2 pi and 2 pi, with rounding
_HALF_TURN_IN_DEGREES = 361.0  # of a phase from -360 to 360
# The forms in which a response may be given; the first that is present is used.
_FORMS = (("response",), ("real", "imaginary"), ("magnitude", "phase"), *FORMS)


def read_frequency_record(
    entry: FrfEntry | ImpedanceEntry,
    key: str,
    sources: Sources,
    shunt: Shunt | None,
    folder: Path,
    data: Reader | None = None,
) -> tuple[FrequencyRecord, list[Finding]]:
    """Read a frequency response or an impedance, from one or several sweeps up or down, sorted by frequency.

    A line at 0 Hz is left out, because the response to a mean value is not that to a sine.

    Parameters
    ----------
    entry : FrfEntry or ImpedanceEntry
    key : str
        Key of its table in the campaign.
    sources : mapping of str to (ChannelSource, level)
        Sources that the record itself gives.
    shunt : Shunt or None
    folder : Path
        Folder to which file names are relative.
    data : Reader, optional
        In the place of the file.

    Returns
    -------
    FrequencyRecord
    list of Finding
        Lines that were left out.

    Raises
    ------
    CampaignError
        The file cannot be read, or holds no response.
    """
    units = response_units(entry)
    with Files(folder, entry, data) as files:
        columns, all_sources = _find(files, entry, sources)
        raw = files.read(entry.file, columns)
        parts = {
            part: files.to_si(entry.file, part, columns[part], all_sources[part], values, units[part])
            for part, values in raw.items()
        }
        numbering, findings = files.reader(entry.file).numbering, files.below()
    for part, values in parts.items():
        if values.dtype.kind == "c" and part != "response":
            message = "found complex numbers, allowed are real numbers (complex ones belong in 'response')"
            raise CampaignError(folder / entry.file, part, message, channel=part)
    for part, values in parts.items():
        if len(values) != len(parts["frequency"]) or not len(values):
            found = f"found {counted(len(values), 'value')}"
            allowed = f"allowed are as many as frequencies, at least one ({len(parts['frequency'])})"
            raise CampaignError(folder / entry.file, part, f"{found}, {allowed}", channel=part)
    findings += _doubts(files, entry, columns, all_sources, parts, numbering)
    parts, rows, still = _in_order(parts, numbering)
    if len(still):
        where = shifted([(0, len(still) - 1)], still)
        message = f"found {counted(len(still), 'line')} at 0 Hz, left out, as only frequencies above 0 Hz are used"
        findings.append(Finding("warning", "0 Hz", entry.file, "frequency", where, message))
    if not len(parts["frequency"]):
        message = "all frequencies are 0 Hz, at least one above 0 Hz is needed"
        raise CampaignError(folder / entry.file, "frequency", message, channel="frequency")
    frf = isinstance(entry, FrfEntry)
    record = FrequencyRecord(
        name=entry.file, key=key, role=entry.role, kind=entry.kind, shunt=shunt, start_time=entry.start_time,
        input=entry.input if frf else "current", output=entry.output if frf else "voltage",
        mechanical="free" if frf else entry.mechanical, frequency=parts["frequency"], response=_complex(parts),
        coherence=parts.get("coherence"), columns=MappingProxyType({p: ", ".join(c) for p, c in columns.items()}),
        first_row=rows,
    )  # fmt: skip
    return record, findings


def _doubts(
    files: Files,
    entry: FrfEntry | ImpedanceEntry,
    columns: Mapping[str, Sequence[str]],
    sources: Mapping[str, ChannelSource],
    parts: Mapping[str, np.ndarray],
    numbering: int | np.ndarray,
) -> list[Finding]:
    """Findings for a magnitude below zero, and a phase in degrees that nothing says to be one."""
    found = []
    below = parts.get("magnitude", np.zeros(0)) < 0
    if below.any():
        message = f"found {counted(int(below.sum()), 'value')} below 0, allowed are magnitudes of at least 0, or levels"
        rows = shifted(runs(below), numbering)
        found.append(Finding("error", "sign", entry.file, "magnitude", rows, f'{message} by unit = "dB re ..."'))
    if "phase" in parts and not sources["phase"].unit and sources["phase"].gain is None:
        reader = files.reader(entry.file)
        stated = [reader.unit(column) for column in columns["phase"]]
        size = float(np.nanmax(np.abs(parts["phase"]), initial=0.0))
        if not any(stated) and _TURN < size <= _HALF_TURN_IN_DEGREES:
            message = f'found up to {size:.4g}, taken for radians; likely degrees, which need unit = "deg"'
            found.append(Finding("warning", "unit", entry.file, "phase", (), message))
    return found


def _in_order(
    parts: Mapping[str, np.ndarray], numbering: int | np.ndarray
) -> tuple[dict[str, np.ndarray], int | np.ndarray, np.ndarray]:
    """Quantities sorted by frequency without lines at 0 Hz, rows of the lines kept, and rows of those left out."""
    frequency = parts["frequency"]
    still = frequency == 0
    rows = numbering if isinstance(numbering, np.ndarray) else numbering + np.arange(len(frequency))
    if not still.any() and np.all(np.diff(frequency) >= 0):
        return dict(parts), numbering, rows[:0]
    kept = np.flatnonzero(~still)
    kept = kept[np.argsort(frequency[kept], kind="stable")]
    return {part: values[kept] for part, values in parts.items()}, rows[kept], rows[still]


def _complex(parts: Mapping[str, np.ndarray]) -> np.ndarray:
    """Complex response from the form in which it is given."""
    if "response" in parts:
        return parts["response"].astype(complex)
    if "imaginary" in parts:
        return parts["real"] + 1j * parts["imaginary"]
    if "magnitude" in parts:
        return parts["magnitude"] * np.exp(1j * parts["phase"])
    found = impedance(parts)
    assert found is not None  # one of the forms was found
    return found


def _find(files: Files, entry: FrfEntry | ImpedanceEntry, sources: Sources) -> tuple[dict, dict[str, ChannelSource]]:
    """Columns and sources of frequency, response and, if present, coherence."""
    reader = files.reader(entry.file)
    found: dict[str, list[str]] = {}
    used = {part: source for part, (source, _) in sources.items()}
    for part, default in RESPONSE_COLUMNS[entry.kind].items():
        try:
            found[part] = [reader.resolve(column) for column in used.setdefault(part, ChannelSource()).columns(default)]
        except ReadError as error:
            if part in sources or not isinstance(error, MissingColumnError):
                raise files.error(entry.file, part, error) from None
            known = known_column(reader, part, entry.kind)
            if known is not None:
                found[part] = [known]
    if "phase" not in found and "phase_deg" in reader.names and "phase" not in sources:
        found["phase"], used["phase"] = ["phase_deg"], ChannelSource(unit="deg")
    named = {form: sum(part in sources for part in form) for form in _FORMS}
    given = sorted((form for form in _FORMS if named[form]), key=lambda form: -named[form]) or _FORMS
    form = next((form for form in given if all(part in found for part in form)), None)
    if "frequency" not in found or form is None:
        what = "frequency" if "frequency" not in found else "response"
        usual = [name for part, name in RESPONSE_COLUMNS[entry.kind].items() if part not in QUANTITIES]
        expected = f"expected are {', '.join(usual)}, or names in the record's channels"
        message = f"missing {reader.part}, {reader.whole} has {shown(reader.names)}; {expected}"
        raise CampaignError(files.folder / entry.file, what, message, channel=what)
    kept = {part: columns for part, columns in found.items() if part in ("frequency", "coherence", *form)}
    return kept, used
