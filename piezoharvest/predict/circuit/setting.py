"""Setting of a record behind a circuit with diodes or switches, or another one that only the engine follows."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeGuard

import numpy as np

from piezoharvest.description.circuit import State
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt, Shunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.equations.terms import state_names
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.predict.circuit.measured_drive import imposed_motion, straight_drive
from piezoharvest.predict.discrete_model import Setting
from piezoharvest.predict.drive import PolynomialDrive, drive_of, size_of
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.records.gate import Edges
from piezoharvest.records.harmonics import Harmonics

DRIVES = ("force", "base_acceleration", "displacement")
IN_STEADY_STATE = DRIVES[:2]
MIN_SHARE = 1e-6  # of the largest possible value: least size of an initial state


def has_events(shunt: Shunt | None, drive: str) -> TypeGuard[Shunt]:
    """True if a record is one behind diodes or switches; with an imposed voltage they have no influence."""
    return drive != "voltage" and shunt is not None and not isinstance(shunt, LinearShunt)


def begins_anywhere(shunt: Shunt | None, drive: str) -> TypeGuard[Shunt]:
    """True if the engine predicts a record of which all initial states are free.

    It is one behind diodes or switches, or behind a capacitor across the leads: its current is a rate of the electrode
    voltage, which `RecordModel` has no row for beside hysteresis.
    """
    if isinstance(shunt, LinearShunt):
        return drive != "voltage" and shunt.has_capacitor_across
    return has_events(shunt, drive)


def by_engine(setting: Setting) -> bool:
    """True if a record is predicted by the engine: one in steady state, or as `begins_anywhere` says."""
    return setting.harmonics is not None or begins_anywhere(setting.shunt, setting.drive)


def redriven(setting: Setting, values: np.ndarray) -> Setting:
    """Setting with other samples of the drive."""
    if setting.harmonics is not None:
        return _in_steady_state(setting, setting.harmonics.refitted(values, setting.sample_time))
    course = _course(setting.drive, values) if by_engine(setting) else drive_of(values)
    return replace(setting, first=float(values[0]), motion=course)


def _course(drive: str, values: np.ndarray) -> PolynomialDrive:
    """Course of a drive behind a circuit between its samples."""
    return imposed_motion(values) if drive == "displacement" else straight_drive(values)


def _in_steady_state(setting: Setting, harmonics: Harmonics) -> Setting:
    """Setting with a periodic drive."""
    values = harmonics.at(setting.sample_time * np.arange(setting.count))
    size = size_of(values, setting.sample_time)
    if setting.size is not None:
        size = setting.size._replace(amplitude=size.amplitude, frequency=size.frequency)
    return replace(setting, first=float(values[0]), motion=drive_of(values), size=size, harmonics=harmonics)


def periodic_setting(
    drive: str, shunt: Shunt | None, sample_time: float, count: int, harmonics: Harmonics, transducer: Transducer
) -> Setting:
    """Setting of a few periods in steady state: nothing of where it begins is free.

    Parameters
    ----------
    drive : str
    shunt : Shunt or None
    sample_time : float
        s.
    count : int
        Samples.
    harmonics : Harmonics
        The drive without its noise.
    transducer : Transducer
        Nominal.

    Raises
    ------
    ParameterError
        The drive is no force or base acceleration, or the switch's timing is none for this frequency.
    """
    if drive not in IN_STEADY_STATE or shunt is None:
        allowed = " and ".join(IN_STEADY_STATE)
        raise ParameterError("drive", f"found {drive!r} in steady state, allowed are {allowed}")
    _check_timing(shunt, transducer, harmonics.period)
    return _in_steady_state(Setting(drive, shunt, sample_time, 0.0, drive_of(np.zeros(count)), count), harmonics)


def _check_timing(shunt: Shunt, transducer: Transducer, period: float | None) -> None:
    try:
        shunt.switch(transducer.capacitance, period)
    except ParameterError as error:
        raise error.within("shunt") from None


def circuit_setting(
    drive: str, shunt: Shunt, sample_time: float, values: np.ndarray, transducer: Transducer, moved: float = 0.0,
    gate: Edges | None = None,
) -> Setting:  # fmt: skip
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
    gate : Edges, optional
        When the switch acts, where it was recorded.

    Raises
    ------
    ParameterError
        The drive is none of these, or the switch's timing is that of a drive with a frequency, or it has none.
    """
    if drive not in DRIVES:
        raise ParameterError(
            "drive", f"found {drive!r} for a record behind {shunt.kind}, allowed are {', '.join(DRIVES)}"
        )
    _check_timing(shunt, transducer, None)
    if drive == "displacement" and gate is None and shunt.switch(transducer.capacitance, None) is not None:
        found = f"found an imposed displacement behind {shunt.kind}, whose switch would act at the extrema of its noise"
        raise ParameterError("drive", f"{found}; it needs a channel gate that times the switch")
    # An imposed motion is known from the first sample on.
    names = state_names(transducer)[2 if drive == "displacement" else 0 :]
    own = [state for state in shunt.states(transducer.capacitance) if state.stores and not state.only_closed]
    setting = Setting(drive, shunt, sample_time, float(values[0]), _course(drive, values), len(values), gate=gate)
    setting = replace(setting, size=size_of(values, sample_time))
    if drive == "displacement":
        x, u = setting.motion.coefficients[0, :2].tolist()
        # At rest electrodes have no voltage; by how much they have one is free.
        setting = replace(setting, fixed=(("x1", x), ("u1", u / sample_time), ("q", transducer.coupling * x)))
    x, u, q, v = _largest(replace(transducer, effects=()), setting)
    x = max(x, moved, MIN_SHARE * np.max(np.abs(values)) / transducer.stiffness, 1e-300)
    # A step that has come on before moves nothing from rest under it, and what a record shows may be its decay.
    swing = min(float(np.sqrt(transducer.stiffness / transducer.mass)), 1.0 / sample_time)
    u, q = max(u, x * swing), max(q, x * abs(transducer.coupling), 1e-300)
    v = max(v, q / transducer.capacitance)
    by = {"x": x, "u": u, "q": q}
    return replace(
        setting, free=(*names, *(state.name for state in own)),
        sizes=(*(float(by[name[0]]) for name in names), *(_size(state, v, transducer.capacitance) for state in own)),
    )  # fmt: skip


def _size(state: State, voltage: float, capacitance: float) -> float:
    """Size of a circuit's state, SI units: what electrodes at a voltage may charge it to, directly or by a coil."""
    by_a_coil = voltage * float(np.sqrt(capacitance / abs(state.storage)))
    return max(voltage, by_a_coil, abs(float(np.real(state.initial))))


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
