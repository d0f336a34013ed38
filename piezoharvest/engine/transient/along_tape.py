"""Compiled propagation of states and their derivatives along the motions of a run, whose events are known.

Within a motion the derivatives obey the variational equation of its mode; at its end they jump, as the time of the
event depends on the quantities (saltation). Sources: Hiskens & Pai, IEEE Trans. Circuits Syst. I 47(2), 204-220, 2000;
Leine & Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004. Derivatives are the innermost axis,
so that the loops over them are vectorised; the quantities come first, and after them initial states and the like.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from piezoharvest.engine.compilation.compiled import compiled, entry
from piezoharvest.engine.motion.element_outputs import NEXT
from piezoharvest.engine.propagation.trajectory import ACTS, NOTHING, OPENS

# The order of a tuple's fields is compiled in: their file has to be among the sources of this one.
from piezoharvest.engine.transient.bending import (
    Bending,
    add_form,
    hold_pieces,
    release_pieces,
    set_changes,
    set_cubic_changes,
    slope_along,
)
from piezoharvest.engine.transient.forcing import Forcing, set_cubics, set_outputs, set_straight
from piezoharvest.engine.transient.mode_steps import ModeSteps

TERMS = 5  # of the Taylor series over less than the shortest tabulated step, see `mode_steps.FINEST`
REMEMBERED = 8  # extrema of which an action may still be due
SAME_TIME = 1e-9  # of a sample: times that differ by less are equal


class Motions(NamedTuple):
    """Motions of a run between its events, in their order.

    Attributes
    ----------
    begins, ends : (k,) array
        s.
    starts : (k, a) array
        Augmented states at their beginnings.
    mode : (k,) int array
        Row of `ModeSteps`.
    configuration, what : (k,) int array
        Of the circuit; reason for the end, as on the tape of a run.
    slip : (k, h) int array
    """

    begins: np.ndarray
    ends: np.ndarray
    starts: np.ndarray
    mode: np.ndarray
    configuration: np.ndarray
    what: np.ndarray
    slip: np.ndarray


class Switching(NamedTuple):
    """What happens at events, and its derivatives (p,) with respect to the quantities.

    Attributes
    ----------
    n, own : int
        States; guards of the circuit, after which the extremum follows.
    kind : int
        0 no switch, 1 it closes and opens, 2 it takes charge at once.
    charge : int
        Its state.
    lag : float
        s.
    timed : int
        1 if actions follow given causes, 0 if they follow the extrema.
    opened : (c,) int array
    guard_cut : (c, g) int array
    stops : (h,) int array
        Their states.
    voltage : (a,) array
        Row of the electrode voltage.
    cut : (n,) int array
        1 for states that are cut when the switch opens.
    d_lag : (p,) array
    d_stage : (c, p) array
        Of the times for which the switch holds configurations.
    d_voltage : (a, p) array
    d_stops : (h, p) array
        Of the limits.
    """

    n: int
    own: int
    kind: int
    charge: int
    lag: float
    timed: int
    opened: np.ndarray
    guard_cut: np.ndarray
    cut: np.ndarray
    stops: np.ndarray
    voltage: np.ndarray
    d_lag: np.ndarray
    d_stage: np.ndarray
    d_voltage: np.ndarray
    d_stops: np.ndarray


class Moving(NamedTuple):
    """State along the run, and memory.

    Attributes
    ----------
    z, d : (a,) and (n, lanes) arrays
        Augmented state, and the derivatives of the states; those of the smooth elements, four each, follow where they
        bend the motion.
    z_next, d_next : arrays of the same shapes
    shift, closing, change : (lanes,) arrays
        Derivatives of the time of the present event, of the last closing, and a scratch.
    cause_time, cause : (r,) and (r, lanes) arrays
        Last extrema, or all that the switch is timed by: their times, and the derivatives of these.
    """

    z: np.ndarray
    d: np.ndarray
    z_next: np.ndarray
    d_next: np.ndarray
    shift: np.ndarray
    closing: np.ndarray
    change: np.ndarray
    cause_time: np.ndarray
    cause: np.ndarray


@compiled
def _grow(A, dA, depends, factor, own, z, d, z_out, d_out):
    """Product of (A, dA) times a factor with a state and its derivatives, into z_out and d_out.

    Only the first `own` states have derivatives: nothing changes the signal. dA is zero but where `depends` is true.
    """
    a, lanes, quantities = len(z), d.shape[1], dA.shape[2]
    for i in range(a):
        total = 0.0
        for j in range(a):
            total += A[i, j] * z[j]
        z_out[i] = factor * total
    for i in range(own):
        for s in range(lanes):
            d_out[i, s] = 0.0
        for j in range(own):
            f = factor * A[i, j]
            if f != 0.0:
                for s in range(lanes):
                    d_out[i, s] += f * d[j, s]
        for j in range(a):
            if depends[i, j]:
                g = factor * z[j]
                for p in range(quantities):
                    d_out[i, p] += g * dA[i, j, p]


@compiled
def _add(moving, own):
    """Add the products to state and derivatives."""
    for i in range(len(moving.z)):
        moving.z[i] += moving.z_next[i]
    for i in range(own):
        for s in range(moving.d.shape[1]):
            moving.d[i, s] += moving.d_next[i, s]


@compiled
def _series(steps, mode, own, left, moving, terms):
    """Move on by a time shorter than all tabulated steps; `terms` holds the last term of the series."""
    a, lanes = len(moving.z), moving.d.shape[1]
    z_term, d_term = terms
    for i in range(a):
        z_term[i] = moving.z[i]
    for i in range(own):
        for s in range(lanes):
            d_term[i, s] = moving.d[i, s]
    for k in range(1, TERMS + 1):
        _grow(
            steps.rate[mode], steps.d_rate[mode], steps.depends_rate[mode], left / k, own, z_term, d_term,
            moving.z_next, moving.d_next,
        )  # fmt: skip
        for i in range(a):
            z_term[i] = moving.z_next[i]
        for i in range(own):
            for s in range(lanes):
                d_term[i, s] = moving.d_next[i, s]
        _add(moving, own)


@compiled
def _move(steps, forcing, mode, own, h, now, length, moving, terms):
    """Move on within a mode; the outputs of its smooth elements are set at the beginning and at the end."""
    left, step, forced = length, h, len(forcing.power) > 0
    for level in range(steps.levels[mode]):
        while left >= step * (1.0 - SAME_TIME):
            time = now + length - left
            if forced and not set_cubics(forcing, steps, mode, level, step, time, moving.z, moving.z_next):
                break
            _grow(
                steps.growth[mode, level], steps.d_growth[mode, level], steps.depends[mode, level], 1.0, own, moving.z,
                moving.d, moving.z_next, moving.d_next,
            )  # fmt: skip
            _add(moving, own)
            left -= step
            if forced:
                set_outputs(forcing, steps.rate[mode], moving.z, now + length - left)
        step *= 0.5
    if left > 0.0:
        set_straight(forcing, moving.z)
        _series(steps, mode, own, left, moving, terms)
        set_outputs(forcing, steps.rate[mode], moving.z, now + length)


@compiled
def _form(row, changes, z, d, out):
    """Derivatives of the value of a form with derivatives (a, p), into `out`."""
    for s in range(len(out)):
        out[s] = 0.0
    add_form(1.0, row, changes, z, d, out)


@compiled
def _rate(A, i, z):
    """Rate of a state."""
    total = 0.0
    for j in range(len(z)):
        total += A[i, j] * z[j]
    return total


@compiled
def _guard_shift(steps, mode, what, moving):
    """Derivatives of the time at which a form is zero, into `shift`."""
    z, shift, row = moving.z, moving.shift, steps.guards[mode, what]
    _form(row, steps.d_guards[mode, what], z, moving.d, shift)
    slope = 0.0
    for j in range(len(z)):
        if row[j] != 0.0:
            slope += row[j] * _rate(steps.rate[mode], j, z)
    for p in range(steps.d_limits.shape[1]):
        shift[p] += steps.d_limits[what, p]
    for s in range(len(shift)):
        shift[s] = -shift[s] / slope if slope != 0.0 else 0.0


@compiled
def _find_shift(steps, switching, motions, k, near, moving):
    """Derivatives of the time of an event, into `shift`."""
    shift, what, time = moving.shift, motions.what[k], motions.ends[k]
    if what == OPENS:
        for s in range(len(shift)):
            shift[s] = moving.closing[s]
        for p in range(switching.d_stage.shape[1]):
            shift[p] += switching.d_stage[motions.configuration[k], p]
    elif what == ACTS:
        best = 0
        for k in range(len(moving.cause_time)):
            if abs(moving.cause_time[k] + switching.lag - time) < abs(moving.cause_time[best] + switching.lag - time):
                best = k
        known = abs(moving.cause_time[best] + switching.lag - time) <= near
        for s in range(len(shift)):
            shift[s] = moving.cause[best, s] if known else 0.0
        for p in range(len(switching.d_lag)):
            shift[p] += switching.d_lag[p]
    else:
        _guard_shift(steps, motions.mode[k], what, moving)


@compiled
def _remember(time, moving):
    """Remember an extremum instead of the oldest one."""
    oldest = 0
    for k in range(len(moving.cause_time)):
        if moving.cause_time[k] < moving.cause_time[oldest]:
            oldest = k
    moving.cause_time[oldest] = time
    for s in range(len(moving.shift)):
        moving.cause[oldest, s] = moving.shift[s]


@compiled
def _shifted(A, z, sign, n, moving):
    """Add to the derivatives the motion in the time by which the event is later."""
    for i in range(n):
        rate = sign * _rate(A, i, z)
        for s in range(len(moving.shift)):
            moving.d[i, s] += rate * moving.shift[s]


@compiled
def _reset(switching, motions, k, moving):
    """Effect of an event on the derivatives beside its shift: currents cut, stops at their limits."""
    d, what, lanes = moving.d, motions.what[k], len(moving.shift)
    for j in range(len(switching.stops)):
        if motions.slip[k + 1, j] != 0 and motions.slip[k, j] == 0:
            _at_limit(switching, j, motions.slip[k + 1, j] * 1.0, moving)
    guard_cut = switching.guard_cut[motions.configuration[k], what] if 0 <= what < switching.own else -1
    for row in range(switching.n):
        if row == guard_cut or (what == OPENS and switching.cut[row]):
            for s in range(lanes):
                d[row, s] = 0.0


@compiled
def _at_limit(switching, j, sign, moving):
    """Derivatives of a stop at its limit."""
    row = switching.stops[j]
    for s in range(len(moving.shift)):
        moving.d[row, s] = 0.0
    for p in range(switching.d_stops.shape[1]):
        moving.d[row, p] = sign * switching.d_stops[j, p]


@compiled
def _voltage(switching, z):
    """Electrode voltage of a state."""
    total = 0.0
    for j in range(len(z)):
        total += switching.voltage[j] * z[j]
    return total


@compiled
def _extract(switching, bending, mode, time, after, moving):
    """Derivatives after charge has been taken until the voltage is zero: sticking stops move with it."""
    z, d, charge, lanes = moving.z, moving.d, switching.charge, len(moving.shift)
    taken = after[charge] - z[charge]
    direction = bending.direction
    direction[:] = 0.0
    direction[charge] = 1.0
    for j in range(len(switching.stops)):
        row = switching.stops[j]
        moved = after[row] - z[row]
        if abs(moved - taken) <= SAME_TIME * abs(taken):
            direction[row] = 1.0
        elif moved != 0.0:
            _at_limit(switching, j, 1.0 if after[row] > 0.0 else -1.0, moving)
    if len(bending.power):
        release_pieces(bending)
        set_changes(bending, mode, time, after, d)
    slope = slope_along(bending, switching.voltage, direction, 0.0, after, time)
    _form(switching.voltage, switching.d_voltage, after, d, moving.change)
    direction[:] = 0.0
    drift = slope_along(bending, switching.voltage, direction, 1.0, after, time)
    for s in range(lanes):
        moving.change[s] += drift * moving.shift[s]
        d[charge, s] -= moving.change[s] / slope
    for j in range(len(switching.stops)):
        row = switching.stops[j]
        if abs(after[row] - z[row] - taken) <= SAME_TIME * abs(taken):
            for s in range(lanes):
                d[row, s] -= moving.change[s] / slope


@compiled
def _event(steps, switching, bending, motions, k, near, moving):
    """Take the derivatives across the event at the end of a motion."""
    mode, what, following = motions.mode[k], motions.what[k], motions.starts[k + 1]
    _find_shift(steps, switching, motions, k, near, moving)
    if what == switching.own and not switching.timed:
        _remember(motions.ends[k], moving)
    opened, now, later = switching.opened, motions.configuration[k], motions.configuration[k + 1]
    closes = opened[now] == now and opened[later] != later
    extracts = switching.kind == 2 and abs(_voltage(switching, following)) <= SAME_TIME * abs(
        _voltage(switching, moving.z)
    )
    if (closes or extracts) and switching.lag == 0.0:
        # The extremum and the action are one event here, delayed by a lag.
        for p in range(len(switching.d_lag)):
            moving.shift[p] += switching.d_lag[p]
    # A later stage is timed from its own beginning.
    if closes or extracts or (what == OPENS and opened[later] != later):
        for s in range(len(moving.shift)):
            moving.closing[s] = moving.shift[s]
    _shifted(steps.rate[mode], moving.z, 1.0, switching.n, moving)
    _reset(switching, motions, k, moving)
    if extracts:
        _extract(switching, bending, motions.mode[k + 1], motions.ends[k], following, moving)
    _shifted(steps.rate[motions.mode[k + 1]], following, -1.0, switching.n, moving)


@compiled
def _write(steps, mode, moving, Y, dY, sample):
    """Write the outputs of a sample."""
    for o in range(Y.shape[1]):
        total = 0.0
        for j in range(len(moving.z)):
            total += steps.outputs[mode, o, j] * moving.z[j]
        Y[sample, o] = total
        _form(steps.outputs[mode, o], steps.d_outputs[mode, o], moving.z, moving.d, dY[sample, o])


@compiled
def _copy(z, d, to_z, to_d):
    """Copy a state and its derivatives."""
    for i in range(len(z)):
        to_z[i] = z[i]
    for i in range(len(d)):
        for s in range(d.shape[1]):
            to_d[i, s] = d[i, s]


@compiled
def _bend(steps, forcing, bending, mode, h, begin, end, moving, terms):
    """Set the derivatives of outputs that bend the motion over a step, to which the run has given its cubics.

    With straight outputs the derivatives at its end are right to the second order in the step; with the cubics that
    follow those of a record are right to 1e-4 (measured, of the effects and circuits of the tests).
    """
    own, length = len(moving.d), end - begin
    hold_pieces(bending, mode, moving.z, NEXT * length)
    set_changes(bending, mode, begin, moving.z, moving.d)
    if length <= 0.0:
        return
    z, d = bending.begin_z, bending.begin_d
    _copy(moving.z, moving.d, z, d)
    _move(steps, forcing, mode, own, h, begin, length, moving, terms)
    set_changes(bending, mode, end, moving.z, moving.d)
    set_cubic_changes(bending, d, moving.d, length)
    _copy(z, d, moving.z, moving.d)


@partial(entry, nogil=True)
def follow(
    steps: ModeSteps, switching: Switching, forcing: Forcing, bending: Bending, motions: Motions, moving: Moving,
    terms: tuple, times: np.ndarray, Y: np.ndarray, dY: np.ndarray,
) -> int:  # fmt: skip
    """Follow the motions of a run.

    Parameters
    ----------
    steps : ModeSteps
    switching : Switching
    forcing : Forcing
        Elements without an influence on the motion.
    bending : Bending
        Those with one; there are none of the one or of the other kind.
    motions : Motions
        The outputs of smooth elements are set in its states.
    moving : Moving
        With the derivatives of the initial state.
    terms : tuple of two arrays
        Memory of the shapes of z and d.
    times : (samples,) array
        s, evenly spaced; a signal that is no sum of tones is straight between them.
    Y : (samples, outputs) array
    dY : (samples, outputs, lanes) array
        Both outputs.

    Returns
    -------
    int
        Number of samples written.
    """
    h, sample, own = times[1] - times[0], 0, len(moving.d)
    near, a = SAME_TIME * h, len(moving.z)
    for k in range(len(motions.begins)):
        set_outputs(forcing, steps.rate[motions.mode[k]], motions.starts[k], motions.begins[k])
    for k in range(len(motions.begins)):
        mode = motions.mode[k]
        for i in range(a):
            moving.z[i] = motions.starts[k, i]
        if len(bending.power):
            _bend(steps, forcing, bending, mode, h, motions.begins[k], motions.ends[k], moving, terms)
        if sample == 0:
            _write(steps, mode, moving, Y, dY, 0)
            sample = 1
        now = motions.begins[k]
        while sample < len(times) and times[sample] <= motions.ends[k] + near:
            there = min(max(times[sample], now), motions.ends[k])
            _move(steps, forcing, mode, own, h, now, there - now, moving, terms)
            _write(steps, mode, moving, Y, dY, sample)
            sample, now = sample + 1, there
        _move(steps, forcing, mode, own, h, now, motions.ends[k] - now, moving, terms)
        if motions.what[k] != NOTHING and k + 1 < len(motions.begins):
            _event(steps, switching, bending, motions, k, near, moving)
    return sample
