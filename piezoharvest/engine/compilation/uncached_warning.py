"""Warning for a run whose compiled code is not cached for the next one."""

from __future__ import annotations

import logging

_LOG = logging.getLogger("piezoharvest")
_said: list[str] = []


def warn_once(text: str) -> None:
    """Warn once per process (on stderr, unless `logging` is configured otherwise), for any number of functions."""
    if not _said:
        _said.append(text)
        _LOG.warning("warning: %s", text)
