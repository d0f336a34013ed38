"""The process behind `Apart`: reads data files on request, in bounded memory."""

from __future__ import annotations

import importlib
import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from piezoharvest.input import in_bytes
from piezoharvest.readers import registered
from piezoharvest.readers.base import MAX_NUMBERS, MissingColumnError, Reader, ReadError

# Three copies of the largest allowed data: as it is in the file, decoded, and transposed.
_MEMORY = 3 * 8 * MAX_NUMBERS


def main() -> None:
    """Answer requests until standard input ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    _limit_memory()
    readers: dict[int, Reader] = {}
    for line in sys.stdin.buffer:
        answer, arrays = _answer(readers, **json.loads(line))
        forms = [(array.dtype.str, len(array)) for array in arrays]
        answers.write(json.dumps({**answer, "arrays": forms}).encode() + b"\n")
        for array in arrays:
            answers.write(array.data)
        answers.flush()


def _limit_memory() -> None:
    """Limit the memory of this process, if the system supports it."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        limits = resource.getrlimit(resource.RLIMIT_DATA)
        given = [limit for limit in limits if limit != resource.RLIM_INFINITY]
        resource.setrlimit(resource.RLIMIT_DATA, (min([_MEMORY, *given]), limits[1]))


def _answer(
    readers: dict[int, Reader], number: int, action: str, values: list[Any]
) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Answer to a request, and its arrays; errors are part of the answer."""
    try:
        return _done(readers, number, action, *values)
    except ReadError as error:
        column, missing = str(error.column), isinstance(error, MissingColumnError)
        return {"error": error.message, "column": column, "row": error.row, "missing": missing}, []
    except MemoryError:
        found = f"the file needs more than the {in_bytes(_MEMORY)} of memory that are allowed for reading it"
    except Exception as error:  # libraries raise any exception on damaged files
        found = f"the file is damaged ({type(error).__name__}: {error})"
    return {"error": found, "column": "", "row": None, "missing": False}, []


def _done(
    readers: dict[int, Reader], number: int, action: str, *values: Any
) -> tuple[dict[str, Any], list[np.ndarray]]:
    if action == "start":
        for library in values:
            importlib.import_module(library)
    if action == "open":
        path = Path(values[0])
        readers[number] = reader = registered()[path.suffix.lower()](path)
        return {"names": list(reader.names), "first_row": reader.first_row}, []
    if action == "resolve":
        return {"name": readers[number].resolve(values[0])}, []
    if action == "read":
        found = readers[number].read(values[0])
        return {}, [found[name] for name in values[0]]
    if action == "time_of":
        time = readers[number].time_of(values[0])
        return {}, [] if time is None else [np.ascontiguousarray(time, float)]
    if action == "close" and number in readers:
        readers.pop(number).close()
    return {}, []


if __name__ == "__main__":
    main()
