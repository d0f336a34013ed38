"""The command `explore`, once its arguments are parsed."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from piezoharvest.cli.commands import driven_study
from piezoharvest.cli.notes import note
from piezoharvest.cli.on_campaigns.running import on_campaign
from piezoharvest.output import OutputError, check_file
from piezoharvest.study import read_toml


def explore(path: Path, *, port: int, save: Path | None) -> int:
    """Serve the page of a study or a campaign until interrupted, and print its address."""
    try:
        from piezoharvest.explore.server import PageServer
    except ModuleNotFoundError as error:
        needed = "the page needs bokeh, which is not installed: pip install 'piezoharvest[explore]'"
        raise OutputError(f"{needed} (no module {error.name!r})") from None
    saved = check_file(path.with_name(f"{path.stem}-explored.toml") if save is None else save, (".toml",))
    page = _page(path, saved)
    if page is None:
        return 1
    server = PageServer(page, port)
    print(server.address, flush=True)
    note("open this address in a browser on this machine; Ctrl-C stops the server")
    try:
        server.run()
    except KeyboardInterrupt:
        note("ended")
    return 0


def _page(path: Path, saved: Path) -> Any:
    """Function that draws the page; the engine is compiled, or the campaign identified, before it is opened."""
    table = read_toml(path)
    if "records" in table or "specimens" in table:
        from piezoharvest.explore.campaign import CampaignExplorer
        from piezoharvest.explore.campaign_page import CampaignPage
        from piezoharvest.identify import identify

        found = on_campaign(path, None, None, identify)
        return None if found is None else partial(CampaignPage, CampaignExplorer(found))
    from piezoharvest.explore.study import StudyExplorer
    from piezoharvest.explore.study_page import StudyPage

    explorer = StudyExplorer(driven_study(path))
    note("compiling the engine on first use")
    explorer.answer(0, {})
    return partial(StudyPage, explorer, saved=saved)
