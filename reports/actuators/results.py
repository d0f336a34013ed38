"""All numbers of the page, as they go into results.json."""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from reports.actuators import diagnosed, mirror, mirror_hysteresis, mirror_search, stack
from reports.actuators.data import LEVELS


class Row(NamedTuple):
    """A model's test errors by level: relative in %, and in um where they are known."""

    name: str
    relative: tuple[float, ...]
    rms: tuple[float, ...] | None


@lru_cache
def hysteretic() -> mirror_hysteresis.Model:
    """The one model with P-I actuators."""
    return mirror_search.fitted(mirror.selected())


def hysteretic_shifts() -> tuple[float, ...]:
    """What the model with P-I actuators makes of the modes' frequencies from 100 to 300 mV."""
    return mirror_hysteresis.predicted_shifts(hysteretic(), mirror.STATES_PUBLISHED // 2)


@lru_cache
def comparison() -> tuple[Row, ...]:
    """Published and own test errors."""
    same, number = mirror.STATES_PUBLISHED // 2, mirror.selected()
    own = {
        f"linear, {2 * same} states, one per level": mirror.test_errors(same),
        f"linear, {2 * number} states, one per level": mirror.test_errors(number),
        "measured responses, one per level": mirror.response_errors(),
        f"P-I actuators, {2 * number} states, one for all": mirror_hysteresis.test_errors(hysteretic()),
        f"linear of 100 mV, {2 * same} states": mirror.foreign_errors(same),
    }
    published = [Row(f"published: {name}", errors, None) for name, errors in mirror.PUBLISHED.items()]
    rows = [Row(n, tuple(e.relative for e in found), tuple(e.rms * 1e6 for e in found)) for n, found in own.items()]
    return (*published, *rows)


def stack_results() -> dict[str, Any]:
    """Of the stack."""
    fit = stack.operator()
    drift, drift_rms = stack.drift()
    return {
        "operator": {
            "kind": fit.kind, "slope": fit.slope, "slope_std": fit.slope_std, "thresholds_V": fit.thresholds,
            "thresholds_std_V": fit.thresholds_std, "weights_um_per_V": fit.weights,
            "weights_std_um_per_V": fit.weights_std, "rms_um": fit.rms, "noise_um": fit.noise,
            "not_identifiable": fit.not_identifiable,
        },
        "tracking_um": {
            name: dict(zip(("measured", "predicted for our inverse", "read back through our inverse"), v, strict=True))
            for name, v in stack.tracking().items()
        },
        "paper_um": stack.PAPER,
        "breakdown": [step._asdict() for step in stack.breakdown()],
        "noise_um": {"cycle to cycle": stack.repeat_noise(), "white": stack.white_noise()},
        "creep_um": {"of the cycles' means": drift, "rms": drift_rms},
        "diagnosis": [one._asdict() for one in diagnosed.of_stack()],
    }  # fmt: skip


def mirror_results() -> dict[str, Any]:
    """Of the mirror."""
    number, errors = mirror.selection()
    model = hysteretic()
    return {
        "modes": {"chosen": number, "error_on_other_realisations": errors},
        "levels_mV": LEVELS,
        "test_errors": [row._asdict() for row in comparison()],
        "noise_percent": [mirror.floor(level)[0] for level in LEVELS],
        "distortion_percent": [mirror.floor(level)[1] for level in LEVELS],
        "gain_20_100_Hz_um_per_V": [mirror.static_gain(level) for level in LEVELS],
        "transient": [mirror.response(level).transient for level in LEVELS],
        "modes_by_level": [
            {**mode._asdict(), "shift_of_the_P-I_model": shift}
            for mode, shift in zip(mirror.level_changes(), hysteretic_shifts(), strict=True)
        ],
        "diagnosis": [one._asdict() for one in diagnosed.of_mirror()],
        "hysteresis": {"modes": len(model.modes.poles), "thresholds_V": model.thresholds, "weights": model.weights},
    }


def as_json(results: dict[str, Any]) -> str:
    """Numbers with six digits."""
    return json.dumps(_plain(results), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(item) for item in value]
    if isinstance(value, bool | str) or value is None:
        return value
    return float(f"{float(value):.6g}") if np.isfinite(value) else None
