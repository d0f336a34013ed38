"""Fits of several specimens of one kind: each with the mean and spread of the kind as its prior."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.model import inner_values, with_values
from piezoharvest.identify.fitting.output_error import covariance, fit
from piezoharvest.identify.fitting.problem import LINEAR_PRIOR_DEVIATION, PRIOR_DEVIATION, Problem
from piezoharvest.population.hierarchy import Beliefs, Population, Said, estimated
from piezoharvest.population.naming import errors_of, variable_name
from piezoharvest.population.oddness import odd_ones
from piezoharvest.predict.parameters import Parameter, Path, is_of_circuit, parameters_of, value_at

# Usual relative spread of parts of one kind: makers give 10 to 20 % for capacitance, stiffness and coupling. Of an
# effect, which nobody controls, it is the effect itself.
USUAL_SPREAD, SPREAD_OF_EFFECTS = 0.2, 1.0
# Of an effect's mean, over its usual spread: as weak as the prior of a parameter about its nominal value.
DEVIATION_OF_EFFECTS = 10.0


@dataclass(frozen=True, eq=False)
class Member:
    """A specimen: its records and their fit, with the effects that all specimens share."""

    name: str
    problem: Problem
    found: Fit


@dataclass(frozen=True, eq=False)
class Pooled:
    """Specimens fitted together.

    Attributes
    ----------
    variables : mapping of str to Parameter
        What the specimens share, by name; the paths are those in one of them.
    population : Population
        Of these variables.
    alone : tuple of Fit
        Each specimen by itself, with all shared variables free and a weak prior.
    fits : tuple of Fit
        With the kind as the prior; `alone` for one of another kind.
    scatter : tuple of (p, p) array
        Covariance of the parameters of each fit, in variables.
    odd : mapping of int to tuple of str
        Specimens of another kind by their values, and what they differ in.
    apart : tuple of int
        All specimens of another kind, those included whose effects are others.
    """

    variables: Mapping[str, Parameter]
    population: Population
    alone: tuple[Fit, ...]
    fits: tuple[Fit, ...]
    scatter: tuple[np.ndarray, ...]
    odd: Mapping[int, tuple[str, ...]]
    apart: tuple[int, ...]


def pooled(members: Sequence[Member], apart: Sequence[int], progress: Callable[[str], None]) -> Pooled:
    """Fit specimens of one kind together.

    Parameters
    ----------
    members : sequence of Member
    apart : sequence of int
        Members that are known to be of another kind.
    progress : callable
        Called with messages on the progress.
    """
    kind = [n for n in range(len(members)) if n not in apart]
    variables = _shared([members[n] for n in kind])
    beliefs = _beliefs(variables, [members[n] for n in kind])
    alone = [_fitted(each, variables, beliefs.mean, beliefs.deviation) for each in members]
    marginals = [_marginal(each, variables, beliefs) for each in alone]
    values = np.array([value for value, _ in marginals])
    errors = np.sqrt([np.diag(scatter) for _, scatter in marginals])
    told = {kind[n]: some for n, some in odd_ones(values[kind], errors[kind], beliefs).items()}
    kind = [n for n in kind if n not in told]
    said = [Said.of_posterior(*marginal, beliefs) for marginal in marginals]
    population = estimated([said[n] for n in kind], beliefs)
    fits, scatter = list(alone), [_own(covariance(each), each) for each in alone]
    for n in kind:
        progress(f"{members[n].name}: fitted once more, with the mean and spread of its kind")
        started = replace(members[n], found=_at(alone[n], variables, population.shrunken(said[n])[0]))
        fits[n] = _fitted(started, variables, population.mean, population.spread)
        scatter[n] = _scatter(fits[n], variables, population)
    names = list(variables)
    odd = {n: tuple(names[k] for k in some) for n, some in told.items()}
    return Pooled(variables, population, tuple(alone), tuple(fits), tuple(scatter), odd, (*apart, *odd))


def names_of(found: Fit) -> list[str]:
    """Names of the fitted parameters, the same for all specimens; those of circuits are of the bench and not shared."""
    return [variable_name(parameter, found.model.transducer) for parameter in found.model.parameters]


def _shared(members: Sequence[Member]) -> dict[str, Parameter]:
    """Parameters that the records of any specimen determine, by name."""
    shared: dict[str, Parameter] = {}
    for each in members:
        pairs = zip(names_of(each.found), each.found.model.parameters, strict=True)
        shared |= {name: p for name, p in pairs if name not in shared and not is_of_circuit(p)}
    return shared


def _beliefs(variables: Mapping[str, Parameter], members: Sequence[Member]) -> Beliefs:
    """What is believed of the kind: nominal values, and for effects what those who show them best say."""
    rows = []
    for name, parameter in variables.items():
        if parameter.path[0] == "effects":
            mean = float(np.median([_value(each.found, name, parameter) for each in members]))
            spread = SPREAD_OF_EFFECTS * (1.0 if parameter.scaling == "log" else abs(mean) or 1.0)
            rows.append((mean, DEVIATION_OF_EFFECTS * spread, spread))
            continue
        values = [parameter.inner(value_at(each.problem.nominal, parameter.path)) for each in members]
        mean = float(np.mean(values))
        size = 1.0 if parameter.scaling == "log" else abs(mean) or 1.0
        rows.append((mean, size * (PRIOR_DEVIATION if parameter.scaling == "log" else LINEAR_PRIOR_DEVIATION),
                     USUAL_SPREAD * size))  # fmt: skip
    return Beliefs(*np.array(rows).reshape(-1, 3).T)


def _value(found: Fit, name: str, parameter: Parameter) -> float:
    """Variable of a parameter in a fit, in which it may have another place, or be none that is fitted."""
    path = _path(found.model.transducer, name, parameter)
    assert path is not None, name  # the effects of a kind are those of all its specimens
    return float(np.real(parameter.inner(value_at(found.model.transducer, path))))


def _path(transducer: Transducer, name: str, parameter: Parameter) -> Path | None:
    """Place of a shared parameter in a transducer, whose effects may stand in another order; None if it has none.

    A quasi-static specimen has no mass, and one of another kind other effects.
    """
    if parameter.path[0] != "effects":
        return parameter.path if parameter.path in {p.path for p in parameters_of(transducer, set())} else None
    places = (("effects", n, *parameter.path[2:]) for n in range(len(transducer.effects)))
    return next((p for p in places if variable_name(replace(parameter, path=p), transducer) == name), None)


def _fitted(member: Member, variables: Mapping[str, Parameter], mean: np.ndarray, deviation: np.ndarray) -> Fit:
    """Fit of a specimen with all shared variables free and normally distributed before."""
    found, problem = member.found, member.problem
    free, beliefs = [], {}
    for (name, parameter), middle, width in zip(variables.items(), mean, deviation, strict=True):
        path = _path(found.model.transducer, name, parameter)
        if path is not None:
            free.append(replace(parameter, path=path))
            beliefs[path] = float(middle), float(width)
    own = [p for p in found.model.parameters if p.path not in beliefs]
    model = replace(found.model, parameters=(*free, *own))
    believed = Problem(problem.data, problem.nominal, problem.offset_channels, beliefs)
    with errors_of(member.name):
        return fit(believed, model, found.nuisance, found.noise, white=found.white, estimate_noise=False)


def _own(scatter: np.ndarray, found: Fit) -> np.ndarray:
    """The part of a covariance that is of parameters, without that of the records' nuisance parameters."""
    count = len(found.model.parameters)
    return scatter[:count, :count]


def _columns(found: Fit, variables: Mapping[str, Parameter]) -> tuple[list[int], list[int]]:
    """Places of shared variables among the variables, and among the parameters of a fit that has them."""
    places = {name: k for k, name in enumerate(names_of(found))}
    pairs = [(n, places[name]) for n, name in enumerate(variables) if name in places]
    return [n for n, _ in pairs], [k for _, k in pairs]


def _marginal(found: Fit, variables: Mapping[str, Parameter], beliefs: Beliefs) -> tuple[np.ndarray, np.ndarray]:
    """Estimates and covariance of the shared variables; of those that a specimen lacks what was believed before."""
    here, there = _columns(found, variables)
    values, scatter = beliefs.mean.copy(), np.diag(beliefs.deviation**2)
    values[here] = inner_values(found.model)[there]
    scatter[np.ix_(here, here)] = covariance(found)[np.ix_(there, there)]
    return values, scatter


def _at(found: Fit, variables: Mapping[str, Parameter], values: np.ndarray) -> Fit:
    """The fit with other values of the shared variables, as a start."""
    here, there = _columns(found, variables)
    inner = inner_values(found.model)
    limits = [(p.lower, p.upper) for p in found.model.parameters]
    inner[there] = values[here]
    inner = np.clip(inner, [low for low, _ in limits], [high for _, high in limits])
    return replace(found, model=with_values(found.model, inner))


def _scatter(found: Fit, variables: Mapping[str, Parameter], population: Population) -> np.ndarray:
    """Covariance of a fit whose prior is the kind, with the error of the kind's mean in it."""
    here, there = _columns(found, variables)
    scatter = covariance(found)
    follows = scatter[:, there] * population.spread[here] ** -2.0
    return _own(scatter + follows @ population.covariance[np.ix_(here, here)] @ follows.T, found)


def kind_as_fit(found: Pooled, n: int) -> tuple[Fit, np.ndarray]:
    """The fit of a specimen moved to the mean of its kind, and the covariance of a specimen about it."""
    here, there = _columns(found.fits[n], found.variables)
    scatter = found.scatter[n].copy()
    scatter[there, :], scatter[:, there] = 0.0, 0.0
    about = np.diag(found.population.spread**2) + found.population.covariance
    scatter[np.ix_(there, there)] = about[np.ix_(here, here)]
    return _at(found.fits[n], found.variables, found.population.mean), scatter
