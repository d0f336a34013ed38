"""Results of a design."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from piezoharvest.description.netlist import Element
from piezoharvest.description.shunts import Shunt
from piezoharvest.design.parts.choice import PartsChoice

if TYPE_CHECKING:
    from piezoharvest.engine.response import Response


@dataclass(frozen=True)
class Bound:
    """Performance bound of passive linear shunts; None where no bound holds or none has been computed."""

    harvested_power: float | None = None
    attenuation_db: float | None = None


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A tuned shunt, checked by the nonlinear simulation.

    Attributes
    ----------
    shunt : Shunt
    harvested_power : float
        W, by simulation; over a band its mean.
    attenuation_db : float
        Displacement against the short circuit, by simulation; over a band worst peak against worst peak.
    displacement_amplitude, voltage_amplitude : float
        m and V, by simulation; over a band the largest.
    converged : bool
        True if every simulation behind these figures is reliable.
    violates : tuple of str
        Names of the limits that are not kept; empty for a feasible candidate.
    start : str
        Formula from which the tuning started.
    method : str
        Tuning method.
    iterations : int
        Iterations of the optimiser, or simulations where it tuned on them.
    gap_to_bound : float or None
        Relative distance from the bound.
    parts : PartsChoice or None
        Parts of the shunt, where they are rounded to a series.
    response : Response
        The simulation; over a band that of the largest displacement.
    """

    shunt: Shunt
    harvested_power: float
    attenuation_db: float
    displacement_amplitude: float
    voltage_amplitude: float
    converged: bool
    violates: tuple[str, ...] = ()
    start: str = ""
    method: str = ""
    iterations: int = 0
    gap_to_bound: float | None = None
    parts: PartsChoice | None = None
    response: Response | None = field(default=None, repr=False)

    @property
    def feasible(self) -> bool:
        """True if all limits are kept."""
        return not self.violates

    def as_json(self) -> dict[str, Any]:
        """Candidate as a table of the JSON output."""
        names = ("harvested_power", "attenuation_db", "gap_to_bound", "converged", "displacement_amplitude",
                 "voltage_amplitude", "violates", "start", "method", "iterations")  # fmt: skip
        values = {name: getattr(self, name) for name in names}
        parts = self.parts.as_json() if self.parts else None
        return {"shunt": shunt_table(self.shunt), **values, "violates": list(self.violates), "parts": parts}


@dataclass(frozen=True, kw_only=True)
class DesignResult:
    """Outcome of a design.

    Attributes
    ----------
    candidates : tuple of Candidate
        Best first; those that violate a limit after those that keep all, unreliable ones last.
    bound : Bound
    trade_off : tuple of mapping
        Front between harvesting and damping.
    notes : tuple of str
        Assumptions, omissions and other remarks.
    """

    candidates: tuple[Candidate, ...]
    bound: Bound = Bound()
    trade_off: tuple[Mapping[str, Any], ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def best(self) -> Candidate:
        """The first candidate."""
        return self.candidates[0]

    @property
    def converged(self) -> bool:
        """True if the best candidate is reliable."""
        return self.best.converged

    def as_json(self) -> dict[str, Any]:
        """Result as a table of the JSON output."""
        return {
            "bound": dataclasses.asdict(self.bound),
            "candidates": [candidate.as_json() for candidate in self.candidates],
            "best": 0,
            "trade_off": [dict(point) for point in self.trade_off],
            "notes": list(self.notes),
        }


def shunt_table(shunt: Shunt) -> dict[str, Any]:
    """Table of a shunt as in a study file: its kind and the keys that differ from their defaults."""
    table: dict[str, Any] = {"kind": shunt.kind}
    for item in dataclasses.fields(shunt):
        value = getattr(shunt, item.name)
        if value is not None and value != item.default:
            table[item.name] = _plain(value)
    return table


def _plain(value: Any) -> Any:
    """The value in types of TOML and JSON."""
    if isinstance(value, Element):
        return {**vars(value), "nodes": list(value.nodes)}
    if isinstance(value, tuple | list):
        return [_plain(inner) for inner in value]
    return value.item() if hasattr(value, "item") else value
