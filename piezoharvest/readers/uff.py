"""Universal files (.uff, .unv) of modal analysis: functions at degrees of freedom, shapes of modes at nodes.

These are data sets 58, text or binary, and 55.

Format: University of Cincinnati, Structural Dynamics Research Laboratory, "Universal File Formats",
www.ceas3.uc.edu/sdrluff, data sets 55, 58 and 164; read by pyuff, which is an extra of this package.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.readers.base import Reader, ReadError, check_count, cut, numbers
from piezoharvest.readers.units import Unit, ratio_of, unit_of

_KINDS = {1: "signal", 2: "auto spectrum", 3: "cross spectrum", 4: "response", 5: "transmissibility", 6: "coherence"}
_DIRECTIONS = {0: "", **{s * n: f"{'+' if s > 0 else '-'}{d}" for s in (1, -1) for n, d in enumerate("XYZ", 1)}}
_FREEDOMS = ("X", "Y", "Z", "RX", "RY", "RZ")  # displacements and rotations of a node
_TIME, _FREQUENCY = 17, 18  # specific data types of an abscissa
_ABSCISSAE = {_TIME: "time_s", _FREQUENCY: "frequency_Hz"}
_CUT_OFF = "its last data set has no end (-1)"
_BINARY = re.compile(rb" *58b.{12}([ \d]{11}\d)([ \d]{11}\d)")  # lines before its values, and the bytes of these
_MOST_COMPLEX = 0.1  # of a shape out of phase: a response, which has the shape twice, is then 1 % off
# SI unit of a quantity by its specific data type, and which factor of data set 164 it is divided by
_SI = {8: ("m", "length"), 9: ("N", "force"), 11: ("m/s", "length"), 12: ("m/s^2", "length"), 13: ("N", "force")}


class Uff(Reader):
    """Functions by kind: "response", "coherence", "signal"; of several of a kind also by degrees of freedom.

    "response 3+Z/1+X" is that at node 3 in +Z to a force at node 1 in +X. The column "frequency_Hz" or "time_s" is
    what all functions have in common. Units are those of the axes' labels, or of the file's system (data set 164).
    """

    suffixes: ClassVar[tuple[str, ...]] = (".uff", ".unv")

    def __init__(self, path: Path):
        super().__init__(path)
        sets = _read(path)
        self._factors: Mapping[str, Any] = next((each for each in sets if each["type"] == 164), {})
        functions = [each for each in sets if each["type"] == 58]
        if not functions:
            modes = sum(each["type"] == 55 for each in _read(path, (55,)))
            if modes:
                host = (
                    f"{counted(modes, 'mode')} (data sets 55), which a study takes as the modes_file of its transducer"
                )
                raise ReadError(f"found no function (data set 58) but {host}")
            cut_off = f": {_CUT_OFF}, the file is cut off" if _open_end(path) else ""
            raise ReadError(f"found no whole function (data set 58) in the universal file{cut_off}")
        if _open_end(path):
            self.cut_off = _CUT_OFF
        check_count(sum(len(each["data"]) for each in functions))
        kinds = [_kind(each) for each in functions]
        count = Counter(kinds)
        names = [k if count[k] == 1 else f"{k} {_freedoms(each)}" for k, each in zip(kinds, functions, strict=True)]
        double = Counter(names)
        names = [name if double[name] == 1 else f"{name} ({n})" for n, name in enumerate(names, start=1)]
        self._functions = dict(zip(names, functions, strict=True))
        self._shared = _common_abscissa(functions)
        self.names = (*self._shared, *names)

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        return {
            name: self._shared[name] if name in self._shared else numbers(self._functions[name]["data"], name)
            for name in names
        }

    def unit(self, name: str) -> Unit | None:
        if name in self._shared:
            return unit_of(_label(next(iter(self._functions.values())), "abscissa"))
        function = self._functions[name]
        above = self._unit_of_axis(function, "ordinate")
        below = self._unit_of_axis(function, "orddenom")
        if above is None or below is None or function["func_type"] == 1:
            return above
        return Unit(f"{above.text}/{below.text}", ratio_of(above.si, below.si), above.factor / below.factor)

    def time_of(self, name: str) -> np.ndarray | None:
        function = self._functions.get(name, {})
        return np.asarray(function["x"], float) if function.get("abscissa_spec_data_type") == _TIME else None

    def _unit_of_axis(self, function: Mapping[str, Any], axis: str) -> Unit | None:
        """Unit by the label of an axis, else by its quantity where the file states its system of units."""
        label = _label(function, axis)
        quantity = _SI.get(function.get(f"{axis}_spec_data_type", 0))
        if label or quantity is None or not self._factors.get(quantity[1]):
            return unit_of(label)
        si, dimension = quantity
        return Unit(f"data set 164, {dimension}", si, 1.0 / self._factors[dimension])


class _Mode(NamedTuple):
    """A mode: Hz, share of critical damping, shape (nodes, freedoms) for a modal mass of one in the file's units."""

    frequency: float
    damping_ratio: float
    shape: np.ndarray


def _mode(each: Mapping[str, Any], n: int) -> _Mode:
    """Mode number n from its data set; raises `ReadError`."""
    shape = np.stack([each[f"r{k}"] for k in range(1, 7) if f"r{k}" in each], axis=1)
    if each["analysis_type"] == 2 and each["data_type"] == 2:
        if not each["modal_m"] > 0:
            raise ReadError(f"mode {n} has a modal mass of {each['modal_m']:g}, which must be greater than 0")
        ratio = each["modal_damp_vis"] + 0.5 * each["modal_damp_his"]
        return _Mode(each["freq"], ratio, shape / np.sqrt(each["modal_m"]))
    if each["analysis_type"] != 3:
        kinds = "a normal mode (analysis type 2) or a complex one (analysis type 3)"
        raise ReadError(f"mode {n} is of analysis type {each['analysis_type']}, must be {kinds}")
    pole, scale = complex(each["eig"]), complex(each["modal_a"])
    if not (pole.imag > 0 and scale):
        found = f"an eigenvalue of {pole:g} 1/s and a modal A of {scale:g}"
        raise ReadError(f"mode {n} has {found}, must have an imaginary part above 0 and a scale other than 0")
    # A real mode of unit mass has the residues shape^2/(pole - its conjugate); here they are shape^2/modal A.
    own = shape * np.sqrt((pole - pole.conjugate()) / scale)
    beside = float(np.linalg.norm(own.imag) / np.linalg.norm(own))
    if not beside < _MOST_COMPLEX:
        message = f"of whose shape {beside:.0%} is out of phase, allowed are up to {_MOST_COMPLEX:.0%}"
        raise ReadError(f"mode {n} is complex, {message}: a host has real modes")
    return _Mode(abs(pole) / (2 * np.pi), -pole.real / abs(pole), own.real)


class ModeShapes:
    """Real modes of a structure in a universal file: data sets 55, in the order of the file.

    Of complex modes, as a modal test gives them, the real part is taken where it is nearly all.

    Attributes
    ----------
    frequency, damping_ratio : (modes,) array
        Hz, and viscous; half of a hysteretic damping ratio counts as viscous.

    Raises
    ------
    ReadError
        There is no mode, the file is cut off, or a mode is truly complex, not scaled, or at other nodes than the first.
    """

    def __init__(self, path: Path):
        sets = _read(path, (55, 164))
        units: Mapping[str, Any] = next((each for each in sets if each["type"] == 164), {"force": 1.0, "length": 1.0})
        modes = [each for each in sets if each["type"] == 55]
        if _open_end(path):
            raise ReadError(f"{_CUT_OFF}, the file is cut off")
        if not modes:
            raise ReadError("found no mode (data set 55) in the universal file")
        self._nodes = np.asarray(modes[0]["node_nums"])
        for n, each in enumerate(modes, 1):
            if not np.array_equal(each["node_nums"], self._nodes):
                raise ReadError(f"mode {n} has nodes other than those of mode 1")
        found = [_mode(each, n) for n, each in enumerate(modes, 1)]
        self.frequency = np.array([mode.frequency for mode in found])
        self.damping_ratio = np.array([mode.damping_ratio for mode in found])
        # Displacements are lengths for a unit of the modal coordinate, rotations are angles; the modal mass is an
        # energy for the square of its rate. A metre is so many `length` of the file's, a newton so many `force`.
        length, force = units["length"], units["force"]
        shapes = np.stack([mode.shape for mode in found])
        turns = np.arange(shapes.shape[2]) >= _FREEDOMS.index("RX")
        self._shapes = shapes * np.sqrt(np.where(turns, force * length, force / length))

    def largest(self) -> str:
        """Place as `at` takes it: where and in which direction the first mode moves most."""
        moves = self._shapes[0, :, :3]
        row, way = np.unravel_index(np.argmax(np.abs(moves)), moves.shape)
        return f"{self._nodes[row]}{'-' if moves[row, way] < 0 else '+'}{_FREEDOMS[way]}"

    def at(self, place: Any, key: str) -> np.ndarray | None:
        """Shapes (modes,) of unit modal mass at a node in a direction, as "12+Z" or "12-RX"; raises `ReadError`.

        Of the "force" and of the "sensor"; None for a key of which the file knows nothing.
        """
        if key not in ("force", "sensor"):
            return None
        found = re.fullmatch(r"(\d+)([+-])(R?[XYZ])", str(place))
        count = self._shapes.shape[2]
        if found is None or int(found[1]) not in self._nodes or _FREEDOMS.index(found[3]) >= count:
            nodes = f"{self._nodes.min()} to {self._nodes.max()}"
            known = f"{', '.join(_FREEDOMS[:count])} at {counted(len(self._nodes), 'node')} from {nodes}"
            raise ReadError(
                f"found no {str(place)!r:.40}, allowed are a node, a sign and a direction as '12+Z', with {known}"
            )
        row = int(np.flatnonzero(self._nodes == int(found[1]))[0])
        return (-1.0 if found[2] == "-" else 1.0) * self._shapes[:, row, _FREEDOMS.index(found[3])]


def _read(path: Path, types: Sequence[int] = (58, 164)) -> list[dict[str, Any]]:
    """Data sets of these types in a file; raises `ReadError`."""
    try:
        import pyuff  # pyright: ignore[reportMissingImports] - an extra
    except ImportError:
        needed = "the package pyuff is missing, which reads universal files"
        raise ReadError(f"{needed}: pip install 'piezoharvest[uff]'") from None
    try:
        file = pyuff.UFF(str(path))
        wanted = [n for n, number in enumerate(file.get_set_types()) if number in types]
        sets: list[dict[str, Any]] = [file.read_sets(n) for n in wanted]  # pyright: ignore[reportAssignmentType] - one
        for each in sets:
            if each["type"] == 58 and not len(each["data"]) == len(each["x"]) == each["num_pts"] > 0:
                raise ValueError(f"{counted(len(each['data']), 'value')} where {each['num_pts']} are stated")
    except MemoryError:
        raise
    except Exception as error:  # pyuff raises any exception on damaged files
        raise ReadError(f"not a complete universal file ({cut(str(error))})") from None
    return sets


def _open_end(path: Path) -> bool:
    """Whether the last data set of a file has no end: the second of its two lines with -1 in the first six columns."""
    inside = False
    with path.open("rb") as file:
        for line in iter(file.readline, b""):
            bound = line.lstrip()[:2] == b"-1" and len(line.rstrip()) <= 6
            inside = inside != bound
            binary = _BINARY.match(line)
            if inside and binary:
                for _ in range(int(binary[1])):
                    file.readline()
                file.seek(int(binary[2]), 1)
    return inside


def _common_abscissa(functions: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """The column of times or frequencies, if all functions have the same."""
    first = functions[0]
    name = _ABSCISSAE.get(first["abscissa_spec_data_type"])
    same = all(np.array_equal(each["x"], first["x"]) for each in functions)
    return {name: np.asarray(first["x"], float)} if name and same else {}


def _kind(function: Mapping[str, Any]) -> str:
    return _KINDS.get(function["func_type"], f"function of type {function['func_type']}")


def _freedoms(function: Mapping[str, Any]) -> str:
    """Degrees of freedom, "3+Z/1+X"; of a signal its own only."""
    ends = [f"{function[f'{end}_node']}{_DIRECTIONS.get(function[f'{end}_dir'], '')}" for end in ("rsp", "ref")]
    return ends[0] if function["func_type"] == 1 else "/".join(ends)


def _label(function: Mapping[str, Any], axis: str) -> str:
    """Label of an axis's units; "" where it is "NONE"."""
    label = str(function.get(f"{axis}_axis_units_lab") or "").strip()
    return "" if label.upper() == "NONE" else label
