"""Energies of smooth motion by Gauss-Legendre quadrature of the powers."""

from __future__ import annotations

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import vector
from piezoharvest.engine.memory.tables import block_of, slot_of
from piezoharvest.engine.memory.vector import add_products, multiply, polynomial
from piezoharvest.engine.motion.energy_forms import NODES, WEIGHTS
from piezoharvest.engine.motion.exact_step import SAMPLE, SERIES, TRIAL, propagate_exactly
from piezoharvest.engine.work_limit import spend_products

# Evaluations over the steps of a level after which its factors at the nodes are tabulated: that takes the time of
# about as many.
OFTEN = 8


@compiled
def energies_by_quadrature(P, L, S, D, slot, level):
    """Compute at QUADRATURE the energies over a step of a level, accurate for smooth motion."""
    height, tau = L[tb.FACTOR_ROWS], P[block_of(L, slot) + L[tb.STEPS] + level]
    tabulated = _tabulated_factors(P, L, S, D, slot, level)
    if tabulated != NONE:
        spend_products(L, len(NODES))
        multiply(P, tabulated, tb.NODE_COUNT * height, L[pg.COLUMNS], S, 0, D[st.FACTORS])
    else:
        spend_products(L, len(NODES) * (L[pg.PRODUCTS] + L[pg.H]))
        for q in range(len(NODES)):
            propagate_exactly(P, L, S, D, slot, 0, NODES[q] * tau, vector(L, D, SAMPLE))
            _factors(P, L, S, D, slot, vector(L, D, SAMPLE), q)
    for e in range(D[st.ENERGIES]):
        S[D[st.QUADRATURE] + e] = 0.0
    _add_energies(P, L, S, D, tau, D[st.QUADRATURE])


@compiled
def add_energies_of_series(P, L, S, D, slot, share):
    """Add energies of a share of a finest step, along its Taylor series at SERIES."""
    block, z, rows = block_of(L, slot), vector(L, D, SAMPLE), L[pg.ROWS]
    for q in range(len(NODES)):
        polynomial(S, vector(L, D, SERIES), rows, tb.TERMS, NODES[q] * share, z)
        _factors(P, L, S, D, slot, z, q)
    finest = L[slot_of(L, slot) + tb.FINEST_LEVEL]
    _add_energies(P, L, S, D, share * P[block + L[tb.STEPS] + finest], D[st.ENERGY])


@inlined
def _factors(P, L, S, D, slot, z, node):
    """Factors of all powers at a state, the motion's at a node."""
    height = L[tb.FACTOR_ROWS]
    multiply(P, block_of(L, slot) + L[tb.FACTOR_COLUMNS], height, L[pg.COLUMNS], S, z, D[st.FACTORS] + node * height)


@compiled
def _add_energies(P, L, S, D, tau, energies):
    """Add to the energies those over tau, from the factors at all nodes."""
    height, own, configuration = L[tb.FACTOR_ROWS], L[pg.PRODUCTS], D[st.CONFIGURATION]
    half, means = height // 2, D[st.FACTORS] + len(NODES) * height
    for p in range(half):
        S[means + p] = 0.0
    for q in range(len(NODES)):
        first = D[st.FACTORS] + q * height
        add_products(S, first, first + half, WEIGHTS[q], means, half)
    for p in range(own):
        category = L[L[pg.PRODUCT_CATEGORY] + configuration * own + p]
        if category >= 0:
            coefficient = P[L[pg.PRODUCT_COEFFICIENT] + configuration * own + p]
            S[energies + category] += tau * coefficient * S[means + p]
    for p in range(own, own + L[pg.H]):
        S[energies + pg.HYSTERESIS] += tau * S[means + p]


@compiled
def _tabulated_factors(P, L, S, D, slot, level):
    """Place of the factors of all powers at the nodes of a level's step, as forms of the state at its beginning.

    They are tabulated when the level has been asked for often, while there is room; NONE before.
    """
    use, sets = slot_of(L, slot) + tb.NODE_USES + level, slot_of(L, slot) + tb.NODE_SETS
    size = tb.NODE_COUNT * L[tb.FACTOR_ROWS] * L[pg.COLUMNS]
    tables = block_of(L, slot) + L[tb.NODE_FACTORS]
    if L[use] < 0:
        return tables - (L[use] + 1) * size
    L[use] += 1
    if L[use] <= OFTEN or L[sets] == tb.MAX_NODE_SETS:
        return NONE
    here = tables + L[sets] * size
    L[sets] += 1
    L[use] = -L[sets]
    _tabulate(P, L, S, D, slot, P[block_of(L, slot) + L[tb.STEPS] + level], here)
    return here


@compiled
def _tabulate(P, L, S, D, slot, tau, out):
    """Tabulate the factors at the nodes of a step, from the motions that begin at the unit vectors."""
    height, unit, z = L[tb.FACTOR_ROWS], vector(L, D, TRIAL), vector(L, D, SAMPLE)
    spend_products(L, 4 * len(NODES) * L[pg.COLUMNS])
    for i in range(L[pg.ROWS]):
        S[unit + i] = 0.0
    for j in range(L[pg.A]):
        S[unit + j] = 1.0
        for q in range(len(NODES)):
            propagate_exactly(P, L, S, D, slot, unit, NODES[q] * tau, z)
            _factors(P, L, S, D, slot, z, q)
        for i in range(tb.NODE_COUNT * height):
            P[out + j * tb.NODE_COUNT * height + i] = S[D[st.FACTORS] + i]
        S[unit + j] = 0.0
    for k in range(L[pg.A] * tb.NODE_COUNT * height, L[pg.COLUMNS] * tb.NODE_COUNT * height):
        P[out + k] = 0.0
