"""Identification of a campaign's parameters with standard errors, and validation on records that were not fitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from piezoharvest.description.parameters import check_kind
from piezoharvest.description.transducer import INERT
from piezoharvest.identify.fitting.coupling_signs import with_known_signs
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit, linearised, mean_square, noise_of_responses, standard_errors
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model
from piezoharvest.identify.growing_fit import beginning, first_lengths, growing_fit
from piezoharvest.identify.identifiability import assumed, combination, experiment, undetermined
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.identify.parameter_selection import Selection, select_parameters
from piezoharvest.identify.preparation import prepared
from piezoharvest.identify.residual_quality import combined_quality, judged
from piezoharvest.identify.result import Estimate, Identification, RecordQuality
from piezoharvest.identify.start_values.initial_hysteresis_state import (
    fit_nuisance,
    has_initial_states,
    may_have_initial_states,
    search_initial_states,
)
from piezoharvest.identify.start_values.multistart import (
    MAX_MEAN_SQUARE,
)
from piezoharvest.identify.start_values.quasi_static import (
    as_quasi_static,
    comes_to_rest,
    is_far_from_quasi_static,
    may_be_quasi_static,
    nominal_fit,
    quasi_static_fit,
    resonance_above_nyquist,
)
from piezoharvest.predict.parameters import is_of_circuit, parameters_of, value_at
from piezoharvest.progress import Numbered, log
from piezoharvest.records.campaign import Campaign
from piezoharvest.records.errors import CampaignError
from piezoharvest.records.record import Record
from piezoharvest.threads import single_threaded

Progress = Callable[[str], None]
WEIGHT_TOLERANCE = 1e-3  # relative difference below which weights count as equal


@single_threaded
def identify(
    campaign: Campaign,
    progress: Progress = log,
    offsets: Sequence[str] | None = None,
    near: Identification | None = None,
    poor: Callable[[Fit], None] = lambda found: None,
) -> Identification:
    """Identify the parameters of a campaign's transducer.

    Parameters
    ----------
    campaign : Campaign
    progress : callable
        Called with messages about progress; default: the logger `piezoharvest`, level INFO.
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
    progress = Numbered.of(progress)
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
    still = _quasi_static_fit(campaign, problem, first) if may_be_quasi_static(problem, first) else None
    if still is not None and not (comes_to_rest(problem) and _stiffness_is_known(still)):
        return _identify_quasi_static(campaign, progress, offsets)
    held = still and nominal_fit(problem, first, still)
    if held is not None:
        progress("inertia and damping do not show: mass and damping keep their nominal values")
        first = fit(problem, held.model, held.nuisance, held.noise, progress=progress)
    # With `near`, this was tested for that fit, whose model is less distorted by effects in the records.
    begun = search_initial_states(problem, first) if near is None else None
    if begun is not None:
        progress("some records begin after a load history that was not recorded")
        first = fit(problem, first.model, begun, first.noise, progress=progress, rounds=2)
    relaxed = may_have_initial_states(problem, first.model) and not has_initial_states(problem, first)
    model = replace(first.model, relaxed=True) if relaxed else first.model
    first = with_final_weights(problem, first, progress)
    nuisance = nuisance_for_model(problem, first.model, first.nuisance, model)
    verdict = select_parameters(problem, first, replace(model, transducer=first.model.transducer), nuisance, progress)
    last = verdict.last
    # Nominal values that no record confirms are as good as unknown.
    unconfirmed = {first.model.parameters[k].path for k in verdict.fixed}
    doubtful = {(name,) for name in INERT} <= unconfirmed and not comes_to_rest(problem)
    if doubtful and _quasi_static_fit(campaign, problem, last) is not None:
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


def _stiffness_is_known(found: Fit) -> bool:
    """True if a fit determines the stiffness, without which the lag b/k of a nominal damping says nothing."""
    unknown = {found.model.parameters[k].path[-1] for k in undetermined(found)}
    return not unknown & {"stiffness", "coupling"}


def _quasi_static_fit(campaign: Campaign, problem: Problem, found: Fit) -> Fit | None:
    """Fit of the quasi-static specimen if that explains the records as well as a fit does."""
    quasi_static = replace(campaign, transducer=as_quasi_static(campaign.transducer))
    still = Problem(prepared(quasi_static, "fit"), quasi_static.transducer, problem.offset_channels)
    # Behind a circuit that resonates a fit of whole records would take most of the time of an identification.
    if problem.has_events and is_far_from_quasi_static(problem, beginning(still, first_lengths(problem)[0]), found):
        return None
    return quasi_static_fit(problem, still, found)


def _identify_quasi_static(campaign: Campaign, progress: Progress, offsets: Sequence[str]) -> Identification:
    """Identification of the quasi-static specimen."""
    progress("inertia and damping do not show: the specimen is treated as quasi-static")
    return identify(replace(campaign, transducer=as_quasi_static(campaign.transducer)), progress, offsets)


def _first_fit(problem: Problem, model: Model, progress: Progress, poor: Callable[[Fit], None]) -> Fit:
    """Fit of all parameters; where it is far off, also one that begins with the circuits as their labels say."""
    found = growing_fit(problem, model, progress, poor)
    own = tuple(parameter for parameter in model.parameters if not is_of_circuit(parameter))
    if len(own) == len(model.parameters) or mean_square(found) < MAX_MEAN_SQUARE:
        return found
    progress("another start: circuits with their nominal values")
    held = growing_fit(problem, replace(model, parameters=own), progress, poor)
    free = replace(held.model, parameters=model.parameters)
    other = fit(problem, free, held.nuisance, held.noise, progress=progress, rounds=2)
    squares = linearised(problem, other.model, other.nuisance, found)[2]
    return other if squares < sum(float(sums.squares.sum()) for sums in found.sums) else found


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


def with_final_weights(problem: Problem, first: Fit, progress: Progress = lambda text: None) -> Fit:
    """The same fit with the final weights of the responses, so that later fits can be compared with it."""
    factors = noise_of_responses(problem, first)
    if all(abs(factor / first.noise.sigma[name] - 1.0) < WEIGHT_TOLERANCE for name, factor in factors.items()):
        return first
    return fit(
        problem, first.model, first.nuisance, Noise({**first.noise.sigma, **factors}), progress=progress, rounds=1
    )


def _estimates(campaign: Campaign, first: Fit, verdict: Selection, unsigned: frozenset[str]):
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
            note = f"the records contradict the nominal value: it is {less}, but they do not determine by how much"
            yield Estimate(
                parameter, value, before, std_here, False, experiment=experiment(parameter), note=note,
                contradicted=True,
            )  # fmt: skip
            continue
        note = "sign as nominal: the records determine only its square" if parameter.name in unsigned else ""
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
