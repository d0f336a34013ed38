"""Folders of results that are replaced as a whole: whatever ends a run, the old result is there or the new one.

A result is written into a hidden folder beside its place (`.NAME.PID.part`) and put there when it is complete:

- A folder that is new, or holds an earlier result and nothing else, is put there by one call of the system (Linux:
  `renameat2` with RENAME_EXCHANGE). Systems without that call rename twice; a kill between both leaves the old folder
  under a hidden name, and the next run gives it back.
- A folder with anything else in it (`--report .`), of another owner, on a file system of its own, or in which this
  process stands, stays the folder that it is: its files are replaced one by one, each whole, the one that names the
  others last. All that is drawn is drawn before, so that this takes milliseconds.

Files that belong to no earlier result are never touched. What killed runs have left is removed by the next run.
"""

from __future__ import annotations

import ctypes
import glob
import os
import shutil
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from piezoharvest.output import OutputError, check_new_directory, writing

try:
    import fcntl
except ImportError:  # Windows: what killed runs have left stays
    fcntl = None

_HERE, _EXCHANGE = -100, 2  # AT_FDCWD and RENAME_EXCHANGE of Linux

Own = Callable[[Path], Collection[str]]


@contextmanager
def whole_folder(path: str | Path, front: str, own: Own) -> Iterator[Path]:
    """Folder to write a result into, which replaces an earlier one if the block ends without an error.

    Parameters
    ----------
    path : str or Path
        Where the result belongs; made if it does not exist.
    front : str
        Name of the file that names the others: it is there only with all of them.
    own : callable
        Names of the files of an earlier result in a folder; empty where there is none.

    Raises
    ------
    OutputError
        The folder, or a file in it, cannot be written.
    """
    check_new_directory(path)
    target = Path(os.path.realpath(path))
    with writing(path):
        _tidy(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        new = _begun(target, own)
    lock = _locked(new)
    try:
        yield new
        with writing(path):
            _put(new, target, front, own)
    except OutputError as error:
        raise OutputError(str(error).replace(str(new), str(path))) from None
    finally:
        shutil.rmtree(new, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def _begun(target: Path, own: Own) -> Path:
    """New hidden folder on the file system of `target`: beside it, or in it where only its files are replaced."""
    name = f".{target.name}.{os.getpid()}.part"
    if not target.exists():
        (target.parent / name).mkdir()
        return target.parent / name
    if _alone(target, own):
        with suppress(PermissionError):  # only the folder itself may be written
            (target.parent / name).mkdir()
            return target.parent / name
    (target / name).mkdir()
    return target / name


def _alone(target: Path, own: Own) -> bool:
    """True if a folder holds nothing but an earlier result, and can be another one from one moment to the next."""
    found = target.stat()
    moves = found.st_dev == target.parent.stat().st_dev and not os.path.samestat(found, os.stat("."))
    return moves and set(os.listdir(target)) <= set(own(target))


def _put(new: Path, target: Path, front: str, own: Own) -> None:
    """Put a complete folder into its place."""
    if not target.exists():
        os.rename(new, target)
        return
    mine, found = new.stat(), target.stat()
    if _alone(target, own) and (mine.st_uid, mine.st_gid) == (found.st_uid, found.st_gid):
        with suppress(OSError):  # a mount point, or on Windows a folder of which a file is open
            shutil.copymode(target, new)
            _exchange(new, target)
            return
    names = sorted(os.listdir(new), key=lambda name: name == front)
    useless = set(own(target)) - set(names)
    for name in names:
        os.replace(new / name, target / name)
    for name in useless:
        (target / name).unlink(missing_ok=True)


def _exchange(new: Path, target: Path) -> None:
    """Put one folder in the place of another, at one stroke where the system knows how."""
    with suppress(OSError):
        _swap(new, target)
        return
    old = new.with_suffix(".old")
    os.rename(target, old)
    try:
        os.rename(new, target)
    except OSError:
        os.rename(old, target)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _swap(one: Path, other: Path) -> None:
    """Let two folders change places in one step; `OSError` where that cannot be."""
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, TypeError):  # not Linux
        raise OSError("no call of the system exchanges two folders") from None
    if rename(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def _tidy(target: Path) -> None:
    """Give back what a killed run has moved away, and remove what it has left."""
    hidden = f".{glob.escape(target.name)}.*"
    for old in target.parent.glob(f"{hidden}.old"):
        if not target.exists() and _abandoned(old.with_suffix(".part")):
            os.rename(old, target)
    for place in (target.parent, target):
        for left in (*place.glob(f"{hidden}.part"), *place.glob(f"{hidden}.old")):
            if left.is_dir() and _abandoned(left.with_suffix(".part")):
                shutil.rmtree(left, ignore_errors=True)


def _locked(folder: Path) -> int | None:
    """Descriptor of a folder that is locked until it is closed or the process ends, however; None where that fails."""
    if fcntl is None:
        return None
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # another process has it, or this file system has no locks
        os.close(descriptor)
        return None
    return descriptor


def _abandoned(folder: Path) -> bool:
    """True if no run that lives is writing into a folder; False where that cannot be known."""
    try:
        lock = _locked(folder)
    except FileNotFoundError:
        return True
    if lock is None:
        return False
    os.close(lock)
    return True
