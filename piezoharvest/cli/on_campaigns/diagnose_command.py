"""The command `diagnose`, once its arguments are parsed."""

from __future__ import annotations

import math
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from piezoharvest.cli import tables
from piezoharvest.cli.notes import note, telling
from piezoharvest.cli.on_campaigns.law_files import save_laws
from piezoharvest.cli.on_campaigns.running import on_campaign
from piezoharvest.output import check_file

if TYPE_CHECKING:
    from piezoharvest.diagnose import Diagnosis, Named
    from piezoharvest.diagnose.discovery.result import Discovery
    from piezoharvest.diagnose.experiments.planning import PlannedRecord
    from piezoharvest.diagnose.residual_structure.residual_tests import ResidualTest

MAX_TEST_ROWS = 10  # number of failed residual tests printed


def diagnose(
    path: Path, *, as_json: bool, report: Path | None, save: Path | None, save_effect: Path | None = None
) -> int:
    """Diagnose a campaign, print the verdict, write the report, the specimen and the law."""
    from piezoharvest.cli.on_campaigns import specimens_output
    from piezoharvest.diagnose import Diagnosis
    from piezoharvest.diagnose import diagnose as run
    from piezoharvest.population import diagnose_specimens

    if save_effect is not None:
        check_file(save_effect, (".py",))
    found = on_campaign(path, report, save, run, diagnose_specimens)
    if found is None:
        return 1
    if not isinstance(found, Diagnosis):
        return specimens_output.diagnosed(found, as_json=as_json, report=report, save=save, save_effect=save_effect)
    if not found.search.final.converged:
        note(f"warning: not to be trusted: {found.search.final.message}")
    with telling():  # the next record is planned
        table = diagnosis_json(found)
    if as_json:
        tables.print_json(table)
    else:
        _print(found)
    if save is not None:
        found.save(save)
        note(f"specimen: {save}")
    if save_effect is not None:
        save_laws(found, save_effect)
    if report is not None:
        from piezoharvest.report import write_diagnosis

        tables.print_report(partial(write_diagnosis, found, report), as_json=as_json)
    return 0 if found.search.final.converged else 1


def diagnosis_json(found: Diagnosis) -> dict[str, Any]:
    """Result as a table of the JSON output.

    In addition to the effects: `scores`, `structure`, parameters before, and the records that were used otherwise than
    requested (`also_fitted`, `cut`, `unpredicted`).
    """
    from piezoharvest.description.effects import registered
    from piezoharvest.diagnose.discovery.result import as_json
    from piezoharvest.diagnose.summary import scored, sentence

    before = {estimate.parameter.name: estimate for estimate in found.before.estimates}
    return {
        "title": found.campaign.title,
        "converged": found.search.final.converged,
        "verdict": found.verdict,
        "summary": sentence(found),
        "also_fitted": list(found.also_fitted),
        "cut": list(found.cut),
        "unpredicted": list(found.unpredicted),
        "effects": [_effect(named) for named in found.effects],
        "discovery": [as_json(each) for each in found.discovery],
        "alternatives": [list(names) for names in found.alternatives],
        "parameters": {
            e.parameter.name: {
                "value": e.value, "std": _finite(e.std), "unit": e.parameter.unit, "identifiable": e.identifiable,
                "assumes": list(e.assumes),
                "before": {"value": (b := before[e.parameter.name]).value, "std": _finite(b.std)},
            }
            for e in found.estimates
        },
        "validation": {
            "noise": dict(found.validation_after.noise),
            "rms_before": dict(found.validation_before.rms),
            "rms_after": dict(found.validation_after.rms),
        },
        "unexplained": found.unexplained,
        "experiment": found.experiment,
        "plan": plan_json(found.plan),
        "hints": [asdict(hint) for hint in found.hints],
        "scores": [
            {
                "name": row.name, "label": row.label or None, "score": row.candidate and row.candidate.score,
                "freedom": row.candidate and row.candidate.degrees_of_freedom,
                "p_value": row.p_value, "fit_gain": row.gain,
            }
            for row in scored(found, list(registered()))
        ],
        "structure": {"before": [_test_json(p) for p in found.shown], "after": [_test_json(p) for p in found.left]},
    }  # fmt: skip


def _print_law(law: Discovery) -> None:
    """Print a law without a name: where it acts, its formula and values, and the places it beat."""
    from piezoharvest.report.units import percent, with_error

    rows = [["place", law.place], [f"of {law.law.place.input.replace('_', ' ')}", law.formula]]
    rows += [[name, with_error(value, std, unit)] for name, (value, std, unit) in law.parameters.items()]
    rows += [["gain", percent(law.gain)], ["p", _p_value(law.p_value)]]
    rows += [[f"instead: {r.place} of {r.input.replace('_', ' ')}", f"log odds {r.log_odds:.3g}"] for r in law.rivals]
    tables.print_rows("", ["law without a name", ""], rows)


def plan_json(plan: PlannedRecord | None) -> dict[str, Any] | None:
    """A planned record as a table of the JSON output: what it is for, what it is expected to tell, and the study."""
    if plan is None:
        return None
    from piezoharvest.diagnose.experiments.planning import described

    return {
        "record": described(plan.planned),
        "sets": [list(names) for names in plan.sets],
        "standard_deviations": math.sqrt(plan.separation) if plan.sets else None,
        "parameter": plan.parameter or None,
        "relative_error": {"before": plan.before, "after": plan.after} if plan.parameter else None,
        "study": plan.tables,
    }


def _effect(named: Named) -> dict[str, Any]:
    from piezoharvest.diagnose.summary import values

    parameters = {
        name: {"value": value, "std": _finite(std), "unit": unit} for name, (value, std, unit) in values(named).items()
    }
    table = {"name": named.effect.name, "p_value": named.p_value, "gain": named.gain, "parameters": parameters}
    if named.other_sign is not None:
        table["other_sign"] = named.other_sign._asdict()
    return table


def _test_json(place: ResidualTest) -> dict[str, Any]:
    return {
        "where": place.where, "record": place.record, "channel": place.channel, "ratio": place.squares / place.count,
        "excess": place.excess, "p_value": place.p_value,
    }  # fmt: skip


def _p_value(value: float) -> str:
    """A p-value for a table; one that is too small for a number is less than the smallest."""
    return "< 1e-300" if value < 1e-300 else f"{value:.2g}"


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else value


def _print(found: Diagnosis) -> None:
    """Print the verdict, the effects, the changes of parameters, and the remaining structure."""
    from piezoharvest.diagnose.summary import sentence, values
    from piezoharvest.report.units import engineering, percent, response_unit, with_error

    print(f"{found.verdict}: {sentence(found)}")
    if found.experiment:
        print(f"Next experiment: {found.experiment}.")
    if found.plan is not None:
        elsewhere = f" With other equipment: {found.told_by}." if found.told_by else ""
        print(f"piezoharvest plan writes this record as a study.{elsewhere}")
    rows = [
        [named.effect.name if not k else "", name, value if isinstance(value, str) else with_error(value, std, unit),
         "" if k else _p_value(named.p_value), "" if k else percent(named.gain)]
        for named in found.effects
        for k, (name, (value, std, unit)) in enumerate(values(named).items())
    ]  # fmt: skip
    if rows:
        tables.print_rows("", ["effect", "parameter", "value", "p", "gain"], rows)
    for law in found.discovery:
        _print_law(law)
    rows = [
        [e.parameter.name, with_error(b.value, b.std, e.parameter.unit), with_error(e.value, e.std, e.parameter.unit)]
        for b, e in zip(found.before.estimates, found.estimates, strict=True)
    ]
    tables.print_rows(found.campaign.title, ["parameter", "without effects", "with effects"], rows)
    records = "validation" if found.campaign.of_role("validate") else "fitted records"
    qualities = (found.validation_before.rms, found.validation_after.rms, found.validation_after.noise)
    rows = [
        [channel, *(engineering(quality[channel], response_unit(channel)) for quality in qualities)]
        for channel in found.validation_after.rms
    ]
    tables.print_rows("", [records, "residual before", "after", "noise alone"], rows)
    if found.left:
        rows = [[p.where, p.record, p.channel, f"{p.squares / p.count:.2f}", _p_value(p.p_value)] for p in found.left]
        tables.print_rows(
            "", ["remaining structure", "record", "channel", "power over that of noise", "p"], rows[:MAX_TEST_ROWS]
        )
    if found.hints:
        rows = [
            [h.channel, h.term, engineering(h.size, response_unit(h.channel)), f"{h.gain:.3g}"] for h in found.hints
        ]
        tables.print_rows("", ["hint: residual of", "term", "size", "gain in -2 ln L"], rows)
