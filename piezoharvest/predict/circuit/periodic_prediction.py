"""Predicted response in a steady state, with derivatives: of a few periods of a sine, behind any circuit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np

from piezoharvest.description.transducer import Transducer
from piezoharvest.engine.steady_search import EngineError
from piezoharvest.engine.transient.periodic_start import periodic_start
from piezoharvest.engine.transient.variation import PlainRun, SampledRun
from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction, Systems
from piezoharvest.predict.circuit.periodic_drive import PeriodicDrive
from piezoharvest.predict.discrete_model import Setting
from piezoharvest.predict.parameters import Parameter
from piezoharvest.predict.prediction import PredictionError

ADVICE = 'give nominal values closer to the specimen, or omit kind = "periodic" where the record has not settled'


class PeriodicPrediction(CircuitPrediction):
    """A transducer and its circuit in steady state, in a setting with a periodic drive.

    Nothing of where the record begins is free: it follows from the parameters. Effects that change during a record do
    not change in it.

    Parameters
    ----------
    transducer, setting, parameters, felt, systems
        As in `CircuitPrediction`.
    nuisance, relaxed, begin_given, under_way
        Without influence: there are no such numbers, and stops begin where the period before has left them.
    """

    def __init__(
        self, transducer: Transducer, setting: Setting, parameters: Sequence[Parameter] = (),
        nuisance: np.ndarray | None = None, *, relaxed: bool = False, felt: int | None = None,
        systems: Systems | None = None, begin_given: bool = False, under_way: int = 0,
    ) -> None:  # fmt: skip
        super().__init__(transducer, setting, parameters, np.zeros(0), relaxed=True, felt=felt, systems=systems)

    @cached_property
    def excitation(self) -> PeriodicDrive:
        """The drive, periodic before and after the record, too."""
        assert self.setting.harmonics is not None
        base = self.setting.drive == "base_acceleration"
        return PeriodicDrive(harmonics=self.setting.harmonics, size=self.setting.size, base=base)

    @property
    def record_time(self) -> float | None:
        """Nothing changes during the record."""
        return None

    def _run(self, names: Sequence[str], size: int, derivatives: bool) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Blocks (first sample, outputs, derivatives), after a period in which a lagging sensor comes to follow."""
        step, harmonics = self.setting.sample_time, self.excitation.harmonics
        early = int(np.ceil(harmonics.period / step)) if self.transducer.effects else 0
        times = step * np.arange(-early, self.setting.count)
        try:
            start, changes = periodic_start(self.system, self.excitation, float(times[0]), derivatives)
            # From there to the first sample, then on through all.
            times = np.concatenate([[start.clock[0]], times])
            if derivatives:
                run = SampledRun(self.system, times, start, changes, names)
            else:
                run = PlainRun(self.system, times, start, names)
            run.through(0, 1)
            last = len(times) - 1
            for begin, end in pairwise([1, *range(early + size, last, size), last]):
                if isinstance(run, SampledRun):
                    values, slopes = run.through(begin, end)
                else:
                    values = run.through(begin, end)
                    slopes = np.zeros((*values.shape, 0))
                first = 0 if begin == 1 else 1  # the sample before a block is not written again
                yield begin + first - 1 - early, values[first:], slopes[first:]
        except EngineError as error:
            raise PredictionError(f"{error}; {ADVICE}") from None

    def _drive_at(self, samples: np.ndarray) -> np.ndarray:
        return self.excitation.harmonics.at(self.setting.sample_time * samples)
