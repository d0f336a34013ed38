"""The tables of a campaign file, validated: the kind of each record, and the sources of its channels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import tomli_w

from piezoharvest.description.effects.circuit_value import CircuitValue, circuit_values
from piezoharvest.description.parameters import Component, ParameterError, described, named_kind, quantity
from piezoharvest.description.shunts import Resistor, Shunt
from piezoharvest.readers.units import ratio_of
from piezoharvest.records.reading.channels import COLUMNS, RATES, UNITS, ChannelSource, check_unit
from piezoharvest.records.reading.impedance_forms import QUANTITIES
from piezoharvest.study import build, build_shunt, unknown

Level = Literal["default", "campaign", "record"]
Sources = Mapping[str, tuple[ChannelSource, Level]]
Input = Literal["force", "voltage", "displacement", "base_acceleration"]
PERIODIC_DRIVES = ("force", "base_acceleration")  # of the engine, which finds the steady state

# Quantities by which a frequency response may be given, with their default columns.
RESPONSE_COLUMNS: Mapping[str, Mapping[str, str]] = {
    "frf": {
        "frequency": "frequency_Hz", "response": "response", "real": "real", "imaginary": "imaginary",
        "magnitude": "magnitude", "phase": "phase_rad", "coherence": "coherence",
    },
    "impedance": {
        "frequency": "frequency_Hz", "response": "impedance", "real": "resistance_ohm", "imaginary": "reactance_ohm",
        "magnitude": "impedance_ohm", "phase": "phase_rad", "coherence": "coherence",
        **{part: quantity.column for part, quantity in QUANTITIES.items()},
    },
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class _Entry(Component):
    """Keys that all kinds of [[records]] have: `rows` is the part of the file that is the record."""

    file: str = described("data file, relative to the campaign file")
    role: Literal["fit", "validate"] = described("whether the record is fitted, or kept for validation", default="fit")
    start_time: float = quantity("s", "start time, since the campaign began", default=0.0)
    channels: Any = described("sources of the channels of this record", default=None)
    rows: tuple[int, int] | None = quantity("", "first and last row that is used", default=None, at_least=1)
    skip_rows: int | None = quantity("", "number of lines above the table of a text file", default=None, at_least=0)
    header_row: int | None = quantity(
        "", "number of the line with the column names in a text file", default=None, at_least=1
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rows is not None and not self.rows[0] < self.rows[1]:
            raise ParameterError("rows", f"found {list(self.rows)}, must be [first, last] with first < last")


@dataclass(frozen=True, kw_only=True)
class _EntryWithShunt(_Entry):
    """A record with a shunt or load across the electrodes."""

    load_resistance: float | None = quantity("ohm", "resistance across the electrodes", default=None, above=0)
    shunt: Any = described("circuit, as in a study, with `fit`, the list of its keys that are fitted", default=None)

    @property
    def _table(self) -> Any:
        """Table of the shunt without the key of those that describe a record."""
        return {key: value for key, value in self.shunt.items() if key != "fit"} if self._has_fit else self.shunt

    @property
    def _has_fit(self) -> bool:
        return isinstance(self.shunt, dict) and "fit" in self.shunt

    def fitted(self, shunt: Shunt | None, where: str) -> tuple[CircuitValue, ...]:
        """Values of the shunt that are fitted: `fit = ["quality", ...]` in its table.

        Raises
        ------
        ParameterError
            It is no list of keys of the shunt.
        """
        if shunt is None or not self._has_fit:
            return ()
        keys = self.shunt["fit"]
        if not isinstance(keys, list | tuple) or not all(isinstance(key, str) for key in keys):
            message = f"found {repr(keys)[:80]}, must be a list of the shunt's keys"
            raise ParameterError(f"{where}.shunt.fit", message)
        return circuit_values(shunt, keys, f"{where}.shunt")

    def across(self, where: str, voltage_imposed: bool) -> Shunt | None:
        """Shunt across the electrodes.

        Raises
        ------
        ParameterError
            No key gives it, or two keys do.
        """
        if self.shunt is not None and self.load_resistance is not None:
            raise ParameterError(f"{where}.shunt", "load_resistance is given too, but only one of the two may be")
        if self.shunt is not None:
            made = isinstance(self.shunt, Shunt)  # of a campaign that is made in Python
            shunt = self.shunt if made else build_shunt(self._table, f"{where}.shunt")
            if shunt.unrecorded:
                raise ParameterError(f"{where}.shunt.kind", f"found {shunt.kind!r}, {shunt.unrecorded}")
            if shunt.taken != (0,):
                found = f"found shunts at electrodes {', '.join(map(str, shunt.taken))}"
                raise ParameterError(f"{where}.shunt", f"{found}, allowed in a record is one at electrode 0")
            return shunt
        if self.load_resistance is not None:
            return Resistor(resistance=self.load_resistance)
        if voltage_imposed:
            return None
        needed = 'it must be a resistance in ohm, or a table shunt instead (kind = "open", "short", ...)'
        raise ParameterError(f"{where}.load_resistance", f"missing key, {needed}")


@dataclass(frozen=True, kw_only=True)
class TimeEntry(_EntryWithShunt):
    """[[records]] of signals over time."""

    drive: Input = described("channel that drives the specimen", default="force")
    sample_rate: float | None = quantity("Hz", "sample rate, where the file has no time column", default=None, above=0)


@dataclass(frozen=True, kw_only=True)
class PeriodicEntry(TimeEntry):
    """[[records]] of a few periods of a sine in steady state."""

    kind: Literal["periodic"] = described("kind of the record")
    frequency: float | None = quantity("Hz", "frequency of the sine, where it is known", default=None, above=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.drive not in PERIODIC_DRIVES:
            allowed = f"allowed in steady state are {' and '.join(PERIODIC_DRIVES)}"
            raise ParameterError("drive", f"found {self.drive!r}, {allowed}")


@dataclass(frozen=True, kw_only=True)
class FrfEntry(_EntryWithShunt):
    """[[records]] of a frequency response, output over input."""

    kind: Literal["frf"] = described("kind of the record")
    input: Input = described("input: channel by which the response is divided", default="force")
    output: Literal["force", "displacement", "velocity", "acceleration", "voltage", "current"] = described(
        "output: channel of the response"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.input == self.output:
            raise ParameterError("output", f"found {self.output!r}, but this is the input; give another channel")
        if self.input == "displacement" and self.output in RATES:
            found = f"found {self.output!r} over an imposed displacement, which does not depend on the specimen"
            raise ParameterError("output", f"{found}, allowed are force, voltage and current")


@dataclass(frozen=True, kw_only=True)
class ImpedanceEntry(_Entry):
    """[[records]] of the impedance of the leads."""

    kind: Literal["impedance"] = described("kind of the record")
    mechanical: Literal["free", "blocked"] = described("mechanical boundary condition of the specimen", default="free")


Entry = TimeEntry | FrfEntry | ImpedanceEntry
ENTRIES = {"time": TimeEntry, "periodic": PeriodicEntry, "frf": FrfEntry, "impedance": ImpedanceEntry}


def build_entry(table: Any, where: str) -> Entry:
    """Entry of [[records]] from its table.

    Raises
    ------
    ParameterError
        A key is missing, unknown, of the wrong type or out of bounds.
    """
    kind = table.get("kind", "time") if isinstance(table, dict) else "time"
    if not isinstance(kind, str) or kind not in ENTRIES:
        raise ParameterError(f"{where}.kind", f"found {repr(kind)[:80]}, allowed are {', '.join(ENTRIES)}")
    if kind == "time" and isinstance(table, dict):
        table = {key: value for key, value in table.items() if key != "kind"}
    return build(ENTRIES[kind], table, where)


def build_sources(tables: Any, level: Level, where: str, units: Mapping[str, str] = UNITS) -> Sources:
    """Sources of channels from a table of tables.

    Raises
    ------
    ParameterError
        A channel or key is unknown, or a unit does not fit its channel.
    """
    if not isinstance(tables, dict):
        example = 'force = { column = "F" } (in Python: {"force": {"column": "F"}})'
        raise ParameterError(where, f"found {named_kind(tables)}, must be a table for each channel, as in {example}")
    found: dict[str, tuple[ChannelSource, Level]] = {}
    for channel, table in tables.items():
        if channel not in units:
            raise unknown(f"{where}.{channel}", channel, units, "channel")
        if not isinstance(table, dict):
            column = tomli_w.dumps({"column": table if isinstance(table, str | int) else "F"}).strip()
            toml, python = f"{{ {column} }}", f"{{{column.replace('column =', chr(34) + 'column' + chr(34) + ':')}}}"
            told = f"found {named_kind(table)}, must be a table, as in {channel} = {toml}"
            raise ParameterError(f"{where}.{channel}", f"{told} (in Python: {python})")
        source = build(ChannelSource, table, f"{where}.{channel}")
        try:
            check_unit(source.unit, units[channel], levels=channel == "magnitude")
        except ParameterError as error:
            raise error.within(f"{where}.{channel}") from None
        found[channel] = source, level
    return found


def default_sources() -> Sources:
    """The channels of the default header."""
    return {channel: (ChannelSource(column=column), "default") for channel, column in COLUMNS.items()}


def response_units(entry: FrfEntry | ImpedanceEntry) -> dict[str, str]:
    """SI unit of each quantity by which a frequency response may be given."""
    ratio = "ohm" if isinstance(entry, ImpedanceEntry) else ratio_of(UNITS[entry.output], UNITS[entry.input])
    values = dict.fromkeys(("response", "real", "imaginary", "magnitude"), ratio)
    more = {part: quantity.unit for part, quantity in QUANTITIES.items()} if isinstance(entry, ImpedanceEntry) else {}
    return {"frequency": "Hz", **values, "phase": "rad", "coherence": "", **more}
