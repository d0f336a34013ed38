"""The specimen file: transducer with effects and hysteresis, standard errors, covariance, source of the data."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from piezoharvest.counting import counted
from piezoharvest.description.effects import Effect, registered
from piezoharvest.description.effects.nameless.kinds import in_a_path
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.paths import component_table, found_at
from piezoharvest.description.transducer import INERT, Transducer
from piezoharvest.input import InputError, check_readable
from piezoharvest.notebook import Shown
from piezoharvest.output import write_text
from piezoharvest.study import MAX_TOML_BYTES, StudyError, build_effect, build_transducer, read_specimen
from piezoharvest.study import unknown as unknown_name

SCALINGS = ("linear", "log", "reciprocal")  # what of a value is normally distributed: itself, its logarithm, 1/value
# Relative size of a negative eigenvalue, and of an asymmetry, that is rounding of the 17 digits in a file.
_ROUNDING = 1e-9
_HEAD = '# An identified specimen, written by piezoharvest; a study uses it by transducer = "this file".\n'


@dataclass(frozen=True, eq=False, repr=False)
class Specimen(Shown):
    """Identified specimen.

    Attributes
    ----------
    values : mapping of str to float
        Values that were identified, by dotted path in the transducer ("effects.leakage.resistance"); SI units. Their
        order is that of the covariance.
    covariance : (p, p) array
        Of these values, in the products of their units.
    scaling : tuple of str
        For each value one of `SCALINGS`.
    transducer : Transducer or None
        None in a file that only lists parameters (the JSON output of `identify`).
    lacking : mapping of str to str
        Parameters that the records do not determine, which are at their nominal values, with the measurement that
        would tell them.
    measurement : tuple of Effect
        Effects found that belong to sensors and labels, not to the specimen.
    unknown : tuple of str
        Mass and damping, where they have no value at all.
    source : mapping
        Campaign, files with their SHA-256, command, version, date.
    """

    values: Mapping[str, float]
    covariance: np.ndarray
    scaling: tuple[str, ...]
    transducer: Transducer | None
    lacking: Mapping[str, str] = field(default_factory=dict)
    measurement: tuple[Effect, ...] = ()
    unknown: tuple[str, ...] = ()
    source: Mapping[str, Any] = field(default_factory=dict)

    @property
    def heading(self) -> str:
        """How many values were identified, and which parameters the records do not determine."""
        count = len(self.values)
        found = f"{count} identified value{'' if count == 1 else 's'}"
        left = (*self.lacking, *self.unknown)
        return f"{found}, {len(left)} not identifiable" if left else found

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The parameters, one a row, those that the records do not determine last."""
        device, errors = self.transducer, self.errors
        return [
            *({"parameter": name, "value": value, "std": errors[name],
               "unit": "" if device is None else found_at(device, name)[1].metadata["unit"], "identifiable": True}
              for name, value in self.values.items()),
            *({"parameter": name, "identifiable": False} for name in (*self.lacking, *self.unknown)),
        ]  # fmt: skip

    @property
    def errors(self) -> Mapping[str, float]:
        """Standard errors by path."""
        return dict(zip(self.values, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


def write_specimen(specimen: Specimen, path: str | Path, title: str = "") -> None:
    """Write a specimen as TOML, completely or not at all.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    write_text(_HEAD + tomli_w.dumps(_table(specimen, title)), path)


def _table(specimen: Specimen, title: str) -> dict[str, Any]:
    assert specimen.transducer is not None
    transducer = component_table(specimen.transducer)
    transducer = {key: value for key, value in transducer.items() if key not in ("quasi_static", *specimen.unknown)}
    found: dict[str, Any] = {
        "title": title,
        "transducer": transducer | ({"quasi_static": True} if specimen.unknown else {}),
        "standard_errors": dict(specimen.errors),
        "covariance": {
            "parameters": list(specimen.values),
            "scaling": list(specimen.scaling),
            "matrix": specimen.covariance.tolist(),
        },
    }
    if specimen.lacking:
        found["not_identifiable"] = {name: {"told_by": text} for name, text in specimen.lacking.items()}
    if specimen.measurement:
        found["measurement"] = [
            {"name": in_a_path(each.name), **component_table(each)} for each in specimen.measurement
        ]
    return {**found, "source": dict(specimen.source)} if specimen.source else found


def load_specimen(path: str | Path) -> Specimen:
    """Read and check a specimen file: TOML, or the JSON output of `identify` or `diagnose`, which has no covariance.

    Raises
    ------
    StudyError
        The file cannot be read, or something in it is missing, unknown or inconsistent.
    """
    path = Path(path)
    if path.suffix.lower() == ".json":
        return _listed(_json(path), path)
    table = read_specimen(path)
    if "parameters" in table:
        return _listed(table, path)
    try:
        return _specimen(table)
    except ParameterError as error:
        raise StudyError(path, error.key, error.message) from None


def _specimen(table: Mapping[str, Any]) -> Specimen:
    transducer, unknown = _transducer(table["transducer"])
    errors = _numbers(table.get("standard_errors", {}), "standard_errors", least=0.0)
    values = {}
    for name in errors:
        try:
            values[name] = found_at(transducer, name)[0]
        except KeyError:
            raise ParameterError(f"standard_errors.{name}", "the transducer of the file has no such number") from None
    covariance, scaling = np.diag(np.square(list(errors.values()))), ("linear",) * len(errors)
    if "covariance" in table:
        covariance, scaling = _covariance(table["covariance"], errors)
    lacking, measurement = _lacking(table.get("not_identifiable", {})), _measurement(table.get("measurement", []))
    return Specimen(values, covariance, scaling, transducer, lacking, measurement, unknown, table.get("source", {}))


def _transducer(table: Any) -> tuple[Transducer, tuple[str, ...]]:
    """Transducer, and which of mass and damping a quasi-static one has no value of: any number stands in for them."""
    if not isinstance(table, Mapping) or table.get("quasi_static") is not True:
        return build_transducer(table), ()
    unknown = tuple(name for name in INERT if name not in table)
    return build_transducer({**table, **dict.fromkeys(unknown, 1.0)}), unknown


def _measurement(tables: Any) -> tuple[Effect, ...]:
    """Effects of sensors and labels from their tables."""
    if not isinstance(tables, list) or not all(isinstance(table, Mapping) for table in tables):
        raise ParameterError("measurement", f"found {tables!r:.60}, must be a list of tables")
    known, found = registered(), []
    for n, table in enumerate(tables):
        where, name = f"measurement.{n}", table.get("name")
        if not isinstance(name, str) or (name not in known and "place" not in table):
            raise unknown_name(f"{where}.name", name, known)
        found.append(build_effect(name, {key: value for key, value in table.items() if key != "name"}, where))
    return tuple(found)


def _lacking(table: Any) -> dict[str, str]:
    """Parameters that are not identifiable, with the measurement that would tell them."""
    if not isinstance(table, Mapping) or not all(isinstance(row, Mapping) for row in table.values()):
        raise ParameterError("not_identifiable", f"found {table!r:.60}, must be a table for each parameter")
    return {name: str(row.get("told_by", "")) for name, row in table.items()}


def _covariance(table: Any, errors: Mapping[str, float]) -> tuple[np.ndarray, tuple[str, ...]]:
    """Covariance in the order of the standard errors, and scaling."""
    if not isinstance(table, Mapping) or not {"parameters", "matrix"} <= set(table):
        raise ParameterError("covariance", "missing parameters or matrix, a covariance needs both")
    names = table["parameters"]
    if not isinstance(names, list) or sorted(map(str, names)) != sorted(errors):
        raise ParameterError("covariance.parameters", f"found {names!r:.80}, allowed are those of [standard_errors]")
    try:
        matrix = np.array(table["matrix"], float).reshape(len(names), len(names))
    except (TypeError, ValueError):
        raise ParameterError(
            "covariance.matrix",
            f"allowed are {counted(len(names), 'row')} of {counted(len(names), 'number')}, one for each parameter",
        ) from None
    size = np.sqrt(np.abs(np.diag(matrix))) + 1e-300
    relative = matrix / np.outer(size, size)
    symmetric = np.all(np.isfinite(matrix)) and np.abs(relative - relative.T).max(initial=0.0) < _ROUNDING
    if not symmetric or np.linalg.eigvalsh(relative).min(initial=0.0) < -_ROUNDING * max(len(names), 1):
        raise ParameterError("covariance.matrix", "this is not a covariance: allowed is a symmetric matrix whose "
                             "eigenvalues are at least 0")  # fmt: skip
    scaling = table.get("scaling", ["linear"] * len(names))
    if not isinstance(scaling, list) or len(scaling) != len(names) or not set(scaling) <= set(SCALINGS):
        raise ParameterError("covariance.scaling", f"allowed are {len(names)} of {', '.join(SCALINGS)}")
    order = [names.index(name) for name in errors]
    return matrix[np.ix_(order, order)], tuple(scaling[n] for n in order)


def _listed(table: Mapping[str, Any], path: Path) -> Specimen:
    """Specimen of a table `parameters` with value and std of each."""
    rows = table.get("parameters")
    if not isinstance(rows, Mapping):
        raise StudyError(path, "parameters", "missing table, the file must be written by `identify --save` or `--json`")
    rows = {name: row for name, row in rows.items() if isinstance(row, Mapping)}
    told = {name: row for name, row in rows.items() if row.get("std") is not None}
    try:
        values = _numbers({name: row.get("value") for name, row in told.items()}, "parameters")
        errors = _numbers({name: row["std"] for name, row in told.items()}, "parameters", least=0.0)
    except ParameterError as error:
        raise StudyError(path, error.key, error.message) from None
    lacking = {name: str(row.get("experiment", "")) for name, row in rows.items() if name not in told}
    return Specimen(values, np.diag(np.square(list(errors.values()))), ("linear",) * len(values), None, lacking)


def _numbers(table: Any, where: str, least: float = -np.inf) -> dict[str, float]:
    """Table of finite numbers."""
    if not isinstance(table, Mapping):
        raise ParameterError(where, f"found {table!r:.60}, must be a table of numbers")
    for name, value in table.items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not np.isfinite(value) or value < least:
            allowed = "a finite number" + (" of at least 0" if least == 0 else "")
            raise ParameterError(f"{where}.{name}", f"found {value!r:.60}, must be {allowed}")
    return {name: float(value) for name, value in table.items()}


def _json(path: Path) -> Mapping[str, Any]:
    try:
        check_readable(path, MAX_TOML_BYTES)
        table = json.loads(path.read_text(encoding="utf-8-sig"))
    except InputError as error:
        raise StudyError(path, "", str(error)) from None
    except (OSError, ValueError, RecursionError) as error:
        raise StudyError(path, "", f"the file cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if not isinstance(table, dict):
        raise StudyError(path, "", "this is not a table, the file must be one that `identify --json` prints")
    return table
