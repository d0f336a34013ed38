"""First fit of records behind diodes and switches: away from the jumps of voltage and current, then with them.

A voltage that is inverted within a sample or two, or the current of a diode that begins to conduct, differs by a
thousand times its noise from one a little later. While the parameters are a few per cent off, the cost has a minimum
for each way in which some jumps of the model meet those of the record. Without the samples beside the jumps, the motion
between them decides.

A record that begins at rest does so in this first fit, too: from a state a little beside rest the switch acts once more
at the very beginning, or once less, which no small step takes back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.jumps import jumps_of
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit, linearised, mean_square
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_problem
from piezoharvest.identify.start_values.multistart import MAX_MEAN_SQUARE, fit_multistart
from piezoharvest.predict.circuit.setting import has_events
from piezoharvest.predict.prediction import PredictionError

SHARE = 1.0 / 12.0  # of a period: parameters whose events are off by no more are found
JUMPING = ("voltage", "current")


def fit_past_jumps(
    problem: Problem,
    model: Model,
    progress: Callable[[str], None],
    poor: Callable[[Fit], None] = lambda found: None,
) -> Fit:
    """Fit from initial estimates, where voltages or currents jump first without the samples beside the jumps.

    Where that ends far off, as with an effect that the model lacks, the fit of all samples from the beginning is made
    too, and the better one taken; `poor` is called as by `fit_multistart`.
    """
    blind = without_jumps(problem)
    if blind is problem:
        return fit_multistart(problem, model, progress, poor)
    progress("start: fit away from the jumps of voltage and current")
    first = fit_multistart(blind, model, progress)
    progress("samples beside the jumps, too: the misfit is that of more samples")
    nuisance = nuisance_for_problem(blind, first.nuisance, problem, first.model)
    try:
        found = fit(problem, first.model, nuisance, progress=progress, rounds=2)
    except PredictionError:  # what fits best without these samples cannot follow them
        return fit_multistart(problem, model, progress, poor)
    if mean_square(found) < MAX_MEAN_SQUARE:
        return found
    progress("another start: all samples from the nominal values")
    other = fit_multistart(problem, model, progress, poor)
    squares = linearised(problem, other.model, other.nuisance, found)[2]
    return other if squares < sum(float(sums.squares.sum()) for sums in found.sums) else found


def without_jumps(problem: Problem) -> Problem:
    """The problem without the samples beside jumps, from rest where a record begins there.

    The problem itself if there are no jumps.
    """
    device = problem.nominal
    period = 2.0 * np.pi * np.sqrt(device.mass / device.stiffness)
    hidden = [beside_jumps(data, period) if isinstance(data, Data) else np.zeros(0, bool) for data in problem.data]
    known = [each.hidden if isinstance(each, Data) else None for each in problem.data]
    if not problem.has_events or not any(
        np.any(mine if own is None else mine & ~own) for mine, own in zip(hidden, known, strict=True)
    ):
        return problem
    data = [
        replace(_from_rest(each), hidden=mine) if isinstance(each, Data) else each
        for each, mine in zip(problem.data, hidden, strict=True)
    ]
    return Problem(data, problem.nominal, problem.offset_channels)


def _from_rest(data: Data) -> Data:
    """Data of a record that begins exactly at rest, if its first samples show nothing else."""
    if any(data.start.values()) or not data.setting.free or not has_events(data.setting.shunt, data.drive):
        return data
    return replace(data, setting=replace(data.setting, free=(), sizes=()))


def beside_jumps(data: Data, period: float) -> np.ndarray:
    """Mask (samples,) of what is beside a jump of a measured channel, for a period of the motion in s."""
    reach = int(np.ceil(SHARE * period / data.setting.sample_time))
    jumps = np.zeros(len(data), bool)
    for channel in set(JUMPING) & set(data.channels):
        jumps |= jumps_of(data.record, channel, period)
    beside = np.convolve(jumps, np.ones(2 * reach + 1), "same") > 0.0 if 2 * reach < len(data) else jumps
    return beside if data.hidden is None else beside | data.hidden
