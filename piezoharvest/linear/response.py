"""Frequency responses of a transducer with a linear circuit, by exact linear algebra at every frequency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from piezoharvest.counting import counted
from piezoharvest.description.circuit import Product
from piezoharvest.description.parameters import check_kind
from piezoharvest.description.system import System
from piezoharvest.linear.assembly import LinearModel, OperatingPoint, angular, assemble, hysteresis_slope
from piezoharvest.notebook import Row, Shown, axes_for, extent, frame, over

# Responses with their units, {} that of the drive.
_UNITS = {
    "displacement": "m/{}", "velocity": "m/s/{}", "voltage": "V/{}", "current": "A/{}", "charge": "C/{}",
    "harvested_power": "W/{}^2", "mechanical_power": "W/{}^2",
}  # fmt: skip


@dataclass(frozen=True, repr=False)
class FrequencyResponse(Shown):
    """Response to a force of peak value 1 N, or with `base` to a base acceleration of 1 m/s^2.

    Arrays are of shape (f,), or (designs, f) for a batch of designs; powers grow with the square of the drive.

    Attributes
    ----------
    frequencies : (f,) array
        Hz.
    displacement, velocity : complex array
        m/N and m/s/N; participation-weighted sum of the modes.
    voltage, current : complex array
        Electrode voltage and load current, V/N and A/N.
    charge : complex array
        q_p, C/N.
    harvested_power, mechanical_power : array
        Mean power into the load, and mean power that the drive delivers, W/N^2 (of the peak value).
    base : bool
        Units above per m/s^2 instead of N.
    """

    frequencies: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    voltage: np.ndarray
    current: np.ndarray
    charge: np.ndarray
    harvested_power: np.ndarray
    mechanical_power: np.ndarray
    base: bool = False

    @property
    def heading(self) -> str:
        """How many frequencies it has, between which, and to what drive."""
        designs = f"{counted(len(self.displacement), 'design')} at " if np.ndim(self.displacement) > 1 else ""
        return f"{designs}{over(self.frequencies)}, per {'m/s^2 of base acceleration' if self.base else 'N of force'}"

    @property
    def rows(self) -> list[Row]:
        """The ranges of frequency and of each response, complex ones by magnitude."""
        drive = "(m/s^2)" if self.base else "N"
        found = (extent(name, unit.format(drive), getattr(self, name)) for name, unit in _UNITS.items())
        return [extent("frequency", "Hz", self.frequencies), *found]

    def to_frame(self) -> Any:
        """The responses over the frequency (Hz) as a `pandas.DataFrame`, of a batch their ranges; or `ImportError`."""
        if np.ndim(self.displacement) > 1:
            return super().to_frame()
        columns = {name: getattr(self, name) for name in _UNITS}
        return frame({"frequency": self.frequencies, **columns}).set_index("frequency")

    def plot(self, ax: Any = None) -> Any:
        """Draw the displacement over the frequency into axes of matplotlib, in a new figure the voltage below it, too.

        Both are magnitudes, on logarithmic scales; of a batch a line for each design.

        Returns
        -------
        Axes or list of Axes
            The axes given, or those of the new figure.
        """
        axes = axes_for(ax, 2, sharex=True)
        drive = "(m/s²)" if self.base else "N"
        for each, name, unit in zip(axes, ("displacement", "voltage"), ("m", "V"), strict=False):
            sizes = np.abs(getattr(self, name))
            each.plot(self.frequencies, sizes.T)
            each.set(ylabel=f"{name} in {unit}/{drive}", yscale="log" if np.any(sizes) else "linear")
        axes[-1].set(xlabel="frequency in Hz")
        return ax if ax is not None else axes

    @property
    def efficiency(self) -> np.ndarray:
        """Conversion efficiency P_out/P_in."""
        return self.harvested_power / self.mechanical_power


def frequency_response(
    system: System,
    frequencies: Any,
    *,
    base: bool = False,
    amplitude: float | None = None,
    operating_point: OperatingPoint = "stick",
) -> FrequencyResponse:
    """Response of a transducer with a linear shunt to a unit force or unit base acceleration.

    Parameters
    ----------
    system : System
        The shunt must be linear. Components with arrays of shape (designs, 1) make it a batch.
    frequencies : (f,) array or float
        Hz.
    base : bool
        Drive by base acceleration instead of force.
    amplitude : float, optional
        Charge amplitude in C of the describing function that represents the hysteresis (first harmonic, with loss).
    operating_point : "stick", "slip" or sequence of bool
        Hysteresis by its slope, without `amplitude`.

    Raises
    ------
    ParameterError
        The shunt has switches or diodes, or a frequency is not above zero.
    """
    check_kind("system", system, System, "System(transducer, shunt) makes one")
    slope = hysteresis_slope(system.transducer, operating_point, amplitude)
    model = assemble(system.transducer, system.shunt, slope=slope, base=base, operating_point=operating_point)
    return response_of(model, frequencies, base=base)


def response_of(model: LinearModel, frequencies: Any, *, base: bool = False) -> FrequencyResponse:
    """Response of an assembled model, for any number of sets of frequencies (Hz); see `frequency_response`."""
    transfer = model.phasors(angular(frequencies))

    def phasor(row: np.ndarray) -> np.ndarray:
        return transfer(row)[..., 0]

    def mean(products: Sequence[Product]) -> np.ndarray:
        powers = [p.coefficient * np.real(phasor(p.first) * np.conj(phasor(p.second))) / 2 for p in products]
        return sum(powers, np.zeros(np.shape(frequencies)))

    names = ("displacement", "velocity", "voltage", "current", "charge")
    return FrequencyResponse(
        frequencies=np.asarray(frequencies, float),
        **{name: phasor(model.rows[name]) for name in names},
        harvested_power=mean(model.powers.get("harvested", ())),
        mechanical_power=np.real(phasor(model.rows["drive_velocity"])) / 2,
        base=base,
    )
