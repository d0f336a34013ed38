"""Inputs that the records visit, from the present fit's prediction: of these a law is known, and of no others."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from piezoharvest.description.effects.nameless.circuit_places import has_dc_load, has_diodes, has_loop
from piezoharvest.description.effects.nameless.sizes import SIZES, length_of
from piezoharvest.description.shunts import SeriesSSHI
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.model import prediction_of
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.predict.any_prediction import AnyPrediction
from piezoharvest.predict.circuit.readings import NEEDED
from piezoharvest.predict.prediction import Prediction

Visited = Mapping[str, np.ndarray]


def visited_inputs(problem: Problem, found: Fit) -> dict[str, np.ndarray]:
    """Samples of every input over all records, free of the noise of sensors; time since each record began, in s."""
    parts: dict[str, list[np.ndarray]] = {}
    every = inputs_of_records(problem, found)
    for _, inputs in every:
        for name, values in inputs.items():
            parts.setdefault(name, []).append(values)
    # A parameter changes with what all records know.
    unknown = {name for name in (*SIZES, "campaign_time") if len(parts.get(name, ())) < len(every)}
    return {name: np.concatenate(values) for name, values in parts.items() if name not in unknown}


def inputs_of_records(problem: Problem, found: Fit) -> list[tuple[float, dict[str, np.ndarray]]]:
    """Sample time (s) and samples of every input of each record."""
    pairs = zip(problem.data, found.nuisance, strict=True)
    return [
        (data.setting.sample_time, _of_record(data, found, nuisance)) for data, nuisance in pairs
        if isinstance(data, Data)
    ]  # fmt: skip


def _channels(prediction: AnyPrediction, data: Data) -> list[str]:
    """Channels that a prediction has and a law may be a function of."""
    if isinstance(prediction, Prediction):
        return [name for name in prediction.matrices.channels if name != "acceleration"]
    of_load = ["dc_voltage"] if has_dc_load(data.setting.shunt) else []
    return list(dict.fromkeys([*NEEDED, *of_load, *(name for name in data.channels if name.startswith("dc_"))]))


def _of_record(data: Data, found: Fit, nuisance: np.ndarray) -> dict[str, np.ndarray]:
    prediction = prediction_of(found.model, data, nuisance)
    names = [name for name in _channels(prediction, data) if name != data.drive]
    blocks = prediction.blocks(False, channels=names)
    values = np.concatenate([block.values for block in blocks])
    signals = dict(zip(names, values.T, strict=True))
    signals[data.drive] = data.record[data.drive] - data.rest
    step = data.setting.sample_time
    rates = {f"{name}_rate": np.gradient(signals[name], step) for name in (data.drive, "displacement")}
    sizes = data.setting.size
    currents = _currents_of_parts(data, found, signals)
    share = np.linspace(0.0, 1.0, len(data))
    time = length_of(sizes) * share
    if sizes is None:
        return {**signals, **rates, **currents, "time": time}
    over = {name: np.full(len(data), getattr(sizes, name)) for name in SIZES}
    over["campaign_time"] = sizes.begin + sizes.length * share
    known = {name: values for name, values in over.items() if np.all(np.isfinite(values))}
    return {**signals, **rates, **currents, **known, "time": time}


def _currents_of_parts(data: Data, found: Fit, signals: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Sizes of the currents that parts of the circuit may have had: no channel shows them.

    Diodes that hold the voltage conduct what the motion makes of current, T x'; the loop of a coil swings to
    v sqrt(C/L), v being the voltage with which it begins.
    """
    shunt, device = data.setting.shunt, found.model.transducer
    parts: dict[str, np.ndarray] = {}
    if has_diodes(shunt) and "velocity" in signals:
        parts["diode_current"] = np.abs(device.coupling * signals["velocity"])
    if has_loop(shunt) and "voltage" in signals:
        inductance, _ = shunt.loop(device.capacitance)
        parts["loop_current"] = np.abs(signals["voltage"]) * float(np.sqrt(device.capacitance / inductance))
        if isinstance(shunt, SeriesSSHI):  # whose diodes are in the loop
            parts["diode_current"] = parts["loop_current"]
    return parts
