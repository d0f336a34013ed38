"""Netlist with diodes and switches for the solver: another network for each set of them that conducts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezoharvest.bench.solver.loads.network import Laws, Network, Part, described, laws, only_inductors
from piezoharvest.description.shunts.spice_circuit import Branch, SpiceCircuit


class Spice(Network):
    """Circuit of SPICE elements; bit n of its branch says whether the n-th diode or switch conducts.

    A diode is a line of Roff up to Vfwd, and one of Ron from there: it conducts from a voltage on, and until its
    current is the one at which the lines meet.
    """

    def __init__(self, shunt: SpiceCircuit) -> None:
        super().__init__(shunt)
        self.given, self.numbers, self.couplings = shunt.branches, shunt.nodes, shunt.couplings
        self.switching = [branch for branch in self.given if branch.part.kind in "DS"]
        self.guard_count = len(self.switching)
        self.side = shunt.dc_capacitor
        self.found: dict[int, Laws] = {}

    def meet(self, capacitance):
        del capacitance
        self.storage = tuple(branch.value for kind in "CL" for branch in self.given if branch.kind == kind)
        coils = [branch for branch in self.given if branch.kind == "L"]
        place = {coil.name.lower(): n for n, coil in enumerate(coils)}
        self.inductances = np.diag([coil.value for coil in coils])
        for coupling in self.couplings:
            of = [place[name] for name in coupling.of]
            for i in of:
                for j in of:
                    if i != j:
                        self.inductances[i, j] = coupling.value * np.sqrt(coils[i].value * coils[j].value)

    def start(self):
        """Capacitors and inductors without energy, but for what sources in their loops and cutsets leave them.

        Charges and fluxes then move at once, which gives the least energy that they can have.
        """
        from scipy.linalg import null_space

        parts = [self.part(branch) for branch in self.given]
        ends, values, port = described(parts)
        fixed = np.hstack((ends["V"], -port)).T  # potentials that sources and the empty electrodes have
        free = null_space(fixed)
        e = np.linalg.lstsq(fixed, np.append(values["V"], 0.0), rcond=None)[0]
        size = np.sqrt(values["C"])[:, None] * ends["C"].T
        e = e - free @ np.linalg.lstsq(size @ free, size @ e, rcond=None)[0]
        meeting = only_inductors(ends, port)
        softness = np.linalg.inv(self.inductances) if len(self.inductances) else self.inductances
        met = meeting @ ends["L"]
        forced = np.linalg.lstsq(met @ softness @ met.T, -meeting @ ends["I"] @ values["I"], rcond=None)[0]
        return np.append(ends["C"].T @ e, softness @ met.T @ forced)

    @property
    def laws(self) -> Laws:
        """Those of the present branch."""
        if self.branch not in self.found:
            self.found[self.branch] = laws([self.part(branch) for branch in self.given], self.inductances)
        return self.found[self.branch]

    def conducts(self, branch: Branch) -> bool:
        """Whether a diode or switch does in the present branch."""
        return bool(self.branch >> self.switching.index(branch) & 1)

    def part(self, branch: Branch) -> Part:
        """A branch of the netlist as a part of the network."""
        if branch.part.kind not in "DS":
            return Part(branch.kind, branch.nodes, branch.value)
        model = branch.part.model
        if not self.conducts(branch):
            return Part("R", branch.nodes, model["roff"])
        ahead = model["vfwd"] * (1.0 - model["ron"] / model["roff"]) if branch.part.kind == "D" else 0.0
        return Part("R", branch.nodes, model["ron"], ahead)

    @property
    def guard_units(self) -> Sequence[str]:
        """Currents of conducting diodes have the size of the transducer's, which a switch would watch."""
        return ["S" if branch.part.kind == "D" and self.conducts(branch) else "V" for branch in self.switching]

    def guards(self, z, v, i):
        seen = np.vstack((z, 0.0 * v + 1.0, v))
        potential = self.laws.potentials[:, :-1] @ seen
        resistive = [branch for branch in self.given if branch.kind == "R"]
        currents = dict(zip((b.name for b in resistive), self.laws.resistive[:, :-1] @ seen, strict=True))
        found = []
        for branch in self.switching:
            model, on = branch.part.model, self.conducts(branch)
            if branch.part.kind == "S":
                plus, minus = (potential[self.numbers[node]] for node in branch.part.nodes[2:])
                beyond = plus - minus - model["vt"] + (model["vh"] if on else -model["vh"])
            elif on:
                beyond = currents[branch.name] - model["vfwd"] / model["roff"]
            else:
                plus, minus = branch.nodes
                beyond = potential[plus] - potential[minus] - model["vfwd"]
            found.append(-beyond if on else beyond)
        return found

    def fire(self, guard):
        self.branch ^= 1 << guard

    def dc(self, z):
        if self.side is None:
            return None
        branch, sign = self.side
        filled = [each for each in self.given if each.kind == "C"]
        return sign * z[filled.index(branch)]
