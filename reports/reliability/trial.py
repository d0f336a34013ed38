"""One random study, simulated: refused in a sentence, or a result that must be possible."""

from __future__ import annotations

import math
import time
import warnings
from typing import Any

from piezoharvest.description.parameters import ParameterError
from piezoharvest.engine import simulate
from piezoharvest.engine.response import Response
from reports.reliability.studies import study_of

SLOW = 60.0  # s of processor time: the work limit of the engine ends a run within half of that
# Of a result that is said to be right: energy closes to this, which is what `plausibility` promises.
CLOSURE = 1e-6
EXCESS = 1e-6  # of the power that comes in, by which a passive circuit may harvest more: closure of the ledger


def attempt(seed: int) -> dict[str, Any]:
    """What became of the study of a seed.

    Returns
    -------
    dict
        `seed`, `kind`, `outcome` ("refused", "converged", "said", "impossible", "internal error"), `what` (the
        sentence, or what is wrong), `closure` and `seconds` of processor time.
    """
    begin, kind = time.process_time(), ""
    row: dict[str, Any] = {"seed": seed, "outcome": "", "what": "", "closure": None}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            study = study_of(seed)
            kind = study.shunts[0].kind
            response = simulate(study.systems[0], study.excitation)
        row |= judged(response)
    except ParameterError as error:
        row |= {"outcome": "refused", "what": str(error)[:300]}
    except Exception as error:
        row |= {"outcome": "internal error", "what": f"{type(error).__name__}: {error}"[:300]}
    seconds = time.process_time() - begin
    if seconds > SLOW and row["outcome"] != "internal error":
        row |= {"outcome": "slow", "what": f"{seconds:.0f} s: {row['what']}"}
    return {**row, "kind": kind, "seconds": round(seconds, 3)}


def judged(response: Response) -> dict[str, Any]:
    """Whether a result is possible; one that is said not to be right may be anything but NaN without a word."""
    closure = abs(response.energy.get("closure", math.nan))
    if not response.converged:
        return {"outcome": "said" if response.message else "impossible", "what": response.message or "no reason given"}
    figures = (response.harvested_power, response.mechanical_power, response.displacement_amplitude,
               response.voltage_amplitude, response.dc_voltage, closure)  # fmt: skip
    if not all(map(math.isfinite, figures)):
        return {"outcome": "impossible", "what": f"a figure of a converged result is not finite: {figures}"}
    # Of what else is in the ledger, an effect or a store is a source where it is negative.
    others = [value for name, value in response.energy.items() if name not in ("mechanical_in", "source", "closure")]
    delivered = max(response.energy.get("source", 0.0), 0.0) + sum(max(-value, 0.0) for value in others)
    incoming = max(response.mechanical_power, 0.0) + delivered / response.period
    if closure > CLOSURE:
        return {"outcome": "impossible", "what": f"closure {closure:.1e}", "closure": closure}
    if response.harvested_power > incoming * (1 + EXCESS) + EXCESS * abs(response.mechanical_power):
        return {"outcome": "impossible", "what": "harvests more than comes in", "closure": closure}
    # What control and gates take is a loss of the shunt, and may be more than the circuit gives.
    spent = max(response.energy.get("shunt_loss", 0.0), 0.0) / response.period
    if response.harvested_power < -spent * (1 + EXCESS):
        return {"outcome": "impossible", "what": "harvests less than nothing", "closure": closure}
    return {"outcome": "converged", "what": response.message, "closure": closure}
