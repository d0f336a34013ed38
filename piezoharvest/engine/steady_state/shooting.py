"""Newton's method on the map from one section to the next, the compiled part of the search for a steady state."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory.algebra import radius, solve_conserving
from piezoharvest.engine.memory.state import set_tones
from piezoharvest.engine.propagation.advance import DONE, advance
from piezoharvest.engine.steady_state.section import (
    BASE,
    BEST,
    BEST_JACOBIAN,
    END,
    EVALUATIONS,
    FOUND,
    LOWEST,
    MATRICES,
    PERIOD,
    RADIUS,
    RESIDUAL,
    SECTIONS,
    SPAN,
    START,
    TIME,
    TRIAL,
    WHEN,
    Y_DIRECTION,
    Y_SLIP,
    change_of,
    copy_section,
    distance,
    integers_of,
    jacobian_of,
    keep_jacobian,
    largest,
    load,
    numbers_of,
    place_of,
    same_variables,
    save,
    variables,
)

# Spans simulated before Newton's method is tried (again): it needs a state with the right sequence of events.
WARM_UP_SPANS = (2, 6, 32, 160, 800)
MAX_ITERATIONS = 24
MAX_HALVINGS = 5
COLLAPSE_SHARE = 0.98  # fraction of the rectified voltage removed by a step in which the bridge does not conduct
RISE_DISTANCE = 0.1  # relative change of the mechanical state below which that of the rectified voltage is significant
TOLERANCE = 1e-12  # aimed at
ACCEPTED = 1e-9  # accepted where rounding allows no more
MAX_RADIUS = 1 + 1e-6
MAX_CHANGE = 1e3 * ACCEPTED  # change over the recorded period, beyond which the result of the search is rejected


@compiled
def run_to(P, L, S, D, W, V, t_end):
    """Run to t_end and count the periods."""
    W[EVALUATIONS] += (t_end - S[D[st.CLOCK]]) / W[PERIOD]
    set_tones(P, L, S, S[D[st.CLOCK]])
    return advance(P, L, S, D, t_end)


@compiled
def span_map(P, L, S, D, W, V, k, mirrored, jacobian):
    """Run from a section through the span to the section END, and store the Jacobian.

    Returns the distance of the two, infinite if their discrete states differ, or NaN if the motion could not be
    simulated.
    """
    load(P, L, S, D, W, V, k, W[WHEN], variables(L, V, k))
    if run_to(P, L, S, D, W, V, W[WHEN] + W[SPAN]) != DONE:
        return np.nan
    save(P, L, S, D, W, V, END, mirrored)
    keep_jacobian(L, S, D, W, V, jacobian, mirrored)
    return distance(P, L, W, V, k)


@inlined
def rectified(L):
    """Index of the state that mirroring does not change, the rectified voltage, or -1."""
    found = -1
    for i in range(L[pg.N]):
        if L[L[pg.ODD] + i] > 0:
            found = i
    return found


@compiled
def propose(P, L, W, V, step, damping):
    """Set the section TRIAL: the discrete state of END with the variables of START plus a damped step, within bounds.

    Slipping stops stay on their limits; the direction of motion follows the velocity, as otherwise a false extremum
    would be detected at the section.
    """
    copy_section(L, W, V, END, TRIAL)
    x, y, n = numbers_of(L, TRIAL), integers_of(L, TRIAL), L[pg.N]
    for i in range(variables(L, V, TRIAL)):
        value = W[place_of(L, V, START, i)] + damping * W[step + i]
        W[place_of(L, V, TRIAL, i)] = value if i < n else max(value, 0.0)
    for j in range(L[pg.H]):
        k, limit, slip = x + L[L[pg.STOP_STATE] + j], P[L[pg.STOP_LIMIT] + j], V[y + Y_SLIP + j]
        W[k] = slip * limit if slip != 0 else min(max(W[k], -limit), limit)
    velocity = 0.0
    for i in range(n):
        velocity += P[L[pg.TRIGGER_ROW] + i] * W[x + i]
    if velocity != 0.0:
        V[y + Y_DIRECTION] = 1 if velocity > 0.0 else -1


@compiled
def _keep_best(L, W, V, residual, jacobian):
    """Store START as the best section, with the Jacobian of its map."""
    copy_section(L, W, V, START, BEST)
    W[TIME], W[RESIDUAL], W[RADIUS] = W[WHEN], residual, np.inf
    if residual < np.inf:
        for k in range(variables(L, V, START) ** 2):
            W[jacobian_of(L, BEST_JACOBIAN) + k] = W[jacobian + k]


@compiled
def _store_rise(L, W, V, k):
    """Store the rectified voltage of a section in which it still rises, if the rest is near its equilibrium."""
    dc, x, end = rectified(L), numbers_of(L, k), numbers_of(L, END)
    if dc < 0 or change_of(L, W, x, end, 0, L[pg.CHARGE], 1e-300)[0] > RISE_DISTANCE:
        return
    if W[end + dc] > W[x + dc]:
        W[LOWEST] = W[x + dc]


@compiled
def _newton_step(L, W, V, k, jacobian, step, pinned, shift):
    """Newton step of a section whose span ends at END, left at `step`; returns its length.

    The variable `pinned` is changed by `shift` and the others follow; -1 pins none.
    """
    n, matrix, work = variables(L, V, k), jacobian_of(L, 2), jacobian_of(L, 3)
    right = jacobian_of(L, MATRICES)
    for i in range(n):
        W[right + i] = W[place_of(L, V, END, i)] - W[place_of(L, V, k, i)]
        for j in range(n):
            W[matrix + i * n + j] = (1.0 if i == j else 0.0) - W[jacobian + i * n + j]
    if pinned >= 0:
        W[right + pinned] = shift
        for j in range(n):
            W[matrix + pinned * n + j] = 1.0 if j == pinned else 0.0
    solve_conserving(W, V, matrix, right, n, integers_of(L, SECTIONS), work, step)
    length = 0.0
    for i in range(n):
        length += W[step + i] ** 2
    return np.sqrt(length)


@compiled
def _try_step(P, L, S, D, W, V, mirrored, step, damping, jacobian):
    """Set the section TRIAL a damped step from START, whose END is kept at BASE; return its distance to its own END."""
    copy_section(L, W, V, BASE, END)
    propose(P, L, W, V, step, damping)
    trial = span_map(P, L, S, D, W, V, TRIAL, mirrored, jacobian)
    if trial < np.inf:
        _store_rise(L, W, V, TRIAL)
    return trial


@compiled
def _next_section(P, L, S, D, W, V, mirrored, jacobian, other):
    """Find a section TRIAL with less distance than START: by Newton's step or a fraction of it, or else END itself.

    The criterion is the length of the next step with the same Jacobian (Deuflhard's natural monotonicity test): a dc
    voltage far too high hardly changes in a period, so that the change itself would suggest a solution. Newton's method
    may also propose unreachable sections, as with a negative dc voltage. Returns the distance, or NaN if the motion
    cannot be simulated.
    """
    step = jacobian_of(L, MATRICES) + largest(L)
    rest, dc = step + largest(L), rectified(L)
    length, damping = _newton_step(L, W, V, START, jacobian, step, -1, 0.0), 1.0
    # The section that steps are proposed from is stored, as every trial overwrites END.
    copy_section(L, W, V, END, BASE)
    if dc >= 0 and W[LOWEST] >= 0.0 and W[step + dc] < -COLLAPSE_SHARE * W[numbers_of(L, START) + dc]:
        # With a bridge that does not conduct, Newton's method finds a voltage of zero: the solution is where conduction
        # begins, between this voltage and one from which it rose.
        voltage = W[numbers_of(L, START) + dc]
        if W[LOWEST] > 0.999 * voltage:
            W[LOWEST] = 0.0
        _newton_step(L, W, V, START, jacobian, step, dc, 0.5 * (W[LOWEST] - voltage))
        trial = _try_step(P, L, S, D, W, V, mirrored, step, 1.0, other)
        if trial < np.inf:
            return trial
    for _ in range(MAX_HALVINGS):
        trial = _try_step(P, L, S, D, W, V, mirrored, step, damping, other)
        if trial <= ACCEPTED:
            return trial
        comparable = trial < np.inf and variables(L, V, TRIAL) == variables(L, V, START)
        if comparable and _newton_step(L, W, V, TRIAL, jacobian, rest, -1, 0.0) < length:
            return trial
        damping /= 3.0
    copy_section(L, W, V, BASE, TRIAL)
    return span_map(P, L, S, D, W, V, TRIAL, mirrored, other)


@compiled
def newton(P, L, S, D, W, V, mirrored):
    """Newton's method from the section START to BEST, and the spectral radius of the map there."""
    _iterate(P, L, S, D, W, V, mirrored)
    if W[RESIDUAL] < np.inf:
        W[RADIUS] = radius(W, jacobian_of(L, BEST_JACOBIAN), variables(L, V, BEST), jacobian_of(L, 2))


@compiled
def _iterate(P, L, S, D, W, V, mirrored):
    """Newton's method with a line search; if it fails, simple iteration of the map."""
    first, other = jacobian_of(L, 0), jacobian_of(L, 1)
    residual = span_map(P, L, S, D, W, V, START, mirrored, first)
    _keep_best(L, W, V, residual, first)
    W[LOWEST] = -1.0
    if residual < np.inf:
        _store_rise(L, W, V, START)
    for _ in range(MAX_ITERATIONS):
        if np.isnan(residual) or (residual == np.inf and same_variables(L, V, START)):
            return
        if residual == np.inf:
            copy_section(L, W, V, END, START)
            residual = span_map(P, L, S, D, W, V, START, mirrored, first)
            continue
        before = residual
        residual = _next_section(P, L, S, D, W, V, mirrored, first, other)
        if np.isnan(residual):
            return
        copy_section(L, W, V, TRIAL, START)
        first, other = other, first
        if residual < W[RESIDUAL]:
            _keep_best(L, W, V, residual, first)
        if W[RESIDUAL] <= TOLERANCE or (W[RESIDUAL] <= ACCEPTED and not residual < 0.5 * before):
            return


@compiled
def _event_free_instant(S, D, begin, span):
    """Instant well within the longest event-free time of the last span, s after its beginning: the map is smooth there.

    Not in its middle, nor at the beginning of a span without events: between two extrema all states may cross zero
    there, and a relative change would be meaningless.
    """
    count, times = min(D[st.LOGGED], D[st.LOG_ROOM]), D[st.LOG_TIME]
    if count == 0:
        return span / 6.0
    for k in range(count):
        value, j = (S[times + k] - begin) % span, k
        while j > 0 and S[times + j - 1] > value:
            S[times + j] = S[times + j - 1]
            j -= 1
        S[times + j] = value
    longest, found = -1.0, 0.0
    for k in range(count):
        gap = S[times + k + 1] - S[times + k] if k + 1 < count else S[times] + span - S[times + k]
        if gap > longest:
            longest, found = gap, S[times + k] + gap / 3.0
    return found % span


@compiled
def find(P, L, S, D, W, V, s, d, mirrored):
    """Search from the state in s and d: a few periods, then Newton's method in S and D, repeated if it fails.

    The best orbit is left in W (its time, residual and spectral radius) and in the section BEST. Returns the status of
    the motion from the start, which is continued during the search.
    """
    clock, spans, span = d[st.CLOCK], 0, W[SPAN]
    begin, sensitivities = s[clock], D[st.SENSITIVITIES]
    time, residual, rho = begin, np.inf, np.inf
    save(P, L, s, d, W, V, FOUND, mirrored)
    for count in WARM_UP_SPANS:
        spans += count
        status = run_to(P, L, s, d, W, V, begin + (spans - 1) * span)
        d[st.LOGGED] = 0
        if status == DONE:
            status = run_to(P, L, s, d, W, V, begin + spans * span)
        W[WHEN] = begin + spans * span + _event_free_instant(s, d, begin, span)
        if status == DONE:
            status = run_to(P, L, s, d, W, V, W[WHEN])
        if status != DONE:
            return status
        save(P, L, s, d, W, V, START, False)
        newton(P, L, S, D, W, V, mirrored)
        found, better = converged(W[RESIDUAL], W[RADIUS]), W[RESIDUAL] < residual
        if found or better:
            time, residual, rho = W[TIME], W[RESIDUAL], W[RADIUS]
            copy_section(L, W, V, BEST, FOUND)
        if found:
            break
        spans += 1
        status = run_to(P, L, s, d, W, V, begin + spans * span)
        if status != DONE:
            return status
    W[TIME], W[RESIDUAL], W[RADIUS] = time, residual, rho
    copy_section(L, W, V, FOUND, BEST)
    D[st.SENSITIVITIES] = sensitivities
    return DONE


@compiled
def converged(residual, rho):
    """True if the state repeats and the orbit attracts."""
    return residual <= ACCEPTED and rho <= MAX_RADIUS
