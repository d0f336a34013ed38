"""Waveforms and responses of ngspice and LTspice (.raw), binary or text, of a transient or an AC analysis.

An AC analysis has complex values over its frequencies, as it is. In a transient one a simulator takes steps of its own,
records are samples at even times: the waveforms are read at the largest of the steps, between them on straight lines,
as the simulator's own viewer draws them. Formats: ngspice manual, section "Raw file"; LTspice writes the header in
UTF-16 and, unless told otherwise, all but the time in single precision.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.readers.base import Reader, ReadError, check_count
from piezoharvest.readers.units import Unit, stated_unit

MOST_HEADER = 1 << 20  # bytes in which a header ends


class SpiceRaw(Reader):
    """A transient or AC analysis of a circuit simulator; columns are named as there, "v(p)", "i(vload)"."""

    suffixes: ClassVar[tuple[str, ...]] = (".raw",)
    # Readings of a netlist that `export` has written: V(drive) is the force, V(base) the acceleration of the base.
    channels: ClassVar[Mapping[str, str]] = MappingProxyType({
        "v(drive)": "force", "v(base)": "base_acceleration", "v(x)": "displacement", "v(p)": "voltage",
        "i(vload)": "current", "v(vdc)": "dc_voltage",
    })  # fmt: skip

    def __init__(self, path: Path):
        super().__init__(path)
        data = path.read_bytes()
        header, body, binary = _split(data)
        plot, flags = header.get("plotname", "none"), header["flags"].lower().split()
        self._over_frequency = plot.lower().startswith("ac ") and "complex" in flags
        if "transient" not in plot.lower() and not self._over_frequency:
            raise ReadError(f"found the analysis {plot!r}, must be a transient or AC one")
        for flag in ("stepped",) if self._over_frequency else ("complex", "stepped"):
            if flag in flags:
                raise ReadError(f"found waveforms that are {flag}, they must be those of a single real run")
        try:
            count, points = int(header["no. variables"]), int(header["no. points"])
        except (KeyError, ValueError):
            raise ReadError("the header has no number of variables or points") from None
        names = header["variables"].split("\n")
        if not (0 < count == len(names) and points > 1):
            found = f"found {counted(len(names), 'variable')} and {counted(points, 'point')}"
            raise ReadError(f"{found}, the header says {counted(count, 'variable')}")
        check_count(count * points)
        self.names = tuple(names)
        if self._over_frequency:
            values = _complex(body, count, points, flags) if binary else _text(body, count, points, complex)
            if not np.all(np.isfinite(values)):
                raise ReadError("some values are not numbers")
            self._uneven = dict(zip(names, values, strict=True)) | {names[0]: np.real(values[0])}
            return
        values = _binary(body, count, points, header["flags"]) if binary else _text(body, count, points)
        time = np.abs(values[0])  # LTspice marks points that compression kept by a minus
        kept = np.concatenate([[True], np.diff(time) > 0])
        if not np.all(np.isfinite(values)) or np.any(np.diff(time) < 0) or kept.sum() < 2:
            raise ReadError("the times do not increase, or some values are not numbers")
        self._uneven = dict(zip(names, values[:, kept], strict=True)) | {names[0]: time[kept]}
        step = float(np.max(np.diff(time[kept])))
        self._times = time[0] + step * np.arange(int((time[-1] - time[0]) / step * (1 + 1e-12)) + 1)

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        if self._over_frequency:
            return {name: self._uneven[name] for name in names}
        times = self._uneven[self.names[0]]
        return {name: np.interp(self._times, times, self._uneven[name]) for name in names}

    def unit(self, name: str) -> Unit | None:
        """Unit of times and frequencies; a voltage may stand for any other quantity."""
        known = {"time": "s", "frequency": "Hz"}.get(name.lower()) if name == self.names[0] else None
        return stated_unit(f"{name} [{known}]")[1] if known else None

    def time_of(self, name: str) -> np.ndarray | None:
        return None if self._over_frequency else self._times

    def resolve(self, column: str | int) -> str:
        """Name of a column; simulators do not tell upper from lower case."""
        if isinstance(column, str):
            column = {name.lower(): name for name in self.names}.get(column.lower(), column)
        return super().resolve(column)


def _split(data: bytes) -> tuple[Mapping[str, str], bytes, bool]:
    """Header, what follows it, and whether that is binary."""
    wide = data[:2] in (b"T\0", b"\xff\xfe")
    encoding = "utf-16-le" if wide else "latin-1"
    for word, binary in (("Binary:\n", True), ("Values:\n", False)):
        for end in (word, word.replace("\n", "\r\n")):
            mark = end.encode(encoding)
            place = data.find(mark, 0, MOST_HEADER)
            if place >= 0:
                body = data[place + len(mark) :]
                text = data[:place].decode(encoding, "replace").lstrip("\ufeff")
                return _fields(text), body if binary or not wide else body.decode(encoding, "replace").encode(), binary
    raise ReadError("not a .raw file of ngspice or LTspice: it has no line 'Binary:' or 'Values:'")


def _fields(text: str) -> dict[str, str]:
    """Fields of a header by name in lower case; the variables are their names, a line for each."""
    fields: dict[str, str] = {"flags": "", "variables": ""}
    names: list[str] | None = None
    for line in text.splitlines():
        if names is not None and line[:1] in "\t ":
            words = line.split()
            if len(words) >= 2:
                names.append(words[1])
            continue
        key, sign, value = line.partition(":")
        if sign:
            fields[key.strip().lower()] = value.strip()
            names = [] if key.strip().lower() == "variables" else names
    fields["variables"] = "\n".join(names or [])
    return fields


def _binary(body: bytes, count: int, points: int, flags: str) -> np.ndarray:
    """Values (count, points): doubles, or behind a double time singles."""
    mixed = np.dtype([("time", "<f8"), ("rest", "<f4", (count - 1,))])
    if len(body) == 8 * count * points:
        values = np.frombuffer(body, "<f8")
        return values.reshape(count, points) if "fastaccess" in flags.lower() else values.reshape(points, count).T
    if len(body) == mixed.itemsize * points:
        if "fastaccess" in flags.lower():
            rest = np.frombuffer(body[8 * points :], "<f4").reshape(count - 1, points)
            return np.vstack([np.frombuffer(body[: 8 * points], "<f8"), rest])
        rows = np.frombuffer(body, mixed)
        return np.vstack([rows["time"], rows["rest"].T])
    wanted = f"{8 * count * points} or {mixed.itemsize * points} bytes of values"
    raise ReadError(f"found {counted(len(body), 'byte')} of values, allowed are {wanted}: cut off, or of several runs")


def _complex(body: bytes, count: int, points: int, flags: Sequence[str]) -> np.ndarray:
    """Complex values (count, points), of double precision."""
    if len(body) != 16 * count * points:
        raise ReadError(
            f"found {counted(len(body), 'byte')} of values, must be {16 * count * points}: cut off, or of several runs"
        )
    values = np.frombuffer(body, "<c16")
    return values.reshape(count, points) if "fastaccess" in flags else values.reshape(points, count).T


def _text(body: bytes, count: int, points: int, kind: type = float) -> np.ndarray:
    """Values (count, points) from text: the number of each point, then its values, complex ones as "1.0,2.0"."""
    try:
        words = body.split()
        if kind is complex:
            del words[:: count + 1]  # the numbers of the points
            parts = np.array([word.split(b",") for word in words], float).reshape(points, count, 2)
            return (parts[..., 0] + 1j * parts[..., 1]).T
        values = np.array(words, float)
        return values.reshape(points, count + 1)[:, 1:].T
    except ValueError:
        raise ReadError(f"the text does not hold {counted(points, 'point')} of {counted(count, 'number')}") from None
