"""Make the page: `python -m reports.actuators`; with names of figures, these alone."""

from __future__ import annotations

import sys
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

from piezoharvest.output import atomic
from piezoharvest.report.figures import style
from reports.actuators.data import DATA
from reports.actuators.figures import FIGURES
from reports.actuators.page import write_page

HERE = Path(__file__).parent


def main(names: list[str]) -> int:
    """Fit, draw and write; 2 for a figure that there is not, or where the measured data are absent."""
    console = Console(stderr=True)
    unknown = [name for name in names if name not in FIGURES]
    if unknown or not DATA.is_dir():
        found = f"found {unknown[0]!r}, allowed are {', '.join(FIGURES)}" if unknown else f"found no {DATA}"
        console.print(f"figures: {found}")
        return 2
    for name in names or FIGURES:
        with console.status(f"drawing {name}"):
            _write(FIGURES[name](), HERE / f"{name}.png")
    if not names:
        print(write_page(HERE))
    return 0


def _write(figure: Figure, path: Path) -> None:
    """As PNG of few colours: a quarter of the size."""
    style.write_png(figure, path)
    with Image.open(path) as image:
        small = image.convert("RGB").quantize(96)
    with atomic(path) as temporary:
        small.save(temporary, optimize=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
