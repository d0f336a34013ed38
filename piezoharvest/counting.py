"""Numbers of things in words, one of them in the singular."""

from __future__ import annotations


def counted(count: int | str, one: str, many: str = "") -> str:
    """Text for a number of items: "1 gap", "3 gaps"; `many` is the plural where it is not `one` with an s."""
    return f"{count} {one if str(count) == '1' else many or one + 's'}"
