"""The table [transducer]: written out, from the catalogue, from figures, or a specimen file in its place."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from piezoharvest.description import catalogue
from piezoharvest.description.figures import Lumped, Modal, data_sheet, data_sheet_keys
from piezoharvest.description.modes_file import KEY, with_modes
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.transducer import Transducer
from piezoharvest.study.building import build
from piezoharvest.study.toml_file import StudyError, check_kind_of_file, read_toml
from piezoharvest.study.words import not_in_catalogue, typed, unknown

_SPECIMEN_TABLES = (
    "title", "transducer", "standard_errors", "covariance", "not_identifiable", "measurement", "source", "parameters",
)  # fmt: skip


_FIGURES = {"modal", "datasheet"}  # tables from which the values of a transducer follow


def build_transducer(table: Any, where: str = "transducer") -> Transducer:
    """Transducer from its table; with `catalogue`, further keys override the entry's (tables key by key)."""
    table = dict(typed(dict, table, where))
    if "catalogue" in table:
        name = table.pop("catalogue")
        if not isinstance(name, str) or name not in catalogue.names():
            raise not_in_catalogue(f"{where}.catalogue", name, catalogue.names())
        for key in sorted(_FIGURES & set(table)):
            raise ParameterError(f"{where}.{key}", "found together with catalogue, only one of the two may be given")
        table = catalogue.merged(_with_figures(catalogue.transducer_table(name), where), table)
    for key in _FIGURES & set(table):
        for twice in (name for name in Lumped._fields if name in table and name != "damping"):
            found = f"found together with a table {key}, from which it follows: remove one of the two"
            raise ParameterError(f"{where}.{twice}", found)
    known = {*(field.name for field in dataclasses.fields(Transducer)), *_FIGURES, "catalogue", KEY}
    for key in table:
        if key not in known:
            raise unknown(f"{where}.{key}", key, known, "key")
    return build(Transducer, _with_figures(table, where), where)


def from_catalogue(name: str, **values: Any) -> Transducer:
    """Transducer of the catalogue; `piezoharvest catalogue` lists them, with their sources.

    Parameters
    ----------
    name : str
    **values
        Fields of the transducer that are not those of the catalogue, as keys of the table [transducer].

    Raises
    ------
    ParameterError
        There is no such transducer, or a value does not fit.

    Examples
    --------
    >>> from piezoharvest import from_catalogue
    >>> from_catalogue("NAC2125-H10", damping=900.0).stiffness
    312500000.0
    """
    return build_transducer({**values, "catalogue": name})


def _with_figures(table: dict[str, Any], where: str) -> dict[str, Any]:
    """Table of a transducer, with the values that follow from its table `modal` or `datasheet`, if it has one.

    A damping in the table itself goes before the one that follows.
    """
    given = [key for key in ("modal", "datasheet") if key in table]
    if len(given) == 2:
        raise ParameterError(
            f"{where}.datasheet", "found together with a table modal, only one of the two may be given"
        )
    if not given:
        return table
    place = f"{where}.{given[0]}"
    figures = typed(dict, table.pop(given[0]), place)
    for key in figures if given[0] == "datasheet" else ():
        if key not in (known := data_sheet_keys()):
            raise unknown(f"{place}.{key}", key, known, "key")
    try:
        kind, figures = (Modal, figures) if given[0] == "modal" else data_sheet(figures)
        found = build(kind, figures, place).lumped()
    except ParameterError as error:
        if error.key.startswith(where):
            raise
        raise ParameterError(place if error.key == given[0] else f"{place}.{error.key}", error.message) from None
    follows = {key: list(value) if isinstance(value, tuple) else value for key, value in found._asdict().items()}
    return {**follows, **table}


def transducer_of(value: Any, folder: Path) -> tuple[Transducer, Path | None]:
    """Transducer of a study, from its table or a specimen file in its place, and that file, if it is from one."""
    table = transducer_table(value, folder)
    if not isinstance(value, str):
        return build_transducer(table), None
    try:
        if typed(dict, table, "transducer").get("quasi_static") is True:
            lacks = "found a quasi-static specimen, whose mass and damping are not known"
            raise ParameterError("transducer.quasi_static", f"{lacks}: give both there and remove quasi_static")
        return build_transducer(table), folder / value
    except ParameterError as error:
        raise ParameterError("transducer", f"{value}: {error}") from None


def transducer_table(value: Any, folder: Path) -> Any:
    """Table of a transducer, with what files say in it: a specimen file in its place, or one of modes, in `folder`.

    Raises
    ------
    ParameterError
        A file cannot be read, or is none of this kind. The table is not checked.
    """
    if isinstance(value, dict) and KEY in value:
        try:
            return with_modes(value, folder)
        except ParameterError as error:
            raise error.within("transducer") from None
    if not isinstance(value, str):
        return value
    try:
        table = read_specimen(folder / value)
    except StudyError as error:
        inner = f"{error.key}: {error.message}" if error.key else error.message
        raise ParameterError("transducer", f"{value}: {inner}") from None
    if "parameters" in table:
        raise ParameterError(
            "transducer", f"{value}: parameters: found only a list, a study needs what `identify --save` writes"
        )
    return table["transducer"]


def read_specimen(path: Path) -> dict[str, Any]:
    """Tables of a specimen file, whose contents are not checked.

    Raises
    ------
    StudyError
        The file cannot be read, has a table that is unknown, or neither [transducer] nor [parameters].
    """
    table = read_toml(path)
    try:
        check_kind_of_file(table, "specimen")
    except ParameterError as error:
        raise StudyError(path, "", error.message) from None
    for key in table:
        if key not in _SPECIMEN_TABLES:
            wrong = unknown(key, key, _SPECIMEN_TABLES, "key")
            raise StudyError(path, wrong.key, wrong.message)
    if "transducer" not in table and "parameters" not in table:
        raise StudyError(path, "transducer", "missing table [transducer], which a specimen file needs")
    return table
