"""What is due at an instant: events that follow at once from where the state is."""

from __future__ import annotations

from piezoharvest.engine import program as pg
from piezoharvest.engine import state as st
from piezoharvest.engine import tables as tb
from piezoharvest.engine.build import build
from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.crossing import NONE
from piezoharvest.engine.events import happen
from piezoharvest.engine.march import read_guards
from piezoharvest.engine.tables import block_of, place_of, seek, slot_of
from piezoharvest.engine.vector import LANES

TINY = 1e-12  # a guard this small, relative to its terms, is zero
AT_ONCE = 60  # events at one instant beyond which the model chatters


@compiled
def settle(P, L, S, D):
    """Carry out whatever is due at this instant without time passing.

    Returns the mode, with its guards read at NOW_GUARDS, or NONE where the events do not end.
    """
    # Where nothing has happened since a mode was moved in, its guards are read as they were.
    known = NONE if D[st.BETWEEN] else D[st.MODE]
    for _ in range(AT_ONCE):
        slot = seek(L, D, D[st.CONFIGURATION], D[st.SLIP])
        if slot == NONE:
            build(P, L, D, D[st.CONFIGURATION], D[st.SLIP])
            slot = L[tb.HELD] - 1
        if known != slot:
            orient(P, L, S, D, slot)
        known = NONE
        read_guards(P, L, S, D, slot, 0, D[st.NOW_GUARDS])
        if L[pg.SWITCHED] and D[st.DIRECTION] == 0:
            leave_rest(P, L, S, D, slot)
        guard = overdue(P, L, S, D, slot)
        if guard == NONE:
            return slot
        happen(P, L, S, D, L[slot_of(L, slot) + tb.FIRST_GUARD + 2 * guard])
    return NONE


@compiled
def orient(P, L, S, D, slot):
    """Set how the guards of a mode are read: the extremum by the direction of motion, a stop by its side.

    The direction is 0 at rest, which is left without an extremum.
    """
    at, own = slot_of(L, slot), L[pg.G]
    for g in range(L[at + tb.GUARD_COUNT]):
        what, sign, offset = L[at + tb.FIRST_GUARD + 2 * g], 1.0, 0.0
        if what == own:
            sign = -D[st.DIRECTION] * 1.0
        elif what > own:
            j, side = (what - own - 1) // 2, (what - own - 1) % 2
            if D[D[st.SLIP] + j] == 0:
                sign, offset = 1.0 - 2.0 * side, -P[L[pg.STOP_LIMIT] + j]
            else:
                sign = -D[D[st.SLIP] + j] * 1.0
        S[D[st.SIGN] + g], S[D[st.OFFSET] + g] = sign, offset


@compiled
def overdue(P, L, S, D, slot):
    """First guard that is above zero, or at zero and about to rise: value, rate and second rate decide in turn.

    Zero is judged against the size of the guard's terms and of what its rate makes of a short step.
    """
    at, block, now = slot_of(L, slot), block_of(L, slot), D[st.NOW_GUARDS]
    size = 0.0
    for i in range(L[pg.A]):
        size += abs(S[i])
    short = P[block + L[tb.STEPS] + L[at + tb.FINEST_LEVEL]]
    for g in range(L[at + tb.GUARD_COUNT] - pg.WATCHED):
        row, sign, value = L[at + tb.FIRST_GUARD + 2 * g + 1], S[D[st.SIGN] + g], S[D[st.OFFSET] + g]
        sizes, place = block + L[tb.SIZES] + 3 * row, now + place_of(row)
        # What its terms leave of it by rounding; an offset (the limit of a stop) is as large as what it bounds.
        S[D[st.FLOOR] + g] = 1e-13 * (size * P[sizes] + abs(value))
        tolerance = TINY
        for k in range(3):
            value += sign * S[place + k * LANES]
            zero = tolerance * size * (P[sizes + k] + (short * P[sizes + k + 1] if k < 2 else 0.0))
            if value > zero:
                return g
            if value < -zero:
                break
            value, tolerance = 0.0, tolerance * 10.0
    return NONE


@compiled
def leave_rest(P, L, S, D, slot):
    """Direction in which sum T_i x_i begins to move: the sign of its first rate that is not zero to rounding."""
    at, block, size = slot_of(L, slot), block_of(L, slot), 0.0
    for i in range(L[pg.A]):
        size += abs(S[i])
    for g in range(L[at + tb.GUARD_COUNT]):
        if L[at + tb.FIRST_GUARD + 2 * g] != L[pg.G]:
            continue
        row = L[at + tb.FIRST_GUARD + 2 * g + 1]
        for k in range(3):
            value = S[D[st.NOW_GUARDS] + place_of(row) + k * LANES]
            if abs(value) > TINY * size * P[block + L[tb.SIZES] + 3 * row + k]:
                D[st.DIRECTION] = 1 if value > 0.0 else -1
                break
    orient(P, L, S, D, slot)
