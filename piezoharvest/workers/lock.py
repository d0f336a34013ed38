"""A lock that keeps two processes from writing the same result."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from piezoharvest.output import OutputError


@contextmanager
def locked(path: Path, otherwise: str) -> Iterator[None]:
    """Lock on a file, released by the system even if the process is killed; no lock on systems without them.

    The file is made if it is not there.

    Raises
    ------
    OutputError
        Another process has it: the sentence `otherwise`.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    with path.open("a") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise OutputError(otherwise) from None
        yield
