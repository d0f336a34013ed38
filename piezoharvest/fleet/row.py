"""One campaign's diagnosis as a row of the table of verdicts."""

from __future__ import annotations

import math
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from numpy.linalg import LinAlgError

from piezoharvest.description.parameters import ParameterError
from piezoharvest.effect_files import load_effects
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.progress import silent
from piezoharvest.study import StudyError

if TYPE_CHECKING:
    from piezoharvest.diagnose import Diagnosis

Row = dict[str, Any]
# What every row has, beside values and standard errors of the parameters.
COLUMNS = (
    "campaign", "title", "verdict", "effects", "law", "gain", "unexplained", "converged", "warnings", "seconds",
    "error",
)  # fmt: skip


def diagnosed(effects: list[Path], path: Path) -> Row:
    """Diagnose a campaign; what is wrong with it is told in the row.

    Parameters
    ----------
    effects : list of Path
        Effect files, which a process on its own has to load.
    path : Path
        Campaign file.

    Returns
    -------
    dict
        Of `COLUMNS` but the campaign, and of each parameter `NAME` and `NAME_std`, in SI units.
    """
    from piezoharvest.diagnose import diagnose
    from piezoharvest.records.campaign import Campaign
    from piezoharvest.records.specimens import load

    begun = perf_counter()
    row: Row = dict.fromkeys(COLUMNS[1:])
    try:
        for file in effects:
            load_effects(file)
        campaign = load(path)
        row["title"], row["warnings"] = campaign.title, len(campaign.warnings)
        if not isinstance(campaign, Campaign):
            raise StudyError(path, "specimens", "found several specimens, which are diagnosed together, not in a fleet")
        row |= _said(diagnose(campaign, silent))
    except (StudyError, ParameterError) as error:
        row["error"] = str(error)
    except PredictionError as error:
        row["error"] = f"{path}: the model cannot predict the records with its nominal values: {error}"
    except (ArithmeticError, LinAlgError) as error:
        row["error"] = f"{path}: the records cannot be computed with these nominal values ({error})"
    except Exception as error:  # of one campaign, which would keep a batch from all those after it
        row["error"] = f"{path}: internal error: {type(error).__name__}: {error}"
    known = {name: None if isinstance(each, float) and not math.isfinite(each) else each for name, each in row.items()}
    return {**known, "seconds": round(perf_counter() - begun, 1)}


def _said(found: Diagnosis) -> Row:
    """What a diagnosis says."""
    gains = [named.gain for named in found.effects] + [law.gain for law in found.discovery]
    values = {e.parameter.name: e.value for e in found.estimates}
    errors = {f"{e.parameter.name}_std": e.std for e in found.estimates}
    return {
        "verdict": found.verdict,
        "effects": " + ".join(named.effect.name for named in found.effects) or None,
        "law": " + ".join(f"{law.place}: {law.formula}" for law in found.discovery) or None,
        "gain": sum(gains) if gains else None,
        "unexplained": found.unexplained,
        "converged": found.search.final.converged,
        **{name: value for pair in zip(values.items(), errors.items(), strict=True) for name, value in pair},
    }
