"""Time against error: the runs from rest of every alternative, and the record."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from reports.speed import engine, events_ivp, ngspice, reference, studies, words
from reports.speed.drives import Sine, Straight
from reports.speed.equations import Loaded
from reports.speed.exact_numpy import Stepper
from reports.speed.sshi import SSHI
from reports.speed.studies import PERIOD, SAMPLE_RATE, Case
from reports.speed.timing import machine, once

DEPTHS = (6, 10, 14, 18, 24, 30, 36)
TOLERANCES = (1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-11)
METHODS = ("DOP853", "LSODA")
STEPS = (250, 500, 1000, 2000, 4000, 8000)  # in a period
STEPS_IN_SAMPLE = (4, 8, 16, 32, 64, 128)
HOLDS = 1e-3  # relative change of the harvested power when the step is halved


@dataclass(frozen=True)
class Row:
    """One run: seconds for a period (or a sample), and the error of the state."""

    alternative: str
    setting: str
    seconds: float
    error: float
    holds: bool | None = None


@dataclass(frozen=True)
class Sizes:
    """How much is run; the smoke test runs less."""

    timed_periods: int = 10_000
    compared_periods: int = 100
    repeats: int = 7
    samples: int = 10_000
    compared_samples: int = 1000
    halvings: int = 6


def periodic(case: Case, sizes: Sizes) -> dict:
    """Every alternative on one of the periodic studies."""
    times = studies.instants(sizes.compared_periods)
    truth = reference.sshi(case, times)
    span = sizes.timed_periods * PERIOD
    model = SSHI(case.table, Sine(case.table["excitation"]))
    seconds, set_up = engine.time_run(case, span, sizes.repeats, 1 / sizes.timed_periods)
    error = studies.distance(engine.states(case, times), truth.states)
    rows = [Row("piezoharvest", "no step, no tolerance", seconds.median, error)]
    rows += _by_hand(model, times, truth.states, sizes.compared_periods)
    finest = [(f"step T/{n}", PERIOD / n) for n in STEPS[: sizes.halvings]]
    note, found = _ngspice(case, times, truth.states, sizes.compared_periods, finest)
    return {
        **_heading(case, truth), "unit": "period", "compared_periods": sizes.compared_periods,
        "least_seconds": seconds.least, "set_up_seconds": set_up, "ngspice": note, "rows": _plain([*rows, *found]),
    }  # fmt: skip


def recorded(sizes: Sizes) -> dict:
    """Every alternative on the record; compared over its first second."""
    with tempfile.TemporaryDirectory() as folder:
        case = studies.record(Path(folder), sizes.samples)
        force = case.objects()[1].values
        times = np.arange(1, sizes.compared_samples + 1) / SAMPLE_RATE
        truth = reference.record(case, force, SAMPLE_RATE, times)
        whole = (sizes.samples - 1) / SAMPLE_RATE
        seconds, set_up = engine.time_run(case, whole, 3 * sizes.repeats, 1 / sizes.samples)
        error, events = studies.distance(engine.states(case, times), truth.states), engine.events(case, whole)
        rows = [Row("piezoharvest", "no step, no tolerance", seconds.median, error)]
        model = Loaded(case.table, Straight(force, SAMPLE_RATE))
        rows += _by_hand(model, times, truth.states, sizes.compared_samples)
        finest = [(f"step h/{n}", 1 / SAMPLE_RATE / n) for n in STEPS_IN_SAMPLE[: sizes.halvings]]
        every = max(1, sizes.compared_samples // 100)
        last = slice(every - 1, None, every)
        note, found = _ngspice(case, times[last], truth.states[last], sizes.compared_samples, finest)
    return {
        **_heading(case, truth), "unit": "sample", "samples": sizes.samples, "events": events,
        "compared_samples": sizes.compared_samples, "least_seconds": seconds.least, "set_up_seconds": set_up,
        "ngspice": note, "rows": _plain([*rows, *found]),
    }  # fmt: skip


def alone(case: Case, sizes: Sizes) -> dict:
    """The engine by itself on a periodic study, without alternatives to compare it with."""
    periods = max(1, sizes.timed_periods // 50)  # a millisecond, in which the core is often left alone
    seconds, set_up = engine.time_run(case, periods * PERIOD, 5 * sizes.repeats, 1 / periods)
    events = engine.events(case, periods * PERIOD) / periods
    return {
        "case": case.name, "title": case.title, "seconds": seconds.median, "least_seconds": seconds.least,
        "set_up_seconds": set_up, "events": events, "date": machine()["date"],
    }  # fmt: skip


def scaling(case: Case, sizes: Sizes) -> list[dict]:
    """Time of the engine's runs against the number of periods."""
    counts = [sizes.timed_periods // 10, sizes.timed_periods, sizes.timed_periods * 10]
    return [{"periods": n, "seconds": engine.time_run(case, n * PERIOD, 3, 1.0)[0].median} for n in counts]


def _heading(case: Case, truth: reference.Truth) -> dict:
    return {"case": case.name, "title": case.title, "reference_uncertainty": truth.uncertainty}


def _plain(rows: list[Row]) -> list[dict]:
    return [asdict(row) for row in rows]


def _by_hand(model: Loaded, times: np.ndarray, truth: np.ndarray, count: int) -> Iterator[Row]:
    """The hand-written alternatives at all their settings; what was tabulated in a first run is not timed."""

    def row(name: str, setting: str, work: Callable[[], np.ndarray]) -> Row:
        states, seconds = once(work)
        return Row(name, setting, seconds / count, studies.distance(model.readings(states), truth))

    for depth in DEPTHS:
        stepper = Stepper(model, depth)
        stepper.run(times)
        yield row("NumPy exact", f"events to step/2^{depth}", lambda stepper=stepper: stepper.run(times))
    for method in METHODS:
        for rtol in TOLERANCES:
            work = lambda method=method, rtol=rtol: events_ivp.run(model, times, method, rtol)  # noqa: E731
            yield row(f"solve_ivp {method}", f"rtol {words.error(rtol)}", work)


def _ngspice(case: Case, times, truth: np.ndarray, count: int, steps) -> tuple[str, list[Row]]:
    """The exported netlist with its step halved; a row holds if halving once more changes the power by little."""
    if ngspice.NGSPICE is None:
        return ngspice.ABSENT, []
    rows, powers = [], []
    for setting, step in steps:
        outcome = ngspice.run(case, times, step)
        powers.append(outcome.harvested_power)
        holds = len(powers) > 1 and abs(powers[-1] / powers[-2] - 1) < HOLDS
        rows.append(Row("ngspice", setting, outcome.seconds / count, studies.distance(outcome.states, truth), holds))
    return "", rows
