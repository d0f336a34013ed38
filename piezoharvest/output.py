"""Writing of files, complete or not at all: atomic writes, and waveforms as tables."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

if TYPE_CHECKING:
    from piezoharvest.engine.response import Response

# Column of a waveform file: signal of `piezoharvest.engine.response.Waveforms`.
WAVEFORM_COLUMNS = {
    "time_s": "time",
    "drive": "drive",
    "displacement_m": "displacement",
    "velocity_m_per_s": "velocity",
    "voltage_V": "voltage",
    "current_A": "current",
    "charge_C": "charge",
    "hysteresis_voltage_V": "hysteresis_voltage",
    "dc_voltage_V": "dc_voltage",
    "acceleration_m_per_s2": "acceleration",
}


class OutputError(ValueError):
    """A file or a directory that cannot be written to."""


def check_file(path: str | Path, suffixes: Sequence[str] = ()) -> Path:
    """Check, before any work is done, that a file can be written; nothing is left behind.

    Parameters
    ----------
    path : str or Path
    suffixes : sequence of str
        Allowed suffixes of the name; any, if empty.

    Raises
    ------
    OutputError
        Wrong suffix, no such directory, no permission to write there, or something other than a file at the path.
    """
    path = Path(path)
    if suffixes and path.suffix.lower() not in suffixes:
        found = repr(path.suffix) if path.suffix else "no ending"
        raise OutputError(f"{path}: found {found}, allowed are names ending in {', '.join(suffixes)}")
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        raise OutputError(f"{path}: this exists and is not a file, so it cannot be overwritten")
    check_directory(target.parent)
    return path


def check_directory(path: str | Path, *, create: bool = False) -> Path:
    """Check that files can be written into a directory, which is created if `create` is set.

    Raises
    ------
    OutputError
        It does not exist, is not a directory, or cannot be written to.
    """
    path = Path(path)
    try:
        if create:
            path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            return path
    except OSError as error:
        raise OutputError(f"{path}: files cannot be written to this directory ({error.strerror})") from None


def check_new_directory(path: str | Path) -> Path:
    """Check, before any work is done, that a directory can be created or written to; nothing is left behind.

    Raises
    ------
    OutputError
        It, or its first existing parent, is not a directory or cannot be written to.
    """
    path = Path(path)
    check_directory(next(place for place in (path, *path.absolute().parents) if os.path.exists(place)))
    return path


@contextmanager
def atomic(path: str | Path) -> Iterator[Path]:
    """Path of a temporary file beside `path`, which replaces `path` if the block ends without an error.

    A reader sees the old file or the complete new one; a killed run leaves the old one unchanged.
    """
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.stem}.{os.getpid()}.part{target.suffix}")
    try:
        yield temporary
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def writing(path: str | Path) -> Iterator[None]:
    """Raise errors of writing a file (a full disk, no permission) as an `OutputError`."""
    try:
        yield
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else error
        raise OutputError(f"{path}: cannot be written ({reason})") from None


@contextmanager
def result_file(path: str | Path) -> Iterator[BinaryIO]:
    """Binary stream into a result file, which exists completely after the block or not at all.

    All output of the package uses it, except tables that are larger than memory (`sweep`).

    Raises
    ------
    OutputError
        The file cannot be written: no permission, a full disk.
    """
    path = check_file(path)
    with writing(path), atomic(path) as temporary, temporary.open("wb") as stream:
        yield stream
        stream.close()  # before its file is renamed


def waveform_table(responses: Sequence[Response]) -> dict[str, Any]:
    """Waveforms of several simulations as the columns of one long table.

    Columns are `shunt` (the position in the study), `kind`, then those of `WAVEFORM_COLUMNS`; `drive` is the force in N
    or the base acceleration in m/s^2. Simulations without waveforms are left out.
    """
    import numpy as np

    kept = [(n, response, response.waveforms) for n, response in enumerate(responses) if response.waveforms is not None]
    lengths = [len(waveforms.time) for _, _, waveforms in kept]
    columns: dict[str, Any] = {
        "shunt": np.repeat(np.array([n for n, _, _ in kept], dtype=np.int64), lengths),
        "kind": np.repeat(np.array([response.shunt for _, response, _ in kept], dtype=str), lengths),
    }
    for column, signal in WAVEFORM_COLUMNS.items():
        parts = [np.broadcast_to(getattr(waveforms, signal), len(waveforms.time)) for _, _, waveforms in kept]
        columns[column] = np.concatenate(parts) if parts else np.empty(0)
    return columns


def write_table(columns: Mapping[str, Any], path: str | Path) -> None:
    """Write columns of equal length to .csv, .npz, .h5 or .parquet, atomically; in .npz and .h5 each is an array.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    path = check_file(path, TABLE_SUFFIXES)
    with result_file(path) as stream:
        _WRITERS[path.suffix.lower()](columns, stream)


def write_text(text: str, path: str | Path) -> None:
    """Write a text file in UTF-8, atomically.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    with result_file(path) as stream:
        stream.write(text.encode("utf-8", "backslashreplace"))  # file names may contain undecodable bytes


def _write_csv(columns: Mapping[str, Any], stream: BinaryIO) -> None:
    from pyarrow import csv

    stream.write((",".join(columns) + "\n").encode())
    csv.write_csv(_arrow(columns), stream, csv.WriteOptions(include_header=False, quoting_style="none"))


def _write_parquet(columns: Mapping[str, Any], stream: BinaryIO) -> None:
    from pyarrow import parquet

    parquet.write_table(_arrow(columns), stream)


def _arrow(columns: Mapping[str, Any]) -> Any:
    import pyarrow

    return pyarrow.table({name: pyarrow.array(values) for name, values in columns.items()})


def _write_npz(columns: Mapping[str, Any], stream: BinaryIO) -> None:
    import numpy as np

    np.savez(stream, **columns)


def _write_h5(columns: Mapping[str, Any], stream: BinaryIO) -> None:
    """Write in memory first: the library aborts the process if it cannot write buffered data."""
    import h5py

    image = BytesIO()
    with h5py.File(image, "w") as file:
        for name, values in columns.items():
            file[name] = values.astype(h5py.string_dtype()) if values.dtype.kind == "U" else values
    stream.write(image.getbuffer())


_WRITERS = {".csv": _write_csv, ".npz": _write_npz, ".h5": _write_h5, ".parquet": _write_parquet}
TABLE_SUFFIXES = tuple(_WRITERS)
