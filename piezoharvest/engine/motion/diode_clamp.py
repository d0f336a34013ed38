"""What conducting diodes hold: an electrode voltage that stays at that of the dc side.

A mode conserves this difference, but doubling exp(A h) - 1 doubles what rounding makes of it, too: beside mechanics
that are 1e5 times as fast as the drive the voltage drifts by 1e-12 of itself within a step, and when the diodes block
they would be found to conduct again at once, for ever. The conserved form is therefore held on every level.

What rounding leaves of the difference where the diodes begin to conduct stays, too. Times the current it is energy that
no entry accounts for: a share of 1e-6, where the voltage is 1e-6 of the open one. It is therefore set to zero there.
"""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import dot_column
from piezoharvest.engine.memory.tables import block_of
from piezoharvest.engine.memory.vector import dot, total_size
from piezoharvest.engine.motion.charge_transfer import along, shift

CONSERVED = 1e-13  # part of a form's rate that rounding may leave of nothing
ROUNDING = 1e-9  # part of the state's size that a form which is zero may be off by where events are found to 1e-12


@compiled
def held_form(P, L, slot, configuration, out):
    """Leave at `out` the form that diodes conducting in a configuration hold at zero; returns its place in P, or NONE.

    It is what opened the diodes, if the mode conserves it: a bridge behind an inductance does not.
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
    return form if P[out + L[pg.CHARGE]] != 0.0 and largest <= CONSERVED * terms else NONE


@compiled
def _opened_by(L, configuration):
    """Number of a guard that makes diodes conduct and leads to a configuration, or NONE."""
    for k in range(L[pg.C] * L[pg.G]):
        if L[L[pg.GUARD_TARGET] + k] == configuration and L[L[pg.GUARD_CODE] + k] == pg.CONDUCT:
            return k
    return NONE


@compiled
def begin_to_hold(P, L, S, D, form):
    """Move as much charge as makes a form zero that diodes hold from now on, if it is zero to rounding.

    Where a run begins, its sensitivities follow; those after an event have their own account (`saltation`).
    """
    value, slope = dot_column(P, form, 1, S, 0, L[pg.A]), along(P, L, D, form)
    if slope == 0.0 or abs(value) > ROUNDING * total_size(S, 0, L[pg.ROWS]):
        return
    shift(P, L, S, D, 0, -value / slope)
    for s in range(0 if D[st.BETWEEN] else D[st.SENSITIVITIES]):
        phi = D[st.PHI] + s * L[pg.ROWS]
        shift(P, L, S, D, phi, -dot_column(P, form, 1, S, phi, L[pg.A]) / slope)


@compiled
def hold(P, L, growth, form):
    """Take from the charge's row of a growth matrix what rounding made of a form that is conserved."""
    rows, charge = L[pg.ROWS], L[pg.CHARGE]
    for j in range(L[pg.A]):
        column = growth + j * rows
        P[column + charge] -= dot(P, form, P, column, rows) / P[form + charge]
