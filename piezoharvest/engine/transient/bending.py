"""Smooth elements that bend a motion: their outputs' derivatives along it.

Within a step of the run every output is a cubic of time (`propagation.smooth_elements`), and so is its derivative here:
with the derivatives of output and rate at both ends, which follow from those of the state (variational equation). Those
at the end are computed with straight outputs first, then with the cubics that follow.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory.algebra import back_substitute, eliminate, is_unit
from piezoharvest.engine.motion.curves import curve_of
from piezoharvest.engine.sensitivity.dual_modes import dual, nominal
from piezoharvest.engine.transient.mode_steps import ModeSteps
from piezoharvest.equations.terms import CURVE, PIECEWISE, PRODUCT, TIMED


class Bending(NamedTuple):
    """Elements of a mode's augmented state, and forms over it that their outputs depend on.

    e elements, m modes, a augmented states, p quantities.

    Attributes
    ----------
    place : int
        Of the first output in the augmented state.
    drift : float
        1/s.
    power : (e,) int array
    scale : (e, 4) array
        SI values of the units of output and derivatives.
    inputs, d_inputs : (e, 2, a) and (e, 2, a, p) arrays
    rates, d_rates : (m, e, 2, a) and (m, e, 2, a, p) arrays
        Rates of the inputs.
    corners, first_corner, pieces, d_pieces : (t,), (e + 1,), (t + e, 3) and (t + e, 3, p) arrays
        Of piecewise elements, as in `Program`.
    held : (e,) int array
        Places in `pieces` of those that are held over a step; -1 where those of the inputs count.
    begin_z, begin_d : (a,) and (n + 4 e, lanes) arrays
        Memory of a step's beginning.
    direction : (a,) array
    work, order : arrays
        Memory of linear equations: matrix (e, e), right side and solution (e, lanes); order of the unknowns.
    """

    place: int
    drift: float
    power: np.ndarray
    scale: np.ndarray
    inputs: np.ndarray
    d_inputs: np.ndarray
    rates: np.ndarray
    d_rates: np.ndarray
    corners: np.ndarray
    first_corner: np.ndarray
    pieces: np.ndarray
    d_pieces: np.ndarray
    held: np.ndarray
    begin_z: np.ndarray
    begin_d: np.ndarray
    direction: np.ndarray
    work: np.ndarray
    order: np.ndarray


def bending_of(batch: pg.Program, count: int, steps: ModeSteps, bent: bool, lanes: int) -> Bending:
    """Elements of a batch of complex steps, of which there are none unless they bend the motion."""
    program, n = nominal(batch), batch.rate.shape[-2]
    power = np.asarray(program.element_power, np.int64)[: None if bent else 0]
    scale = program.exo_scale[: pg.DERIVATIVES * len(power)].reshape(-1, pg.DERIVATIVES)
    both = dual(batch.element_z, 3)
    inputs, changes = both.value[: len(power)], both.change[:, : len(power)]
    changes = np.moveaxis(np.broadcast_to(changes, (count, *changes.shape[1:])), 0, -1)
    rates = np.ascontiguousarray(np.einsum("kia,mab->mkib", inputs, steps.rate))
    d_rates = np.einsum("kiap,mab->mkibp", changes, steps.rate) + np.einsum("kia,mabp->mkibp", inputs, steps.d_rate)
    d_rates = np.ascontiguousarray(d_rates)
    e, a = len(power), inputs.shape[-1]
    pieces = dual(batch.pieces, 2)
    d_pieces = np.moveaxis(np.broadcast_to(pieces.change, (count, *pieces.change.shape[1:])), 0, -1)
    return Bending(
        n, float(program.drift), power, np.ascontiguousarray(scale), np.ascontiguousarray(inputs),
        np.ascontiguousarray(changes), rates, d_rates, np.real(program.corners), program.first_corner,
        np.ascontiguousarray(pieces.value), np.ascontiguousarray(d_pieces), np.full(e, -1), begin_z=np.zeros(a),
        begin_d=np.zeros((n + pg.DERIVATIVES * e, lanes)), direction=np.zeros(a),
        work=np.zeros(e * (e + 2 * max(lanes, 1))), order=np.zeros(e, np.int64),
    )  # fmt: skip


@compiled
def value_of(row, z):
    """Value of a form."""
    total = 0.0
    for j in range(len(z)):
        total += row[j] * z[j]
    return total


@compiled
def add_form(factor, row, changes, z, d, out):
    """Add to `out` the derivatives of the value of a form with derivatives (a, p), times a factor."""
    for j in range(len(d)):
        f = factor * row[j]
        if f != 0.0:
            for s in range(len(out)):
                out[s] += f * d[j, s]
    for j in range(len(z)):
        g = factor * z[j]
        if g != 0.0:
            for p in range(changes.shape[1]):
                out[p] += g * changes[j, p]


@compiled
def piece_at(elements, k, first):
    """Place of the polynomial of the k-th element, a piecewise one, at an input."""
    at = elements.first_corner[k]
    while at < elements.first_corner[k + 1] and elements.corners[at] <= first:
        at += 1
    return at + k


@compiled
def _piece_of(bending, k, first):
    """Place of the polynomial of a piecewise element: that which is held over a step, or that of an input."""
    return bending.held[k] if bending.held[k] >= 0 else piece_at(bending, k, first)


@compiled
def hold_pieces(bending, mode, z, ahead):
    """Hold the pieces of piecewise elements that their inputs go through over the step that begins at a state.

    Those in which they are so many seconds ahead: a step may begin at a corner.
    """
    for k in range(len(bending.power)):
        if bending.power[k] == PIECEWISE:
            first = value_of(bending.inputs[k, 0], z) + ahead * value_of(bending.rates[mode, k, 0], z)
            bending.held[k] = piece_at(bending, k, first)


@compiled
def release_pieces(bending):
    """Let piecewise elements follow their inputs from piece to piece."""
    for k in range(len(bending.power)):
        bending.held[k] = -1


@compiled
def _slopes(bending, k, first, second, time):
    """Derivatives of an output by its two inputs, and the second ones: by the first twice, and by both."""
    power = bending.power[k]
    if power == PRODUCT:
        return second, first, 0.0, 1.0
    if power == TIMED:
        return time, 0.0, 0.0, 0.0
    if power == PIECEWISE:
        piece = bending.pieces[_piece_of(bending, k, first)]
        return piece[1] + 2.0 * first * piece[2], 0.0, 2.0 * piece[2], 0.0
    if power <= CURVE:
        _, slope, bend = curve_of(CURVE - power, first)
        return slope, 0.0, bend, 0.0
    return power * first ** (power - 1), 0.0, power * (power - 1) * first ** (power - 2), 0.0


@compiled
def _by_inputs(bending, k, z, time):
    """Derivatives of an element's output, as `_slopes`, at a state."""
    first, second = value_of(bending.inputs[k, 0], z), value_of(bending.inputs[k, 1], z)
    return _slopes(bending, k, first, second, bending.drift * time)


@compiled
def _set_mutual(bending, forms, shift, z, time):
    """Set the matrix (e, e) of the equations of the outputs' derivatives, or with shift 1 of those of their rates.

    It is the unit matrix less the outputs' influence on each other by way of `forms` (e, 2, a) of their inputs.
    """
    count = len(bending.power)
    for k in range(count):
        by_first, by_second, _, _ = _by_inputs(bending, k, z, time)
        for m in range(count):
            place = bending.place + 4 * m + shift
            total = by_first * forms[k, 0, place] + by_second * forms[k, 1, place]
            bending.work[k * count + m] = (1.0 if k == m else 0.0) - total / bending.scale[k, shift]


@compiled
def _solve(bending, columns):
    """Solve the equations in the memory for so many columns; return the place of the solution."""
    count, work, order = len(bending.power), bending.work, bending.order
    right = count * count
    if is_unit(work, 0, count):
        return right
    out = right + count * columns
    for k in range(count * columns):
        work[out + k] = 0.0
    rank = eliminate(work, order, 0, right, count, columns, 0)
    back_substitute(work, order, 0, right, count, columns, 0, rank, out)
    return out


@compiled
def _set_rows(bending, shift, d):
    """Solve for the derivatives of outputs, or with shift 1 of their rates, and set them."""
    lanes = d.shape[1]
    out = _solve(bending, lanes)
    for k in range(len(bending.power)):
        for s in range(lanes):
            d[bending.place + 4 * k + shift, s] = bending.work[out + k * lanes + s]


@compiled
def set_changes(bending, mode, time, z, d):
    """Set the derivatives of all outputs and of their rates so that they agree with those of the states."""
    count, lanes = len(bending.power), d.shape[1]
    for row in range(bending.place, bending.place + 4 * count):
        for s in range(lanes):
            d[row, s] = 0.0
    right = bending.work[count * count : count * (count + lanes)]
    right[:] = 0.0
    for k in range(count):
        _add_value(bending, k, time, z, d, right[k * lanes : (k + 1) * lanes])
    _set_mutual(bending, bending.inputs, 0, z, time)
    _set_rows(bending, 0, d)
    right[:] = 0.0
    for k in range(count):
        _add_rate(bending, mode, k, time, z, d, right[k * lanes : (k + 1) * lanes])
    _set_mutual(bending, bending.rates[mode], 1, z, time)
    _set_rows(bending, 1, d)


@compiled
def _add_value(bending, k, time, z, d, out):
    """Add the derivatives of an output, but for what other outputs do to it."""
    inputs, changes, unit = bending.inputs[k], bending.d_inputs[k], 1.0 / bending.scale[k, 0]
    by_first, by_second, _, _ = _by_inputs(bending, k, z, time)
    add_form(unit * by_first, inputs[0], changes[0], z, d, out)
    if by_second != 0.0:
        add_form(unit * by_second, inputs[1], changes[1], z, d, out)
    if bending.power[k] == PIECEWISE:
        first = value_of(inputs[0], z)
        change = bending.d_pieces[_piece_of(bending, k, first)]
        for p in range(change.shape[1]):
            out[p] += unit * (change[0, p] + first * (change[1, p] + first * change[2, p]))


@compiled
def _add_rate(bending, mode, k, time, z, d, out):
    """Add the derivatives of an output's rate, but for what other outputs' rates do to it."""
    inputs, rates, unit = bending.inputs[k], bending.rates[mode, k], 1.0 / bending.scale[k, 1]
    by_first, by_second, twice, both = _by_inputs(bending, k, z, time)
    first_rate, second_rate = value_of(rates[0], z), value_of(rates[1], z)
    add_form(unit * by_first, rates[0], bending.d_rates[mode, k, 0], z, d, out)
    by_value = twice * first_rate + both * second_rate
    if bending.power[k] == TIMED:
        by_value += bending.drift
    if bending.power[k] == PIECEWISE:
        first = value_of(inputs[0], z)
        change = bending.d_pieces[_piece_of(bending, k, first)]
        for p in range(change.shape[1]):
            out[p] += unit * first_rate * (change[1, p] + 2.0 * first * change[2, p])
    add_form(unit * by_value, inputs[0], bending.d_inputs[k, 0], z, d, out)
    if by_second != 0.0 or both != 0.0:
        add_form(unit * by_second, rates[1], bending.d_rates[mode, k, 1], z, d, out)
        add_form(unit * both * first_rate, inputs[1], bending.d_inputs[k, 1], z, d, out)


@compiled
def set_cubic_changes(bending, begin, end, length):
    """Set the second and third derivatives at the beginning of a step so that outputs and rates are those at its end.

    `begin` and `end` are derivatives (n + 4 e, lanes) of a state and its elements.
    """
    for k in range(len(bending.power)):
        place, scale = bending.place + 4 * k, bending.scale[k]
        for s in range(begin.shape[1]):
            slope, final = scale[1] * begin[place + 1, s], scale[1] * end[place + 1, s]
            rise = scale[0] * (end[place, s] - begin[place, s]) - slope * length
            turn = (final - slope) * length
            begin[place + 2, s] = (6.0 * rise - 2.0 * turn) / length**2 / scale[2]
            begin[place + 3, s] = (6.0 * turn - 12.0 * rise) / length**3 / scale[3]


@compiled
def slope_along(bending, row, direction, passes, z, time):
    """Derivative of a form as the states move in a direction (a,) and time passes, the elements' outputs with them.

    `passes` is 1.0, or 0.0 where time stands still.
    """
    count = len(bending.power)
    right = count * count
    for k in range(count):
        by_first, by_second, _, _ = _by_inputs(bending, k, z, time)
        moved = by_first * value_of(bending.inputs[k, 0], direction)
        moved += by_second * value_of(bending.inputs[k, 1], direction)
        if bending.power[k] == TIMED:
            moved += passes * bending.drift * value_of(bending.inputs[k, 0], z)
        bending.work[right + k] = moved / bending.scale[k, 0]
    _set_mutual(bending, bending.inputs, 0, z, time)
    out, slope = _solve(bending, 1), value_of(row, direction)
    for k in range(count):
        slope += row[bending.place + 4 * k] * bending.work[out + k]
    return slope
