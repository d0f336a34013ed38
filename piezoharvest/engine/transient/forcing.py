"""Smooth elements that force the derivatives of a motion without having an influence on it.

An effect at its null value, such as a spring that stiffens, leaves the motion between events linear; but the derivative
by its strength is forced by the outputs of its elements along that motion. Within a step every output is a cubic with
the values and slopes of both ends, as in `propagation.smooth_elements`. Where it misses the output in the middle the
step is halved.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.motion.curves import curve_of
from piezoharvest.engine.sensitivity.dual_modes import nominal
from piezoharvest.engine.transient.bending import piece_at, value_of
from piezoharvest.equations.terms import CURVE, PIECEWISE, PRODUCT, TIMED

# Of an element's largest output: error of a cubic in the middle of a step. A derivative then has this error at most,
# where differences of runs with elements have 3e-5.
TOLERANCE = 1e-6
# Halvings of a sample at most: a transient that is over sooner, in leads of little resistance, forces nothing.
MAX_HALVINGS = 8
FORMS = ("rate", "guard_z", "output_z", "voltage_row", "trigger_row")  # over the augmented state, whose motion they are


class Forcing(NamedTuple):
    """Elements of a mode's augmented state; inputs and outputs of the nominal motion.

    Attributes
    ----------
    place : int
        Of the first output in the augmented state.
    drift : float
        1/s.
    power : (e,) int array
    inputs : (e, 2, a) array
    scale : (e, 4) array
        SI values of the units of output and derivatives.
    corners, first_corner, pieces : (t,), (e + 1,) and (t + e, 3) arrays
        Of piecewise elements, as in `Program`.
    largest, middle : (e,) array
        Largest outputs so far, SI; those in the middle of a step.
    """

    place: int
    drift: float
    power: np.ndarray
    inputs: np.ndarray
    scale: np.ndarray
    corners: np.ndarray
    first_corner: np.ndarray
    pieces: np.ndarray
    largest: np.ndarray
    middle: np.ndarray


def moving(batch: pg.Program) -> pg.Program:
    """Nominal design of a batch of complex steps, without its smooth elements where nothing depends on them."""
    program, n = nominal(batch), batch.rate.shape[-2]
    elements = slice(n, n + pg.DERIVATIVES * len(program.element_power))
    if any(np.any(getattr(program, name)[..., elements]) for name in FORMS):
        return program
    changes = {name: _without(getattr(program, name), elements) for name in (*FORMS, "product_z", "element_z")}
    own = slice(0, elements.stop - n)
    exosystem = np.delete(_without(program.exosystem, own), own, axis=-2)
    return program._replace(
        **{**changes, "element_z": changes["element_z"][:0]}, exosystem=np.ascontiguousarray(exosystem),
        exo_scale=_without(program.exo_scale, own), element_power=np.zeros(0, np.int64),
        element_parity=np.zeros(0, np.int64), first_corner=np.zeros(1, np.int64), corners=np.zeros(0),
        pieces=np.zeros((0, 3)),
        storage=np.ascontiguousarray(program.storage[..., :n, :n]),
    )  # fmt: skip


def _without(array: np.ndarray, columns: slice) -> np.ndarray:
    return np.ascontiguousarray(np.delete(array, columns, axis=-1))


def forcing_of(batch: pg.Program, starts: np.ndarray, bent: bool) -> Forcing:
    """Elements of a batch of complex steps, whose sizes are at least those at some states (k, a).

    There are none where they bend the motion.
    """
    program, n = nominal(batch), batch.rate.shape[-2]
    count = 0 if bent else len(program.element_power)
    scale = program.exo_scale[: pg.DERIVATIVES * count].reshape(count, pg.DERIVATIVES)
    found = Forcing(
        n, float(program.drift), np.asarray(program.element_power[:count], np.int64), program.element_z[:count], scale,
        program.corners, program.first_corner, program.pieces, np.zeros(count), np.zeros(count),
    )  # fmt: skip
    firsts, seconds = np.moveaxis(found.inputs @ starts.T, 1, 0)
    for k, (power, first, second) in enumerate(zip(found.power, firsts, seconds, strict=True)):
        # Time is not known here; it is a share of the record.
        sizes = np.abs(first * second if power == PRODUCT else first ** max(power, 1))
        found.largest[k] = np.max(sizes, initial=0.0)
    return found


@compiled
def _rate_of(row, A, z):
    """Rate of a form."""
    total = 0.0
    for j in range(len(z)):
        if row[j] != 0.0:
            total += row[j] * value_of(A[j], z)
    return total


@compiled
def set_outputs(forcing, A, z, time):
    """Set the outputs of all elements at a state, and their rates; an input may be the output of an earlier element."""
    for k in range(len(forcing.power)):
        power, into, place = forcing.power[k], forcing.inputs[k], forcing.place + 4 * k
        first, rate = value_of(into[0], z), _rate_of(into[0], A, z)
        if power == PRODUCT:
            second, other = value_of(into[1], z), _rate_of(into[1], A, z)
            value, slope = first * second, rate * second + first * other
        elif power == TIMED:
            value, slope = forcing.drift * time * first, forcing.drift * (first + time * rate)
        elif power == PIECEWISE:
            piece = forcing.pieces[piece_at(forcing, k, first)]
            value = piece[0] + first * (piece[1] + first * piece[2])
            slope = (piece[1] + 2.0 * first * piece[2]) * rate
        elif power <= CURVE:
            value, by_first, _ = curve_of(CURVE - power, first)
            slope = by_first * rate
        else:
            slope = first ** (power - 1)
            value, slope = slope * first, power * slope * rate
        z[place], z[place + 1] = value / forcing.scale[k, 0], slope / forcing.scale[k, 1]


@compiled
def set_straight(forcing, z):
    """Let the outputs go on with their present slopes."""
    for k in range(len(forcing.power)):
        z[forcing.place + 4 * k + 2] = z[forcing.place + 4 * k + 3] = 0.0


@compiled
def _propagate(growth, z, out):
    """State after a step."""
    for i in range(len(z)):
        out[i] = z[i] + value_of(growth[i], z)


@compiled
def set_cubics(forcing, steps, mode, level, length, time, z, other):
    """Set the cubics over a step from a state with outputs; False where they miss an output in the middle.

    `other` is memory of the shape of z. A step of the shortest length is not judged.
    """
    A, last = steps.rate[mode], level + 1 >= min(steps.levels[mode], MAX_HALVINGS)
    if not last:
        _propagate(steps.growth[mode, level + 1], z, other)
        set_outputs(forcing, A, other, time + 0.5 * length)
        for k in range(len(forcing.power)):
            forcing.middle[k] = forcing.scale[k, 0] * other[forcing.place + 4 * k]
    _propagate(steps.growth[mode, level], z, other)
    set_outputs(forcing, A, other, time + length)
    close = True
    for k in range(len(forcing.power)):
        place, scale = forcing.place + 4 * k, forcing.scale[k]
        begin, end = scale[0] * z[place], scale[0] * other[place]
        slope, final = scale[1] * z[place + 1], scale[1] * other[place + 1]
        rise, turn = end - begin - slope * length, (final - slope) * length
        z[place + 2] = (6.0 * rise - 2.0 * turn) / length**2 / scale[2]
        z[place + 3] = (6.0 * turn - 12.0 * rise) / length**3 / scale[3]
        forcing.largest[k] = max(forcing.largest[k], max(abs(begin), abs(end)))
        if not last:
            cubic = 0.5 * (begin + end) + 0.125 * (slope - final) * length
            close &= abs(forcing.middle[k] - cubic) <= TOLERANCE * forcing.largest[k]
    return close
