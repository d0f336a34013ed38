"""Identification of a campaign's parameters with standard errors, and validation on records that were not fitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.parameters import ParameterError, check_kind
from piezoharvest.description.transducer import INERT, Transducer
from piezoharvest.identify.confidence import confidence_region, correlations
from piezoharvest.identify.fitting.coupling_signs import with_known_signs
from piezoharvest.identify.fitting.data import Data, data_of
from piezoharvest.identify.fitting.evaluation import map_records
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.likelihood import Whitener
from piezoharvest.identify.fitting.measured_responses import FrequencyData, ResponseQuality
from piezoharvest.identify.fitting.model import Model, unexplained_blocks
from piezoharvest.identify.fitting.output_error import fit, linearised, mean_square, noise_of_responses, standard_errors
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model, nuisance_for_problem
from piezoharvest.identify.identifiability import assumed, combination, experiment, uncertain, undetermined
from piezoharvest.identify.noise.noise_gain import gain_of
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.identify.saving import save, specimen_of
from piezoharvest.identify.start_values.away_from_jumps import fit_past_jumps
from piezoharvest.identify.start_values.initial_hysteresis_state import (
    fit_nuisance,
    has_initial_states,
    may_have_initial_states,
    search_initial_states,
)
from piezoharvest.identify.start_values.multistart import (
    MAX_MEAN_SQUARE,
    ROUGH_TOLERANCE,
    tune_to_responses,
)
from piezoharvest.identify.start_values.quasi_static import (
    as_quasi_static,
    is_far_from_quasi_static,
    may_be_quasi_static,
    quasi_static_fits_as_well,
    resonance_above_nyquist,
)
from piezoharvest.notebook import Shown, axes_for
from piezoharvest.predict.parameters import Parameter, is_of_circuit, parameters_of, value_at
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.records.campaign import Campaign
from piezoharvest.records.errors import CampaignError
from piezoharvest.records.finding import counted
from piezoharvest.records.record import FrequencyRecord, Record
from piezoharvest.threads import single_threaded

Progress = Callable[[str], None]
INITIAL_SAMPLES = 1 << 19  # samples of a record that are fitted first
# Of many records: those of each kind that are fitted first, fewer where there are many kinds, and how many times as
# many there have to be. They determine where the fit of all begins, which then takes a few iterations.
SOME_RECORDS, OF_ALL_KINDS, MANY_TIMES = 8, 16, 4
# Behind circuits: periods of the nominal resonance in the first fit, over which one that is 5 % off loses less than
# half a turn, and the factor by which the records then grow, as the resonance is known that much better.
FIRST_PERIODS, MIN_FIRST_SAMPLES, GROWTH, MAX_STAGES = 8, 200, 4, 6
WEIGHT_TOLERANCE = 1e-3  # relative difference below which weights count as equal
MIN_CONTRADICTION = 25.0  # change of -2 ln L, five standard errors, by which records contradict a nominal value


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
    """Rms of the residuals, and rms expected from noise alone, by channel; SI units."""

    rms: Mapping[str, float]
    noise: Mapping[str, float]


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
        return f"{known} of {len(self.estimates)} parameters from {counted(len(self.records), 'record')}, {trusted}"

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The parameters, one a row."""
        return [
            {"parameter": e.parameter.name, "value": e.value, "std": e.std, "unit": e.parameter.unit,
             "nominal": e.nominal, "identifiable": e.identifiable}
            for e in self.estimates
        ]  # fmt: skip

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
            f"the records contradict the nominal {' and '.join(contradicted)} without telling the value: give a nearer "
            "one; standard errors of what else is fitted are rough"
        )
        warnings = (r.warning for r in self.records if r.warning and not (r.missed and r.role == "fit"))
        return (*((rough,) if contradicted else ()), *warnings)


def prepared(campaign: Campaign, role: str) -> tuple[Data | FrequencyData, ...]:
    """Records of a role, prepared for a fit.

    Raises
    ------
    CampaignError
        The model cannot be driven by a record.
    """
    return map_records(partial(_prepared, campaign), campaign.of_role(role))


def _prepared(campaign: Campaign, record: Record | FrequencyRecord) -> Data | FrequencyData:
    try:
        if isinstance(record, Record):
            return data_of(record, campaign.transducer)
        data = FrequencyData(record)
        data.matrices(campaign.transducer)
        return data
    except ParameterError as error:
        raise CampaignError(campaign.path, f"{record.key}.{error.key}", error.message) from None


@single_threaded
def identify(
    campaign: Campaign,
    progress: Progress = lambda text: None,
    offsets: Sequence[str] | None = None,
    near: Identification | None = None,
    poor: Callable[[Fit], None] = lambda found: None,
) -> Identification:
    """Identify the parameters of a campaign's transducer.

    Parameters
    ----------
    campaign : Campaign
    progress : callable
        Called with messages about progress.
    offsets : sequence of str, optional
        Channels whose offset is free in every record; default all responses.
    near : Identification, optional
        Identification from some of the records, used as the start.
    poor : callable
        Called with a first fit that leaves more than noise, before other starts are tried; it may raise.

    Raises
    ------
    CampaignError
        There are no records to fit, or a record cannot be predicted.
    """
    check_kind("campaign", campaign, Campaign, 'load_campaign("campaign.toml") reads one')
    data = prepared(campaign, "fit")
    if not data:
        raise CampaignError(campaign.path, "records", 'no record has role = "fit", at least one is needed')
    if offsets is None:
        offsets = sorted({channel for each in data for channel in each.channels})
    problem = Problem(data, campaign.transducer, tuple(offsets))
    if resonance_above_nyquist(problem, campaign.transducer):
        return _identify_quasi_static(campaign, progress, offsets)
    drives = {r.drive for r in campaign.records if isinstance(r, Record)}
    parameters, unsigned = with_known_signs(parameters_of(campaign.transducer, drives), data, campaign.transducer)
    model = Model(campaign.transducer, tuple(parameters), tuple(offsets))
    first = _first_fit(problem, model, progress, poor) if near is None else _fit_near(problem, model, near, progress)
    if may_be_quasi_static(problem, first) and _explained_quasi_statically(campaign, problem, first):
        return _identify_quasi_static(campaign, progress, offsets)
    # With `near`, this was tested for that fit, whose model is less distorted by effects in the records.
    begun = search_initial_states(problem, first) if near is None else None
    if begun is not None:
        progress("some records begin after a load that is not recorded")
        first = fit(problem, first.model, begun, first.noise, progress=progress, rounds=2)
    relaxed = may_have_initial_states(problem, first.model) and not has_initial_states(problem, first)
    model = replace(first.model, relaxed=True) if relaxed else first.model
    first = _with_final_weights(problem, first, progress)
    nuisance = nuisance_for_model(problem, first.model, first.nuisance, model)
    verdict = _select_parameters(problem, first, replace(model, transducer=first.model.transducer), nuisance, progress)
    last = verdict.last
    # Nominal values that no record confirms are as good as unknown.
    unconfirmed = {first.model.parameters[k].path for k in verdict.fixed}
    if {(name,) for name in INERT} <= unconfirmed and _explained_quasi_statically(campaign, problem, last):
        return _identify_quasi_static(campaign, progress, offsets)
    estimates = _estimates(campaign, first, verdict, unsigned)
    return identification_of(campaign, problem, last, tuple(estimates), progress)


def with_parameters_held(
    other: Identification, offsets: Sequence[str], progress: Progress = lambda text: None
) -> Identification:
    """The values of an identification in a model with fewer free offsets, of which only nuisance parameters are fitted.

    What the offsets took in is then left in the residuals, where a fit of all parameters would hide it.

    Parameters
    ----------
    other : Identification
        Its estimates, with their standard errors, are those of the result.
    offsets : sequence of str
        Channels whose offset stays free.
    progress : callable
        Called with messages about progress.
    """
    campaign, found, kept = other.campaign, other.found, tuple(offsets)
    problem = Problem(prepared(campaign, "fit"), campaign.transducer, kept)
    before = Problem(problem.data, campaign.transducer, other.offsets)
    model = replace(found.model, parameters=(), offset_channels=kept)
    nuisance = nuisance_for_model(before, found.model, found.nuisance, model)
    last = fit(problem, model, nuisance, found.noise, estimate_noise=False, progress=progress)
    bare = identification_of(campaign, problem, last, other.estimates, progress)
    return replace(bare, held=other.held or found.model.parameters)


def identification_of(
    campaign: Campaign, problem: Problem, last: Fit, estimates: tuple[Estimate, ...], progress: Progress
) -> Identification:
    """Identification with a last fit and its estimates: the residuals of all records."""
    offsets = problem.offset_channels
    shown = [*judged(problem.data, last), *_validation_qualities(campaign, last, offsets, progress)]
    return Identification(
        campaign, last.model.transducer, estimates,
        combined_quality([r for r in shown if r.role == "fit"]),
        combined_quality([r for r in shown if r.role == "validate"]),
        tuple(shown), last.noise, last.converged, last.message, last, offsets,
    )  # fmt: skip


def _explained_quasi_statically(campaign: Campaign, problem: Problem, found: Fit) -> bool:
    """True if a quasi-static specimen explains the records as well as a fit does."""
    quasi_static = replace(campaign, transducer=as_quasi_static(campaign.transducer))
    still = Problem(prepared(quasi_static, "fit"), quasi_static.transducer, problem.offset_channels)
    # Behind a circuit that resonates a fit of whole records would take most of the time of an identification.
    if problem.has_events and is_far_from_quasi_static(problem, _beginning(still, _lengths(problem)[0]), found):
        return False
    return quasi_static_fits_as_well(problem, still, found)


def _identify_quasi_static(campaign: Campaign, progress: Progress, offsets: Sequence[str]) -> Identification:
    """Identification of the quasi-static specimen."""
    progress("inertia and damping do not show: the specimen is taken to be quasi-static")
    return identify(replace(campaign, transducer=as_quasi_static(campaign.transducer)), progress, offsets)


def _first_fit(problem: Problem, model: Model, progress: Progress, poor: Callable[[Fit], None]) -> Fit:
    """Fit of all parameters; where it is far off, also one that begins with the circuits as their labels say."""
    found = growing_fit(problem, model, progress, poor)
    own = tuple(parameter for parameter in model.parameters if not is_of_circuit(parameter))
    if len(own) == len(model.parameters) or mean_square(found) < MAX_MEAN_SQUARE:
        return found
    progress("another start: circuits as their labels say")
    held = growing_fit(problem, replace(model, parameters=own), progress, poor)
    free = replace(held.model, parameters=model.parameters)
    other = fit(problem, free, held.nuisance, held.noise, progress=progress, rounds=2)
    squares = linearised(problem, other.model, other.nuisance, found)[2]
    return other if squares < sum(float(sums.squares.sum()) for sums in found.sums) else found


def growing_fit(
    problem: Problem,
    model: Model,
    progress: Progress = lambda text: None,
    poor: Callable[[Fit], None] = lambda found: None,
) -> Fit:
    """Fit of all parameters, first to the beginnings of some records: of long and many ones, to save time.

    Of records behind circuits with events to a few periods, then to more and more: over a whole record a resonance that
    is a per cent off loses the phase, and the cost has many minima.
    """
    lengths = [INITIAL_SAMPLES]
    if problem.has_events:
        longest = max(len(each) for each in problem.data if isinstance(each, Data))
        lengths = [n for n in _lengths(problem) if n < longest] + lengths
    some = _some(problem)
    part = _beginning(some, lengths[0])
    found = fit_past_jumps(part, model, progress, poor)
    for length in [*lengths[1:], max(len(each) for each in some.data)]:
        before, part = part, _beginning(some, length)
        if part is not before:
            nuisance = nuisance_for_problem(before, found.nuisance, part, found.model)
            try:
                found = fit(part, found.model, nuisance, found.noise, progress=progress, rounds=2)
            except PredictionError:  # what fits the beginning best cannot follow the rest
                found = fit_past_jumps(part, model, progress, poor)
    if some is problem:
        return found
    known = dict(zip(map(id, some.data), found.nuisance, strict=True))
    nuisance = [known.get(id(each), mine) for each, mine in zip(problem.data, problem.start(found.model), strict=True)]
    return fit(problem, found.model, nuisance, found.noise, progress=progress, rounds=2)


def _some(problem: Problem) -> Problem:
    """The problem with some records of each drive, circuit and set of channels, from small to large drives.

    The problem itself if it has not many more.
    """
    kinds: dict[tuple, list[Data]] = {}
    for each in problem.data:
        if isinstance(each, Data):
            kinds.setdefault((each.drive, each.setting.shunt, each.channels), []).append(each)
    kept, most = set[int](), min(SOME_RECORDS, max(2, OF_ALL_KINDS // max(len(kinds), 1)))
    for alike in kinds.values():
        alike.sort(key=lambda each: float(np.ptp(each.record[each.drive])))
        places = np.linspace(0, len(alike) - 1, min(most, len(alike))).round().astype(int)
        kept |= {id(alike[k]) for k in places}
    some = [each for each in problem.data if not isinstance(each, Data) or id(each) in kept]
    if len(some) * MANY_TIMES > len(problem.data):
        return problem
    return Problem(some, problem.nominal, problem.offset_channels)


def _lengths(problem: Problem) -> list[int]:
    """Numbers of samples of the first fits behind circuits: a few periods of the nominal resonance, then more."""
    device = problem.nominal
    period = 2.0 * np.pi * np.sqrt(device.mass / device.stiffness)
    step = min(each.setting.sample_time for each in problem.data if isinstance(each, Data))
    first = max(int(FIRST_PERIODS * period / step), MIN_FIRST_SAMPLES)
    return [first * GROWTH**k for k in range(MAX_STAGES) if first * GROWTH**k < INITIAL_SAMPLES]


def _beginning(problem: Problem, count: int) -> Problem:
    """The problem with the first samples of its records; the problem itself if none is longer."""

    def begun(each: Data | FrequencyData) -> Data | FrequencyData:
        if not isinstance(each, Data) or len(each) <= count or each.record.periodic:
            return each
        return data_of(each.record.beginning(count), problem.nominal)

    data = [begun(each) for each in problem.data]
    if all(one is other for one, other in zip(data, problem.data, strict=True)):
        return problem
    return Problem(data, problem.nominal, problem.offset_channels)


def _fit_near(problem: Problem, model: Model, near: Identification, progress: Progress) -> Fit:
    """Fit of all parameters, started from the fit of fewer records, whose noise is kept."""
    noise, before = Noise({**problem.noise().sigma, **near.noise.sigma}), near.found
    known = {
        record.name: nuisance for record, nuisance in zip(near.campaign.of_role("fit"), before.nuisance, strict=True)
    }
    model = replace(model, transducer=before.model.transducer)
    nuisance = []
    for data in problem.data:
        alone = Problem([data], problem.nominal, problem.offset_channels)
        # Nuisance parameters first: the exact instant of a jump of the drive can be mistaken for other errors.
        mine = (
            (known[data.name],)
            if data.name in known
            else fit_nuisance(alone, before.model, None, noise, progress).nuisance
        )
        nuisance += nuisance_for_model(alone, before.model, mine, model)
    return fit(problem, model, nuisance, noise, estimate_noise=False, progress=progress)


def _with_final_weights(problem: Problem, first: Fit, progress: Progress) -> Fit:
    """The same fit with the final weights of the responses, so that later fits can be compared with it."""
    factors = noise_of_responses(problem, first)
    if all(abs(factor / first.noise.sigma[name] - 1.0) < WEIGHT_TOLERANCE for name, factor in factors.items()):
        return first
    return fit(
        problem, first.model, first.nuisance, Noise({**first.noise.sigma, **factors}), progress=progress, rounds=1
    )


class _Selection(NamedTuple):
    """The last fit, its parameters fixed at nominal values, and those whose nominal values the records contradict."""

    last: Fit
    fixed: list[int]
    contradicted: list[int]


def _select_parameters(
    problem: Problem, first: Fit, model: Model, nuisance: Sequence[np.ndarray], progress: Progress
) -> _Selection:
    """Fit of the parameters that the records determine; others stay nominal unless the records contradict that."""

    def refitted(fixed: Sequence[int]) -> Fit:
        kept = tuple(p for k, p in enumerate(model.parameters) if k not in fixed)
        device = _with_nominal(model.transducer, problem.nominal, [model.parameters[k] for k in fixed])
        start = (
            tune_to_responses(problem, replace(model, transducer=device, parameters=kept), progress) if fixed else model
        )
        return fit(problem, start, nuisance, first.noise, progress=progress, rounds=1)

    fixed, contradicted = undetermined(first), list[int]()
    last = refitted(fixed)
    for k in list(fixed):
        if not _contradicts(last, first):
            break
        freed = refitted([other for other in fixed if other != k])
        if _contradicts(last, freed):
            fixed, last = [other for other in fixed if other != k], freed
            contradicted.append(k)
    places = {parameter.path: k for k, parameter in enumerate(model.parameters)}
    while True:
        doubts = [places[last.model.parameters[n].path] for n in uncertain(last)]
        doubt = next((k for k in doubts if k not in contradicted), None)
        if doubt is None:
            return _Selection(last, fixed, contradicted)
        less = refitted([*fixed, doubt])
        if _contradicts(less, last):
            contradicted.append(doubt)
        else:
            fixed, last = [*fixed, doubt], less


def _contradicts(fewer: Fit, more: Fit) -> bool:
    """True if records contradict the values that the fit with fewer parameters keeps fixed."""
    return fewer.cost - more.cost > max(MIN_CONTRADICTION, ROUGH_TOLERANCE * more.cost)


def _with_nominal(transducer: Transducer, nominal: Transducer, parameters: Sequence[Parameter]) -> Transducer:
    from piezoharvest.predict.parameters import put

    for parameter in parameters:
        transducer = put(transducer, parameter.path, value_at(nominal, parameter.path))
    return transducer


def _estimates(campaign: Campaign, first: Fit, verdict: _Selection, unsigned: frozenset[str]):
    """Estimates in the order of the parameters."""
    last, fixed = verdict.last, verdict.fixed
    std = standard_errors(last)
    places = {p.path: k for k, p in enumerate(last.model.parameters)}
    varied = {p.path: k for k, p in enumerate(first.model.parameters)}
    for parameter in parameters_of(replace(campaign.transducer, quasi_static=False), set()):
        if parameter.path in varied:
            parameter = first.model.parameters[varied[parameter.path]]  # with the scaling of the fit
        if parameter.name in campaign.unknown:
            continue
        before, k = float(value_at(campaign.transducer, parameter.path)), varied.get(parameter.path)
        if k is None or k in fixed:
            combined = "" if k is None else combination(first, k, [j for j in fixed if j != k])
            yield Estimate(
                parameter, before, before, None, False, combination=combined, experiment=experiment(parameter)
            )
            continue
        value = float(value_at(last.model.transducer, parameter.path))
        slope = parameter.slope(parameter.inner(value))
        std_here = slope * float(std[places[parameter.path]])
        if k in verdict.contradicted:
            less = "smaller" if abs(value) < abs(before) else "larger"
            note = f"the records contradict the nominal value: it is {less}, but they do not tell by how much"
            yield Estimate(
                parameter, value, before, std_here, False, experiment=experiment(parameter), note=note,
                contradicted=True,
            )  # fmt: skip
            continue
        note = "sign as nominal: the records tell its square" if parameter.name in unsigned else ""
        yield Estimate(parameter, value, before, std_here, True, assumed(first, k, fixed), note=note)


def _validation_qualities(
    campaign: Campaign, last: Fit, offsets: tuple[str, ...], progress: Progress
) -> list[RecordQuality]:
    """Quality of the validation records, of which only the nuisance parameters are fitted."""
    data = prepared(campaign, "validate")
    if not data:
        return []
    problem = Problem(data, campaign.transducer, offsets)
    sigma = {**problem.noise().sigma, **last.noise.sigma}
    return judged(data, fit_nuisance(problem, last.model, None, Noise(sigma), progress))


def judged(data: Sequence[Data | FrequencyData], found: Fit) -> list[RecordQuality]:
    """Residuals of each record."""
    each_record = []
    for each, nuisance, white in zip(data, found.nuisance, found.white, strict=True):
        if isinstance(each, FrequencyData):
            value, _ = each.response(replace(found.model, parameters=()))
            rms = float(np.sqrt(np.mean(np.abs(each.record.response - value) ** 2)))
            noise = float(np.sqrt(np.mean(each.sigma_of_lines**2)))
            output = f"{each.record.output}/{each.record.input}"
            quality, judgement = Quality({output: rms}, {output: noise}), each.judged(value)
            missed = judgement.missed is not None
            each_record.append(RecordQuality(each.name, each.role, quality, {}, _warning(each, judgement), missed))
            continue
        squares, count = np.zeros(len(each.channels)), 0
        for _, begin, residual in unexplained_blocks(found.model, each, nuisance):
            assert isinstance(white, Whitener)
            squares += (white.weighted(begin, residual) ** 2).sum(axis=0)
            count += len(residual)
        rms = dict(zip(each.channels, np.sqrt(squares / count).tolist(), strict=True))
        names = Problem([each], found.model.transducer, found.model.offset_channels).nuisance_names(found.model, each)
        nuisance_values = dict(zip(names, nuisance.tolist(), strict=True))
        each_record.append(
            RecordQuality(each.name, each.role, Quality(rms, _expected_rms(each, found)), nuisance_values)
        )
    return each_record


def _warning(data: FrequencyData, judged: ResponseQuality) -> str:
    """Warning about the fit of a response, or ""."""
    if data.reference is None:
        return f"{data.name}: {len(data)} lines are too few to show their noise: the residual was taken for it"
    if judged.missed is not None:
        return (
            f"{data.name}: near {judged.missed:.6g} Hz the fit is off by {judged.share:.0%} of the response, where the "
            "noise is far less: it misses a resonance, or the specimen has one that the model has not"
        )
    if judged.lacking:
        return (
            f"{data.name}: the residual is {judged.ratio:.3g} times the noise that the lines themselves show: the "
            "model lacks something; standard errors are wider by as much"
        )
    return ""


def _expected_rms(data: Data, found: Fit) -> dict[str, float]:
    """Standard deviation of residuals from noise alone, that of the drive included."""
    frequencies = np.fft.rfftfreq(min(len(data), 4096), data.setting.sample_time)
    gain = gain_of(replace(found.model, parameters=()).prediction(data), data.channels, frequencies)
    passed = (np.abs(gain) ** 2).mean(axis=0) * found.noise.sigma.get(data.drive, 0.0) ** 2
    own = [found.noise.sigma[channel] ** 2 for channel in data.channels]
    return dict(zip(data.channels, np.sqrt(passed + own).tolist(), strict=True))


def combined_quality(records: Sequence[RecordQuality]) -> Quality:
    """Root mean squares over records."""

    def mean(which: str) -> dict[str, float]:
        values: dict[str, list[float]] = {}
        for record in records:
            for channel, value in getattr(record.quality, which).items():
                values.setdefault(channel, []).append(value)
        return {channel: float(np.sqrt(np.mean(np.square(some)))) for channel, some in values.items()}

    return Quality(mean("rms"), mean("noise"))


__all__ = [
    "Estimate", "FrequencyRecord", "Identification", "Quality", "RecordQuality", "identification_of", "identify",
    "prepared", "with_parameters_held",
]  # fmt: skip
