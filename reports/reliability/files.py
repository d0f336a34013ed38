"""Small valid files of every format that is read, as instruments and programs write them."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np

COUNT = 40
TIME = np.arange(COUNT) / 1000.0
COLUMNS = {"time_s": TIME, "force_N": np.sin(300.0 * TIME), "voltage_V": 2.0 * np.cos(200.0 * TIME)}
NAMES = tuple(COLUMNS)


def rows(delimiter: str, decimal: str = ".") -> str:
    """Lines of the table."""
    numbers = zip(*COLUMNS.values(), strict=True)
    return "\n".join(delimiter.join(f"{x:.6g}".replace(".", decimal) for x in row) for row in numbers) + "\n"


def csv() -> str:
    """Names and units in one row."""
    return "time (s),force (N),voltage (V)\n" + rows(",")


def european() -> str:
    """A preamble, decimal commas and a row of units."""
    return "Messung 7;\nDatum;1.2.2026\n\nZeit;Kraft;Spannung\ns;N;V\n" + rows(";", ",")


def tektronix() -> str:
    """Settings above, two columns of an oscilloscope."""
    head = "Model,TBS2000\nFirmware,1.2\nRecord Length,40\nSample Interval,0.001\nVertical Units,V\n\nTIME,CH1,CH2\n"
    return head + rows(",")


def labview() -> str:
    """A .lvm file."""
    head = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
        "Multi_Headings\tNo\nX_Columns\tOne\nTime_Pref\tRelative\n***End_of_Header***\t\n\t\t\nChannels\t2\t\n"
        "Samples\t40\t40\nX_Dimension\tTime\tTime\nX0\t0\t0\nDelta_X\t0.001\t0.001\n***End_of_Header***\t\t\n"
        "X_Value\tforce\tvoltage\tComment\n"
    )
    return head + rows("\t")


def touchstone() -> str:
    """Reflection of one port."""
    lines = [f"{1e3 * (1 + k)} {0.5:g} {-10.0 - k:g}" for k in range(COUNT)]
    return "! analyser\n# Hz S MA R 50\n" + "\n".join(lines) + "\n"


def universal() -> str:
    """A function at nodal degree of freedom, data set 58."""
    head = [
        "    -1", "    58", "Displacement over force", "NONE", "01-Jan-26 12:00:00", "NONE", "NONE",
        "    4         0    1         0       NONE         1   3       NONE         1   3",
        f"         5{COUNT:10d}         1  1.00000e+00  1.00000e+00  0.00000e+00",
        "        18    0    0    0             Frequency                  Hz",
        "         8    0    0    0          Displacement                   m",
        "        13    0    0    0                 Force                   N",
        "         0    0    0    0                  NONE                NONE",
    ]  # fmt: skip
    values = [f"{1e-6 * np.cos(k):13.5e}{1e-6 * np.sin(k):13.5e}" for k in range(COUNT)]
    body = ["".join(values[k : k + 3]) for k in range(0, COUNT, 3)]
    return "\n".join([*head, *body, "    -1", ""])


TEXTS: dict[str, Callable[[], str]] = {
    "run.csv": csv, "messung.csv": european, "scope.csv": tektronix, "run.lvm": labview, "port.s1p": touchstone,
    "host.uff": universal,
}  # fmt: skip
# Arrays that programs save where a column is expected.
ARRAYS: tuple[np.ndarray, ...] = (
    np.zeros((0,)), np.zeros(()), np.ones((COUNT, 2)), np.ones((2, 3, COUNT)), np.ones(COUNT, complex),
    np.ones(COUNT, bool), np.ones(COUNT, "f2"), np.ones(COUNT, "i1"), np.ones(COUNT, "u8"),
    np.ones(COUNT, ">f4"), np.full(COUNT, "text"),
    np.ones(COUNT - 1), np.full(COUNT, np.nan), np.full(COUNT, np.inf), np.full(COUNT, 1e308), np.ones((1, COUNT)),
)  # fmt: skip


def write_npz(columns: dict[str, np.ndarray], path: Path) -> None:
    """NumPy."""
    np.savez(path, **columns)  # pyright: ignore[reportArgumentType]


def write_npy(columns: dict[str, np.ndarray], path: Path) -> None:
    """NumPy, one array."""
    np.save(path, next(iter(columns.values())))


def write_mat(columns: dict[str, np.ndarray], path: Path) -> None:
    """MATLAB, version 5."""
    from scipy.io import savemat

    savemat(path, columns)


def write_hdf5(columns: dict[str, np.ndarray], path: Path) -> None:
    """HDF5."""
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[name] = values.astype("S8") if values.dtype.kind == "U" else values


def write_parquet(columns: dict[str, np.ndarray], path: Path) -> None:
    """Parquet; a column is a list."""
    import pyarrow
    from pyarrow import parquet

    lists = {
        name: pyarrow.array(values.tolist() if values.ndim else [values.item()]) for name, values in columns.items()
    }
    parquet.write_table(pyarrow.table(lists), path)


def write_tdms(columns: dict[str, np.ndarray], path: Path) -> None:
    """TDMS of LabVIEW."""
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as file:
        file.write_segment([ChannelObject("group", name, values) for name, values in columns.items()])


def write_wav(columns: dict[str, np.ndarray], path: Path) -> None:
    """Sound of one channel or more."""
    from scipy.io import wavfile

    wavfile.write(path, 1000, next(iter(columns.values())))


def write_raw(columns: dict[str, np.ndarray], path: Path) -> None:
    """Waveforms of ngspice, in binary."""
    names, table = list(columns), np.column_stack([np.ravel(values).astype(float) for values in columns.values()])
    head = io.StringIO()
    head.write("Title: bench\nDate: 1\nPlotname: Transient Analysis\nFlags: real\n")
    head.write(f"No. Variables: {len(names)}\nNo. Points: {len(table)}\nVariables:\n")
    for k, name in enumerate(names):
        head.write(f"\t{k}\t{'time' if k == 0 else f'v({name})'}\t{'time' if k == 0 else 'voltage'}\n")
    path.write_bytes(head.getvalue().encode() + b"Binary:\n" + table.astype("<f8").tobytes())


BINARIES: dict[str, Callable[[dict[str, np.ndarray], Path], None]] = {
    "run.npz": write_npz, "run.npy": write_npy, "run.mat": write_mat, "run.h5": write_hdf5,
    "run.parquet": write_parquet, "run.tdms": write_tdms, "run.wav": write_wav, "run.raw": write_raw,
}  # fmt: skip
