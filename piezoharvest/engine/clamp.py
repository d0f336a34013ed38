"""What conducting diodes hold: an electrode voltage that stays at that of the dc side.

A mode conserves this difference, but doubling exp(A h) - 1 doubles what rounding makes of it, too: beside mechanics
that are 1e5 times as fast as the drive the voltage drifts by 1e-12 of itself within a step, and when the diodes block
they would be found to conduct again at once, for ever. The conserved form is therefore held on every level.
"""

from __future__ import annotations

from piezoharvest.engine import program as pg
from piezoharvest.engine import tables as tb
from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.crossing import NONE
from piezoharvest.engine.tables import block_of
from piezoharvest.engine.vector import dot

CONSERVED = 1e-13  # part of a form's rate that rounding may leave of nothing


@compiled
def held_form(P, L, slot, configuration, out):
    """Leave at `out` the form that diodes conducting in a configuration hold at zero; returns whether there is one.

    It is what opened the diodes, if the mode conserves it: a bridge behind an inductance does not.
    """
    guard, a = _opened_by(L, configuration), L[pg.A]
    if guard == NONE:
        return False
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
    return P[out + L[pg.CHARGE]] != 0.0 and largest <= CONSERVED * terms


@compiled
def _opened_by(L, configuration):
    """Number of a guard that makes diodes conduct and leads to a configuration, or NONE."""
    for k in range(L[pg.C] * L[pg.G]):
        if L[L[pg.GUARD_TARGET] + k] == configuration and L[L[pg.GUARD_CODE] + k] == pg.CONDUCT:
            return k
    return NONE


@compiled
def hold(P, L, growth, form):
    """Take from the charge's row of a growth matrix what rounding made of a form that is conserved."""
    rows, charge = L[pg.ROWS], L[pg.CHARGE]
    for j in range(L[pg.A]):
        column = growth + j * rows
        P[column + charge] -= dot(P, form, P, column, rows) / P[form + charge]
