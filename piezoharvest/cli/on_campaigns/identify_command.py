"""The command `identify`, once its arguments are parsed."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from piezoharvest.cli import tables
from piezoharvest.cli.notes import note
from piezoharvest.cli.on_campaigns.identification_output import above_noise, identification_json
from piezoharvest.cli.on_campaigns.running import on_campaign

if TYPE_CHECKING:
    from piezoharvest.identify import Estimate, Identification


def identify(path: Path, *, as_json: bool, report: Path | None, save: Path | None) -> int:
    """Identify the parameters of a campaign, print them, write the report and the specimen."""
    from piezoharvest.cli.on_campaigns import specimens_output
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

        tables.print_report(partial(write_identification, found, report), as_json=as_json)
    return 1 if found.doubts else 0


def remarks(found: Identification) -> list[str]:
    """Reservations about the result."""
    return [*(f"not to be trusted: {doubt}" for doubt in found.doubts), *found.warnings, *above_noise(found)]


def _remark(estimate: Estimate) -> str:
    if estimate.identifiable:
        parts = [f"at the nominal {' and '.join(estimate.assumes)}"] if estimate.assumes else []
    else:
        parts = ["not identifiable", *([f"known: {estimate.combination}"] if estimate.combination else [])]
    return "; ".join([*parts, *([estimate.note] if estimate.note else [])])


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
    tables.print_rows(found.campaign.title, ["parameter", "value", "relative error", "nominal", ""], rows)
    if figures := found.resonances:
        rows = [[e.name, with_error(e.value, e.std, e.unit), percent(e.std / e.value, 2)] for e in figures if e.value]
        tables.print_rows("", ["derived figure", "value", "relative error"], rows)
    rows = [
        [role, channel, engineering(rms, unit), engineering(quality.noise[channel], unit)]
        for role, quality in (("fitted", found.fit), ("validation", found.validation))
        for channel, rms in quality.rms.items()
        for unit in [response_unit(channel)]
    ]
    tables.print_rows("", ["records", "channel", "residual (rms)", "noise alone"], rows)
