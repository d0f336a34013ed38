"""Peak voltage of open electrodes in the steady state of a sine, which a tracker takes its own from."""

from __future__ import annotations

import numpy as np

from piezoharvest.bench.solver.model import Model, SolverError
from piezoharvest.bench.solver.rest import rest
from piezoharvest.description.excitation import Excitation
from piezoharvest.description.parameters import ParameterError

SMALL = 1e-6  # share of a state of the energy that the drive would store at rest: a small motion


def open_voltage(model: Model, excitation: Excitation) -> float:
    """Peak voltage (V) of a model whose circuit leaves its electrodes open, in small motions about its relaxed state.

    The rates of all states are evaluated for a small change of each and of the drive: they are lines, y' = J y + b F,
    and y = (i w - J)^-1 b F under F sin(w t).

    Raises
    ------
    ParameterError
        The excitation is not one sine.
    SolverError
        The voltage grows without end.
    """
    if excitation.size is None:
        found = f"found {model.circuit.__class__.__name__} under {excitation.kind}"
        raise ParameterError("kind", f"{found}, but a tracker of the open-circuit voltage needs one sine")
    amplitude, frequency = (float(np.squeeze(each)) for each in excitation.size)
    origin, n = rest(model, 0.0), len(model.scale)
    energy = amplitude * float(np.abs(model.gain / model.stiffness**0.5).max())
    steps = np.append(SMALL * energy / model.scale, SMALL * amplitude)
    columns, drives = np.tile(origin[:, None], n + 2), np.zeros(n + 2)
    columns[:, :n] += np.diag(steps[:n])
    drives[n] = steps[n]
    rates = np.empty_like(columns)
    voltages = model.moment(np.zeros(n + 2), drives, columns, rates).v + np.zeros(n + 2)
    slopes, seen = (rates[:, :-1] - rates[:, -1:]) / steps, (voltages[:-1] - voltages[-1]) / steps
    # In units of the root of energy, in which the numbers of any structure are alike.
    scale = model.scale
    J, b = scale[:, None] * slopes[:, :n] / scale, scale * slopes[:, n]
    try:
        moved = np.linalg.solve(2j * np.pi * frequency * np.eye(n) - J, b * amplitude) / scale
    except np.linalg.LinAlgError:
        raise SolverError("the open electrodes' voltage, which a tracker needs, grows without end") from None
    return float(abs(seen[:n] @ moved))
