"""What a bench can do in a planned record: the table [experiment] of a campaign."""

from __future__ import annotations

from dataclasses import dataclass

from piezoharvest.description.parameters import Component, ParameterError, quantity


@dataclass(frozen=True, kw_only=True)
class BenchLimits(Component):
    """Limits of planned records; what is left out is as the campaign's records show it.

    Attributes
    ----------
    drive : (float, float) or None
        Lowest and highest value of the drive, N or m/s^2.
    frequency : (float, float) or None
        Hz.
    duration, sample_rate : float or None
        Longest record in s, highest sample rate in Hz.
    loads : tuple of float or None
        Resistances in ohm.
    max_displacement, max_voltage, max_current : float or None
        Largest magnitudes that the sensors read, m, V, A.

    Raises
    ------
    ParameterError
        A lower limit is not below the upper one, or the list of loads is empty.
    """

    drive: tuple[float, float] | None = quantity("N or m/s^2", "lowest and highest value of the drive", default=None)
    frequency: tuple[float, float] | None = quantity(
        "Hz", "lowest and highest frequency of the drive", default=None, above=0
    )
    duration: float | None = quantity("s", "longest possible record", default=None, above=0)
    sample_rate: float | None = quantity("Hz", "highest sample rate", default=None, above=0)
    loads: tuple[float, ...] | None = quantity("ohm", "load resistances", default=None, above=0)
    max_displacement: float | None = quantity("m", "largest displacement", default=None, above=0)
    max_voltage: float | None = quantity("V", "largest voltage", default=None, above=0)
    max_current: float | None = quantity("A", "largest current", default=None, above=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("drive", "frequency"):
            pair = getattr(self, name)
            if pair is not None and not pair[0] < pair[1]:
                raise ParameterError(name, f"found {list(pair)}, must be [lowest, highest] with lowest < highest")
        if self.loads == ():
            raise ParameterError("loads", "found an empty list, at least one resistance in ohm is needed")
