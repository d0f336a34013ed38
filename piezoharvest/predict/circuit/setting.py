"""Setting of a record behind a circuit with diodes or switches."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeGuard

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.equations.terms import state_names
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.predict.circuit.measured_drive import straight_drive
from piezoharvest.predict.discrete_model import Setting
from piezoharvest.predict.drive import Drive, drive_of
from piezoharvest.predict.prediction import PredictionError

DRIVES = ("force", "base_acceleration")
MIN_SHARE = 1e-6  # of the largest possible value: least size of an initial state


def has_events(shunt: Shunt | None, drive: str) -> TypeGuard[Shunt]:
    """True if a record is one behind diodes or switches; with an imposed voltage they have no influence."""
    return drive != "voltage" and shunt is not None and not isinstance(shunt, LinearShunt)


def motion_of(drive: str, shunt: Shunt | None, values: np.ndarray) -> Drive:
    """Course of a drive between its samples, as it is predicted with."""
    return straight_drive(values) if has_events(shunt, drive) else drive_of(values)


def circuit_setting(
    drive: str, shunt: Shunt, sample_time: float, values: np.ndarray, transducer: Transducer, moved: float = 0.0
) -> Setting:
    """Setting from the samples of the drive; the states of structure, electrodes and dc side have free initial values.

    Parameters
    ----------
    drive : str
    shunt : Shunt
    sample_time : float
        s.
    values : (samples,) array
        Drive without its noise.
    transducer : Transducer
        Nominal. Its largest values in the record, from rest, are the units of the initial values.
    moved : float
        Half of the range of the measured displacement, m; 0 if there is none.

    Raises
    ------
    ParameterError
        The drive is no force or base acceleration, or the switch's timing is that of a drive with a frequency.
    """
    if drive not in DRIVES:
        raise ParameterError(
            "drive", f"found {drive!r} for a record behind {shunt.kind}, allowed are {' and '.join(DRIVES)}"
        )
    try:
        shunt.switch(transducer.capacitance, None)
    except ParameterError as error:
        raise error.within("shunt") from None
    names = state_names(transducer)
    dc = [state.name for state in shunt.states(transducer.capacitance) if state.name == "dc"]
    setting = Setting(drive, shunt, sample_time, float(values[0]), straight_drive(values), len(values))
    x, u, q, v = _largest(replace(transducer, effects=()), setting)
    x = max(x, moved, MIN_SHARE * np.max(np.abs(values)) / transducer.stiffness, 1e-300)
    u = max(u, x * MIN_SHARE / sample_time)
    q = max(q, MIN_SHARE * x * abs(transducer.coupling), 1e-300)
    v = max(v, MIN_SHARE * q / transducer.capacitance)
    by = {"x": x, "u": u, "q": q, "d": v}
    free = (*names, *dc)
    return replace(setting, free=free, sizes=tuple(float(by[name[0]]) for name in free))


def _largest(transducer: Transducer, setting: Setting) -> list[float]:
    """Largest displacement, velocity, charge and electrode voltage of the nominal model from rest."""
    outputs = ("displacement", "velocity", "charge", "voltage")
    found = [0.0] * len(outputs)
    try:
        for block in CircuitPrediction(transducer, setting).blocks(derivatives=False, channels=outputs):
            found = np.maximum(found, np.abs(block.values).max(axis=0)).tolist()
    except PredictionError:
        pass  # sizes are then those of the measured channels
    return found
