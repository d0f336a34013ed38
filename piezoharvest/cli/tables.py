"""Results on stdout: JSON for programs, tables for people."""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from piezoharvest.cli.notes import telling
from piezoharvest.counting import counted
from piezoharvest.description.netlist import UNITS
from piezoharvest.description.shunts import registered
from piezoharvest.study.building import component_in

if TYPE_CHECKING:
    from piezoharvest.description.parameters import Component
    from piezoharvest.engine.response import Response

_PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}

_FRONT_STEPS = 12  # of a front that is printed; the JSON has all points
_MIN_COST = 1e-4  # of the power, or dB: what is less is within the accuracy of the tuning, and of either sign
# Keys of a result in the order of the interface; each is an attribute of `Response`.
_RESULT = (
    "shunt", "converged", "period", "harvested_power", "mechanical_power", "efficiency", "displacement_amplitude",
    "voltage_amplitude", "dc_voltage", "attenuation_db", "energy", "events_per_period", "periods_evaluated", "message",
    "displacement_rms", "standard_error", "figure_of_merit", "energy_stored", "time_to_turn_on", "wakes_per_hour",
    "packets_per_hour", "time_to_start", "least_switching_voltage", "adapted_inductance",
)  # fmt: skip

_QUANTILES = {"p5": "5 %", "p50": "50 %", "p95": "95 %"}
# Columns of intervals: header, unit, key of the figure, factor.
_SPREAD = (
    ("harvested power", "W", "harvested_power", 1.0), ("mech. power", "W", "mechanical_power", 1.0),
    ("effi- ciency", "%", "efficiency", 100.0), ("displace- ment", "m", "displacement_amplitude", 1.0),
    ("voltage", "V", "voltage_amplitude", 1.0), ("dc voltage", "V", "dc_voltage", 1.0),
    ("attenu- ation", "dB", "attenuation_db", 1.0),
)  # fmt: skip


def print_json(data: Any) -> None:
    """Print one JSON object; numbers that are not finite become null."""
    print(json.dumps(_plain(data), indent=2, allow_nan=False))


def print_report(write: Callable[[], Path], *, as_json: bool, name: str = "") -> None:
    """Write a report, and print its path beside its name: to stderr where stdout is for JSON."""
    with telling():
        page = write()
    print(page, *([f"({name})"] if name else []), file=sys.stderr if as_json else sys.stdout)


def _plain(value: Any) -> Any:
    """The value in JSON types: numpy's are converted, NaN and infinities are None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int) else str(value)


def response_json(response: Response) -> dict[str, Any]:
    """Result of one simulation as a table of the JSON output."""
    return {key: getattr(response, key) for key in _RESULT}


def _without_zeros_of_failures(response: Response) -> Response:
    """The response; one without results has NaN instead of figures that are 0 because nothing was found."""
    from piezoharvest.engine.response import FAILED

    if not (response.message or "").startswith(FAILED):
        return response
    return dataclasses.replace(response, **dict.fromkeys(_FIGURES, math.nan))


def print_responses(title: str, responses: Sequence[Response]) -> None:
    """Print one row for each shunt."""
    responses = [_without_zeros_of_failures(response) for response in responses]
    noisy = any(r.displacement_rms is not None for r in responses)
    supplies = any(r.wakes_per_hour is not None for r in responses)
    columns = [
        Column("harvested power", "W", [r.harvested_power for r in responses]),
        *_error_column(responses, "harvested_power", "W"),
        Column("mech. power", "W", [r.mechanical_power for r in responses]),
        Column("effi- ciency", "%", [100 * r.efficiency for r in responses]),
        Column("figure of merit", "", [r.figure_of_merit for r in responses]),
        Column("displace- ment", "m", [r.displacement_amplitude for r in responses]),
        *([Column("rms displ.", "m", [r.displacement_rms for r in responses])] if noisy else []),
        *_error_column(responses, "displacement_rms", "m"),
        Column("voltage", "V", [r.voltage_amplitude for r in responses]),
        Column("dc voltage", "V", [r.dc_voltage for r in responses]),
        Column("attenu- ation", "dB", [r.attenuation_db for r in responses]),
        *(_supply_columns(responses) if supplies else []),
    ]
    _print_table(title, "shunt", [r.shunt for r in responses], columns, [r.converged for r in responses])


_FIGURES = ("harvested_power", "mechanical_power", "displacement_amplitude", "voltage_amplitude", "dc_voltage")


def _supply_columns(responses: Sequence[Response]) -> list[Column]:
    """What a supply at the smoothing capacitor did."""
    packets = [r.packets_per_hour for r in responses]
    return [
        Column("turns on after", "s", [r.time_to_turn_on for r in responses]),
        Column("wake-ups per hour", "", [r.wakes_per_hour for r in responses]),
        *([Column("packets per hour", "", packets)] if any(each is not None for each in packets) else []),
        Column("energy stored", "J", [r.energy_stored for r in responses]),
    ]


def _error_column(responses: Sequence[Response], name: str, unit: str) -> list[Column]:
    """Standard error of a figure under noise; none for other excitations."""
    errors = [(r.standard_error or {}).get(name) for r in responses]
    return [Column("standard error", unit, errors)] if any(error is not None for error in errors) else []


def print_intervals(shunts: Sequence[str], spread: Sequence[Mapping[str, Any] | None]) -> None:
    """Print three rows for each shunt: the 5, 50 and 95 % quantiles over draws of the specimen."""
    rows = [(shunt, found, key) for shunt, found in zip(shunts, spread, strict=True) if found for key in _QUANTILES]
    columns = [
        Column(name, unit, [scale * figure[key] if (figure := found[label]) else None for _, found, key in rows])
        for name, unit, label, scale in _SPREAD
    ]
    names = [f"{shunt} {_QUANTILES[key]}" for shunt, _, key in rows]
    trusted = [found["converged"] == found["samples"] for _, found, _ in rows]
    _print_table(f"over {counted(rows[0][1]['samples'], 'draw')} of the specimen", "quantile", names, columns, trusted)


def percent(share: float | None) -> float | None:
    """A share in percent."""
    return None if share is None else 100 * share


def print_design(title: str, result: Mapping[str, Any], *, damping: bool = False) -> None:
    """Print the candidates of a design, best first, and the bound as the last row.

    Of a design for `damping` alone the power is not shown, of one for power alone not the damping that is added.
    """
    rows = [*result["candidates"], {"shunt": {"kind": "bound"}, "converged": True, **result["bound"]}]
    scheduled = Column("with schedule", "W", [row.get("scheduled_power") for row in rows])
    errors = [row.get("harvested_power_standard_error") for row in rows]
    frequencies = [row.get("frequency") for row in rows]
    columns = [
        *([Column("best frequency", "Hz", frequencies)] if any(frequencies) else []),
        *([] if damping else [Column("harvested power", "W", [row.get("harvested_power") for row in rows])]),
        *([Column("standard error", "W", errors)] if any(errors) and not damping else []),
        *([scheduled] if any(row.get("scheduled_power") is not None for row in rows) else []),
        Column("attenu- ation", "dB", [row.get("attenuation_db") for row in rows]),
        *([Column("added damping", "%", [percent(row.get("added_damping")) for row in rows])] if damping else []),
        Column("gap to bound", *_told([row.get("gap_to_bound") for row in rows], damping)),
        *_parts_columns([row.get("parts") for row in rows]),
        *_worst_columns([row.get("worst_case") for row in rows]),
    ]
    names = [row["shunt"]["kind"] for row in rows]
    keys = [*(_keys(row["shunt"], (row.get("parts") or {}).get("ideal", {})) for row in result["candidates"]), ""]
    _print_table(title, "candidate", names, columns, [row["converged"] for row in rows], keys)
    if result["trade_off"]:
        _print_front(result["trade_off"])


def _print_front(points: Sequence[Mapping[str, Any]]) -> None:
    """Print some points of the front between harvest and damping, both ends among them."""
    step = max(1, -(-(len(points) - 1) // _FRONT_STEPS))
    rows = [*points[:-1:step], points[-1]]
    columns = [
        Column("harvested power", "W", [row["harvested_power"] for row in rows]),
        Column("attenu- ation", "dB", [row["attenuation_db"] for row in rows]),
    ]
    names, keys = [row["shunt"]["kind"] for row in rows], [_keys(row["shunt"], {}) for row in rows]
    _print_table("front between harvested power and damping", "shunt", names, columns, [True] * len(rows), keys)


def print_sweep(
    title: str, best: Mapping[str, Any] | None, inputs: Mapping[str, str], outputs: Mapping[str, str]
) -> None:
    """Print the best row of a sweep, given the units of its parameters and of its outputs by name."""
    if best is None:
        print(title)
        return
    name = f"design {best['design']}: shunts.{best['shunt']} ({best['kind']})"
    columns = [
        Column(output.removesuffix("_db").replace("_", " "), unit, [best[output]]) for output, unit in outputs.items()
    ]
    keys = "\n".join(f"{path} = {best[path]:.6g} {unit}".rstrip() for path, unit in inputs.items())
    _print_table(title, "best", [name], columns, [True], [keys])


def print_catalogue(
    entries: Sequence[Mapping[str, Any]],
    materials: Sequence[Mapping[str, Any]],
    parts: Mapping[str, Sequence[Mapping[str, Any]]],
) -> None:
    """Print a line for each transducer, each material and each part of the catalogue, these by their sort."""
    header = ("name", "resonance", "k", "C", "T", "what")
    rows = [
        (
            entry["key"],
            _shown(entry, "short_circuit_frequency"),
            f"{entry['values']['coupling_factor']['value']:.2f}",
            _shown(entry, "capacitance"),
            _shown(entry, "coupling"),
            entry["name"],
        )
        for entry in entries
    ]
    print_rows("transducers: resonance with shorted electrodes, coupling factor, clamped C, T", header, rows)
    print_rows("materials", ("name", "what"), [(each["key"], each["name"]) for each in materials])
    for sort, some in parts.items():
        print_rows(sort, ("name", "what"), [(each["key"], each["note"]) for each in some])


def print_entry(entry: Mapping[str, Any]) -> None:
    """Print one entry of the catalogue: its values, its source, what was read and what was derived."""
    rows = [(key.replace("_", " "), _shown(entry, key)) for key in entry["values"]]
    print_rows(entry["name"], ("value", ""), rows)
    print(f"source: {entry['source']}\n\n{entry['note']}")
    for text in entry.get("assumptions", ()):
        print(f"assumed: {text}")


def _shown(entry: Mapping[str, Any], key: str) -> str:
    """A value of an entry with its unit."""
    value, unit = entry["values"][key]["value"], entry["values"][key]["unit"]
    # No prefix where it would be read wrongly: beside a power, a kilogram or no unit at all.
    return f"{value:.4g} {unit}".strip() if unit in ("", "kg") or "^" in unit else _with_unit(value, unit)


def _parts_columns(parts: Sequence[Mapping[str, Any] | None]) -> list[Column]:
    """What rounding to a series of parts costs and the worst case within its tolerance; none without a series."""
    chosen = [one for one in parts if one]
    if not chosen:
        return []
    figure, unit = (
        ("harvested_power", "W") if "harvested_power" in chosen[0]["worst_case"] else ("attenuation_db", "dB")
    )
    series, spread = chosen[0]["series"], f"{100 * chosen[0]['tolerance']:g}"
    costs = [one["cost"] if one else None for one in parts]
    return [
        Column(f"cost of {series}", *_told(costs, unit == "dB")),
        Column(f"worst within {spread} %", unit, [one["worst_case"][figure] if one else None for one in parts]),
    ]


def _told(differences: Sequence[float | None], decibels: bool) -> tuple[str, list[float | None]]:
    """Unit and values of differences in dB, or of shares in per cent; 0 for what the tuning cannot tell from it."""
    scale = 1.0 if decibels else 100.0
    told = [None if each is None else scale * each if abs(each) >= _MIN_COST else 0.0 for each in differences]
    return "dB" if decibels else "%", told


def _worst_columns(cases: Sequence[Mapping[str, Any] | None]) -> list[Column]:
    """Worst case within the tolerance and its certified value; none without a tolerance."""
    found = [case for case in cases if case]
    if not found:
        return []
    figure, unit = found[0]["objective"], "W" if found[0]["objective"] == "harvested_power" else "dB"
    certified = Column("certi- fied", unit, [case["certified"] if case else None for case in cases])
    worst = Column("worst case", unit, [case[figure] if case else None for case in cases])
    return [worst, *([certified] if any(case["certified"] is not None for case in found) else [])]


def _keys(shunt: Mapping[str, Any], ideal: Mapping[str, float]) -> str:
    """Keys of a shunt, one a line, with their units, and the ideal values of those that were rounded."""
    return "\n".join(_lines_of(shunt, registered().get(shunt["kind"]), ideal))


def _lines_of(table: Mapping[str, Any], cls: type[Component] | None, ideal: Mapping[str, float]) -> list[str]:
    """Keys of a circuit, or of a part of one such as its storage, each a line."""
    fields = {field.name: field for field in dataclasses.fields(cls)} if cls else {}
    hints = get_type_hints(cls) if cls else {}
    lines: list[str] = []
    for key, value in table.items():
        if key == "netlist" and not isinstance(value, str):
            lines += [_element(part, ideal) for part in value]
            continue
        if key == "others":
            lines += _keys_of_others(table[key], ideal)
            continue
        if key == "netlist":  # that of a circuit simulator
            value = counted(sum(map(bool, map(str.strip, value.splitlines()))), "line")
        if isinstance(value, Mapping) and "currents" in value:  # a curve
            value = counted(len(value["currents"]), "point")
        if parts := _parts_of(key, value):
            for path, part in parts.items():
                own = {name.removeprefix(f"{path}."): x for name, x in ideal.items() if name.startswith(f"{path}.")}
                lines += [f"{path}.{line}" for line in _lines_of(part, component_in(hints.get(key)), own)]
            continue
        unit = fields[key].metadata.get("unit") if key in fields else None
        if unit and isinstance(value, float):
            tuned = f" (ideal {_with_unit(ideal[key], unit)})" if key in ideal else ""
            value = _with_unit(value, unit, exact=key in ideal) + tuned
        elif isinstance(value, float):
            value = f"{value:.4g}"
        elif unit and isinstance(value, list):
            tuned = [_with_unit(x, unit, exact=f"{key}.{n}" in ideal) for n, x in enumerate(value)]
            value = ", ".join(tuned)
        if key != "kind" and value is not None:
            lines.append(f"{key} = {value}")
    return lines


def _parts_of(key: str, value: Any) -> dict[str, Mapping[str, Any]]:
    """Parts of a circuit under a key of its table, such as its storage, by their paths; none if it holds a value."""
    if isinstance(value, Mapping):
        return {key: value}
    parts = value if isinstance(value, list) else []
    return {f"{key}.{n}": part for n, part in enumerate(parts) if isinstance(part, Mapping)}


def _keys_of_others(others: Sequence[Mapping[str, Any]], ideal: Mapping[str, float]) -> list[str]:
    """Keys of a shunt's others, under their names in the shunt."""
    lines = []
    for n, other in enumerate(others):
        prefix = f"others.{n}."
        own = {key.removeprefix(prefix): value for key, value in ideal.items() if key.startswith(prefix)}
        lines += [prefix + line for line in (f"kind = {other['kind']}", *_keys(other, own).splitlines())]
    return lines


def _element(part: Mapping[str, Any], ideal: Mapping[str, float]) -> str:
    """Name, value and nodes of an element of a netlist, and its ideal value if it was rounded."""
    name, unit = part["name"], UNITS[part["kind"]]
    tuned = f" (ideal {_with_unit(ideal[name], unit)})" if name in ideal else ""
    first, second = part["nodes"]
    value = _with_unit(part["value"], unit, exact=name in ideal)
    return f"{name} {first}-{second} = {value}{tuned}{', load' if part['load'] else ''}"


def _with_unit(value: float, unit: str, *, exact: bool = False) -> str:
    """Value with a prefixed unit; an exact one without trailing zeros."""
    power = _power(abs(value))
    text = f"{value / 10.0**power:.4g}" if exact else _cell(value, 10.0**power)
    return f"{text} {_PREFIXES[power]}{unit}"


class Column:
    """A column of numbers with one engineering prefix, chosen for the largest, in its header.

    Parameters
    ----------
    name : str
        Header, one word in a line.
    unit : str
        SI unit, which takes a prefix; "%", "dB" and "" take none.
    values : sequence of float or None
    """

    def __init__(self, name: str, unit: str, values: Sequence[float | None]):
        self.name, self.unit, self.values = name, unit, values
        self.largest = max((abs(v) for v in values if v is not None and math.isfinite(v)), default=0.0)
        self.power = 0 if unit in ("%", "dB", "") else _power(self.largest)
        self.tells = self.largest > 0  # a column of zeros, as of the power of circuits without a load, is left out

    @property
    def header(self) -> list[str]:
        """Lines of the header."""
        return [*self.name.split(), *([_PREFIXES[self.power] + self.unit] if self.unit else [])]

    @property
    def cells(self) -> list[str]:
        """Numbers as text."""
        return [_cell(value, 10.0**self.power) for value in self.values]


def _share_prefixes(columns: Sequence[Column]) -> None:
    """Give columns of one unit the prefix of the smallest, so that a row compares, as far as four digits show all."""
    for unit in {column.unit for column in columns}:
        same = [column for column in columns if column.unit == unit and column.tells]
        lowest = min((column.power for column in same), default=0)
        for column in same:
            if float(f"{column.largest:.3e}") < 1e4 * 10.0**lowest:
                column.power = lowest


def _power(largest: float) -> int:
    """Power of ten, a multiple of three with a prefix, that brings the number between 1 and 1000."""
    if largest == 0:
        return 0
    # Of the rounded number, so that 999.96 counts as 1000.
    exponent = int(f"{largest:.3e}".partition("e")[2])
    return min(max(3 * (exponent // 3), min(_PREFIXES)), max(_PREFIXES))


def _cell(value: float | None, scale: float) -> str:
    if value is None or not math.isfinite(value):
        return "-"
    return f"{value / scale:#.4g}".rstrip(".") if value else "0"


def _print_table(
    title: str,
    corner: str,
    names: Sequence[str],
    columns: Sequence[Column],
    trusted: Sequence[bool],
    notes: Sequence[str] = (),
) -> None:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(title), title_justify="left", box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    table.collapse_padding = True
    columns = [column for column in columns if column.tells] or list(columns)
    _share_prefixes(columns)
    height = max(len(column.header) for column in columns)
    below = "\n" * (height - 1)
    table.add_column(below + corner, no_wrap=True)
    for column in columns:
        table.add_column(
            "\n".join([""] * (height - len(column.header)) + column.header), justify="right", overflow="fold"
        )
    if notes:
        table.add_column(below + "keys", overflow="fold")
    for n, name in enumerate(names):
        cells = [column.cells[n] for column in columns]
        table.add_row(*map(Text, (name if trusted[n] else f"{name}\n(not trusted)", *cells, *notes[n : n + 1])))
    _print_rich(table)


def print_rows(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows of text; the first column and the last are left-justified."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(title) if title else None, title_justify="left", box=box.SIMPLE_HEAD, show_edge=False)
    for n, name in enumerate(header):
        table.add_column(name, justify="left" if n in (0, len(header) - 1) else "right", no_wrap=n == 0)
    for row in rows:
        table.add_row(*map(Text, row))
    _print_rich(table)


def _print_rich(table: Any) -> None:
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal:  # a file or a pipe: no limit of width
        console.width = 200
    with console.capture() as capture:
        console.print(table)
    print("\n".join(line.rstrip() for line in capture.get().splitlines()))
