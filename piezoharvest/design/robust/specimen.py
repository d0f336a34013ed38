"""Intervals from a specimen file: two standard errors of each identified parameter."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.tolerance import Tolerance
from piezoharvest.input import InputError, check_readable
from piezoharvest.study import MAX_TOML_BYTES, StudyError, read_toml

_ERRORS = 2.0  # standard errors: 95 % of a normal distribution
NAMES = ("stiffness", "mass", "damping", "coupling", "capacitance")
_KEY = "design.tolerance.from"


def widened(tolerance: Tolerance) -> Tolerance:
    """The tolerance with the half-widths of its specimen file, where it names one, in the place of absent ones.

    The file is what `identify` gives: a table `parameters` with `value` and `std` of each (its JSON output, or the same
    as TOML), or tables [transducer] and [standard_errors]. A half-width is two standard errors over the value.

    Raises
    ------
    ParameterError
        The file cannot be read, has none of the parameters, or no standard error of one.
    """
    if tolerance.from_ is None:
        return tolerance
    path = Path(tolerance.from_)
    own = {name for name in NAMES if getattr(tolerance, name) is not None}
    found = {}
    for name, (value, error) in _estimates(path).items():
        if name not in own:
            found[name] = _half_width(path, name, value, error)
    if not found and not own:
        raise ParameterError(_KEY, f"{path.name} holds none of {', '.join(NAMES)}, at least one is needed")
    return dataclasses.replace(tolerance, **found)


def _estimates(path: Path) -> dict[str, tuple[Any, Any]]:
    """Value and standard error of each parameter in the file."""
    table = _table(path)
    listed = table.get("parameters")
    if isinstance(listed, Mapping):
        rows = {name: row for name, row in listed.items() if name in NAMES and isinstance(row, Mapping)}
        return {name: (row.get("value"), row.get("std")) for name, row in rows.items()}
    values, errors = table.get("transducer"), table.get("standard_errors")
    if not isinstance(values, Mapping):
        raise ParameterError(_KEY, f"{path.name} has neither a table parameters nor a table transducer, one is needed")
    errors = errors if isinstance(errors, Mapping) else {}
    return {name: (values[name], errors.get(name)) for name in NAMES if name in values}


def _half_width(path: Path, name: str, value: Any, error: Any) -> float:
    if not _number(value) or value == 0:
        raise ParameterError(_KEY, f"{path.name} has {value!r} as {name}, allowed is a number other than 0")
    if not _number(error) or error < 0:
        lacks = "no standard error" if error is None else f"the standard error {error!r}"
        remedy = f"allowed is a number of at least 0 there, or a half-width {name} in [design.tolerance]"
        raise ParameterError(_KEY, f"{path.name} has {lacks} of {name}, {remedy}")
    width = _ERRORS * float(error) / abs(float(value))
    if not width < 1:
        raise ParameterError(_KEY, f"{path.name} leaves {name} open: 2 standard errors are {width:.3g} of the value, "
                                   f"allowed is less than 1, or a half-width {name} in [design.tolerance]")  # fmt: skip
    return width


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf")


def _table(path: Path) -> Mapping[str, Any]:
    """Content of the file, TOML or JSON."""
    try:
        if path.suffix.lower() != ".json":
            return read_toml(path)
        check_readable(path, MAX_TOML_BYTES)
        table = json.loads(path.read_text(encoding="utf-8-sig"))
    except StudyError as error:
        raise ParameterError(_KEY, f"{path.name}: {error.message}") from None
    except (InputError, OSError, ValueError, RecursionError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise ParameterError(_KEY, f"{path.name}: the file cannot be read ({why})") from None
    if not isinstance(table, dict):
        raise ParameterError(_KEY, f"{path.name} is not a table, allowed is what `identify --json` prints")
    return table
