"""Measurement of a study on the virtual bench: every record is integrated, sensed and converted."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from piezoharvest.bench.effects import BenchEffect
from piezoharvest.bench.effects.electrical import Leakage
from piezoharvest.bench.effects.sensing import DisplacementLag
from piezoharvest.bench.sensors import COLUMNS, channels, sample
from piezoharvest.bench.settings import Bench, Setup, build_bench
from piezoharvest.bench.solver import CIRCUITS, Model, SolverError, Waves, integrate
from piezoharvest.bench.solver.drive import merged
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.parameters import ParameterError, check_kind
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.harvesting.mppt import MPPT
from piezoharvest.description.shunts.harvesting.rectifier import Rectifier
from piezoharvest.description.transducer import Transducer
from piezoharvest.progress import Stage, Step, log
from piezoharvest.study import Study, StudyError

Effects = tuple[BenchEffect, ...]
_MODE = ("mass", "damping", "stiffness", "coupling")


@dataclass(frozen=True, eq=False)
class BenchRecord:
    """One record of the bench.

    Attributes
    ----------
    name : str
        File name without its ending.
    setup : Setup
        What was to be measured.
    label : Shunt
        Circuit as the campaign has it.
    columns : mapping
        Samples by column of the default header, time first; SI units.
    waves : Waves
        True values at the sample instants.
    warnings : tuple of str
        Warnings of channels that were clipped or moved by few steps of the converter.
    """

    name: str
    setup: Setup
    label: Shunt
    columns: Mapping[str, np.ndarray]
    waves: Waves
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class BenchCampaign:
    """Records measured by the bench, with the specimen and the settings.

    Attributes
    ----------
    study : Study
    bench : Bench
    effects : tuple of BenchEffect
        All effects that were switched on.
    nominal : Transducer
        Nominal specimen as stated in the campaign.
    records : tuple of BenchRecord
    """

    study: Study
    bench: Bench
    effects: Effects
    nominal: Transducer
    records: tuple[BenchRecord, ...]


def measure(study: Study, progress: Callable[[str], None] = log) -> BenchCampaign:
    """Run a study on the virtual bench of its table [bench].

    Parameters
    ----------
    study : Study
    progress : callable
        Called for every record; default: the logger `piezoharvest`, level INFO.

    Raises
    ------
    StudyError
        The table [bench] is wrong, or requires something the bench cannot do.
    SolverError
        A record's equations have no solution.
    """
    check_kind("study", study, Study, 'load_study("study.toml") reads one')
    try:
        bench, effects, setups = build_bench(study)
        records = []
        for n, setup in enumerate(setups):
            what = f"record {n + 1} of {len(setups)}: {setup.excitation.kind}, {setup.shunt.kind}"
            progress(Step(what, n, len(setups)))
            stage = Stage(progress, what, "intervals")
            records.append(_record(study.transducer, bench, effects, setup, n, stage))
    except ParameterError as error:
        raise StudyError(study.path, error.key, error.message) from None
    return BenchCampaign(study, bench, effects, scattered(study.transducer, bench), tuple(records))


def _record(transducer: Transducer, bench: Bench, effects: Effects, setup: Setup, n: int, stage: Stage) -> BenchRecord:
    """Integrate, sense and convert one record."""
    base = setup.excitation.base
    time = np.arange(int(setup.duration * bench.sample_rate * (1 + 1e-12))) / bench.sample_rate
    line = channels(bench, base=base)
    late = {name: sum(effect.lateness(name) for effect in effects) for name in line}
    instants = merged(time, np.concatenate([time[time > lateness] - lateness for lateness in late.values()]))
    try:
        waves = integrate(_model(transducer, bench, effects, setup), setup.excitation, instants, stage)
    except SolverError as error:
        raise SolverError(f"record {n + 1} ({setup.excitation.kind}, {setup.shunt.kind}): {error}") from None
    label = _label(setup.shunt, waves)
    refused = f"no campaign may have a record of {label.kind}, {label.unrecorded}"
    columns, warnings = {COLUMNS["time"]: time}, [refused] if label.unrecorded else []
    for place, (name, channel) in enumerate(line.items()):
        true = waves.at(time - late[name]).sensed(name)
        if np.isnan(true).all():  # the circuit has no such part
            continue
        # Each channel of each record has its own random stream: another channel's settings do not change it.
        rng = np.random.default_rng([bench.seed, n + 1, place])
        columns[COLUMNS[name]], warning = sample(name, channel, time, true, bench.converter, effects, rng)
        warnings += [warning] if warning else []
    return BenchRecord(
        f"{n + 1:02d}_{setup.excitation.kind}_{setup.shunt.kind}", setup, label, columns, waves.at(time),
        tuple(warnings),
    )  # fmt: skip


def _label(shunt: Shunt, waves: Waves) -> Shunt:
    """Circuit that a campaign has: what a tracker has found in the excitation, a record tells by its voltage."""
    if not isinstance(shunt, MPPT):
        return shunt
    bridge = {f.name: getattr(shunt, f.name) for f in fields(Rectifier) if f.name != "dc_voltage"}
    return Rectifier(**bridge, dc_voltage=float(waves.dc_voltage[0]))


def _model(transducer: Transducer, bench: Bench, effects: Effects, setup: Setup) -> Model:
    """True model of the specimen and its circuit, with all effects."""
    shunt = setup.shunt
    for effect in effects:
        shunt = effect.connect(shunt)
    model = Model(transducer, CIRCUITS[shunt.kind](shunt), base=setup.excitation.base)
    Leakage(resistance=bench.buffer.input_resistance).act(model, setup.duration)
    DisplacementLag(time_constant=bench.laser.lag).act(model, setup.duration)
    for effect in effects:
        try:
            effect.act(model, setup.duration)
        except ParameterError as error:
            raise error.within(f"bench.effects.{effect.name}") from None
    return model


def scattered(transducer: Transducer, bench: Bench) -> Transducer:
    """Nominal values of a transducer: the true ones times exp(nominal_error * normal); thresholds by one factor.

    Mass, damping, stiffness and coupling of every mode, the capacitance, and the weights have factors of their own.
    """
    rng = np.random.default_rng([bench.seed])

    def factor() -> float:
        return math.exp(bench.nominal_error * rng.standard_normal())

    values: dict[str, Any] = {key: getattr(transducer, key) * factor() for key in (*_MODE, "capacitance")}
    values["modes"] = tuple(replace(m, **{key: getattr(m, key) * factor() for key in _MODE}) for m in transducer.modes)
    if transducer.hysteresis is not None:
        stretch, pairs = factor(), transducer.hysteresis
        thresholds = tuple(stretch * r for r in pairs.thresholds)
        values["hysteresis"] = Hysteresis(thresholds=thresholds, weights=tuple(factor() * w for w in pairs.weights))
    return replace(transducer, **values)
