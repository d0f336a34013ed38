"""A rectifying circuit together with the supply at its storage capacitor."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.shunts.base import TOGETHER, ExtendedCircuit, Shunt, numbers_of
from piezoharvest.description.shunts.bridge import Bridge, balance_of_capacitor, charging_current
from piezoharvest.description.shunts.storage import Storage

OFF, FULL = "off", "full"
RETURN_TIME = 1.0  # s; of states that no motion comes to, so that any is as good
REACHED = 1e-9  # of the voltage to turn on, within which it is reached: a store that begins with it is on


def with_supply(shunt: Shunt) -> Shunt:
    """The circuit with the supply that its storage feeds, if it has one."""
    return Stored(circuit=shunt, storage=shunt.storage) if isinstance(shunt, Bridge) and shunt.storage else shunt


class Supply(NamedTuple):
    """What a supply that is on does on a piece of its load's line, in a phase; arrays of several that are alike.

    Attributes
    ----------
    circuit : Bridge
        The circuit with what the supply draws from it.
    current, conductance : float or array
        Of the piece, A and S.
    share : float or array
        Of what leaves the store, that reaches the load.
    low, high : float or array
        Voltages at the ends of the piece, V.
    duration : float or array
        Of the phase, s; without phases of no effect.
    above, below, after : str
        Supply on the next piece, on the one before, and in the next phase.
    """

    circuit: Bridge
    current: Any
    conductance: Any
    share: Any
    low: Any
    high: Any
    duration: Any
    above: str
    below: str
    after: str


@dataclass(frozen=True, kw_only=True)
class Stored(ExtendedCircuit):
    """A circuit in all its configurations while the supply is off, on, or the store full.

    A configuration is that of the supply with that of the circuit behind it, as in "3 open+": "off", the number of a
    piece of its load's line, or "full"; with phases of the load also the number of the phase, as in "3/1 open+". Then a
    state "timer" holds the time since the phase began, s.

    All pieces but the first and the last are alike, in all phases that send and in all that do not.
    """

    circuit: Bridge
    storage: Storage

    @property
    def pieces(self) -> int:
        """Number of pieces of the load's line."""
        return len(self.storage.knots[0]) - 1

    @property
    def _phases(self) -> range:
        return range(max(1, len(self.storage.phases)))

    def configurations(self) -> tuple[str, ...]:
        levels = (*map(str, range(self.pieces)), FULL)
        supplies = (OFF, *(self._name(level, phase) for phase in self._phases for level in levels))
        return tuple(f"{supply} {own}" for supply in supplies for own in self.circuit.configurations())

    def alike(self) -> tuple[str, ...]:
        pieces, sends = range(self.pieces), [phase.sends for phase in self.storage.phases] or [False]
        levels = dict.fromkeys((tuple(pieces[:1]), tuple(pieces[1:-1]), tuple(pieces[-1:]), (FULL,)))
        groups = [
            [self._name(str(level), phase) for phase in self._phases if sends[phase] == sent for level in some]
            for some in levels
            for sent in (False, True)
        ]
        supplies = (OFF, *(TOGETHER.join(group) for group in groups if group))
        return tuple(f"{supply} {own}" for supply in supplies for own in self.circuit.configurations())

    def states(self, capacitance: float) -> tuple[State, ...]:
        states = self.circuit.states(capacitance)
        if not self.storage.phases:
            return states
        # Of such a size that a phase counts as much as the energy of the store.
        longest = max(np.max(np.real(phase.duration)) for phase in self.storage.phases)
        size = np.real(self.circuit.dc_capacitance * self.storage.turn_on**2) / longest**2
        return (*states, State("timer", size, odd=False, stores=False))

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        supply, own = configuration.split(" ", 1)
        rows = list(self._loaded(supply).equations(own, port, z, dz))
        if _level(supply) == FULL:
            # A full store stays at its limit; from above it, where only a search tries states, it comes back to that.
            rows[balance_of_capacitor(self.circuit, port)] = RETURN_TIME * dz.dc + z.dc - self.storage.limit * port.one
        if self.storage.phases:
            rows.append(dz.timer - (0.0 if supply == OFF else 1.0) * port.one)
        return rows

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        supply, own = configuration.split(" ", 1)
        powers = {name: list(products) for name, products in self._loaded(supply).powers(own, port, z).items()}
        if supply == OFF:
            return powers
        on, voltage = self._supply(supply), self._voltage(supply, own, port, z)
        load = on.current * port.one + on.conductance * voltage
        powers["harvested"].append(Product(on.share, voltage, load))
        powers["shunt_loss"].append(Product(1.0 - on.share, voltage, load))
        if _level(supply) == FULL:
            powers["shunt_loss"].append(Product(1.0, z.dc, self._charging(supply, own, port, z)))
        return powers

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        supply, own = configuration.split(" ", 1)
        guards = [
            guard._replace(target=f"{supply} {guard.target}", conducts=guard.begins_to_conduct)
            for guard in self._loaded(supply).guards(own, port, z)
        ]
        (knots, first), voltage = self.storage.knots, self._voltage(supply, own, port, z)
        if supply == OFF:
            reached = voltage - (1 - REACHED) * knots[first] * port.one
            return [*guards, Guard(reached, f"{self._name(str(first), 0)} {own}", event="supply turns on")]
        guards += self._end_of_phase(supply, own, port, z)
        on, piece = self._supply(supply), self._piece(supply)
        if _level(supply) == FULL:
            return [*guards, Guard(-self._charging(supply, own, port, z), f"{on.below} {own}", event="")]
        if piece == self.pieces - 1:
            guards.append(Guard(z.dc - on.high * port.one, f"{on.above} {own}", event="store is full"))
        else:
            guards.append(Guard(voltage - on.high * port.one, f"{on.above} {own}", event=""))
        falls = on.low * port.one - voltage
        if piece == 0:
            timer = "timer" if self.storage.phases else None
            return [*guards, Guard(falls, f"{on.below} {own}", timer, event="supply turns off")]
        return [*guards, Guard(falls, f"{on.below} {own}", event="")]

    def closed(self, configuration: str, polarity: int) -> str:
        return _behind(configuration, lambda own: self.circuit.closed(own, polarity))

    def opened(self, configuration: str) -> str:
        return _behind(configuration, self.circuit.opened)

    def _name(self, level: str, phase: int) -> str:
        """Configuration of a supply that is on."""
        return f"{level}/{phase}" if self.storage.phases else level

    def _piece(self, supply: str) -> int:
        """Number of the piece of the line on which the load is, the first of those that are alike."""
        level = _level(supply)
        return self.pieces - 1 if level == FULL else int(level)

    def _end_of_phase(self, supply: str, own: str, port: Port, z: SimpleNamespace) -> list[Guard]:
        """Guard: the time of the phase is over, and the next one begins."""
        phases = self.storage.phases
        if not phases:
            return []
        over = z.timer - self._supply(supply).duration * port.one
        event = "packet is sent" if phases[_phase(supply)].sends else ""
        return [Guard(over, f"{self._supply(supply).after} {own}", "timer", event=event)]

    def _loaded(self, supply: str) -> Bridge:
        """The circuit with what the supply draws from it."""
        return self.circuit if supply == OFF else self._supply(supply).circuit

    def _supply(self, supply: str) -> Supply:
        """What a supply that is on does; each is asked for in every configuration of the circuit, several times."""
        if supply not in self._supplies:
            self._supplies[supply] = self._made(supply)
        return self._supplies[supply]

    @cached_property
    def _supplies(self) -> dict[str, Supply]:
        """Supplies that were asked for, by their names."""
        return {}

    def _made(self, supply: str) -> Supply:
        storage = self.storage
        knots, phases = storage.knots[0], storage.phases

        def numbers(number: Callable[[int, int], Any]) -> Any:
            return numbers_of(supply, lambda one: number(self._piece(one), _phase(one)))

        current = numbers(lambda piece, phase: storage.line(piece, phase)[0])
        conductance = numbers(lambda piece, phase: storage.line(piece, phase)[1])
        duration = numbers(lambda _, phase: phases[phase].duration) if phases else 0.0
        low, high = numbers(lambda piece, _: knots[piece]), numbers(lambda piece, _: knots[piece + 1])
        circuit, share = self.circuit.supplying(current, conductance), numbers(storage.share)
        names = (_renamed(supply, change) for change in (self._above, self._below, self._after))
        return Supply(circuit, current, conductance, share, low, high, duration, *names)

    def _above(self, supply: str) -> str:
        """Supply at the voltages above those of a piece."""
        piece = self._piece(supply) + 1
        return self._name(str(piece) if piece < self.pieces else FULL, _phase(supply))

    def _below(self, supply: str) -> str:
        """Supply at the voltages below those of a piece; below a full store is the last piece."""
        piece = self._piece(supply) - (_level(supply) != FULL)
        return OFF if piece < 0 else self._name(str(piece), _phase(supply))

    def _after(self, supply: str) -> str:
        """Supply in the next phase."""
        return self._name(_level(supply), (_phase(supply) + 1) % len(self._phases))

    def _charging(self, supply: str, own: str, port: Port, z: SimpleNamespace) -> Row:
        """Current into the capacitor, or past a full one: what arrives, less what leaves its side."""
        return charging_current(self._loaded(supply), own, port, z)

    def _voltage(self, supply: str, own: str, port: Port, z: SimpleNamespace) -> Row:
        """Voltage of the supply: that of the capacitor, with what its current makes of the resistance in series."""
        if not np.any(self.circuit.smoothing_resistance):
            return z.dc
        return z.dc + self.circuit.dc_resistance * self._charging(supply, own, port, z)


def _first(supply: str) -> str:
    """A supply, the first of several that are alike."""
    return supply.partition(TOGETHER)[0]


def _level(supply: str) -> str:
    """Piece of the load's line, "full" or "off"."""
    return _first(supply).partition("/")[0]


def _phase(supply: str) -> int:
    """Number of the phase of the load, 0 without phases."""
    return int(_first(supply).partition("/")[2] or 0)


def _renamed(supply: str, name: Callable[[str], str]) -> str:
    """A supply, or each of several that are alike, under other names."""
    return TOGETHER.join(map(name, supply.split(TOGETHER)))


def _behind(configuration: str, change: Callable[[str], str]) -> str:
    """A configuration in which that of the circuit has changed."""
    supply, own = configuration.split(" ", 1)
    return f"{supply} {change(own)}"
