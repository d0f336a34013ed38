"""Random studies run from rest by the engine and by the bench's solver, whose equations and method are its own.

The bench integrates with implicit Runge-Kutta steps (Radau IIA) between events that it locates itself. Of the studies a
share has hysteresis, and a share is stiff: the structure turns or decays ten times in the time in which the drive
turns once.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from piezoharvest.bench.effects import registered
from piezoharvest.bench.settings import check_shunt
from piezoharvest.bench.solver import CIRCUITS, Model, SolverError, integrate
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.paths import component_table
from piezoharvest.engine import simulate
from piezoharvest.engine.response import Waveforms
from piezoharvest.linear import linearize
from piezoharvest.study import Study, build
from reports.reliability.studies import study_of

OF_EACH = 350  # studies of a stratum
PERIODS, SAMPLES = 8, 64  # of the drive, from rest; samples in a period
STIFF = 10.0  # fastest rate of the open-circuit structure over that of the drive
NO_VOLTAGE = 1e-6  # of the open-circuit voltage
# The bench looks for events at the stages of its steps, so that it may miss two that are close together: what is
# further apart than CLOSE is run again with FINER times as many nodes.
CLOSE, FINER = 1e-6, 8
SIGNALS = ("displacement", "voltage", "dc_voltage")


def sample(first: int) -> list[int]:
    """Seeds of studies that can be compared, from the first one on: as many of each stratum."""
    chosen: dict[str, list[int]] = {"hysteretic": [], "stiff": [], "other": []}
    seed = first
    while any(len(seeds) < OF_EACH for seeds in chosen.values()):
        try:
            study = study_of(seed)
            seeds = chosen[stratum(study)]
            if len(seeds) < OF_EACH and _on_the_bench(study) is not None:
                seeds.append(seed)
        except ParameterError:
            pass
        seed += 1
    return sorted(seed for seeds in chosen.values() for seed in seeds)


def stratum(study: Study) -> str:
    """What a study is drawn for: "hysteretic", "stiff", or "other"."""
    if study.transducer.hysteresis is not None:
        return "hysteretic"
    rates = np.abs(np.linalg.eigvals(linearize(replace(study.transducer, effects=())).A))
    return "stiff" if rates.max() * length_of(study) > STIFF * 2.0 * np.pi * PERIODS else "other"


def length_of(study: Study) -> float:
    """Length of the run, s."""
    period = study.excitation.period
    return PERIODS * period if period else study.excitation.length or 0.0


def compare(seed: int) -> dict[str, Any]:
    """Distance of the engine from the bench's solver in the study of a seed.

    Returns
    -------
    dict
        `seed`, `kind`, `stratum`, `outcome` ("compared", "refused", "said" by the engine, "not on the bench", "not
        followed" by its solver), `what`, `distance`, the largest of the signals' root mean square differences relative
        to the root mean square of the signal, and `seconds` of processor time.
    """
    begin = time.process_time()
    row: dict[str, Any] = {"seed": seed, "kind": "", "stratum": "", "distance": None}
    try:
        study = study_of(seed)
        row |= {"kind": study.shunts[0].kind, "stratum": stratum(study)}
        row |= _compared(study)
    except ParameterError as error:
        row |= {"outcome": "refused", "what": str(error)[:300]}
    except SolverError as error:
        row |= {"outcome": "not followed", "what": str(error)[:300]}
    return {**row, "seconds": round(time.process_time() - begin, 3)}


def _compared(study: Study) -> dict[str, Any]:
    model = _on_the_bench(study)
    if model is None:
        return {"outcome": "not on the bench", "what": "the bench has no such circuit or effect"}
    count = PERIODS * SAMPLES
    response = simulate(study.systems[0], study.excitation, transient=length_of(study), samples=count)
    if not response.converged or response.waveforms is None:
        return {"outcome": "said", "what": response.message}
    distance = _distance(study, response.waveforms, model, 1)
    if distance > CLOSE and (again := _on_the_bench(study)):
        distance = _distance(study, response.waveforms, again, FINER)
    return {"outcome": "compared", "what": "", "distance": distance}


def _distance(study: Study, engine: Waveforms, model: Model, finer: int) -> float:
    """Distance of the engine's waveforms from the bench's, whose nodes are `finer` times as many as the samples."""
    count = (len(engine.time) - 1) * finer
    waves = integrate(
        model, study.excitation, np.interp(np.arange(count + 1) / finer, range(len(engine.time)), engine.time)
    )
    device = study.transducer
    # A voltage that a short or a diode that never conducts leaves is rounding: less than this is no voltage.
    open_circuit = abs(device.coupling) * _size(waves.displacement) / device.capacitance
    least = {"displacement": 0.0, "voltage": NO_VOLTAGE * open_circuit, "dc_voltage": NO_VOLTAGE * open_circuit}
    distances = [0.0]
    for name in SIGNALS:
        bench = getattr(waves, name)[::finer]
        if not np.isnan(bench).all():
            least_size = max(least[name], np.finfo(float).tiny)
            distances.append(_size(getattr(engine, name) - bench) / max(_size(bench), least_size))
    return max(distances)


def _size(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _on_the_bench(study: Study) -> Model | None:
    """The same specimen and circuit in the bench's equations; None where it has none for them."""
    known, shunt = registered(), study.shunts[0]
    effects = study.transducer.effects
    if not all(effect.name in known for effect in effects):
        return None
    own = [build(known[effect.name], component_table(effect), effect.name) for effect in effects]
    for effect in own:
        shunt = effect.connect(shunt)
    try:
        check_shunt(shunt, "shunts.0")
    except ParameterError:
        return None
    model = Model(study.transducer, CIRCUITS[shunt.kind](shunt), base=study.excitation.base)
    for effect in own:
        effect.act(model, length_of(study))
    return model
