"""Result of a loop's identification: a Prandtl-Ishlinskii operator with its uncertainty, and its inverse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.identify.hysteresis.play_operators import plays

Kind = Literal["stop", "play"]


class LoopError(ValueError):
    """A loop cannot be fitted, or a fit has no inverse or form that is required."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Loop:
    """Prandtl-Ishlinskii operator y = offset + slope u + sum_i w_i P_i(u), with P_i stop or play of threshold r_i.

    Attributes
    ----------
    kind : "stop" or "play"
        Stop: charge to voltage, displacement to force. Play: voltage to displacement or to charge.
    offset : float
        Unit of the output.
    slope : float
        Output per input: for the stop type 1/C.
    thresholds : (n,) array
        Unit of the input, increasing.
    weights : (n,) array
        Output per input, at least 0.
    """

    kind: Kind
    offset: float
    slope: float
    thresholds: np.ndarray
    weights: np.ndarray

    def predict(self, signal: np.ndarray, states: np.ndarray | float = 0.0) -> np.ndarray:
        """Output for an input whose extremes are all sampled.

        Parameters
        ----------
        signal : (samples,) array
        states : (n,) array or float
            Outputs of the play operators before the first sample (a stop operator's is the input minus this); 0 is the
            virgin state. The inverse is exact only if neighbours differ by no more than their thresholds.
        """
        signal = np.asarray(signal, float)
        outputs = plays(signal, self.thresholds, states).outputs
        if self.kind == "stop":
            outputs = signal[:, None] - outputs
        return self.offset + self.slope * signal + outputs @ self.weights

    @property
    def inverse(self) -> Loop:
        """The exact inverse, of the other type: stop operators invert play operators and the reverse.

        Sources: Krejci & Kuhnen, IEE Proc. Control Theory Appl. 148(3), 185-192, 2001. On the virgin curve the output
        is piecewise linear with corners at the thresholds; the inverse has the corners' outputs as thresholds and the
        reciprocal slopes. Its input is the output minus the offset, which `undo` subtracts first.

        Raises
        ------
        LoopError
            The slope is 0: the output of stop operators saturates, that of play operators begins with a dead zone.
        """
        if self.slope <= 0:
            raise LoopError(f"slope: found {self.slope:g}, but an inverse needs a value greater than 0")
        slopes = self._virgin_slopes
        corners = np.cumsum(slopes[:-1] * np.diff(self.thresholds, prepend=0.0))
        inverse = 1.0 / slopes
        play = self.kind == "play"
        return Loop(
            kind="stop" if play else "play", offset=0.0, slope=float(inverse[-1] if play else inverse[0]),
            thresholds=corners, weights=np.abs(np.diff(inverse)),
        )  # fmt: skip

    def undo(self, output: np.ndarray, states: np.ndarray | float = 0.0) -> np.ndarray:
        """Input that gives a required output, by the inverse.

        Parameters
        ----------
        output : (samples,) array
        states : (n,) array or float
            As in `predict`: states of the operator, not of its inverse.

        Raises
        ------
        LoopError
            There is no inverse.
        """
        z = np.broadcast_to(np.asarray(states, float), self.thresholds.shape)
        # As play operators plus a slope, with stop = input - play. States: Kuhnen, European J. Control 9(4), 2003.
        weights = self.weights if self.kind == "play" else -self.weights
        beyond = np.cumsum((weights * z)[::-1])[::-1]
        inverse_states = self._virgin_slopes[1:] * z + beyond - weights * z
        return self.inverse.predict(np.asarray(output, float) - self.offset, inverse_states)

    def hysteresis(self) -> tuple[Hysteresis, float]:
        """Parameters of a transducer: stop operators of charge, and the clamped capacitance in F.

        Raises
        ------
        LoopError
            The operator is of play type (its inverse has this form), or has no slope.
        """
        if self.kind != "stop" or self.slope <= 0:
            raise LoopError(
                f"kind: found {self.kind!r} with slope {self.slope:g}, must be 'stop' with a slope greater than 0"
            )
        r, w = (tuple(map(float, values)) for values in (self.thresholds, self.weights))
        return Hysteresis(thresholds=r, weights=w), 1.0 / self.slope

    @property
    def _virgin_slopes(self) -> np.ndarray:
        """Slopes of the parts of the virgin curve, from the origin outwards; (n + 1,)."""
        passed = np.concatenate(([0.0], np.cumsum(self.weights)))
        return self.slope + (passed if self.kind == "play" else self.weights.sum() - passed)


@dataclass(frozen=True, eq=False, kw_only=True)
class LoopFit(Loop):
    """An operator identified from a record.

    Attributes
    ----------
    offset_std, slope_std : float
    weights_std, thresholds_std : (n,) array
        Standard errors, for coloured residuals. Given thresholds have 0.
    states : (n,) array
        Outputs of the play operators before the first sample of the record.
    rms : float
        Rms of the residual.
    noise : float
        Standard deviation of white noise on the output, from its differences.
    excited : float
        Half the range of the input: thresholds beyond it have no effect.
    unseen : (m,) array
        Given thresholds beyond that, which are not in `thresholds`: for the stop type their weights are part of the
        slope, for the play type they have no effect.
    """

    offset_std: float
    slope_std: float
    weights_std: np.ndarray
    thresholds_std: np.ndarray
    states: np.ndarray
    rms: float
    noise: float
    excited: float
    unseen: np.ndarray

    @property
    def not_identifiable(self) -> tuple[str, ...]:
        """For each parameter that the record does not determine, a sentence with what it determines and a remedy."""
        found = []
        more = f"a record with an input range above {2 * self.excited:.3g} would determine it"
        if len(self.unseen):
            shown = ", ".join(f"{r:.3g}" for r in self.unseen)
            instead = "slope plus their weights" if self.kind == "stop" else "the offset"
            where = f"weights of the thresholds {shown}: beyond half the input range"
            found.append(f"{where}; only {instead} is determined; {more}")
        if self.slope_std > 0.5 * self.slope:
            found.append(
                f"slope: found {self.slope:.3g} +- {self.slope_std:.3g}, only its sum with the narrowest "
                "threshold's weight; more samples after each reversal, or a lower frequency, would determine it"
            )
        for r, w, std in zip(self.thresholds, self.weights, self.weights_std, strict=True):
            if std > 0.5 * w:
                found.append(
                    f"weight of the threshold {r:.3g}: found {w:.3g} +- {std:.3g}, only its sum with the "
                    "neighbours'; loops of amplitudes near the threshold would determine it"
                )
        return tuple(found)
