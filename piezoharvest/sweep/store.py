"""Storage of a sweep: chunk by chunk beside its file while it runs, in one file once it is complete."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from piezoharvest.output import atomic, check_directory, writing
from piezoharvest.workers.lock import locked

if TYPE_CHECKING:
    import pyarrow

SUFFIXES = (".parquet", ".csv")
_MARK = "sweep"  # key of the fingerprint in the metadata of a part, and of a complete Parquet file
_LONGEST_HEADER = 2**16  # bytes of the first line of a CSV file that are looked at
_ROWS = 2**16  # rows of a row group, at least


class Store:
    """Parts of a table in a folder beside the final file.

    Every part is written atomically and carries the fingerprint of its sweep: after a kill at any moment the folder
    only holds complete parts, which are used if they belong to this sweep.

    Parameters
    ----------
    out : Path
        The final file, .parquet or .csv.
    schema : pyarrow.Schema
        Columns of the table.
    fingerprint : str
        Hash of all that the table depends on.

    Attributes
    ----------
    folder : Path
        FILE.partial.
    """

    def __init__(self, out: Path, schema: pyarrow.Schema, fingerprint: str):
        self._target = Path(os.path.realpath(out))
        self.folder = self._target.with_name(f"{self._target.name}.partial")
        self._schema = schema
        self._marked = schema.with_metadata({_MARK: fingerprint})

    def replaced(self) -> str:
        """Sentence on the table of another sweep that is at the file's place; empty if none is.

        A CSV file has no fingerprint: there only other columns tell it.
        """
        found = _COLUMNS[self._target.suffix.lower()](self._target)
        if found is None or not {"design", "shunt", "kind", "converged"} <= set(found[0]):
            return ""
        names, mark = found
        if (mark is None or mark == self._marked.metadata[_MARK.encode()]) and names == self._schema.names:
            return ""
        return f"{self._target} holds the table of another study, sweep or version, which the new one will replace"

    @contextmanager
    def opened(self) -> Iterator[tuple[set[int], bool]]:
        """Make the folder, or resume with its parts, and lock it against other processes.

        Yields
        ------
        found : set of int
            Indices of the parts that are there.
        foreign : bool
            True if there were parts of another sweep, which have been removed.

        Raises
        ------
        OutputError
            The folder cannot be written to, or another process is using it.
        """
        check_directory(self.folder, create=True)
        with locked(self.folder / "lock", f"{self.folder}: another sweep is writing the same file"):
            schemas = {path: _schema_of(path) for path in self._parts()}
            own = {p for p, found in schemas.items() if found and found.equals(self._marked, check_metadata=True)}
            useless = schemas.keys() - own
            for path in (*useless, *self.folder.glob(".*.part.arrow")):
                path.unlink()
            try:
                yield {int(path.stem) for path in own}, any(schemas[path] is not None for path in useless)
            finally:
                self._leave()

    def put(self, part: int, table: pyarrow.Table) -> None:
        """Store a part."""
        import pyarrow as pa

        with (
            writing(self._target),
            atomic(self._path(part)) as path,
            pa.OSFile(str(path), "wb") as sink,
            pa.ipc.new_file(sink, self._marked) as writer,
        ):
            writer.write_table(table)

    def finish(self, parts: int, look: Callable[[pyarrow.Table], object]) -> None:
        """Write the final file from all parts in order, and remove them.

        Parameters
        ----------
        parts : int
            Number of parts.
        look : callable
            Called with the rows of the final file, in order, some ten thousand at a time.
        """
        write_to = _WRITERS[self._target.suffix.lower()]
        whole = self.folder / f"whole{self._target.suffix.lower()}"
        try:
            with writing(self._target), write_to(whole, self._marked) as write:
                for table in self._groups(parts):
                    write(table)
                    look(table)
            os.replace(whole, self._target)
        finally:
            whole.unlink(missing_ok=True)
        for path in self._parts():
            path.unlink()

    def _path(self, part: int) -> Path:
        return self.folder / f"{part:08d}.arrow"

    def _parts(self) -> list[Path]:
        return sorted(self.folder.glob("[0-9]*.arrow"))

    def _leave(self) -> None:
        """Remove the folder unless it holds something to resume from."""
        if not self._parts():
            (self.folder / "lock").unlink(missing_ok=True)
            with suppress(OSError):  # user files in it
                self.folder.rmdir()

    def _groups(self, parts: int) -> Iterator[pyarrow.Table]:
        """Tables of `_ROWS` rows or more, in order."""
        import pyarrow as pa

        tables: list[Any] = []
        for part in range(parts):
            with pa.OSFile(str(self._path(part))) as source:
                tables.append(pa.ipc.open_file(source).read_all().replace_schema_metadata())
            if part == parts - 1 or sum(table.num_rows for table in tables) >= _ROWS:
                yield pa.concat_tables(tables).combine_chunks()
                tables = []


def _schema_of(path: Path) -> pyarrow.Schema | None:
    """Schema and metadata of a part, or None if the file is none."""
    import pyarrow as pa

    try:
        with pa.OSFile(str(path)) as source:
            return pa.ipc.open_file(source).schema
    except pa.ArrowInvalid:
        return None


@contextmanager
def _parquet(path: Path, schema: pyarrow.Schema) -> Iterator[Callable[[pyarrow.Table], object]]:
    from pyarrow import parquet

    with parquet.ParquetWriter(path, schema) as writer:
        yield lambda table: writer.write_table(table, row_group_size=table.num_rows)


@contextmanager
def _csv(path: Path, schema: pyarrow.Schema) -> Iterator[Callable[[pyarrow.Table], object]]:
    from pyarrow import csv

    plain = csv.WriteOptions(include_header=False, quoting_style="none")
    with path.open("wb") as stream:
        stream.write((",".join(schema.names) + "\n").encode())
        with csv.CSVWriter(stream, schema, write_options=plain) as writer:
            yield writer.write_table


_WRITERS = {".parquet": _parquet, ".csv": _csv}


def _columns_of_parquet(path: Path) -> tuple[list[str], bytes | None] | None:
    """Names of the columns and fingerprint of a table; None if the file is none or cannot be read."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        schema = parquet.read_schema(path)
    except (OSError, pa.ArrowException):
        return None
    return schema.names, (schema.metadata or {}).get(_MARK.encode())


def _columns_of_csv(path: Path) -> tuple[list[str], None] | None:
    """As `_columns_of_parquet`, from the first line."""
    try:
        with path.open("rb") as stream:
            return stream.readline(_LONGEST_HEADER).decode().strip().split(","), None
    except (OSError, UnicodeDecodeError):
        return None


_COLUMNS: Mapping[str, Callable[[Path], tuple[list[str], bytes | None] | None]] = {
    ".parquet": _columns_of_parquet,
    ".csv": _columns_of_csv,
}
