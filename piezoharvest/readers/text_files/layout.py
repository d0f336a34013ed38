"""Layout of a text file: first row of its table of numbers, delimiter and decimal mark, names of the columns.

The table is the first run of rows of equal width that are numbers. The text above it, an instrument's preamble, may
be anything; the rows right above the table give the names and units of the columns.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from piezoharvest.counting import counted
from piezoharvest.readers.base import ReadError, cut
from piezoharvest.readers.units import unit_of

COMMENT = ("#", "%")
_MISSING = {"", "n/a", "na", "#n/a", "null", "nan", "-nan", "1.#ind", "-1.#ind", "1.#qnan", "-1.#qnan"}
_INFINITE = {"inf", "infinity", "\u221e"}  # PicoScope writes the sign of infinity where its range is exceeded
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_CUT_NUMBER = re.compile(r"[+-]?\d*\.?\d*(?:[eE][+-]?\d*)?")  # possible rest of a number at the end of a truncated file
_BLANKS = re.compile(r'"[^"]*"|\S+')
_MIN_TABLE_ROWS = 3  # rows of numbers that make a table: a preamble may have one or two, as a scale for each channel
MAX_HEADER_LINES = 3  # lines above the table that may hold names and units
_NO_UNITS = {"", "-", "1", "sequence"}  # in a row of units: oscilloscopes number their samples
_COMMENT_COLUMN = "comment"  # LabVIEW's last column, which only rows with a comment have
ADVICE = "skip_rows (number of lines to skip) or header_row (line of the names) tells where it begins"


@dataclass(frozen=True)
class Dialect:
    """Delimiter of the cells of a line (None: blanks), and decimal mark."""

    delimiter: str | None
    decimal: str

    def split(self, line: str) -> list[str]:
        """Cells of a line, without quotation marks and blanks around them."""
        line = line.strip() if self.delimiter is None else line.strip("\r\n")
        if self.delimiter is None:
            cells = _BLANKS.findall(line)
        elif '"' in line:
            try:
                cells = next(csv.reader([line], delimiter=self.delimiter, skipinitialspace=True), [""])
            except csv.Error:  # a cell of more than 128 KiB
                cells = line.split(self.delimiter)
        else:
            cells = line.split(self.delimiter)
        return [cell.strip().strip('"').strip() for cell in cells]

    def number(self, cell: str) -> float | None:
        """Value of a cell; NaN if it is marked as missing, None if it is not a number."""
        text = cell.replace(self.decimal, ".") if self.decimal != "." else cell
        if _NUMBER.fullmatch(text) and not (self.decimal != "." and "." in cell):
            return float(text)
        word = cell.lower()
        if word in _MISSING:
            return float("nan")
        return float(word.replace("\u221e", "inf")) if word.lstrip("+-") in _INFINITE else None

    def is_number(self, cell: str) -> bool:
        """True if a cell is a number or is marked as missing."""
        return self.number(cell) is not None

    def is_cut(self, cells: Sequence[str]) -> bool:
        """True if the cells may be a truncated row of numbers."""
        return all(
            self.is_number(cell) or _CUT_NUMBER.fullmatch(cell.replace(self.decimal, ".")) is not None for cell in cells
        )


# By precedence: a comma beside semicolons, tabs or blanks is a decimal mark; else it is the delimiter.
_DIALECTS = [Dialect(d, m) for d in (";", "\t", ",", None) for m in (".", ",")]


@dataclass(frozen=True)
class TextLayout:
    """Layout of a text file.

    Attributes
    ----------
    dialect : Dialect
    names : tuple of str
        Names of the columns; "1", "2", ... if the file has none.
    units : tuple of str
        Units of the columns from a row of units; "" if none is given.
    width : int
        Cells of a row.
    numeric : tuple of int
        Columns that are numbers in all rows that were examined.
    above : int
        Lines above the table.
    header : frozenset of str
        Lines of the preamble that have text: if they are repeated, the table continues below them.
    named : bool
        True if the names are from the file.
    remarks : bool
        True if a row may end in a comment, for which the header has one more column.
    """

    dialect: Dialect
    names: tuple[str, ...]
    units: tuple[str, ...]
    width: int
    numeric: tuple[int, ...]
    above: int
    header: frozenset[str]
    remarks: bool
    named: bool


@dataclass
class _NumberRows:
    """Run of rows of equal width that are numbers: first and last line, from 0, and the columns that are numeric."""

    dialect: Dialect
    first: int
    last: int
    width: int
    numeric: frozenset[int]
    count: int
    whole: bool  # up to the end of the lines


def find_layout(lines: Sequence[str], skip_rows: int = 0, header_row: int | None = None) -> TextLayout:
    """Find the table in the first lines of a file.

    Parameters
    ----------
    lines : sequence of str
    skip_rows : int
        Number of lines to skip.
    header_row : int, optional
        Line, from 1, with the names of the columns.

    Raises
    ------
    ReadError
        There is no table.
    """
    begin = max(skip_rows, header_row or 0)
    run = _table(lines, begin)
    if run is None:
        seen = next(((n, line) for n, line in enumerate(lines[begin:], begin + 1) if line.strip()), None)
        what = f"no rows of numbers (line {seen[0]} is {cut(seen[1])!r})" if seen else "no samples"
        raise ReadError(f"found {what}, but a table of numbers is needed; {ADVICE}")
    names, units = _names(lines, run, skip_rows, header_row)
    named = bool(names)
    names = names or tuple(str(n) for n in range(1, run.width + 1))
    words = (line for line in lines[: run.first] if not all(map(run.dialect.is_number, run.dialect.split(line))))
    header = frozenset(line.strip() for line in words)
    remarks = any(
        _bare(line).split(run.dialect.delimiter)[-1].strip().lower() == _COMMENT_COLUMN
        for line in lines[max(run.first - MAX_HEADER_LINES, 0) : run.first]
        if line.strip()
    )
    return TextLayout(
        run.dialect, names, units, run.width, tuple(sorted(run.numeric)), run.first, header, remarks, named
    )


def _table(lines: Sequence[str], begin: int) -> _NumberRows | None:
    """The table by the dialect that gives the most rows; columns of text, such as dates, only if there is no other."""
    found = [_first_run(lines, begin, dialect, True) for dialect in _DIALECTS]
    if not any(found):
        found = [_first_run(lines, begin, dialect, False) for dialect in _DIALECTS]
        found += [_first_run(lines, begin, dialect, True, 1) for dialect in _DIALECTS if dialect.delimiter is None]
    return max((run for run in found if run), key=lambda run: run.count, default=None)  # the first of equals


def _first_run(
    lines: Sequence[str], begin: int, dialect: Dialect, strict: bool, least_width: int = 2
) -> _NumberRows | None:
    """The first run of several rows, or else the longest; if rows may contain text, always the longest."""
    longest: _NumberRows | None = None
    for run in _runs(lines, begin, dialect, strict, least_width):
        if longest is None or run.count > longest.count:
            longest = run
        if strict and run.count >= _MIN_TABLE_ROWS:
            break
    if longest is None or (longest.count < 2 and not longest.whole):
        return None
    return _extended_upward(longest, lines, begin) if strict else longest


def _runs(lines: Sequence[str], begin: int, dialect: Dialect, strict: bool, least_width: int) -> Iterator[_NumberRows]:
    """All runs of rows of equal width; blank lines and comments are skipped."""
    run: _NumberRows | None = None
    for n in range(begin, len(lines)):
        if not lines[n].strip() or lines[n].lstrip().startswith(COMMENT):
            continue
        cells = dialect.split(lines[n]) if (dialect.delimiter or "") in lines[n] else []
        numeric = _numbers(dialect, cells, strict) if len(cells) >= least_width else frozenset[int]()
        if run is not None and len(cells) == run.width and _matches_run(run.numeric & numeric, cells, strict):
            run.last, run.numeric, run.count = n, run.numeric & numeric, run.count + 1
            continue
        if run is not None:
            yield run
        run = _NumberRows(dialect, n, n, len(cells), numeric, 1, False) if numeric else None
    if run is not None:
        run.whole = True
        yield run


def _numbers(dialect: Dialect, cells: Sequence[str], strict: bool) -> frozenset[int]:
    """Columns of a row that are numbers; none if they are too few: all filled cells if `strict`, else half of them."""
    filled = [n for n, cell in enumerate(cells) if cell]
    found = [n for n in filled if dialect.is_number(cells[n])]
    enough = len(found) == len(filled) if strict else 2 * len(found) >= len(filled)
    real = enough and any(_NUMBER.fullmatch(cells[n].replace(dialect.decimal, ".")) for n in found)
    return frozenset(found) if real else frozenset()


def _matches_run(common: frozenset[int], cells: Sequence[str], strict: bool) -> bool:
    """True if a row has numbers in the columns in which the rows above have them."""
    return bool(common) and (strict or 2 * len(common) >= sum(1 for cell in cells if cell))


def _extended_upward(run: _NumberRows, lines: Sequence[str], begin: int) -> _NumberRows:
    """Extend a run by the rows above it that have numbers in the same columns, and text in other or further columns.

    Some oscilloscopes write their settings into columns beside the first samples, LabVIEW a comment after the first.
    """
    first = run.first
    while first > begin:
        cells = run.dialect.split(lines[first - 1])
        if len(cells) < run.width or any(run.dialect.is_number(cell) for cell in cells[run.width :] if cell):
            break
        if not all(cells[n] and run.dialect.is_number(cells[n]) for n in run.numeric):
            break
        first -= 1
    return replace(run, first=first)


def _names(
    lines: Sequence[str], run: _NumberRows, skip_rows: int, header_row: int | None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names, if there are any, and units of the columns from the rows above the table."""
    empty = ("",) * run.width
    samples = [run.dialect.split(lines[n]) for n in range(run.first, min(run.last + 1, run.first + _MIN_TABLE_ROWS))]
    if header_row is not None:
        names = _column_names(lines[header_row - 1], run, samples)
        if names is None:
            count = len(run.dialect.split(_bare(lines[header_row - 1])))
            named = f"found {counted(count, 'name')} in {cut(lines[header_row - 1])!r}"
            found = f"{named}, but {counted(run.width, 'column')} in the table"
            raise ReadError(f"{found} that begins in line {run.first + 1}", row=header_row)
        below = [_column_names(line, run, samples) for line in lines[header_row : run.first] if line.strip()]
        units = next((row for row in below if row is not None and _are_units(row)), None)
        return names, _units(units) if units else empty
    near = [n for n in range(run.first - 1, -1, -1) if lines[n].strip()][:MAX_HEADER_LINES]
    fitting = [(n, row) for n in near if (row := _column_names(lines[n], run, samples)) is not None]
    if not fitting:
        _refuse_header(lines, run, [n for n in near if n >= skip_rows])
        return (), empty
    (line, row), *others = fitting
    if others and _are_units(row):
        return others[0][1], _units(row)
    remark = lines[line].lstrip().startswith(COMMENT)
    if others and remark and not lines[others[0][0]].lstrip().startswith(COMMENT):
        row = others[0][1]
    return row, empty


def _refuse_header(lines: Sequence[str], run: _NumberRows, near: Sequence[int]) -> None:
    """Raise an error if the line right above the table has another number of cells: it may name other columns."""
    if not near or near[0] != run.first - 1 or lines[near[0]].lstrip().startswith(COMMENT):
        return
    cells = run.dialect.split(lines[near[0]])
    if len(cells) == 1 and run.width == 2:
        single = _first_run(lines, run.first, _DIALECTS[-1], True, 1)
        if run.dialect == Dialect(",", ".") and single is not None and single.count >= run.count:
            found = f"found {cut(lines[run.first])!r}, which may be two columns or one with a decimal comma"
            raise ReadError(f"{found}: a header with a name for each column would show it; {ADVICE}", row=run.first + 1)
    if len(cells) > 1 and run.dialect.delimiter is not None:
        seen = f"in the header (line {near[0] + 1}: {cut(lines[near[0]])!r})"
        raise ReadError(f"found {counted(run.width, 'column')}, but {len(cells)} {seen}; {ADVICE}", row=run.first + 1)


def _bare(line: str) -> str:
    """A line without the comment character."""
    return line.strip("\r\n").lstrip().lstrip("#% ") if line.lstrip().startswith(COMMENT) else line.strip("\r\n")


def _column_names(line: str, run: _NumberRows, samples: Sequence[Sequence[str]]) -> tuple[str, ...] | None:
    """Cells of a line as names of the table's columns; None if their number differs or they are numbers."""
    cells = [_bare(line).strip().strip('"')] if run.width == 1 else run.dialect.split(_bare(line))
    while len(cells) > run.width and (not cells[-1] or cells[-1].lower() == _COMMENT_COLUMN):
        cells.pop()
    surplus = run.width - len(cells)
    if surplus > 0 and not any(any(row[len(cells) :]) for row in samples):  # a delimiter ends every row of numbers
        cells += [""] * surplus
    words = any(cell and not run.dialect.is_number(cell) for cell in cells)
    return tuple(cells) if len(cells) == run.width and words else None


def _are_units(cells: Sequence[str]) -> bool:
    """True if a row holds units: all of its cells, or, below a time or a frequency in its unit, most of them."""
    inner = [_inner(cell) for cell in cells]
    bracketed = [cell[:1] in ("(", "[", "<") and cell[-1:] in (")", "]", ">") for cell in cells]
    units = [unit_of(text) for text in inner]
    rest = [
        b or u is not None or text.lower() in _NO_UNITS or _NUMBER.fullmatch(text) is not None
        for text, b, u in zip(inner, bracketed, units, strict=True)
    ]
    first = units[0] if units else None
    most = first is not None and first.si in ("s", "Hz") and 3 * sum(rest) >= 2 * len(rest)
    return (any(units) or any(bracketed)) and (all(rest) or most)


def _units(cells: Sequence[str]) -> tuple[str, ...]:
    return tuple(text if unit_of(text := _inner(cell)) else "" for cell in cells)


def _inner(cell: str) -> str:
    """A cell without brackets around it."""
    pair = cell[:1] + cell[-1:]
    inside = cell[1:-1] if pair in ("()", "[]", "<>") else cell
    return (cell if any(mark in inside for mark in pair) and pair in ("()", "[]") else inside).strip()
