"""Laws with a memory at the places of the records: their starts, and the scores of all of a place by one linearisation.

A memory has no influence at a factor of zero, and its own values no derivative there: like the time constants of named
effects these are tried at several starts (Davies, Biometrika 74(1), 33-43, 1987).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from piezoharvest.description.effects.nameless.circuit_places import SwitchLoop, has_loop
from piezoharvest.description.effects.nameless.forms import Line
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.effects.nameless.memory import Delay, LateBy, Memory, Play, Relaxation, Resonance
from piezoharvest.description.effects.nameless.places import CHANNELS, LoadCurrent, Place, Reading
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose.discovery.law_fits import ScoredLaw, known_before, law_parameters
from piezoharvest.diagnose.discovery.places import ACTING
from piezoharvest.diagnose.discovery.tables.smoothness import Smoothness, projected
from piezoharvest.diagnose.discovery.tables.visited import Visited
from piezoharvest.diagnose.selection.score_tests import extended
from piezoharvest.diagnose.selection.start_values import CampaignScales
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.output_error import linearised
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model
from piezoharvest.predict.parameters import Parameter, put
from piezoharvest.predict.prediction import PredictionError

PLAYS = (0.01, 0.03, 0.1, 0.25)  # thresholds that are tried, of half the visited range
RESONANCES = 5  # frequencies that are tried between the slowest and the fastest that the records resolve
RESONANCES_BETWEEN = 16  # the same between two channels, where a sensor may be excited at a narrow resonance of its own
DAMPING_RATIO = 0.2  # at the start: resonances that are apart by a factor of three overlap
# Of the own resonances of the specimen: frequencies that are tried, too, as one beside them shows most, and narrowly;
# and their damping ratio, with which neighbours overlap.
BESIDE, BESIDE_DAMPING = (0.5, 0.7, 0.84, 1.0, 1.19, 1.41, 2.0), 0.1
# Delays of a load or of crosstalk that are tried; longest one, in samples, where there is no resonance.
DELAYS, LATE_SAMPLES = 5, 16.0
# Of sqrt(L C) of a switched loop: least time constant of a relaxation that is tried there, as a faster one is a
# resistance or an inductance; and how many are tried in each decade, within which fits find the best one.
LEAST_SWING, IN_A_DECADE = 0.1, 2
FASTEST = 0.3  # of the rate of samples: highest frequency of a resonance that is tried


def memories_at(place: Place, visited: Visited, scales: CampaignScales, device: Transducer) -> list[Law]:
    """Laws with a memory that are tried at a place: at a sensor of the reading's own true value, or of another channel.

    Rates and time have none: what lags behind a rate is how far the channel is ahead of its own lag.
    """
    kinds: list[Memory] = []
    if isinstance(place, Reading):
        own = place.of == place.channel
        kinds = [*(_of_sensor(place, visited, scales) if own else _of_crosstalk(place, scales, device))]
    elif isinstance(place, LoadCurrent):
        kinds = [*_of_load(scales, device)]
    elif isinstance(place, SwitchLoop):
        kinds = [*_of_loop(scales, device)]
    elif place.port and not place.in_circuit:
        kinds = [*_of_port(place, visited, scales, device)]
    if place.name.removeprefix("reading.") in ACTING:  # a late drive is late channels
        kinds = [each for each in kinds if not isinstance(each, Delay)]
    return [Law(place=place, form=Line(factor=0.0), memory=each) for each in kinds]


def _of_sensor(place: Place, visited: Visited, scales: CampaignScales) -> Iterator[Memory]:
    yield Delay(delay=0.0)
    yield from plays(visited[place.input])
    # By what it is behind: a low-pass of any share. By its lag: a high-pass, as amplifiers that block a constant have.
    yield from (Relaxation(time_constant=each, behind=side) for each in scales.times for side in (True, False))
    yield from _resonances(scales, behind=True)


def _of_crosstalk(place: Place, scales: CampaignScales, device: Transducer) -> Iterator[Memory]:
    """Filters between two channels: of low frequencies, of high ones, resonances, and delays."""
    if place.input in CHANNELS:
        yield from (LateBy(delay=each, whole=True) for each in delays(scales, device))
        yield from (Relaxation(time_constant=each, behind=side) for each in scales.times for side in (False, True))
        yield from _resonances(scales, behind=False, count=RESONANCES_BETWEEN, damping_ratio=BESIDE_DAMPING)


def _of_load(scales: CampaignScales, device: Transducer) -> Iterator[Memory]:
    """How late a load may be."""
    yield from (Relaxation(time_constant=each, behind=True) for each in scales.times)
    yield from (LateBy(delay=each) for each in delays(scales, device))


def delays(scales: CampaignScales, device: Transducer) -> list[float]:
    """Delays that are tried: by less than what turns the resonance, or some samples, by a radian.

    The longer ones of other periods of it look the same in a score.
    """
    shortest = 0.5 * scales.sample_time
    radian = LATE_SAMPLES * scales.sample_time
    if not device.quasi_static:
        radian = max(float(np.sqrt(device.mass / device.stiffness)), 2.0 * shortest)
    return np.geomspace(shortest, radian, DELAYS).tolist()


def _of_loop(scales: CampaignScales, device: Transducer) -> Iterator[Memory]:
    """Relaxations from a part of the time in which a coil swings on: what lags between two actions shows, too."""
    coils = [shunt.loop(device.capacitance)[0] for shunt in scales.shunts if has_loop(shunt)]
    shortest = LEAST_SWING * float(np.sqrt(min(map(np.real, coils)) * device.capacitance))
    decades = np.log10(scales.times[-1] / shortest)
    for time in np.geomspace(shortest, scales.times[-1], max(2, round(IN_A_DECADE * decades) + 1)):
        yield from (Relaxation(time_constant=float(time), behind=behind) for behind in (True, False))


def _of_port(place: Place, visited: Visited, scales: CampaignScales, device: Transducer) -> Iterator[Memory]:
    """Memories of a port; a damper's relaxation is that of the spring."""
    if place.port in Play.signs:
        yield from plays(visited[place.input])
    if place.port in Relaxation.signs and place.name != "damper":
        yield from (Relaxation(time_constant=each) for each in scales.times)
    if place.port in Resonance.signs:
        yield from _resonances(scales, behind=False)
        yield from _beside_resonances(scales, device)


def plays(visited: np.ndarray) -> Iterator[Play]:
    """Starts of a play."""
    half = 0.5 * float(np.ptp(visited))
    yield from (Play(threshold=share * half) for share in PLAYS if half > 0.0)


def _resonances(
    scales: CampaignScales, *, behind: bool, count: int = RESONANCES, damping_ratio: float = DAMPING_RATIO
) -> Iterator[Resonance]:
    highest, lowest = FASTEST / scales.sample_time, 1.0 / scales.longest
    for frequency in np.geomspace(max(lowest, 1e-3 * highest), highest, count):
        yield Resonance(frequency=float(frequency), damping_ratio=damping_ratio, behind=behind)


def _beside_resonances(scales: CampaignScales, device: Transducer) -> Iterator[Resonance]:
    """Resonances beside those of the specimen, such as a small mass on a wire, as far as the records resolve them."""
    if device.quasi_static:
        return
    highest, lowest = FASTEST / scales.sample_time, 1.0 / scales.longest
    for mode in device.all_modes:
        for share in BESIDE:
            frequency = share * float(np.sqrt(mode.stiffness / mode.mass)) / (2.0 * np.pi)
            if lowest < frequency < highest:
                yield Resonance(frequency=frequency, damping_ratio=BESIDE_DAMPING)


def score_memories(problem: Problem, base: Fit, laws: Sequence[Law], visited: np.ndarray) -> list[ScoredLaw]:
    """Scores of laws with a memory at one place, those of the wrong sign at a port left out: they would give energy."""
    first, at = len(base.model.transducer.effects), len(base.model.parameters)
    strengths = [_strength(law, n) for n, law in enumerate(laws, first)]
    model = replace(extended(base.model, laws, strengths), felt=first)
    nuisance = nuisance_for_model(problem, base.model, base.nuisance, model)
    try:
        information, gradient, _ = linearised(problem, model, nuisance, base)
    except (PredictionError, ParameterError, np.linalg.LinAlgError):
        return []
    kept, prior = known_before(problem, base, model, information)
    found = []
    for k, (law, strength) in enumerate(zip(laws, strengths, strict=True), at):
        some = [*kept, k]
        inside, slope = projected(
            information[np.ix_(some, some)], gradient[some], prior[np.ix_(some, some)], [len(kept)]
        )
        if not inside[0, 0] > 1e-8 * information[k, k]:
            continue  # in the span of the fitted parameters
        step = float(slope[0] / inside[0, 0])
        allowed = float(np.clip(step, strength.lower, strength.upper))
        if step * law.passive_sign < 0.0 or (allowed != step and allowed == 0.0):
            continue
        begun, gain = put(law, strength.path[2:], allowed), (2.0 * step - allowed) * allowed * float(inside[0, 0])
        found.append(ScoredLaw(begun, visited, Smoothness(np.inf, gain)))
    return found


def at_null(law: Law) -> Law:
    """A law with a memory without its strength."""
    return put(law, _strength(law, 0).path[2:], 0.0)


def _strength(law: Law, n: int) -> Parameter:
    """The parameter at whose zero a law with a memory is absent."""
    names = ("delay", "factor")
    return next(p for p in law_parameters(law, n) if p.path[-1] in names)
