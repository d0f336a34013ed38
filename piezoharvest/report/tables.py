"""Rows of a report's tables, as text."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.parameters import Component
from piezoharvest.description.transducer import Transducer
from piezoharvest.design.front.point import FrontPoint
from piezoharvest.design.places import unit_at
from piezoharvest.design.result import DesignResult
from piezoharvest.report.figures.ledger import name_of
from piezoharvest.report.figures.restrictions import price_text, value_text
from piezoharvest.report.limits import Limit, ModeFigures, hysteretic, mode_figures, white_input
from piezoharvest.report.subjects import Subject, front_subject, values_of
from piezoharvest.report.units import (
    NONE,
    SPACE,
    decibel,
    engineering,
    kind_name,
    number,
    percent,
    quantity_text,
    symbol,
    with_error,
)  # fmt: skip
from piezoharvest.study import Study

_LIMITS = {
    "max_voltage": "voltage too high", "max_inductance": "inductance too large", "min_power": "power too low",
    "max_displacement": "displacement too large", "min_attenuation_db": "too little damping",
}  # fmt: skip


_MERIT = "from 2 upwards a resistor, from π upwards a rectifier can reach the power limit"

_NOISE = "sum over modes of S/(4 m): power supplied by white noise of this density, whatever the shunt"
_MIN_VOLTAGE = 1e-9  # V: smaller voltages are rounding errors of zero
_MIN_COST = 1e-4  # of the power, or dB: what is less is within the accuracy of the tuning, and of either sign
_FRONT_ROWS, _KIND_ROWS = 14, 6  # of the best front, and of each kind's; the JSON has all points
_MIN_LIMIT_SHARE = 0.01  # of the limit: smallest share that is compared with it


class Row(NamedTuple):
    """A candidate in the ranking."""

    rank: int
    label: str
    kind: str
    values: list[tuple[str, str]]
    cells: list[str]
    closure: str
    converged: bool
    violates: list[str]
    colour: int


class PartsRow(NamedTuple):
    """Parts of a candidate: key, ideal, bought and worst value of each; cost and worst case of the objective."""

    label: str
    parts: list[tuple[str, str, str, str]]
    cost: str
    worst: str
    sure: bool


class FrontRow(NamedTuple):
    """A design on a front."""

    label: str
    kind: str
    values: list[tuple[str, str]]
    power: str
    attenuation: str


class QuantityRow(NamedTuple):
    """A quantity: name, value with unit, and description."""

    name: str
    value: str
    doc: str


def ranking(subjects: Sequence[Subject], limit: Limit | None, damping: bool) -> tuple[list[str], list[Row]]:
    """Headings, those of the objective first, and one row for each candidate; no column without any value."""
    columns = _damping_columns(subjects) if damping else _power_columns(subjects, limit)
    shown = {heading: cells for heading, cells in columns.items() if any(cell != NONE for cell in cells)}
    rows = []
    for n, s in enumerate(subjects):
        closure = s.response.energy.get("closure") if s.response else None
        violates = [_LIMITS.get(name, name) for name in s.candidate.violates]
        frequency = s.candidate.frequency
        own = [] if frequency is None else [("frequency", engineering(frequency, "Hz", 5))]
        rows.append(Row(s.rank + 1, s.label, s.shunt.kind, own + list(values_of(s.shunt)),
                        [cells[n] for cells in shown.values()],
                        number(closure, 1) if closure is not None else engineering(None), s.candidate.converged,
                        violates, s.rank))  # fmt: skip
    return list(shown), rows


def _power_columns(subjects: Sequence[Subject], limit: Limit | None) -> dict[str, list[str]]:
    """Cells by heading of a table about harvested power."""
    near = limit is not None and near_limit(subjects, limit)
    return {
        "harvested power": [_power(s) for s in subjects],
        "share of the limit": [
            percent(s.candidate.harvested_power / limit.power) if limit and near else NONE for s in subjects
        ],
        "efficiency": [percent(s.response.efficiency) if s.response else NONE for s in subjects],
        **_motion_columns(subjects),
        "voltage": [_voltage(s) for s in subjects],
        "dc voltage": [_dc_voltage(s) for s in subjects],
    }


def _damping_columns(subjects: Sequence[Subject]) -> dict[str, list[str]]:
    """Cells by heading of a table about vibration; power only where some is harvested."""
    motion = _motion_columns(subjects)
    harvested = any(s.harvests for s in subjects)
    return {
        "against shorted": motion["against shorted"],
        "added damping": [
            percent(s.candidate.added_damping) if s.candidate.added_damping is not None else NONE for s in subjects
        ],
        "displace\u00adment": motion["displace\u00adment"],
        "voltage": [_voltage(s) for s in subjects],
        "dc voltage": [_dc_voltage(s) for s in subjects],
        "harvested power": [_power(s) if harvested else NONE for s in subjects],
    }


def _motion_columns(subjects: Sequence[Subject]) -> dict[str, list[str]]:
    return {
        "displace\u00adment": [engineering(s.candidate.displacement_amplitude, "m") for s in subjects],
        "against shorted": [decibel(s.candidate.attenuation_db) for s in subjects],
    }


def _power(subject: Subject) -> str:
    power, error = subject.candidate.harvested_power, subject.candidate.standard_error
    return with_error(power, error, "W") if error else engineering(power, "W")


def _voltage(subject: Subject) -> str:
    voltage = subject.candidate.voltage_amplitude
    return engineering(voltage if voltage > _MIN_VOLTAGE else 0.0, "V")


def _dc_voltage(subject: Subject) -> str:
    response = subject.response
    return engineering(response.dc_voltage, "V") if response and response.dc_voltage else NONE


def bought_parts(subjects: Sequence[Subject]) -> list[PartsRow]:
    """One row for each candidate whose parts were rounded to a series."""
    rows = []
    for s in subjects:
        c = s.candidate.parts
        if c is None:
            continue
        units = {name: unit_at(c.shunt, name) for name in c.values}
        parts = []
        for name, unit in units.items():
            ideal, worst = engineering(c.ideal[name], unit, 4), engineering(c.worst_values[name], unit)
            parts.append((symbol(name), ideal, quantity_text(c.values[name], unit), worst))
        harvest = c.objective == "harvested_power"
        cost = "0" if abs(c.cost) < _MIN_COST else percent(c.cost, 2) if harvest else f"{number(c.cost, 2)}{SPACE}dB"
        worst = engineering(c.worst, "W") if harvest else decibel(c.worst)
        rows.append(PartsRow(s.label, parts, cost, worst, c.converged and c.complete))
    return rows


def restrictions(subjects: Sequence[Subject]) -> list[tuple[str, str, str]]:
    """Name, figure and price against the bound of each restriction on a synthesised network."""
    rows = next((s.candidate.restrictions for s in subjects if s.candidate.restrictions), ())
    return [(row["name"], value_text(row), price_text(rows, n) if n else "") for n, row in enumerate(rows)]


def best_front(result: DesignResult) -> list[FrontRow]:
    """Rows along the best front over all kinds."""
    return [_front_row(kind_name(p.shunt.kind), p) for p in _some(result.trade_off, _FRONT_ROWS)]


def kind_fronts(subjects: Sequence[Subject], result: DesignResult) -> list[list[FrontRow]]:
    """Rows along the front of each candidate, in the order of the ranking."""
    pairs = sorted(((front_subject(subjects, one), one) for one in result.fronts), key=lambda pair: pair[0].rank)
    return [[_front_row(s.label, p) for p in _some(one.points, _KIND_ROWS)] for s, one in pairs]


def _some(points: Sequence[FrontPoint], most: int) -> list[FrontPoint]:
    """At most so many of the points, both ends among them, evenly in their order."""
    return [points[n] for n in np.unique(np.linspace(0, len(points) - 1, most).astype(int))] if points else []


def _front_row(label: str, point: FrontPoint) -> FrontRow:
    figures = engineering(point.harvested_power, "W"), decibel(point.attenuation_db)
    return FrontRow(label, point.shunt.kind, list(values_of(point.shunt)), *figures)


def series_text(subjects: Sequence[Subject]) -> str:
    """Series and tolerance of the parts, in words; empty without a series."""
    choice = next((s.candidate.parts for s in subjects if s.candidate.parts), None)
    return f"{choice.series}, ±{number(100 * choice.tolerance, exact=True)}{SPACE}%" if choice else ""


def near_limit(subjects: Sequence[Subject], limit: Limit | None) -> bool:
    """True if any candidate comes close enough to the limit for shares of it to be informative."""
    return limit is not None and any(s.candidate.harvested_power > _MIN_LIMIT_SHARE * limit.power for s in subjects)


def energies(subjects: Sequence[Subject]) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """Header and rows of the energy balance, per period or run."""
    drawn = [(s, s.response.energy) for s in subjects if s.response is not None and any(s.response.energy.values())]
    names = dict.fromkeys(name for _, energy in drawn for name in energy if name != "closure")
    header = ["mechanical in" if name == "mechanical_in" else name_of(name) for name in names]
    return header, [(s.label, [engineering(energy.get(name), "J") for name in names]) for s, energy in drawn]


def entries(component: Component) -> Iterator[QuantityRow]:
    """Every quantity of a component, from the metadata of its fields."""
    for field in dataclasses.fields(component):
        value = getattr(component, field.name)
        if "unit" in field.metadata and value is not None:
            unit = _one_unit(component, field.metadata["unit"])
            yield QuantityRow(field.name.replace("_", " "), quantity_text(value, unit, 4), field.metadata["doc"])


def _one_unit(component: Any, unit: str) -> str:
    """The unit of "N or m/s^2" and the like that applies to a force or to a base acceleration."""
    choices = unit.split(" or ")
    return choices[-1 if getattr(component, "base", False) else 0]


def transducer_tables(transducer: Transducer) -> Iterator[tuple[str, list[QuantityRow]]]:
    """Heading and entries of the transducer, its hysteresis, further modes and effects."""
    yield transducer.name or "Transducer", list(entries(transducer))
    if transducer.hysteresis is not None:
        yield "Hysteresis", list(entries(transducer.hysteresis))
    for n, mode in enumerate(transducer.modes, 2):
        yield f"Mode {n}", list(entries(mode))
    for n, electrode in enumerate(transducer.electrodes, 1):
        yield f"Electrodes {n}", list(entries(electrode))
    for effect in transducer.effects:
        yield f"Effect: {effect.name.replace('_', ' ')}", list(entries(effect))


def excitation_table(study: Study) -> tuple[str, list[QuantityRow]]:
    """Heading and entries of the excitation."""
    rows = list(entries(study.excitation))
    if study.free_frequency:
        free = QuantityRow(
            "frequency", "free", "for each candidate the frequency in the band at which it harvests most"
        )
        rows = [free if row.name == "frequency" else row for row in rows]
    return f"Excitation: {kind_name(study.excitation.kind)}", rows


def goal_table(study: Study) -> list[QuantityRow]:
    """The goal of the design."""
    if study.design is None:
        return []
    found = [QuantityRow("objective", study.design.objective.replace("_", " "), "goal of the design")]
    if study.design.parts:
        found.append(QuantityRow("parts", study.design.parts, "series of preferred values (IEC 60063)"))
    return found + list(entries(study.design))


def two_port(study: Study, limit: Limit | None) -> tuple[list[str], list[tuple[str, list[str], str]]]:
    """Header (modes) and rows (name, one value for each mode, remark) of the two-port's figures."""
    transducer = study.transducer
    points = ("slip", "stick") if hysteretic(transducer) else ("stick",)
    found = [(point, mode_figures(transducer, point)) for point in points]
    words = {"slip": "hysteresis slipping", "stick": "hysteresis sticking"}
    header = [
        ", ".join(([f"mode {n + 1}"] if len(modes) > 1 else []) + ([words[point]] if len(points) > 1 else []))
        for point, modes in found
        for n in range(len(modes))
    ]
    figures = [mode for _, modes in found for mode in modes]
    shorted = [engineering(m.short_circuit, "Hz", 5) for m in figures]
    opened = [engineering(m.open_circuit, "Hz", 5) for m in figures]
    if transducer.electrodes:  # what a shunt at electrodes 0 sees is neither with all shorted nor a patch alone
        every = [engineering(m.all_shorted, "Hz", 5) for m in figures]
        remark = "undamped, electrodes 0 shorted and all others open"
        rows = [
            ("short-circuit resonance", every, "undamped, all electrodes shorted"),
            ("f_sc of electrodes 0", shorted, remark),
            ("open-circuit resonance f_oc", opened, "undamped, all electrodes open"),
        ]
    else:
        rows = [
            ("short-circuit resonance", shorted, "undamped"),
            ("open-circuit resonance", opened, "undamped"),
        ]
    rows += [
        ("coupling factor k_e²", [number(m.coupling_squared) for m in figures], "(f_oc² − f_sc²)/f_sc²"),
        ("mechanical quality Q_m", [number(m.quality) if np.isfinite(m.quality) else "∞" for m in figures], "√(k m)/b"),
        ("k_e² Q_m", [number(m.merit) if np.isfinite(m.merit) else "∞" for m in figures], _MERIT),
        (
            "matched resistance",
            [_matched(m, transducer) for m in figures],
            f"1/(C ω) at {'f_sc' if transducer.electrodes else 'the short-circuit resonance'}",
        ),
    ]
    blank, noise = [""] * (len(figures) - 1), white_input(transducer, study.excitation)
    if noise is not None:
        rows.append(("input power of noise", [engineering(noise, "W"), *blank], _NOISE))
    if limit is not None:
        remark = f"{limit.formula}: no interface can exceed it"
        rows.append(("power limit", [engineering(limit.power, "W"), *blank], remark))
    return header, rows


def _matched(mode: ModeFigures, transducer: Transducer) -> str:
    return engineering(1 / (2 * np.pi * mode.short_circuit * transducer.capacitance), "ohm")
