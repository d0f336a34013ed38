"""Records to be fitted with a model: prior knowledge of their noise and of the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import Model, nuisance_limits, nuisance_names
from piezoharvest.identify.noise.noise_levels import noise_floor
from piezoharvest.identify.noise.noise_model import Noise, initial_noise, noise_upper_bound
from piezoharvest.predict.circuit.setting import begins_anywhere, by_engine, has_events
from piezoharvest.predict.parameters import Path, value_at

PRIOR_DEVIATION = 1.0  # prior standard deviation of the logarithm of a parameter about its nominal value
LINEAR_PRIOR_DEVIATION = 10.0  # the same for a linear parameter, in units of its nominal value
NOISE_STANDARD_ERRORS = 3.0  # standard errors by which a noise may be below that at the highest frequencies of records
MIN_RELATIVE_NOISE = 1e-6  # of its range: least noise of a channel
# The same of a response without any noise, as of a simulation: about the error of a solver with a tolerance of 1e-6,
# and of a prediction between samples (`data.MIN_RELATIVE_NOISE` of a standard deviation). It is no random one.
EXACT_RELATIVE_NOISE = 1e-5
# Prior standard deviations of nuisance parameters that a record may not determine: the logarithm of the duration of a
# jump, which shows only in overshoots; the initial states of stops, relative to their thresholds; and initial states
# behind a circuit, relative to the largest ones that the nominal model reaches from rest. An edge of a gate is anywhere
# within its sample, from -1 to 1, with the standard deviation of that.
NUISANCE_PRIORS = {"rise": 2.0, "history": 1.0, "start": 3.0, "edge": 3.0**-0.5}
# The same of initial states that first samples show, about what these show: the nominal coupling and capacitance, from
# which the charge is taken, may be some per cent off.
STARTS_SHOWN = 0.1


class Problem:
    """Records to be fitted with a model.

    Parameters
    ----------
    data : sequence of Data
    nominal : Transducer
        Mean of the prior.
    offset_channels : tuple of str
    beliefs : mapping of Path to (float, float), optional
        Prior mean and standard deviation of the variables of parameters whose prior is not that about nominal values:
        other specimens of the same kind tell it.
    """

    def __init__(
        self,
        data: Sequence[Data | FrequencyData],
        nominal: Transducer,
        offset_channels: tuple[str, ...],
        beliefs: Mapping[Path, tuple[float, float]] | None = None,
    ) -> None:
        self.data, self.nominal, self.offset_channels = tuple(data), nominal, offset_channels
        self.beliefs = dict(beliefs or {})

    @cached_property
    def has_events(self) -> bool:
        """True if a record is one behind a circuit with diodes or switches."""
        return any(map(_switches, self.data))

    @cached_property
    def needs_engine(self) -> bool:
        """True if the engine predicts a record: in steady state, or as `begins_anywhere` says."""
        return any(isinstance(data, Data) and by_engine(data.setting) for data in self.data)

    @cached_property
    def is_exact(self) -> bool:
        """True if no response has any noise, as those of a simulation: what a model leaves is nothing random."""
        return all(
            isinstance(data, Data) and all(_is_exact(data, channel) for channel in data.channels) for data in self.data
        )

    def noise(self) -> Noise:
        """Guess of the noise from the records themselves."""
        found: dict[str, list[float]] = {}
        for data in self.data:
            if isinstance(data, FrequencyData):
                found[data.name] = [1.0]  # times the noise of its lines
                continue
            for channel in (*data.channels, data.drive):
                guess = initial_noise(data.record[channel]) / data.level(channel)
                found.setdefault(channel, []).append(data.sigma.get(channel, max(guess, _least_noise(data, channel))))
        return Noise({**{channel: float(np.median(values)) for channel, values in found.items()}, **self.known})

    @cached_property
    def known(self) -> dict[str, float]:
        """Standard deviations from the campaign, and those of drives whose noise floor is visible.

        Estimates of a drive's noise from residuals depend on the model that filters it, which may be wrong.
        """
        floors: dict[str, list[tuple[float, int]]] = {}
        for data in self.data:
            if isinstance(data, Data) and (floor := _floor(data, data.drive)) is not None:
                floors.setdefault(data.drive, []).append(floor)
        shown = {
            name: float(np.sqrt(np.average([sigma**2 for sigma, _ in some], weights=[count for _, count in some])))
            for name, some in floors.items()
        }
        return {**shown, **{channel: sigma for data in self.data for channel, sigma in data.sigma.items()}}

    @cached_property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Lower and upper limits of the noise of the channels, from the records themselves."""
        found: dict[str, tuple[float, float]] = {}
        for data in self.data:
            if isinstance(data, FrequencyData):
                continue
            for channel in (*data.channels, data.drive):
                least = _least_noise(data, channel)
                floor, _ = _floor(data, channel) or (0.0, 0)  # larger than the upper half band if that is attenuated
                bound = max(noise_upper_bound(data.record[channel]) / data.level(channel), floor)
                lowest, highest = found.get(channel, (self._floors.get(channel, 0.0), 0.0))
                lowest = max(lowest, least) if _is_exact(data, channel) else lowest
                found[channel] = lowest, max(highest, least, bound)
        return found

    @cached_property
    def _floors(self) -> dict[str, float]:
        """Lower limits of the noise of responses, from the noise floors of all records and their standard errors."""
        shown: dict[str, list[tuple[float, int] | None]] = {}
        for data in self.data:
            if isinstance(data, FrequencyData):
                continue
            for channel in data.channels:
                shown.setdefault(channel, []).append(_floor(data, channel))
        found = {}
        for channel, each in shown.items():
            seen = [floor for floor in each if floor is not None]
            if len(seen) == len(each):
                total = sum(count for _, count in seen)
                mean = float(np.sqrt(sum(sigma**2 * count for sigma, count in seen) / total))
                found[channel] = mean * (1.0 - NOISE_STANDARD_ERRORS / np.sqrt(2.0 * total))
        return found

    def start(self, model: Model) -> tuple[np.ndarray, ...]:
        """Start values of the records' nuisance parameters: zero, unless a record knows better."""
        return tuple(
            np.array([data.start.get(name, 0.0) for name in self.nuisance_names(model, data)])
            if isinstance(data, Data)
            else np.zeros(0)
            for data in self.data
        )

    def nuisance_names(self, model: Model, data: Data | FrequencyData) -> tuple[str, ...]:
        """Names of a record's nuisance parameters."""
        return () if isinstance(data, FrequencyData) else nuisance_names(model, data)

    def nuisance_limits(self, model: Model) -> np.ndarray:
        """Largest magnitudes of the nuisance parameters of all records, concatenated."""
        return np.concatenate(
            [nuisance_limits(model, data) for data in self.data if isinstance(data, Data)] or [np.zeros(0)]
        )


def nuisance_for_model(
    problem: Problem, before: Model, nuisance: Sequence[np.ndarray], after: Model
) -> tuple[np.ndarray, ...]:
    """Nuisance parameters of the records for another model: those of the same name are kept, new ones are zero.

    A new stop, however, gets the initial state of the last old one, because the same load has moved it before.
    """
    found = []
    for data, mine in zip(problem.data, nuisance, strict=True):
        old = numbered(problem.nuisance_names(before, data))
        values = dict(zip(old, mine, strict=True))
        past = next((value for (name, _), value in reversed(values.items()) if name.startswith("history")), 0.0)
        found.append(
            np.array(
                [
                    values.get(name, past if name[0].startswith("history") else 0.0)
                    for name in numbered(problem.nuisance_names(after, data))
                ]
            )
        )
    return tuple(found)


def nuisance_for_problem(
    before: Problem,
    nuisance: Sequence[np.ndarray],
    after: Problem,
    model: Model,
    rest: Sequence[np.ndarray] | None = None,
) -> tuple[np.ndarray, ...]:
    """Nuisance parameters of records with other lengths: those of the same name are kept, others are from `rest`.

    Parameters
    ----------
    before, after : Problem
        Problems with the same records.
    nuisance : sequence of (o,) array
    model : Model
    rest : sequence of (o,) array, optional
        Values of the others; default zero.
    """
    found = []
    for old, new, mine, other in zip(before.data, after.data, nuisance, rest or after.start(model), strict=True):
        values = dict(zip(numbered(before.nuisance_names(model, old)), mine, strict=True))
        units = {name: _unit(old, name) / _unit(new, name) for name in after.nuisance_names(model, new)}
        names = numbered(after.nuisance_names(model, new))
        kept = ((name, values.get(name), value) for name, value in zip(names, other, strict=True))
        found.append(np.array([value if known is None else known * units[name] for (name, _), known, value in kept]))
    return tuple(found)


def _least_noise(data: Data, channel: str) -> float:
    """Least noise of a record's channel."""
    relative = EXACT_RELATIVE_NOISE if _is_exact(data, channel) else MIN_RELATIVE_NOISE
    return relative * float(np.ptp(data.record[channel])) + 1e-300


def _is_exact(data: Data, channel: str) -> bool:
    """True for a response whose upper half band is all but empty, and shows no noise either."""
    values = data.record[channel]
    if channel == data.drive or channel in data.sigma or noise_floor(data.record, channel) is not None:
        return False
    return noise_upper_bound(values) < EXACT_RELATIVE_NOISE * np.ptp(values)


def _floor(data: Data, channel: str) -> tuple[float, int] | None:
    """Noise floor of a record, as it would be at the level of the campaign, and the number of its lines."""
    floor = noise_floor(data.record, channel)
    return None if floor is None else (floor[0] / data.level(channel), floor[1])


def _switches(data: Data | FrequencyData) -> bool:
    """True for a record behind a circuit with diodes or switches."""
    return isinstance(data, Data) and has_events(data.setting.shunt, data.drive)


def starting(problem: Problem, model: Model) -> tuple[np.ndarray, ...]:
    """Masks of the nuisance parameters that say where records behind circuits begin, if the engine predicts them."""
    each = ((_own_starts(data), problem.nuisance_names(model, data)) for data in problem.data)
    return tuple(np.array([name in own for name in names], bool) for own, names in each)


def _own_starts(data: Data | FrequencyData) -> set[str]:
    """Names of the initial states of structure, electrodes and circuit of a record that the engine predicts."""
    if not isinstance(data, Data) or not begins_anywhere(data.setting.shunt, data.drive):
        return set()
    return {f"start {state}" for state in data.setting.free}


def starts_as_shown(problem: Problem, model: Model, nuisance: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    """Nuisance parameters with records behind diodes or switches beginning as their first samples show them."""
    every = zip(starting(problem, model), problem.start(model), nuisance, strict=True)
    return tuple(np.where(mask, shown, mine) for mask, shown, mine in every)


def _unit(data: Data | FrequencyData, name: str) -> float:
    """Unit of a nuisance parameter, SI: those of initial states behind circuits depend on the length of the record."""
    if not isinstance(data, Data):
        return 1.0
    sizes = zip(data.setting.free, data.setting.sizes, strict=False)  # records of linear circuits have no sizes
    return {f"start {state}": size for state, size in sizes}.get(name, 1.0)


def numbered(names: Sequence[str]) -> list[tuple[str, int]]:
    """Names with the number of each among those that are the same."""
    return [(name, list(names[:k]).count(name)) for k, name in enumerate(names)]


def prior_of(problem: Problem, model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Prior means and inverse variances of all parameters."""
    means, precision = [], []
    for parameter in model.parameters:
        if parameter.path in problem.beliefs:
            mean, deviation = problem.beliefs[parameter.path]
            means.append(mean)
            precision.append(deviation**-2)
            continue
        if parameter.path[0] == "effects" and int(parameter.path[1]) >= len(problem.nominal.effects):
            means.append(0.0)
            precision.append(parameter.deviation**-2)
            continue
        nominal = parameter.inner(value_at(problem.nominal, parameter.path))
        means.append(nominal)
        scale = parameter.deviation if np.isfinite(parameter.deviation) else LINEAR_PRIOR_DEVIATION
        size = PRIOR_DEVIATION if parameter.scaling == "log" else scale * (abs(nominal) or 1.0)
        precision.append(size**-2)
    known = [prior for data in problem.data for prior in _nuisance_priors(problem, model, data)]
    more = np.array(known).reshape(-1, 2)
    return np.concatenate([means, more[:, 0]]), np.concatenate([precision, more[:, 1]])


def _nuisance_priors(problem: Problem, model: Model, data: Data | FrequencyData) -> list[tuple[float, float]]:
    """Means and inverse variances of a record's nuisance parameters.

    The mean of an effect's initial state is rest, and its deviation what it could reach: without this, the start of a
    relaxation that is about as slow as the record is long could not be told from an offset.
    """
    names = problem.nuisance_names(model, data)
    found = [_nuisance_prior(data, name) for name in names]
    if isinstance(data, Data):
        prediction = model.prediction(data)
        for k, size in enumerate(prediction.reach, prediction.begun_from):
            found[k] = 0.0, size**-2 if size > 0.0 else 0.0
    return found


def _nuisance_prior(data: Data | FrequencyData, name: str) -> tuple[float, float]:
    """Mean and inverse variance of a nuisance parameter; the latter is zero where nothing is known."""
    if isinstance(data, Data) and name in data.start:
        return data.start[name], STARTS_SHOWN**-2
    return 0.0, next((size**-2 for start, size in NUISANCE_PRIORS.items() if name.startswith(start)), 0.0)
