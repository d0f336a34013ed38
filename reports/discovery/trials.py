"""One trial: its campaign made, read from its files, diagnosed, and the answer held against the truth."""

from __future__ import annotations

import tempfile
import time
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from piezoharvest.diagnose import Diagnosis, diagnose
from piezoharvest.diagnose.discovery.result import Discovery, as_json
from piezoharvest.diagnose.residuals import Residuals, residuals
from piezoharvest.records import load_campaign
from piezoharvest.records.campaign import Campaign
from reports.discovery import others
from reports.discovery.campaigns import (
    BENT,
    OWN,
    PARAMETERS,
    UNSEEN,
    Made,
    Trial,
    UnreachableError,
    make,
    named,
    truth,
    write,
)

POINTS = 25  # of a curve that is kept for the gallery
BANDS = 3.0  # standard errors
EXPONENT = 0.05  # largest error of an exponent that is right
# Known effects of a place.
KIN = {
    "spring": ("stiffening", "friction", "creep"), "electrodes": ("leakage", "bias_current", "dielectric_relaxation"),
    "load": ("load_error",), "capacitor": ("voltage_dependent_capacitance",), "coupling": ("nonlinear_coupling",),
    "reading.displacement": ("contact_compliance", "displacement_lag"), "reading.voltage": ("clipping",),
    "reading.current": ("clipping",),
}  # fmt: skip
# What of a held-out trial is kept: how it was answered, never the answer.
KEPT = (
    "key", "kind", "law", "place", "sigma", "seed", "outcome", "right", "banded", "formula_right", "exponent_error",
    "inside", "gain", "cpu", "power_error", "others", "diagnosed",
)  # fmt: skip


def attempt(trial: Trial) -> dict[str, Any]:
    """Run a trial; what goes wrong is a result too."""
    base = {"key": trial.key, **asdict(trial), "diagnosed": datetime.now(UTC).isoformat(timespec="minutes")}
    try:
        with threadpool_limits(1):  # processes share the machine
            return {**base, **_run(make(trial))}
    except UnreachableError as error:
        return {**base, "outcome": "not made", "right": False, "error": str(error)}
    except Exception as error:
        return {**base, "outcome": "failed", "right": False, "error": f"{type(error).__name__}: {error}"}


def held_out(trial: Trial) -> dict[str, Any]:
    """Run a held-out trial, of which only how it was answered is kept."""
    result = attempt(trial)
    return {key: result[key] for key in KEPT if key in result}


def _run(made: Made) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        campaign, everything = map(load_campaign, write(made, Path(folder)))
    cpu = time.process_time()
    found = diagnose(campaign)
    cpu = time.process_time() - cpu
    outcome = outcome_of(made, found)
    result = {
        "truth": truth(made), "verdict": found.verdict, "effects": [named.effect.name for named in found.effects],
        "found": [_short(each) for each in found.discovery], "alternatives": [list(a) for a in found.alternatives],
        "outcome": outcome, "right": outcome == "right", "cpu": cpu, "parameters": _parameters(made, found),
    }  # fmt: skip
    result["inside"] = [abs(v - t) <= BANDS * std for t, v, std in result["parameters"].values()]
    law = _largest(found)
    if outcome == "right" and law is not None:
        result |= _of_law(made, law)
    if made.trial.kind in ("law", "pair"):
        each = list(residuals(_with_unseen(found, everything)))
        (unseen,) = (one for one in each if one.data.name == UNSEEN)
        result |= {
            "gain": gain_of(unseen, made),
            "power_error": _power_errors(unseen),
            "others": others.answers(each, made),
        }
    return result


def _largest(found: Diagnosis) -> Discovery | None:
    return max(found.discovery, key=lambda each: each.gain, default=None)


def outcome_of(made: Made, found: Diagnosis) -> str:
    """How a trial was answered.

    "right", "kin" (a known effect of the true place, which a law of it may be a small part of), "among" (what is told
    as possible), "missed", "wrong" (and confident), or for a healthy specimen "alarm".
    """
    kind, verdict = made.trial.kind, found.verdict
    confident = verdict in ("new_effect", "effect")
    if kind == "healthy" or made.trial.law == "unvisited":
        return "right" if verdict == "adequate" else "wrong" if confident else "alarm"
    if kind == "impossible":
        return "wrong" if confident else "missed" if verdict == "adequate" else "right"
    wanted = {named(made.trial)} if kind == "pair" else set()
    law, effects = _largest(found), {each.effect.name for each in found.effects}
    place = made.site[0] if made.site else ""
    near = set(KIN.get(place, ()))
    # A free law holds what acts at its own place already: nothing tells the two apart.
    if verdict == "new_effect" and law is not None and at_site(law, made) and wanted - near <= effects <= wanted:
        return "right"
    if verdict == "effect" and kind in ("law", "pair") and effects - wanted <= near:
        return "kin"
    if confident:
        return "wrong"
    told = law is not None and (at_site(law, made) or any(_is(r.place, r.input, made) for r in law.rivals))
    # A law that is as likely as known effects is named by its place alone; and one of these may have the true place.
    told = told or bool(effects & near) or any(n.startswith(f"{place} ") for names in found.alternatives for n in names)
    return "among" if verdict == "ambiguous" and told else "missed"


def at_site(law: Discovery, made: Made) -> bool:
    """True if a law was found where it is."""
    return _is(law.place, law.law.place.input, made)


def _is(place: str, of: str, made: Made) -> bool:
    """Displacement's rate and velocity are the same."""
    assert made.site is not None
    return (place, of.replace("displacement_rate", "velocity")) == made.site


def _short(law: Discovery) -> dict[str, Any]:
    """A law as JSON, its curve with fewer points."""
    entry = as_json(law)
    some = np.unique(np.linspace(0, len(law.input) - 1, POINTS).astype(int))
    entry["curve"] = {name: [values[k] for k in some] for name, values in entry["curve"].items()}
    return entry


def _of_law(made: Made, law: Discovery) -> dict[str, Any]:
    """Curve, formula and exponent of a law at the right place."""
    assert made.drawn is not None
    entry, drawn = as_json(law), made.drawn
    memory = (entry["memory"] or {}).get("kind")
    exponent = law.parameters.get("exponent", (getattr(law.law.form, "exponent", None),))[0]
    result: dict[str, Any] = {}
    if drawn.slack is None:  # a curve over the input does not tell a memory
        result["banded"] = banded(law.input, law.value, law.std, made)
    if drawn.form is not None:
        result["formula_right"] = drawn.form in (law.form, memory)
        if drawn.exponent is not None and exponent is not None and result["formula_right"]:
            result["exponent_error"] = abs(float(exponent) - drawn.exponent)
            result["formula_right"] = result["exponent_error"] <= EXPONENT
    return result


def banded(x: np.ndarray, value: np.ndarray, std: np.ndarray, made: Made) -> float:
    """Share of the visited range in which a curve is within three of its standard errors of the truth.

    Where a straight line is a parameter of the model, it is left out of both.
    """
    error, scale = value - made.law(x), np.maximum(std, 1e-3 * np.abs(value).max() + 1e-300)
    assert made.site is not None
    if made.site[0] in BENT:
        w = 1.0 / scale**2
        error = error - x * float((w * x) @ error / ((w * x) @ x))
    return float(np.mean(np.abs(error) <= BANDS * std + 1e-4 * np.abs(value).max()))


def _parameters(made: Made, found: Diagnosis) -> dict[str, list[float]]:
    """Truth, value and standard error of what was determined, but for the parameter that a law's straight line is."""
    own = OWN.get(made.site[0]) if made.site else None
    own = made.site[0].removeprefix("parameter.") if made.site and made.site[0].startswith("parameter.") else own
    return {
        e.parameter.name: [float(getattr(made.specimen, e.parameter.name)), e.value, e.std]
        for e in found.estimates
        if e.identifiable and e.std and e.parameter.name in PARAMETERS and e.parameter.name != own
    }


def _with_unseen(found: Diagnosis, everything: Campaign) -> Diagnosis:
    """The diagnosis with one more record, that it has not seen."""
    (unseen,) = (record for record in everything.records if record.name == UNSEEN)
    return replace(found, campaign=replace(found.campaign, records=(*found.campaign.records, unseen)))


def gain_of(unseen: Residuals, made: Made) -> float:
    """Share of the error of a record that it has not seen that a diagnosis takes off: of squares, without the noise."""
    before, after = (others.squares(error) for error in others.errors(unseen, made))
    return float(np.clip(1.0 - after / before, -1.0, 1.0))


def _power_errors(unseen: Residuals) -> list[float]:
    """Relative error of the mean power of a record as predicted: before and after the diagnosis."""
    v, i = (unseen.data.channels.index(name) for name in ("voltage", "current"))
    shown = np.column_stack([unseen.data.record[name] for name in unseen.data.channels])
    powers = [float(np.mean((shown - left)[:, v] * (shown - left)[:, i])) for left in (unseen.before, unseen.after)]
    return [abs(power / float(np.mean(shown[:, v] * shown[:, i])) - 1.0) for power in powers]
