"""What a data file seems to hold: its times, which column is which channel, and what it does not tell.

Columns are judged by their names, in English and German, and by the units that the file states. What two columns may
be, or none, is left to the user.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from piezoharvest.readers import Reader, ReadError, open_reader
from piezoharvest.readers.base import last_part, shown
from piezoharvest.readers.units import Unit, ratio_of, stated_unit
from piezoharvest.records.reading.channels import ALSO, COLUMNS, UNITS
from piezoharvest.records.reading.entries import RESPONSE_COLUMNS, FrfEntry
from piezoharvest.records.reading.frequency_record import read_frequency_record
from piezoharvest.records.reading.impedance_forms import QUANTITIES
from piezoharvest.records.reading.known_columns import known_column
from piezoharvest.study import StudyError

# What a letter stands for depends on where it is: v_tip is a velocity, v_piezo a voltage.
_STRUCTURE = r"tip|beam|laser|ldv|mass|plate|mid\w*|end|host|struct\w*|vib\w*|mech\w*|polytec|free"
_ELECTRODES = (
    r"p|pz|pzt|piezo\w*|pvdf|mfc|patch|peh|harv\w*|transducer|elec\w*|"
    r"oc|out\w*|r?load|l|r|rl|res\w*|shunt|term\w*|sens\w*"
)
_DRIVEN = r"ext|in|exc\w*|shaker|hammer|drive|act\w*|app\w*|meas\w*"


def _letter(letters: str, places: str) -> str:
    """Names that are a letter and a place, as "v_piezo", "Vpzt1" and "tip_x"."""
    return rf"(?:{letters}) ?(?:{places}) ?\d*|(?:{places}) (?:{letters}) ?\d*"


# Names without their units, in lower case, words apart; the first channel that fits is taken.
_WORDS: Mapping[str, str] = MappingProxyType({
    "time": r"t|time.*|zeit.*|x value|x_value|timestamp|seconds?",
    "base_acceleration": r"(?!(?:f|u|v|x) |.*(?:force|kraft|volt|disp|veloc))(?:.*\b(?:base|shaker|sockel)\b.*|base.*)",
    "dc_voltage": r"[uv]? ?dc.*|dc.*volt.*|.*storage.*|[uv] ?(?:rect\w*|sto\w*|bat\w*)",
    "gate": r"gate.*|trig.*",
    "force": rf"f|.*force.*|.*kraft.*|.*load ?cell.*|impedance head.*|hammer.*|{_letter('f', _DRIVEN)}",
    "velocity": r"(?!.*(?:disp|position|weg)).*(?:velocity|vibrometer|geschw).*|vel(?: .*)?|"
                rf"{_letter('v|vel', _STRUCTURE)}",
    "displacement": r"x|tip|.*(?:disp|position|weg|auslenk|deflection|laser|strain|dehnung).*|lvdt.*|"
                    rf"{_letter('x|w|d', _STRUCTURE)}",
    "acceleration": rf"acc(?: .*|\d*)|.*accel.*|.*beschl.*|{_letter('a|acc', _STRUCTURE)}",
    "current": rf"i|.*current.*|.*strom.*|{_letter('i', _ELECTRODES)}",
    "voltage": r"u|v|.*volt.*|.*spannung.*|piezo.*|(?:pzt|pvdf|mfc|peh|harvester)(?: .*|\d*)|"
               rf"{_letter('u|v', _ELECTRODES)}",
})  # fmt: skip
_SIMULATED = re.compile(r"(?P<quantity>[vi])\((?P<place>[^()]+)\)", re.IGNORECASE)  # V(out), I(Rload)
_BASE = "base_acceleration"
_MOTIONS = ("displacement", "velocity", "acceleration")  # of these, the unit tells better than the name
OTHER_UNIT = "?"  # stands for the unit of a column that is recognised, but in none of its channel's units
LEVEL = "dB"
_MOST_TABLES = 10  # of a text file that are looked at, one below the other
_LEAST_COUNTED = 2  # samples whose numbers are consecutive
_OUTPUTS = ("displacement", "velocity", "acceleration", "voltage")
_RATIOS = {
    ratio_of(UNITS[top], UNITS[below]): (top, below)
    for below in ("force", "base_acceleration")
    for top in _OUTPUTS
    if UNITS[top] != UNITS[below]
}


@dataclass(frozen=True, kw_only=True)
class FoundFile:
    """What was found in a data file.

    Attributes
    ----------
    path : Path
    kind : "time", "frf" or "impedance"
    columns : mapping of str to (str or int)
        Column of each channel that was recognised, as a campaign names it; times that the format stores have none.
    units : mapping of str to str
        Unit that the file states for it, "" if none, `OTHER_UNIT` where it is not the channel's, `LEVEL` for one in
        decibels without what 0 dB is.
    values : mapping of str to array (n,)
        Recognised channels over time in SI units, "time" among them if the file has any; "frequency" and "response" of
        a frequency response that needs nothing more to be read.
    count : int
        Samples or lines.
    output, input : str
        Of a frequency response; "" if its unit does not tell them.
    left : tuple of str
        Other columns, with their units.
    doubts : tuple of str
        What could not be told, or was guessed, a sentence each.
    skip_rows : int
        Lines above the table of a text file, where the first table of the file is not the data.
    """

    path: Path
    kind: str
    columns: Mapping[str, str | int]
    units: Mapping[str, str]
    values: Mapping[str, np.ndarray]
    count: int
    output: str = ""
    input: str = ""
    left: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    skip_rows: int = 0

    @property
    def rate(self) -> float | None:
        """Sample rate, Hz; None without times that ascend."""
        time = self.values.get("time", np.empty(0))
        span = float(time[-1] - time[0]) if len(time) > 1 else 0.0
        return (len(time) - 1) / span if 0 < span < np.inf else None


def look_into(path: Path) -> FoundFile:
    """Recognise what a data file holds; of several tables in a text file, the longest.

    Raises
    ------
    ReadError
        It cannot be read, or holds no numbers.
    """
    found, below = _table(path, 0)
    for _ in range(_MOST_TABLES):
        if not below:
            break
        try:
            other, below = _table(path, below)
        except ReadError:  # remarks with numbers
            break
        found = other if other.count > found.count else found
    return found


def _table(path: Path, above: int) -> tuple[FoundFile, int]:
    """What a file holds below some lines, and the lines above its next table, 0 if there is none."""
    with open_reader(path, **({"skip_rows": above} if above else {})) as reader:
        found = _spectrum(reader, path) or _signals(reader, path)
        if found.count == 0:
            where = f" in its columns {shown(reader.names)}" if any(reader.names) else ""
            raise ReadError(f"found no rows of numbers{where}, at least one is needed")
        row = reader.left_out[0] if reader.by_lines and reader.left_out is not None else 0
        return replace(found, skip_rows=above), max(row - 1, 0)


def _spectrum(reader: Reader, path: Path) -> FoundFile | None:
    """A frequency response or an impedance, if there is a column of frequencies."""
    frequency = known_column(reader, "frequency") or next((n for n in reader.names if n == "frequency_Hz"), None)
    if frequency is None or (frequency.lower() == "f" and reader.unit(frequency) is None):  # which may be a force
        return None
    count = len(reader.read([frequency])[frequency])
    units = [unit.of or unit.si for name in _resolved(reader).values() if (unit := reader.unit(name)) is not None]
    # Names of other quantities, as g, b and y, may also be those of a channel.
    telling = ("real", "magnitude", *(part for part, quantity in QUANTITIES.items() if quantity.unit in ("F", "H")))
    named = {RESPONSE_COLUMNS["impedance"][part] for part in ("response", "conductance", "admittance", *telling)}
    if reader.measures or named & set(reader.names) or any(known_column(reader, part) for part in telling):
        return FoundFile(path=path, kind="impedance", columns={}, units={}, values={}, count=count)
    output, source = next((_RATIOS[si] for si in units if si in _RATIOS), ("", ""))
    parts = {part: known_column(reader, part, "frf") for part in RESPONSE_COLUMNS["frf"]}
    defaults = (*RESPONSE_COLUMNS["frf"].values(), "phase_deg")
    columns: dict[str, str | int] = {
        part: name for part, name in parts.items() if name and (name not in defaults or _text(reader, name) == LEVEL)
    }
    known = {column for column in (*parts.values(), *defaults) if column is not None}
    doubts = () if output else ("no column states a unit such as m/N, which would identify output and input",)
    return FoundFile(
        path=path, kind="frf", columns=columns, units={part: _text(reader, name) for part, name in columns.items()},
        values=_response(path, output, source), count=count, output=output, input=source,
        left=tuple(name for name in reader.names if name not in known), doubts=doubts,
    )  # fmt: skip


def _text(reader: Reader, column: str | int) -> str:
    """Unit that a file states for a column, as it writes it."""
    unit = reader.unit(reader.resolve(column))
    if unit is not None and unit.si == "dB" and not unit.of:
        return LEVEL
    return "" if unit is None else " ".join(unit.text.split())


def _response(path: Path, output: str, source: str) -> Mapping[str, np.ndarray]:
    """Frequencies (Hz) and the response in SI units, if the file is one as it is."""
    if not output:
        return {}
    entry = FrfEntry(kind="frf", file=path.name, output=cast("Any", output), input=cast("Any", source))
    try:
        record, _ = read_frequency_record(entry, "", {}, None, path.parent)
    except StudyError:
        return {}
    return {"frequency": record.frequency, "response": record.response}


def _signals(reader: Reader, path: Path) -> FoundFile:
    """Channels over time."""
    columns = _by_name(reader)
    columns |= dict(_by_unit(reader, columns))
    units: dict[str, str] = {}
    values: dict[str, np.ndarray] = {}
    doubts: list[str] = []
    if "acceleration" in columns and not {"force", "base_acceleration"} & set(columns):
        columns = {_BASE if name == "acceleration" else name: column for name, column in columns.items()}
        doubts.append("there is no force: the acceleration is taken for that of the base")
    for channel, place in list(columns.items()):
        name = reader.resolve(place)
        unit, raw = reader.unit(name), _numbers(reader, name)
        if raw is None or (channel == "time" and not np.all(np.diff(raw) > 0)):
            del columns[channel]
            wrong = "no increasing times" if raw is not None else "no numbers"
            doubts.append(f"column {name!r} looked like {channel}, but holds {wrong}")
        elif unit is not None and unit.firm and unit.si != UNITS[channel]:
            doubt = f"{channel} is in {unit.text}: its gain, in {UNITS[channel]} for one {unit.text}, is missing"
            doubts.append(doubt + (" (the mode shape at the gauge gives it)" if unit.si == "strain" else ""))
            units[channel] = OTHER_UNIT
        else:
            units[channel] = _text(reader, name)
            values[channel] = raw * (unit.factor if unit is not None and unit.si == UNITS[channel] else 1.0)
    any_column = next((name for name in _resolved(reader).values() if _numbers(reader, name) is not None), None)
    stamps = None if any_column is None or "time" in columns else reader.time_of(any_column)
    values |= {} if stamps is None else {"time": stamps}
    sizes = [len(each) for each in values.values()] or [len(_of(reader, any_column))]
    used = set(columns.values())
    left = tuple(name for n, name in enumerate(reader.names, start=1) if n not in used and name)
    named = {channel: _named(reader, place) for channel, place in columns.items()}
    return FoundFile(
        path=path, kind="time", columns=named, units=units, values=values, count=max(sizes), left=left,
        doubts=tuple(doubts),
    )  # fmt: skip


def _of(reader: Reader, name: str | None) -> np.ndarray:
    return np.empty(0) if name is None else reader.read([name])[name]


def _numbers(reader: Reader, name: str) -> np.ndarray | None:
    """Real values of a column; None if it is text, or empty."""
    try:
        raw = np.real(_of(reader, name))
    except ReadError:
        return None
    return raw if np.isfinite(raw).any() else None


def _by_name(reader: Reader) -> dict[str, int]:
    """Columns, by their numbers from 1, that are named like a channel: default ones, then those in its unit, first."""
    found: dict[str, list[tuple[int, int]]] = {}
    for n, full in _resolved(reader).items():
        name, unit = reader.names[n - 1], reader.unit(full)
        default = next(
            (c for c, column in (*COLUMNS.items(), *ALSO.items()) if column == name), reader.channels.get(name.lower())
        )
        channel = default or _named_like(name, unit) or _electrical(name)
        if channel is not None and (default is not None or not _counts(reader, full, channel)):
            first = 0 if default is not None else 1 if unit is not None and unit.si == UNITS[channel] else 2
            first += 2 * (default is None and _named_like(name, unit) is None)
            found.setdefault(channel, []).append((first, n))
    return {channel: min(places)[1] for channel, places in found.items()}


def _named_like(name: str, unit: Unit | None) -> str | None:
    """Channel that a name, or the last part of its path, is a word for; a motion by the unit that the file states."""
    if (signal := _SIMULATED.fullmatch(name)) is not None:
        return _simulated(signal["quantity"].lower(), signal["place"].lower())
    parts = (name, last_part(name), name.rsplit(".", 1)[-1])
    bare = [stated_unit(part)[0].strip().strip('"').lower().replace("_", " ").strip() for part in parts]
    channel = _channel_of(*bare, name.lower())
    if channel in _MOTIONS and unit is not None and unit.firm and unit.si == UNITS["time"]:
        return None  # "X" of an oscilloscope
    if channel in _MOTIONS and unit is not None:
        return next((motion for motion in _MOTIONS if UNITS[motion] == unit.si), channel)
    return channel


def _channel_of(*words: str) -> str | None:
    """The first channel that one of these is a word for."""
    return next((c for c, form in _WORDS.items() if any(re.fullmatch(form, word) for word in words)), None)


def _simulated(quantity: str, place: str) -> str | None:
    """Channel of V(node) or I(element) of a circuit simulator, where forces and motions are voltages of nodes."""
    word = place.replace("_", " ")
    acted = _channel_of(word) if quantity == "v" and len(word) > 1 else None
    if acted in ("force", _BASE, *_MOTIONS):
        return acted
    channel = _channel_of(f"{quantity} {word}")
    return channel if channel in ("voltage", "dc_voltage", "current") else None


def _electrical(name: str) -> str | None:
    """Channel of any other voltage of a node, or current, of a circuit simulator: the first of the file, in doubt."""
    signal = _SIMULATED.fullmatch(name)
    return None if signal is None else "voltage" if signal["quantity"].lower() == "v" else "current"


def _counts(reader: Reader, name: str, channel: str) -> bool:
    """True if a column only numbers the samples, as "X" of an oscilloscope does; times may be whole seconds."""
    raw = _numbers(reader, name) if channel != "time" else None
    return raw is not None and len(raw) > _LEAST_COUNTED and bool(np.all(np.diff(raw) == 1.0))


def _by_unit(reader: Reader, columns: Mapping[str, int]) -> Iterator[tuple[str, int]]:
    """Channels that are not named, by a unit that one column alone has and one channel alone is left for."""
    used = set(columns.values())
    stated = {n: reader.unit(name) for n, name in _resolved(reader).items()}
    sure = {n: unit for n, unit in stated.items() if unit is not None and (unit.firm or len(unit.text) > 1)}
    rest = [(n, unit.si) for n, unit in sure.items() if n not in used]
    for channel in ("time", "force", "displacement", "velocity", "voltage", "current", "acceleration"):
        places = [n for n, si in rest if si == UNITS[channel]]
        if channel not in columns and len(places) == 1:
            yield channel, places[0]


def _resolved(reader: Reader) -> dict[int, str]:
    """Columns by their numbers from 1, without arrays that are too large to be listed column by column."""
    found = {}
    for n in range(1, len(reader.names) + 1):
        with suppress(ReadError):
            found[n] = reader.resolve(n)
    return found


def _named(reader: Reader, place: int) -> str | int:
    """A column as a campaign names it: by its name, or its number where several have that name or it has none."""
    name = reader.names[place - 1]
    return name if name.strip() and list(reader.names).count(name) == 1 else place
