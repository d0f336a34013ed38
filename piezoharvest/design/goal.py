"""Figure of merit of a design: its objective and limits as one number to be minimised."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from piezoharvest.description.shunts import Shunt
from piezoharvest.study import DesignOptions

if TYPE_CHECKING:
    from piezoharvest.engine.response import Response

MARGIN = 1e-3  # tuning keeps this relative distance from a limit, so that rounding does not violate it
PENALTY = 100.0  # merit per e-fold beyond a limit: far above any trade between the logarithms of these figures
_TOLERANCE = 1e-6
SMALLEST_FIGURE = 1e-30  # W or m, in place of zero under a logarithm
COILS = ("inductor", "coil", "second")  # names of states that are the current of a coil, beside "current..."


class DesignFigures(NamedTuple):
    """Figures of a shunt in the operation of the design.

    Attributes
    ----------
    harvested_power : float
        W; over a band its mean.
    displacement_amplitude, voltage_amplitude : float
        m and V; over a band the largest.
    attenuation_db : float
        Displacement against the short circuit's; over a band worst peak against worst peak.
    converged : bool
    message : str
        Remarks on the simulation.
    response : Response or None
        A simulation, over a band that of the largest displacement; None for figures of the linear two-port.
    standard_error : float or None
        Of the harvested power under noise, W; None where it is not estimated.
    """

    harvested_power: float
    displacement_amplitude: float
    voltage_amplitude: float
    attenuation_db: float
    converged: bool = True
    message: str = ""
    response: Response | None = None
    standard_error: float | None = None


class Slopes(NamedTuple):
    """Derivatives (n,) of the logarithms of a shunt's figures by the logarithms of its parts."""

    harvested_power: np.ndarray
    displacement_amplitude: np.ndarray
    voltage_amplitude: np.ndarray


@dataclass(frozen=True)
class Goal:
    """Objective and limits of a design.

    `min_attenuation_db` is read without its sign: 6 and -6 both ask for at least 6 dB less displacement than with
    shorted electrodes.
    """

    options: DesignOptions

    @property
    def damping(self) -> bool:
        """True if displacement is to be minimised, False if harvested power is to be maximised."""
        return self.options.objective == "damping"

    @property
    def counts_power(self) -> bool:
        """True if the merit depends on harvested power: it is the objective, or has a limit."""
        return not self.damping or self.options.min_power is not None

    @property
    def limits_levels(self) -> bool:
        """True if displacement or voltage has a limit."""
        o = self.options
        return any(limit is not None for limit in (o.max_voltage, o.max_displacement, o.min_attenuation_db))

    def largest_displacement(self, shorted: float) -> float:
        """Largest displacement allowed in m, given that with shorted electrodes; infinite without a limit."""
        limits = [np.inf]
        if self.options.max_displacement is not None:
            limits.append(self.options.max_displacement)
        if self.options.min_attenuation_db is not None:
            limits.append(shorted * 10 ** (-abs(self.options.min_attenuation_db) / 20))
        return min(limits)

    def excess(self, figures: DesignFigures) -> dict[str, float]:
        """Logarithm of each limited figure over its limit; negative where the limit is kept."""
        o, found = self.options, {}
        if o.max_voltage is not None:
            found["max_voltage"] = _log(figures.voltage_amplitude) - np.log(o.max_voltage)
        if o.max_displacement is not None:
            found["max_displacement"] = _log(figures.displacement_amplitude) - np.log(o.max_displacement)
        if o.min_power is not None:
            found["min_power"] = _log(o.min_power) - _log(figures.harvested_power)
        if o.min_attenuation_db is not None:
            found["min_attenuation_db"] = (figures.attenuation_db + abs(o.min_attenuation_db)) * np.log(10) / 20
        return found

    def excess_slopes(self, slopes: Slopes) -> np.ndarray:
        """Derivatives (m, n) of each `excess`."""
        o, level = self.options, slopes.displacement_amplitude
        found = [
            (o.max_voltage, slopes.voltage_amplitude), (o.max_displacement, level),
            (o.min_power, -slopes.harvested_power), (o.min_attenuation_db, level),
        ]  # fmt: skip
        return np.reshape([slope for limit, slope in found if limit is not None], (-1, len(level)))

    def violated(self, figures: DesignFigures, shunt: Shunt, capacitance: float) -> tuple[str, ...]:
        """Names of the limits that are violated; a figure that is not a number violates its limit."""
        broken = [name for name, by in self.excess(figures).items() if not by <= _TOLERANCE]
        limit = self.options.max_inductance
        if limit is not None and largest_inductance(shunt, capacitance) > limit * (1 + _TOLERANCE):
            broken.append("max_inductance")
        return tuple(broken)

    def score(self, figures: DesignFigures) -> float:
        """The objective alone, smaller is better: logarithm of displacement, or of one over power."""
        return _log(figures.displacement_amplitude) if self.damping else -_log(figures.harvested_power)

    def score_slope(self, slopes: Slopes) -> np.ndarray:
        """Derivatives (n,) of `score`."""
        return slopes.displacement_amplitude if self.damping else -slopes.harvested_power

    def agree(self, first: DesignFigures, second: DesignFigures, within: float) -> bool:
        """True if two sets of figures agree within so many e-folds, and are on the same side of each limit."""
        a, b = ([self.score(f), *self.excess(f).values()] for f in (first, second))
        sides = [(x > _TOLERANCE) == (y > _TOLERANCE) for x, y in zip(a[1:], b[1:], strict=True)]
        return bool(np.allclose(a, b, rtol=0, atol=within)) and all(sides)

    def merit(self, figures: DesignFigures) -> float:
        """The number that every tuning minimises: objective plus a penalty on limits that are exceeded."""
        beyond = sum(max(0.0, by + MARGIN) for by in self.excess(figures).values())
        untrusted = 0.0 if figures.converged else PENALTY
        merit = self.score(figures) + PENALTY * beyond + untrusted
        return merit if np.isfinite(merit) else 1e6


def largest_inductance(shunt: Shunt, capacitance: float) -> float:
    """Largest inductance of a circuit and its others in H: the storage of their states of coils; 0 without any."""
    states = [state for each in (shunt, *shunt.others) for state in each.states(capacitance)]
    coils = [s for s in states if s.name.startswith("current") or s.name in COILS]
    return max((float(s.storage) for s in coils), default=0.0)


def _log(value: float) -> float:
    return float(np.log(max(value, SMALLEST_FIGURE)))
