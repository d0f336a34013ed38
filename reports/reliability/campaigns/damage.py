"""What is wrong with campaigns: faults of sensors, converters and files, and of what the campaign file says."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from piezoharvest.description.effects import registered
from reports.reliability.campaigns.drawing import Columns, Tables

Rng = np.random.Generator
LAW = '''"""Laws of a user."""

from dataclasses import dataclass
from typing import ClassVar

from piezoharvest import Effect, Product, quantity


@dataclass(frozen=True, kw_only=True)
class SlowSpring(Effect):
    """A spring whose other end creeps behind a damper, which may begin anywhere."""

    name: ClassVar[str] = "slow_spring"
    source: ClassVar[str] = "any textbook"
    looks: ClassVar[str] = "a resonance that is stiffer than at rest"
    told_by: ClassVar[str] = "a slow sine"

    stiffness: float = quantity("N/m", "stiffness of the spring", at_least=0, null=0.0)
    time_constant: float = quantity("s", "time constant of damper and spring", above=0)

    def act(self, specimen):
        stretch, rate = specimen.state("stretch", 1.0)
        specimen.equation(rate - specimen.u + stretch / self.time_constant)
        specimen.push(-self.stiffness * stretch)

    @classmethod
    def starts(cls, scales):
        for time_constant in (0.1, 10.0):
            yield cls(stiffness=0.0, time_constant=time_constant)
'''


def _column(rng: Rng, columns: Columns) -> str:
    """A channel that is damaged."""
    return str(rng.choice([name for name in columns if name != "time_s"]))


def _gap(rng: Rng, columns: Columns) -> None:
    first, count = int(rng.integers(len(next(iter(columns.values()))))), int(rng.integers(1, 50))
    for name in columns:
        columns[name] = np.delete(columns[name], slice(first, first + count))


def _set(value: Callable[[Rng, np.ndarray], np.ndarray]) -> Callable[[Rng, Columns], None]:
    """Damage of one channel."""

    def act(rng: Rng, columns: Columns) -> None:
        name = _column(rng, columns)
        columns[name] = value(rng, columns[name])

    return act


def _nan(rng: Rng, values: np.ndarray) -> np.ndarray:
    found = values.copy()
    found[rng.integers(len(found), size=int(rng.choice([1, 5, len(found)])))] = rng.choice([np.nan, np.inf, 1e300])
    return found


def _drop_out(rng: Rng, values: np.ndarray) -> np.ndarray:
    found, first = values.copy(), int(rng.integers(len(values)))
    found[first : first + int(rng.integers(2, 60))] = float(rng.choice([0.0, found[first], 1e3 * np.abs(found).max()]))
    return found


def _short(rng: Rng, columns: Columns) -> None:
    count = int(rng.choice([1, 2, 3, 4, 6, 10, 20]))
    for name in columns:
        columns[name] = columns[name][:count]


def _late(rng: Rng, columns: Columns) -> None:
    """The record begins in the middle of what happens."""
    first = int(rng.uniform(0.1, 0.8) * len(next(iter(columns.values()))))
    for name in columns:
        columns[name] = columns[name][first:]


def _thinned(rng: Rng, columns: Columns) -> None:
    step = int(rng.integers(2, 30))
    for name in columns:
        columns[name] = columns[name][::step]


def _other_clock(rng: Rng, columns: Columns) -> None:
    for name in ("time_s", "frequency_Hz"):
        if name in columns:
            columns[name] = columns[name] * 10.0 ** float(rng.choice([-9, -6, -3, -1, 1, 3, 6, 9]))


def _shifted_clock(rng: Rng, columns: Columns) -> None:
    if "time_s" in columns:
        columns["time_s"] = columns["time_s"] + float(rng.choice([1e3, -5.0, 1e9]))


def _jitter(rng: Rng, columns: Columns) -> None:
    if "time_s" in columns:
        time = columns["time_s"]
        step = float(np.ptp(time)) / max(len(time) - 1, 1)
        columns["time_s"] = time + step * float(rng.choice([1e-4, 0.1, 2.0])) * rng.standard_normal(len(time))


def _twice(rng: Rng, columns: Columns) -> None:
    columns[_column(rng, columns)] = columns[_column(rng, columns)].copy()


def _one_period(rng: Rng, columns: Columns) -> None:
    count = max(len(next(iter(columns.values()))) // int(rng.integers(10, 40)), 3)
    for name in columns:
        columns[name] = columns[name][-count:]


def _idle(rng: Rng, columns: Columns) -> None:
    """A record in which nothing happens but noise, or nothing at all."""
    share = float(rng.choice([0.0, 1e-6, 1e-3]))
    for name, values in columns.items():
        if name not in ("time_s", "frequency_Hz"):
            columns[name] = share * np.abs(values).max() * rng.standard_normal(len(values))


def _clip(rng: Rng, values: np.ndarray) -> np.ndarray:
    limit = rng.uniform(0.01, 0.9) * np.abs(values).max()
    return np.clip(values, -limit, limit if rng.random() < 0.5 else None)


def _quantised(rng: Rng, values: np.ndarray) -> np.ndarray:
    step = 2.0 * np.abs(values).max() / 2.0 ** float(rng.integers(1, 9)) or 1.0
    return step * np.round(values / step)


OF_RECORDS: dict[str, Callable[[Rng, Columns], None]] = {
    "gap": _gap,
    "cells that are no numbers": _set(_nan),
    "constant channel": _set(lambda rng, v: np.full_like(v, float(rng.choice([0.0, 1.0, v[0]])))),
    "clipped": _set(_clip),
    "few samples": _short,
    "one period": _one_period,
    "begins late": _late,
    "another sample rate": _thinned,
    "another clock": _other_clock,
    "clock begins elsewhere": _shifted_clock,
    "jitter": _jitter,
    "offset": _set(lambda rng, v: v + float(rng.choice([1.0, 1e3, -1e6])) * (np.abs(v).max() or 1.0)),
    "no drive": _set(lambda rng, v: 0.0 * v),
    "unit": _set(lambda rng, v: v * float(rng.choice([1e-6, 1e-3, 1e3, 1e6]))),
    "sign": _set(lambda rng, v: -v),
    "the same channel twice": _twice,
    "few bits": _set(_quantised),
    "drop-out": _set(_drop_out),
    "nothing happens": _idle,
    "spikes": _set(lambda rng, v: v + 1e2 * np.abs(v).max() * (rng.random(len(v)) < 0.01)),
    "drift": _set(lambda rng, v: v + float(rng.choice([1e-2, 10.0])) * np.abs(v).max() * np.linspace(0, 1, len(v))),
    "reversed": _set(lambda rng, v: v[::-1].copy()),
    "noise": _set(lambda rng, v: np.abs(v).max() * rng.standard_normal(len(v))),
    "missing channel": lambda rng, c: c.pop(_column(rng, c)) if len(c) > 2 else None,
}  # fmt: skip


def _absurd(rng: Rng, tables: Tables) -> None:
    name = str(rng.choice([name for name, value in tables["transducer"].items() if isinstance(value, float)]))
    tables["transducer"][name] *= 10.0 ** float(rng.choice([-12, -6, -3, -1, 1, 3, 6, 12]))


def _spots(rng: Rng, tables: Tables) -> None:
    """Effects of the file on a bound, at their null value, or at a number out of the blue."""
    library = sorted(name for name, cls in registered().items() if cls.__module__.startswith("piezoharvest."))
    for name in rng.choice(library, int(rng.integers(1, 4)), replace=False):
        found = {}
        for field in dataclasses.fields(registered()[str(name)]):
            meta = field.metadata
            spots = [meta.get(key) for key in ("at_least", "at_most", "null", "above", "below")]
            spots = [float(spot) for spot in spots if isinstance(spot, int | float)]
            if "unit" in meta and field.init:
                found[field.name] = float(rng.choice([*spots, 10.0 ** rng.uniform(-12, 12)]))
            elif field.name == "channel":
                found[field.name] = str(rng.choice(["force", "displacement", "voltage", "current"]))
        tables["transducer"].setdefault("effects", {})[str(name)] = found


def _unknown_mass(rng: Rng, tables: Tables) -> None:
    for key in ("mass", "damping"):
        tables["transducer"].pop(key, None)
    tables["transducer"] |= {"quasi_static": True} if rng.random() < 0.5 else {"mass": "unknown", "damping": "unknown"}


def _hysteresis(rng: Rng, tables: Tables) -> None:
    """Operators that the specimen has not, of any size."""
    count = int(rng.integers(1, 6))
    tables["transducer"]["hysteresis"] = {
        "thresholds": sorted(10.0 ** rng.uniform(-12, -3, count)),
        "weights": list(10.0 ** rng.uniform(2, 10, count)),
    }


def _mode(rng: Rng, tables: Tables) -> None:
    first = tables["transducer"]
    if isinstance(first.get("mass"), float) and isinstance(first.get("damping"), float):
        factor = float(rng.choice([0.5, 1.0, 9.0, 1e6]))
        first["modes"] = [{key: factor * first[key] for key in ("mass", "damping", "stiffness", "coupling")}]


def _sigma(rng: Rng, tables: Tables) -> None:
    for name in rng.choice(["force", "displacement", "voltage", "current"], int(rng.integers(1, 5)), replace=False):
        units = {"force": "N", "displacement": "m", "voltage": "V", "current": "A"}
        columns = {"force": "force_N", "displacement": "displacement_m", "voltage": "voltage_V", "current": "current_A"}
        table = {"column": columns[name], "unit": units[name], "sigma": 10.0 ** rng.uniform(-15, 3)}
        if rng.random() < 0.3:
            table |= {"gain": float(rng.choice([-1.0, 1e-3, 1e6])), "offset": float(rng.choice([0.0, 1.0, -1e3]))}
        tables.setdefault("channels", {})[str(name)] = table


def _wrong_key(rng: Rng, tables: Tables) -> None:
    holder = tables["transducer"] if rng.random() < 0.5 else rng.choice(tables["records"])
    holder.pop(str(rng.choice(sorted(holder))))


def _other_drive(rng: Rng, tables: Tables) -> None:
    entry = rng.choice(tables["records"])
    entry["drive"] = str(rng.choice(["voltage", "displacement", "base_acceleration", "force"]))
    if rng.random() < 0.3:
        entry.pop("load_resistance", entry.pop("shunt", None))


def _fit(rng: Rng, tables: Tables) -> None:
    """Values of circuits that are fitted: any of their numbers."""
    for entry in tables["records"]:
        numbers = [key for key, value in entry.get("shunt", {}).items() if isinstance(value, float)]
        if numbers and rng.random() < 0.7:
            entry["shunt"]["fit"] = [str(key) for key in rng.choice(numbers, min(len(numbers), 2), replace=False)]


def _label(rng: Rng, tables: Tables) -> None:
    """Labels of loads and circuits that are not what was connected."""
    for entry in tables["records"]:
        for holder in (entry, entry.get("shunt", {})):
            for key, value in holder.items():
                if isinstance(value, float) and key not in ("start_time", "frequency") and rng.random() < 0.4:
                    holder[key] = value * 10.0 ** float(rng.choice([-6, -3, -1, 0.1, 1, 3, 6]))


def _starts(rng: Rng, tables: Tables) -> None:
    for entry in tables["records"]:
        entry["start_time"] = float(rng.choice([0.0, -1.0, 1e6, 1.0, 1e-9]))


def _specimens(rng: Rng, tables: Tables) -> None:
    """Each record is of a specimen of its own, or records are shared out."""
    records = tables.pop("records")
    cut = int(rng.integers(1, len(records))) if len(records) > 1 else 1
    groups = [group for group in (records[:cut], records[cut:]) if group]
    groups = groups if len(groups) > 1 else [records, [dict(each) for each in records]]
    tables["specimens"] = [{"records": group} for group in groups]
    if rng.random() < 0.5:
        tables["specimens"][0]["transducer"] = {"capacitance": 10.0 ** rng.uniform(-12, -3)}


def _rows(rng: Rng, tables: Tables) -> None:
    entry = rng.choice(tables["records"])
    first = int(rng.integers(1, 200))
    entry["rows"] = [first, first + int(rng.integers(1, 300))]


def _all_validate(rng: Rng, tables: Tables) -> None:
    for entry in tables["records"]:
        entry["role"] = "validate"


def _periodic(rng: Rng, tables: Tables) -> None:
    for entry in tables["records"]:
        if "kind" not in entry and rng.random() < 0.6:
            entry["kind"] = "periodic"


def _experiment(rng: Rng, tables: Tables) -> None:
    size = 10.0 ** rng.uniform(-6, 6)
    tables["experiment"] = {"drive": [-size, size], "duration": 10.0 ** rng.uniform(-3, 3), "loads": [1.0, 1e5]}


def _copies(rng: Rng, tables: Tables) -> None:
    """A record that is given twice, perhaps in the other role."""
    entry = dict(rng.choice(tables["records"]))
    tables["records"].append({**entry, "role": str(rng.choice(["fit", "validate"]))})


OF_TABLES: dict[str, Callable[[Rng, Tables], Any]] = {
    "absurd nominal value": _absurd, "effects on their bounds": _spots, "unknown mass": _unknown_mass,
    "hysteresis": _hysteresis, "a mode": _mode, "sigma": _sigma, "a key is missing": _wrong_key,
    "another drive": _other_drive, "fit": _fit, "wrong label": _label, "start times": _starts, "rows": _rows,
    "nothing to fit": _all_validate, "periodic": _periodic, "experiment": _experiment, "a record twice": _copies,
}  # fmt: skip


def damage(rng: Rng, tables: Tables, files: dict[str, Columns]) -> list[str]:
    """Damage a campaign in place; what was done to it."""
    done = []
    for _ in range(int(rng.choice([0, 0, 1, 1, 2]))):
        name, what = str(rng.choice(sorted(files))), str(rng.choice(sorted(OF_RECORDS)))
        if len(files[name]) > 1 and all(map(len, files[name].values())):
            OF_RECORDS[what](rng, files[name])
            done.append(what)
    for _ in range(int(rng.choice([0, 0, 1, 1, 2]))):
        what = str(rng.choice(sorted(OF_TABLES)))
        OF_TABLES[what](rng, tables)
        done.append(what)
    if rng.random() < 0.1:
        _specimens(rng, tables)
        done.append("specimens")
    return done
