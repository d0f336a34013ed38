"""The sentence for a run whose compiled code is not kept for the next one."""

from __future__ import annotations

import logging

_LOG = logging.getLogger("piezoharvest")
_said: list[str] = []


def say_once(text: str) -> None:
    """Warn (on stderr, unless `logging` is told otherwise), once in a process, however many functions it is true of."""
    if not _said:
        _said.append(text)
        _LOG.warning("warning: %s", text)
