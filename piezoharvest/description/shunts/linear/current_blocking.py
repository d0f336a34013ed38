"""Shunt for several modes: branches side by side, each of which blocks the currents of the other modes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import quantity
from piezoharvest.description.shunts.base import LinearShunt
from piezoharvest.description.shunts.linear.current_flowing import check_lengths


@dataclass(frozen=True, kw_only=True)
class CurrentBlocking(LinearShunt):
    """Multi-branch shunt: each branch has inductor, resistor and one blocking circuit for each of the other modes.

    A blocking circuit is a parallel LC circuit with its antiresonance at the frequency of its mode. All branches but
    the mode's own contain the same blocking circuit of that mode. The resistance of a branch includes the losses of its
    coil; `coil_quality` gives those of the blocking coils, as a resistance in series with each.
    """

    kind: ClassVar[str] = "current_blocking"
    source: ClassVar[str] = "Wu, Proc. SPIE 3327, 159-168, 1998; losses after Fleming, Behrens & Moheimani 2003"

    inductances: tuple[float, ...] = quantity("H", "inductance of each branch", above=0)
    resistances: tuple[float, ...] = quantity("ohm", "resistance of each branch", above=0)
    blocking_inductances: tuple[float, ...] = quantity("H", "inductance that blocks each mode", above=0)
    blocking_capacitances: tuple[float, ...] = quantity("F", "capacitance that blocks each mode", above=0)
    coil_quality: float | None = quantity(
        "", "quality w L/R of the blocking coils at antiresonance; default: no losses", default=None, above=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        count = len(self.inductances)
        blocking = {"blocking_inductances": count, "blocking_capacitances": count}
        check_lengths(self, count, {"resistances": count, **blocking})

    def blocks(self) -> Iterator[tuple[int, int, str]]:
        """Number of the branch, number of the mode that is blocked, and name, of every blocking circuit."""
        count = range(len(self.inductances))
        return ((branch, mode, f"{branch}_{mode}") for branch in count for mode in count if mode != branch)

    def coil_resistance(self, mode: int) -> float:
        """Resistance in ohm in series with the coil that blocks a mode."""
        if self.coil_quality is None:
            return 0.0
        return (self.blocking_inductances[mode] / self.blocking_capacitances[mode]) ** 0.5 / self.coil_quality

    def states(self, capacitance: float) -> tuple[State, ...]:
        """Current of every branch, then coil current and voltage of every blocking circuit."""
        found = [State(f"current_{n}", inductance) for n, inductance in enumerate(self.inductances)]
        for _, mode, name in self.blocks():
            found.append(State(f"current_{name}", self.blocking_inductances[mode]))
            found.append(State(f"voltage_{name}", self.blocking_capacitances[mode]))
        return tuple(found)

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        currents = [getattr(z, f"current_{n}") for n, _ in enumerate(self.inductances)]
        branches = [
            inductance * getattr(dz, f"current_{n}") + resistance * currents[n] - port.v
            for n, (inductance, resistance) in enumerate(zip(self.inductances, self.resistances, strict=True))
        ]
        blocks: list[Row] = []
        for n, mode, name in self.blocks():
            current, voltage = getattr(z, f"current_{name}"), getattr(z, f"voltage_{name}")
            branches[n] = branches[n] + voltage
            lost = self.coil_resistance(mode) * current
            blocks.append(self.blocking_inductances[mode] * getattr(dz, f"current_{name}") + lost - voltage)
            blocks.append(self.blocking_capacitances[mode] * getattr(dz, f"voltage_{name}") + current - currents[n])
        return [port.i - sum(currents, start=0.0 * port.one), *branches, *blocks]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        currents = [getattr(z, f"current_{n}") for n, _ in enumerate(self.inductances)]
        pairs = zip(self.resistances, currents, strict=True)
        coils = [(self.coil_resistance(mode), getattr(z, f"current_{name}")) for _, mode, name in self.blocks()]
        return {
            "harvested": [Product(resistance, current, current) for resistance, current in pairs],
            "shunt_loss": [Product(r, i, i) for r, i in coils if self.coil_quality is not None],
        }
