"""Parquet files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from piezoharvest.readers.base import Reader, ReadError, check_count, numbers


class Parquet(Reader):
    """Parquet file; null values become NaN."""

    suffixes: ClassVar[tuple[str, ...]] = (".parquet",)
    magic: ClassVar[tuple[bytes, ...]] = (b"PAR1",)
    unsafe: ClassVar[tuple[str, ...]] = ("pyarrow.parquet",)

    def __init__(self, path: Path):
        from pyarrow import ArrowException, parquet

        super().__init__(path)
        try:
            self._file = parquet.ParquetFile(path)
        except (ArrowException, OSError) as error:
            raise ReadError(f"not a complete Parquet file ({error})") from None
        self.names = tuple(self._file.schema_arrow.names)

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        from pyarrow import ArrowException

        check_count(len(names) * self._file.metadata.num_rows)
        try:
            return {name: self._column(name) for name in names}
        except (ArrowException, OSError) as error:
            raise ReadError(f"the file is damaged ({error})") from None

    def _column(self, name: str) -> np.ndarray:
        """One column, read row group by row group to limit memory."""
        groups = (self._file.read_row_group(n, columns=[name]) for n in range(self._file.num_row_groups))
        parts = [numbers(group.column(0).to_numpy(), name) for group in groups]
        return np.concatenate(parts) if parts else np.empty(0)

    def close(self) -> None:
        self._file.close()
