"""A circuit whose diodes, switch or dc load are broken lines: voltages over currents, or a current over a voltage."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.base import ExtendedCircuit, Shunt
from piezoharvest.description.shunts.bridge import Bridge, charging_current, sign_of
from piezoharvest.description.shunts.curves.broken_line import BrokenLine
from piezoharvest.description.shunts.curves.load_curve import LoadCurve
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve
from piezoharvest.description.shunts.real_coil import WoundSwitch
from piezoharvest.description.shunts.self_powered.breaker import ElectronicBreaker

# A piece is left for the one before it at so much less than at the corner, relatively: behind a resistance of an ohm,
# rounding of a voltage is as much of a microampere, and the two would follow each other without end.
BACK = 1e-5
MOST_CONFIGURATIONS = 4096  # with which a system is set up in a second; its 50 stops then have 2^62 combinations


def takes_diode_curve(cls: type[Shunt]) -> bool:
    """Whether diodes of a kind of circuit may have a curve; else they are straight."""
    return issubclass(cls, Bridge) and not issubclass(cls, ElectronicBreaker)


class PieceNumbers(NamedTuple):
    """Numbers of the pieces on which parts are; that of the switch has the sign of its current."""

    diode: int = 0
    switch: int = 0
    load: int = 0


def with_curves(shunt: Shunt) -> Shunt:
    """The circuit in all pieces of the curves of its diodes, its switch and its load, if it has any.

    Raises
    ------
    ParameterError
        The breakers of a self-powered circuit have a curve, or curves have too many points.
    """
    diode, load = (shunt.diode_curve, shunt.load_curve) if isinstance(shunt, Bridge) else (None, None)
    if diode is not None and not takes_diode_curve(type(shunt)):
        raise ParameterError("diode_curve", f"found in {shunt.kind}, whose breakers have the same straight diodes")
    switch = shunt.switch_curve if isinstance(shunt, WoundSwitch) else None
    if diode is None and switch is None and load is None:
        return shunt
    found = Curved(circuit=shunt, diode=diode, closed_switch=switch, load=load)
    count = found.size
    if count > MOST_CONFIGURATIONS:
        lines = {"switch_curve": switch, "diode_curve": diode, "load_curve": load}
        key = max(lines, key=lambda key: getattr(lines[key], "pieces", 0))
        allowed = f"at most {MOST_CONFIGURATIONS} are allowed: give fewer points"
        raise ParameterError(key, f"found {count} combinations of pieces and configurations, {allowed}")
    return found


@dataclass(frozen=True, kw_only=True)
class Curved(ExtendedCircuit):
    """A circuit in each of its configurations while its parts are on one piece of their curves.

    In a piece a diode is one with another drop and resistance, and so is the closed switch, for the direction of its
    current; a load takes a constant current beside another conductance. A configuration is named after the pieces with
    that of the circuit behind them, as in "2,-1,0 closed+" (`PieceNumbers`).
    """

    diode: VoltageCurve | None
    closed_switch: VoltageCurve | None
    load: LoadCurve | None

    def configurations(self) -> tuple[str, ...]:
        return tuple(_named(pieces, own) for own in self.circuit.configurations() for pieces in self._pieces(own))

    @property
    def size(self) -> int:
        """Number of configurations."""
        return sum(len(self._pieces(own)) for own in self.circuit.configurations())

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        pieces, own = _split(configuration)
        return self._at(pieces).equations(own, port, z, dz)

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        pieces, own = _split(configuration)
        powers = self._at(pieces).powers(own, port, z)
        if self.load is None:
            return powers
        (current, conductance), voltage = self.load.piece(pieces.load), self._load_voltage(pieces, own, port, z)
        taken = Product(1.0, voltage, current * port.one + conductance * voltage)
        return {**powers, "harvested": [*powers["harvested"], taken]}

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        pieces, own = _split(configuration)
        every = self._at(pieces).guards(own, port, z)
        guards = [
            guard._replace(target=self._kept(pieces, guard.target), conducts=guard.begins_to_conduct) for guard in every
        ]
        if self.diode is not None and sign_of(own):
            rectified = next(-guard.rises for guard in every if not sign_of(guard.target))
            between = _between(self.diode, pieces.diode, rectified, port)
            guards += [Guard(rises, _named(pieces._replace(diode=k), own), event="") for k, rises in between]
        if self.closed_switch is not None and self._is_closed(own):
            guards += self._along_switch(self.closed_switch, pieces, own, port, z)
        if self.load is not None:
            between = _between(self.load, pieces.load, self._load_voltage(pieces, own, port, z), port)
            guards += [Guard(rises, _named(pieces._replace(load=k), own), event="") for k, rises in between]
        return guards

    def closed(self, configuration: str, polarity: int) -> str:
        pieces, own = _split(configuration)
        return self._kept(pieces, self.circuit.closed(own, polarity))

    def opened(self, configuration: str) -> str:
        pieces, own = _split(configuration)
        return self._kept(pieces._replace(switch=0), self.circuit.opened(own))  # the current of the coil is cut

    def _is_closed(self, own: str) -> bool:
        """Whether the switch is closed in a configuration of the circuit."""
        return self.circuit.opened(own) != own

    def _pieces(self, own: str) -> list[PieceNumbers]:
        """Pieces of all parts in a configuration of the circuit."""
        load = range(self.load.pieces) if self.load is not None else (0,)
        each = product(self._diode_pieces(own), self._switch_pieces(own), load)
        return [PieceNumbers(*pieces) for pieces in each]

    def _diode_pieces(self, own: str) -> Sequence[int]:
        """Pieces of the diodes in a configuration of the circuit."""
        return range(self.diode.pieces) if self.diode is not None and sign_of(own) else (0,)

    def _switch_pieces(self, own: str) -> Sequence[int]:
        """Pieces of the switch in a configuration of the circuit, with the sign of the current."""
        if self.closed_switch is None or not self._is_closed(own):
            return (0,)
        return range(1 - self.closed_switch.pieces, self.closed_switch.pieces)

    def _kept(self, pieces: PieceNumbers, own: str) -> str:
        """Configuration in which that of the circuit has changed: pieces stay as far as it has them, else the first."""
        diode = pieces.diode if pieces.diode in self._diode_pieces(own) else 0
        switch = pieces.switch if pieces.switch in self._switch_pieces(own) else 0
        return _named(pieces._replace(diode=diode, switch=switch), own)

    def _along_switch(
        self, curve: VoltageCurve, pieces: PieceNumbers, own: str, port: Port, z: SimpleNamespace
    ) -> list[Guard]:
        """Guards that lead to the next piece of the switch's curve and back."""
        switch = pieces.switch
        sides = (1, -1) if switch == 0 else (1 if switch > 0 else -1,)
        return [
            Guard(rises, _named(pieces._replace(switch=side * piece), own), event="")
            for side in sides
            for piece, rises in _between(curve, abs(switch), side * z.current, port)
        ]

    def _load_voltage(self, pieces: PieceNumbers, own: str, port: Port, z: SimpleNamespace) -> Row:
        """Voltage of the load: that of the capacitor, with what its current makes of the resistance in series."""
        if not np.any(self.circuit.smoothing_resistance):
            return z.dc
        return z.dc + self.circuit.dc_resistance * charging_current(self._at(pieces), own, port, z)

    def _at(self, pieces: PieceNumbers) -> Any:
        """The circuit with its parts as they are in their pieces."""
        found = copy.copy(self.circuit)
        if self.diode is not None:
            drop, resistance = self.diode.piece(pieces.diode)
            found.__dict__["diode_drop"] = found.diode_drop + drop
            found.__dict__["diode_resistance"] = found.diode_resistance + resistance
        if self.closed_switch is not None:
            drop, resistance = self.closed_switch.piece(abs(pieces.switch))
            found.__dict__["in_line"] = (-drop if pieces.switch < 0 else drop, resistance)
        return found if self.load is None else found.supplying(*self.load.piece(pieces.load))


def _named(pieces: PieceNumbers, own: str) -> str:
    """Configuration with the numbers of pieces, that of the switch signed by its current."""
    diode, switch, load = pieces
    return f"{diode},{f'{switch:+d}' if switch else '0'},{load} {own}"


def _split(configuration: str) -> tuple[PieceNumbers, str]:
    """Pieces of the parts, and the configuration of the circuit."""
    pieces, own = configuration.split(" ", 1)
    return PieceNumbers(*map(int, pieces.split(","))), own


def _between(curve: BrokenLine, piece: int, place: Row, port: Port) -> Iterator[tuple[int, Row]]:
    """PieceNumbers beside one, with what rises through zero as the place goes there."""
    if piece + 1 < curve.pieces:
        yield piece + 1, place - curve.places[piece + 1] * port.one
    if piece:
        yield piece - 1, (1.0 - BACK) * curve.places[piece] * port.one - place
