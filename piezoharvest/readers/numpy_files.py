"""Files of numpy: .npz with several arrays, .npy with one."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from piezoharvest.readers.arrays import ArrayReader
from piezoharvest.readers.base import ReadError


class NumpyFile(ArrayReader):
    """Arrays that numpy has saved; the one of a .npy file has no name: "[:, 0]", or "[:]" if it is a vector."""

    suffixes: ClassVar[tuple[str, ...]] = (".npz", ".npy")

    def __init__(self, path: Path):
        super().__init__(path)
        try:
            found = np.load(path, mmap_mode="r", allow_pickle=False)
            if isinstance(found, np.ndarray):
                arrays = {"": found}
            else:
                with found:
                    arrays = {name: found[name] for name in found.files}
        except Exception as error:  # zipfile, zlib and numpy each have their own
            allowed = "allowed is a whole file of numpy's, without pickled objects"
            raise ReadError(f"found no readable numpy file ({error}), {allowed}") from None
        self._found({name: array for name, array in arrays.items() if array.dtype.kind in "fiubc"})

    def _values(self, array: Any, index: tuple[Any, ...]) -> Any:
        return array[index]
