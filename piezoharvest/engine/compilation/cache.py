"""Compiled code on disk: never stale, safe when several processes write at once, and never in the way of a run.

Numba keeps a function under the stamp of its own file, although what it calls from other files is compiled into it, and
it writes the index before the code that the index tells of. Here a file of code carries in its name the contents of all
that it was made from; so whoever finds a file by its name has the right one, and no index is needed.

Uses what numba does not promise to keep: see `compiled.TESTED`.
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

from piezoharvest.engine.compilation.uncached_warning import say_once

_PACKAGE = str(Path(__file__).parents[2])
_IMPORT = re.compile(r"^[ \t]*(?:from|import)[ \t]+([\w.]+)(?:[ \t]+import[ \t]*(\([^)]*\)|.*))?", re.MULTILINE)
_DIGEST = 32  # bytes


def sources(file: str) -> list[str]:
    """Files that can change what is compiled of the functions in a file.

    They are the file itself and those of this package that it imports, directly or not: functions that are called, and
    constants, which numba compiles in.

    Parameters
    ----------
    file : str
        Of a module, of this package or not.
    """
    return sorted(_texts(file))


@cache
def _texts(file: str) -> dict[str, bytes]:
    """The same files with what they hold."""
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
    """What tells code compiled of the functions in a file from code made of other sources or by another numba."""
    content = hashlib.sha256(numba.__version__.encode())
    for _, text in sorted(_texts(file).items()):
        content.update(_digest(text))
    return content.hexdigest()[:16]


class _CodeFiles(IndexDataCacheFile):
    """Files of code of one function: one for each signature and processor, under the stamp of its sources."""

    def __init__(self, folder: str, function: str, mark: str):
        super().__init__(folder, function, mark)
        self._function, self._mark = function, mark

    def _path(self, key: tuple) -> str:
        return self._data_path(f"{self._function}.{self._mark}.{_digest(repr(key).encode()).hex()[:16]}.nbc")

    def load(self, key: tuple) -> Any:
        """Code as it was saved; None where it has to be compiled: it is not there, not to be read, or damaged."""
        try:
            content = Path(self._path(key)).read_bytes()
            return pickle.loads(content[_DIGEST:]) if _digest(content[_DIGEST:]) == content[:_DIGEST] else None
        except Exception:
            return None

    def save(self, key: tuple, data: Any) -> None:
        """Write the whole file or none, and remove those of other sources."""
        content = self._dump(data)
        with self._open_for_write(self._path(key)) as file:
            file.write(_digest(content) + content)
        for path in Path(self._cache_path).glob(f"{self._function}.*.nbc"):
            if not path.name.startswith(f"{self._function}.{self._mark}."):
                path.unlink(missing_ok=True)


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).digest()


class _Places(CompileResultCacheImpl):
    """Where code may be kept: NUMBA_CACHE_DIR, beside the source, or the user's cache."""

    if os.path.expanduser("~") == "~":  # a user without a home, for whom numba would make a folder of that name
        _locator_classes = [each for each in CompileResultCacheImpl._locator_classes if "UserWide" not in each.__name__]


class _Cache(FunctionCache):
    _impl_class = _Places

    def __init__(self, function: Callable):
        super().__init__(function)
        self._cache_file = _CodeFiles(
            self._cache_path, self._impl.filename_base, stamp(os.path.abspath(inspect.getfile(function)))
        )

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _say_unkept(str(error))


def keep(dispatcher: Any) -> None:
    """Keep on disk what numba makes of a function; where that is not possible, compile it in memory and say so."""
    try:
        dispatcher._cache = _Cache(dispatcher.py_func)
    except (RuntimeError, OSError):  # numba found no place, or the sources cannot be read
        _say_unkept("neither the package's folder nor the user's cache may be written to")


def _say_unkept(why: str) -> None:
    say_once(
        f"compiled code cannot be kept on disk ({why}), so that each run compiles anew for about half a minute: set "
        "the environment variable NUMBA_CACHE_DIR to a folder that may be written to"
    )
