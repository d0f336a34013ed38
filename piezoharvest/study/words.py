"""Words of messages: what was found at a key, and names that were meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any, TypeVar

from piezoharvest.description.parameters import ParameterError

_T = TypeVar("_T")

WORDS: dict[Any, str] = {str: "a string", bool: "true or false", list: "a list of tables", dict: "a table"}


def typed(wanted: type[_T], value: Any, where: str) -> _T:
    """The value, which must be of a type that TOML has."""
    if not isinstance(value, wanted):
        raise ParameterError(where, f"found {shown_value(value)}, must be {WORDS[wanted]}")
    return value


def unknown(key: str, name: Any, known: Iterable[str], what: str = "") -> ParameterError:
    """Error for an unknown name, with the most similar known one; `what` is named by a key ("key", "effect")."""
    names = {right.lower(): right for right in sorted(known)}
    near = difflib.get_close_matches(str(name)[:100].lower(), names, n=1)
    hint = f" (did you mean {names[near[0]]!r}?)" if near else ""
    found = f"unknown {what}{hint}, known {what}s" if what else f"found {shown_value(name)}{hint}, allowed"
    return ParameterError(key, f"{found} are {', '.join(names.values())}")


def shortened(text: str, most: int = 450) -> str:
    """A part of a message, which may be arbitrarily long in a file, shortened."""
    return text if len(text) <= most else f"{text[: most - 150]} ... {text[-145:]}"


def shown_value(value: Any) -> str:
    """A value as shown in a message, shortened."""
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 80 else f"{text[:60]}..."
