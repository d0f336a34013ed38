"""Sections of a motion: snapshots of the hybrid state at one instant.

Numbers in W (states, then the times of scheduled actions, of the opening of the switch and of its last action, relative
to now) and integers in V (discrete state). The continuous variables of a section form its vector: the states, the
scheduled times, and the opening time if the switch is closed.
"""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.events.charge_extraction import zero_voltage
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import QUEUE_LENGTH

# Sections, Jacobians and scratch, by number.
START, END, TRIAL, BEST, BASE, FOUND = range(6)
SECTIONS = 6
# Square matrices: two Jacobians, four of scratch, and the Jacobian of the best section.
MATRICES, BEST_JACOBIAN = 7, 6
# Integers of a section, before the slips and the polarities.
Y_CONFIGURATION, Y_DIRECTION, Y_WAITING, Y_CLOSED, Y_SLIP = range(5)
# First entries of W: results, the span, and a rectified voltage from which it rises (-1: none known).
TIME, RESIDUAL, RADIUS, EVALUATIONS, SPAN, PERIOD, WHEN, LOWEST, HEAD = range(9)


@inlined
def numbers_of(L, k):
    """Offset of the numbers of a section in W."""
    return HEAD + k * (L[pg.N] + QUEUE_LENGTH + 2)


@inlined
def integers_of(L, k):
    """Offset of the integers of a section in V."""
    return k * (Y_SLIP + L[pg.H] + QUEUE_LENGTH)


@inlined
def largest(L):
    """Largest number of variables of a section."""
    return L[pg.N] + QUEUE_LENGTH + 1


@inlined
def jacobian_of(L, k):
    """Offset in W of a matrix of the size of a Jacobian: those of START and TRIAL, then scratch."""
    return numbers_of(L, SECTIONS) + k * largest(L) * largest(L)


def room(L: np.ndarray) -> tuple[int, int]:
    """Numbers of W and integers of V."""
    n, h = int(L[pg.N]), int(L[pg.H])
    m = n + QUEUE_LENGTH + 1
    numbers = HEAD + SECTIONS * (n + QUEUE_LENGTH + 2) + MATRICES * m * m + 3 * m
    return numbers, SECTIONS * (Y_SLIP + h + QUEUE_LENGTH) + m


@compiled
def variables(L, V, k):
    """Length of the vector of a section."""
    y = integers_of(L, k)
    return L[pg.N] + V[y + Y_WAITING] + V[y + Y_CLOSED]


@inlined
def place_of(L, V, k, i):
    """Place of variable i of a section in W: the opening time stands behind the whole queue."""
    waiting = L[pg.N] + V[integers_of(L, k) + Y_WAITING]
    return numbers_of(L, k) + (i if i < waiting else L[pg.N] + QUEUE_LENGTH)


@compiled
def load(P, L, S, D, W, V, k, time, sensitivities):
    """Set the state to a section at `time`, with sensitivities to the section's variables if they are propagated."""
    x, y, n, h, clock = numbers_of(L, k), integers_of(L, k), L[pg.N], L[pg.H], D[st.CLOCK]
    for i in range(n):
        S[i] = W[x + i]
    for j in range(h):
        D[D[st.SLIP] + j] = V[y + Y_SLIP + j]
    waiting = V[y + Y_WAITING]
    D[st.CONFIGURATION], D[st.DIRECTION] = V[y + Y_CONFIGURATION], V[y + Y_DIRECTION]
    D[st.WAITING], D[st.CLOSED] = waiting, V[y + Y_CLOSED]
    D[st.INCOMPLETE] = D[st.LOGGED] = 0
    D[st.MODE] = NONE
    S[clock + st.NOW], S[clock + st.ACTED] = time, time + W[x + n + QUEUE_LENGTH + 1]
    S[clock + st.OPENS] = time + W[x + n + QUEUE_LENGTH] if V[y + Y_CLOSED] else np.inf
    for j in range(waiting):
        S[D[st.QUEUE] + j] = time + W[x + n + j]
        D[D[st.POLARITY] + j] = V[y + Y_SLIP + h + j]
    D[st.SENSITIVITIES] = sensitivities
    rows = L[pg.ROWS]
    for s in range(sensitivities):
        for i in range(rows):
            S[D[st.PHI] + s * rows + i] = 1.0 if i == s and i < n else 0.0
        for j in range(waiting):
            S[D[st.QUEUE_PHI] + j * sensitivities + s] = 1.0 if s == n + j else 0.0
        S[D[st.OPENS_PHI] + s] = 1.0 if V[y + Y_CLOSED] and s == sensitivities - 1 else 0.0
        S[D[st.EVENT_PHI] + s] = 0.0
    if L[pg.SHORTED] and L[pg.ELEMENTS]:
        # Motions conserve the voltage, but the charge depends on it nonlinearly through smooth elements: a linear step
        # of a search does not conserve it.
        zero_voltage(P, L, S, D)
        for i in range(n):
            W[x + i] = S[i]


@compiled
def save(P, L, S, D, W, V, k, mirrored):
    """Store the state as a section, mirrored if the span is half a period."""
    x, y, n, h, clock = numbers_of(L, k), integers_of(L, k), L[pg.N], L[pg.H], D[st.CLOCK]
    sign, time = -1 if mirrored else 1, S[clock + st.NOW]
    for i in range(n):
        W[x + i] = S[i] * (L[L[pg.ODD] + i] if mirrored else 1)
    for j in range(h):
        V[y + Y_SLIP + j] = sign * D[D[st.SLIP] + j]
    configuration = D[st.CONFIGURATION]
    V[y + Y_CONFIGURATION] = L[L[pg.MIRROR] + configuration] if mirrored else configuration
    V[y + Y_DIRECTION] = sign * D[st.DIRECTION]
    V[y + Y_WAITING], V[y + Y_CLOSED] = D[st.WAITING], D[st.CLOSED]
    for j in range(D[st.WAITING]):
        W[x + n + j] = S[D[st.QUEUE] + j] - time
        V[y + Y_SLIP + h + j] = sign * D[D[st.POLARITY] + j]
    W[x + n + QUEUE_LENGTH] = S[clock + st.OPENS] - time
    W[x + n + QUEUE_LENGTH + 1] = S[clock + st.ACTED] - time


@compiled
def keep_jacobian(L, S, D, W, V, at, mirrored):
    """Store the Jacobian of the variables of the section END with respect to those of the initial section."""
    n, rows, count, row = L[pg.N], L[pg.ROWS], D[st.SENSITIVITIES], 0
    for i in range(n):
        sign = L[L[pg.ODD] + i] if mirrored else 1
        for s in range(count):
            W[at + row * count + s] = sign * S[D[st.PHI] + s * rows + i]
        row += 1
    for j in range(D[st.WAITING]):
        for s in range(count):
            W[at + row * count + s] = S[D[st.QUEUE_PHI] + j * count + s]
        row += 1
    if D[st.CLOSED]:
        for s in range(count):
            W[at + row * count + s] = S[D[st.OPENS_PHI] + s]


@compiled
def copy_section(L, W, V, source, target):
    """Copy a section."""
    for i in range(L[pg.N] + QUEUE_LENGTH + 2):
        W[numbers_of(L, target) + i] = W[numbers_of(L, source) + i]
    for i in range(Y_SLIP + L[pg.H] + QUEUE_LENGTH):
        V[integers_of(L, target) + i] = V[integers_of(L, source) + i]


@inlined
def same_variables(L, V, k):
    """True if a section has the same continuous variables as END."""
    y, end = integers_of(L, k), integers_of(L, END)
    return V[y + Y_WAITING] == V[end + Y_WAITING] and V[y + Y_CLOSED] == V[end + Y_CLOSED]


@compiled
def distance(P, L, W, V, k):
    """Relative change from a section to END; infinite where the discrete state changed its kind.

    Mechanical and electrical states are compared separately: together, a weakly coupled circuit would be masked by the
    vibration. The last action counts while it may inhibit the next one.
    """
    if not same_variables(L, V, k):
        return np.inf
    x, end, n = numbers_of(L, k), numbers_of(L, END), L[pg.N]
    whole = change_of(L, W, x, end, 0, n, 1e-300)[1]
    mechanical = change_of(L, W, x, end, 0, L[pg.CHARGE], 1e-12 * whole)[0]
    electrical = change_of(L, W, x, end, L[pg.CHARGE], n, 1e-12 * whole)[0]
    found = max(mechanical, electrical)
    for i in range(n, variables(L, V, k)):
        found = max(found, abs(W[place_of(L, V, END, i)] - W[place_of(L, V, k, i)]) / W[SPAN])
    acted, before = W[end + n + QUEUE_LENGTH + 1], W[x + n + QUEUE_LENGTH + 1]
    if max(acted, before) > -P[L[pg.HOLD_OFF]]:
        found = max(found, abs(acted - before) / W[SPAN])
    return found if np.isfinite(found) else np.inf


@compiled
def change_of(L, W, x, end, first, last, least):
    """Relative change of some states between two sections."""
    change, before, after = 0.0, 0.0, 0.0
    for i in range(first, last):
        change += (W[end + i] - W[x + i]) ** 2
        before += W[x + i] ** 2
        after += W[end + i] ** 2
    size = max(np.sqrt(before), np.sqrt(after), least)
    return np.sqrt(change) / size, size
