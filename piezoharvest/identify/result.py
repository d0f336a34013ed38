"""Result of an identification: parameters with standard errors, and residuals of the records."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.confidence import confidence_region, correlations
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.identify.resonance_figures import ResonanceFigure, resonance_figures
from piezoharvest.identify.saving import save, specimen_of
from piezoharvest.notebook import Shown, axes_for
from piezoharvest.predict.parameters import Parameter
from piezoharvest.records.campaign import Campaign


@dataclass(frozen=True)
class Estimate:
    """Estimate of a parameter.

    Attributes
    ----------
    parameter : Parameter
    value, nominal : float
        SI unit.
    std : float or None
        Standard error in the same unit; None if the data do not determine it.
    identifiable : bool
    assumes : tuple of str
        Undetermined parameters on whose nominal values this estimate depends: if one of these is off by a tenth, the
        estimate is off by more than its standard error.
    combination : str
        Combination with other parameters that is known instead, if any.
    experiment : str
        The measurement that would determine it.
    note : str
        Remark: the sign is the nominal one, or the records contradict the nominal value.
    contradicted : bool
        True if the records contradict the nominal value, though they do not determine the parameter.
    """

    parameter: Parameter
    value: float
    nominal: float
    std: float | None
    identifiable: bool
    assumes: tuple[str, ...] = ()
    combination: str = ""
    experiment: str = ""
    note: str = ""
    contradicted: bool = False


@dataclass(frozen=True)
class Quality:
    """Rms of the residuals, and rms expected from noise alone, by channel; SI units.

    `weighted`, of responses, whose noise depends on the frequency: rms of the residual of each line over its own noise.
    """

    rms: Mapping[str, float]
    noise: Mapping[str, float]
    weighted: Mapping[str, float] = field(default_factory=dict)

    def ratio(self, channel: str) -> float:
        """Residual of a channel in units of the noise."""
        noise = self.noise[channel]
        return self.weighted.get(channel, self.rms[channel] / noise if noise else math.inf)


@dataclass(frozen=True)
class RecordQuality:
    """One record: its name, role, and residuals.

    Attributes
    ----------
    name, role : str
    quality : Quality
    nuisance : mapping of str to float
    warning : str
        Warning about the fit of a frequency response.
    missed : bool
        True if the fit misses a feature that a frequency response plainly shows.
    """

    name: str
    role: str
    quality: Quality
    own: Mapping[str, float]
    warning: str = ""
    missed: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Shown):
    """A campaign's parameters.

    Attributes
    ----------
    campaign : Campaign
    transducer : Transducer
        With the identified values.
    estimates : tuple of Estimate
    fit, validation : Quality
        Of the fitted and of the validation records; the latter has no channels if there are none.
    records : tuple of RecordQuality
    noise : Noise
    converged : bool
    message : str
    found : Fit
    offsets : tuple of str
        Channels whose offset was free in every record.
    held : tuple of Parameter
        Parameters that `found` keeps where another fit has put them (`with_parameters_held`); empty if it fitted them.
    """

    campaign: Campaign
    transducer: Transducer
    estimates: tuple[Estimate, ...]
    fit: Quality
    validation: Quality
    records: tuple[RecordQuality, ...]
    noise: Noise
    converged: bool
    message: str
    found: Fit
    offsets: tuple[str, ...]
    held: tuple[Parameter, ...] = ()

    def save(self, path: str | Path) -> None:
        """Write the specimen file, which a study takes by `transducer = "FILE"`; raises `OutputError`."""
        save(self.found, self.estimates, self.campaign, path, command="identify", trusted=not self.doubts)

    @property
    def heading(self) -> str:
        """How many parameters of how many records, and whether to trust them."""
        known = sum(estimate.identifiable for estimate in self.estimates)
        trusted = f"not to be trusted: {'; '.join(self.doubts)}" if self.doubts else "converged"
        some = f"{known} of {counted(len(self.estimates), 'parameter')}"
        return f"{some} from {counted(len(self.records), 'record')}, {trusted}"

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The parameters, one a row, with the remark of `Estimate.note` (a sign that is the nominal one)."""
        return [
            {"parameter": e.parameter.name, "value": e.value, "std": e.std, "unit": e.parameter.unit,
             "nominal": e.nominal, "identifiable": e.identifiable, "note": e.note}
            for e in self.estimates
        ]  # fmt: skip

    @property
    def resonances(self) -> tuple[ResonanceFigure, ...]:
        """Resonances with shorted and open electrodes and coupling, as far as the records determine them.

        Coupling and capacitance have errors that go together, of which these are often free.
        """
        if self.campaign.unknown:  # of a specimen far below its resonance
            return ()
        specimen = specimen_of(self.found, self.estimates, self.campaign)
        order = {name: n for n, name in enumerate(specimen.values)}
        own = [e for e in self.estimates if e.parameter.path[0] not in ("effects", "hysteresis")]
        names = [".".join(map(str, e.parameter.path)) for e in own]
        fitted = [n for n, name in enumerate(names) if name in order]
        places = [order[names[n]] for n in fitted]
        scatter = np.zeros((len(own), len(own)))
        scatter[np.ix_(fitted, fitted)] = specimen.covariance[np.ix_(places, places)]
        return resonance_figures(
            self.transducer, [e.parameter.path for e in own], scatter, [e.identifiable for e in own]
        )

    def correlations(self) -> tuple[tuple[str, ...], np.ndarray]:
        """Names of the parameters that the records determine, and the correlations of their errors, (n, n) array."""
        return correlations(specimen_of(self.found, self.estimates, self.campaign))

    def plot(self, ax: Any = None) -> Any:
        """Draw the parameters over their nominal values, with two standard errors, into axes of matplotlib.

        Returns
        -------
        Axes
        """
        (axes,) = axes_for(ax)
        shown = [e for e in self.estimates if e.identifiable and e.nominal and e.std is not None]
        ratios = [e.value / e.nominal for e in shown]
        errors = [2 * (e.std or 0.0) / abs(e.nominal) for e in shown]
        axes.errorbar(ratios, range(len(shown)), xerr=errors, fmt="o", capsize=3)
        axes.axvline(1.0, color="0.6", linewidth=0.8)
        axes.set_yticks(range(len(shown)), [e.parameter.name for e in shown])
        axes.set(xlabel="identified over nominal value, two standard errors")
        return axes

    def plot_confidence(self, first: str, second: str, ax: Any = None) -> Any:
        """Draw the region of 95 % of two parameters, an ellipse about their values, into axes of matplotlib.

        Parameters
        ----------
        first, second : str
            Names as in `correlations`.
        ax : Axes, optional

        Returns
        -------
        Axes

        Raises
        ------
        ValueError
            The records do not determine a parameter of such a name, or both are the same.
        """
        specimen = specimen_of(self.found, self.estimates, self.campaign)
        x, y = confidence_region(specimen, first, second)
        units = {estimate.parameter.name: estimate.parameter.unit for estimate in self.estimates}
        (axes,) = axes_for(ax)
        axes.plot(x, y)
        axes.plot(specimen.values[first], specimen.values[second], "o")
        axes.set(xlabel=f"{first} in {units.get(first, '')}", ylabel=f"{second} in {units.get(second, '')}")
        return axes

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons not to trust the result."""
        missed = (record.warning for record in self.records if record.missed and record.role == "fit")
        return (*(() if self.converged else (self.message,)), *missed)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the result, in addition to the doubts."""
        contradicted = [estimate.parameter.name for estimate in self.estimates if estimate.contradicted]
        rough = (
            f"the records contradict the nominal {' and '.join(contradicted)} but do not determine it: give a better "
            "one; the standard errors of the other parameters are rough"
        )
        warnings = (r.warning for r in self.records if r.warning and not (r.missed and r.role == "fit"))
        return (*((rough,) if contradicted else ()), *warnings)
