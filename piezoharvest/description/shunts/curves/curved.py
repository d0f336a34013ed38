"""A circuit whose diodes or whose switch have a voltage that is a broken line over their current."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from piezoharvest.description.circuit import Guard, Port, Product, Row
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts.base import ExtendedCircuit, Shunt
from piezoharvest.description.shunts.bridge import Bridge, sign_of
from piezoharvest.description.shunts.curves.voltage_curve import VoltageCurve
from piezoharvest.description.shunts.real_coil import WoundSwitch
from piezoharvest.description.shunts.self_powered.breaker import ElectronicBreaker

# A piece is left for the one before it at so much less than the current of the corner, relatively: behind a resistance
# of an ohm, rounding of a voltage is as much of a microampere, and the two would follow each other without end.
BACK = 1e-5
MOST_CONFIGURATIONS = 4096  # with which a system is set up in a second; its 50 stops then have 2^62 combinations


def takes_diode_curve(cls: type[Shunt]) -> bool:
    """Whether diodes of a kind of circuit may have a curve; else they are straight."""
    return issubclass(cls, Bridge) and not issubclass(cls, ElectronicBreaker)


def with_curves(shunt: Shunt) -> Shunt:
    """The circuit in all pieces of the curves of its diodes and of its switch, if it has any.

    Raises
    ------
    ParameterError
        A self-powered circuit has a curve, or curves have too many points.
    """
    diode = shunt.diode_curve if isinstance(shunt, Bridge) else None
    if diode is not None and not takes_diode_curve(type(shunt)):
        raise ParameterError("diode_curve", f"found in {shunt.kind}, whose breakers have the same straight diodes")
    switch = shunt.switch_curve if isinstance(shunt, WoundSwitch) else None
    if diode is None and switch is None:
        return shunt
    found = Curved(circuit=shunt, diode=diode, closed_switch=switch)
    count = found.size
    if count > MOST_CONFIGURATIONS:
        key = "switch_curve" if switch is not None else "diode_curve"
        allowed = f"at most {MOST_CONFIGURATIONS} are allowed: give fewer points"
        raise ParameterError(key, f"found {count} combinations of pieces and configurations, {allowed}")
    return found


@dataclass(frozen=True, kw_only=True)
class Curved(ExtendedCircuit):
    """A circuit in each of its configurations while its parts are on one piece of their curves.

    In a piece a diode is one with another drop and resistance, and so is the closed switch, for the direction of its
    current. A configuration is named after both pieces with that of the circuit behind them, as in "2,-1 closed+": the
    number of the diodes' piece, and that of the switch's with the sign of its current, which the first piece has not.
    """

    diode: VoltageCurve | None
    closed_switch: VoltageCurve | None

    def configurations(self) -> tuple[str, ...]:
        return tuple(
            _named(diode, switch, own)
            for own in self.circuit.configurations()
            for diode in self._diode_pieces(own)
            for switch in self._switch_pieces(own)
        )

    @property
    def size(self) -> int:
        """Number of configurations."""
        owns = self.circuit.configurations()
        return sum(len(self._diode_pieces(own)) * len(self._switch_pieces(own)) for own in owns)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        pieces, own = _split(configuration)
        return self._at(pieces).equations(own, port, z, dz)

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        pieces, own = _split(configuration)
        return self._at(pieces).powers(own, port, z)

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        pieces, own = _split(configuration)
        every = self._at(pieces).guards(own, port, z)
        guards = [
            guard._replace(target=self._kept(pieces, guard.target), conducts=guard.begins_to_conduct) for guard in every
        ]
        diode, switch = pieces
        if self.diode is not None and sign_of(own):
            rectified = next(-guard.rises for guard in every if not sign_of(guard.target))
            between = _between(self.diode, diode, rectified, port)
            guards += [Guard(rises, _named(piece, switch, own), event="") for piece, rises in between]
        if self.closed_switch is not None and self._is_closed(own):
            guards += self._along_switch(pieces, own, port, z)
        return guards

    def closed(self, configuration: str, polarity: int) -> str:
        pieces, own = _split(configuration)
        return self._kept(pieces, self.circuit.closed(own, polarity))

    def opened(self, configuration: str) -> str:
        pieces, own = _split(configuration)
        return self._kept((pieces[0], 0), self.circuit.opened(own))  # the current of the coil is cut

    def _is_closed(self, own: str) -> bool:
        """Whether the switch is closed in a configuration of the circuit."""
        return self.circuit.opened(own) != own

    def _diode_pieces(self, own: str) -> Sequence[int]:
        """Pieces of the diodes in a configuration of the circuit."""
        return range(self.diode.pieces) if self.diode is not None and sign_of(own) else (0,)

    def _switch_pieces(self, own: str) -> Sequence[int]:
        """Pieces of the switch in a configuration of the circuit, with the sign of the current."""
        if self.closed_switch is None or not self._is_closed(own):
            return (0,)
        return range(1 - self.closed_switch.pieces, self.closed_switch.pieces)

    def _kept(self, pieces: tuple[int, int], own: str) -> str:
        """Configuration in which that of the circuit has changed: pieces stay as far as it has them, else the first."""
        diode, switch = pieces
        has_both = diode in self._diode_pieces(own), switch in self._switch_pieces(own)
        return _named(diode if has_both[0] else 0, switch if has_both[1] else 0, own)

    def _along_switch(self, pieces: tuple[int, int], own: str, port: Port, z: SimpleNamespace) -> list[Guard]:
        """Guards that lead to the next piece of the switch's curve and back."""
        assert self.closed_switch is not None
        diode, switch = pieces
        sides = (1, -1) if switch == 0 else (1 if switch > 0 else -1,)
        return [
            Guard(rises, _named(diode, side * piece, own), event="")
            for side in sides
            for piece, rises in _between(self.closed_switch, abs(switch), side * z.current, port)
        ]

    def _at(self, pieces: tuple[int, int]) -> Any:
        """The circuit with its parts as they are in their pieces."""
        diode, switch = pieces
        found = copy.copy(self.circuit)
        if self.diode is not None:
            drop, resistance = self.diode.piece(diode)
            found.__dict__["diode_drop"] = found.diode_drop + drop
            found.__dict__["diode_resistance"] = found.diode_resistance + resistance
        if self.closed_switch is not None:
            drop, resistance = self.closed_switch.piece(abs(switch))
            found.__dict__["in_line"] = (-drop if switch < 0 else drop, resistance)
        return found


def _named(diode: int, switch: int, own: str) -> str:
    """Configuration with a piece of the diodes and one of the switch, signed by its current."""
    return f"{diode},{f'{switch:+d}' if switch else '0'} {own}"


def _split(configuration: str) -> tuple[tuple[int, int], str]:
    """Pieces of the diodes and of the switch, and the configuration of the circuit."""
    pieces, own = configuration.split(" ", 1)
    diode, switch = pieces.split(",")
    return (int(diode), int(switch)), own


def _between(curve: VoltageCurve, piece: int, current: Row, port: Port) -> Iterator[tuple[int, Row]]:
    """Pieces beside one, with what rises through zero as the current goes there."""
    if piece + 1 < curve.pieces:
        yield piece + 1, current - curve.currents[piece + 1] * port.one
    if piece:
        yield piece - 1, (1.0 - BACK) * curve.currents[piece] * port.one - current
