"""Base class of shunts: linear configurations of a circuit, and the events that switch between them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from piezoharvest.description.circuit import Assignment, Guard, Port, Product, Row, State, Switch
from piezoharvest.description.parameters import Component, ParameterError, described

_MIRROR = str.maketrans("+-", "-+")
TOGETHER = "|"  # between the parts of a word in a name for several configurations


class Leads(NamedTuple):
    """What a circuit that a design makes up may be sized by: the transducer's leads in operation.

    Attributes
    ----------
    capacitance : float
        Clamped one, F.
    frequency : float
        Of the operation, Hz.
    open_voltage : float
        Amplitude at open electrodes, V.
    blocking_voltage : float
        Amplitude that would stop the motion sum T_i x_i against the excitation, V.
    """

    capacitance: float
    frequency: float
    open_voltage: float
    blocking_voltage: float


@dataclass(frozen=True, kw_only=True)
class Shunt(Component):
    """A circuit across the electrodes.

    Subclasses define `kind` (the name in study files) and `source`, and override the methods below. A circuit without
    switches or diodes has the single configuration "linear".

    Raises
    ------
    ParameterError
        One of the others is not linear, or at electrodes that have a shunt.
    """

    kind: ClassVar[str]
    source: ClassVar[str]
    mirrors: ClassVar[bool] = True  # swapped leads make no difference
    shorts: ClassVar[bool] = False  # it holds the electrode voltage at zero
    loaded: ClassVar[bool] = True  # there is a load that may conduct
    sampled: ClassVar[bool] = False  # a controller acts at samples, with whose loop `linear.sampled` deals
    tracks: ClassVar[bool] = False  # it is at work as `tracked`, by the voltage of open electrodes
    unrecorded: ClassVar[str] = ""  # why no measured record may have it, in words
    multiplied: ClassVar[tuple[str, ...]] = ()  # names of products of two rows, which its equations have among z

    electrode: int = described(
        "number of the pair of electrodes to which it is connected; 0 is the transducer's own", default=0
    )
    others: tuple[Shunt, ...] = described(
        "linear circuits that act together with this one, each at its own pair of electrodes", default=()
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "others", tuple(self.others))
        if type(self.electrode) is not int or self.electrode < 0:
            raise ParameterError("electrode", f"found {self.electrode!r}, must be a whole number from 0 on")
        taken = [self.electrode]
        for n, other in enumerate(self.others):
            if not isinstance(other, LinearShunt) or other.others:
                found = getattr(other, "kind", type(other).__name__) + (" with others" if other.others else "")
                allowed = "must be a linear circuit (no switches, no diodes) without others"
                raise ParameterError(f"others.{n}", f"found {found}, {allowed}")
            if other.electrode in taken:
                found = f"found {other.electrode}, which already has a shunt"
                raise ParameterError(f"others.{n}.electrode", f"{found}: each needs its own pair of electrodes")
            taken.append(other.electrode)

    @property
    def taken(self) -> tuple[int, ...]:
        """Numbers of the electrodes that have a shunt, this one's first."""
        return (self.electrode, *(other.electrode for other in self.others))

    def swapped(self, number: int) -> Self:
        """The same circuits where electrodes 0 and those of a number have changed places."""
        if number == 0:
            return self
        places = {0: number, number: 0}
        others = tuple(replace(o, electrode=places.get(o.electrode, o.electrode)) for o in self.others)
        return replace(self, electrode=places.get(self.electrode, self.electrode), others=others)

    @classmethod
    def assumed(cls, capacitance: float, frequency: float) -> tuple[dict[str, Any], str]:
        """Values that a design may assume for keys without a default, and a remark on them.

        `capacitance` is the transducer's clamped one, F; `frequency` that of the operation, Hz.
        """
        return {}, ""

    @classmethod
    def assumed_if_named(cls, leads: Leads, values: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
        """As `assumed`, of a kind that a design tries only where its candidates name it.

        `values` are those of other keys, so far as they are known.
        """
        return {}, ""

    def states(self, capacitance: float) -> tuple[State, ...]:
        """States of the circuit; `capacitance` is the transducer's clamped one, F."""
        return ()

    def configurations(self) -> tuple[str, ...]:
        """Names of the configurations, the initial one first; + and - mark pairs that mirror each other."""
        return ("linear",)

    def possible_states(self, voltage: Any) -> Mapping[str, tuple[Any, Any]]:
        """Least and largest values (SI units) of states at an electrode voltage (V), which parts see to at once."""
        return {}

    def guessed_states(self, voltage: float, rate: float) -> Mapping[str, float]:
        """Likely values (SI units) of states at an electrode voltage (V) that changes at a rate (V/s)."""
        return {}

    def begun(self, voltage: float, states: Mapping[str, float]) -> str:
        """Configuration in which a run begins at an electrode voltage (V) with these values of such states."""
        return self.configurations()[0]

    def alike(self) -> tuple[str, ...]:
        """Names of the configurations, of which one may stand for several that differ in numbers only (`each_of`).

        Equations, powers and guards of such a name have rows and coefficients with a leading axis for these numbers,
        and its guards lead to names that stand for as many.
        """
        return self.configurations()

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        """Residuals that are zero in this configuration: one for the port and one for each state.

        A constraint on the port's voltage is given as its derivative; the guard that leads here ensures it on entry.
        """
        raise NotImplementedError

    def factors(self, port: Port, z: SimpleNamespace) -> Mapping[str, tuple[Row, Row]]:
        """Both factors of each product that `multiplied` names, over voltages, states and earlier products.

        Between events the circuit is then not linear, and the engine goes by steps of a controlled error.
        """
        return {}

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        """Power by destination: "harvested", "shunt_loss", or "source" for the power of an active part."""
        return {}

    def control(self, port: Port) -> Sequence[Product]:
        """Power that control takes from what is harvested."""
        return ()

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        """Events of the circuit itself (diodes that start or stop conducting)."""
        return ()

    def switch(self, capacitance: float, period: float | None) -> Switch | None:
        """The synchronised switch, or None; `period` of the excitation in s, or None if it has none.

        Raises
        ------
        ParameterError
            The timing needs a period and the excitation has none.
        """
        return None

    def closed(self, configuration: str, polarity: int) -> str:
        """Configuration after the switch closes; `polarity` is +1 at a maximum of sum T_i x_i and -1 at a minimum."""
        return configuration

    def opened(self, configuration: str) -> str:
        """Configuration after the switch opens, or its next stage; a state named "current" is set to zero then."""
        return configuration

    def stage(self, configuration: str, capacitance: float) -> Any:
        """Share of the on-time for which the switch holds this configuration.

        A switch with several stages is led from one to the next, and out of the last, by `opened`.
        """
        return 1.0

    def assignments(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Assignment]:
        """What a clocked controller sets, one after the other, at the end of its time in a configuration."""
        return ()

    @property
    def tuned(self) -> tuple[str, ...]:
        """Keys, or places in lists as "numerator.0", that a design tunes where circuits of its class have none."""
        return ()

    def tracked(self, open_voltage: Any) -> Self:
        """The circuit where the peak of the open electrodes' voltage is `open_voltage` (V)."""
        return self

    def settled(self, capacitance: float, omega: float) -> LinearShunt | None:
        """The linear circuit that it becomes under a sine of `omega` (rad/s); None if it does not adapt itself."""
        return None

    def figures(self, states: Mapping[str, float]) -> Mapping[str, float]:
        """Figures that a response has of this circuit, by their names there, from its states at the end of a run."""
        return {}

    def remark(self, events: Collection[str], dc_voltage: float) -> str:
        """What a user has to know of a run with these events and this mean dc voltage (V), or nothing."""
        return ""

    def why_nothing(self, events: Collection[str], voltage: float) -> str:
        """Why nothing is harvested in a run with these events and this amplitude (V) at the electrodes, or nothing."""
        return ""

    def dc_side(self, port: Port, z: SimpleNamespace) -> Row:
        """Voltage of the dc side, V; zero if there is none."""
        return 0.0 * port.one

    @staticmethod
    def mirrored(configuration: str) -> str:
        """Configuration with all signs reversed."""
        return configuration.translate(_MIRROR)


def too_low(voltage: float, against: str) -> str:
    """Text for an amplitude (V) of the electrodes that is too low for something."""
    return f"nothing is harvested: an amplitude of {voltage:.4g} V at the electrodes is not enough for {against}"


@dataclass(frozen=True, kw_only=True)
class LinearShunt(Shunt):
    """A circuit of linear parts: one configuration with a rational admittance."""

    @property
    def has_capacitor_across(self) -> bool:
        """True if its current depends on the rate of the electrode voltage, as through a capacitor across the leads."""
        if self.shorts:
            return False
        none = np.zeros(1)
        port = Port(none, np.full(1, np.nan), none, none, 1.0)
        z = SimpleNamespace(**{state.name: none for state in self.states(1.0)})
        return any(bool(np.any(np.isnan(row))) for row in self.equations("linear", port, z, z))


@dataclass(frozen=True, kw_only=True)
class ExtendedCircuit(Shunt):
    """A circuit with a further part that has states of operation of its own: a supply, a cold start, a curved part.

    Each of these multiplies the configurations; the circuit's own follows behind a blank, as in "cold open+".

    Subclasses define `configurations`, `equations`, `powers`, `guards`, `closed` and `opened`.
    """

    circuit: Any

    @property
    def kind(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Kind of the circuit."""
        return self.circuit.kind

    @property
    def mirrors(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether swapped leads make no difference to the circuit."""
        return self.circuit.mirrors

    def states(self, capacitance: float) -> tuple[State, ...]:
        return self.circuit.states(capacitance)

    def control(self, port: Port) -> Sequence[Product]:
        return self.circuit.control(port)

    def switch(self, capacitance: float, period: float | None) -> Switch | None:
        return self.circuit.switch(capacitance, period)

    def stage(self, configuration: str, capacitance: float) -> Any:
        return self.circuit.stage(own_configuration(configuration), capacitance)

    def dc_side(self, port: Port, z: SimpleNamespace) -> Row:
        return self.circuit.dc_side(port, z)


def own_configuration(configuration: str) -> str:
    """Configuration of the circuit itself, in the name of an extended one."""
    return configuration.split(" ", 1)[1]


def each_of(configuration: str) -> list[str]:
    """Names of the configurations that a name stands for: as many as one of its words has parts, as in "1|2 open+"."""
    if TOGETHER not in configuration:
        return [configuration]
    words = configuration.split(" ")
    place = next(k for k, word in enumerate(words) if TOGETHER in word)
    before, after = words[:place], words[place + 1 :]
    return [" ".join((*before, part, *after)) for part in words[place].split(TOGETHER)]


def numbers_of(word: str, number: Callable[[str], Any]) -> Any:
    """A number of a word; of one in parts those of all, along a leading axis before that of a batch of designs."""
    numbers = [number(part) for part in word.split(TOGETHER)]
    if len(numbers) == 1:
        return numbers[0]
    shapes = {np.shape(each) for each in numbers}
    if len(shapes) > 1:
        numbers = [np.broadcast_to(each, np.broadcast_shapes(*shapes)) for each in numbers]
    return np.array(numbers).reshape(len(numbers), -1, 1)
