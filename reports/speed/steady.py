"""Periodic steady states from a cold start, against waiting for them: smoothing capacitors from 1 nF to 1 mF."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from piezoharvest import simulate
from reports.speed.engine import Simulation
from reports.speed.studies import PERIOD, Case, energy_coordinates, sshi
from reports.speed.timing import repeat

CAPACITORS = tuple(10.0 ** np.arange(-9, -2.9, 0.5))
# Waiting is over when the state stays so close to where it ends; it ends where as many periods again change nothing.
SETTLED, NOTHING = 1e-6, 1e-9
FIRST, LOOKS = 64, 128  # periods until the end is first looked for, and looks in a doubling


class Waited(NamedTuple):
    """Where a long transient ends: state, power of the last period (W), periods until it stayed that close to it."""

    state: np.ndarray
    power: float
    periods: int


def measure(capacitors: tuple[float, ...] = CAPACITORS, repeats: int = 5) -> list[dict]:
    """A row for each smoothing capacitor."""
    return [_row(float(capacitor), repeats) for capacitor in capacitors]


def _row(capacitor: float, repeats: int) -> dict:
    case = sshi(capacitor)
    system, excitation = case.objects()
    response = simulate(system, excitation)
    seconds = repeat(lambda: simulate(system, excitation), repeats)
    end = wait(Simulation(case, ledger=True))
    plain = Simulation(case)
    waiting = repeat(lambda: plain.run(end.periods * PERIOD), 1)
    return {
        "smoothing_capacitance": capacitor,
        "converged": bool(response.converged),
        "message": response.message,
        "events_per_period": response.events_per_period,
        "period_evaluations": float(response.periods_evaluated),
        "seconds": seconds.median,
        "state_error": float(np.linalg.norm(_at_phase_zero(case, response) - end.state) / np.linalg.norm(end.state)),
        "power_error": abs(response.harvested_power / end.power - 1),
        "periods_waited": end.periods,
        "seconds_waited": waiting.median,
    }


def _at_phase_zero(case: Case, response) -> np.ndarray:
    w = response.waveforms
    v_h = w.hysteresis_voltage[0]
    readings = (w.displacement[0], w.velocity[0], w.voltage[0] - v_h, v_h, w.dc_voltage[0])
    return energy_coordinates(case, *readings)[0]


def wait(simulation: Simulation) -> Waited:
    """Let a simulation that keeps a ledger run from rest, twice as long again and again, until nothing changes."""
    period, counts, states = simulation.excitation.period, [0], [simulation.reading()]
    while True:
        half = len(states) - 1
        for count in np.unique(np.ceil(np.linspace(counts[-1], max(2 * counts[-1], FIRST), LOOKS + 1)[1:])):
            simulation.run(count * period)
            counts.append(int(count))
            states.append(simulation.reading())
        size = np.linalg.norm(states[-1])
        if np.linalg.norm(states[-1] - states[half]) <= NOTHING * size:
            break
    away = np.linalg.norm(np.array(states) - states[-1], axis=1) > SETTLED * size
    before = simulation.harvested()
    simulation.run((counts[-1] + 1) * period)
    power = (simulation.harvested() - before) / period
    return Waited(simulation.reading(), power, counts[int(np.flatnonzero(away).max()) + 1])
