"""A rectifying circuit together with the supply at its storage capacitor."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.shunts.base import ExtendedCircuit, Shunt
from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.storage import Storage

OFF, FULL = "off", "full"
RETURN_TIME = 1.0  # s; of states that no motion comes to, so that any is as good
REACHED = 1e-9  # of the voltage to turn on, within which it is reached: a store that begins with it is on


def with_supply(shunt: Shunt) -> Shunt:
    """The circuit with the supply that its storage feeds, if it has one."""
    return Stored(circuit=shunt, storage=shunt.storage) if isinstance(shunt, Bridge) and shunt.storage else shunt


@dataclass(frozen=True, kw_only=True)
class Stored(ExtendedCircuit):
    """A circuit in all its configurations while the supply is off, on, or the store full.

    A configuration is that of the supply with that of the circuit behind it, as in "3 open+": "off", the number of a
    piece of its load's line, or "full"; with phases of the load also the number of the phase, as in "3/1 open+". Then a
    state "timer" holds the time since the phase began, s.
    """

    circuit: Bridge
    storage: Storage

    @property
    def pieces(self) -> int:
        """Number of pieces of the load's line."""
        return len(self.storage.knots[0]) - 1

    def configurations(self) -> tuple[str, ...]:
        phases, levels = range(max(1, len(self.storage.phases))), (*map(str, range(self.pieces)), FULL)
        supplies = (OFF, *(self._name(level, phase) for phase in phases for level in levels))
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
            rows[self._balance(port)] = RETURN_TIME * dz.dc + z.dc - self.storage.limit * port.one
        if self.storage.phases:
            rows.append(dz.timer - (0.0 if supply == OFF else 1.0) * port.one)
        return rows

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        supply, own = configuration.split(" ", 1)
        powers = {name: list(products) for name, products in self._loaded(supply).powers(own, port, z).items()}
        if supply == OFF:
            return powers
        piece, phase, voltage = self._piece(supply), _phase(supply), self._voltage(supply, own, port, z)
        load, share = self.storage.load(piece, phase, voltage, port.one), self.storage.share(piece, phase)
        powers["harvested"].append(Product(share, voltage, load))
        powers["shunt_loss"].append(Product(1.0 - share, voltage, load))
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
        piece, phase = self._piece(supply), _phase(supply)

        def to(level: str) -> str:
            return f"{self._name(level, phase)} {own}"

        if _level(supply) == FULL:
            return [*guards, Guard(-self._charging(supply, own, port, z), to(str(piece)), event="")]
        if piece == self.pieces - 1:
            guards.append(Guard(z.dc - knots[piece + 1] * port.one, to(FULL), event="store is full"))
        else:
            guards.append(Guard(voltage - knots[piece + 1] * port.one, to(str(piece + 1)), event=""))
        falls = knots[piece] * port.one - voltage
        if piece == 0:
            timer = "timer" if self.storage.phases else None
            return [*guards, Guard(falls, f"{OFF} {own}", timer, event="supply turns off")]
        return [*guards, Guard(falls, to(str(piece - 1)), event="")]

    def closed(self, configuration: str, polarity: int) -> str:
        return _behind(configuration, lambda own: self.circuit.closed(own, polarity))

    def opened(self, configuration: str) -> str:
        return _behind(configuration, self.circuit.opened)

    def _name(self, level: str, phase: int) -> str:
        """Configuration of a supply that is on."""
        return f"{level}/{phase}" if self.storage.phases else level

    def _piece(self, supply: str) -> int:
        """Number of the piece of the line on which the load is."""
        level = _level(supply)
        return self.pieces - 1 if level == FULL else int(level)

    def _end_of_phase(self, supply: str, own: str, port: Port, z: SimpleNamespace) -> list[Guard]:
        """Guard: the time of the phase is over, and the next one begins."""
        phases, phase = self.storage.phases, _phase(supply)
        if not phases:
            return []
        over = z.timer - phases[phase].duration * port.one
        target = f"{self._name(_level(supply), (phase + 1) % len(phases))} {own}"
        return [Guard(over, target, "timer", event="packet is sent" if phases[phase].sends else "")]

    def _balance(self, port: Port) -> int:
        """Place of the store's balance of currents among the equations: behind the port's, in the order of states."""
        return 1 + [state.name for state in self.circuit.states(port.capacitance)].index("dc")

    def _loaded(self, supply: str) -> Bridge:
        """The circuit with what the supply draws from it."""
        if supply == OFF:
            return self.circuit
        if supply not in self._circuits:
            self._circuits[supply] = self.circuit.supplying(*self.storage.line(self._piece(supply), _phase(supply)))
        return self._circuits[supply]

    @cached_property
    def _circuits(self) -> dict[str, Bridge]:
        """Circuits that were asked for, by the name of what the supply does."""
        return {}

    def _charging(self, supply: str, own: str, port: Port, z: SimpleNamespace) -> Row:
        """Current into the capacitor, or past a full one: what arrives, less what leaves its side."""
        at_rest = SimpleNamespace(**{name: 0.0 * port.one for name in vars(z)})
        return -self._loaded(supply).equations(own, port, z, at_rest)[self._balance(port)]

    def _voltage(self, supply: str, own: str, port: Port, z: SimpleNamespace) -> Row:
        """Voltage of the supply: that of the capacitor, with what its current makes of the resistance in series."""
        if not np.any(self.circuit.smoothing_resistance):
            return z.dc
        return z.dc + self.circuit.dc_resistance * self._charging(supply, own, port, z)


def _level(supply: str) -> str:
    """Piece of the load's line, "full" or "off"."""
    return supply.partition("/")[0]


def _phase(supply: str) -> int:
    """Number of the phase of the load, 0 without phases."""
    return int(supply.partition("/")[2] or 0)


def _behind(configuration: str, change: Callable[[str], str]) -> str:
    """A configuration in which that of the circuit has changed."""
    supply, own = configuration.split(" ", 1)
    return f"{supply} {change(own)}"
