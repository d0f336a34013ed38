"""Faults of sensors that no effect of the vocabulary has: what a measurement with them shows must not get a name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from piezoharvest.bench.measuring import BenchCampaign
from piezoharvest.records.reading.channels import COLUMNS

# Channel, and what is added to its readings but for a factor, of readings and time as share of the record less a half.
Fault = tuple[str, Callable[[np.ndarray, np.ndarray], np.ndarray]]
FAULTS: dict[str, Fault] = {
    "gain that drifts": ("voltage", lambda y, share: y * share),
    "cubic sensor": ("displacement", lambda y, share: y**3),
    "quadratic sensor": ("voltage", lambda y, share: y**2),
    "rectifying sensor": ("current", lambda y, share: np.abs(y)),
    "thermal drift": ("displacement", lambda y, share: share),
    "dead band": ("voltage", lambda y, share: -np.clip(y, -0.02 * np.ptp(y), 0.02 * np.ptp(y))),
    "echo": ("displacement", lambda y, share: np.concatenate([np.full(30, y[0]), y[:-30]]) - y),
}


def faulty(measured: BenchCampaign, name: str, sigma: float, noise: Mapping[str, float]) -> BenchCampaign:
    """The same campaign read by a sensor with a fault that changes the fitted samples by so many sigma of its noise."""
    channel, fault = FAULTS[name]
    column = COLUMNS[channel]
    added = []
    for record in measured.records:
        values = np.asarray(record.columns[column])
        added.append(fault(values, np.linspace(-0.5, 0.5, len(values))))
    fitted = [change for record, change in zip(measured.records, added, strict=True) if record.setup.role == "fit"]
    factor = sigma * noise[channel] / float(np.linalg.norm(np.concatenate(fitted)))
    records = (
        replace(record, columns={**record.columns, column: np.asarray(record.columns[column]) + factor * change})
        for record, change in zip(measured.records, added, strict=True)
    )
    return replace(measured, records=tuple(records))
