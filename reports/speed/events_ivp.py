"""scipy's `solve_ivp` with terminal events: integrated to the first event, the mode changed, and started again.

It looks for events at the ends of steps only, so that two crossings of a guard within one step are missed. Shorter
steps make that rarer and cost time; the limit here is where they begin to cost.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from reports.speed.equations import Loaded, Motion, Run

TYPICAL = 1e-3  # square root of an energy in J: the absolute tolerance is as small a share of it as the relative one is

LONGEST = 4  # steps of the drive, of which a period has 64


def run(model: Loaded, times: np.ndarray, method: str, rtol: float) -> np.ndarray:
    """States at ascending times, from rest; a row for each."""
    run, states, done = model.start(), [], 0
    while done < len(times):
        if run.t >= run.opens:
            model.fire(run, "opens")
        limit = min(times[-1], run.opens, model.drive.after(run.t))
        wanted = times[done : np.searchsorted(times, limit, side="right")]
        states += _to_event(model, run, limit, wanted, method, rtol)
        done = len(states)
    return np.array(states)


def _to_event(model: Loaded, run: Run, limit: float, wanted: np.ndarray, method: str, rtol: float) -> list[np.ndarray]:
    """Integrate a run to its next event or to `limit`, and change its mode; the states at the `wanted` times passed."""
    motion, count = model.motion(run.mode), len(wanted)
    solution = solve_ivp(
        _rates(model, motion, run), (run.t, limit), run.z, method=method, rtol=rtol, atol=rtol * TYPICAL,
        t_eval=wanted if count and wanted[-1] == limit else [*wanted, limit], events=_guards(motion, len(run.z)),
        max_step=LONGEST * model.drive.step,
    )  # fmt: skip
    if not solution.success:
        raise ArithmeticError(solution.message)
    passed = list(np.transpose(solution.y)[:count])
    if solution.status == 0:
        run.t, run.z = limit, solution.y[:, -1]
        return passed
    event = next(j for j, found in enumerate(solution.t_events) if len(found))
    run.t, run.z = float(solution.t_events[event][0]), solution.y_events[event][0].copy()
    model.fire(run, *motion.events[event])
    return passed


def _rates(model: Loaded, motion: Motion, run: Run):
    n, force = len(run.z), model.drive.force(run.t)
    matrix, push = motion.matrix[:n, :n], motion.matrix[:n, n]
    return lambda t, z: matrix @ z + push * force(t)


def _guards(motion: Motion, n: int) -> list:
    """Guards as functions of time and state. None of them looks at the force."""
    guards = []
    for row in motion.guards:

        def guard(t, z, row=row[:n], constant=row[-1]):
            return row @ z + constant

        guard.terminal, guard.direction = True, 1
        guards.append(guard)
    return guards
