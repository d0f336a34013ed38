"""What a planned record would tell: separation of two models, and standard errors of parameters.

If one model is true, the record raises the other's cost, refitted to all data, by the noncentrality of their
difference: its whitened square less what the other's parameters can take up, which the records so far hold in place
(Atkinson & Fedorov, Biometrika 62(1), 57-70, 1975, for designs that discriminate; Kay, Detection Theory, 1998).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import LinearShunt
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose.experiments.candidates import Planned, scaled
from piezoharvest.diagnose.experiments.reach import Reach
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.evaluation import total_information
from piezoharvest.identify.fitting.levenberg_marquardt import Fit
from piezoharvest.identify.fitting.likelihood import Whitener
from piezoharvest.identify.fitting.model import Model, prediction_of, residual_blocks
from piezoharvest.identify.fitting.output_error import covariance, inverse, linearised
from piezoharvest.identify.fitting.problem import Problem, nuisance_for_model, prior_of
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.predict.discrete_model import setting_of
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.predict.step_counts import with_steps
from piezoharvest.records.record import Record, Signal

DC_SIDE = "dc_voltage", "dc_current"  # channels of circuits with diodes
_IMPOSSIBLE = (PredictionError, ParameterError, np.linalg.LinAlgError, ArithmeticError)


@dataclass(frozen=True, eq=False)
class Known:
    """A model with what the records so far tell of its parameters.

    Attributes
    ----------
    model : Model
    information : (p, p) array
        Inverse covariance of its parameters.
    """

    model: Model
    information: np.ndarray

    @classmethod
    def of(cls, found: Fit) -> Known:
        """A fitted model."""
        p = len(found.model.parameters)
        return cls(found.model, inverse(covariance(found)[:p, :p]))

    @classmethod
    def beyond(cls, problem: Problem, found: Fit, model: Model) -> Known:
        """A model with more parameters or effects than the one that was fitted, by linearisation there."""
        nuisance = nuisance_for_model(problem, found.model, found.nuisance, model)
        information, _, _ = linearised(problem, model, nuisance, found)
        p = len(model.parameters)
        return cls(model, inverse(inverse(information + np.diag(prior_of(problem, model)[1]))[:p, :p]))

    def errors(self, more: np.ndarray | float = 0.0) -> np.ndarray:
        """Standard errors (p,) on the scales of the fit, with further information."""
        return np.sqrt(np.maximum(np.diag(inverse(self.information + more)), 0.0))


@dataclass(frozen=True, eq=False)
class Bench:
    """The bench on which planned records would be measured.

    Attributes
    ----------
    reach : Reach
    nominal : Transducer
    noise : Noise
    offsets : tuple of str
        Channels whose offset is free in every record.
    """

    reach: Reach
    nominal: Transducer
    noise: Noise
    offsets: tuple[str, ...]
    _known: dict = field(init=False, repr=False, default_factory=dict)

    def separation(self, planned: Planned, first: Known, second: Known) -> float:
        """Expected rise of -2 ln L of the wrong one of two models: the smaller one, as either may be true."""
        return min(self._noncentrality(planned, first, second), self._noncentrality(planned, second, first))

    def information(self, planned: Planned, known: Known) -> np.ndarray:
        """Information (p, p) on the parameters of a model that a record of it would add; zero if there is none."""
        p = len(known.model.parameters)
        data = self.data(planned, known.model)
        if data is None:
            return np.zeros((p, p))
        information, _, _ = self._linearised(data, known.model)
        rest = slice(p, None)
        return information[:p, :p] - information[:p, rest] @ inverse(information[rest, rest]) @ information[rest, :p]

    def _noncentrality(self, planned: Planned, truth: Known, rival: Known) -> float:
        data, p = self.data(planned, truth.model), len(rival.model.parameters)
        if data is None:
            return 0.0
        try:
            information, gradient, squares = self._linearised(data, rival.model)
        except _IMPOSSIBLE:
            return 0.0
        information[:p, :p] += rival.information
        felt = np.diag(information) > 0.0
        taken = gradient[felt] @ inverse(information[np.ix_(felt, felt)]) @ gradient[felt]
        return max(float(squares - taken), 0.0)

    def _linearised(self, data: Data, model: Model) -> tuple[np.ndarray, np.ndarray, float]:
        """Information with the priors of the record's own parameters, gradient and sum of squares."""
        problem = Problem([data], self.nominal, self.offsets)
        (nuisance,) = problem.start(model)
        white = Whitener(prediction_of(model, data, nuisance), self.noise, data)
        information, gradient, squares = total_information(model, (nuisance,), [white.sums(model, nuisance)])
        own, p = prior_of(problem, model)[1], len(model.parameters)
        return information + np.diag(np.where(np.arange(len(own)) < p, 0.0, own)), gradient, squares

    def fitting(self, planned: Planned, models: Sequence[Model]) -> Planned:
        """The record with a smaller drive, if it would exceed the range of a sensor: responses are nearly linear."""
        factor = 1.0
        for model in models:
            data = self._predicted(planned, model)
            if data is not None:
                sizes = zip(data.channels, np.abs(data.values).max(axis=0).tolist(), strict=True)
                factor = min(factor, *(self.reach.largest[channel] / size for channel, size in sizes if size > 0))
        # A little less: what is scaled keeps its lowest value, and is not quite linear.
        return planned if factor >= 1.0 else scaled(planned, 0.98 * factor)

    def data(self, planned: Planned, model: Model) -> Data | None:
        """The record as a model predicts it, without noise; None where it cannot, or a sensor's range is exceeded."""
        data = self._predicted(planned, model)
        if data is None or np.any(np.abs(data.values) > [self.reach.largest[c] for c in data.channels]):
            return None
        return data

    def _predicted(self, planned: Planned, model: Model) -> Data | None:
        """`data`, whatever the ranges of the sensors."""
        key = planned, id(model)  # models live as long as the fits that are compared
        if key not in self._known:
            try:
                self._known[key] = self._prediction(planned, model)
            except _IMPOSSIBLE:
                self._known[key] = None
        return self._known[key]

    def _prediction(self, planned: Planned, model: Model) -> Data:
        drive, channels, step = self.reach.drive, self._channels(planned), 1.0 / planned.sample_rate
        blank = self._record(planned, np.zeros((len(planned.time), len(channels))))
        setting = setting_of(drive, planned.shunt, step, blank[drive], self.nominal)
        still = dict.fromkeys(channels, 0.0)
        data = Data("planned", "fit", blank, setting, np.zeros(len(blank)), channels, {}, still)
        (nuisance,) = Problem([data], self.nominal, self.offsets).start(model)
        blocks = residual_blocks(replace(model, parameters=()), data, nuisance, False)
        values = -np.concatenate([residual for _, _, residual, _ in blocks])
        setting = with_steps(setting, [(values[:, n], self.noise.sigma[c]) for n, c in enumerate(channels)])
        return replace(data, record=self._record(planned, values), setting=setting)

    def _channels(self, planned: Planned) -> tuple[str, ...]:
        """Channels of the campaign that the circuit has: without diodes there is no dc side."""
        without = DC_SIDE if isinstance(planned.shunt, LinearShunt) else ()
        return tuple(channel for channel in self.reach.channels if channel not in without)

    def _record(self, planned: Planned, values: np.ndarray) -> Record:
        """Record of the planned drive with responses (samples, channels)."""
        time, sigma = planned.time, self.noise.sigma
        columns = {self.reach.drive: planned.excitation.signal().at(time)}
        for n, channel in enumerate(self._channels(planned)):
            columns[channel] = values[:, n]
        signals = {name: Signal(column, sigma.get(name), "", "", 1) for name, column in columns.items()}
        clock = Signal(time, None, "", "", 1)
        return Record("planned", "records.0", "fit", self.reach.drive, planned.shunt, 0.0, clock, signals)
