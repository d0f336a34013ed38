"""Answers of the page of `piezoharvest explore`, without the browser: a circuit and the bound at another frequency."""

from __future__ import annotations

from itertools import count

from piezoharvest.explore.study import StudyExplorer
from piezoharvest.study import Study
from reports.speed import studies
from reports.speed.timing import repeat

STEP = 0.01  # Hz; a slider that moves, so that no bound is one of before


def measure(repeats: int = 5) -> dict:
    """Median time of an answer of each circuit, s."""
    rows = []
    for case in (studies.sshi(), studies.sshi(stops=True), studies.sshc()):
        system, excitation = case.objects()
        explorer = StudyExplorer(Study(transducer=system.transducer, excitation=excitation, shunts=(system.shunt,)))
        frequencies = (studies.DRIVE["frequency"] + STEP * n for n in count(1))

        def moved(explorer=explorer, frequencies=frequencies) -> None:
            answer = explorer.answer(0, {"excitation.frequency": next(frequencies)})
            assert answer.response.converged and answer.bound is not None

        moved()
        rows.append({"title": case.title, "seconds": repeat(moved, repeats).median})
    return {"rows": rows}
