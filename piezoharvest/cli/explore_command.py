"""The command `explore`, once its arguments are parsed."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from piezoharvest.cli.notes import note
from piezoharvest.output import OutputError, check_file
from piezoharvest.study.studies import load_driven_study


def explore(path: Path, *, port: int, save: Path | None) -> int:
    """Serve the page of a study or a campaign until interrupted, and print its address."""
    try:
        from piezoharvest.explore.server import PageServer
    except ModuleNotFoundError as error:
        needed = "the page needs bokeh, which is not installed: pip install 'piezoharvest[explore]'"
        raise OutputError(f"{needed} (no module {error.name!r})") from None
    saved = check_file(path.with_name(f"{path.stem}-explored.toml") if save is None else save, (".toml",))
    server = PageServer(_page(path, saved), port)
    print(server.address, flush=True)
    note("open this address in a browser on this machine; Ctrl-C ends")
    try:
        server.run()
    except KeyboardInterrupt:
        note("ended")
    return 0


def _page(path: Path, saved: Path) -> Any:
    """Function that draws the page; the engine is compiled, and the campaign identified, before it is opened."""
    from piezoharvest.explore.study import StudyExplorer
    from piezoharvest.explore.study_page import StudyPage

    explorer = StudyExplorer(load_driven_study(path))
    note("compiling the engine, on its first use")
    explorer.answer(0, {})
    return partial(StudyPage, explorer, saved=saved)
