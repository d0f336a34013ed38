"""Shunt for several modes: branches side by side, each of which lets the current of its own mode flow."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

from piezoharvest.counting import counted
from piezoharvest.description.circuit import Port, Product, Row, State
from piezoharvest.description.parameters import ParameterError, quantity
from piezoharvest.description.shunts.base import LinearShunt

MOST_BRANCHES = 8  # one patch couples to few modes; states, and with them the time of a simulation, grow with branches


def check_lengths(shunt: LinearShunt, branches: int, wanted: Mapping[str, int]) -> None:
    """Check the number of branches, and that lists of parts have the wanted lengths.

    Raises
    ------
    ParameterError
        A list has another length, or there are too many branches.
    """
    if not 1 <= branches <= MOST_BRANCHES:
        raise ParameterError("inductances", f"found {branches} branches, allowed are 1 to {MOST_BRANCHES}")
    for name, count in wanted.items():
        found = len(getattr(shunt, name))
        if found != count:
            raise ParameterError(
                name,
                f"found {counted(found, 'value')} for {counted(branches, 'branch', 'branches')}, allowed are {count}",
            )


@dataclass(frozen=True, kw_only=True)
class CurrentFlowing(LinearShunt):
    """Multi-branch shunt of series RLC branches in parallel, one for each mode.

    The inductor that lets a branch pass the frequency of its mode and the one that resonates with the electrodes are
    one part. The resistance of a branch includes the losses of its coil.
    """

    kind: ClassVar[str] = "current_flowing"
    source: ClassVar[str] = "Behrens, Moheimani & Fleming, J. Sound Vib. 266(5), 929-942, 2003"
    without_capacitor: ClassVar[int] = 0  # this many branches, the first ones, have no capacitor

    inductances: tuple[float, ...] = quantity("H", "inductance of each branch", above=0)
    resistances: tuple[float, ...] = quantity("ohm", "resistance of each branch", above=0)
    capacitances: tuple[float, ...] = quantity("F", "capacitance of each branch that has one", above=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        count = len(self.inductances)
        check_lengths(self, count, {"resistances": count, "capacitances": count - self.without_capacitor})

    def branches(self) -> Iterator[tuple[int, Any, Any, Any]]:
        """Number, inductance, resistance and capacitance (None without one) of each branch."""
        capacitances = (*(None,) * self.without_capacitor, *self.capacitances)
        parts = zip(self.inductances, self.resistances, capacitances, strict=True)
        return ((n, *values) for n, values in enumerate(parts))

    def states(self, capacitance: float) -> tuple[State, ...]:
        """Current of every branch, then the voltages of the capacitors."""
        currents = [State(f"current_{n}", inductance) for n, inductance, _, _ in self.branches()]
        return (*currents, *(State(f"voltage_{n}", c) for n, _, _, c in self.branches() if c is not None))

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        rows: list[Row] = []
        total = 0.0 * port.one
        for n, inductance, resistance, capacitance in self.branches():
            current, rate = getattr(z, f"current_{n}"), getattr(dz, f"current_{n}")
            total = total + current
            left = inductance * rate + resistance * current - port.v
            if capacitance is not None:
                left = left + getattr(z, f"voltage_{n}")
                rows.append(capacitance * getattr(dz, f"voltage_{n}") - current)
            rows.append(left)
        return [port.i - total, *rows]

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        currents = [(resistance, getattr(z, f"current_{n}")) for n, _, resistance, _ in self.branches()]
        return {"harvested": [Product(resistance, current, current) for resistance, current in currents]}
