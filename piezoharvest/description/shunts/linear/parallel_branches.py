"""Shunt for several modes: a resonant branch, with further ones beside it that have a capacitor."""

from dataclasses import dataclass
from typing import ClassVar

from piezoharvest.description.shunts.linear.current_flowing import CurrentFlowing


@dataclass(frozen=True, kw_only=True)
class ParallelBranches(CurrentFlowing):
    """A branch of inductance and resistance, and beside it branches of inductance, resistance and capacitance.

    The first branch is that of the lowest mode. There is one capacitance less than there are branches.
    """

    kind: ClassVar[str] = "parallel_branches"
    source: ClassVar[str] = "Hollkamp, J. Intell. Mater. Syst. Struct. 5(1), 49-57, 1994"
    without_capacitor: ClassVar[int] = 1
