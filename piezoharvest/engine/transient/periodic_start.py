"""State from which a run repeats with the period of its excitation, with its derivatives by the quantities.

The state is that of the steady state's own search. Being a fixed point z = P(z, p) of the map over a period, it changes
with the quantities by dz/dp = (1 - dP/dz)^-1 dP/dp (implicit function theorem; Aprille & Trick, Proc. IEEE 60(1),
108-114, 1972), and both derivatives of the map come from one run along its motions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from piezoharvest.description.excitation import Excitation
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory.state import EngineState
from piezoharvest.engine.run import Machine
from piezoharvest.engine.sensitivity.orbit import unscheduled_state
from piezoharvest.engine.simulation import search
from piezoharvest.engine.steady_search import EngineError, Orbit, Shooting, solve_conserving
from piezoharvest.engine.steady_state.shooting import ACCEPTED
from piezoharvest.engine.transient.sampled_system import SampledSystem
from piezoharvest.engine.transient.variation import SampledRun


def periodic_start(
    system: SampledSystem, excitation: Excitation, before: float, derivatives: bool = True
) -> tuple[EngineState, np.ndarray]:
    """State in the steady state, less than a period before a time, and its derivatives.

    Parameters
    ----------
    system : SampledSystem
        Under the excitation.
    excitation : Excitation
        Periodic.
    before : float
        s.
    derivatives : bool
        Compute them; else they are zero.

    Returns
    -------
    EngineState
        The switch is open, and no action of it is scheduled.
    (n, quantities) array
        Derivatives of its scaled states.

    Raises
    ------
    EngineError
        There is no steady state with the period of the excitation.
    """
    period = excitation.period
    assert period is not None
    plain = system.plain
    orbit, mirrored, _, _, settles = search(plain, excitation)
    if not settles:
        raise EngineError(_why_not(orbit))
    shooting, span = Shooting(Machine(plain), period, mirrored), 0.5 * period if mirrored else period
    # The orbit's own time is some periods after rest.
    orbit = replace(orbit, time=np.mod(orbit.time - before, period) + before - 2.0 * period)
    state, found = unscheduled_state(shooting, orbit, span)
    if not found:
        raise EngineError("an action of the switch is always pending, so none can be attributed to its extremum")
    if state.clock[st.NOW] < before - period:
        orbit = replace(orbit, time=orbit.time + period)
        state, _ = unscheduled_state(shooting, orbit, span)
    n = plain.program.rate.shape[-2]
    if not derivatives:
        return state, np.zeros((n, system.count))
    parity = plain.program.odd[:, None] if mirrored else 1.0
    return state, _by_quantities(system, state, span, parity)


def _why_not(orbit: Orbit) -> str:
    """Sentence about a search that has failed."""
    if orbit.converged:
        reason = "there is one, but a run from rest does not reach it"
    elif orbit.residual <= ACCEPTED:
        reason = f"it is unstable, a small change grows {orbit.radius:.3g} times in each"
    else:
        reason = f"the nearest changes by {orbit.residual:.1e} in each"
    return f"no steady state that repeats with every period of the excitation ({reason})"


def _by_quantities(system: SampledSystem, state: EngineState, span: float, parity: np.ndarray | float) -> np.ndarray:
    """Derivatives (n, count) of a state that repeats after a span, with the signs `parity`, by the quantities."""
    n, count, now = system.lowered.program.rate.shape[-2], system.count, float(state.clock[st.NOW])
    changes = np.hstack([np.zeros((n, count)), np.eye(n)])
    run = SampledRun(system, np.array([now, now + span]), state, changes, ())
    run.through(0, 1)
    after = parity * run.changes
    return solve_conserving(np.eye(n) - after[:, count:], after[:, :count])
