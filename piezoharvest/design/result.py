"""Results of a design."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from piezoharvest.description.netlist import Element
from piezoharvest.description.parameters import Component
from piezoharvest.description.shunts import Shunt
from piezoharvest.design.front.point import Front, FrontPoint, overall
from piezoharvest.design.parts.choice import PartsChoice
from piezoharvest.design.robust.worst import RobustCase
from piezoharvest.notebook import Shown, axes_for

if TYPE_CHECKING:
    from piezoharvest.engine.response import Response


@dataclass(frozen=True)
class Bound:
    """Performance bound of passive, causal, linear shunts; None where no finite one exists or the objective needs none.

    Attributes
    ----------
    harvested_power : float or None
        W that no such shunt passes.
    attenuation_db : float or None
        dB below which no such shunt brings the displacement.
    reached : float or None
        Value, W or dB, that a passive causal shunt is shown to reach.
    frequency_wise : float or None
        The bound if every frequency could have a shunt of its own, W or dB.
    any_interface : float or None
        W that no circuit passes, switched ones included.
    linearised : bool
        True with hysteresis: the bound is that of its describing function at the amplitude found.
    notes : tuple of str
    """

    harvested_power: float | None = None
    attenuation_db: float | None = None
    reached: float | None = None
    frequency_wise: float | None = None
    any_interface: float | None = None
    linearised: bool = False
    notes: tuple[str, ...] = ()

    def gap(self, power: float, attenuation_db: float, *, damping: bool) -> float | None:
        """Distance of a candidate from the bound: 1 - P/P_bound, or dB above it; negative beyond it."""
        if damping:
            return None if self.attenuation_db is None else attenuation_db - self.attenuation_db
        return None if not self.harvested_power else 1 - power / self.harvested_power

    def as_json(self) -> dict[str, Any]:
        """Bound as a table of the JSON output."""
        return {key: value for key, value in dataclasses.asdict(self).items() if key != "notes"}


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A tuned shunt, checked by the nonlinear simulation.

    Attributes
    ----------
    shunt : Shunt
    harvested_power : float
        W, by simulation; over a band its mean, under noise its expectation.
    attenuation_db : float
        Displacement against the short circuit, by simulation; over a band worst peak against worst peak.
    displacement_amplitude, voltage_amplitude : float
        m and V, by simulation; over a band the largest. Under noise the displacement is the amplitude of a sine with
        the expected mean square, the voltage the largest of the study's realisation.
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
    frequency : float or None
        Hz, of the drive, where the design found it; None where the study gives it.
    standard_error : float or None
        W, of the harvested power under noise: 0 where its expectation is exact, None for other excitations.
    gap_to_bound : float or None
        Relative distance from the bound.
    schedule : tuple of mapping or None
        Where a switch's lag is tuned over a band: for frequencies (Hz) of the band the fields that are best there, and
        the harvested power, W.
    scheduled_power : float or None
        W, mean over the band with the schedule.
    added_damping : float or None
        Viscous damping ratio of the mode that takes as much energy a period as the shunt does, at the displacement
        amplitude simulated: for a sine on a single mode, else None.
    parts : PartsChoice or None
        Parts of the shunt, where they are rounded to a series.
    restrictions : tuple of mapping or None
        Of a synthesised network: the bound, and the figures with one more restriction from each to the next.
    worst_case : RobustCase or None
        Worst case in the tolerance of the study, where it has one.
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
    frequency: float | None = None
    standard_error: float | None = None
    gap_to_bound: float | None = None
    added_damping: float | None = None
    schedule: tuple[Mapping[str, float], ...] | None = None
    scheduled_power: float | None = None
    parts: PartsChoice | None = None
    restrictions: tuple[Mapping[str, Any], ...] | None = None
    worst_case: RobustCase | None = None
    response: Response | None = field(default=None, repr=False)

    @property
    def feasible(self) -> bool:
        """True if all limits are kept."""
        return not self.violates

    def as_json(self) -> dict[str, Any]:
        """Candidate as a table of the JSON output."""
        names = ("frequency", "harvested_power", "attenuation_db", "added_damping", "gap_to_bound", "converged",
                 "displacement_amplitude", "voltage_amplitude", "violates", "start", "method", "iterations",
                 "scheduled_power")  # fmt: skip
        values = {name: getattr(self, name) for name in names}
        schedule = None if self.schedule is None else [dict(row) for row in self.schedule]
        parts = self.parts.as_json() if self.parts else None
        restrictions = None if self.restrictions is None else [dict(row) for row in self.restrictions]
        worst = self.worst_case.as_json() if self.worst_case else None
        more = {"violates": list(self.violates), "schedule": schedule, "parts": parts, "worst_case": worst}
        more |= {"restrictions": restrictions, "harvested_power_standard_error": self.standard_error}
        return {"shunt": shunt_table(self.shunt), **values, **more}


@dataclass(frozen=True, kw_only=True, repr=False)
class DesignResult(Shown):
    """Outcome of a design.

    Attributes
    ----------
    candidates : tuple of Candidate
        Best first; those that violate a limit after those that keep all, unreliable ones last.
    bound : Bound
    fronts : tuple of Front
        For the trade-off the front between harvesting and damping of each candidate, with parts as tuned.
    notes : tuple of str
        Assumptions, omissions and other remarks.
    """

    candidates: tuple[Candidate, ...]
    bound: Bound = Bound()
    fronts: tuple[Front, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def heading(self) -> str:
        """The best candidate."""
        best = self.best
        words = f"{best.harvested_power:.4g} W, {best.attenuation_db:.4g} dB"
        return f"best of {len(self.candidates)}: {best.shunt.kind}, {words}"

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The candidates, best first."""
        names = ("harvested_power", "attenuation_db", "added_damping", "gap_to_bound", "converged")
        return [
            {"kind": found.shunt.kind, **{name: getattr(found, name) for name in names}} for found in self.candidates
        ]

    def plot(self, ax: Any = None) -> Any:
        """Draw the power of each candidate over its attenuation, with the bounds, into axes of matplotlib.

        Returns
        -------
        Axes
        """
        (axes,) = axes_for(ax)
        for found in self.candidates:
            marker = "o" if found.converged and found.feasible else "x"
            axes.plot([found.attenuation_db], [found.harvested_power], marker, label=found.shunt.kind)
        if self.bound.harvested_power is not None:
            axes.axhline(
                self.bound.harvested_power, linestyle="--", color="0.4", label="bound of passive linear shunts"
            )
        if self.bound.attenuation_db is not None:
            axes.axvline(self.bound.attenuation_db, linestyle="--", color="0.4", label="bound of passive linear shunts")
        axes.set(xlabel="attenuation in dB", ylabel="harvested power in W")
        axes.legend()
        return axes

    @property
    def best(self) -> Candidate:
        """The first candidate."""
        return self.candidates[0]

    @cached_property
    def trade_off(self) -> tuple[FrontPoint, ...]:
        """The best front over all kinds, largest power first."""
        return overall(self.fronts)

    @property
    def converged(self) -> bool:
        """True if the best candidate is reliable."""
        return self.best.converged

    @property
    def feasible(self) -> bool:
        """True if the best candidate keeps all limits; none does otherwise."""
        return self.best.feasible

    def as_json(self) -> dict[str, Any]:
        """Result as a table of the JSON output."""
        return {
            "bound": self.bound.as_json(),
            "candidates": [candidate.as_json() for candidate in self.candidates],
            "best": 0,
            "trade_off": [_point_table(point) for point in self.trade_off],
            "fronts": [
                {"kind": front.kind, "free": list(front.free), "points": [_point_table(p) for p in front.points]}
                for front in self.fronts
            ],
            "notes": list(self.notes),
        }


def _point_table(point: FrontPoint) -> dict[str, Any]:
    """Point of a front as a table of the JSON output."""
    figures = {"harvested_power": point.harvested_power, "attenuation_db": point.attenuation_db}
    return {"kind": point.shunt.kind, "shunt": shunt_table(point.shunt), **figures}


def shunt_table(shunt: Shunt) -> dict[str, Any]:
    """Table of a shunt as in a study file: its kind and the keys that differ from their defaults."""
    return {"kind": shunt.kind, **given_keys(shunt)}


def given_keys(component: Component) -> dict[str, Any]:
    """Fields of a component that differ from their defaults; what it has computed and kept is none of them."""
    given = ((item, getattr(component, item.name)) for item in dataclasses.fields(component))
    return {item.name: _plain(value) for item, value in given if value is not None and value != item.default}


def _plain(value: Any) -> Any:
    """The value in types of TOML and JSON."""
    if isinstance(value, Element):
        return value.table
    if isinstance(value, tuple | list):
        return [_plain(inner) for inner in value]
    if isinstance(value, Shunt):
        return shunt_table(value)
    if isinstance(value, Component):
        return given_keys(value)
    return value.item() if hasattr(value, "item") else value
