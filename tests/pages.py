"""Reports whose page alone is looked at."""

from contextlib import contextmanager

import pytest

from piezoharvest.report.figures import style


@contextmanager
def figures_on_the_page_only():
    """Draw figures into the page, not into the files beside it, which take most of the time of a report.

    The files are there, but empty: `tests/report/test_every_report.py` holds what they show.
    """
    with pytest.MonkeyPatch.context() as patch:
        for name in ("write_png", "write_pdf"):
            patch.setattr(style, name, lambda figure, stream: None)
        yield
