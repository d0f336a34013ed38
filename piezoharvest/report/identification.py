"""The page of an identification: parameters, unknowns, residuals, and every record."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from piezoharvest.counting import counted
from piezoharvest.identify import Estimate, Identification
from piezoharvest.identify.prediction_overlay import Predicted, predictions
from piezoharvest.output import write_text
from piezoharvest.progress import Stage, follower
from piezoharvest.records import FrequencyRecord
from piezoharvest.report.figures import identified
from piezoharvest.report.figures.pictures import Picture, place_pictures
from piezoharvest.report.frame.rendering import page
from piezoharvest.report.frame.report_folder import NAME, report_folder
from piezoharvest.report.records import record_figure
from piezoharvest.report.units import NONE, engineering, number, percent, response_unit, with_error

MAX_NOISE_RATIO = 1.2  # times the noise, above which residuals are marked


def write_identification(found: Identification, directory: str | Path) -> Path:
    """Write the report of an identification: a self-contained HTML page, and its figures as PNG files.

    Parameters
    ----------
    found : Identification
    directory : str or Path
        Created if it does not exist.

    Returns
    -------
    Path
        The HTML file. An earlier report there is replaced as a whole: where a page is, it is complete.

    Raises
    ------
    OutputError
        The directory or a file in it cannot be written.
    """
    with report_folder(directory) as folder:
        figures = place_pictures(_pictures(found), ("loops", "records", "findings"), folder)
        text = page(
            "identification.html.j2",
            title=found.campaign.title,
            sentence=_sentence(found),
            warning=f"Not to be trusted: {'; '.join(found.doubts)}." if found.doubts else "",
            parameters=[_row(estimate) for estimate in found.estimates],
            resonances=[(e.name, with_error(e.value, e.std, e.unit)) for e in found.resonances],
            unknown=[_unknown(estimate) for estimate in found.estimates if not estimate.identifiable],
            residuals=list(_residuals(found)),
            lacks=found.warnings,
            warnings=[str(finding) for finding in found.campaign.warnings],
            figures=figures,
            file=found.campaign.path.name,
        )
        write_text(text, folder / NAME)
    return Path(directory) / NAME


def _pictures(found: Identification) -> Iterator[Picture]:
    kept: list[Predicted] = []
    stage = Stage(follower(), "drawing", "records")
    for n, each in enumerate(stage.over(predictions(found), len(found.records)), 1):
        heading = f"{each.record.name} ({'fitted' if each.record.role == 'fit' else 'validation'})"
        if isinstance(each.record, FrequencyRecord):
            caption = "Measured and predicted response; residual in per cent of the measured magnitude."
        else:
            caption = f"Driven by {each.record.drive.replace('_', ' ')}, {_load(each)}."
        yield Picture(f"record_{n}", "records", heading, caption, identified.fit_figure(each))
        if each.findings:
            said = "; ".join(f"{finding.place}: {finding.message}" for finding in each.findings)
            yield Picture(f"checks_{n}", "findings", heading, said, record_figure(each.record, each.findings))
        kept.append(each)
    loops = identified.loops_figure(kept)
    if loops is not None:
        caption = "Sensor offsets are removed; the charge is the integral of the measured current."
        yield Picture("loops", "loops", "Displacement over force, voltage over charge", caption, loops)


def _load(each: Predicted) -> str:
    shunt = each.record.shunt
    if shunt is None:
        return "no load"
    resistance = getattr(shunt, "resistance", None)
    # Of a bridge it is a function: that of its diodes.
    return shunt.kind + (f" of {engineering(resistance, 'ohm', 4)}" if isinstance(resistance, float | int) else "")


def _sentence(found: Identification) -> str:
    known = sum(estimate.identifiable for estimate in found.estimates)
    fitted = sum(record.role == "fit" for record in found.records)
    some = f"{known} of {counted(len(found.estimates), 'parameter')} {'is' if known == 1 else 'are'}"
    text = f"{some} determined by {counted(fitted, 'record')}."
    unseen = bool(found.validation.rms)
    quality, words = (found.validation, "records that were not fitted") if unseen else (found.fit, "these records")
    ratios = [f"{channel} {number(quality.ratio(channel), 3)}" for channel, noise in quality.noise.items() if noise]
    return f"{text} Residuals of {words}, relative to the noise: {', '.join(ratios)}."


def _row(estimate: Estimate) -> dict[str, Any]:
    unit, std, value = estimate.parameter.unit, estimate.std, estimate.value
    change = f"{100 * (value / estimate.nominal - 1):+z.1f}\u202f%".replace("-", "\u2212") if estimate.nominal else NONE
    return {
        "name": estimate.parameter.name,
        "value": with_error(value, std, unit),
        "identifiable": estimate.identifiable,
        "assumes": " and ".join(estimate.assumes),
        "share": NONE if std is None or not value else percent(std / abs(value), 2),
        "nominal": engineering(estimate.nominal, unit, 4),
        "change": change if estimate.identifiable else NONE,
        "note": estimate.note,
    }


def _unknown(estimate: Estimate) -> dict[str, str]:
    kept = "is not known: " + estimate.note if estimate.note else "keeps its nominal value"
    known = f" Only {estimate.combination} is known." if estimate.combination else ""
    return {"name": estimate.parameter.name, "text": f"{kept}.{known} It could be determined by {estimate.experiment}."}


def _residuals(found: Identification) -> Iterator[dict[str, Any]]:
    for record in found.records:
        for channel, rms in record.quality.rms.items():
            noise, unit, ratio = record.quality.noise[channel], response_unit(channel), record.quality.ratio(channel)
            yield {
                "file": record.name,
                "role": "fitted" if record.role == "fit" else "validation",
                "channel": channel,
                "rms": engineering(rms, unit),
                "noise": engineering(noise, unit),
                "ratio": number(ratio, 3),
                # The noise of a response depends on frequency: its quality is judged over all lines.
                "loud": bool(record.warning) if "/" in channel else ratio > MAX_NOISE_RATIO,
            }
