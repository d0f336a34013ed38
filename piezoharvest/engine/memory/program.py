"""Lowered system as the compiled engine uses it, and the places of its arrays in flat memory.

Everything is in energy-scaled coordinates (1/2 z^2 is an energy for every state that stores one), so that the matrices
of nF and uF, of Hz and kHz, have entries of the size of the system's frequencies, and one tolerance holds for all. The
augmented state is [states | exogenous states]: those of the smooth elements, those of the signal, and last the constant
1, if anything is constant.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from piezoharvest.description.circuit import EVENTS
from piezoharvest.engine.memory.vector import COLUMNS as COLUMNS_AT_ONCE
from piezoharvest.engine.memory.vector import padded

TONES, RAMPS = 0, 1
CLOCKED = 3  # kind of a switch that is a clock
NONE = -1  # number of a guard, a configuration or a table that does not exist

# The output of a smooth element is a cubic of time: so many exogenous states, its value and three derivatives.
DERIVATIVES = 4

# Codes of events, in the order of their names in results.
(
    CLOSE, OPEN, CONDUCT, BLOCK, EXTRACT, SLIP, STICK, STEP_ON, TICK, TURN_ON, TURN_OFF, FILL, SENT, POWERED, UNPOWERED,
) = range(15)  # fmt: skip
EVENT_NAMES = (
    "switch closes",
    "switch opens",
    "diodes conduct",
    "diodes block",
    "voltage extracted",
    "hysteresis slips",
    "hysteresis sticks",
    "switch steps on",
    "controller acts",
    *EVENTS,
)

# Output rows of every configuration.
OUTPUTS = (
    "drive", "displacement", "velocity", "voltage", "current", "charge", "hysteresis_voltage", "dc_voltage",
    "acceleration",
)  # fmt: skip
DISPLACEMENT, VOLTAGE = 1, 3
WATCHED = 2  # outputs whose extremes are recorded: their rates stand behind the guards, so that steps resolve them too

# Categories of energy; the effects' own losses follow.
CATEGORIES = ("mechanical_in", "damping", "hysteresis", "harvested", "shunt_loss", "source")
MEAN_DC = "mean_dc"  # not an energy: time integral of the dc voltage, for its mean
MECHANICAL_IN, DAMPING, HYSTERESIS, HARVESTED, SHUNT_LOSS, SOURCE = range(6)


class Program(NamedTuple):
    """One design.

    n states, w exogenous states, a = n + w, c configurations, h stops, g guards, p products, k tones, e elements,
    m assignments. A linear form has a part over the augmented state (`*_z`, length a) and one over the derivative
    (`*_d`, length n). A batch has the designs as the leading axis of those arrays of numbers that differ.
    """

    rate: np.ndarray  # (c, n, a): z' = rate [z | exogenous] with every stop slipping
    stop_response: np.ndarray  # (c, n, h): z' that a rate of each stop alone brings about
    exosystem: np.ndarray  # (w, w)
    omega: np.ndarray  # (k,) rad/s
    phase: np.ndarray  # (k,)
    exo_scale: np.ndarray  # (w,) physical = scale * scaled
    scale: np.ndarray  # (n,)
    storage: np.ndarray  # (m, m) stored energy z' storage z / 2 of states and elements, m = n + 4 e
    stop_input: np.ndarray  # (h, n) derivative of the stop's input as a form over z'
    stop_limit: np.ndarray  # (h,)
    stop_weight: np.ndarray  # (h,) scaled so that weight * s * input' is a power
    voltage_row: np.ndarray  # (a,) v_p
    guard_z: np.ndarray  # (c, g, a)
    guard_d: np.ndarray  # (c, g, n)
    trigger_row: np.ndarray  # (a,) sum T_i u_i
    product_coefficient: np.ndarray  # (c, p)
    product_z: np.ndarray  # (c, p, 2, a)
    product_d: np.ndarray  # (c, p, 2, n)
    output_z: np.ndarray  # (c, outputs, a)
    output_d: np.ndarray  # (c, outputs, n)
    equilibrium: np.ndarray  # (n,) under the static part of the excitation, electrodes relaxed
    element_z: np.ndarray  # (e, 2, a) inputs of the smooth elements
    corners: np.ndarray  # (t,) of all piecewise elements, one after the other
    pieces: np.ndarray  # (t + e, 3) a, b, c of every piece a + b x + c x^2: one more than corners of each element
    lag: float
    on_time: float
    stage: np.ndarray  # (c,) share of it for which the switch holds a configuration
    recovered: np.ndarray  # (n,) share of the energy of a state that is cut, which is harvested
    hold_off: float
    efficiency: float
    drop: float  # V, in the path of the charge that is taken at once
    threshold: float  # V, of the electrodes at an extremum: below it the switch does not act
    gate_energy: float  # J, of each action of the switch
    early: float  # 1 if the lag is counted from the previous extremum
    step: float  # largest step, s
    assigned_row: np.ndarray  # (m, a) value of each assignment, over the augmented state
    assigned_step: np.ndarray  # (m,) multiples of which it is rounded to, 0 for none
    assigned_limit: np.ndarray  # (m,)
    drift: float  # 1/s: time as share of a record is drift * t
    period: float  # of the excitation, s; infinite if it has none

    signal_kind: int  # TONES or RAMPS
    charge: int  # index of q
    switched: int  # 0 none, 1 closes and opens, 2 extracts at once, or CLOCKED
    shorted: int  # 1 if the electrodes are always at zero voltage
    categories: int
    odd: np.ndarray  # (n,) sign that mirroring gives each state
    stop_state: np.ndarray  # (h,)
    guard_target: np.ndarray  # (c, g), -1 where there is none
    guard_cut: np.ndarray  # (c, g), state set to zero, or -1
    guard_code: np.ndarray  # (c, g)
    closed: np.ndarray  # (2, c): after closing at a minimum, at a maximum
    opened: np.ndarray  # (c,)
    cut: np.ndarray  # (n,) 1 for states set to zero when the switch opens or steps on
    mirror: np.ndarray  # (c,)
    product_category: np.ndarray  # (c, p), -1 where there is none
    element_power: np.ndarray  # (e,) as in `terms.SmoothElement`
    element_parity: np.ndarray  # (e,) likewise
    first_corner: np.ndarray  # (e + 1,) of each element; the next one's is its end
    assigned_state: np.ndarray  # (m,)
    assigned_first: np.ndarray  # (c + 1,) first assignment at the end of a configuration; the next one's is the end


# The table of contents `L`: first the sizes,
(A, N, C, H, G, PRODUCTS, TONE_COUNT, ROWS, COLUMNS, LENGTH, ELEMENTS, SIGNAL) = range(12)
_SIZES = 12
# then for every field of `Program` where it begins, in P (numbers) or in L itself (integers; plain ones are the entry).
(
    RATE, STOP_RESPONSE, EXOSYSTEM, OMEGA, PHASE, EXO_SCALE, SCALE, STORAGE, STOP_INPUT, STOP_LIMIT, STOP_WEIGHT,
    VOLTAGE_ROW, GUARD_Z, GUARD_D, TRIGGER_ROW, PRODUCT_COEFFICIENT, PRODUCT_Z, PRODUCT_D, OUTPUT_Z, OUTPUT_D,
    EQUILIBRIUM, ELEMENT_Z, CORNERS, PIECES, LAG, ON_TIME, STAGE, RECOVERED, HOLD_OFF, EFFICIENCY, DROP, THRESHOLD,
    GATE_ENERGY, EARLY,
    STEP, ASSIGNED_ROW, ASSIGNED_STEP, ASSIGNED_LIMIT, DRIFT, PERIOD,
    SIGNAL_KIND, CHARGE, SWITCHED, SHORTED, CATEGORY_COUNT,
    ODD, STOP_STATE, GUARD_TARGET, GUARD_CUT, GUARD_CODE, CLOSED, OPENED, CUT, MIRROR, PRODUCT_CATEGORY,
    ELEMENT_POWER, ELEMENT_PARITY, FIRST_CORNER, ASSIGNED_STATE, ASSIGNED_FIRST,
) = range(_SIZES, _SIZES + len(Program._fields))  # fmt: skip
NUMBERS = Program._fields[: PERIOD - _SIZES + 1]
PLAIN = Program._fields[SIGNAL_KIND - _SIZES : CATEGORY_COUNT - _SIZES + 1]
LISTS = Program._fields[ODD - _SIZES :]
CONTENTS = _SIZES + len(Program._fields)  # entries; those of the tables follow
ROOM = 36  # entries of the table of contents for the tables of modes


def integers(program: Program) -> np.ndarray:
    """Table of contents of a program, followed by its integers."""
    c, n, a = program.rate.shape[-3:]
    header = np.zeros(CONTENTS + ROOM, np.int64)
    guards, products = program.guard_target.shape[1], program.product_category.shape[1]
    rows = padded(a)
    columns = -(-a // COLUMNS_AT_ONCE) * COLUMNS_AT_ONCE
    shapes = _shapes(program)
    length = sum(map(math.prod, shapes.values()))
    header[:LENGTH] = a, n, c, len(program.stop_state), guards, products, len(program.phase), rows, columns
    elements = len(program.element_power)
    header[LENGTH : SIGNAL + 1] = length, elements, n + DERIVATIVES * elements
    offset = 0
    for k, name in enumerate(NUMBERS, RATE):
        header[k] = offset
        offset += math.prod(shapes[name])
    for k, name in enumerate(PLAIN, SIGNAL_KIND):
        header[k] = getattr(program, name)
    lists, offset = [header], len(header)
    for k, name in enumerate(LISTS, ODD):
        values = np.asarray(getattr(program, name)).astype(np.int64).ravel()
        header[k] = offset
        offset += len(values)
        lists.append(values)
    return np.concatenate(lists)


def numbers(program: Program) -> np.ndarray:
    """The real numbers of a program in one array, or one row of them for every design of a batch."""
    shapes, blocks = _shapes(program), []
    for name, shape in shapes.items():
        value = np.asarray(getattr(program, name))
        batch = value.shape[: value.ndim - len(shape)]
        blocks.append(value.reshape(*batch, -1))
    batches = {block.shape[:-1] for block in blocks}
    if len(batches) > 1:  # what is the same for all designs of a batch has no axis for them
        batch = np.broadcast_shapes(*batches)
        blocks = [np.broadcast_to(block, (*batch, block.shape[-1])) for block in blocks]
    return np.concatenate(blocks, axis=-1)


def part(program: Program, which: int | slice) -> Program:
    """Some designs of a batch, or one of them."""
    changes = {}
    for name, shape in _shapes(program).items():
        value = np.asarray(getattr(program, name))
        if value.ndim > len(shape):
            changes[name] = value[which]
    return program._replace(**changes)


def _shapes(program: Program) -> dict[str, tuple[int, ...]]:
    """Shape of every array of numbers in one design."""
    c, n, a = program.rate.shape[-3:]
    h, w, k, o, e = len(program.stop_state), a - n, len(program.phase), len(OUTPUTS), len(program.element_power)
    r, t = len(program.assigned_state), program.corners.shape[-1]
    g, p, m = program.guard_target.shape[1], program.product_category.shape[1], n + DERIVATIVES * e
    shapes = (
        (c, n, a), (c, n, h), (w, w), (k,), (k,), (w,), (n,), (m, m), (h, n), (h,), (h,), (a,), (c, g, a), (c, g, n),
        (a,), (c, p), (c, p, 2, a), (c, p, 2, n), (c, o, a), (c, o, n), (n,), (e, 2, a), (t,), (t + e, 3),
        (), (), (c,), (n,), (), (), (), (), (), (), (), (r, a), (r,), (r,), (), (),
    )  # fmt: skip
    return dict(zip(NUMBERS, shapes, strict=True))
