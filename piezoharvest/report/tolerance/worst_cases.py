"""Rows of a report's table of worst cases."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from piezoharvest.design.robust.worst import LimitCase, RobustCase
from piezoharvest.report.subjects import Subject
from piezoharvest.report.units import SPACE, decibel, engineering, number, percent
from piezoharvest.study import Study

_MIN_COST = 1e-4  # of the power, or dB: what is less is within the accuracy of the tuning, and of either sign


class WorstRow(NamedTuple):
    """Worst case of a candidate: figures as text, deviations in the worst corner, what is known of it, and limits."""

    label: str
    nominal: str
    worst: str
    cost: str
    corner: list[tuple[str, str]]
    known: str
    limits: list[tuple[str, bool]]
    sure: bool


def worst_cases(subjects: Sequence[Subject]) -> list[WorstRow]:
    """One row for each candidate with a worst case."""
    rows = []
    for s in subjects:
        case = s.candidate.worst_case
        if case is None:
            continue
        shown = _shown(case)
        cost = "0" if abs(case.nominal_cost) < _MIN_COST else _loss(case, case.nominal_cost)
        corner = [(name, _deviation(name, value)) for name, value in case.corner.items()]
        limits = [_limit(limit, case.binds) for limit in case.limits]
        nominal = shown(getattr(s.candidate, case.objective))
        rows.append(WorstRow(s.label, nominal, shown(case.worst), cost, corner, _known(case), limits, case.converged))
    return rows


def worst_case_text(study: Study, subjects: Sequence[Subject]) -> str:
    """The worst case of the best candidate in one sentence; empty without a tolerance."""
    case = next((s.candidate.worst_case for s in subjects if s.candidate.worst_case), None)
    if case is None or study.design is None:
        return ""
    what = "damping" if case.objective == "attenuation_db" else "power"
    at = ", ".join(f"{name.replace('_', ' ')} {_deviation(name, value)}" for name, value in case.corner.items())
    where = f"at {at}" if at else "without any deviation"
    ranked = "Candidates were tuned for, and are ranked by, the worst case" if study.design.worst_case else (
        "Candidates were tuned for the nominal values")  # fmt: skip
    return f"The least {what} of {subjects[0].label} is {_shown(case)(case.worst)}, {where}. {ranked}."


def _shown(case: RobustCase):
    return decibel if case.objective == "attenuation_db" else lambda value: engineering(value, "W")


def _loss(case: RobustCase, value: float) -> str:
    return f"{number(value, 2)}{SPACE}dB" if case.objective == "attenuation_db" else percent(value, 2)


def _deviation(name: str, value: float) -> str:
    """Deviation with its sign: in K or in percent."""
    sign = "" if value == 0 else "+" if value > 0 else "\u2212"
    size = f"{number(abs(value))}{SPACE}K" if name == "temperature" else percent(abs(value))
    return f"{sign}{size}"


def _known(case: RobustCase) -> str:
    """The certificate, or the samples that verify the worst case, in words."""
    if case.certified is not None:
        text = f"never below {_shown(case)(case.certified)}"
        if case.objective == "attenuation_db":
            text = f"never above {_shown(case)(case.certified)}"
        return f"{text} (gap {_loss(case, case.gap or 0.0)})"
    if not case.samples:
        return "not verified by samples"
    return f"worst of {case.samples} samples: {_shown(case)(case.sampled)}"


def _limit(limit: LimitCase, binds: str | None) -> tuple[str, bool]:
    """A limit and what it meets at worst, and True if it is kept."""
    state = "kept" if limit.kept else "broken"
    nearest = ", the nearest" if limit.name == binds else ""
    return f"{limit.name.replace('_', ' ')}: {state}{nearest}", limit.kept
