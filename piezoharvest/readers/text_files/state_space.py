"""State-space models of modes, as ANSYS writes them (SPMWRITE): matrices A, B and C in Matrix Market format.

States are the modal coordinates and their rates, for shapes of unit modal mass: A = [0, 1; -omega^2, -2 zeta omega],
B = [0; shapes at the inputs], C = [shapes at the outputs, 0]; rows of C for velocities and accelerations may follow.

Formats: ANSYS Mechanical APDL Theory Reference, "State-Space Matrices Export", and Command Reference, SPMWRITE with
FileFormat = 1; Boisvert, Pozo & Remington, The Matrix Market Exchange Formats, NISTIR 5935, 1996. How the matrices
follow each other in the file is published nowhere: here each one begins with its line %%MatrixMarket, in the order A,
B, C, D. What the matrices hold is checked.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.readers.base import ReadError

MOST_BYTES, MOST_ENTRIES = 2**26, 10**7
_BANNER = re.compile(r"^%%MatrixMarket\b.*$", re.MULTILINE | re.IGNORECASE)
_CLOSE = 1e-6  # relative, of what must be zero or one: a dozen digits are written


@dataclass(frozen=True, eq=False)
class StateSpaceModes:
    """Modes of a state-space model.

    Attributes
    ----------
    frequency, damping_ratio : (n,) array
        Hz, and share of critical damping.
    inputs : (n, inputs) array
        Shapes at the inputs, kg^-1/2 for a force and N/(V kg^1/2) for a voltage.
    outputs : (outputs, n) array
        Shapes at the outputs, kg^-1/2.
    """

    frequency: np.ndarray
    damping_ratio: np.ndarray
    inputs: np.ndarray
    outputs: np.ndarray

    def at(self, number: Any, key: str) -> np.ndarray | None:
        """Shapes (n,) at an output, of the "sensor", or else at an input, by its number from 1 on; raises `ReadError`.

        None for the "base", of which the file knows nothing.
        """
        if key == "base":
            return None
        known, where = (self.outputs, "rows of C") if key == "sensor" else (self.inputs.T, "columns of B")
        if type(number) is not int or not 1 <= number <= len(known):
            raise ReadError(f"found {number!r:.40}, must be a number from 1 to {len(known)}, the {where}")
        return known[number - 1]


def read_state_space(path: Path) -> StateSpaceModes:
    """Modes of a file of SPMWRITE.

    Raises
    ------
    ReadError
        It is in another of its formats, or does not hold matrices of modes.
    """
    if path.stat().st_size > MOST_BYTES:
        raise ReadError(f"found {path.stat().st_size} bytes, allowed are up to {MOST_BYTES}")
    matrices = _matrices(path.read_text(encoding="utf-8", errors="replace"))
    if len(matrices) < 3:
        found = f"found {counted(len(matrices), 'matrix', 'matrices')} in Matrix Market format"
        others = "0 (dense) and 2 to 4 (SML, the default) are not read"
        raise ReadError(f"{found}, must be A, B and C, as SPMWRITE writes them with FileFormat = 1; {others}")
    a, b, c = matrices[:3]
    n = len(a) // 2
    if a.shape != (2 * n, 2 * n) or not n or len(b) != 2 * n or c.shape[1] != 2 * n:
        shapes = ", ".join(f"{rows} x {columns}" for rows, columns in (a.shape, b.shape, c.shape))
        raise ReadError(f"found matrices of {shapes}, must be A of 2n x 2n, B with 2n rows and C with 2n columns")
    squares, rates = -np.diag(a[n:, :n]), -np.diag(a[n:, n:])
    expected = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(squares), -np.diag(rates)]])
    if not np.all(squares > 0) or np.abs(a - expected).max(axis=1).max() > _CLOSE * np.abs(a).max():
        raise ReadError("found a matrix A that is not that of modes, must be [0, 1; -omega^2, -2 zeta omega]")
    if np.any(np.abs(a[:n] - expected[:n]) > _CLOSE) or np.any(np.abs(b[:n]) > _CLOSE * np.abs(b).max()):
        raise ReadError("found rates of modal coordinates that are not the states in the lower half of A, must be them")
    omega = np.sqrt(squares)
    return StateSpaceModes(omega / (2 * np.pi), rates / (2 * omega), b[n:], c[:, :n])


def _matrices(text: str) -> list[np.ndarray]:
    """All matrices of a text, each from its banner to its last entry; what stands between is left out."""
    begins = [banner.start() for banner in _BANNER.finditer(text)]
    spans = pairwise([*begins, len(text)])
    return [_matrix(text[begin:end], number) for number, (begin, end) in enumerate(spans, 1)]


def _matrix(text: str, number: int) -> np.ndarray:
    """The matrix at the beginning of a text."""
    from scipy.io import mmread

    banner, *lines = text.splitlines()
    rows = [line for line in lines if line.strip() and not line.startswith("%")]
    no_matrix = f"found no Matrix Market matrix behind banner {number}"
    try:
        size = [int(word) for word in rows[0].split()]
        count = size[2] if "coordinate" in banner.lower() else size[0] * size[1]
    except (ValueError, IndexError):
        raise ReadError(f"{no_matrix}, must be its size") from None
    if max(size[0] * size[1], count) > MOST_ENTRIES:
        raise ReadError(f"found {size[0]} x {size[1]} entries in matrix {number}, allowed are up to {MOST_ENTRIES}")
    try:
        found: Any = mmread(io.StringIO("\n".join([banner, *rows[: count + 1], ""])))
    except (ValueError, OverflowError) as error:
        raise ReadError(f"{no_matrix} ({error})") from None
    dense = np.asarray(found.toarray() if hasattr(found, "toarray") else found)
    if np.iscomplexobj(dense) or not np.all(np.isfinite(dense)):
        raise ReadError(f"found entries in matrix {number} that are no finite real numbers")
    return dense.astype(float)
