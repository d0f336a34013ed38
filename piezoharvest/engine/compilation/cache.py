"""Disk cache of compiled code: never stale, safe when several processes write at once, and no reason for a run to fail.

Numba stores a function under the stamp of its own file, although functions of other files are compiled into it, and it
writes the index before the code. Here the name of a cached file contains a digest of all its sources, so that a file
found by its name is the right one and no index is needed.

Uses internals of numba that may change between versions: see `compiled.TESTED`.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import pickle
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile

from piezoharvest.engine.compilation.uncached_warning import warn_once

_PACKAGE = str(Path(__file__).parents[2])
_IMPORT = re.compile(r"^[ \t]*(?:from|import)[ \t]+([\w.]+)(?:[ \t]+import[ \t]*(\([^)]*\)|.*))?", re.MULTILINE)
_DIGEST = 32  # bytes


def sources(file: str) -> list[str]:
    """Files that the compiled code of the functions in a file depends on.

    They are the file itself and those of this package that it imports, directly or not: functions that are called, and
    constants, which numba compiles in.

    Parameters
    ----------
    file : str
        Of a module, of this package or not.
    """
    return sorted(_contents(file))


@cache
def _contents(file: str) -> dict[str, bytes]:
    """Contents of the files of `sources`, by path."""
    found: dict[str, bytes] = {}
    todo = [file]
    while todo:
        path = todo.pop()
        if path not in found:
            found[path] = Path(path).read_bytes()
            for module, names in _IMPORT.findall(found[path].decode()):
                todo += _imported(module, re.findall(r"\w+", names))
    return found


def _imported(module: str, names: list[str]) -> Iterator[str]:
    """Files of this package that `from module import names` runs; a name may be that of a module."""
    package, *words = module.split(".")
    if package != os.path.basename(_PACKAGE):
        return
    places = [os.path.join(_PACKAGE, *words[:depth]) for depth in range(len(words) + 1)]
    for place in (*places, *(os.path.join(places[-1], name) for name in names)):
        yield from _modules().intersection((f"{place}.py", os.path.join(place, "__init__.py")))


@cache
def _modules() -> set[str]:
    """All modules of this package."""
    return {os.path.join(folder, name) for folder, _, names in os.walk(_PACKAGE) for name in names}


def stamp(file: str) -> str:
    """Digest that identifies the sources of the functions in a file and the version of numba."""
    content = hashlib.sha256(numba.__version__.encode())
    for _, text in sorted(_contents(file).items()):
        content.update(_digest(text))
    return content.hexdigest()[:16]


class _CodeFiles(IndexDataCacheFile):
    """Cached code files of one function: one per signature and processor, named by the stamp of its sources."""

    def __init__(self, folder: str, function: str, mark: str):
        super().__init__(folder, function, mark)
        self._function, self._mark = function, mark

    def _path(self, key: tuple) -> str:
        return self._data_path(f"{self._function}.{self._mark}.{_digest(repr(key).encode()).hex()[:16]}.nbc")

    def load(self, key: tuple) -> Any:
        """Return the saved code, or None if it is missing, unreadable or damaged and has to be compiled."""
        try:
            content = Path(self._path(key)).read_bytes()
            return pickle.loads(content[_DIGEST:]) if _digest(content[_DIGEST:]) == content[:_DIGEST] else None
        except Exception:
            return None

    def save(self, key: tuple, data: Any) -> None:
        """Write the file atomically, and remove files made from other sources."""
        content = self._dump(data)
        with self._open_for_write(self._path(key)) as file:
            file.write(_digest(content) + content)
        for path in Path(self._cache_path).glob(f"{self._function}.*.nbc"):
            if not path.name.startswith(f"{self._function}.{self._mark}."):
                path.unlink(missing_ok=True)


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).digest()


class _CacheLocator(CompileResultCacheImpl):
    """Locator of the cache folder: NUMBA_CACHE_DIR, beside the source, or the user's cache."""

    if os.path.expanduser("~") == "~":  # a user without a home, for whom numba would make a folder of that name
        _locator_classes = [each for each in CompileResultCacheImpl._locator_classes if "UserWide" not in each.__name__]


class _Cache(FunctionCache):
    _impl_class = _CacheLocator

    def __init__(self, function: Callable):
        super().__init__(function)
        self._cache_file = _CodeFiles(
            self._cache_path, self._impl.filename_base, stamp(os.path.abspath(inspect.getfile(function)))
        )

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _warn_uncached(str(error))


def cache_on_disk(dispatcher: Any) -> None:
    """Cache the compiled function on disk; if that is not possible, compile it in memory and warn."""
    try:
        dispatcher._cache = _Cache(dispatcher.py_func)
    except (RuntimeError, OSError):  # numba found no place, or the sources cannot be read
        _warn_uncached("neither the package's directory nor the user's cache is writable")


def _warn_uncached(why: str) -> None:
    warn_once(
        f"compiled code cannot be stored on disk ({why}), so each run compiles again for about half a minute: set "
        "the environment variable NUMBA_CACHE_DIR to a writable directory"
    )
