"""`python -m reports.speed.growth`: how the cost of a period grows with the modes of the host, by pairs of electrodes.

Writes growth.md beside this file: processor time, the least of several runs, and the power of the number of modes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from piezoharvest.description.excitation import SineForce
from piezoharvest.description.shunts import ParallelSSHI, SeriesRL
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Electrode, Mode, Transducer
from piezoharvest.engine import simulate
from piezoharvest.engine.lowering.lower import lower
from piezoharvest.engine.run import Machine
from piezoharvest.engine.work_limit import MAX_WORK
from piezoharvest.output import write_text

MODES, ELECTRODES = (10, 20, 40), (1, 8)
SHORT, LONG = 100, 500  # periods of two transients: what differs is free of what happens once
REPEATS = 5
BASE = Transducer(mass=0.010, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
DRIVE = SineForce(amplitude=0.02, frequency=50.6)


class Cost(NamedTuple):
    """Seconds of one period, and of the whole search for the steady state."""

    modes: int
    electrodes: int
    period: float
    steady: float


def host(modes: int, electrodes: int) -> System:
    """A host with resonances at multiples of the first; an SSHI at one pair of electrodes, RL shunts at the others."""
    rng = np.random.default_rng(1)
    further = tuple(
        Mode(mass=0.01, damping=0.0628 * n, stiffness=986.96 * n**2, coupling=float(1e-3 * rng.uniform(-1, 1)))
        for n in range(2, modes + 1)
    )
    places = tuple(
        Electrode(capacitance=40e-9, coupling=tuple(map(float, 1e-3 * rng.uniform(-1, 1, modes))))
        for _ in range(electrodes - 1)
    )
    others = tuple(SeriesRL(inductance=60.0 / n, resistance=2e3, electrode=n) for n in range(1, electrodes))
    shunt = ParallelSSHI(inductance=0.1, quality=5.0, smoothing_capacitance=1e-6, load_resistance=1e6, others=others)
    transducer = Transducer(
        mass=BASE.mass, damping=BASE.damping, stiffness=BASE.stiffness, coupling=BASE.coupling,
        capacitance=BASE.capacitance, modes=further, electrodes=places,
    )  # fmt: skip
    return System(transducer, shunt)


def least(run: Callable[[], object]) -> float:
    """Least processor time of several runs in s."""
    run()  # compiles
    times = []
    for _ in range(REPEATS):
        begin = time.process_time()
        run()
        times.append(time.process_time() - begin)
    return min(times)


def cost(modes: int, electrodes: int) -> Cost:
    """What a host costs: periods as `make bench` times them, without a ledger of energies, and `simulate`."""
    system, period = host(modes, electrodes), 1 / DRIVE.frequency
    lowered = lower(system, DRIVE)
    machine = Machine(lowered, ledger=False)

    def run(periods: int) -> None:
        lowered.budget.left = MAX_WORK
        if status := machine.run(machine.state(), periods * period):
            raise RuntimeError(f"the engine ended with status {status}")

    short, long = (least(lambda n=n: run(n)) for n in (SHORT, LONG))
    return Cost(modes, electrodes, (long - short) / (LONG - SHORT), least(lambda: simulate(system, DRIVE)))


def main() -> None:
    """Measure and write the page."""
    with threadpool_limits(1):
        rows = [cost(modes, electrodes) for electrodes in ELECTRODES for modes in MODES]
    lines = ["# How the cost grows with the modes", "",
             f"Parallel SSHI at one pair of electrodes, RL shunts at the others; processor time, the least of "
             f"{REPEATS} runs, {date.today().isoformat()}. `python -m reports.speed.growth` makes this page.", "",
             "| pairs of electrodes | modes | a period, us | steady state, ms |", "|---:|---:|---:|---:|"]  # fmt: skip
    lines += [f"| {r.electrodes} | {r.modes} | {1e6 * r.period:.3g} | {1e3 * r.steady:.3g} |" for r in rows]
    for electrodes in ELECTRODES:
        some = [row for row in rows if row.electrodes == electrodes]
        logs = [math.log(row.modes) for row in some]
        period, steady = (
            np.polyfit(logs, [math.log(getattr(row, name)) for row in some], 1)[0] for name in ("period", "steady")
        )
        lines += ["", f"With {electrodes} the period grows as the modes to the power {period:.2f}, the steady state to "
                  f"{steady:.2f}."]  # fmt: skip
    write_text("\n".join(lines) + "\n", Path(__file__).parent / "growth.md")


if __name__ == "__main__":
    main()
