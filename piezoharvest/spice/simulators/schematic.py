"""A netlist as a schematic for LTspice: .asc, a text format of symbols, labels and texts.

Places of pins are those of LTspice's own symbols (lib/sym/res.asy and so on). Two-terminal parts of the circuit are
drawn, each pin with the label of its node; what has no symbol of two pins (the transducer, sources that are
expressions, lines, commands) stands beside them as SPICE directives, which are as good as symbols. A subcircuit is one
directive with its comments, as its lines belong together in whatever order LTspice takes the directives.
"""

from __future__ import annotations

from typing import NamedTuple


class _Symbol(NamedTuple):
    name: str
    plus: tuple[int, int]
    minus: tuple[int, int]


_SYMBOLS = {
    "R": _Symbol("res", (16, 16), (16, 96)),
    "C": _Symbol("cap", (16, 0), (16, 64)),
    "L": _Symbol("ind", (16, 16), (16, 96)),
    "V": _Symbol("voltage", (0, 16), (0, 96)),
    "D": _Symbol("diode", (16, 0), (16, 64)),
}
# Grid of LTspice is 16; a symbol with its names is about this large.
WIDTH, HEIGHT, COLUMNS = 208, 160, 5
LINE = 24  # distance of lines of text


def schematic(netlist: str) -> str:
    """Schematic with the circuit of a netlist.

    Parameters
    ----------
    netlist : str
        As `export_spice` writes it.

    Returns
    -------
    str
        Contents of an .asc file.
    """
    title, *rest = netlist.replace("\n+ ", " ").splitlines()
    parts, texts, inside = [], [], False
    for line in rest:
        inside |= line.startswith(".subckt")
        if not inside and line[:1] in _SYMBOLS:
            parts.append(line)
        elif line != ".end":
            texts.append(line)
        inside &= not line.startswith(".ends")
    rows = -(-len(parts) // COLUMNS)
    lines = ["Version 4", f"SHEET 1 {COLUMNS * WIDTH + 2000} {rows * HEIGHT + LINE * len(texts)}"]
    for n, part in enumerate(parts):
        lines += _drawn(part, n % COLUMNS * WIDTH, n // COLUMNS * HEIGHT)
    lines.append(f"TEXT 0 -{2 * LINE} Left 2 ;{title.removeprefix('* ')}")
    top = rows * HEIGHT + LINE
    for comments, block in _blocks(texts):
        words = "\\n".join(line.removeprefix("*").strip() if comments else line for line in block)
        if words.strip("\\n "):
            lines.append(f"TEXT 0 {top} Left 2 {';' if comments else '!'}{words}")
        top += LINE * len(block)
    return "\n".join([*lines, ""])


def _drawn(line: str, x: int, y: int) -> list[str]:
    """Lines of one symbol with its labels, at a place."""
    name, plus, minus, value = line.split(maxsplit=3)
    symbol = _SYMBOLS[name[0]]
    value, condition, initial = value.partition(" IC=")
    labels = [
        f"FLAG {x + across} {y + down} {node}" for node, (across, down) in ((plus, symbol.plus), (minus, symbol.minus))
    ]
    drawn = [f"SYMBOL {symbol.name} {x} {y} R0", f"SYMATTR InstName {name}", f"SYMATTR Value {value}"]
    return [*labels, *drawn, *([f"SYMATTR SpiceLine IC={initial}"] if condition else [])]


def _blocks(texts: list[str]) -> list[tuple[bool, list[str]]]:
    """Runs of comments and of directives, with whether they are comments; a subcircuit is one run."""
    blocks: list[tuple[bool, list[str]]] = []
    inside = ended = False
    for line in texts:
        begins = line.startswith(".subckt")
        inside |= begins
        comment = line.startswith("*") and not inside
        if blocks and blocks[-1][0] == comment and not begins and not ended:
            blocks[-1][1].append(line)
        else:
            blocks.append((comment, [line]))
        ended = line.startswith(".ends")
        inside &= not ended
    return blocks
