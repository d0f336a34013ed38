"""A circuit from a netlist as a shunt: linear between the states of its diodes and switches."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np

from piezoharvest.description.circuit import Guard, Port, Product, Row, State
from piezoharvest.description.netlist import NormalTree, normal_tree
from piezoharvest.description.parameters import ParameterError, check_range, described
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.spice_language.reading import Part, read_parts, refusal

# Each diode and switch doubles the number of configurations, all of which are prepared before a simulation.
MOST_SWITCHING = 7
# Least time constant of a conducting part with the electrodes, as a share of the period, and in s without a period.
# Below a share of 1e-8 conducting diodes missed the end of their current.
STIFFEST, FASTEST = 5e-8, 1e-9
PLUS, MINUS = 1, 0  # numbers of the electrodes' nodes


class Branch(NamedTuple):
    """A part between numbered nodes; diodes and switches are resistances with a voltage in series, kind R."""

    name: str
    kind: str
    nodes: tuple[int, int]
    value: float
    part: Part


class _Solution(NamedTuple):
    """Rows of one configuration: currents of all links, voltages of all tree branches, potentials of nodes."""

    currents: dict[str, Row]
    voltages: dict[str, Row]
    potentials: list[Row]


@dataclass(frozen=True, kw_only=True)
class SpiceCircuit(Shunt):
    """Circuit from a SPICE netlist of R, L, C, K, D, S, V, I and subcircuits, all of them piecewise linear.

    Diodes follow LTspice's law with Ron, Roff and Vfwd; switches close above a control voltage of Vt + Vh and open
    below Vt - Vh. Sources are constant. Coupled inductors have as states the combinations of their currents whose
    energies are independent of each other.

    Raises
    ------
    ParameterError
        Part of the netlist is not understood or not piecewise linear (the message names its line), or the circuit has
        no solution.
    """

    kind: ClassVar[str] = "spice"
    source: ClassVar[str] = (
        "Bryant, Proc. IEE C 106(9), 174-188, 1959 (normal tree); LTspice help, D. Diode, S. Voltage controlled switch"
    )

    netlist: str = described("text of the netlist")
    port: Sequence[str] = described("nodes of the electrodes, plus and minus", default=("p", "0"))
    load: Sequence[str] = described("resistors and sources whose power is harvested", default=())
    subcircuit: str | None = described("subcircuit of the netlist that is used as the circuit", default=None)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("port", "load"):
            object.__setattr__(self, name, _words(name, getattr(self, name)))
        if type(self.netlist) is not str:
            raise ParameterError("netlist", f"found {type(self.netlist).__name__}, must be a text")
        self._check_topology()

    @cached_property
    def _circuit(self) -> tuple[tuple[Branch, ...], dict[str, int], list[Part]]:
        """Branches, numbers of the nodes, and couplings."""
        parts, pins = read_parts(self.netlist, self.subcircuit)
        port = pins[:2] if self.subcircuit else self.port
        if len(port) != 2 or port[0] == port[1]:
            raise ParameterError("port", f"found {list(port)}, allowed are two different nodes")
        if not parts:
            raise ParameterError("netlist", "it has no elements; the first line is a title")
        numbers = {node: n for n, node in zip((PLUS, MINUS), port, strict=True)}
        branches: list[Branch] = []
        names: set[str] = set()
        for part in parts:
            if part.name.lower() in names:
                raise refusal(part.line, f"{part.name}: found a second time, each name may be used once")
            names.add(part.name.lower())
            if part.kind in "RLC" and not part.value > 0:
                raise refusal(part.line, f"{part.name}: found {part.value:g}, must be a value greater than 0")
            check_range(f"netlist: line {part.line}: {part.name}", part.value, inverted=part.kind in "RLC")
            for key, value in part.model.items():
                check_range(f"netlist: line {part.line}: {key} of {part.name}", value, inverted=key in ("ron", "roff"))
            if part.kind == "K":
                continue
            ends = tuple(numbers.setdefault(node, len(numbers)) for node in part.nodes)
            if ends[0] != ends[1]:  # what joins a node to itself does nothing
                kind = "R" if part.kind in "DS" else part.kind
                branches.append(Branch(part.name, kind, (ends[0], ends[1]), part.value, part))
        self._check_names(branches, numbers, port)
        return tuple(branches), numbers, [part for part in parts if part.kind == "K"]

    def _check_names(self, branches: list[Branch], numbers: Mapping[str, int], port: Sequence[str]) -> None:
        used = {node for branch in branches for node in branch.nodes}
        for node, number in zip(port, (PLUS, MINUS), strict=True):
            if number not in used:
                raise ParameterError("port", f"no element is connected to node {node!r}")
        loads = {branch.name.lower(): branch for branch in branches}
        for name in self.load:
            if name not in loads or loads[name].part.kind not in "RVI":
                known = ", ".join(b.name for b in branches if b.part.kind in "RVI") or "none"
                raise ParameterError("load", f"found {name!r}, allowed are {known}")
        if len(self._switching_of(branches)) > MOST_SWITCHING:
            found = f"found {len(self._switching_of(branches))} diodes and switches, allowed are {MOST_SWITCHING}"
            raise ParameterError("netlist", found)
        if used != set(range(len(numbers))):
            node = next(node for node, number in numbers.items() if number not in used)
            raise ParameterError("netlist", f"only a control input is connected to node {node!r}")

    @staticmethod
    def _switching_of(branches: Iterable[Branch]) -> list[Branch]:
        return [branch for branch in branches if branch.part.kind in "DS"]

    def _tree(self, configuration: str) -> NormalTree:
        """Tree with as many sources of voltage and capacitors, and as few of current and inductors, as there can be.

        Of the resistances the small ones are in it: voltages of a conducting diode are then not differences of large
        ones, whose rounding would let it block at another instant than it conducts.
        """
        if configuration not in self._trees:
            on = self._on(configuration)
            ordered = sorted(self.branches, key=lambda e: self._law(e, on)[0] if e.kind == "R" else 0.0)
            self._trees[configuration] = normal_tree(cast(Any, ordered))
        return self._trees[configuration]

    @cached_property
    def _trees(self) -> dict[str, NormalTree]:
        return {}

    def _check_topology(self) -> None:
        """Raise `ParameterError` for parts that hang in the air, loops of sources and currents without a path."""
        branches = self._circuit[0]
        reached, grew = {PLUS, MINUS}, True
        while grew:
            grew = False
            for branch in branches:
                if len(reached & set(branch.nodes)) == 1:
                    reached |= set(branch.nodes)
                    grew = True
        for branch in branches:
            if not reached & set(branch.nodes):
                raise refusal(branch.part.line, f"{branch.name} is not connected to the port, even through others")
        topology = self._tree("none")
        for branch in topology.links:
            if branch.kind == "V":
                raise refusal(self._line(branch.name), f"{branch.name} is in a loop of sources, or across the port")
        for branch in topology.tree:
            if branch.kind == "I":
                raise refusal(self._line(branch.name), f"{branch.name} has no path for its current")
        _ = self._inductances

    def _line(self, name: str) -> int:
        return next(branch.part.line for branch in self.branches if branch.name == name)

    @cached_property
    def _inductances(self) -> tuple[list[Branch], np.ndarray, np.ndarray, np.ndarray]:
        """Inductors, their matrix (H), and its eigenvalues and vectors."""
        coils = [branch for branch in self._circuit[0] if branch.kind == "L"]
        places = {coil.name.lower(): n for n, coil in enumerate(coils)}
        matrix = np.diag([coil.value for coil in coils]) if coils else np.zeros((0, 0))
        for coupling in self._circuit[2]:
            if not 0 < abs(coupling.value) < 1:
                found = f"found {coupling.value:g}, must have a magnitude between 0 and 1"
                raise refusal(coupling.line, f"{coupling.name}: {found}")
            for first, second in itertools.combinations(coupling.of, 2):
                if first not in places or second not in places:
                    missing = first if first not in places else second
                    raise refusal(
                        coupling.line, f"{coupling.name}: found {missing!r}, which is not an inductor of this circuit"
                    )
                i, j = places[first], places[second]
                matrix[i, j] = matrix[j, i] = coupling.value * np.sqrt(matrix[i, i] * matrix[j, j])
        size = np.sqrt(np.diag(matrix))
        share, vectors = np.linalg.eigh(matrix / np.outer(size, size)) if coils else (np.zeros(0), matrix)
        if coils and share[0] <= 1e-12:
            line = self._circuit[2][0].line
            raise refusal(
                line, f"{self._circuit[2][0].name}: these couplings together do not give a positive stored energy"
            )
        # Currents are vectors/size @ states, whose energy is share * state^2 / 2: states in units of sqrt(H) A.
        return coils, matrix, share, vectors / size[:, None]

    @property
    def branches(self) -> tuple[Branch, ...]:
        """All parts but couplings, in the order of the netlist."""
        return self._circuit[0]

    @property
    def coils(self) -> tuple[list[Branch], np.ndarray]:
        """Inductors, and the matrix that gives their currents from the states."""
        return self._inductances[0], self._inductances[3]

    @property
    def couplings(self) -> list[Part]:
        """Couplings of inductors."""
        return self._circuit[2]

    @property
    def nodes(self) -> dict[str, int]:
        """Numbers of the nodes by name; the port is 1 and 0."""
        return self._circuit[1]

    def states(self, capacitance: float) -> tuple[State, ...]:
        odd = not self._switching_of(self.branches)
        share, (charged, flowing) = self._inductances[2], self._start
        voltages = [State(f"voltage_{b.name}", b.value, odd, initial=charged[b.name]) for b in self.branches
                    if b.kind == "C"]  # fmt: skip
        return (*voltages, *(State(f"flux_{n}", float(share[n]), odd, initial=flowing[n]) for n in range(len(share))))

    @cached_property
    def _start(self) -> tuple[dict[str, float], np.ndarray]:
        """Voltages of the capacitors by name, and fluxes, when the sources are switched on.

        Where a loop has nothing but sources and capacitors, and a cutset nothing but sources and inductors, charges and
        fluxes move at once: to the least energy that the sources leave.
        """
        tree, links, cut = self._tree("none")
        inner = {kind: [n for n, e in enumerate(tree) if e.kind == kind] for kind in "VCL"}
        outer = {kind: [n for n, e in enumerate(links) if e.kind == kind] for kind in "ICL"}

        def crossed(own: str, other: str) -> np.ndarray:
            return cut[1:][np.ix_(inner[own], outer[other])]

        held = np.array([tree[n].value for n in inner["V"]])
        stored, linked = (np.array([of[n].value for n in where["C"]]) for of, where in ((tree, inner), (links, outer)))
        imposed = crossed("V", "C").T @ held
        weighed = crossed("C", "C") * linked
        voltages = np.linalg.solve(np.diag(stored) + weighed @ crossed("C", "C").T, -weighed @ imposed)
        charged = {tree[n].name: float(v) for n, v in zip(inner["C"], voltages, strict=True)}
        loops = crossed("C", "C").T @ voltages + imposed
        charged |= {links[n].name: float(v) for n, v in zip(outer["C"], loops, strict=True)}
        coils, matrix, _, vectors = self._inductances
        place = {coil.name: n for n, coil in enumerate(coils)}
        free, bound = [place[links[n].name] for n in outer["L"]], [place[tree[n].name] for n in inner["L"]]
        follows, forced = np.zeros((len(coils), len(free))), np.zeros(len(coils))
        follows[free], follows[bound] = np.eye(len(free)), -crossed("L", "L")
        forced[bound] = -crossed("L", "I") @ np.array([links[n].value for n in outer["I"]])
        own = np.linalg.solve(follows.T @ matrix @ follows, -follows.T @ matrix @ forced)
        return charged, np.linalg.solve(vectors, follows @ own + forced)

    def configurations(self) -> tuple[str, ...]:
        names = [branch.name for branch in self._switching_of(self.branches)]
        return tuple(_configured(dict(zip(names, on, strict=True))) for on in self._states_of_switches(len(names)))

    @staticmethod
    def _states_of_switches(count: int) -> list[tuple[bool, ...]]:
        return list(itertools.product((False, True), repeat=count))

    def _on(self, configuration: str) -> dict[str, bool]:
        """Whether each diode and switch conducts."""
        conducting = configuration.split()
        return {branch.name: branch.name in conducting for branch in self._switching_of(self.branches)}

    @staticmethod
    def mirrored(configuration: str) -> str:
        return configuration

    def equations(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace) -> Sequence[Row]:
        tree, links, cut = self._tree(configuration)
        none, found = 0.0 * port.one, self._solve(configuration, port, z, dz)
        currents = [found.currents[e.name] for e in links]
        voltages = [port.v, *(found.voltages[e.name] for e in tree)]
        coils, _, _, vectors = self._inductances
        rates = dict(zip([coil.name for coil in coils], _combined(vectors, self._fluxes(dz), none), strict=True))
        # Only loops of capacitors and cutsets of inductors are differentiated: sources in them are constant.
        current_rates = [rates[e.name] if e.kind == "L" else none for e in links]
        voltage_rates = [port.dv, *(getattr(dz, f"voltage_{e.name}") if e.kind == "C" else none for e in tree)]
        equations = [port.i - _sum(cut[0], currents, none)]
        for row, e in zip(cut[1:], tree, strict=True):
            if e.kind == "C":
                equations.append(e.value * getattr(dz, f"voltage_{e.name}") + _sum(row, currents, none))
            elif e.kind == "L":
                equations.append(rates[e.name] + _sum(row, current_rates, none))
        for column, e in zip(cut.T, links, strict=True):
            if e.kind == "L":
                equations.append(self._induced(e.name, rates, none) - _sum(column, voltages, none))
            elif e.kind == "C":
                equations.append(getattr(dz, f"voltage_{e.name}") - _sum(column, voltage_rates, none))
        return equations

    def guards(self, configuration: str, port: Port, z: SimpleNamespace) -> Sequence[Guard]:
        found, on = self._solve(configuration, port, z, None), self._on(configuration)
        guards: list[Guard] = []
        for branch in self._switching_of(self.branches):
            model, target = branch.part.model, _configured({**on, branch.name: not on[branch.name]})
            if branch.part.kind == "D" and on[branch.name]:
                # The current where the two lines of its law meet: as a voltage this would be lost in rounding.
                least = model["vfwd"] / model["roff"]
                excess = self._through(branch, found, configuration) - least * port.one
            elif branch.part.kind == "D":
                excess = self._across(branch, found) - model["vfwd"] * port.one
            else:
                plus, minus = (found.potentials[self.nodes[node]] for node in branch.part.nodes[2:])
                level = model["vt"] + (-model["vh"] if on[branch.name] else model["vh"])
                excess = plus - minus - level * port.one
            guards.append(Guard(-excess if on[branch.name] else excess, target, conducts=not on[branch.name]))
        return guards

    def powers(self, configuration: str, port: Port, z: SimpleNamespace) -> Mapping[str, Sequence[Product]]:
        found = self._solve(configuration, port, z, None)
        powers: dict[str, list[Product]] = {"harvested": [], "shunt_loss": [], "source": []}
        for branch in self.branches:
            if branch.kind in "LC":
                continue
            across, through = self._across(branch, found), self._through(branch, found, configuration)
            loaded = branch.name.lower() in self.load
            delivers = branch.kind in "VI" and not loaded
            category = "harvested" if loaded else "source" if delivers else "shunt_loss"
            powers[category].append(Product(-1.0 if delivers else 1.0, across, through))
        return powers

    def switch(self, capacitance: float, period: float | None) -> None:
        """No synchronised switch; raise `ParameterError` where a part conducts too well to be told from a short."""
        # In a fit there is a capacitance for each change of a parameter, which are all but the same.
        least = (STIFFEST * period if period is not None else FASTEST) / float(np.min(np.real(capacitance)))
        for branch in self._switching_of(self.branches):
            if branch.part.model["ron"] < least:
                found = f"found Ron={branch.part.model['ron']:g} ohm, must be {least:.3g} ohm or more"
                why = "so that its time constant with the electrodes is not lost in the rounding of a period"
                raise refusal(branch.part.line, f"{branch.name}: {found}, {why}")

    def dc_side(self, port: Port, z: SimpleNamespace) -> Row:
        """Voltage of the capacitor across the first load of a circuit with diodes or switches; else zero."""
        found = self.dc_capacitor
        return 0.0 * port.one if found is None else found[1] * getattr(z, f"voltage_{found[0].name}")

    @property
    def dc_capacitor(self) -> tuple[Branch, float] | None:
        """Capacitor across the first load of a circuit with diodes or switches, and 1 or -1: its sign on the load."""
        if self._switching_of(self.branches) and self.load:
            load = next(branch for branch in self.branches if branch.name.lower() == self.load[0])
            for branch in self.branches:
                if branch.kind == "C" and set(branch.nodes) == set(load.nodes):
                    return branch, 1.0 if branch.nodes == load.nodes else -1.0
        return None

    def _fluxes(self, z: SimpleNamespace) -> list[Row]:
        return [getattr(z, f"flux_{n}") for n in range(len(self._inductances[2]))]

    def _induced(self, name: str, rates: Mapping[str, Row], none: Row) -> Row:
        """Voltage across an inductor."""
        coils, matrix, _, _ = self._inductances
        place = [coil.name for coil in coils].index(name)
        return _sum(matrix[place], [rates[coil.name] for coil in coils], none)

    def _law(self, branch: Branch, on: Mapping[str, bool]) -> tuple[float, float]:
        """Resistance and voltage in series of a resistor, a diode or a switch."""
        if branch.part.kind == "R":
            return branch.value, 0.0
        model = branch.part.model
        resistance = model["ron" if on[branch.name] else "roff"]
        if branch.part.kind == "D" and on[branch.name]:
            return resistance, model["vfwd"] * (1 - model["ron"] / model["roff"])
        return resistance, 0.0

    def _solve(self, configuration: str, port: Port, z: SimpleNamespace, dz: SimpleNamespace | None) -> _Solution:
        """Resistive part: (R_l + F' R_t F) i_l = voltages of the rest; without dz, rows with rates are left out."""
        tree, links, cut = self._tree(configuration)
        none, on, one = 0.0 * port.one, self._on(configuration), port.one
        coils, _, _, vectors = self._inductances
        flowing = dict(zip([coil.name for coil in coils], _combined(vectors, self._fluxes(z), none), strict=True))
        in_tree = ["port", *(e.kind for e in tree)]
        rows = {kind: [n for n, k in enumerate(in_tree) if k == kind] for kind in ("port", "V", "C", "R", "L")}
        columns = [n for n, e in enumerate(links) if e.kind == "R"]
        outer = [n for n, e in enumerate(links) if e.kind in "LI"]
        sources = [flowing[links[n].name] if links[n].kind == "L" else links[n].value * one for n in outer]
        held = {0: port.v} | {n: tree[n - 1].value * one for n in rows["V"]}
        held |= {n: getattr(z, f"voltage_{tree[n - 1].name}") for n in rows["C"]}
        of_tree = [self._law(cast(Any, tree[n - 1]), on) for n in rows["R"]]
        of_links = [self._law(cast(Any, links[n]), on) for n in columns]
        resistances = np.diag([r for r, _ in of_tree]) if of_tree else np.zeros((0, 0))
        inner, across = cut[np.ix_(rows["R"], columns)], cut[np.ix_(rows["R"], outer)]
        # Voltage that drives the loop of each link, with no current in the links.
        driving = [
            _sum(cut[list(held), n], list(held.values()), none)
            + sum((cut[row, n] * e * one for row, (_, e) in zip(rows["R"], of_tree, strict=True)), none)
            - _sum((inner[:, k] @ resistances @ across), sources, none) - of_links[k][1] * one
            for k, n in enumerate(columns)
        ]  # fmt: skip
        matrix = np.diag([r for r, _ in of_links]) + inner.T @ resistances @ inner if columns else np.zeros((0, 0))
        own = _combined(np.linalg.inv(matrix), driving, none) if columns else []
        currents = {links[n].name: row for n, row in zip(columns, own, strict=True)}
        currents |= {links[n].name: row for n, row in zip(outer, sources, strict=True)}
        voltages = {tree[n - 1].name: row for n, row in held.items() if n}
        for (resistance, series), n in zip(of_tree, rows["R"], strict=True):
            through = -(_sum(cut[n, columns], own, none) + _sum(cut[n, outer], sources, none))
            voltages[tree[n - 1].name] = resistance * through + series * one
        if dz is not None:
            rates = dict(zip(flowing, _combined(vectors, self._fluxes(dz), none), strict=True))
            voltages |= {tree[n - 1].name: self._induced(tree[n - 1].name, rates, none) for n in rows["L"]}
            currents |= {e.name: e.value * getattr(dz, f"voltage_{e.name}") for e in links if e.kind == "C"}
        return _Solution(currents, voltages, self._potentials(port, voltages, tree))

    def _potentials(self, port: Port, voltages: Mapping[str, Row], tree: Sequence[Any]) -> list[Row]:
        """Potentials of the nodes against the negative electrode, where the tree's voltages lead to them."""
        known: dict[int, Row] = {MINUS: 0.0 * port.one, PLUS: port.v}
        waiting = [e for e in tree if e.name in voltages]
        for _ in waiting:
            for e in waiting:
                plus, minus = e.nodes
                if plus in known and minus not in known:
                    known[minus] = known[plus] - voltages[e.name]
                elif minus in known and plus not in known:
                    known[plus] = known[minus] + voltages[e.name]
        return [known.get(n, 0.0 * port.one) for n in range(len(self.nodes))]

    def _across(self, branch: Branch, found: _Solution) -> Row:
        """Voltage across a branch that is no inductor."""
        if branch.name in found.voltages:
            return found.voltages[branch.name]
        plus, minus = branch.nodes
        return found.potentials[plus] - found.potentials[minus]

    def _through(self, branch: Branch, found: _Solution, configuration: str) -> Row:
        """Current through a resistor, a diode, a switch or a source."""
        if branch.name in found.currents:
            return found.currents[branch.name]
        tree, links, cut = self._tree(configuration)
        none = 0.0 * found.potentials[PLUS]
        n = 1 + [e.name for e in tree].index(branch.name)
        return -_sum(cut[n], [found.currents.get(e.name, none) for e in links], none)


def _words(key: str, given: Any) -> tuple[str, ...]:
    """Names in lower case, from one or a list."""
    words = cast(Sequence[Any], (given,) if isinstance(given, str) else given)
    if not isinstance(given, list | tuple | str) or not all(isinstance(word, str) for word in words):
        raise ParameterError(key, f"found {given!r}, must be a list of names")
    return tuple(str(word).lower() for word in words)


def _configured(on: Mapping[str, bool]) -> str:
    """Name of the configuration in which these conduct."""
    return " ".join(name for name, conducts in on.items() if conducts) or "none"


def _sum(coefficients: Any, rows: Sequence[Row], none: Row) -> Row:
    """Sum of coefficient * row, without absent terms."""
    return sum((c * row for c, row in zip(coefficients, rows, strict=True) if c), start=none)


def _combined(matrix: np.ndarray, rows: Sequence[Row], none: Row) -> list[Row]:
    """Rows of a matrix times rows."""
    return [_sum(line, rows, none) for line in matrix]
