"""Transducer of a study by `new` from a universal file: its modes, and where to say what the file does not know."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import tomli_w

from piezoharvest.counting import counted
from piezoharvest.output import OutputError
from piezoharvest.readers import ReadError
from piezoharvest.readers.uff import ModeShapes

_CAPACITANCE, _COUPLED = 60e-9, 0.01  # F, and K^2 of the first mode, until the user's own stand there
_SIDE = 0.2  # half width of a damping band, of the first frequency


def with_host(template: str, path: Path, target: Path) -> str:
    """Template of a study with the modes of a file in the place of its transducer; raises `OutputError`."""
    if not path.is_file():
        raise OutputError(f"found {path}, which is no existing file")
    try:
        shapes = ModeShapes(path)
    except ReadError as error:
        raise OutputError(f"{path}: {error.message}") from None
    name = Path(os.path.relpath(path, target.parent)).as_posix()
    count, first = len(shapes.frequency), float(shapes.frequency[0])
    found = ", ".join(f"{f:.4g}" for f in shapes.frequency[:6]) + (", ..." if count > 6 else "")
    couplings = [float(f"{np.sqrt(_COUPLED * _CAPACITANCE) * 2 * np.pi * first:.2g}")] * count
    lines = [
        f"[transducer]                     # (?): what the file does not know; {counted(count, 'mode')} at {found} Hz",
        tomli_w.dumps({"modes_file": name}).strip(),
        f"capacitance = {_CAPACITANCE:g}             # (?) F, clamped",
        "",
        "[transducer.shapes]",
        f'force = "{shapes.largest()}"                    # (?) node, sign, direction: here where mode 1 moves most',
        '# sensor = "12-X"                # where the displacement is read; default: where the force is',
        f"coupling_0 = {couplings}  # (?) N/(V kg^1/2) for each mode, of unit modal mass: here K^2 of mode 1 is 1 %",
        f"# base = {[0.1] * count}         # kg^1/2 for each mode, for a base acceleration",
        "",
        "",
    ]
    start, end = template.index("[transducer] "), template.index("[excitation]\n")
    text = template[:start] + "\n".join(lines) + template[end:]
    text = re.sub(r"(?m)^frequency = [\d.]+ +", f"frequency = {first:.4g} ".ljust(33), text)
    return re.sub(r"(?m)^band = \[.*?\]", f"band = [{(1 - _SIDE) * first:.4g}, {(1 + _SIDE) * first:.4g}]", text)
