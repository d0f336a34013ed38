"""State of a run: states, clocks, sensitivities, energies and the log, in two flat arrays S and D.

D holds the discrete state and the places of everything else in S, which begins with the augmented state.
"""

from __future__ import annotations

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, inlined
from piezoharvest.engine.memory import program as pg
from piezoharvest.engine.memory import tables as tb
from piezoharvest.engine.memory.vector import GROUP, lined_up, whole_lines

QUEUE_LENGTH = 4  # scheduled actions of the switch at one time, at most
VECTORS = 16  # of scratch
TANGENT_BLOCKS = 5  # of all sensitivities: themselves, three terms of a series, and what the fourth one acts on
TOLERANCE = 1e-11  # of the outputs of smooth elements: the energy of a period then closes to about 1e-8

# Places in D: the discrete state; BETWEEN is set while an event is incomplete, MODE is the slot of the mode of the last
# step (-1: none, or the last step was another state's),
(
    CONFIGURATION, DIRECTION, WAITING, CLOSED, LOGGED, SAMPLED, INCOMPLETE, HAPPENED, MODE,
    # recorded quantities,
    SENSITIVITIES, ENERGIES, TRACKED, LOG_ROOM, SAMPLES_WANTED, TAPE_ROOM, TAPED, STEPS_TAPED,
    # places of lists in D,
    SLIP, POLARITY, CANDIDATE, LOG_CODE, TAPE_KIND, PIVOTS, SEGMENTS, COUNTS,
    # and in S.
    CLOCK, QUEUE, SIGN, OFFSET, NOW_GUARDS, THEN_GUARDS, SIZE, LOW, HIGH, GUESS, THERE_GUARDS, TAYLOR, LOWER, UPPER,
    FREE_STEP, CURVE, CURVE_PHI, WORK, EXTREMES, ENERGY, PHI, QUEUE_PHI, OPENS_PHI, EVENT_PHI, LOG_TIME, SAMPLE_TIME,
    SAMPLES, TAPE, QUADRATURE, FACTORS, FIRST_TIMES, END,
) = range(57)  # fmt: skip
# Places from CLOCK on in S: time now, when the switch opens, when it last acted, all in s.
NOW, OPENS, ACTED = range(3)


class EngineState:
    """Hybrid state of a simulation and its recorded quantities.

    Parameters
    ----------
    contents : (i,) int array
        Table of contents of the machine.
    sensitivities : int
        Number of derivatives that are propagated.
    ledger, track : bool
        Record energies; record the extremes of displacement and voltage.
    log : int
        Events to keep.
    sample_time : (t,) array, optional
        Times in s at which the outputs are sampled.
    tape : int
        Motions between two events to keep.
    steps_taped : bool
        Keep every step of a motion with smooth elements, with the cubics of their outputs, as a motion of its own.
    tolerance : float
        Error of the output of a smooth element within a step, relative to the state.
    """

    def __init__(
        self, contents, *, sensitivities=0, ledger=False, track=False, log=0, sample_time=None, tape=0,
        steps_taped=False, tolerance=TOLERANCE,
    ):  # fmt: skip
        times = np.zeros(0) if sample_time is None else np.asarray(sample_time, float)
        rows, h, outputs = contents[pg.ROWS], contents[pg.H], len(pg.OUTPUTS)
        guards = contents[tb.SLOT]  # more than any mode has
        energies, elements = contents[pg.CATEGORY_COUNT] if ledger else 0, contents[pg.ELEMENTS]
        columns = -(-sensitivities // GROUP) * GROUP * rows  # in groups, as they are propagated
        curve = 3 + 4 * rows + elements * (elements + 2) if elements else 0
        places = {
            CLOCK: 3, QUEUE: QUEUE_LENGTH, SIGN: guards, OFFSET: guards, NOW_GUARDS: contents[tb.GUARD_ROWS],
            THEN_GUARDS: contents[tb.GUARD_ROWS], LOW: guards, HIGH: guards, GUESS: guards,
            SIZE: 1, LOWER: contents[tb.FORMS], UPPER: contents[tb.FORMS],
            THERE_GUARDS: contents[tb.FORMS], TAYLOR: tb.TAYLOR_ROWS,
            FREE_STEP: contents[tb.FREE_STEP_ROWS], CURVE: curve, CURVE_PHI: sensitivities * rows if elements else 0,
            WORK: VECTORS * rows,
            EXTREMES: 4, ENERGY: energies, PHI: TANGENT_BLOCKS * columns, QUEUE_PHI: QUEUE_LENGTH * sensitivities,
            OPENS_PHI: sensitivities, EVENT_PHI: sensitivities, LOG_TIME: log, SAMPLE_TIME: len(times),
            SAMPLES: len(times) * outputs, TAPE: tape * (2 + int(contents[pg.A])), QUADRATURE: energies,
            FACTORS: (tb.NODE_COUNT + 1) * contents[tb.FACTOR_ROWS] if ledger else 0, FIRST_TIMES: len(pg.EVENT_NAMES),
        }  # fmt: skip
        lists = {
            SLIP: h, POLARITY: QUEUE_LENGTH, CANDIDATE: guards, LOG_CODE: log, TAPE_KIND: tape * (3 + int(h)),
            PIVOTS: elements, SEGMENTS: elements, COUNTS: len(pg.EVENT_NAMES),
        }  # fmt: skip
        in_d, in_s = _offsets(lists, END + 1), _offsets(places, rows)
        self.D = np.zeros(in_d[-1], np.int64)
        self.D[[*lists, *places, END]] = [*in_d[:-1], *in_s]
        self.D[[MODE, SENSITIVITIES, ENERGIES, TRACKED]] = -1, sensitivities, energies, track
        self.D[[LOG_ROOM, SAMPLES_WANTED, TAPE_ROOM, STEPS_TAPED]] = log, len(times), tape, steps_taped
        self.S = lined_up(int(self.D[END]))
        self._place, self._lists = places, lists
        self.z = self.S[: contents[pg.A]]
        self.clock, self.energy = self[CLOCK], self[ENERGY]
        self.clock[:] = 0.0, np.inf, -np.inf
        self[CURVE][2:3] = tolerance
        self.extremes = self[EXTREMES].reshape(2, 2)
        self.extremes[:] = np.inf, -np.inf
        self.sample_time = self[SAMPLE_TIME]
        self.sample_time[:] = times
        self.samples = self[SAMPLES].reshape(-1, outputs)
        self.log_time, self.log_code = self[LOG_TIME], self[LOG_CODE]
        self.counts, self.first_times = self[COUNTS], self[FIRST_TIMES]  # of events, by their codes

    def __getitem__(self, place: int) -> np.ndarray:
        """Part of S or D that a place stands for, without copying."""
        begin = self.D[place]
        if place in self._lists:
            return self.D[begin : begin + self._lists[place]]
        return self.S[begin : begin + self._place[place]]

    def follow(self, other: EngineState) -> None:
        """Copy the hybrid state of another state of the same machine."""
        for k in (CONFIGURATION, DIRECTION, WAITING, CLOSED, INCOMPLETE):
            self.D[k] = other.D[k]
        for place in (SLIP, POLARITY, CLOCK, QUEUE):
            self[place][:] = other[place]
        self.D[MODE] = -1
        self.z[:] = other.z


def _offsets(sizes: dict[int, int], begin: int) -> np.ndarray:
    """Offsets of consecutive blocks of these sizes, each aligned to a cache line, and the end of the last."""
    return np.cumsum([whole_lines(begin), *map(whole_lines, sizes.values())])


@inlined
def vector(L, D, k):
    """Place of the k-th scratch vector in S."""
    return D[WORK] + k * L[pg.ROWS]


@compiled
def dot_column(P, at, stride, S, z, count):
    """Value of a linear form, which stands in P with a stride, for a vector in S."""
    total = 0.0
    for j in range(count):
        total += P[at + j * stride] * S[z + j]
    return total


@compiled
def stored(P, L, S):
    """Stored energy, J."""
    m, total = L[pg.SIGNAL], 0.0
    for i in range(m):
        for j in range(m):
            total += 0.5 * S[i] * P[L[pg.STORAGE] + i * m + j] * S[j]
    return total


@inlined
def set_one(P, L, S):
    """Set the constant, if the model has one, the last of the exogenous states."""
    last = L[pg.A] - 1
    if last == L[pg.SIGNAL] + 2 * max(L[pg.TONE_COUNT], 1):
        S[last] = 1.0 / P[L[pg.EXO_SCALE] + last - L[pg.N]]


@compiled
def set_tones(P, L, S, t):
    """Set the exogenous states of a sum of tones from their phases, so that errors do not accumulate."""
    at = L[pg.SIGNAL]
    scale = L[pg.EXO_SCALE] + at - L[pg.N]
    for k in range(L[pg.TONE_COUNT]):
        angle = P[L[pg.OMEGA] + k] * t + P[L[pg.PHASE] + k]
        S[at + 2 * k] = np.sin(angle) / P[scale + 2 * k]
        S[at + 2 * k + 1] = np.cos(angle) / P[scale + 2 * k + 1]
    set_one(P, L, S)


@compiled
def set_ramp(P, L, S, value, slope):
    """Set the exogenous states of a linear piece of signal."""
    at = L[pg.SIGNAL]
    scale = L[pg.EXO_SCALE] + at - L[pg.N]
    S[at] = value / P[scale]
    S[at + 1] = slope / P[scale + 1]
    set_one(P, L, S)
