"""Cascades of events: all events that are due at an instant, one after the other."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.events.event_actions import trigger_event
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.tables import block_of, find_mode, place_of, rows_read, slot_of
from piezoharvest.engine.memory.vector import LANES
from piezoharvest.engine.motion.diode_clamp import begin_clamp
from piezoharvest.engine.motion.mode_tables import build
from piezoharvest.engine.motion.term_sizes import term_sizes
from piezoharvest.engine.propagation.propagate import read_guards

ZERO_TOLERANCE = 1e-12  # relative to its terms: a smaller guard counts as zero
MAX_EVENTS = 60  # events at one instant, beyond which the model is taken to chatter


@compiled
def present_mode(P, L, D):
    """Mode of the present configuration and stops; one that is new is built."""
    slot = find_mode(L, D, D[st.CONFIGURATION], D[st.SLIP])
    if slot == NONE:
        build(P, L, D, D[st.CONFIGURATION], D[st.SLIP])
        slot = L[tb.CLAMPED] - 1
    return slot


@compiled
def process_due_events(P, L, S, D):
    """Carry out all events that are due at this instant.

    Returns the mode, with its guards evaluated at NOW_GUARDS, or NONE if the events do not end.
    """
    # If no event has happened since the last step, the signs and limits of the guards are still set.
    known = NONE if D[st.INCOMPLETE] else D[st.MODE]
    for _ in range(MAX_EVENTS):
        slot = present_mode(P, L, D)
        if known != slot:
            set_guard_signs(P, L, S, D, slot)
            if L[slot_of(L, slot) + tb.CLAMPED_FORM] != NONE:
                begin_clamp(P, L, S, D, slot)
        known = NONE
        read_guards(P, L, S, D, slot, L[tb.GUARDS], 0, D[st.NOW_GUARDS])
        if L[pg.SWITCHED] and L[pg.SWITCHED] != pg.CLOCKED and D[st.DIRECTION] == 0:
            initial_direction(P, L, S, D, slot)
        guard = first_due(P, L, S, D, slot)
        if guard == NONE:
            return slot
        trigger_event(P, L, S, D, L[slot_of(L, slot) + tb.FIRST_GUARD + 2 * guard])
    return NONE


@compiled
def set_guard_signs(P, L, S, D, slot):
    """Set the signs of a mode's guards: of the extremum by the direction of motion, of a stop by its side.

    Also set the limits of their forms between which none of them rises. The direction is 0 at rest; motion that begins
    there is not an extremum.
    """
    at, own, lower, upper = slot_of(L, slot), L[pg.G], D[st.LOWER], D[st.UPPER]
    for r in range(L[tb.FORMS]):
        S[lower + r], S[upper + r] = -np.inf, np.inf
    for g in range(L[at + tb.GUARD_COUNT] - pg.WATCHED):
        what, row, sign, offset = L[at + tb.FIRST_GUARD + 2 * g], L[at + tb.FIRST_GUARD + 2 * g + 1], 1.0, 0.0
        if what == own:
            sign = -D[st.DIRECTION] * 1.0
        elif what > own:
            j, side = (what - own - 1) // 2, (what - own - 1) % 2
            if D[D[st.SLIP] + j] == 0:
                sign, offset = 1.0 - 2.0 * side, -P[L[pg.STOP_LIMIT] + j]
            else:
                sign = -D[D[st.SLIP] + j] * 1.0
        S[D[st.SIGN] + g], S[D[st.OFFSET] + g] = sign, offset
        if sign > 0.0:
            S[upper + row] = -offset
        elif sign < 0.0:
            S[lower + row] = offset


@compiled
def first_due(P, L, S, D, slot):
    """First guard that is above zero, or at zero and about to rise: value, rate and second rate decide in turn.

    Zero is relative to the size of the guard's terms and to its change in a short step.
    """
    sizes = term_sizes(P, L, S, slot)
    S[D[st.SIZE]] = sizes[0]
    if not _any_due(P, L, S, D, slot, sizes):
        return NONE
    at, now = slot_of(L, slot), D[st.NOW_GUARDS]
    for g in range(L[at + tb.GUARD_COUNT] - pg.WATCHED):
        row, sign = L[at + tb.FIRST_GUARD + 2 * g + 1], S[D[st.SIGN] + g]
        place, zeros = now + place_of(row), _zero_tolerances(P, L, slot, sizes, place_of(row))
        value = sign * S[place] + S[D[st.OFFSET] + g]
        if _due(value, sign * S[place + LANES], sign * S[place + 2 * LANES], zeros):
            return g
    return NONE


@inlined
def _zero_tolerances(P, L, slot, sizes, place):
    """Tolerances for zero of a guard, of its rate and of its second rate."""
    block = block_of(L, slot)
    largest, short = block + L[tb.SIZES] + place, P[block + L[tb.STEPS] + L[slot_of(L, slot) + tb.FINEST_LEVEL]]
    value, rate, bend = sizes[0] * P[largest], sizes[1] * P[largest + LANES], sizes[2] * P[largest + 2 * LANES]
    zero = ZERO_TOLERANCE
    return zero * (value + short * rate), 10.0 * zero * (rate + short * bend), 100.0 * zero * bend


@inlined
def _due(value, rate, bend, zeros):
    """True if a guard is above zero, or at zero and about to rise; without branches, so that it is vectorised."""
    rises = (rate > zeros[1]) | ((rate >= -zeros[1]) & (bend > zeros[2]))
    return (value > zeros[0]) | ((value >= -zeros[0]) & rises)


@compiled
def _any_due(P, L, S, D, slot, sizes):
    """True if any guard is due; forms are tested a register at a time."""
    now, lower, upper = D[st.NOW_GUARDS], D[st.LOWER], D[st.UPPER]
    due = False
    for row in range(0, rows_read(L, False, slot), LANES):
        place = place_of(row)
        for k in range(LANES):
            zeros, here = _zero_tolerances(P, L, slot, sizes, place + k), now + place + k
            value, rate, bend = S[here], S[here + LANES], S[here + 2 * LANES]
            due |= _due(value - S[upper + row + k], rate, bend, zeros)
            due |= _due(S[lower + row + k] - value, -rate, -bend, zeros)
    return due


@compiled
def initial_direction(P, L, S, D, slot):
    """Direction in which sum T_i x_i begins to move: the sign of its lowest derivative that is not zero to rounding."""
    at, block, sizes = slot_of(L, slot), block_of(L, slot), term_sizes(P, L, S, slot)
    for g in range(L[at + tb.GUARD_COUNT]):
        if L[at + tb.FIRST_GUARD + 2 * g] != L[pg.G]:
            continue
        row = L[at + tb.FIRST_GUARD + 2 * g + 1]
        for k in range(3):
            value = S[D[st.NOW_GUARDS] + place_of(row) + k * LANES]
            if abs(value) > ZERO_TOLERANCE * sizes[k] * P[block + L[tb.SIZES] + place_of(row) + k * LANES]:
                D[st.DIRECTION] = 1 if value > 0.0 else -1
                break
    set_guard_signs(P, L, S, D, slot)
