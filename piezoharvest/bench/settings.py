"""Validation of the table [bench] of a study: the set-up, the effects, and the records to be measured."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from piezoharvest.bench.devices import (
    Accelerometer,
    Buffer,
    Converter,
    CurrentSense,
    DcMeter,
    Laser,
    LoadCell,
    Vibrometer,
)
from piezoharvest.bench.effects import BenchEffect, registered
from piezoharvest.bench.solver import CIRCUITS
from piezoharvest.description.excitation import Excitation
from piezoharvest.description.limits import check_size
from piezoharvest.description.parameters import Component, ParameterError, described, quantity
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.linear.coil import WoundShunt
from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.description.shunts.linear.short import Short
from piezoharvest.study import Study, build, build_excitation, build_shunt

MAX_SAMPLES = 1_000_000  # of a record: at some 0.2 ms for each, a few minutes


# Responses that the bench can measure; those of the first line unless [bench] names them.
Response = Literal[
    "displacement", "voltage", "current",
    "velocity", "acceleration", "dc_voltage", "dc_current", "gate",
]  # fmt: skip
RESPONSES: tuple[Response, ...] = get_args(Response)
USUAL = RESPONSES[:3]


@dataclass(frozen=True, kw_only=True)
class RecordOptions(Component):
    """One of [[bench.records]]: differences from the study.

    Attributes
    ----------
    excitation : table
        Keys that replace those of [excitation]; with another `kind` the whole table is replaced.
    load_resistance, shunt
        A resistor, or the table of a shunt; default the first shunt of the study.
    """

    excitation: Any = described(
        "keys that replace those of the study's excitation; all of them if the kind differs", default=None
    )
    shunt: Any = described("circuit; default: the first shunt of the study", default=None)
    load_resistance: float | None = quantity("ohm", "load resistance", default=None, above=0)
    role: Literal["fit", "validate"] = described("whether the record is fitted, or kept for validation", default="fit")
    duration: float | None = quantity("s", "length of the record", default=None, above=0)


@dataclass(frozen=True, kw_only=True)
class Bench(Component):
    """The table [bench].

    Attributes
    ----------
    channels : tuple of str
        Responses that are measured beside the drive; a record has those of the dc side and of the switch's gate
        where its circuit has such a part. `acceleration` is that of the displacement.
    duration : float
        Default: the excitation's own length, or 10 s where it has none.
    seed : int
        Seed of noise, hum phases and nominal errors.
    nominal_error : float
        Relative scatter of the nominal values of the campaign about the true ones.
    truth : bool
        Write `truth.json` beside the campaign.
    records : tuple of RecordOptions
        Default: one record for each shunt of the study.
    """

    sample_rate: float = quantity("Hz", "sample rate", default=1000.0, above=0)
    duration: float | None = quantity("s", "length of a record", default=None, above=0)
    seed: int = quantity("", "seed of all random numbers", default=0, at_least=0)
    nominal_error: float = quantity("", "relative scatter of the nominal values", default=0.0, at_least=0, below=1)
    truth: bool = described("whether truth.json is written beside the campaign", default=False)
    channels: tuple[Response, ...] = described("responses that are measured, in addition to the drive", default=USUAL)
    load_cell: LoadCell = field(default_factory=LoadCell)
    laser: Laser = field(default_factory=Laser)
    buffer: Buffer = field(default_factory=Buffer)
    current_sense: CurrentSense = field(default_factory=CurrentSense)
    accelerometer: Accelerometer = field(default_factory=Accelerometer)
    vibrometer: Vibrometer = field(default_factory=Vibrometer)
    moving_accelerometer: Accelerometer = described("accelerometer on the structure", default_factory=Accelerometer)
    dc_meter: DcMeter = field(default_factory=DcMeter)
    dc_sense: CurrentSense = described("sense resistor in the branch of the dc load", default_factory=CurrentSense)
    converter: Converter = field(default_factory=Converter)
    records: tuple[RecordOptions, ...] = ()


@dataclass(frozen=True, eq=False)
class Setup:
    """One record to be measured: excitation, shunt by its label, and duration (s)."""

    excitation: Excitation
    shunt: Shunt
    role: Literal["fit", "validate"]
    duration: float


def build_bench(study: Study) -> tuple[Bench, tuple[BenchEffect, ...], tuple[Setup, ...]]:
    """Bench of a study, with its effects and the records to be measured.

    Raises
    ------
    ParameterError
        A key is missing, unknown, of the wrong type or out of bounds.
    """
    table = dict(study.bench)
    if study.transducer.electrodes:
        found = (
            f"found {len(study.transducer.electrodes)}, but the virtual bench has only the transducer's own electrodes"
        )
        raise ParameterError("transducer.electrodes", found)
    effects = _effects(study, table.pop("effects", {}))
    bench = build(Bench, table, "bench")
    if not bench.channels:
        raise ParameterError(
            "bench.channels", f"found an empty list, must contain at least one of {', '.join(RESPONSES)}"
        )
    options = bench.records or tuple(RecordOptions() for _ in study.shunts)
    setups = []
    for n, option in enumerate(options):
        where = f"bench.records.{n}" if bench.records else f"shunts.{n}"
        shunt = _shunt(study, option, where, 0 if bench.records else n)
        if shunt.taken != (0,):
            raise ParameterError(where, "found a shunt at further electrodes, which the virtual bench does not have")
        excitation = _excitation(study, option.excitation, f"{where}.excitation")
        duration = option.duration or bench.duration or excitation.length or 10.0
        if duration * bench.sample_rate < 3:
            found = f"found {duration:g} s at {bench.sample_rate:g} Hz"
            raise ParameterError(
                f"{where}.duration", f"{found}, which is less than the three samples that a record needs"
            )
        if not duration * bench.sample_rate <= MAX_SAMPLES:
            found = f"found {duration:g} s at {bench.sample_rate:g} Hz, {duration * bench.sample_rate:.7g} samples"
            raise ParameterError(f"{where}.duration", f"{found}, allowed are up to {MAX_SAMPLES}")
        check_size(study.transducer, excitation, shunt)
        setups.append(Setup(excitation, _sensed(shunt, bench.current_sense, where), option.role, duration))
    if not setups:
        raise ParameterError("shunts", "missing tables [[shunts]] or [[bench.records]], at least one is needed")
    return bench, effects, tuple(setups)


def _effects(study: Study, tables: Any) -> tuple[BenchEffect, ...]:
    """Effects of the study's transducer, which the campaign also states, and those of the bench only."""
    known, found = registered(), {}
    for effect in study.transducer.effects:
        where = f"transducer.effects.{effect.name}"
        if effect.name not in known:
            raise ParameterError(where, f"the virtual bench has no such effect, it has {', '.join(known)}")
        found[effect.name] = build(known[effect.name], vars(effect), where)
    if not isinstance(tables, Mapping):
        raise ParameterError(
            "bench.effects", f"found {tables!r}, must be a table for each effect, [bench.effects.NAME]"
        )
    for name, table in tables.items():
        where = f"bench.effects.{name}"
        if name not in known:
            raise ParameterError(where, f"unknown effect, known effects are {', '.join(sorted(known))}")
        if name in found:
            raise ParameterError(where, f"transducer.effects.{name} is given too, but only one of the two may be")
        found[name] = build(known[name], table, where)
    return tuple(found.values())


def _shunt(study: Study, option: RecordOptions, where: str, default: int) -> Shunt:
    """Shunt of a record by its label."""
    if option.shunt is not None and option.load_resistance is not None:
        raise ParameterError(f"{where}.shunt", "load_resistance is given too, but only one of the two may be")
    if option.shunt is not None:
        return build_shunt(option.shunt, f"{where}.shunt", study.transducer)
    if option.load_resistance is not None:
        return Resistor(resistance=option.load_resistance)
    if not study.shunts:
        raise ParameterError(
            f"{where}.load_resistance", "missing key, give a resistance in ohm, or a table shunt instead"
        )
    return study.shunts[default]


def _excitation(study: Study, table: Any, where: str) -> Excitation:
    """Excitation of a record: that of the study with some keys replaced, or another one."""
    if table is None:
        return study.excitation
    if not isinstance(table, Mapping):
        raise ParameterError(where, f"found {table!r}, must be a table")
    kind = study.excitation.kind
    values = {f.name: getattr(study.excitation, f.name) for f in dataclasses.fields(study.excitation) if f.init}
    own = {name: value for name, value in values.items() if value is not None}
    if "file" in own:  # relative to the working directory, while a new one is relative to the study
        own["file"] = str(Path(own["file"]).resolve())
    same = table.get("kind", kind) == kind
    return build_excitation({"kind": kind, **own, **table} if same else table, study.path.parent, where)


def check_shunt(shunt: Shunt, where: str) -> None:
    """Raise `ParameterError` if the bench cannot build a circuit."""
    for key in ("diode_curve", "switch_curve", "loop_sections", "load_curve"):
        if getattr(shunt, key, None) is not None:
            found = "found on the virtual bench, whose diodes, switches, loops and loads are piecewise linear"
            straight = " (diode = NAME gives one, together with diode_current)" if key == "diode_curve" else ""
            raise ParameterError(f"{where}.{key}", found + straight)
    for key in ("storage", "initial_dc_voltage", "smoothing_resistance", "start_voltage"):
        if getattr(shunt, key, None):
            raise ParameterError(
                f"{where}.{key}", "found on the virtual bench, which has only loads and starts from rest"
            )
    if shunt.kind not in CIRCUITS:
        found = f"found {shunt.kind!r}, for which the virtual bench has no circuit"
        raise ParameterError(f"{where}.kind", f"{found}, allowed are {', '.join(CIRCUITS)}")
    parts = ("core_resistance", "self_resonance", "second_core_resistance", "second_self_resonance")
    real = any(getattr(shunt, key, None) is not None for key in parts)
    if (real and not CIRCUITS[shunt.kind].real_coil) or (isinstance(shunt, WoundShunt) and not shunt.is_ideal):
        message = "found a coil with losses or a self-resonance, but the virtual bench has only ideal ones in"
        raise ParameterError(where, f"{message} {shunt.kind}")


def _sensed(shunt: Shunt, sense: CurrentSense, where: str) -> Shunt:
    """Shunt including the current's sense resistor; raises if the bench cannot build it."""
    check_shunt(shunt, where)
    if isinstance(shunt, Short):
        return Resistor(resistance=sense.resistance)
    if isinstance(shunt, Resistor) and shunt.resistance < sense.resistance:
        allowed = f"must be at least {sense.resistance:g} ohm (bench.current_sense.resistance, which is part of it)"
        raise ParameterError(f"{where}.resistance", f"found {shunt.resistance:g} ohm, {allowed}")
    return shunt
