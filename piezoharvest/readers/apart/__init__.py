"""Readers in a separate process, for formats whose libraries may crash on a damaged file.

A crash, an endless loop or unbounded memory use then ends the helper process only, and is reported as a `ReadError`.
The process is started by the first file that needs it, which takes 0.3 s, and serves all that follow: a file costs
2 ms more than in the same process, and each MB that is read 2 ms.
"""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from piezoharvest.readers.base import MissingColumnError, Reader, ReadError

_START_TIMEOUT = 60.0  # s until the process must be ready: its imports take 0.3 s, many times that from a slow disk
# s for one request: every library reads more than 10 MB/s, a network drive 1 MB/s; at most one hour.
_BASE_TIMEOUT, _TIMEOUT_PER_BYTE, _MAX_TIMEOUT = 5.0, 1e-6, 3600.0
_numbers = count(1)  # of the files that have been opened


class Apart(Reader):
    """Proxy of a `Reader` that runs in another process; its methods are those of that reader.

    Parameters
    ----------
    path : Path
    libraries : sequence of str
        Modules that the reader imports.
    """

    def __init__(self, path: Path, libraries: Sequence[str]):
        super().__init__(path)
        self._process = _running()
        self._process.start(libraries)
        self._patience = min(_BASE_TIMEOUT + _TIMEOUT_PER_BYTE * path.stat().st_size, _MAX_TIMEOUT)
        self._number = next(_numbers)
        found = self._ask("open", os.path.abspath(path))
        self.names, self.first_row = tuple(found["names"]), found["first_row"]

    def resolve(self, column: str | int) -> str:
        return self._ask("resolve", column)["name"]

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        return dict(zip(names, self._ask("read", list(names))["arrays"], strict=True))

    def time_of(self, name: str) -> np.ndarray | None:
        return next(iter(self._ask("time_of", name)["arrays"]), None)

    def close(self) -> None:
        with suppress(ReadError):  # of a process that has ended
            self._ask("close")

    def _ask(self, action: str, *values: Any) -> dict[str, Any]:
        """Answer to a request; raises `ReadError`."""
        return self._process.answer({"number": self._number, "action": action, "values": values}, self._patience)


class _Process:
    """The reading process: takes a request as a line of JSON, answers with a line of JSON and the arrays in it."""

    def __init__(self) -> None:
        folders = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": folders},
        )  # fmt: skip
        assert self._process.stdin is not None and self._process.stdout is not None
        self._requests, self._answers = self._process.stdin, self._process.stdout
        self._lock, self._owner = threading.Lock(), os.getpid()
        atexit.register(self._end)

    @property
    def usable(self) -> bool:
        """True if the process runs and was started by this process, not by a parent that this is a fork of."""
        return self._owner == os.getpid() and self._process.poll() is None

    def start(self, libraries: Sequence[str]) -> None:
        """Wait until the process runs and has imported the libraries; raises `ReadError`."""
        try:
            self.answer({"number": 0, "action": "start", "values": libraries}, _START_TIMEOUT)
        except ReadError:
            libraries = " and ".join(libraries)
            raise ReadError(f"no second Python process could be started to read this file with {libraries}") from None

    def answer(self, request: dict[str, Any], patience: float) -> dict[str, Any]:
        """Answer to a request, within so many seconds; raises `ReadError`."""
        with self._lock, self._watched(patience):
            self._requests.write(json.dumps(request).encode() + b"\n")
            self._requests.flush()
            found = json.loads(self._answers.readline())
            found["arrays"] = [self._array(*form) for form in found.get("arrays", ())]
        if "error" in found:
            kind = MissingColumnError if found["missing"] else ReadError
            raise kind(found["error"], found["column"], found["row"])
        return found

    def _array(self, dtype: str, length: int) -> np.ndarray:
        array = np.empty(length, dtype)
        if length and self._answers.readinto(memoryview(array).cast("B")) < array.nbytes:  # pyright: ignore
            raise EOFError
        return array

    @contextmanager
    def _watched(self, patience: float) -> Iterator[None]:
        """End the process if its answer does not come in time; raises `ReadError`."""
        late = threading.Event()
        timer = threading.Timer(patience, lambda: (late.set(), self._process.kill()))
        timer.start()
        try:
            yield
        except (OSError, EOFError, ValueError):  # of a pipe that is broken, and of half an answer
            status = self._end()
            found = f"reading took more than {patience:.0f} s" if late.is_set() else f"its reader crashed ({status})"
            raise ReadError(f"the file is damaged ({found})") from None
        except BaseException:  # interrupted: the pending answer must not be taken for that to the next request
            self._end()
            raise
        finally:
            timer.cancel()

    def _end(self) -> int:
        """End the process and return its exit status."""
        if self._owner == os.getpid():
            self._process.kill()
        with suppress(OSError):  # of a request that nobody has taken
            self._requests.close()
        self._answers.close()
        return self._process.wait()


_kept: list[_Process] = []


def _running() -> _Process:
    """The reading process, started again if it has ended."""
    if not _kept or not _kept[0].usable:
        _kept[:] = [_Process()]
    return _kept[0]
