"""A host structure as a list of its modes in a file, as a finite-element program or a modal test gives it.

One row for each mode, columns by name, shapes normalised to unit modal mass:

| column | unit | |
|---|---|---|
| `frequency_Hz` | Hz | natural frequency with all electrodes shorted |
| `damping_ratio` | | share of critical damping |
| `force` | kg^-1/2 | shape where and as the force acts |
| `sensor` | kg^-1/2 | shape where the displacement is read; without the column, where the force acts |
| `coupling_0`, `coupling_1`, ... | N/(V kg^1/2) | of the transducer's own and of each further pair of electrodes |
| `base` | kg^1/2 | participation in a base acceleration a, which drives the mode with -base a; needed for one |

A universal file (.uff, .unv) has the modes as its data sets 55, with shapes at nodes: normal modes, or complex ones
whose shapes are nearly in phase. A table `shapes` then says where force and sensor are, as `force = "12+Z"` (node,
sign, direction; R before the direction for a rotation), and has the other columns as lists with a value for each mode:
`coupling_0 = [...]`, `base = [...]`.

A state-space model of ANSYS (.spm, SPMWRITE with FileFormat = 1) has force and voltages as its inputs: in `shapes`,
`force = 1` and `coupling_0 = 2` are numbers of columns of B, `sensor = 1` that of a row of C, counted from 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.parameters import LARGEST, SMALLEST, ParameterError

KEY, PLACES, STATE_SPACE = "modes_file", "shapes", ".spm"
GIVEN = ("mass", "damping", "stiffness", "coupling", "effective_mass", "sensor_participation", "modes",
         "modal", "datasheet", "catalogue")  # by the file  # fmt: skip
_TWICE = f"found together with {KEY}, which gives it too: remove one of the two"


def with_modes(table: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Table of a transducer in which the modes of its file, relative to `folder`, replace the key.

    The first mode that the force moves comes first, scaled so that its share of the force is 1.

    Raises
    ------
    ParameterError
        The file is not as described above, or the table gives what the file does.
    """
    table = dict(table)
    name = table.pop(KEY)
    if not isinstance(name, str):
        raise ParameterError(KEY, f"found {name!r}, must be the name of a file")
    for key in GIVEN:
        if key in table:
            raise ParameterError(key, _TWICE)
    electrodes = table.get("electrodes", [])
    count = 1 + len(electrodes) if isinstance(electrodes, list) else 1
    columns = _columns(folder / name, name, count, table.pop(PLACES, None))
    first = np.flatnonzero(columns["force"])
    if not len(first):
        raise ParameterError(
            KEY, f"{name}: found only zeros in column 'force', but the force must drive at least one mode"
        )
    order = [first[0], *(n for n in range(len(columns["force"])) if n != first[0])]
    shares = [columns["force"][first[0]], *[1.0] * (len(order) - 1)]
    modes = [_mode(columns, n, share) for n, share in zip(order, shares, strict=True)]
    table |= {key: value for key, value in modes[0].items() if key != "force_participation"}
    couplings = [[float(columns[f"coupling_{k}"][n] / share) for n, share in zip(order, shares, strict=True)]
                 for k in range(1, count)]  # fmt: skip
    if count > 1:
        pairs = zip(electrodes, couplings, strict=True)
        table["electrodes"] = [_with_coupling(each, coupling, k) for k, (each, coupling) in enumerate(pairs)]
    return {**table, "modes": modes[1:]}


def check_base(table: Any, effective_mass: float | None, why: str) -> None:
    """Raise `ParameterError` if a file of modes lacks the participations that a base acceleration drives.

    Without them each mode would be driven by its mass, which of unit modal mass is a matter of scaling.

    Parameters
    ----------
    table : mapping
        Table of the transducer, as the user gave it.
    effective_mass : float or None
        Of its first mode, as built, kg.
    why : str
        What needs them.
    """
    if isinstance(table, Mapping) and KEY in table and effective_mass is None:
        key = f"{PLACES}.base" if PLACES in table else KEY
        found = "missing key" if PLACES in table else f"{table[KEY]}: the file has no column 'base'"
        raise ParameterError(key, f"{found}, {why} needs each mode's participation in a base acceleration (kg^1/2)")


def _mode(columns: Mapping[str, np.ndarray], n: int, share: float) -> dict[str, float]:
    """Table of a mode in the coordinate that is `share` times that of unit modal mass."""
    omega, mass = 2 * np.pi * columns["frequency_Hz"][n], share**-2
    values = {
        "mass": mass,
        "damping": 2 * columns["damping_ratio"][n] * omega * mass,
        "stiffness": omega**2 * mass,
        "coupling": columns["coupling_0"][n] / share,
        "force_participation": columns["force"][n] / share,
        "sensor_participation": columns["sensor"][n] / share,
    }
    if "base" in columns:
        values["effective_mass"] = columns["base"][n] / share
    return {key: float(value) for key, value in values.items()}


def _with_coupling(electrode: Any, coupling: list[float], k: int) -> Any:
    """Table of further electrodes with the coupling of the file."""
    if not isinstance(electrode, dict):
        return electrode  # building it says what is wrong
    if "coupling" in electrode:
        raise ParameterError(f"electrodes.{k}.coupling", _TWICE)
    return {**electrode, "coupling": coupling}


def _columns(path: Path, name: str, electrodes: int, places: Any) -> dict[str, np.ndarray]:
    """Columns by name, of a file with rows of modes or with shapes at nodes."""
    from piezoharvest.readers.uff import Uff

    if not path.is_file():
        folder = path.is_dir()
        raise ParameterError(
            KEY, f"found {name!r}, which is {'a directory, not a file' if folder else 'no existing file'}"
        )
    if path.suffix.lower() in (*Uff.suffixes, STATE_SPACE):
        columns = _at_places(path, name, electrodes, places)
        for message, row in _faults(columns):
            raise ParameterError(KEY, f"{name}, mode {row + 1}: {message}")
        return {"sensor": columns["force"], **columns}
    if places is not None:
        raise ParameterError(PLACES, f"found together with {name}, whose columns give it: remove it")
    return _read(path, name, electrodes)


def _at_places(path: Path, name: str, electrodes: int, places: Any) -> dict[str, np.ndarray]:
    """Columns from a universal file or a state-space model, and from the table that says which shape is what."""
    from piezoharvest.readers import ReadError
    from piezoharvest.readers.text_files.state_space import read_state_space
    from piezoharvest.readers.uff import ModeShapes

    read, takes = ModeShapes, "shapes at nodes: it takes force = '12+Z' and coupling_0 = [...]"
    if path.suffix.lower() == STATE_SPACE:
        read, takes = read_state_space, "inputs and outputs by number: it takes force = 1 and coupling_0 = 2"
    places = _checked(places, name, electrodes, takes)
    try:
        modes = read(path)
    except ReadError as error:
        raise ParameterError(KEY, f"{name}: {error.message}") from None
    columns = {"frequency_Hz": modes.frequency, "damping_ratio": modes.damping_ratio}
    for key, value in places.items():
        try:
            known = modes.at(value, key)
            columns[key] = _list(key, value, len(modes.frequency), name) if known is None else known
        except ReadError as error:
            raise ParameterError(f"{PLACES}.{key}", f"{error.message} in {name}") from None
    return columns


def _list(key: str, value: Any, count: int, name: str) -> np.ndarray:
    """A list with a number for each mode."""
    try:
        found = np.asarray(value, float)
    except (TypeError, ValueError):
        raise ParameterError(f"{PLACES}.{key}", f"found {value!r:.40}, must be a list of numbers") from None
    if found.shape != (count,):
        message = f"found {value!r:.40}, must be a list of {counted(count, 'number')}, one for each mode in {name}"
        raise ParameterError(f"{PLACES}.{key}", message)
    return found


def _checked(places: Any, name: str, electrodes: int, takes: str) -> Mapping[str, Any]:
    """The table that says where force, sensor and electrodes are, with all its keys."""
    lists = [f"coupling_{k}" for k in range(electrodes)]
    needed, known = ["force", *lists], ["force", "sensor", *lists, "base"]
    if not isinstance(places, Mapping):
        found = "missing table" if places is None else f"found {places!r:.40}, must be a table"
        raise ParameterError(PLACES, f"{found}, {name} has {takes}")
    for key in [*needed, *places]:
        if key not in places:
            raise ParameterError(f"{PLACES}.{key}", f"missing key, needed for the shapes in {name}")
        if key not in known:
            raise ParameterError(f"{PLACES}.{key}", f"found an unknown key, allowed are {', '.join(known)}")
    return places


def _read(path: Path, name: str, electrodes: int) -> dict[str, np.ndarray]:
    """Columns of a file by name."""
    from piezoharvest.readers import ReadError, open_reader

    needed = ["frequency_Hz", "damping_ratio", "force", *(f"coupling_{k}" for k in range(electrodes))]
    try:
        with open_reader(path) as reader:
            wanted = needed + [column for column in ("sensor", "base") if column in reader.names]
            found = reader.read([reader.resolve(column) for column in wanted])
            columns = {column: found[reader.resolve(column)] for column in wanted}
            spare = [column for column in reader.names if column.startswith("coupling_") and column not in wanted]
            numbering = reader.numbering
    except ReadError as error:
        where = name if error.row is None else f"{name}, row {error.row}"
        raise ParameterError(KEY, f"{where}: {error.message}") from None
    if spare:
        found = f"found column {spare[0]!r}, but {electrodes} pair{'s' if electrodes > 1 else ''} of electrodes"
        raise ParameterError(KEY, f"{name}: {found}; each further pair needs a table [[transducer.electrodes]]")
    for message, row in _faults(columns, "nan or an empty cell"):
        at = numbering[row] if isinstance(numbering, np.ndarray) else numbering + row
        raise ParameterError(KEY, f"{name}, row {at}: {message}")
    return {"sensor": columns["force"], **columns}


def _faults(columns: Mapping[str, np.ndarray], missing: str = "nan") -> Iterator[tuple[str, int]]:
    """What is wrong with values, and in which row; `missing` says what a nan stands for."""
    for column, values in columns.items():
        least = {"frequency_Hz": "greater than 0 Hz", "damping_ratio": "at least 0"}.get(column, "")
        for row, value in enumerate(values):
            fine = (SMALLEST < abs(value) < LARGEST and np.imag(value) == 0) or value == 0
            if not fine or (column == "frequency_Hz" and value <= 0) or (column == "damping_ratio" and value < 0):
                found = missing if np.isnan(value) else value
                yield f"found {found} in column {column!r}, must be a finite number {least}".rstrip(), row
