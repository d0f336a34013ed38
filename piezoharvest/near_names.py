"""Which known name a misspelt one is likely to mean, for messages."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_LEAST_PART = 3  # letters of a part of a name that tell which one is meant
_SURE = 0.8  # similarity from which a name with the given part in it is the only one offered
_MOST = 3  # names that a message offers
_LONGEST = 100  # letters that are compared: a file may have a name of any length


def near_names(name: object, known: Iterable[str]) -> list[str]:
    """The known names that are likely meant: of another case, with the given part in them, or of similar spelling.

    Parameters
    ----------
    name : object
        What was given; anything but text means none of them.
    known : iterable of str

    Returns
    -------
    list of str
        Likeliest first; empty if none is similar.
    """
    if not isinstance(name, str):
        return []
    names = {_plain(right): right for right in sorted(known)}
    given = _plain(name[:_LONGEST])
    if given in names:
        return [names[given]]
    near = difflib.get_close_matches(given, names, n=1)
    parts = [plain for plain in names if given in plain] if len(given) >= _LEAST_PART else []
    if near and near[0] in parts and difflib.SequenceMatcher(None, given, near[0]).ratio() >= _SURE:
        return [names[near[0]]]
    offered = sorted(parts, key=lambda part: (part not in near, len(part), part))
    return [names[plain] for plain in (offered or near)[:_MOST]]


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """` (did you mean 'this'?)` with the names that are likely meant, or nothing."""
    near = [repr(each) for each in near_names(name, known)]
    return f" (did you mean {' or '.join(near)}?)" if near else ""


def _plain(name: str) -> str:
    """Name without what is easily confused: case, and blanks, hyphens and underscores."""
    return name.lower().replace("-", "_").replace(" ", "_")
