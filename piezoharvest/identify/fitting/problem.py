"""Records to be fitted with a model: what is known of their noise, and of the parameters before."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model, own_limits, own_names
from piezoharvest.identify.noise.drive_denoising import noise_floor
from piezoharvest.identify.noise.noise_model import Noise, ceiling, first_guess
from piezoharvest.predict.parameters import value_at

PRIOR = 1.0  # standard deviation of the logarithm of a parameter about its nominal value, where nothing else is known
WEAK = 10.0  # the same for a linear one, in units of its own size
CHANCE = 3.0  # standard errors, by which a noise may be less than the lines of records show
FAINTEST = 1e-6  # of its range, that the noise of a channel is taken to have at least
# Standard deviations of numbers of a record that may not show in it: the logarithm of how long a jump takes, which
# shows in what overshoots or not at all, and where stops are at its beginning, as share of their thresholds.
UNSEEN = {"rise": 2.0, "history": 1.0}


class Problem:
    """Records to be fitted with a model.

    Parameters
    ----------
    data : sequence of Data
    nominal : Transducer
        Mean of the prior.
    offset_channels : tuple of str
    """

    def __init__(
        self, data: Sequence[Data | FrequencyData], nominal: Transducer, offset_channels: tuple[str, ...]
    ) -> None:
        self.data, self.nominal, self.offset_channels = tuple(data), nominal, offset_channels

    def noise(self) -> Noise:
        """Guess of the noise from the records themselves."""
        found: dict[str, list[float]] = {}
        for data in self.data:
            if isinstance(data, FrequencyData):
                found[data.name] = [1.0]  # times the noise that its lines show
                continue
            for channel in (*data.channels, data.drive):
                guess = first_guess(data.record[channel])
                floor = FAINTEST * float(np.ptp(data.record[channel])) + 1e-300
                found.setdefault(channel, []).append(data.sigma.get(channel, max(guess, floor)))
        return Noise({**{channel: float(np.median(values)) for channel, values in found.items()}, **self.known})

    @cached_property
    def known(self) -> dict[str, float]:
        """Standard deviations that the campaign gives, and those of drives that show theirs by themselves.

        What residuals tell of a drive's noise depends on how the model passes it on, which may be wrong.
        """
        floors: dict[str, list[tuple[float, int]]] = {}
        for data in self.data:
            if isinstance(data, Data) and (floor := noise_floor(data.record[data.drive])) is not None:
                floors.setdefault(data.drive, []).append(floor)
        shown = {
            name: float(np.sqrt(np.average([sigma**2 for sigma, _ in some], weights=[count for _, count in some])))
            for name, some in floors.items()
        }
        return {**shown, **{channel: sigma for data in self.data for channel, sigma in data.sigma.items()}}

    @cached_property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Between which standard deviations the noise of the channels is, as the records themselves show it."""
        found: dict[str, tuple[float, float]] = {}
        for data in self.data:
            if isinstance(data, FrequencyData):
                continue
            for channel in (*data.channels, data.drive):
                floor = FAINTEST * float(np.ptp(data.record[channel])) + 1e-300
                highest = max(found.get(channel, (0.0, 0.0))[1], floor, ceiling(data.record[channel]))
                found[channel] = self._floors.get(channel, 0.0), highest
        return found

    @cached_property
    def _floors(self) -> dict[str, float]:
        """Smallest standard deviations of the noise of responses: less than all records show would be by chance."""
        shown: dict[str, list[tuple[float, int] | None]] = {}
        for data in self.data:
            if isinstance(data, FrequencyData):
                continue
            for channel in data.channels:
                shown.setdefault(channel, []).append(noise_floor(data.record[channel]))
        found = {}
        for channel, each in shown.items():
            seen = [floor for floor in each if floor is not None]
            if len(seen) == len(each):
                total = sum(count for _, count in seen)
                mean = float(np.sqrt(sum(sigma**2 * count for sigma, count in seen) / total))
                found[channel] = mean * (1.0 - CHANCE / np.sqrt(2.0 * total))
        return found

    def start(self, model: Model) -> tuple[np.ndarray, ...]:
        """Own numbers of the records before a fit: all zero."""
        return tuple(np.zeros(len(self.own_names(model, data))) for data in self.data)

    def own_names(self, model: Model, data: Data | FrequencyData) -> tuple[str, ...]:
        """Names of a record's own numbers."""
        return () if isinstance(data, FrequencyData) else own_names(model, data)

    def own_limits(self, model: Model) -> np.ndarray:
        """The largest sizes of the own numbers of all records, one after the other."""
        return np.concatenate(
            [own_limits(model, data) for data in self.data if isinstance(data, Data)] or [np.zeros(0)]
        )


def carried(problem: Problem, before: Model, own: Sequence[np.ndarray], after: Model) -> tuple[np.ndarray, ...]:
    """The records' own numbers in another model: those of the same name stay, new ones are zero.

    But a new stop begins where the last one of the old does, for the same load has moved it before.
    """
    found = []
    for data, mine in zip(problem.data, own, strict=True):
        old = _numbered(problem.own_names(before, data))
        values = dict(zip(old, mine, strict=True))
        past = next((value for (name, _), value in reversed(values.items()) if name.startswith("history")), 0.0)
        found.append(
            np.array(
                [
                    values.get(name, past if name[0].startswith("history") else 0.0)
                    for name in _numbered(problem.own_names(after, data))
                ]
            )
        )
    return tuple(found)


def renamed(
    before: Problem, own: Sequence[np.ndarray], after: Problem, model: Model, rest: Sequence[np.ndarray] | None = None
) -> tuple[np.ndarray, ...]:
    """The own numbers of records that are cut elsewhere: those of the same name stay, others are as in the rest.

    Parameters
    ----------
    before, after : Problem
        Of the same records.
    own : sequence of (o,) array
    model : Model
    rest : sequence of (o,) array, optional
        Default zero.
    """
    found = []
    for old, new, mine, other in zip(before.data, after.data, own, rest or after.start(model), strict=True):
        values = dict(zip(_numbered(before.own_names(model, old)), mine, strict=True))
        names = _numbered(after.own_names(model, new))
        found.append(np.array([values.get(name, value) for name, value in zip(names, other, strict=True)]))
    return tuple(found)


def _numbered(names: Sequence[str]) -> list[tuple[str, int]]:
    return [(name, list(names[:k]).count(name)) for k, name in enumerate(names)]


def prior_of(problem: Problem, model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Means and inverse variances of all parameters."""
    means, precision = [], []
    for parameter in model.parameters:
        if parameter.path[0] == "effects":
            means.append(0.0)
            precision.append(0.0)
            continue
        nominal = parameter.inner(value_at(problem.nominal, parameter.path))
        means.append(nominal)
        size = PRIOR if parameter.scaling == "log" else WEAK * (abs(nominal) or 1.0)
        precision.append(size**-2)
    known = [
        next((size**-2 for start, size in UNSEEN.items() if name.startswith(start)), 0.0)
        for data in problem.data
        for name in problem.own_names(model, data)
    ]
    return np.concatenate([means, np.zeros(len(known))]), np.concatenate([precision, known])
