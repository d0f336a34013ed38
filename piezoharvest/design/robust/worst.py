"""Worst case of a candidate over the box of a tolerance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from piezoharvest.design.goal import DesignFigures


@dataclass(frozen=True)
class LimitCase:
    """The worst that a limit meets in the box.

    Attributes
    ----------
    name : str
        Key of the limit.
    value : float
        The limited figure there, in the unit of the limit.
    excess : float
        Logarithm of the figure over the limit; negative where the limit is kept.
    corner : dict
        The point, by axis.
    kept : bool
    """

    name: str
    value: float
    excess: float
    corner: Mapping[str, float]
    kept: bool


@dataclass(frozen=True)
class RobustCase:
    """The worst of a candidate's objective, and of each limit, anywhere in the box.

    Attributes
    ----------
    objective : str
        Key of the figure that is worst here: "harvested_power" (W) or "attenuation_db".
    figures : DesignFigures
        All figures in the worst corner, by simulation; attenuation is against the study's transducer, shorted.
    corner : mapping
        Deviations there: relative, the temperature's in K.
    certified : float or None
        Value of the objective that no point of the box is worse than; None for circuits with switches, and others that
        the certificate does not know.
    gap : float or None
        Distance from the worst found to the certified value: 1 - certified/worst for power, or dB.
    nominal_cost : float
        Loss of the objective in the middle of the box by the design for the worst case: 1 - P/P_nominal, or dB.
    limits : tuple of LimitCase
    samples : int
        Random points that were simulated, or computed on the two-port, to verify the worst case.
    sampled : float or None
        The worst of them.
    converged : bool
        True if all simulations of the search were reliable and none was left out.
    left_out : tuple of str
        Axes that this candidate does not have.
    """

    objective: str
    figures: DesignFigures
    corner: Mapping[str, float]
    certified: float | None
    gap: float | None
    nominal_cost: float
    limits: tuple[LimitCase, ...]
    samples: int
    sampled: float | None
    converged: bool
    left_out: tuple[str, ...] = ()

    @property
    def worst(self) -> float:
        """The worst figure of the objective, W or dB."""
        return getattr(self.figures, self.objective)

    @property
    def violates(self) -> tuple[str, ...]:
        """Limits that are not kept everywhere in the box."""
        return tuple(limit.name for limit in self.limits if not limit.kept)

    @property
    def binds(self) -> str | None:
        """The limit that is nearest to its value, or furthest beyond it, somewhere in the box; None without limits."""
        return max(self.limits, key=lambda limit: limit.excess).name if self.limits else None

    @property
    def remarks(self) -> list[str]:
        """Remarks on what is not sure, and on limits that are not kept, in words."""
        unsure = "the worst case is uncertain: part of the tolerance box is unstable or could not be simulated"
        found = [] if self.converged else [unsure]
        if self.left_out and self.figures.harvested_power > 0:
            found.append(f"its worst case leaves out {', '.join(self.left_out)}: this kind has no such key")
        for limit in self.limits:
            if not limit.kept:
                where = ", ".join(f"{name} {value:+.3g}" for name, value in limit.corner.items())
                found.append(f"{limit.name} is not met everywhere within the tolerance ({limit.value:.4g} at {where})")
        return found

    def as_json(self) -> dict[str, Any]:
        """Worst case as a table of the JSON output."""
        names = ("harvested_power", "attenuation_db", "displacement_amplitude", "voltage_amplitude")
        limits = {
            limit.name: {"worst": limit.value, "corner": dict(limit.corner), "kept": limit.kept}
            for limit in self.limits
        }
        more = ("objective", "certified", "gap", "nominal_cost", "samples", "sampled", "binds", "converged")
        return {
            **{name: getattr(self.figures, name) for name in names}, "corner": dict(self.corner),
            **{name: getattr(self, name) for name in more}, "limits": limits, "violates": list(self.violates),
            "left_out": list(self.left_out),
        }  # fmt: skip
