"""Trials of what is wrong behind diodes and switches: a random circuit with effects on the virtual bench, diagnosed.

The bench integrates with equations and a method (Radau IIA) of its own; the diagnosis predicts with the engine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.bench import measure
from piezoharvest.bench.measuring import BenchCampaign
from piezoharvest.description.effects import registered
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.paths import component_table
from piezoharvest.description.shunts import Shunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.predict.circuit.setting import circuit_setting
from piezoharvest.predict.parameters import parameters_of
from piezoharvest.study import build, build_shunt, study_from
from reports.diagnosis import trials
from reports.diagnosis.trials import Trial
from reports.identification.specimens import specimen

TRANSDUCER = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1.0e-3, "capacitance": 40e-9}
OFF = 0.03  # largest relative error of a nominal value
RATE, DURATION = 4000.0, 0.3  # Hz, s: fifteen periods
HOLD_OFF = 4e-3  # s: a switched structure may come to rest for a moment, where noise makes extrema
FREQUENCIES, AMPLITUDES = (48.0, 53.0), (0.02, 0.05)  # Hz, N: about the resonance of 50 Hz
ROLES = ("fit", "fit", "validate")
NOISE = {"displacement": 3e-7, "voltage": 0.02}  # m, V: of the sensors
SENSORS = {
    "load_cell": {"sensitivity": 100.0, "noise": 2e-5},
    "laser": {"sensitivity": 5e3, "resolution": 0.0, "noise": NOISE["displacement"]},
    "buffer": {"gain": 0.05, "noise": NOISE["voltage"]},  # 200 V reach the end of the converter
}
BRIDGES = ("rectifier", "parallel_sshi", "series_sshi")
LOOPS = ("parallel_sshi", "series_sshi", "ssdi", "ssdv")
SWITCHES = (*LOOPS, "sece", "ssds")
# What an effect of no strength, or of its largest, is at a share of 0 and 1; the other numbers are drawn.
Strength = Callable[[float], dict[str, Any]]


class Drawn(NamedTuple):
    """An effect of a trial: circuits in which it shows, and its table at a share of its largest strength."""

    circuits: tuple[str, ...]
    table: Callable[[np.random.Generator, Shunt], Strength]


def _probe(rng: np.random.Generator, shunt: Shunt) -> Strength:
    if shunt.kind in BRIDGES and rng.random() < 0.5:
        return lambda s: {"resistance": 1e4 / s, "place": "dc"}
    return lambda s: {"resistance": 1e4 / s, "capacitance": 2e-9 * s}


def _drop(rng: np.random.Generator, shunt: Any) -> Strength:
    return lambda s: {"diode_drop": shunt.diode_drop + 3.0 * s}


def _scaled(key: str, largest: float, signed: bool = False, **others: tuple[float, float]) -> Callable[..., Strength]:
    """Strength in proportion to the share, of a random sign if it may be, and logarithmic draws of other keys."""

    def table(rng: np.random.Generator, shunt: Shunt) -> Strength:
        most = largest * (float(rng.choice((-1.0, 1.0))) if signed else 1.0)
        rest = {name: float(np.exp(rng.uniform(*np.log(ends)))) for name, ends in others.items()}
        return lambda s: {key: most * s, **rest}

    return table


DRAWS: dict[str, Drawn] = {
    "switch_delay": Drawn(SWITCHES, _scaled("time_lag", 2e-3)),
    "inversion_loss": Drawn(LOOPS, lambda rng, shunt: lambda s: {"quality": shunt.quality / (1.0 + 4.0 * s)}),
    "voltage_reversion": Drawn(SWITCHES, _scaled("share", 0.5, time_constant=(1e-3, 2e-2))),
    "diode_drop_error": Drawn(BRIDGES, _drop),
    "on_time_offset": Drawn(LOOPS, _scaled("on_time_error", 0.6, signed=True)),
    "missed_switching": Drawn(SWITCHES, lambda rng, shunt: lambda s: {"threshold": s}),  # of the largest voltage
    "reverse_leakage": Drawn(BRIDGES, _scaled("conductance", 1e-5)),
    "probe_loading": Drawn((*BRIDGES, *SWITCHES[2:]), _probe),
}
# Of the fifteen: what may be there beside a circuit's.
OTHERS: dict[str, Callable[..., Strength]] = {
    "leakage": lambda rng, shunt: lambda s: {"resistance": 1e4 / s},
    "displacement_lag": _scaled("time_constant", 1e-3),
    "channel_skew": _scaled("delay", 5e-4),
    "creep": _scaled("compliance_ratio", 0.5, time_constant=(5e-3, 5e-2)),
    "coupling_drift": _scaled("relative_drift", 0.2, signed=True),
    "bias_current": _scaled("current", 1e-4, signed=True),
}
SHARES = (1e-5, 1.0)  # between which the share of an effect's largest strength lies
MISSED = (0.25, 0.8)  # of the largest voltage: where a peak detector's threshold is drawn


def circuit_of(trial: Trial) -> Shunt:
    """Random circuit of a trial, in which its effects show."""
    rng = np.random.default_rng([trial.seed, 21])
    allowed = [DRAWS[name].circuits for name in trial.names if name in DRAWS] or [(*BRIDGES, *SWITCHES[2:])]
    kind = str(rng.choice([kind for kind in allowed[0] if all(kind in others for others in allowed)]))
    values: dict[str, Any] = {"kind": kind}
    if kind in LOOPS:
        values |= {"inductance": float(rng.uniform(0.3, 1.0)), "quality": float(rng.uniform(3.0, 10.0))}
    if kind in BRIDGES:
        values |= {
            "smoothing_capacitance": 1e-6, "load_resistance": float(rng.uniform(1e5, 5e5)),
            "diode_drop": float(rng.uniform(0.2, 0.6)),
        }  # fmt: skip
    if kind in SWITCHES:
        values["hold_off"] = HOLD_OFF
    if kind == "ssdv":
        values["source_voltage"] = float(rng.uniform(0.2, 1.0))
    return build_shunt(values, "shunt")


class Specimen(NamedTuple):
    """What stands on the bench but for its effects: transducer, circuit, drive of each record."""

    transducer: Transducer
    shunt: Shunt
    drives: tuple[tuple[float, float], ...]  # Hz, N

    def predicted(self, tables: Mapping[str, Mapping[str, Any]], derivatives: bool) -> tuple[np.ndarray, np.ndarray]:
        """Fitted samples in units of their noise (n,), and derivatives (n, p) to all numbers of a fit."""
        effects = tuple(build(registered()[name], table, name) for name, table in tables.items())
        device = replace(self.transducer, effects=effects)
        parameters = parameters_of(self.transducer, {"force"}) if derivatives else []
        values, slopes = [], []
        for (frequency, amplitude), role in zip(self.drives, ROLES, strict=True):
            if role != "fit":
                continue
            times = np.arange(round(RATE * DURATION)) / RATE
            force = amplitude * np.sin(2.0 * np.pi * frequency * times)
            setting = circuit_setting("force", self.shunt, 1.0 / RATE, force, self.transducer)
            blocks = list(CircuitPrediction(device, setting, parameters).blocks(derivatives, channels=tuple(NOISE)))
            noise = np.array(list(NOISE.values()))
            values.append((np.concatenate([block.values for block in blocks]) / noise).ravel())
            if derivatives:
                each = np.concatenate([block.derivatives for block in blocks]) / noise[:, None]
                slopes.append(each.reshape(-1, each.shape[-1]))
        return np.concatenate(values), _joined(slopes, len(parameters))


def _joined(slopes: list[np.ndarray], common: int) -> np.ndarray:
    """Derivatives of all records: to the common parameters, then to the numbers of each record."""
    own = [each.shape[1] - common for each in slopes]
    rows = []
    for n, each in enumerate(slopes):
        zeros = [np.zeros((len(each), count)) for count in own]
        zeros[n] = each[:, common:]
        rows.append(np.concatenate([each[:, :common], *zeros], axis=1))
    return np.concatenate(rows) if rows else np.zeros((0, 0))


def specimen_of(trial: Trial) -> Specimen:
    """Random specimen of a trial with its circuit and drives."""
    rng, nominal = np.random.default_rng([trial.seed, 22]), build(Transducer, TRANSDUCER, "transducer")
    drives = tuple((float(rng.uniform(*FREQUENCIES)), float(rng.uniform(*AMPLITUDES))) for _ in ROLES)
    return Specimen(specimen(nominal, trial.seed, OFF), circuit_of(trial), drives)


def effects_of(trial: Trial, on: Specimen) -> dict[str, dict[str, Any]]:
    """Tables of the effects, each of the size aimed at: what it changes that no parameter of a fit takes, in sigma."""
    if not trial.names:
        return {}
    healthy, slopes = on.predicted({}, derivatives=True)
    basis, _ = np.linalg.qr(slopes / np.maximum(np.linalg.norm(slopes, axis=0), 1e-300))
    tables = {}
    for n, name in enumerate(trial.names):
        rng = np.random.default_rng([trial.seed, n, 23])
        strength = DRAWS[name].table(rng, on.shunt) if name in DRAWS else OTHERS[name](rng, on.shunt)
        if name == "missed_switching":  # it has no size that could be small: one extremum more is either missed or not
            largest = NOISE["voltage"] * float(np.abs(healthy[1::2]).max())
            tables[name] = strength(largest * float(rng.uniform(*MISSED)))
            continue

        def size(share: float, name: str = name, strength: Strength = strength) -> float:
            change = on.predicted({name: strength(share)}, derivatives=False)[0] - healthy
            return float(np.linalg.norm(change - basis @ (basis.T @ change)))

        tables[name] = strength(_share(size, trial.sigma))
    return tables


def _share(size: Callable[[float], float], sigma: float) -> float:
    """Share at which an effect has a size."""
    low, high = np.log(SHARES)
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if size(float(np.exp(middle))) < sigma else (low, middle)
    return float(np.exp(high))


def bench_of(trial: Trial) -> tuple[BenchCampaign, Transducer, dict[str, dict[str, Any]]]:
    """Measure a trial: what the bench has, the specimen, and the effects' parameters."""
    on = specimen_of(trial)
    tables = effects_of(trial, on)
    records = [
        {"excitation": {"frequency": frequency, "amplitude": amplitude}, "role": role}
        for (frequency, amplitude), role in zip(on.drives, ROLES, strict=True)
    ]
    bench = {
        "sample_rate": RATE, "duration": DURATION, "seed": trial.seed, "channels": list(NOISE), **SENSORS,
        "effects": tables, "records": records,
    }  # fmt: skip
    drive = {"kind": SineForce.kind, "frequency": on.drives[0][0], "amplitude": on.drives[0][1]}
    study = study_from(
        {"transducer": TRANSDUCER, "excitation": drive, "shunts": [_table(on.shunt)], "bench": bench},
        Path("study.toml"),
    )
    measured = measure(replace(study, transducer=on.transducer))
    return replace(measured, nominal=study.transducer), on.transducer, tables


def _table(shunt: Shunt) -> dict[str, Any]:
    return {"kind": shunt.kind, **component_table(shunt)}


attempt = partial(trials.attempt, bench=bench_of)


def held_out(trial: Trial) -> dict[str, Any]:
    """Run a held-out trial, of whose answer only whether it is right is kept."""
    return trials.kept(attempt(trial))
