"""Channels of a record: their names, SI units and default columns, and the scaling of raw values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from piezoharvest.description.parameters import Component, ParameterError, described, quantity
from piezoharvest.readers.conversion import unit_factor
from piezoharvest.readers.units import Unit

# SI unit and default column of every channel; in files, time is one of them.
UNITS: Mapping[str, str] = MappingProxyType({
    "time": "s", "force": "N", "displacement": "m", "voltage": "V", "current": "A", "base_acceleration": "m/s^2",
    "velocity": "m/s", "acceleration": "m/s^2", "dc_voltage": "V", "dc_current": "A", "gate": "",
})  # fmt: skip
COLUMNS: Mapping[str, str] = MappingProxyType({
    "time": "time_s", "force": "force_N", "displacement": "displacement_m", "voltage": "voltage_V",
    "current": "current_A", "base_acceleration": "base_acceleration_m_per_s2", "velocity": "velocity_m_s",
    "acceleration": "acceleration_m_s2", "dc_voltage": "dc_voltage_V", "dc_current": "dc_current_A", "gate": "gate",
})  # fmt: skip
# The same columns as the bench and `simulate --out` spell their units, and the other way round.
ALSO: Mapping[str, str] = MappingProxyType({
    "base_acceleration": "base_acceleration_m_s2", "velocity": "velocity_m_per_s",
    "acceleration": "acceleration_m_per_s2",
})  # fmt: skip
# Allowed magnitudes of non-zero samples in SI units: twelve decades beyond any measurement, and below the 9.9e37 and
# 3.4e38 that instruments and single precision write for an overload.
SMALLEST, LARGEST = 1e-30, 1e30
# Which derivative of the displacement a channel is.
RATES: Mapping[str, int] = MappingProxyType({"velocity": 1, "acceleration": 2})
DRIVES = ("force", "voltage", "displacement", "base_acceleration")


_SAME = "give the same unit, or a gain (per raw unit; 1 if the values are correct as they are)"


@dataclass(frozen=True, kw_only=True)
class ChannelSource(Component):
    """Source of the values of a channel, and their scaling: value = gain * raw + offset, in `unit`.

    Attributes
    ----------
    column : str, int, tuple of these, or None
        Name of the column, its number counted from 1, or several that are averaged (two displacement sensors on
        either side of a specimen); default: the channel's own name in the default header.
    unit : str
        Unit of the values, as pint reads it; default the SI unit.
    gain, offset : float
        In `unit` per raw unit (default 1), and in `unit`. Without a unit and a gain, values and offset are in the unit
        that the file states, if any. A gain overrules the file.
    sigma : float, optional
        Known standard deviation of the noise of the values, so after gain and offset, in the unit of the offset.
    file : str, optional
        File with the column, if it is not the record's file.
    """

    column: Any = described(
        "name of the column, or its number counted from 1, or a list of columns that are averaged", default=None
    )
    unit: str = described("unit of the values; default: that of the file, or the SI unit", default="")
    gain: float | None = quantity("", "gain: value per raw unit", default=None)
    offset: float = quantity("", "offset: value at raw zero", default=0.0)
    sigma: float | None = quantity(
        "", "known standard deviation of the noise of the values, after gain and offset", default=None, above=0
    )
    file: str | None = described("file with the column; default: that of the record", default=None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gain == 0:
            raise ParameterError("gain", "found 0, must be any finite number but 0")
        columns = self.column if isinstance(self.column, tuple) else (self.column,)
        for column in columns:
            fine = isinstance(column, str) or (type(column) is int and column > 0)
            if not fine and self.column is not None:
                allowed = "the name of a column, its number counted from 1, or a list of these"
                raise ParameterError("column", f"found {repr(column)[:80]}, must be {allowed}")
        if not columns:
            raise ParameterError("column", "found an empty list, at least one column is needed")

    def columns(self, default: str) -> tuple[str | int, ...]:
        """Columns that are averaged; usually one."""
        found = default if self.column is None else self.column
        return found if isinstance(found, tuple) else (found,)

    def to_si(self, raw: np.ndarray, si: str, stated: Unit | None = None, levels: bool = False) -> np.ndarray:
        """Values in the SI unit of the channel; the raw array itself if no scaling is needed.

        Parameters
        ----------
        raw : (n,) array
        si : str
        stated : Unit, optional
            Unit that the file states for the raw values.
        levels : bool
            The values may be levels: 20 times the logarithm of a magnitude, by the unit "dB" or "dB re UNIT".

        Raises
        ------
        ParameterError
            The file states another unit than the campaign, or one of another quantity, or one that a gain of -1 would
            overrule; the error's key is "unit".
        """
        if levels and (self.unit.startswith("dB") or (not self.unit and stated is not None and stated.of == si)):
            return self._of_levels(raw, si, stated)
        if self.gain is None and stated is not None:
            self._check_stated(stated, si)
        factor = self.factor(si, stated)
        scale, shift = (1.0 if self.gain is None else self.gain) * factor, self.offset * factor
        if self.gain == -1 and not self.unit and stated is not None and stated.si == si and stated.factor != 1:
            # Meant to turn a sign, it would change the unit as well.
            found = f"found the unit {stated.text!r} in the file, which a gain overrules, and gain = -1 without a unit"
            raise ParameterError(
                "unit",
                f'{found}; {{ unit = "{si}", gain = {-stated.factor:.10g} }} reverses the sign of values in that unit',
            )
        values = raw if scale == 1 else scale * raw
        return values if shift == 0 else values + shift

    def _of_levels(self, raw: np.ndarray, si: str, stated: Unit | None) -> np.ndarray:
        """Magnitudes in the SI unit from levels in dB; gain and offset are those of the levels."""
        if stated is not None and stated.firm and self.gain is None and stated.si != "dB":
            found = f"found the unit {stated.text!r} in the file and {self.unit!r} in the campaign"
            raise ParameterError("unit", f"{found}, {_SAME}")
        gain = 1.0 if self.gain is None else self.gain
        zero = unit_factor(_reference(self.unit) or si, si)
        if stated is not None and stated.of and self.gain is None:  # the file says what 0 dB is
            if stated.of != si or (_reference(self.unit) and not np.isclose(stated.factor, zero, rtol=1e-9, atol=0)):
                found = f"found levels in {stated.text!r} in the file and {self.unit!r} in the campaign"
                raise ParameterError("unit", f"{found}, {_SAME}")
            zero = stated.factor
        return zero * 10.0 ** ((gain * raw + self.offset) / 20.0)

    def _check_stated(self, stated: Unit, si: str) -> None:
        """Raise an error unless the units that the campaign and the file state are the same."""
        factor, same = unit_factor(self.unit or si, si), stated.si == si
        if not self.unit and same:
            return
        if stated.si == "dB" and not stated.of and not self.unit:
            raise ParameterError("unit", f'found levels in dB in the file: unit = "dB re {si}" defines 0 dB')
        if stated.firm and not (same and np.isclose(stated.factor, factor, rtol=1e-9, atol=0)):
            wanted = f"{self.unit!r} in the campaign" if self.unit else f"none in the campaign, which means {si!r}"
            raise ParameterError("unit", f"found the unit {stated.text!r} in the file and {wanted}, {_SAME}")

    def reverse(self, si: str, stated: Unit | None) -> str:
        """Keys that give the values the other sign, as text: a gain overrules the unit of the file, and includes it."""
        factor = self.factor(si, stated) / unit_factor(self.unit or si, si)
        gain = -factor * (1.0 if self.gain is None else self.gain)
        offset = f", offset = {-factor * self.offset:.10g}" if self.offset else ""
        sigma = f", sigma = {factor * self.sigma:.10g}" if self.sigma and factor != 1.0 else ""
        return f'unit = "{self.unit or si}", gain = {gain:.10g}{offset}{sigma}'

    def factor(self, si: str, stated: Unit | None) -> float:
        """SI value of one of the unit in which the values are taken to be: the channel's own, or that of the file."""
        if self.unit or stated is None or stated.si != si or self.gain is not None:
            return unit_factor(self.unit or si, si)
        return stated.factor


def check_unit(unit: str, si: str, levels: bool = False) -> None:
    """Raise `ParameterError` unless a unit ("": the SI unit) converts; "dB" and "dB re UNIT" do for `levels`."""
    level = levels and unit.startswith("dB")
    if level and unit != "dB" and not _reference(unit):
        raise ParameterError("unit", f"found {unit!r}, must be 'dB' or 'dB re' with a unit that converts to {si}")
    unit_factor((_reference(unit) if level else unit) or si, si)


def _reference(unit: str) -> str:
    """Unit of 0 dB in "dB re UNIT", "" if it is none."""
    return unit.removeprefix("dB re ").strip() if unit.startswith("dB re ") else ""
