"""Instantaneous transfer of charge on the electrodes, with the sticking stops whose input is the charge."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st


@inlined
def follows_charge(P, L, j):
    """True if a stop's input is the charge; a stop of a displacement does not change when charge is moved."""
    return P[L[pg.STOP_INPUT] + j * L[pg.N] + L[pg.CHARGE]] != 0.0


@compiled
def charge_slope(P, L, D, form):
    """Derivative of a linear form with respect to the charge."""
    total = P[form + L[pg.CHARGE]]
    for j in range(L[pg.H]):
        if D[D[st.SLIP] + j] == 0 and follows_charge(P, L, j):
            total += P[form + L[L[pg.STOP_STATE] + j]]
    return total


@compiled
def move_charge(P, L, S, D, z, move):
    """Move the charge of a state, or of a sensitivity."""
    S[z + L[pg.CHARGE]] += move
    for j in range(L[pg.H]):
        if D[D[st.SLIP] + j] == 0 and follows_charge(P, L, j):
            S[z + L[L[pg.STOP_STATE] + j]] += move
