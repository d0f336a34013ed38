"""The candidates of a design in figures and tables: one name, one colour, one line style throughout."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from piezoharvest.counting import counted
from piezoharvest.description.parameters import Component
from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.description.shunts.curves.broken_line import BrokenLine
from piezoharvest.design.front.point import Front
from piezoharvest.design.result import Candidate, given_keys
from piezoharvest.engine.response import Response, Waveforms
from piezoharvest.report.figures.style import line_style
from piezoharvest.report.units import kind_name, quantity_text, symbol

LOADS = ("load_resistance", "resistance", "dc_voltage")


@dataclass(frozen=True, eq=False)
class Subject:
    """A candidate with its place in the ranking.

    Attributes
    ----------
    candidate : Candidate
    label : str
        Unique name.
    rank : int
        From 0, best first.
    """

    candidate: Candidate
    label: str
    rank: int

    @property
    def shunt(self) -> Shunt:
        """The tuned circuit."""
        return self.candidate.shunt

    @property
    def response(self) -> Response | None:
        """Response of its simulation."""
        return self.candidate.response

    @property
    def waveforms(self) -> Waveforms | None:
        """Waveforms of its simulation, None where there are none."""
        found = self.response.waveforms if self.response else None
        return found if found is not None and len(found.time) > 1 else None

    @property
    def linear(self) -> bool:
        """True if it has neither switches nor diodes."""
        return isinstance(self.shunt, LinearShunt)

    @property
    def switched(self) -> bool:
        """True if it has a synchronised switch."""
        return hasattr(self.shunt, "phase_lag")

    @property
    def load_field(self) -> str | None:
        """Name of the field that holds the load, None where there is no single one."""
        given = {field.name for field in dataclasses.fields(self.shunt)}  # a bridge's `resistance` is a function
        return next((name for name in LOADS if name in given and getattr(self.shunt, name) is not None), None)

    @property
    def harvests(self) -> bool:
        """True if power reaches a load at all."""
        return self.candidate.harvested_power > 0

    @property
    def style(self) -> dict[str, Any]:
        """Colour and dashes of its line."""
        return line_style(self.rank)

    def with_load(self, value: Any) -> Shunt:
        """The circuit with another load, otherwise as tuned."""
        assert self.load_field is not None
        return dataclasses.replace(self.shunt, **{self.load_field: value})


def subjects_of(candidates: Iterable[Candidate]) -> tuple[Subject, ...]:
    """Candidates in order, those of the same kind numbered."""
    candidates = tuple(candidates)
    kinds = ["synthesised_network" if c.restrictions else c.shunt.kind for c in candidates]
    total = Counter(kinds)
    seen: Counter[str] = Counter()
    found = []
    for rank, (candidate, kind) in enumerate(zip(candidates, kinds, strict=True)):
        seen[kind] += 1
        label = kind_name(kind) + (f" ({seen[kind]})" if total[kind] > 1 else "")
        found.append(Subject(candidate, label, rank))
    return tuple(found)


def front_subject(subjects: Iterable[Subject], front: Front) -> Subject:
    """The candidate from which a front goes on: the one of its kind with the power of its first point."""
    power = front.points[0].harvested_power
    same = (s for s in subjects if s.shunt.kind == front.kind)
    return min(same, key=lambda s: abs(s.candidate.harvested_power - power))


def values_of(shunt: Component) -> Iterator[tuple[str, str]]:
    """Symbol and value, with unit, of every key of a shunt, or of a part of one, that differs from its default."""
    fields = {field.name: field for field in dataclasses.fields(shunt)}
    for key, value in given_keys(shunt).items():
        given = getattr(shunt, key)
        if key == "netlist" and isinstance(value, str):  # that of a circuit simulator
            yield "netlist", counted(sum(map(bool, map(str.strip, value.splitlines()))), "line")
        elif key == "netlist":
            texts = ((part["kind"], quantity_text(part["value"], _PART_UNITS[part["kind"]])) for part in value)
            yield "netlist", ", ".join(f"{kind}{NO_BREAK}{text}" for kind, text in texts)
        elif key == "others":
            for other in given:
                at = f" at electrode {other.electrode}"
                yield from ((name + at, text) for name, text in values_of(other) if name != symbol("electrode"))
        elif isinstance(given, Component) and not isinstance(given, BrokenLine):  # such as what a storage feeds
            yield from ((f"{symbol(key)}: {name}", text) for name, text in values_of(given))
        elif isinstance(given, tuple) and any(isinstance(each, Component) for each in given):
            for n, each in enumerate(given, start=1):
                yield from ((f"{symbol(key)} {n}: {name}", text) for name, text in values_of(each))
        else:
            yield symbol(key), quantity_text(value, fields[key].metadata.get("unit"))


NO_BREAK = "\N{NO-BREAK SPACE}"  # between a part and its value, in narrow columns
_PART_UNITS = {"R": "ohm", "L": "H", "C": "F"}
