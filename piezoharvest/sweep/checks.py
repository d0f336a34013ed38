"""Checks of a sweep before anything is simulated."""

from __future__ import annotations

import dataclasses

import numpy as np

from piezoharvest.description.parameters import ParameterError, check_quantity
from piezoharvest.equations.terms import Terms
from piezoharvest.study import Study, StudyError, check_systems, unknown
from piezoharvest.sweep.place import parameters, place
from piezoharvest.sweep.plan import Plan
from piezoharvest.sweep.table import known_outputs, paths

_DESIGNS_TRIED = 64  # designs


def check(study: Study, plan: Plan) -> None:
    """Check that a study can be swept.

    Raises
    ------
    StudyError
        A path or an output that does not exist, a value out of the bounds of its parameter, or no design that is
        physical.
    """
    try:
        _check_names(study)
        _check_designs(study, plan)
    except ParameterError as error:
        raise StudyError(study.path, error.key, error.message) from None


def _check_names(study: Study) -> None:
    """Raise `ParameterError` for a path, an end of a range or an output that does not exist in the study."""
    assert study.sweep is not None
    known = parameters(study)
    for n, parameter in enumerate(study.sweep.parameters):
        where = f"sweep.parameters.{n}"
        if parameter.path not in known:
            raise unknown(f"{where}.path", parameter.path, known)
        for key, value in (("from", parameter.from_), ("to", parameter.to)):
            try:
                check_quantity(known[parameter.path], value)
            except ParameterError as error:
                raise ParameterError(f"{where}.{key}", error.message) from None
    for n, name in enumerate(study.sweep.outputs or ()):
        if name not in known_outputs(study):
            raise unknown(f"sweep.outputs.{n}", name, known_outputs(study))


def _check_designs(study: Study, plan: Plan) -> None:
    """Raise `ParameterError` if all of some designs are invalid with a shunt.

    A design that is not physical has a null answer in the table; a sweep of such designs alone is an error.
    """
    tried = sorted({0, *np.random.default_rng(0).integers(plan.designs, size=_DESIGNS_TRIED).tolist()})
    for shunt in range(len(study.shunts)):
        refusals = (_refusal(study, plan, shunt, n) for n in tried)
        first = next(refusals)
        if first is not None and all(refusals):
            raise first


def _refusal(study: Study, plan: Plan, shunt: int, design: int) -> ParameterError | None:
    """Error that a design raises, or None."""
    values = plan.points(range(design, design + 1))[0].tolist()
    try:
        system, excitation = place(study, shunt, paths(study), values)
        shunts = (system.shunt,)
        check_systems(dataclasses.replace(study, transducer=system.transducer, excitation=excitation, shunts=shunts))
        switch = system.shunt.switch(system.electrode.capacitance, excitation.period)
        Terms(system.transducer).check(system.shunt, switch)
    except ParameterError as error:
        found = ", ".join(f"{path} = {value:g}" for path, value in zip(paths(study), values, strict=True))
        return ParameterError(
            "sweep.parameters", f"none of the designs tried is possible, for instance {found} ({error})"
        )
    return None
