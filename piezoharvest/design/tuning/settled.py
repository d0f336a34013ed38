"""Start values of circuits that adapt themselves: tuned on the two-port as what they settle to under a sine."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from piezoharvest.design.drafts import Draft
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.tuning.starts import Host, Start, scales

_SHARES = np.geomspace(1e-3, 1e3, 61)  # of the impedance of the capacitance, before the best is refined


def settled_starts(view: LinearView, draft: Draft, host: Host) -> list[Start]:
    """The best value of the one free field where the circuit has adapted to the sine, found on the two-port.

    Empty for circuits that do not adapt, for another excitation and over a band, where none is settled for long.
    """
    op, omega = view.operation, host.omega
    if not op.apart or op.band is not None or len(draft.free) != 1:
        return []
    if draft.shunt.settled(view.capacitance, omega) is None:
        return []
    (name,), (scale,) = draft.free, scales(draft, host).values()

    def merit(log: float) -> float:
        shunt = draft.with_values({name: scale * float(np.exp(log))}).settled(view.capacitance, omega)
        assert shunt is not None
        return view.merit(shunt)

    logs = np.log(_SHARES)
    n = int(np.argmin([merit(log) for log in logs]))
    near = logs[max(n - 1, 0)], logs[min(n + 1, len(logs) - 1)]
    best: Any = minimize_scalar(merit, bounds=near, method="bounded", options={"xatol": 1e-6})
    return [Start("two-port with the coil as it has adapted", {name: scale * float(np.exp(best.x))})]
