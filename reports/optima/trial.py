"""One study of the report, as a row that is kept."""

from __future__ import annotations

from typing import Any

from reports.optima.comparison import compared
from reports.optima.plants import Case


def attempt(case: Case, designs: int, simulated: int) -> dict[str, Any]:
    """Comparisons of a case, with the processor time in s."""
    found, seconds = compared(case.study(), designs, simulated, case.seed)
    kinds = [each._asdict() for each in found]
    return {"name": case.name, "designs": designs, "simulated": simulated, "cpu": seconds, "kinds": kinds}
