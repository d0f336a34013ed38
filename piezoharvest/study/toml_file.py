"""TOML files, read with care: what is wrong with one is said in one sentence."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from piezoharvest.description.parameters import ParameterError
from piezoharvest.input import InputError, check_readable
from piezoharvest.study.words import shortened

MAX_TOML_BYTES = 1 << 22  # bytes: tomllib takes about a second for 2 MB; a study of a thousand lines has 40 kB

# tomllib takes time in proportion to the square of a key's parts: 16 s for 20,000 of them; our tables need few.
_MAX_KEY_PARTS = 100

_NETLISTS = (".asc", ".cir", ".net", ".sp", ".spice", ".ckt")
_LONG_KEY = re.compile(rf"""(?<![\w"'-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_MAX_KEY_PARTS}}}""")


class StudyError(ValueError):
    """An error in a study file, in one sentence: file, key path, what was found, what is allowed.

    Attributes
    ----------
    path, key, message : str
        The three parts; the key is a dotted path as in "shunts.0.load_resistance", empty for the whole file.
    """

    def __init__(self, path: str | Path, key: str, message: str):
        text = ": ".join(shortened(part) for part in (str(path), key, message) if part)
        super().__init__("".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text))
        self.path, self.key, self.message = str(path), key, message


# Tables that only one kind of file has, and what takes it.
_KINDS = {
    "campaign": (
        {"records", "channels", "specimens", "experiment"},
        "a campaign of measured records, for identify, diagnose and plan",
    ),
    "study": (
        {"excitation", "shunts", "design", "sweep", "bench"},
        "a study, for simulate, design, sweep, measure and export",
    ),
    "specimen": (
        {"standard_errors", "covariance", "source"},
        'an identified specimen, which a study or campaign uses by transducer = "FILE"',
    ),
}


def check_kind_of_file(table: Mapping[str, Any], wanted: str) -> None:
    """Raise `ParameterError` if the tables of a file are those of another kind of file.

    Parameters
    ----------
    table : mapping
    wanted : "campaign", "study" or "specimen"

    Raises
    ------
    ParameterError
        A table of another kind is there, and none of the wanted kind; its key is empty.
    """
    if _KINDS[wanted][0] & set(table):
        return
    for kind, (tables, what) in _KINDS.items():
        if kind != wanted and tables & set(table):
            raise ParameterError("", f"found {what}, but a {wanted} is needed")


def read_toml(path: Path) -> dict[str, Any]:
    """Tables of a TOML file.

    Raises
    ------
    StudyError
        The file cannot be read, is too large, is not UTF-8 or not TOML.
    """
    text = ""
    try:
        check_readable(path, MAX_TOML_BYTES)
        text = path.read_bytes().decode("utf-8-sig")
        if _LONG_KEY.search(text):
            raise ValueError(f"a key of more than {_MAX_KEY_PARTS} parts")
        return tomllib.loads(text)
    except InputError as error:
        raise StudyError(path, "", str(error)) from None
    except OSError as error:
        raise StudyError(path, "", f"the file cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        found = f"found byte {error.object[error.start]:#04x} at offset {error.start}"
        raise StudyError(
            path, "", _of_another_kind(path) or f"{found}, but a TOML file must be text in UTF-8"
        ) from None
    except (ValueError, RecursionError) as error:  # ValueError: a syntax error, or a number of thousands of digits
        what = "tables nested too deeply" if isinstance(error, RecursionError) else str(error)
        if what.startswith(("Cannot overwrite", "Cannot declare")):  # as where a study has a file and a table, too
            what = f"a key or table is given twice ({what})"
        message = _of_another_kind(path) or _decimal_comma(text, what) or f"not a valid TOML file: {what}"
        raise StudyError(path, "", message) from None


def _decimal_comma(text: str, what: str) -> str:
    """What is wrong with the line of a syntax error, if that is a number with a comma; else ""."""
    place = re.search(r"at line (\d+)", what)
    line = text.splitlines()[int(place[1]) - 1].strip() if place and int(place[1]) <= len(text.splitlines()) else ""
    found = re.match(r"[^=]*=\s*([+-]?\d+,\d+)\s*(#|$)", line)
    return f"line {place[1]}: found {found[1]}, must have a decimal point, not a comma" if place and found else ""


def _of_another_kind(path: Path) -> str:
    """What a file is by its ending that is no TOML, and what begins a TOML file with it; "" if no such thing."""
    from piezoharvest.readers import registered  # here: only an error needs it

    ending = path.suffix.lower()
    if ending in _NETLISTS:
        return "found a netlist, but a TOML file is needed: piezoharvest import makes a shunt of it, for a study"
    if ending in registered():
        needed = "a TOML file that describes it is needed"
        return f"found a data file, but {needed}: piezoharvest new campaign {path.name} writes one"
    return ""
