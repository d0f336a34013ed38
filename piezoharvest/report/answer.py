"""The result of a design in one sentence, with its main figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezoharvest.report.limits import Limit
from piezoharvest.report.spans import design_band, drive_frequency, frequency_range
from piezoharvest.report.subjects import Subject, values_of
from piezoharvest.report.tables import near_limit
from piezoharvest.report.units import SPACE, decibel, engineering, kind_name, percent
from piezoharvest.study import Study


@dataclass(frozen=True)
class Answer:
    """Result of a design in words and figures.

    Attributes
    ----------
    sentence : str
    warning : str
        Reason why the result is unreliable; empty where it is reliable.
    cards : list of (name, value, remark)
    """

    sentence: str
    warning: str
    cards: list[tuple[str, str, str]]


def answer(study: Study, subjects: Sequence[Subject], limit: Limit | None) -> Answer:
    """Result of a design: its best candidate."""
    best = subjects[0]
    c, damping = best.candidate, study.design is not None and study.design.objective == "damping"
    parts = ", ".join(f"{name} = {value}" for name, value in values_of(best.shunt))
    who = f"{best.label} ({parts})" if parts else best.label
    power, displacement = engineering(c.harvested_power, "W"), engineering(c.displacement_amplitude, "m")
    vibration = _vibration(c.attenuation_db)
    if damping:
        does = f"{vibration}, to {displacement}" + (f", and harvests {power}" if best.harvests else "")
    else:
        does = f"harvests {power} and {vibration}"
    sentence = f"Best of {len(subjects)}: {who} {does}, {_where(study)}." if len(subjects) > 1 else (
        f"{who[0].upper()}{who[1:]} {does}, {_where(study)}.")  # fmt: skip
    return Answer(sentence, _warning(best), _cards(best, limit, design_band(study) is not None, damping))


_SIGNALS = {
    "random_base": "the random base acceleration", "record": "the recorded force", "multisine": "the multisine force",
}  # fmt: skip


def _vibration(attenuation: float) -> str:
    """Change of the vibration, in words."""
    text = decibel(attenuation).lstrip("+\u2212")
    if not text[0].isdigit():
        return "changes the vibration by an unknown amount"
    if float(text.split(SPACE)[0]) == 0:
        return "leaves the vibration unchanged relative to shorted electrodes"
    return f"{'raises' if attenuation > 0 else 'lowers'} the vibration by {text} relative to shorted electrodes"


def _where(study: Study) -> str:
    """The excitation, in words."""
    band, frequency, excitation = design_band(study), drive_frequency(study), study.excitation
    what = "base acceleration" if excitation.base else "force"
    unit = "m/s^2" if excitation.base else "N"
    if frequency is None:
        return f"under {_SIGNALS.get(excitation.kind, 'the ' + kind_name(excitation.kind))} of the study"
    amplitude: float = excitation.amplitude  # pyright: ignore[reportAttributeAccessIssue]
    level = f"a sinusoidal {what} of {engineering(amplitude, unit, 4, exact=True)}"
    if band is not None:
        damping = study.design is not None and study.design.objective == "damping"
        judged = "worst vibration" if damping else "mean power, worst vibration"
        return f"under {level} from {frequency_range(band)} ({judged})"
    return f"under {level} at {engineering(frequency, 'Hz', 5, exact=True)}"


def _warning(best: Subject) -> str:
    if not best.candidate.converged:
        message = best.response.message if best.response else ""
        return f"Not to be trusted: {message or 'a simulation behind these results did not converge'}."
    if best.candidate.violates:
        return f"No candidate meets all limits; this one violates {', '.join(best.candidate.violates)}."
    return ""


def _cards(best: Subject, limit: Limit | None, band: bool, damping: bool) -> list[tuple[str, str, str]]:
    """The main figures, the objective's first."""
    c, r = best.candidate, best.response
    remark = "mean over the band" if band else ""
    if limit is not None and near_limit([best], limit):
        remark = f"{percent(c.harvested_power / limit.power)} of what any interface can draw"
    harvest = [("harvested power", engineering(c.harvested_power, "W"), remark)] if best.harvests or not damping else []
    if r is not None and best.harvests:
        harvest.append(("efficiency", percent(r.efficiency), "electrical output over mechanical input"))
        if np.isfinite(r.figure_of_merit):
            merit = f"{r.figure_of_merit:.3g}"
            harvest.append(
                ("figure of merit", merit, "P/(C V_oc² f) at this motion; 1 is the maximum of an ideal bridge")
            )
    amplitude = "largest amplitude in the band" if band else "amplitude"
    motion = [
        ("vibration", decibel(c.attenuation_db), "relative to shorted electrodes"),
        ("displacement", engineering(c.displacement_amplitude, "m"), amplitude),
    ]
    dc = f"dc {engineering(r.dc_voltage, 'V')}" if r is not None and r.dc_voltage else amplitude
    voltage = ("electrode voltage", engineering(c.voltage_amplitude, "V"), dc)
    return [*motion, *harvest, voltage] if damping else [*harvest, *motion, voltage]
