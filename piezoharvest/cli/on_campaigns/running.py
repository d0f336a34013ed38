"""What commands on a campaign have in common: its checks, and errors that are about its records."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from piezoharvest.cli.notes import note, telling
from piezoharvest.output import check_file, check_new_directory
from piezoharvest.study import StudyError

_T = TypeVar("_T")
_S = TypeVar("_S")


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
        note(f"piezoharvest: error: {path}: the model cannot predict the records with its nominal values: {error}")
        return None
    except (ArithmeticError, LinAlgError) as error:
        message = f"the records cannot be computed with these nominal values ({error}), check them and their units"
        raise StudyError(path, "transducer", message) from None
