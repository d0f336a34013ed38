"""`python -m reports.disagreement`: run the story of designs/simulator-disagrees, and keep what it prints."""

from __future__ import annotations

import contextlib
import importlib.util
import io
from datetime import date
from pathlib import Path
from tempfile import TemporaryDirectory

from piezoharvest.output import write_text

STORY = Path(__file__).parents[2] / "designs" / "simulator-disagrees" / "disagrees.py"
HEAD = """# A circuit simulation that yields 12 % less

ngspice simulates the bench of Liang & Liao (2012) at 42 Hz with 1 nS across its 31 kH inductor, which nobody is told
of; `diagnose` has its records and the stated parts. [The story](../../designs/simulator-disagrees/README.md) says what
follows from it.

Power of a rectifier over its loads: by this engine and by ngspice with the stated parts, by ngspice with the hidden
one, and its share. Then what `diagnose` finds at each frequency, and in one campaign of all of them. Made by
`python -m reports.disagreement`, {day}.

```
{lines}```
"""


def main() -> None:
    """Run the story in a folder that is taken away, and write the page."""
    spec = importlib.util.spec_from_file_location("disagrees", STORY)
    assert spec is not None and spec.loader is not None
    story, printed = importlib.util.module_from_spec(spec), io.StringIO()
    spec.loader.exec_module(story)
    with TemporaryDirectory() as folder, contextlib.redirect_stdout(printed):
        story.main(Path(folder))
    page = HEAD.format(day=date.today().isoformat(), lines=printed.getvalue())
    write_text(page, Path(__file__).parent / "disagreement.md")


if __name__ == "__main__":
    main()
