"""Fields that are tuned after the load and the lag: what the study names besides, and the time lag under other signals.

What pays, measured on parallel and series SSHI for k_e^2 of 0.001, 0.025 and 0.3 with load and lag as tuned:

- `on_time_error` has an optimum beside zero, as the transducer's own current flows on while the switch is closed: worth
  1e-4, 1e-3 and 2e-2 of the power. The power falls with its square: 0.1 too much costs 1 to 10 %.
- `inductance`, at the same quality, has a flat one: within 1e-3 of what is assumed here, but where coupling is strong
  the switch then acts later, and the lag has to be tuned with it.
- `smoothing_capacitance` has none that is of use: the power rises to a limit, which it reaches to 1e-3 at 100 periods,
  unless it is so small that the voltage behind the bridge is none of dc (k_e^2 = 0.3, off resonance).
- `quality`, `efficiency` and `diode_drop` are better the larger, or smaller: they are never tuned.

None of them is tuned unless the study names it (`tune`): a controller, a coil and a capacitor come in few values.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from piezoharvest.description.shunts import Shunt
from piezoharvest.design.drafts import Draft
from piezoharvest.design.trial import Trial
from piezoharvest.design.tuning.minimax import Tuned
from piezoharvest.design.tuning.refine import refine, simplex
from piezoharvest.design.tuning.region import Region, coordinates, values_at
from piezoharvest.design.tuning.starts import Host, Start

# Half a turn of the resonance is all that differs, as an action at the next extremum does the same; one before the
# extremum cannot be timed without a period.
_LAGS = np.linspace(0, np.pi, 6, endpoint=False)
_ALONE, _WITH_LOAD = 15, 40  # simulations of the search beyond the grid, at most
_SHARE = 0.2  # of the work that is left, for one time lag: five candidates have switches and harvest


def tune_late(trial: Trial, draft: Draft, tuned: Tuned, host: Host) -> Tuned:
    """Tune load, lag and late fields together by the engine's gradient, from where load and lag are tuned."""
    names = tuple(name for name in draft.late if name != "time_lag")
    smoothing = None if "smoothing_capacitance" in names else draft.smoothing
    whole = Draft(tuned.shunt, (*draft.free, *names), smoothing=smoothing)
    region = Region.of(whole, host, trial.view.goal.options.max_inductance)
    found = refine(trial, whole, Start(tuned.start, whole.first()), region)
    if found.merit >= tuned.merit:
        return tuned
    return found._replace(method=f"{tuned.method}, {found.method}", iterations=tuned.iterations + found.iterations)


def tune_time_lag(trial: Trial, draft: Draft, tuned: Tuned, host: Host) -> Tuned | None:
    """Tune the time lag, and the load with it, by simulation of a signal without a frequency.

    From the best of a grid over half a period of the resonance a simplex search goes on. The load stays as it is where
    both would take too long; None if the lag alone does.
    """
    before, left, base = trial.simulations, trial.left, coordinates(draft.values_of(tuned.shunt))

    def shunt_at(p: np.ndarray) -> Shunt:
        lag: dict[str, Any] = {"time_lag": float(np.clip(p[0], 0.0, np.pi)) / host.omega}
        return replace(draft.with_values(values_at(draft.free, np.append(p[1:], base[len(p) - 1 :]))), **lag)

    def merit(p: np.ndarray) -> float:
        return trial.merit(shunt_at(p))

    merit(_LAGS[1:2])
    allowed = _SHARE * left / (left - trial.left) - len(_LAGS)  # simulations of the search
    if allowed < _ALONE:
        return None
    first = min(_LAGS[:, None], key=merit)
    p = simplex(merit, np.append(first, base), _WITH_LOAD) if allowed >= _WITH_LOAD else simplex(merit, first, _ALONE)
    # Under noise what is better in one realisation may not be in the mean, by which candidates are judged.
    late, early = (trial.view.goal.merit(trial.figures(one, complete=True)) for one in (shunt_at(p), tuned.shunt))
    if late >= early:
        return tuned
    count = tuned.iterations + trial.simulations - before
    return Tuned(shunt_at(p), merit(p), tuned.start, "grid and simplex search with the simulator", count)
