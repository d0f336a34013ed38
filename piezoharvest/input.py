"""Reading of files: only regular ones of bounded size, so that reading ends and fits into memory."""

from __future__ import annotations

import os
import stat
from pathlib import Path

_KINDS = {
    stat.S_IFIFO: "a pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFSOCK: "a socket",
}  # fmt: skip


class InputError(ValueError):
    """A file that cannot be read; the message says why."""


def check_readable(path: str | Path, most: int) -> int:
    """Check, before anything is read, that a file exists, is regular, and not too large.

    A pipe or a device may block its reader, or never end.

    Parameters
    ----------
    path : str or Path
    most : int
        Largest allowed size in bytes.

    Returns
    -------
    int
        Its size in bytes.

    Raises
    ------
    InputError
        It does not exist, is not a regular file, is too large, or must not be read.
    """
    try:
        found = os.stat(path)
        kind = _KINDS.get(stat.S_IFMT(found.st_mode))
        if kind is not None:
            raise InputError(f"found {kind}, not a file")
        with open(path, "rb"):
            pass
    except OSError as error:
        raise InputError(f"the file cannot be read ({error.strerror})") from None
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"this is not a file name ({error})") from None  # "embedded null byte", as Python calls a NUL
    if found.st_size > most:
        raise InputError(f"found a file of {in_bytes(found.st_size)}, allowed are up to {in_bytes(most)}")
    return found.st_size


def in_bytes(count: int) -> str:
    """A number of bytes in words, with a unit."""
    for unit, size in (("GiB", 1 << 30), ("MiB", 1 << 20), ("KiB", 1 << 10)):
        if count >= size:
            return f"{count / size:.4g} {unit}"
    return f"{count} bytes"
