"""A lowered system: the arrays that the compiled engine runs on.

Everything is in energy-scaled coordinates (1/2 z^2 is an energy for every state that stores one), so that the matrices
of nF and uF, of Hz and kHz, have entries of the size of the system's frequencies, and one tolerance serves all.
The augmented state is [states | exogenous states]; the last exogenous state is the constant 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest.engine.compiled import compiled
from piezoharvest.engine.reference import reference

TONES, RAMPS = 0, 1

# Codes of events, in the order of their names in results.
CLOSE, OPEN, CONDUCT, BLOCK, EXTRACT, SLIP, STICK = range(7)
EVENT_NAMES = (
    "switch closes",
    "switch opens",
    "diodes conduct",
    "diodes block",
    "voltage extracted",
    "hysteresis slips",
    "hysteresis sticks",
)

# Rows that every configuration reads out.
OUTPUTS = (
    "drive", "displacement", "velocity", "voltage", "current", "charge", "hysteresis_voltage", "dc_voltage",
)  # fmt: skip
DISPLACEMENT, VOLTAGE = 1, 3
WATCHED = 2  # outputs whose extremes are wanted: their rates stand behind the guards, so that steps follow them too

# Where energy goes; the effects' own losses follow.
CATEGORIES = ("mechanical_in", "damping", "hysteresis", "harvested", "shunt_loss", "source")
MEAN_DC = "mean_dc"  # not an energy: the dc voltage over the time, for its mean
MECHANICAL_IN, DAMPING, HYSTERESIS, HARVESTED, SHUNT_LOSS, SOURCE = range(6)


class Program(NamedTuple):
    """One design. n states, w exogenous states, a = n + w, c configurations, h stops, g guards, p products, k tones.

    A linear form has a part over the augmented state (`*_z`, length a) and one over the derivative (`*_d`, length n).
    """

    rate: np.ndarray  # (c, n, a): z' = rate [z | exogenous] with every stop slipping
    stop_response: np.ndarray  # (c, n, h): z' that a rate of each stop alone brings about
    exosystem: np.ndarray  # (w, w)
    signal_kind: int  # TONES or RAMPS
    omega: np.ndarray  # (k,) rad/s
    phase: np.ndarray  # (k,)
    exo_scale: np.ndarray  # (w,) physical = scale * scaled
    scale: np.ndarray  # (n,)
    odd: np.ndarray  # (n,) sign that mirroring gives each state
    storage: np.ndarray  # (n, n) stored energy z' storage z / 2
    stop_state: np.ndarray  # (h,) int
    stop_input: np.ndarray  # (h, n) derivative of the stop's input as a form over z'
    stop_limit: np.ndarray  # (h,)
    stop_weight: np.ndarray  # (h,) scaled so that weight * s * input' is a power
    charge: int  # index of q
    voltage_row: np.ndarray  # (a,) v_p
    guard_z: np.ndarray  # (c, g, a)
    guard_d: np.ndarray  # (c, g, n)
    guard_target: np.ndarray  # (c, g) int, -1 where there is none
    guard_cut: np.ndarray  # (c, g) int, state set to zero, or -1
    guard_code: np.ndarray  # (c, g) int
    trigger_row: np.ndarray  # (a,) sum T_i u_i
    switched: int  # 0 none, 1 closes and opens, 2 extracts at once
    lag: float
    on_time: float
    hold_off: float
    early: int
    efficiency: float
    closed: np.ndarray  # (2, c) int: after closing at a minimum, at a maximum
    opened: np.ndarray  # (c,) int
    cut: int  # state that opening sets to zero, or -1
    mirror: np.ndarray  # (c,) int
    product_coefficient: np.ndarray  # (c, p)
    product_category: np.ndarray  # (c, p) int, -1 where there is none
    product_z: np.ndarray  # (c, p, 2, a)
    product_d: np.ndarray  # (c, p, 2, n)
    output_z: np.ndarray  # (c, outputs, a)
    output_d: np.ndarray  # (c, outputs, n)
    categories: int
    step: float  # largest step, s


ProgramRef, ProgramType = reference(Program)


@compiled
def point(program):
    """The program by pointer, for compiled code."""
    return ProgramRef(*program)
