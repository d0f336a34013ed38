"""Charge that is moved on the electrodes at once: the stops that follow it and stick go with it."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st


@inlined
def of_charge(P, L, j):
    """Whether a stop follows the charge; one that follows a displacement stays where it is when charge is moved."""
    return P[L[pg.STOP_INPUT] + j * L[pg.N] + L[pg.CHARGE]] != 0.0


@compiled
def along(P, L, D, form):
    """What a unit of charge adds to a linear form."""
    total = P[form + L[pg.CHARGE]]
    for j in range(L[pg.H]):
        if D[D[st.SLIP] + j] == 0 and of_charge(P, L, j):
            total += P[form + L[L[pg.STOP_STATE] + j]]
    return total


@compiled
def shift(P, L, S, D, z, move):
    """Move the charge of a state, or of a sensitivity."""
    S[z + L[pg.CHARGE]] += move
    for j in range(L[pg.H]):
        if D[D[st.SLIP] + j] == 0 and of_charge(P, L, j):
            S[z + L[L[pg.STOP_STATE] + j]] += move
