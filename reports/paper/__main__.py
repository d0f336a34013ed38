"""Make the page: `python -m reports.paper`."""

from __future__ import annotations

import sys
from pathlib import Path
from unittest.mock import patch

from rich.console import Console

from reports.paper.audit import audit, fits, outlook
from reports.paper.gallery import pictures
from reports.paper.page import write_page


def main() -> int:
    """Simulate, fit, audit, draw and write; 1 where a finding is no longer supported by its numbers."""
    # Nothing here is an attenuation; the short circuit that it is measured against would take most of the time.
    with patch("piezoharvest.engine.simulation._short_circuit", return_value=(1.0, "")):
        return _make(Console(stderr=True))


def _make(console: Console) -> int:
    with console.status("simulating and auditing"):
        findings = {"audit": audit()}
    with console.status("fitting candidates (some minutes)"):
        findings["fits"] = [check() for check in fits.CHECKS]
    with console.status("harvesting circuits"):
        findings["outlook"] = [check() for check in outlook.CHECKS]
    with console.status("drawing"):
        page = write_page(findings, pictures(), Path(__file__).parent)
    print(page)
    lost = [f.name for group in findings.values() for f in group if not f.supported]
    for name in lost:
        console.print(f"not supported by the numbers as they are now: {name}")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
