"""What commands say on stderr beside their results: progress, remarks, warnings."""

from __future__ import annotations

import sys

_BEGINNINGS = ("warning:", "piezoharvest:")  # of what --quiet does not silence
_quiet = False


def be_quiet(wanted: bool) -> None:
    """Print warnings and errors alone from now on, or everything again."""
    global _quiet
    _quiet = wanted


def quiet() -> bool:
    """True if only warnings and errors are wanted."""
    return _quiet


def note(text: str) -> None:
    """Print progress, a remark or a warning to stderr."""
    if not _quiet or text.startswith(_BEGINNINGS):
        print(text, file=sys.stderr, flush=True)
