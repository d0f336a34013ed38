"""Constraint of conducting diodes: the electrode voltage equals that of the dc side.

A mode conserves this difference, but doubling exp(A h) - 1 also doubles its rounding error: with mechanics 1e5 times as
fast as the drive the voltage drifts by 1e-12 of itself within a step, and diodes that block would be found to conduct
again immediately, endlessly. The conserved form is therefore enforced on every level.

The rounding error of the difference at the time when the diodes begin to conduct would stay, too. Times the current it
is energy without an entry: a share of 1e-6 if the voltage is 1e-6 of the open one. It is therefore set to zero there.
"""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import dot_column
from piezoharvest.engine.memory.tables import block_of, slot_of
from piezoharvest.engine.memory.vector import dot
from piezoharvest.engine.motion.charge_transfer import charge_slope, move_charge
from piezoharvest.engine.motion.term_sizes import term_sizes

CONSERVED_SHARE = 1e-13  # of a form's terms: a rate below this is rounding of zero
ROUNDING_SHARE = 1e-9  # of the state's size: error of a form that is zero, as events are located to 1e-12


@compiled
def clamped_form(P, L, slot, configuration, out):
    """Write to `out` the form that diodes conducting in a configuration keep at zero; return its place in P, or NONE.

    It is the guard at which they began to conduct, if the mode conserves it: with a bridge behind an inductance it does
    not.
    """
    guard, a = _opened_by(L, configuration), L[pg.A]
    if guard == NONE:
        return NONE
    matrix, rows, form = block_of(L, slot) + L[tb.MATRIX], L[pg.ROWS], L[pg.GUARD_Z] + guard * a
    for k in range(rows):
        P[out + k] = P[form + k] if k < a else 0.0
    largest, terms = 0.0, 0.0
    for j in range(a):
        rate = 0.0
        for i in range(a):
            term = P[out + i] * P[matrix + j * rows + i]
            rate += term
            terms += abs(term)
        largest = max(largest, abs(rate))
    return form if P[out + L[pg.CHARGE]] != 0.0 and largest <= CONSERVED_SHARE * terms else NONE


@compiled
def _opened_by(L, configuration):
    """Number of the guard that makes diodes conduct and leads to a configuration, or NONE."""
    for k in range(L[pg.C] * L[pg.G]):
        if L[L[pg.GUARD_TARGET] + k] == configuration and L[L[pg.GUARD_CODE] + k] == pg.CONDUCT:
            return k
    return NONE


@compiled
def begin_clamp(P, L, S, D, slot):
    """Move charge so that the form that the diodes of a mode keep at zero is exactly zero, if it is zero to rounding.

    At the beginning of a run the sensitivities follow; after an event they are set by `saltation`.
    """
    form = L[slot_of(L, slot) + tb.CLAMPED_FORM]
    value, slope = dot_column(P, form, 1, S, 0, L[pg.A]), charge_slope(P, L, D, form)
    if slope == 0.0 or abs(value) > ROUNDING_SHARE * term_sizes(P, L, S, slot)[0]:
        return
    move_charge(P, L, S, D, 0, -value / slope)
    for s in range(0 if D[st.INCOMPLETE] else D[st.SENSITIVITIES]):
        phi = D[st.PHI] + s * L[pg.ROWS]
        move_charge(P, L, S, D, phi, -dot_column(P, form, 1, S, phi, L[pg.A]) / slope)


@compiled
def enforce_clamp(P, L, growth, form):
    """Remove from the charge's row of a growth matrix the rounding error of a form that is conserved."""
    rows, charge = L[pg.ROWS], L[pg.CHARGE]
    for j in range(L[pg.A]):
        column = growth + j * rows
        P[column + charge] -= dot(P, form, P, column, rows) / P[form + charge]
