"""Valid input made wrong where its structure is: keys and values of tables, lines and cells of text, binary data."""

from __future__ import annotations

import copy
import datetime
import math
import random
from typing import Any

# What stands where a number, a word or a table is expected.
ODD: tuple[Any, ...] = (
    0, 0.0, -0.0, 1, -1, 1e-320, 1e-30, 1e30, 1e308, math.inf, -math.inf, math.nan, 2**63 - 1, -(2**63), True, False,
    "", " ", "nan", "5 N", "3 V", "1e-3", "-2 nF", "12 parsec", "µ", "\u202e", "a\nb", "<b>x</b>", "../up", "x" * 5000,
    [], [0], [math.nan], [1, 2, 3], [[1], [2]], ["a"], [{}], {}, {"kind": "open"}, {"unknown": 1},
    datetime.date(2026, 1, 1),
)  # fmt: skip
CELLS = (
    "", " ", "nan", "-", "1,5", "1.5.2", "0x10", "1e999", "-1e999", "1e-400", "1_000", "\u22125", "12x", "#REF!", '"',
    "'", "9" * 400, "\0", "true", "=1+1", "1 2", "abc", ";", ",", "\t", "\ufeff", "\u00bd", "1e5e5",
)  # fmt: skip


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all keys and items below a table or list."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, each in items for place in [(*path, key), *places(each, (*path, key))]]


def mutate_tables(tables: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    """Tables with one to three values changed, taken away, renamed, added or exchanged."""
    found = copy.deepcopy(tables)
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        every = places(found)
        if not every:
            return found
        *above, key = rng.choice(every)
        holder = at(found, above)
        what = rng.random()
        if what < 0.5:
            holder[key] = copy.deepcopy(rng.choice(ODD))
        elif what < 0.6 and isinstance(holder[key], int | float):
            holder[key] = holder[key] * rng.choice([-1, 1e-12, 1e12, 1e3, 0.5])
        elif what < 0.75:
            del holder[key]
        elif what < 0.85 and isinstance(holder, dict):
            holder[rng.choice(["kind", "unknown", str(key) + "s", str(key).upper(), "", "a.b"])] = holder.pop(key)
        else:
            holder[key] = copy.deepcopy(at(found, rng.choice(every)))
    return found


def at(tables: Any, path: Any) -> Any:
    """What stands at a path, or the deepest there is on the way."""
    for key in path:
        try:
            tables = tables[key]
        except (KeyError, IndexError, TypeError):
            return tables
    return tables


def mutate_text(text: str, rng: random.Random) -> str:
    """Text of a table with lines or cells changed."""
    lines = text.split("\n")
    for _ in range(rng.choice([1, 1, 2, 4])):
        k = rng.randrange(len(lines))
        what = rng.random()
        if what < 0.45:
            lines[k] = _with_other_cell(lines[k], rng)
        elif what < 0.55:
            del lines[k]
        elif what < 0.65:
            lines.insert(k, lines[rng.randrange(len(lines))])
        elif what < 0.75:
            lines.insert(k, rng.choice(CELLS))
        elif what < 0.85:
            lines[k] = lines[k].translate(str.maketrans(",;\t", rng.choice([";,,", "\t\t,", "   "])))
        elif what < 0.95:
            lines = lines[: k + 1]
            lines[-1] = lines[-1][: rng.randrange(len(lines[-1]) + 1)]
        else:
            lines = lines * rng.choice([2, 50])
        lines = lines or [""]
    return "\n".join(lines)


def _with_other_cell(line: str, rng: random.Random) -> str:
    delimiter = next((mark for mark in "\t;," if mark in line), " ")
    cells = line.split(delimiter)
    cells[rng.randrange(len(cells))] = rng.choice(CELLS)
    return delimiter.join(cells)


def mutate_bytes(data: bytes, rng: random.Random) -> bytes:
    """Data of a binary file with bits, numbers of four bytes or whole pieces changed."""
    found = bytearray(data)
    for _ in range(rng.choice([1, 1, 3, 10])):
        if not found:
            break
        k, what = rng.randrange(len(found)), rng.random()
        if what < 0.3:
            found[k] ^= 1 << rng.randrange(8)
        elif what < 0.7:
            number = rng.choice([0, 1, 2, 14, 100, 2**31 - 1, 2**31, 2**32 - 1])
            found[k - k % 4 : k - k % 4 + 4] = number.to_bytes(4, "little")
        elif what < 0.85:
            del found[k : k + rng.choice([1, 4, 100])]
        else:
            found[k:k] = found[: rng.choice([4, 64])]
    return bytes(found)
