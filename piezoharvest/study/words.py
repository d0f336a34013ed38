"""Words of messages: what was found at a key, and names that were meant."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

from piezoharvest.description.parameters import ParameterError
from piezoharvest.near_names import did_you_mean

_T = TypeVar("_T")

WORDS: dict[Any, str] = {str: "a string", bool: "true or false", list: "a list of tables", dict: "a table"}


def typed(wanted: type[_T], value: Any, where: str) -> _T:
    """The value, which must be of a type that TOML has."""
    if not isinstance(value, wanted):
        allowed = f"{WORDS[wanted]}{_brackets(wanted, value, where)}"
        raise ParameterError(where, f"found {shown_value(value)}, must be {allowed}")
    return value


def _brackets(wanted: type, value: Any, where: str) -> str:
    """How a table is written, where one was given as a list of tables or the other way round."""
    name = ".".join(part for part in where.split(".") if not part.isdigit())
    if wanted is dict and isinstance(value, list) and value and isinstance(value[0], dict):
        return f", written as [{name}], not [[{name}]]"
    return f", written as [[{name}]], not [{name}]" if wanted is list and isinstance(value, dict) else ""


def unknown(key: str, name: Any, known: Iterable[str], what: str = "") -> ParameterError:
    """Error for an unknown name, with the known ones that are similar; `what` is named by a key ("key", "effect")."""
    names = sorted(known)
    hint = did_you_mean(name, names)
    found = f"unknown {what}{hint}, known {what}s" if what else f"found {shown_value(name)}{hint}, allowed"
    return ParameterError(key, f"{found} are {', '.join(names) or 'none'}")


def not_in_catalogue(key: str, name: Any, known: Iterable[str]) -> ParameterError:
    """Error for a name that the catalogue does not have, with similar ones instead of all of them."""
    found = f"found {shown_value(name)}{did_you_mean(name, known)}"
    return ParameterError(key, f"{found}, must be a name that `piezoharvest catalogue` lists")


def shortened(text: str, most: int = 450) -> str:
    """A part of a message, which may be arbitrarily long in a file, shortened between two words where it has some."""
    if len(text) <= most:
        return text
    head, tail = text[: most - 150], text[-145:]
    head, tail = head.rpartition(" ")[0] or head, tail.partition(" ")[2] or tail
    return f"{head} ... {tail}"


def shown_value(value: Any) -> str:
    """A value as shown in a message, shortened."""
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 80 else f"{text[:60]}..."
