"""Instantaneous extraction of the charge on the electrodes, until their voltage is zero."""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import state as st
from piezoharvest.engine.memory.program import NONE
from piezoharvest.engine.memory.state import dot_column
from piezoharvest.engine.memory.vector import copy
from piezoharvest.engine.motion.charge_transfer import charge_slope, follows_charge, move_charge
from piezoharvest.engine.motion.element_outputs import (
    MATRIX,
    START,
    element_of,
    equations,
    input_of,
    output_of,
    outputs,
    outputs_at,
    release,
    scale_of,
    scratch,
    slope_of,
    solve,
)
from piezoharvest.engine.motion.energy_forms import NODES, WEIGHTS


@compiled
def extract_charge(P, L, S, D):
    """Take the electrode voltage to zero by moving charge, and the stops with it, from saturation to saturation."""
    delivered, charge, row, slip = 0.0, 0.0, L[pg.VOLTAGE_ROW], D[st.SLIP]
    for _ in range(2 * L[pg.H] + 2):
        voltage = dot_column(P, row, 1, S, 0, L[pg.A])
        if voltage == 0.0:
            break
        sign = -1 if voltage > 0.0 else 1
        _stick_reversed(P, L, D, sign)
        slope = charge_slope(P, L, D, row)
        reach, first = _next_saturation(P, L, S, D, sign)
        if L[pg.ELEMENTS]:
            move, first = _extract_nonlinear(P, L, S, D, row, slope, reach, first)
            delivered -= P[L[pg.SCALE] + L[pg.CHARGE]] * _extraction_work(P, L, S, D, row, slope, move)
        else:
            move = -voltage / slope
            if abs(reach) < abs(move):
                move = reach
            else:
                first = NONE
            move_charge(P, L, S, D, 0, move)
            delivered -= P[L[pg.SCALE] + L[pg.CHARGE]] * move * (voltage + 0.5 * slope * move)
        charge += P[L[pg.SCALE] + L[pg.CHARGE]] * abs(move)
        _update_sensitivities(P, L, S, D, row, slope, first)
        if D[st.ENERGIES]:
            for j in range(L[pg.H]):
                if D[slip + j] != 0:
                    S[D[st.ENERGY] + pg.HYSTERESIS] += P[L[pg.STOP_WEIGHT] + j] * P[L[pg.STOP_LIMIT] + j] * abs(move)
        if first == NONE:
            break
        D[slip + first] = sign
        S[L[L[pg.STOP_STATE] + first]] = sign * P[L[pg.STOP_LIMIT] + first]
    if D[st.ENERGIES]:
        harvested = P[L[pg.EFFICIENCY]] * max(delivered - P[L[pg.DROP]] * charge, 0.0)
        S[D[st.ENERGY] + pg.HARVESTED] += harvested
        S[D[st.ENERGY] + pg.SHUNT_LOSS] += delivered - harvested


@compiled
def _stick_reversed(P, L, D, sign):
    """Let stops that slipped in the other direction stick, as they do when the charge reverses."""
    for j in range(L[pg.H]):
        if follows_charge(P, L, j) and D[D[st.SLIP] + j] == -sign:
            D[D[st.SLIP] + j] = 0


@compiled
def _next_saturation(P, L, S, D, sign):
    """Charge that may move until the next stop slips, and the number of that stop."""
    nearest, first = np.inf, NONE
    for j in range(L[pg.H]):
        if D[D[st.SLIP] + j] == 0 and follows_charge(P, L, j):
            reach = sign * P[L[pg.STOP_LIMIT] + j] - S[L[L[pg.STOP_STATE] + j]]
            if abs(reach) < abs(nearest):
                nearest, first = reach, j
    return nearest, first


@compiled
def _update_sensitivities(P, L, S, D, row, slope, first):
    """Update the sensitivities for the moved charge: until the next stop slips, or with the voltage kept at zero."""
    for s in range(D[st.SENSITIVITIES]):
        phi = D[st.PHI] + s * L[pg.ROWS]
        if first != NONE:
            move = -S[phi + L[L[pg.STOP_STATE] + first]]
        elif L[pg.ELEMENTS]:
            move = _charge_response(P, L, S, D, row, slope, phi)
        else:
            move = -dot_column(P, row, 1, S, phi, L[pg.A]) / slope
        move_charge(P, L, S, D, phi, move)


# With smooth elements the voltage is not linear in the charge. For given outputs it is, so these are the unknowns that
# are solved for, and the charge follows.


@compiled
def _extract_nonlinear(P, L, S, D, row, slope, reach, first):
    """Move the charge until the voltage is zero or the next stop slips; return the charge, and True if a stop slips.

    The initial state is left at START.
    """
    rows, start, now = L[pg.ROWS], scratch(L, D, START), S[D[st.CLOCK]]
    copy(S, 0, start, rows)
    release(L, D)
    outputs_at(P, L, S, D, 0, now, row, slope)
    move = S[L[pg.CHARGE]] - S[start + L[pg.CHARGE]]
    if not abs(reach) < abs(move):
        return move, NONE
    copy(S, start, 0, rows)
    move_charge(P, L, S, D, 0, reach)
    outputs(P, L, S, D, 0, now)
    return reach, first


@compiled
def zero_voltage(P, L, S, D):
    """Move the charge so that the electrode voltage is zero, with its sensitivities, without recording energies."""
    row = L[pg.VOLTAGE_ROW]
    slope = charge_slope(P, L, D, row)
    _extract_nonlinear(P, L, S, D, row, slope, np.inf, NONE)
    _update_sensitivities(P, L, S, D, row, slope, NONE)


@compiled
def _charge_response(P, L, S, D, row, slope, phi):
    """Change of charge that keeps the voltage at zero when the states change by phi."""
    count, now = L[pg.ELEMENTS], S[D[st.CLOCK]]
    right = scratch(L, D, MATRIX) + count * count
    voltage = dot_column(P, row, 1, S, phi, L[pg.N])
    for k in range(count):
        first, second, total = input_of(P, L, S, 0, k, 0), input_of(P, L, S, 0, k, 1), 0.0
        for which in range(2):
            form = L[pg.ELEMENT_Z] + (2 * k + which) * L[pg.A]
            change = dot_column(P, form, 1, S, phi, L[pg.N]) - charge_slope(P, L, D, form) * voltage / slope
            total += slope_of(P, L, D, k, first, second, now, which) * change
        S[right + k] = total / scale_of(P, L, element_of(L, k))
    equations(P, L, S, D, 0, now, row, slope)
    solve(L, S, D)
    for k in range(count):
        S[phi + element_of(L, k)] = S[right + k]
        voltage += P[row + element_of(L, k)] * S[right + k]
    return -voltage / slope


@compiled
def _extraction_work(P, L, S, D, row, slope, move):
    """Integral of the voltage over the charge from START to the present state; the energies of elements are recorded.

    The inputs of the elements go linearly from their initial to their present values, so that all quantities are
    polynomials along the path; the charge follows from one of the inputs.
    """
    start, count, now = scratch(L, D, START), L[pg.ELEMENTS], S[D[st.CLOCK]]
    more = scratch(L, D, MATRIX) + count * count
    rates = more + count
    lead = NONE
    for e in range(2 * count):
        if charge_slope(P, L, D, L[pg.ELEMENT_Z] + e * L[pg.A]) != 0.0:
            lead = L[pg.ELEMENT_Z] + e * L[pg.A]
    voltage, work = dot_column(P, row, 1, S, start, L[pg.A]), 0.0
    for q in range(len(NODES)):
        charge, rate, here = NODES[q] * move, move, voltage
        for k in range(count):
            first, second = input_of(P, L, S, start, k, 0), input_of(P, L, S, start, k, 1)
            to_first, to_second = input_of(P, L, S, 0, k, 0) - first, input_of(P, L, S, 0, k, 1) - second
            first, second = first + NODES[q] * to_first, second + NODES[q] * to_second
            place = element_of(L, k)
            S[more + k] = output_of(P, L, D, k, first, second, now) / scale_of(P, L, place) - S[start + place]
            slopes = slope_of(P, L, D, k, first, second, now, 0) * to_first
            slopes += slope_of(P, L, D, k, first, second, now, 1) * to_second
            S[rates + k] = slopes / scale_of(P, L, place)
            here += P[row + place] * S[more + k]
        if lead != NONE:
            rate = dot_column(P, lead, 1, S, 0, L[pg.A]) - dot_column(P, lead, 1, S, start, L[pg.A])
            charge = NODES[q] * rate
            for k in range(count):
                charge -= P[lead + element_of(L, k)] * S[more + k]
                rate -= P[lead + element_of(L, k)] * S[rates + k]
            charge, rate = charge / charge_slope(P, L, D, lead), rate / charge_slope(P, L, D, lead)
        work += WEIGHTS[q] * (here + slope * charge) * rate
        if D[st.ENERGIES]:
            _add_element_energies(P, L, S, D, charge, WEIGHTS[q])
    return work


@compiled
def _add_element_energies(P, L, S, D, charge, weight):
    """Add the energy taken by charge of smooth elements at a point of the path, where their outputs change with it."""
    count, start = L[pg.ELEMENTS], scratch(L, D, START)
    more = scratch(L, D, MATRIX) + count * count
    for p in range(L[pg.PRODUCTS]):
        k = D[st.CONFIGURATION] * L[pg.PRODUCTS] + p
        first, second, rate = L[pg.PRODUCT_Z] + 2 * k * L[pg.A], L[pg.PRODUCT_Z] + (2 * k + 1) * L[pg.A], 0.0
        for m in range(count):
            place = element_of(L, m)
            rate += P[second + place + 1] * S[more + count + m] * scale_of(P, L, place) / scale_of(P, L, place + 1)
        if rate != 0.0 and L[L[pg.PRODUCT_CATEGORY] + k] >= 0:
            value = dot_column(P, first, 1, S, start, L[pg.A]) + charge * charge_slope(P, L, D, first)
            for m in range(count):
                value += P[first + element_of(L, m)] * S[more + m]
            S[D[st.ENERGY] + L[L[pg.PRODUCT_CATEGORY] + k]] += weight * P[L[pg.PRODUCT_COEFFICIENT] + k] * value * rate
