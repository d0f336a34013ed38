"""An identification as a table of the JSON output."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezoharvest.identify import Estimate, Identification
    from piezoharvest.identify.result import Quality


MAX_NOISE_RATIO = 1.2  # times the noise, above which residuals give a warning


def above_noise(found: Identification) -> list[str]:
    """Warnings about channels whose residuals are more than noise."""
    return [
        f"{channel} of the {role} records: the residual is {quality.rms[channel] / noise:.3g} times the noise: the "
        "model lacks something, and parameters may be off by more than their standard errors; piezoharvest diagnose "
        "looks for the cause"
        for role, quality in (("fitted", found.fit), ("validation", found.validation))
        for channel, noise in quality.noise.items()
        # The noise of a response depends on frequency: the fit warns of it itself.
        if "/" not in channel and quality.rms[channel] > MAX_NOISE_RATIO * noise
    ]


def identification_json(found: Identification) -> dict[str, Any]:
    """Result as a table of the JSON output."""
    return {
        "title": found.campaign.title,
        "converged": found.converged,
        "message": found.message,
        "trusted": not found.doubts,
        "warnings": [*found.doubts, *found.warnings, *above_noise(found)],
        "parameters": {estimate.parameter.name: _estimate(estimate) for estimate in found.estimates},
        "resonances": {
            each.name: {"value": each.value, "std": each.std, "unit": each.unit} for each in found.resonances
        },
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


def _quality(quality: Quality) -> dict[str, Any]:
    return {"rms": dict(quality.rms), "noise": dict(quality.noise)}
