"""The command `identify`, once its arguments are parsed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from piezoharvest.cli import tables
from piezoharvest.cli.notes import note, telling
from piezoharvest.output import check_file, check_new_directory
from piezoharvest.study import StudyError

if TYPE_CHECKING:
    from piezoharvest.identify import Estimate, Identification
    from piezoharvest.identify.identification import Quality

_T = TypeVar("_T")
_S = TypeVar("_S")
MAX_NOISE_RATIO = 1.2  # times the noise, above which residuals give a warning


def on_campaign(
    path: Path,
    report: Path | None,
    save: Path | None,
    run: Callable[..., _T],
    of_several: Callable[..., _S] | None = None,
) -> _T | _S | None:
    """Run on a campaign after printing the warnings of its checks; None where no model can follow it.

    Parameters
    ----------
    path : Path
        Campaign file.
    report : Path or None
        Directory for the report, checked first.
    save : Path or None
        Specimen file, checked first.
    run : callable
        Called with the campaign and a function for progress messages.
    of_several : callable, optional
        The same for a campaign of several specimens, which is an error without it.
    """
    from numpy.linalg import LinAlgError

    from piezoharvest.predict.prediction import PredictionError
    from piezoharvest.records import load_campaign
    from piezoharvest.records.specimens import SpecimenSet, load

    if report is not None:
        check_new_directory(report)
    if save is not None:
        check_file(save, (".toml",))
    campaign = load_campaign(path) if of_several is None else load(path)
    for finding in campaign.warnings:
        note(f"warning: {finding}")
    try:
        with telling() as tell:
            if of_several is not None and isinstance(campaign, SpecimenSet):
                return of_several(campaign, tell)
            return run(campaign, tell)
    except PredictionError as error:
        note(f"piezoharvest: error: {path}: the model with its nominal values cannot follow the records: {error}")
        return None
    except (ArithmeticError, LinAlgError) as error:
        message = f"the records cannot be computed with these nominal values ({error}), check them and their units"
        raise StudyError(path, "transducer", message) from None


def identify(path: Path, *, as_json: bool, report: Path | None, save: Path | None) -> int:
    """Identify the parameters of a campaign, print them, write the report and the specimen."""
    from piezoharvest.cli import specimens_output
    from piezoharvest.identify import Identification
    from piezoharvest.identify import identify as run
    from piezoharvest.population import identify_specimens

    found = on_campaign(path, report, save, run, identify_specimens)
    if found is None:
        return 1
    if not isinstance(found, Identification):
        return specimens_output.identified(found, as_json=as_json, report=report, save=save)
    for text in remarks(found):
        note(f"warning: {text}")
    if as_json:
        tables.print_json(identification_json(found))
    else:
        _print(found)
    if save is not None:
        found.save(save)
        note(f"specimen: {save}")
    if report is not None:
        from piezoharvest.report import write_identification

        print(write_identification(found, report), file=sys.stderr if as_json else sys.stdout)
    return 1 if found.doubts else 0


def remarks(found: Identification) -> list[str]:
    """Reservations about the result."""
    texts = [*(f"not to be trusted: {doubt}" for doubt in found.doubts), *found.warnings]
    for role, quality in (("fitted", found.fit), ("validation", found.validation)):
        texts += [
            f"{channel} of the {role} records: residual {quality.rms[channel] / noise:.3g} times the noise: the model "
            "lacks something, which piezoharvest diagnose looks for"
            for channel, noise in quality.noise.items()
            # The noise of a response depends on frequency: reported above.
            if "/" not in channel and quality.rms[channel] > MAX_NOISE_RATIO * noise
        ]
    return texts


def identification_json(found: Identification) -> dict[str, Any]:
    """Result as a table of the JSON output."""
    return {
        "title": found.campaign.title,
        "converged": found.converged,
        "message": found.message,
        "trusted": not found.doubts,
        "warnings": [*found.doubts, *found.warnings],
        "parameters": {estimate.parameter.name: _estimate(estimate) for estimate in found.estimates},
        "fit": _quality(found.fit),
        "validation": _quality(found.validation),
        "records": [
            {
                "file": record.name,
                "role": record.role,
                **_quality(record.quality),
                "own": dict(record.own),
                "warning": record.warning,
            }
            for record in found.records
        ],
    }


def _estimate(estimate: Estimate) -> dict[str, Any]:
    keys = ("value", "std", "identifiable", "nominal", "assumes", "combination", "experiment", "note")
    table = {key: getattr(estimate, key) for key in keys}
    return {"value": table["value"], "std": table["std"], "unit": estimate.parameter.unit, **table}


def _remark(estimate: Estimate) -> str:
    if estimate.identifiable:
        parts = [f"at the nominal {' and '.join(estimate.assumes)}"] if estimate.assumes else []
    else:
        parts = ["not identifiable", *([f"known: {estimate.combination}"] if estimate.combination else [])]
    return "; ".join([*parts, *([estimate.note] if estimate.note else [])])


def _quality(quality: Quality) -> dict[str, Any]:
    return {"rms": dict(quality.rms), "noise": dict(quality.noise)}


def _print(found: Identification) -> None:
    """Print the parameters, and the residuals against the noise."""
    from piezoharvest.report.units import engineering, percent, response_unit, with_error

    rows = []
    for e in found.estimates:
        unit = e.parameter.unit
        share = "" if e.std is None or e.value == 0 else percent(e.std / abs(e.value), 2)
        rows.append(
            [e.parameter.name, with_error(e.value, e.std, unit), share, engineering(e.nominal, unit), _remark(e)]
        )
    tables.print_rows(found.campaign.title, ["parameter", "value", "", "nominal", ""], rows)
    rows = [
        [role, channel, engineering(rms, unit), engineering(quality.noise[channel], unit)]
        for role, quality in (("fitted", found.fit), ("validation", found.validation))
        for channel, rms in quality.rms.items()
        for unit in [response_unit(channel)]
    ]
    tables.print_rows("", ["records", "channel", "residual (rms)", "noise alone"], rows)
