"""Parallel switch harvesting on an inductor, by electronic breakers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.shunts.bridge import Bridge
from piezoharvest.description.shunts.self_powered.breaker import ElectronicBreaker
from piezoharvest.description.shunts.self_powered.breaker_states import CHARGED, PULLED, Breakers, breakers_of


@dataclass(frozen=True, kw_only=True)
class SelfPoweredSSHI(ElectronicBreaker, Bridge):
    """Self-powered parallel SSHI: rectifier with a coil in parallel, through which breakers invert the voltage.

    While the bridge conducts, the voltage is constant; it begins to fall when the displacement reverses.
    """

    kind: ClassVar[str] = "self_powered_sshi"
    source: ClassVar[str] = "Liang & Liao, IEEE Trans. Ind. Electron. 59(4), 1950-1960, 2012"
    bridge_marks: ClassVar[tuple[str, ...]] = ("", "+", "-")

    def possible(self, breakers: Breakers) -> bool:
        return super().possible(breakers) and not (breakers.bridge and self._resting(breakers))

    def _resting(self, breakers: Breakers) -> list[str]:
        """Breakers whose envelope capacitors follow a voltage that stays where it is while the bridge conducts."""
        found = [which for which, _ in (*breakers.where(CHARGED), *breakers.where(PULLED))]
        if not found or not self._rests:
            return []
        pulled = np.any(np.real(self.base_resistance) > 0)
        return [which for which in found if not (pulled and breakers.of(which) == PULLED)]

    def states(self, capacitance: float) -> tuple[State, ...]:
        return (*self.breaker_states(capacitance), *self.bridge_states())

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        breakers = breakers_of(configuration)
        sign, rectified = self._bridge(breakers, port, z)
        if sign:
            port_equation = self.conduction(sign, rectified, port, z, dz)
        else:
            port_equation = self.forward(port, z) - self.breaker_current(breakers, port, z)
        own = self.breaker_equations(breakers, port, z, dz)
        return [port_equation, *own, *self.dc_equations(rectified, port, z, dz)]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        breakers = breakers_of(configuration)
        powers = self.bridge_powers(self._bridge(breakers, port, z)[1], port, z)
        powers["shunt_loss"] += [*self.leads_loss(port, z), *self.breaker_losses(breakers, port, z)]
        return powers

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        breakers, guards = breakers_of(configuration), list(super().guards(configuration, port, z))
        if breakers.bridge:
            rectified = self._bridge(breakers, port, z)[1]
            return [*guards, Guard(-rectified, breakers._replace(bridge="").name, conducts=False)]
        resting = self._resting(breakers)
        for mark, sign in (("+", 1), ("-", -1)):
            after = breakers._replace(bridge=mark)
            if after.exists:
                for which in resting:
                    after = after.rest_from(which)
                guards.append(Guard(self.excess(sign, port, z), after.name))
        return guards

    @property
    def _rests(self) -> bool:
        """Whether the voltage stays while the bridge conducts: nothing is left for envelope capacitors to follow."""
        return self.dc_voltage is not None and not np.any(self.resistance(1))

    def _bridge(self, breakers: Breakers, port: Port, z: SimpleNamespace) -> tuple[int, Row]:
        """Sign of the conducting diodes, and the current through them towards the dc side."""
        sign = {"": 0, "+": 1, "-": -1}[breakers.bridge]
        return sign, sign * (self.forward(port, z) - self.breaker_current(breakers, port, z))
