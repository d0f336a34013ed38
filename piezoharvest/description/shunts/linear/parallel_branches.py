"""Shunt for several modes: a resonant branch, with further ones beside it that have a capacitor."""

from dataclasses import dataclass
from typing import ClassVar

from piezoharvest.description.shunts.linear.current_flowing import CurrentFlowing


@dataclass(frozen=True, kw_only=True)
class ParallelBranches(CurrentFlowing):
    """Multi-branch shunt: a series RL branch for the lowest mode, in parallel with series RLC branches for others.

    There is one capacitance less than there are branches.
    """

    kind: ClassVar[str] = "parallel_branches"
    source: ClassVar[str] = "Hollkamp, J. Intell. Mater. Syst. Struct. 5(1), 49-57, 1994"
    without_capacitor: ClassVar[int] = 1
