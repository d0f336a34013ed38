"""A diagnosis in tables: values with their units, all effects with their scores, and the verdict in a sentence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from piezoharvest.description.effects import Effect, registered
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.diagnose.result import Diagnosis, Named
from piezoharvest.diagnose.selection.score_tests import ScoredEffect, cosine
from piezoharvest.records.reading.channels import UNITS
from piezoharvest.records.record import Record

HIGHER_MODES = (
    "Part of the remaining residual follows the drive without delay, as the response of modes above the measured band "
    "does: a table [[transducer.modes]] adds a mode."
)
NOT_HERE = "no record has such a circuit"
Value = tuple[float | str, float | None, str]


@dataclass(frozen=True)
class Scored:
    """One effect of the library, tested against the model without any.

    Attributes
    ----------
    name : str
    label : str
        Channel or load at which it scores highest, if it has one; or that it is an effect of a circuit which no record
        has.
    candidate : ScoredEffect or None
        The start with the highest score; None where the records cannot show it, or it would have the wrong sign.
    p_value : float
        p-value of the score, corrected for the number of starts of all effects.
    gain : float or None
        Decrease of -2 ln L when the effect is fitted alone; None where it was not fitted.
    """

    name: str
    label: str
    candidate: ScoredEffect | None
    p_value: float
    gain: float | None


def values(named: Named) -> Mapping[str, Value]:
    """All fields of an effect that was found; unfitted ones (a channel, a label) without a standard error."""
    found: dict[str, Value] = {}
    for field in fields(named.effect):
        value = getattr(named.effect, field.name)
        if field.name in named.values:
            value, std, unit = named.values[field.name]
            found[field.name] = (value, std, unit_of(named.effect, unit))
        elif value is not None:
            found[field.name] = (value, None, field.metadata.get("unit", ""))
    return found


def unit_of(effect: Effect, unit: str) -> str:
    """Unit of a parameter; that of the effect's channel where the field has none."""
    channel = getattr(effect, "channel", None)
    return UNITS[channel] if channel is not None and not unit else unit


def label_of(effect: Effect) -> str:
    """Channel or load that distinguishes an effect from others of its kind."""
    if (channel := getattr(effect, "channel", None)) is not None:
        return str(channel)
    if effect.name == "load_error":
        resistance = getattr(effect, "resistance", None)
        return "all loads" if resistance is None else f"{resistance:g} ohm"
    return ""


def scored(diagnosis: Diagnosis, names: Sequence[str]) -> list[Scored]:
    """Effects of a library against the model without any, the highest score first."""
    search = diagnosis.search
    circuits = [record.shunt for record in diagnosis.campaign.records if isinstance(record, Record)] or [None]
    elsewhere = [name for name, cls in registered().items() if not any(map(cls.acts_on, circuits))]
    rows = []
    for name in names:
        candidates = [candidate for candidate in search.first if candidate.name == name]
        best = min(candidates, key=lambda c: (c.p_value, -c.score), default=None)
        p_value = 1.0 if best is None else min(1.0, best.p_value * len(search.first))
        gains = [-change for text, change, _ in search.fits if text == name]
        label = label_of(best.effect) if best else NOT_HERE if name in elsewhere else ""
        rows.append(Scored(name, label, best, p_value, max(gains, default=None)))
    return sorted(rows, key=lambda row: -(row.candidate.score if row.candidate else -1.0))


def cosines(rows: Sequence[Scored]) -> tuple[list[str], np.ndarray]:
    """Names and cosines of the projected signatures of the effects that have one."""
    kept = [row for row in rows if row.candidate is not None and row.candidate.column >= 0]
    table = np.array([[cosine(a.candidate, b.candidate) for b in kept] for a in kept])  # pyright: ignore
    return [row.name for row in kept], table.reshape(len(kept), len(kept))


def sentence(diagnosis: Diagnosis) -> str:
    """The verdict in words, its reservations, and the records that were not fitted or validated with as asked."""
    parts = [_verdict(diagnosis)]
    if diagnosis.deviating:
        far = " and ".join(
            f"{each.parameter.name} at {each.value / each.nominal:.2g} times its nominal value"
            for each in diagnosis.deviating
        )
        parts.append(
            f"The fit puts {far}, which may compensate for something that no known effect describes, unless the "
            "nominal value was wrong."
        )
    for named in (each for each in diagnosis.effects if each.other_sign is not None):
        parts.append(_other_sign(named))
    if diagnosis.cut:
        after = "after the drive saturated is left out."
        parts.append(f"What {', '.join(diagnosis.cut)} contain{_s(diagnosis.cut)} {after}")
    if diagnosis.campaign.transducer.quasi_static:
        parts.append("Inertia and damping do not show in these records.")
    if diagnosis.unpredicted:
        parts.append(
            f"The model with these effects cannot predict {', '.join(diagnosis.unpredicted)}, which did not count then."
        )
    if diagnosis.also_fitted:
        names, they = ", ".join(diagnosis.also_fitted), "it was" if len(diagnosis.also_fitted) == 1 else "they were"
        parts.append(
            f"The residuals of {names} are larger than those of the records fitted first, so {they} fitted too."
        )
        if not diagnosis.campaign.of_role("validate"):
            parts.append("No record is left to validate with.")
    return " ".join(parts)


def _other_sign(named: Named) -> str:
    """That the sign of an effect is not told."""
    assert named.other_sign is not None
    (other, probability), name = named.other_sign, type(named.effect).strength().name
    value, odds = named.values[name][0], (1.0 - probability) / probability
    return (
        f"The sign of {_words(named.effect.name)} is not certain: {name} may be {value:.3g} or, at odds of {odds:.2g} "
        f"to one against it, {other:.3g}."
    )


def _s(names: Sequence[str]) -> str:
    """Ending of a verb in the third person."""
    return "s" if len(names) == 1 else ""


def _verdict(diagnosis: Diagnosis) -> str:
    names = " and ".join(_described(named) for named in diagnosis.effects)
    if diagnosis.verdict == "adequate":
        return "Nothing is missing: the residuals of the fitted model are noise, and no known effect reduces them."
    if diagnosis.verdict == "effect":
        gain = sum(named.gain for named in diagnosis.effects)
        them = "it" if len(diagnosis.effects) == 1 else "them"
        share = f"{100 * gain:z.0f} % of {judged_error(diagnosis)}"
        return f"The model lacked {names}: including {them} removes {share} above the noise."
    if diagnosis.discovery:
        return _verdict_of_laws(diagnosis)
    if diagnosis.verdict == "ambiguous":
        others = " or ".join(" and ".join(map(_other, some)) for some in diagnosis.alternatives)
        return f"The model lacks {names}, or else {others}: these records cannot distinguish them."
    return " ".join(["Something is missing that no known effect explains.", *_found_on_the_way(diagnosis, names)])


def _found_on_the_way(diagnosis: Diagnosis, names: str) -> Iterator[str]:
    """Sentences on effects that explain a part or compensate for something, and on what the rest is like."""
    gain, several = sum(named.gain for named in diagnosis.effects), len(diagnosis.effects) > 1
    start = f"{names[:1].upper()}{names[1:]}"
    if names and gain > 0.0:
        removed = f"{'remove' if several else 'removes'} {_share(gain)} of {judged_error(diagnosis)} above the noise"
        yield f"{start} {removed}, but not the rest."
    elif names:
        yield f"{start} {'were' if several else 'was'} found in addition."
    harm = " and ".join(_described(named) for named in diagnosis.effects if named.spoils)
    if harm:
        yield f"With {harm}, records that were not fitted are predicted worse: it compensates for something else."
    if any(hint.of_higher_modes for hint in diagnosis.hints):
        yield HIGHER_MODES


def _share(gain: float) -> str:
    """A share in whole per cent; with as many digits as distinguish it from all."""
    digits = next((digits for digits in range(5) if round(100.0 * gain, digits) < 100.0), 0)
    return f"{100.0 * gain:z.{digits}f} %"


def judged_error(diagnosis: Diagnosis) -> str:
    """By which error an effect is judged: that of records that were kept back, if there are any."""
    return "the validation error" if diagnosis.campaign.of_role("validate") else "the error of the fitted records"


def _verdict_of_laws(diagnosis: Diagnosis) -> str:
    laws = " and ".join(f"a law at {_at(law.place)}, {law.formula}" for law in diagnosis.discovery)
    gain = sum(law.gain for law in diagnosis.discovery)
    removed = f"{'removes' if len(diagnosis.discovery) == 1 else 'remove'} {_share(gain)} of {judged_error(diagnosis)}"
    told = f"No known effect explains what was missing, but {laws}, {removed} above the noise."
    if diagnosis.verdict == "new_effect":
        return told
    last = (step.found.model.transducer.effects[-1] for step, _ in diagnosis.search.alternatives)
    others = " or ".join(map(_law_or_effect, last))
    return f"{told} These records cannot distinguish it from {others}."


def _law_or_effect(effect: Effect) -> str:
    """A law by its place and input, or an effect by its name."""
    if not isinstance(effect, Law):
        return _words(effect.name)
    return f"a law at {_at(effect.place.name)}, of the {effect.place.input.replace('_', ' ')}"


def _at(place: str) -> str:
    """A place in words: `reading.voltage` is the reading of the voltage."""
    kind, _, name = place.partition(".")
    return f"the {kind} of the {name.replace('_', ' ')}" if name else f"the {place}"


def _described(named: Named) -> str:
    label = label_of(named.effect)
    return _words(named.effect.name) + (f" ({label})" if label else "")


def _other(name: str) -> str:
    """An effect of an alternative in words, or a law without a name, whose name is "place form"."""
    place, _, form = name.partition(" ")
    return f"a law at {_at(place)}" if form else _words(name)


def _words(name: str) -> str:
    return name.replace("_", " ")
