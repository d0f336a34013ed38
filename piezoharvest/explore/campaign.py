"""What the page of a campaign shows: records beside the identified model, with effects that are switched on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.effects import Effect, registered
from piezoharvest.description.parameters import AS_LABELLED, ParameterError
from piezoharvest.diagnose.selection.start_values import campaign_scales
from piezoharvest.explore.knobs import Knob, around, size
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.measured_responses import FrequencyData
from piezoharvest.identify.fitting.model import nuisance_names, unexplained_blocks
from piezoharvest.identify.preparation import prepared
from piezoharvest.identify.result import Identification, RecordQuality
from piezoharvest.predict.prediction import PredictionError

_JUST_SEEN = 1e-3  # share of a channel's range: the least change that one sees in a plot of it
_SEARCHED = 15  # decades to either side of 1 in SI units, in which an effect begins to be seen
_BELOW, _ABOVE = 0.5, 2.5  # decades of a strength's slider about where it is just seen
_OTHERS = 1.5  # decades of the sliders of other values, as time constants
_STARTS = 40  # start values of an effect that are looked at, for one of each channel


class Seen(NamedTuple):
    """A record beside the model.

    Attributes
    ----------
    x : (n,) array
        Time in s, or frequency in Hz.
    measured, predicted, residual : mapping of str to (n,) array
        By channel in SI units; of a frequency response in dB, the residual relative to the response.
    rms, noise : mapping of str to float
        Of the residual, and what noise alone would leave; empty for a frequency response.
    """

    x: np.ndarray
    measured: Mapping[str, np.ndarray]
    predicted: Mapping[str, np.ndarray]
    residual: Mapping[str, np.ndarray]
    rms: Mapping[str, float]
    noise: Mapping[str, float]


class CampaignExplorer:
    """Records of an identified campaign.

    Parameters
    ----------
    found : Identification

    Attributes
    ----------
    effects : dict of str to Effect
        What can be switched on, by label.
    identified : tuple of str
        Labels of those that the identified model has.
    """

    def __init__(self, found: Identification):
        self.found = found
        device = found.found.model.transducer
        own = {_label(effect): effect for effect in device.effects if _is_switchable(type(effect))}
        fixed = tuple(effect for effect in device.effects if effect not in own.values())
        self._model = replace(found.found.model, parameters=(), felt=None, transducer=replace(device, effects=fixed))
        self._data = [data for role in ("fit", "validate") for data in prepared(found.campaign, role)]
        self.effects = {**own, **_others([data for data in self._data if data.role == "fit"], found)}
        self.identified = tuple(own)

    @property
    def records(self) -> tuple[RecordQuality, ...]:
        """The records, those fitted first."""
        return self.found.records

    def seen(self, number: int, effects: Sequence[Effect] = ()) -> Seen:
        """A record beside the model with some effects; what else was fitted keeps its values.

        Raises
        ------
        PredictionError
            The model cannot follow the record.
        ParameterError
            The effects have no equilibrium.
        """
        data, one = self._data[number], self.found.records[number]
        device = self._model.transducer
        model = replace(self._model, transducer=replace(device, effects=(*device.effects, *effects)))
        with np.errstate(all="ignore"):
            if isinstance(data, FrequencyData):
                return _response(data, data.response(model)[0])
            nuisance = np.array([one.own.get(name, 0.0) for name in nuisance_names(model, data)])
            left = np.concatenate([residual for _, _, residual in unexplained_blocks(model, data, nuisance)])
        measured = data.part(0, len(data))
        shown, predicted, residual = (
            dict(zip(data.channels, part.T, strict=True)) for part in (measured, measured - left, left)
        )
        rms = {channel: float(np.sqrt(np.mean(np.square(values)))) for channel, values in residual.items()}
        time = np.arange(len(data)) * data.setting.sample_time
        return Seen(time, shown, predicted, residual, rms, one.quality.noise)

    def knobs(self, label: str, number: int) -> list[Knob]:
        """Sliders of an effect: its strength, from where the record just shows it, and its other values.

        Empty if the record does not show the effect.
        """
        effect = self.effects[label]
        strength = type(effect).strength()
        others = [size(effect, field.name, f"{label}.{field.name}", _OTHERS) for field in fields(effect)
                  if field is not strength and field.name != strength.name]  # fmt: skip
        if strength.metadata["null"] == AS_LABELLED or label in self.identified:
            first = size(effect, strength.name, f"{label}.{strength.name}", 1.0) or around(
                effect, strength.name, f"{label}.{strength.name}", 2.0, relative=True
            )
        else:
            first = self._strength(effect, f"{label}.{strength.name}", number)
        return [] if first is None else [first, *(knob for knob in others if knob is not None)]

    def _strength(self, effect: Effect, path: str, number: int) -> Knob | None:
        """Slider of a strength whose null is zero or infinity, about where the record just shows it."""
        field, without = type(effect).strength(), self.seen(number)
        sign = -1 if field.metadata["null"] == np.inf else 1
        tried = range(-_SEARCHED, _SEARCHED + 1)  # from below: a model with far too strong an effect takes long
        high = next(
            (n for n in tried[::3] if self._shows(effect, field.name, 10.0 ** (sign * n), number, without)), None
        )
        if high is None:
            return None
        high = next(n for n in (high - 2, high - 1, high) if n == high or
                    self._shows(effect, field.name, 10.0 ** (sign * n), number, without))  # fmt: skip
        ends = sorted((10.0 ** (sign * (high - _BELOW)), 10.0 ** (sign * (high + _ABOVE))))
        limit = field.metadata.get("below")
        ends[1] = min(ends[1], 0.999 * limit) if limit else ends[1]
        return Knob(path, field.metadata["unit"], 10.0 ** (sign * high), *ends, logarithmic=True)

    def _shows(self, effect: Effect, name: str, value: float, number: int, without: Seen) -> bool:
        """True if the record shows the effect at this strength; too strong an effect for the model counts as shown."""
        try:
            found = self.seen(number, [replace(effect, **{name: value})])
        except (ParameterError, PredictionError, ArithmeticError, np.linalg.LinAlgError):
            return value > 1 if type(effect).strength().metadata["null"] != np.inf else value < 1
        changes = [
            np.max(np.abs(found.predicted[channel] - values)) / (np.ptp(without.measured[channel]) or 1.0)
            for channel, values in without.predicted.items()
        ]
        return not max(changes) < _JUST_SEEN  # NaN is no small change


def with_values(effect: Effect, label: str, values: Mapping[str, float]) -> Effect:
    """An effect with the values of its sliders; raises `ParameterError`."""
    own = {path.removeprefix(f"{label}."): value for path, value in values.items() if path.startswith(f"{label}.")}
    return replace(effect, **own)


def telling(shown: Seen, channel: str, count: int) -> np.ndarray:
    """Samples that a plot of some hundred pixels needs: extrema of measured values and residuals in `count` parts."""
    if len(shown.x) <= 4 * count:
        return np.arange(len(shown.x))
    edges = np.linspace(0, len(shown.x), count + 1).astype(int)[:-1]
    chosen: list[int] = []
    for begin, part in zip(edges, np.split(np.arange(len(shown.x)), edges[1:]), strict=True):
        for values in (shown.measured[channel], shown.residual[channel]):
            chosen += [begin + int(np.argmin(values[part])), begin + int(np.argmax(values[part]))]
    return np.unique(chosen)


def _label(effect: Effect) -> str:
    """Name of an effect, with its channel if it has one."""
    channel = getattr(effect, "channel", None)
    return effect.name if channel is None else f"{effect.name} of {channel}"


def _is_switchable(kind: type[Effect]) -> bool:
    """True for effects of the library but lines, whose size in every record only a fit finds."""
    return kind in registered().values() and kind.line is Effect.line


def _others(data: Sequence[Data | FrequencyData], found: Identification) -> dict[str, Effect]:
    """Effects that records may show beside those of the model, by label: one of each kind, or one for each channel."""
    scales, present = campaign_scales(data, found.found), {type(e) for e in found.found.model.transducer.effects}
    shunts: list[Any] = [each.setting.shunt if isinstance(each, Data) else each.record.shunt for each in data]
    labelled: dict[str, Effect] = {}
    for _, kind in sorted(registered().items()):
        if kind not in present and _is_switchable(kind) and any(map(kind.acts_on, shunts)):
            with suppress(ParameterError):  # of one that only records over time have a scale for
                for start in islice(kind.starts(scales), _STARTS):
                    labelled.setdefault(_label(start), start)
    return labelled


def _response(data: FrequencyData, predicted: np.ndarray) -> Seen:
    """A frequency response in dB."""
    record = data.record
    name = "impedance" if record.kind == "impedance" else f"{record.output} over {record.input}"
    parts = (record.response, predicted, (record.response - predicted) / record.response)
    shown, model, residual = ({name: 20 * np.log10(np.maximum(np.abs(part), 1e-300))} for part in parts)
    return Seen(record.frequency, shown, model, residual, {}, {})
