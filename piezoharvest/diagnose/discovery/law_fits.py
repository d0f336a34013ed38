"""Laws at places in the model of a fit: one linearisation of each, and full fits of the promising ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from piezoharvest.description.effects import Effect
from piezoharvest.description.effects.nameless.forms import Bends, Corners, Form, Line
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Memory, Play, Relaxation, Resonance
from piezoharvest.description.effects.nameless.places import LoadCurrent, Place
from piezoharvest.description.effects.nameless.shapes import Bump, Shape, StepChange
from piezoharvest.description.parameters import Component, ParameterError
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose.discovery.tables.knots import moved
from piezoharvest.diagnose.discovery.tables.smoothness import Smoothness, projected, smoothness
from piezoharvest.diagnose.selection.score_tests import extended
from piezoharvest.identify.fitting.evaluation import total_information
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.model import Model, inner_values
from piezoharvest.identify.fitting.output_error import fit, inverse, linearised
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model, numbered
from piezoharvest.predict.parameters import STEP, Parameter, Path, parameter_of, put, value_at
from piezoharvest.predict.prediction import PredictionError

FIT_TOLERANCE = 0.5  # of -2 ln L, as of other trial fits
ITERATIONS = 40  # of a full fit: one that takes more is far from its place
SMOOTHING_ROUNDS = 3  # of fit and smoothness
AT_END = 1e-3  # of a logarithm: closer to the end of its range a fit was stopped there
SAME_DEVIATION = 2.0  # ratio of deviations from which on a law is fitted anew: less hardly changes a curve
TABLES = (Corners, Bends)
# Parameters of the model that are straight lines at a place.
OWN = {"spring": "stiffness", "damper": "damping", "capacitor": "capacitance", "coupling": "coupling"}


@dataclass(frozen=True, eq=False)
class LawFit:
    """A full fit of a model with a law, its last effect unless said otherwise.

    Attributes
    ----------
    found : Fit
    visited : (n,) array
        Inputs of the law in the fitted records.
    index : int
        Of the law among the effects.
    """

    found: Fit
    visited: np.ndarray
    index: int = -1

    @property
    def law(self) -> Law:
        """The law with its fitted values."""
        law = self.found.model.transducer.effects[self.index]
        assert isinstance(law, Law)
        return law

    @property
    def place(self) -> Place:
        """Where it acts."""
        return self.law.place

    @property
    def form(self) -> Form:
        """What it is."""
        return self.law.form

    @cached_property
    def own(self) -> list[int]:
        """Columns of the law's parameters."""
        path = "effects", self.index % len(self.found.model.transducer.effects)
        return [k for k, p in enumerate(self.found.model.parameters) if p.path[:2] == path]

    @cached_property
    def tabled(self) -> list[int]:
        """Columns of a table's kinks, or of a formula's parameters with those of its memory."""
        if not isinstance(self.form, TABLES):
            return self.own
        return [k for k in self.own if self.found.model.parameters[k].path[2] == "form"]

    @property
    def memory_at_its_end(self) -> bool:
        """True if a time or frequency of its memory, or a damping at a port, has gone to the end of its range.

        What is faster or slower than all records is a straight line. A sensor's filter may well be critically damped.
        A delay, which is no logarithm, has no such end.
        """
        values, parameters = inner_values(self.found.model), self.found.model.parameters
        ends = [
            (values[k], (parameters[k].lower, parameters[k].upper))
            for k in self.own
            if parameters[k].path[2] == "memory"
            and parameters[k].scaling == "log"
            and (self.place.port or parameters[k].path[3] != "damping_ratio")
        ]
        return any(np.any(np.isclose(value, bounds, rtol=0.0, atol=AT_END)) for value, bounds in ends)

    @cached_property
    def normal(self) -> tuple[np.ndarray, np.ndarray]:
        """Information and right side of `tabled` parameters at the fit, the others projected out."""
        found = self.found
        information, gradient, _ = total_information(found.model, found.nuisance, found.sums)
        prior = found.prior.copy()
        prior[self.tabled, self.tabled] = 0.0
        inside, slope = projected(information, gradient, prior, self.tabled)
        return inside, inside @ inner_values(found.model)[self.tabled] + slope

    @property
    def evidence(self) -> float:
        """-2 ln of the marginal likelihood up to a constant (Laplace), for laws at several places.

        Of a formula, whose parameters have no prior, with that of one sample, as Schwarz's criterion has it; so of the
        memory before a table.
        """
        kinks, found = self.tabled, self.found
        if not isinstance(self.form, TABLES):
            return self.criterion
        inside, _ = self.normal
        precision = np.diag(found.prior)[kinks]
        ratio = np.linalg.slogdet(np.eye(len(kinks)) + inside / np.sqrt(np.outer(precision, precision)))[1]
        return found.cost + float(ratio) + self._others * np.log(self.samples)

    @property
    def _others(self) -> int:
        """Number of the law's parameters that are none of its table."""
        return len(self.own) - len(self.tabled)

    @property
    def freedom(self) -> float:
        """Effective number of the law's parameters."""
        inside, _ = self.normal
        found = float(np.trace(inverse(inside + np.diag(np.diag(self.found.prior)[self.tabled])) @ inside))
        # Of what the data do not determine, rounding has any sign.
        return float(np.clip(found, 0.0, len(self.tabled))) + self._others

    @property
    def criterion(self) -> float:
        """Bayes's information criterion, for forms at one place (Schwarz, Ann. Stat. 6(2), 461-464, 1978)."""
        return self.found.cost + self.freedom * np.log(self.samples)

    @property
    def samples(self) -> float:
        """Number of samples of all channels in the fitted records."""
        return sum(float(sums.count.sum()) for sums in self.found.sums)


def law_parameters(law: Law, n: int, deviation: float = np.inf) -> list[Parameter]:
    """Parameters of a law that is the n-th effect: those of its form, kinks of a table or a formula's, and memory.

    The factor of a straight line with a memory at a port has the sign of one that takes energy.
    """
    found = _of_form(law, ("effects", n, "form"), deviation)
    if law.memory is None:
        return found
    return [*found, *(_near(p, law.memory) for p in _quantities(law.memory, ("effects", n, "memory")))]


def _of_form(law: Law, path: Path, deviation: float) -> list[Parameter]:
    form, memory = law.form, law.memory
    if isinstance(form, TABLES):
        unit = f"{law.place.unit}/({law.place.input_unit or '1'})"
        return [
            Parameter((*path, "kinks", j), unit, "linear", -np.inf, np.inf, deviation=deviation)
            for j in range(len(form.kinks))
        ]
    found = [] if memory is not None and memory.alone else _quantities(form, path)
    if isinstance(form, Shape):  # a scale has no null value, and its size may be off by decades
        turned = {"scaling": "log", "sign": float(np.sign(form.scale))}
        found = [replace(p, **turned) if p.path[-1] == "scale" else p for p in found]
    if isinstance(form, StepChange) and form.finest:  # within a sample no moment is better than another
        found = [replace(p, lower=np.log(form.finest)) if p.path[-1] == "width" else p for p in found]
    if isinstance(law.place, LoadCurrent):  # 2: a lag is the Pade approximation of a delay
        found = [replace(p, upper=2.0) if p.path[-1] == "factor" else p for p in found]
    sign = law.passive_sign
    if sign and isinstance(form, Line):
        bounds = {"lower": 0.0} if sign > 0 else {"upper": 0.0}
        found = [replace(p, **bounds) if p.path[-1] == "factor" else p for p in found]
    return found


def _near(parameter: Parameter, memory: Memory) -> Parameter:
    """Parameter of a memory within a decade of its start: starts are closer, and far from them fits run away.

    More than critically damped, what resonates is none.
    """
    if parameter.scaling != "log":
        return parameter
    start = parameter.inner(getattr(memory, str(parameter.path[-1])))
    upper = 0.0 if parameter.path[-1] == "damping_ratio" else start + np.log(10.0)
    return replace(parameter, lower=start - np.log(10.0), upper=upper)


def _while_recorded(parameter: Parameter, law: Law, visited: np.ndarray) -> Parameter:
    """Parameter of a law; the moment of a step is one at which something was recorded: outside it is a constant.

    Nor is anything told of a bump whose height is outside.
    """
    if not isinstance(law.form, StepChange | Bump) or parameter.path[-1] != "at":
        return parameter
    return replace(parameter, lower=float(visited.min()), upper=float(visited.max()))


def _quantities(component: Component, path: Path) -> list[Parameter]:
    """Parameters for the quantities of a form or a memory."""
    fields = [field for field in dataclasses.fields(component) if "unit" in field.metadata]
    return [parameter_of(component, field, (*path, field.name)) for field in fields]


@dataclass(frozen=True, eq=False)
class ScoredLaw:
    """A law without kinks at a place, and what one linearisation expects of it.

    Attributes
    ----------
    law : Law
    visited : (n,) array
    smoothness : Smoothness
    """

    law: Law
    visited: np.ndarray
    smoothness: Smoothness

    @property
    def gain(self) -> float:
        """Expected decrease of -2 ln of the marginal likelihood."""
        return self.smoothness.gain


def score(problem: Problem, base: Fit, law: Law, visited: np.ndarray) -> ScoredLaw | None:
    """Score of a law without kinks; None where the model then has no solution, or no record shows it.

    Of a memory before it the values are those that are given.
    """
    first = len(base.model.transducer.effects)
    parameters = law_parameters(law, first)
    model = replace(extended(base.model, [law], parameters), felt=first)
    nuisance = nuisance_for_model(problem, base.model, base.nuisance, model)
    try:
        information, gradient, _ = linearised(problem, model, nuisance, base)
    except (PredictionError, ParameterError, np.linalg.LinAlgError):
        return None
    kinks = [k for k, p in enumerate(model.parameters) if p.path[:3] == ("effects", first, "form")]
    kept, prior = known_before(problem, base, model, information)
    some, own = [*kept, *kinks], list(range(len(kept), len(kept) + len(kinks)))
    inside, slope = projected(information[np.ix_(some, some)], gradient[some], prior[np.ix_(some, some)], own)
    plain = np.diag(information)[kinks]
    if not np.any(np.diag(inside) > 1e-8 * plain):
        return None  # in the span of the fitted parameters
    return ScoredLaw(law, visited, smoothness(inside, slope))


def known_before(problem: Problem, base: Fit, model: Model, information: np.ndarray) -> tuple[list[int], np.ndarray]:
    """Columns of what was fitted before the laws, which keep their priors, and these in the size of the whole."""
    at, before = len(base.model.parameters), len(model.parameters)
    kept, prior, own = list(range(at)), np.zeros_like(information), at
    prior[:at, :at] = base.prior[:at, :at]
    place = before
    for data in problem.data:
        old, new = problem.nuisance_names(base.model, data), problem.nuisance_names(model, data)
        # New ones, such as what a stop began with, are not felt without a factor.
        shared = {name: k for k, name in enumerate(_counted(new))}
        for k, name in enumerate(_counted(old)):
            column = place + shared[name]
            kept.append(column)
            prior[column, column] = base.prior[own + k, own + k]
        own, place = own + len(old), place + len(new)
    return kept, prior


def _counted(names: Sequence[str]) -> list[tuple[str, int]]:
    """Names with their number among the same ones."""
    return [(name, names[:k].count(name)) for k, name in enumerate(names)]


def fitted(
    problem: Problem, base: Fit, law: Law, visited: np.ndarray, deviation: float = np.inf, aim: float = np.inf,
    most: int = ITERATIONS,
) -> LawFit | None:  # fmt: skip
    """Fit of a model with a law; a table's smoothness alternates with it. None where it has no solution.

    With fewer iterations than a full fit takes, the smoothness stays.
    """
    first = len(base.model.transducer.effects)
    parameters = [_while_recorded(p, law, visited) for p in law_parameters(law, first, deviation)]
    model = extended(base.model, [law], parameters)
    try:
        nuisance = nuisance_for_model(problem, base.model, base.nuisance, model)
    except (PredictionError, ParameterError, np.linalg.LinAlgError):
        return None
    return _fitted_from(problem, base, model, nuisance, visited, deviation, aim, most)


def continued(
    problem: Problem, base: Fit, law: LawFit, aim: float = np.inf, most: int = ITERATIONS
) -> LawFit | None:  # fmt: skip
    """As `fitted`, from where fewer iterations have come."""
    model = law.found.model
    deviation = model.parameters[law.tabled[0]].deviation if isinstance(law.form, TABLES) else np.inf
    return _fitted_from(problem, base, model, law.found.nuisance, law.visited, deviation, aim, most)


def with_moved_knots(problem: Problem, table: LawFit) -> LawFit | None:
    """Fit of a table whose corners are moved to where it bends; None where that has no solution."""
    assert isinstance(table.form, TABLES)
    found, first = table.found, len(table.found.model.transducer.effects) - 1
    law = replace(table.law, form=moved(table.form, table.visited))
    deviation = smoothness(*table.normal).deviation
    parameters = tuple(p for k, p in enumerate(found.model.parameters) if k not in table.own)
    transducer = replace(found.model.transducer, effects=(*found.model.transducer.effects[:-1], law))
    model = replace(
        found.model, transducer=transducer, parameters=(*parameters, *law_parameters(law, first, deviation))
    )
    return _fitted_from(problem, found, model, found.nuisance, table.visited, deviation)


def _fitted_from(
    problem: Problem, base: Fit, model: Model, nuisance: Sequence[np.ndarray], visited: np.ndarray, deviation: float,
    aim: float = np.inf, most: int = ITERATIONS,
) -> LawFit | None:  # fmt: skip
    """Fit of a model whose last effect is a law, with the noise and the whitening of another one."""
    done = None
    for _ in range(SMOOTHING_ROUNDS):
        try:
            found = fit(
                problem, model, nuisance, base.noise, white=base.white, estimate_noise=False, enough=FIT_TOLERANCE,
                most=most, aim=aim,
            )  # fmt: skip
        except (PredictionError, ParameterError, np.linalg.LinAlgError):
            return done
        if not np.all(np.isfinite(found.information)):  # at values where the model overflows
            return done
        done = LawFit(found, visited)
        if not isinstance(done.form, TABLES) or most < ITERATIONS:
            return done
        better = smoothness(*done.normal).deviation
        if 1.0 / SAME_DEVIATION < better / deviation < SAME_DEVIATION:
            return done
        deviation = better
        kept = tuple(replace(p, deviation=deviation) if k in done.tabled else p for k, p in enumerate(model.parameters))
        model, nuisance = replace(found.model, parameters=kept), found.nuisance
    return done


def ended(problem: Problem, start: Fit, law: LawFit) -> LawFit:
    """A fit that was not at its end, continued, with the noise and the whitening of that without a law."""
    found = law.found
    if found.converged:
        return law
    try:
        again = fit(
            problem, found.model, found.nuisance, start.noise, white=start.white, estimate_noise=False,
            enough=FIT_TOLERANCE,
        )  # fmt: skip
    except (PredictionError, ParameterError, np.linalg.LinAlgError):
        return law
    return replace(law, found=again)


def without_law(problem: Problem, some: LawFit) -> Fit:
    """The fit without its law: a start for another one, whose parameters are those with the law."""
    found, model = some.found, some.found.model
    kept = tuple(p for k, p in enumerate(model.parameters) if k not in some.own)
    effects = model.transducer.effects[:-1]
    bare = replace(model, transducer=replace(model.transducer, effects=effects), parameters=kept, felt=None)
    names = [(numbered(problem.nuisance_names(each, data)) for data in problem.data) for each in (model, bare)]
    stays = [name in after for before, after in zip(*names, strict=True) for name in before]  # no state of its memory
    places = [k for k in range(len(model.parameters)) if k not in some.own]
    places += [len(model.parameters) + k for k, same in enumerate(stays) if same]
    return replace(
        found, model=bare, nuisance=nuisance_for_model(problem, model, found.nuisance, bare),
        information=found.information[np.ix_(places, places)], prior=found.prior[np.ix_(places, places)],
    )  # fmt: skip


def without_effect(problem: Problem, found: Fit, n: int) -> Fit | None:
    """Fit of the same model without its n-th effect; None where it has no solution or comes to no end."""
    model = found.model
    effects = model.transducer.effects
    kept = [p for p in model.parameters if p.path[:2] != ("effects", n)]
    moved = tuple(
        replace(p, path=("effects", int(p.path[1]) - 1, *p.path[2:]))
        if p.path[0] == "effects" and int(p.path[1]) > n
        else p
        for p in kept
    )
    less = replace(
        model, transducer=replace(model.transducer, effects=(*effects[:n], *effects[n + 1 :])), parameters=moved
    )
    less = replace(less, transducer=_with_static_part(less, effects[n]))
    nuisance = nuisance_for_model(problem, model, found.nuisance, less)
    try:
        again = fit(problem, less, nuisance, found.noise, estimate_noise=False, enough=FIT_TOLERANCE)
    except (PredictionError, ParameterError, np.linalg.LinAlgError):
        return None
    return again if again.converged else None


def _with_static_part(model: Model, effect: Effect) -> Transducer:
    """The transducer, to whose own parameter what a lost memory did at low frequencies is added.

    Of one that is faster than all records only that was left, so that a fit from there begins near its end. Of other
    functions of what a memory makes of its input no number says what that was.
    """
    device = model.transducer
    if not (isinstance(effect, Law) and isinstance(effect.memory, Relaxation | Resonance) and effect.place.name in OWN):
        return device
    if not isinstance(effect.form, Line):
        return device
    name = OWN[effect.place.name]
    value = getattr(device, name) + (0.0 if effect.memory.behind else effect.form.factor)
    fitted = (name,) in {p.path for p in model.parameters}
    return put(device, (name,), value) if fitted and value > 0.0 else device


def inputs_and_values(some: LawFit, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs over the visited range, evenly, and the law there; with play, of by how much the input is ahead of it."""
    low, high, memory = some.visited.min(), some.visited.max(), some.law.memory
    if isinstance(memory, Play) and not memory.follows:  # which the visited ones are of its start
        low, high = -memory.threshold, memory.threshold
    if some.place.input == "campaign_time":  # between the records nothing is known
        x = np.quantile(some.visited, np.linspace(0.0, 1.0, count))
    else:
        x = np.linspace(low, high, count)
    return x, np.real(some.form.values(x))


def derivative(some: LawFit, x: np.ndarray) -> np.ndarray:
    """Derivatives (n, parameters) of the law's values with respect to its parameters' variables, by a complex step."""
    columns: list[np.ndarray] = []
    transducer = some.found.model.transducer
    for k in some.own:
        parameter = some.found.model.parameters[k]
        if parameter.path[2] == "memory":  # it moves no value of the function that follows it
            columns.append(np.zeros(len(x)))
            continue
        inner = parameter.inner(value_at(transducer, parameter.path))
        form = put(some.form, parameter.path[3:], parameter.outer(inner + 1j * STEP))
        columns.append(np.imag(form.values(x)) / STEP)
    return np.column_stack(columns)


def best_of(fits: Sequence[LawFit]) -> list[LawFit]:
    """Fits of tables by increasing evidence loss."""
    return sorted(fits, key=lambda each: each.evidence)
