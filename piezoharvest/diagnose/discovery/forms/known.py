"""Names of laws: known effects are special cases at their places, and a law that is one of them gets its name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from piezoharvest.description.effects import Effect
from piezoharvest.description.effects.electrical.coupling_drift import CouplingDrift
from piezoharvest.description.effects.electrical.dielectric_relaxation import DielectricRelaxation
from piezoharvest.description.effects.electrical.leakage import Leakage
from piezoharvest.description.effects.electrical.nonlinear_coupling import NonlinearCoupling
from piezoharvest.description.effects.electrical.voltage_dependent_capacitance import VoltageDependentCapacitance
from piezoharvest.description.effects.mechanical.creep import Creep
from piezoharvest.description.effects.mechanical.friction import Friction
from piezoharvest.description.effects.mechanical.stiffening import Stiffening
from piezoharvest.description.effects.nameless.forms import Hertz, Knee, Line, Monomial
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Play, Relaxation
from piezoharvest.description.effects.nameless.places import Reading
from piezoharvest.description.effects.sensing.clipping import Clipping
from piezoharvest.description.effects.sensing.contact_compliance import ContactCompliance
from piezoharvest.description.effects.sensing.displacement_lag import DisplacementLag
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose.discovery.law_fits import FIT_TOLERANCE, TABLES, LawFit, without_law
from piezoharvest.diagnose.selection.score_tests import effect_parameters, extended
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model
from piezoharvest.predict.prediction import PredictionError


def known_effects(law: Law, device: Transducer, longest: float = 1.0) -> Iterator[Effect]:
    """Effects of the library that a law is a special case of, with the values that follow from its own.

    Parameters
    ----------
    law : Law
    device : Transducer
    longest : float
        Length of the longest record, s: `coupling_drift` is told by what it comes to over a record.
    """
    make = _MADE.get(law.place.name)
    if law.place.name == "parameter.coupling":
        make = partial(_drift, longest=longest)
    if make is None and isinstance(law.place, Reading):
        make = _of_reading
    try:
        yield from make(law, device) if make else ()
    except (ParameterError, ZeroDivisionError):  # the law has a sign that the effect has not
        return


def _spring(law: Law, device: Transducer) -> Iterator[Effect]:
    form, memory = law.form, law.memory
    if isinstance(form, Monomial) and form.exponent == 3:
        yield Stiffening(cubic_stiffness=form.factor / form.scale**3)
    if isinstance(form, Line) and isinstance(memory, Play):
        yield Friction(stiffness=form.factor, threshold=memory.threshold)
    if isinstance(form, Line) and isinstance(memory, Relaxation):
        stiff = device.stiffness - (form.factor if memory.behind else 0.0)  # of fast motion
        softer = -form.factor / stiff  # c/(1 + c) of the creep ratio c
        ratio = softer / (1.0 - softer)
        yield Creep(compliance_ratio=ratio, time_constant=memory.time_constant * (1.0 + ratio))


def _capacitor(law: Law, device: Transducer) -> Iterator[Effect]:
    form, memory = law.form, law.memory
    if isinstance(form, Monomial) and form.exponent == 3:
        yield VoltageDependentCapacitance(beta=form.factor / form.scale**3 / device.capacitance)
    if isinstance(form, Line) and isinstance(memory, Relaxation):
        yield DielectricRelaxation(capacitance=form.factor, time_constant=memory.time_constant)


def _coupling(law: Law, device: Transducer) -> Iterator[Effect]:
    if isinstance(law.form, Monomial) and law.form.exponent == 2:
        yield NonlinearCoupling(quadratic_coupling=law.form.factor / law.form.scale**2)


def _electrodes(law: Law, device: Transducer) -> Iterator[Effect]:
    if isinstance(law.form, Line) and law.memory is None:
        yield Leakage(resistance=1.0 / law.form.factor)


def _drift(law: Law, device: Transducer, *, longest: float) -> Iterator[Effect]:
    if isinstance(law.form, Line) and law.place.input == "time" and not law.form.start:
        yield CouplingDrift(relative_drift=law.form.factor * longest)


def _of_reading(law: Law, device: Transducer) -> Iterator[Effect]:
    form, memory, place = law.form, law.memory, law.place
    assert isinstance(place, Reading)
    if place.of == place.channel and isinstance(form, Knee) and form.sides == 2 and form.factor < 0.0:
        yield Clipping(limit=form.knee, channel=place.channel)  # pyright: ignore[reportArgumentType]
    if place.channel != "displacement":
        return
    if isinstance(form, Hertz) and form.side == 1 and form.exponent < 1.0 and place.of == "force":
        yield ContactCompliance(coefficient=form.factor / form.scale**form.exponent)
    if isinstance(memory, Relaxation) and memory.behind:
        yield DisplacementLag(time_constant=memory.time_constant)


_MADE: dict[str, Callable[[Law, Transducer], Iterator[Effect]]] = {
    "spring": _spring, "capacitor": _capacitor, "coupling": _coupling, "electrodes": _electrodes,
}  # fmt: skip


def named(problem: Problem, best: LawFit) -> Fit | None:
    """Fit with a known effect instead of a law, if one fits as well by Schwarz's criterion; else None."""
    if isinstance(best.form, TABLES):
        return None
    bare = without_law(problem, best)
    for effect in known_effects(best.law, best.found.model.transducer, float(best.visited.max())):
        first = len(bare.model.transducer.effects)
        own = effect_parameters([effect], first)
        model = extended(bare.model, [effect], own)
        nuisance = nuisance_for_model(problem, best.found.model, best.found.nuisance, model)
        try:
            found = fit(problem, model, nuisance, best.found.noise, estimate_noise=False, enough=FIT_TOLERANCE)
        except (PredictionError, ParameterError, np.linalg.LinAlgError):
            continue
        fewer = (best.freedom - len(own)) * np.log(best.samples)
        if found.converged and found.cost < best.found.cost + fewer + FIT_TOLERANCE:
            return found
    return None
