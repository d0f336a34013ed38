"""The protocol between components and equations: what effects see of a builder of equations and of a campaign.

Two builders have it, `equations.terms.Terms` for the engine and the linear view, and `predict.record_model.RecordModel`
for the prediction of measured records; what effects write is checked against it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from piezoharvest.description.circuit import Row
from piezoharvest.description.shunts.base import Shunt


class LumpedMode(Protocol):
    """One mode of a transducer, SI units."""

    @property
    def coupling(self) -> float:
        """Coupling factor, N/V."""
        ...


class LumpedDevice(Protocol):
    """First mode and electrodes of a transducer, SI units."""

    @property
    def all_modes(self) -> Sequence[LumpedMode]:
        """All modes, the first one included."""
        ...

    @property
    def mass(self) -> float:
        """Modal mass of the first mode, kg."""
        ...

    @property
    def damping(self) -> float:
        """Damping of the first mode, N s/m."""
        ...

    @property
    def stiffness(self) -> float:
        """Short-circuit stiffness of the first mode, N/m."""
        ...

    @property
    def coupling(self) -> float:
        """Coupling factor of the first mode, N/V."""
        ...

    @property
    def capacitance(self) -> float:
        """Clamped capacitance, F."""
        ...


class SpecimenRows(Protocol):
    """Rows of the lumped model, which effects combine.

    Attributes
    ----------
    one, time, elapsed, drive, drive_rate : Row
        The constant 1, time as a share of the record and in s since it began, the drive in its unit, and its rate.
    x, u : Row
        Displacement (m) and velocity (m/s) of the first mode.
    q, v_t, v, i : Row
        Charge (C), voltage across the clamped capacitance and at the electrodes (V), load current (A).
    size : (float, float) or None
        Amplitude and frequency (Hz) of the drive, arrays in a batch of designs; None where it has none.
    """

    size: Any
    one: Row
    time: Row
    elapsed: Row
    drive: Row
    drive_rate: Row
    x: Row
    u: Row
    q: Row
    v_t: Row
    v: Row
    i: Row

    @property
    def transducer(self) -> LumpedDevice:
        """The transducer that the rows are of."""
        ...

    @property
    def drive_name(self) -> str:
        """Channel that is imposed: "force", "base_acceleration", "voltage" or "displacement"."""
        ...

    @property
    def strain_charge(self) -> Row:
        """Charge that the motion makes, sum of T_i x_i over the modes, C."""
        ...


class EquationBuilder(SpecimenRows, Protocol):
    """A builder of equations, to which effects add states, elements and terms.

    Attributes
    ----------
    reads : bool
        It has sensors, whose readings effects may change.
    further : mapping of str to Row
        Channels that not every model has, by name.
    """

    reads: bool
    further: Mapping[str, Row]

    def state(self, name: str, storage: complex) -> tuple[Row, Row]:
        """Add a state with energy of about storage z^2/2, and give it an equation; return rows of it and its rate."""
        ...

    def equation(self, residual: Row) -> None:
        """Add an equation: a row that is zero."""
        ...

    def stop(self, row: Row, threshold: float) -> Row:
        """Add a stop operator of a state; return the row of its output."""
        ...

    def product(self, first: Row, second: Row) -> Row:
        """Add the product of two rows; return the row of it."""
        ...

    def power(self, row: Row, exponent: float, *, positive: bool = False) -> Row:
        """Add a power of a row, or of its positive part; return the row of it."""
        ...

    def hinges(self, row: Row, corners: Sequence[tuple[float, Any, Any]], order: int = 1) -> Row:
        """Add the sum of c max(s (x - k), 0)^order / order of a row x over corners (s, k, c); return the row of it.

        The side s is 1 or -1, the order 1 or 2.
        """
        ...

    def curve(self, name: str, row: Row) -> Row:
        """Add a curve of a row, by its name in `nameless.curves.CURVES`; return the row of it."""
        ...

    def charge(self, row: Row) -> None:
        """Add a charge on the electrodes beside C v_t and sum T_i x_i, C."""
        ...

    def draw(self, row: Row) -> None:
        """Add a current that leaves the electrodes beside the load, A."""
        ...

    def push(self, row: Row, mode: int = 0) -> None:
        """Add a force on a mode, N."""
        ...

    def conduct(self, row: Row) -> None:
        """Add a current through the load beside that of its label, which the sensor of the current sees, A."""
        ...

    def read(self, row: Row, channel: str = "displacement") -> None:
        """Add to what the sensor of a channel reads beside the true value, in the channel's unit."""
        ...

    def lag(self, time_constant: float) -> None:
        """Put a first-order lag (s) into the displacement sensor."""
        ...


class EnergyRows(SpecimenRows, Protocol):
    """Rows with those of the states that an effect has added, for its energy and losses."""

    def own(self, name: str) -> tuple[Row, Row]:
        """Return rows of a state or stop of the effect, and of its rate."""
        ...

    @property
    def capacitor_current(self) -> Row:
        """Rate of the charge on the clamped capacitance with what effects add to it, q - sum T_i x_i, A."""
        ...


class CampaignSizes(Protocol):
    """Sizes, times and channels of a campaign, from which effects take start values; SI units.

    `diagnose.start_values.CampaignScales` says what each of them is.
    """

    @property
    def drives(self) -> tuple[str, ...]: ...  # noqa: D102

    @property
    def channels(self) -> tuple[str, ...]: ...  # noqa: D102

    @property
    def loaded(self) -> bool: ...  # noqa: D102

    @property
    def has_tension(self) -> bool: ...  # noqa: D102

    @property
    def displacement(self) -> float: ...  # noqa: D102

    @property
    def capacitance(self) -> float: ...  # noqa: D102

    @property
    def sample_time(self) -> float: ...  # noqa: D102

    @property
    def times(self) -> tuple[float, ...]: ...  # noqa: D102

    @property
    def loads(self) -> tuple[float, ...]: ...  # noqa: D102

    @property
    def shunts(self) -> tuple[Shunt | None, ...]: ...  # noqa: D102

    @property
    def switching(self) -> tuple[float, ...]: ...  # noqa: D102

    @property
    def longest(self) -> float: ...  # noqa: D102

    @property
    def jitter(self) -> float: ...  # noqa: D102

    @property
    def peaks(self) -> Mapping[str, tuple[float, ...]]: ...  # noqa: D102

    @property
    def mains(self) -> Mapping[str, tuple[float, ...]]: ...  # noqa: D102

    @property
    def ends(self) -> Mapping[str, tuple[float, float]]: ...  # noqa: D102

    def resolves_time(self, time_constant: float) -> bool:
        """Return True if records show a process of this time constant, s."""
        ...

    def separates_line(self, channel: str, frequency: float) -> bool:
        """Return True if some record tells a line (Hz) from harmonics of its drive."""
        ...
