"""Network shunt: equations against complex nodal analysis, equivalence with the shunts of fixed form, messages."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from messages import is_sentence

from piezoharvest.description.circuit import Port
from piezoharvest.description.netlist import Element, normal_tree, read_netlist, spice_number
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import Network, ParallelRL, ParallelRLC, SeriesRL, SeriesRLC

OMEGA = 2 * np.pi * 50.0
CAPACITANCE = 40e-9


def _phasors(shunt, omega):
    """Solve a shunt's equations for 1 V at its port: load current, powers and stored energies as phasors."""
    states = shunt.states(CAPACITANCE)
    unit = np.eye(4 + 2 * len(states))
    z = SimpleNamespace(**{s.name: unit[4 + n] for n, s in enumerate(states)})
    dz = SimpleNamespace(**{s.name: unit[4 + len(states) + n] for n, s in enumerate(states)})
    port = Port(v=unit[0], dv=unit[1], i=unit[2], one=unit[3], capacitance=CAPACITANCE)
    rows = np.array(shunt.equations("linear", port, z, dz))
    assert len(rows) == 1 + len(states)
    on_states = rows[:, 4 : 4 + len(states)] + 1j * omega * rows[:, 4 + len(states) :]
    matrix = np.column_stack([rows[:, 2], on_states])
    scale = np.abs(matrix).max(axis=1)
    columns = np.abs(matrix / scale[:, None]).max(axis=0)
    right = -(rows[:, 0] + 1j * omega * rows[:, 1]) / scale
    solution = np.linalg.solve(matrix / scale[:, None] / columns, right) / columns
    motion = np.concatenate([[1.0, 1j * omega], solution[:1], [0.0], solution[1:], 1j * omega * solution[1:]])
    powers = {
        where: sum(p.coefficient * (p.first @ motion) * np.conj(p.second @ motion) / 2 for p in products)
        for where, products in shunt.powers("linear", port, z).items()
    }
    stored = [s.storage * abs(value) ** 2 / 4 for s, value in zip(states, solution[1:], strict=True)]
    return solution[0], powers, stored


def _nodal(elements, omega):
    """Modified nodal analysis for 1 V between nodes 1 and 0: node voltages, current that flows in, condition number."""
    nodes = sorted({n for e in elements for n in e.nodes} - {0})
    size = len(nodes)
    matrix = np.zeros((size + 1, size + 1), complex)
    for e in elements:
        y = _admittance(e, omega)
        for row, sign in zip(e.nodes, (1, -1), strict=True):
            for column, other in zip(e.nodes, (1, -1), strict=True):
                if row and column:
                    matrix[nodes.index(row), nodes.index(column)] += sign * other * y
    port = nodes.index(1)
    matrix[port, size] = -1.0
    matrix[size, port] = 1.0
    scale = np.abs(matrix).max(axis=1)
    # The same scale on rows and columns keeps the matrix symmetric and its entries near one.
    scale[size] = 1.0 / scale[port]
    root = np.sqrt(scale)
    scaled = matrix / root[:, None] / root
    right = np.zeros(size + 1, complex)
    right[size] = 1.0
    solution = np.linalg.solve(scaled, right / root) / root
    voltages = {0: 0j, **dict(zip(nodes, solution[:size], strict=True))}
    return voltages, solution[size], np.linalg.cond(scaled)


def _admittance(element, omega):
    value = element.value
    return {"R": 1 / value, "C": 1j * omega * value, "L": 1 / (1j * omega * value)}[element.kind]


@st.composite
def networks(draw):
    """Connected multigraphs, biased to few nodes and few kinds so that loops of C and cutsets of L are common."""
    kinds = draw(st.sampled_from(["RLC", "LC", "RC", "RL", "C", "L", "CCCR", "LLLR"]))
    size = draw(st.integers(2, 6))
    edges = [(n, draw(st.integers(0, n - 1))) for n in range(1, size)]
    for _ in range(draw(st.integers(0, 6))):
        plus = draw(st.integers(0, size - 1))
        edges.append((plus, (plus + draw(st.integers(1, size - 1))) % size))
    elements = []
    for n, nodes in enumerate(edges):
        kind = draw(st.sampled_from(kinds))
        # Impedances within a factor 100 at OMEGA: the comparison is of equations, not of rounding errors.
        ohms = 10.0 ** draw(st.floats(3.0, 5.0))
        value = {"R": ohms, "L": ohms / OMEGA, "C": 1 / (ohms * OMEGA)}[kind]
        load = kind == "R" and draw(st.booleans())
        elements.append(Element(f"{kind}{n}", kind, draw(st.sampled_from([nodes, nodes[::-1]])), value, load))
    return elements


@settings(max_examples=300, deadline=None)
@given(networks(), st.floats(0.3, 3.0))
def test_admittance_equals_nodal_analysis(elements, ratio):
    omega = ratio * OMEGA
    voltages, expected, condition = _nodal(elements, omega)
    assume(condition < 1e6)  # at the resonance of a loop without loss there is no answer to compare
    current, powers, stored = _phasors(Network(netlist=elements), omega)
    across = {e: voltages[e.nodes[0]] - voltages[e.nodes[1]] for e in elements}
    flows = [abs(_admittance(e, omega) * v) for e, v in across.items()]
    assert current == pytest.approx(expected, abs=1e-9 * max(flows))
    # Every resistor's power stands where it belongs, and together they are what flows in.
    for where, load in (("harvested", True), ("shunt_loss", False)):
        dissipated = sum(abs(v) ** 2 / e.value / 2 for e, v in across.items() if e.kind == "R" and e.load is load)
        assert complex(powers[where]) == pytest.approx(dissipated, rel=1e-8, abs=1e-9 * max(flows))
    assert (np.conj(current) / 2).real == pytest.approx(sum(powers.values()).real, abs=1e-9 * max(flows))
    # The states carry the energy of every coil and capacitor, redundant ones included.
    amplitudes = {e: v if e.kind == "C" else v * _admittance(e, omega) for e, v in across.items() if e.kind != "R"}
    energies = [e.value * abs(amplitude) ** 2 / 4 for e, amplitude in amplitudes.items()]
    assert stored == pytest.approx(energies, rel=1e-7, abs=1e-9 * max(flows) / omega)


@pytest.mark.parametrize(
    ("netlist", "shunt"),
    [
        ("L1 1 2 2\nR1 2 0 10k load=true", SeriesRL(inductance=2.0, resistance=1e4)),
        ("L1 1 0 2\nR1 1 0 10k load=true", ParallelRL(inductance=2.0, resistance=1e4)),
        ("C1 1 2 100n\nL1 2 3 2\nR1 3 0 10k load=true", SeriesRLC(inductance=2.0, resistance=1e4, capacitance=1e-7)),
        ("C1 1 0 100n\nL1 1 0 2\nR1 0 1 10k load=true", ParallelRLC(inductance=2.0, resistance=1e4, capacitance=1e-7)),
    ],
)
def test_equals_shunts_of_fixed_form(netlist, shunt):
    for omega in (100.0, OMEGA, 2000.0):
        network, fixed = _phasors(Network(netlist=netlist), omega), _phasors(shunt, omega)
        assert network[0] == pytest.approx(fixed[0], rel=1e-12)
        assert network[1]["harvested"] == pytest.approx(fixed[1]["harvested"], rel=1e-12)
        assert sorted(network[2]) == pytest.approx(sorted(fixed[2]), rel=1e-12)


def test_bridge_of_resistors_without_states():
    wheatstone = "R1 1 2 100\nR2 1 3 200\nR3 2 0 300\nR4 3 0 400\nR5 2 3 500 load"
    current, powers, stored = _phasors(Network(netlist=wheatstone), OMEGA)
    voltages, expected, _ = _nodal(read_netlist(wheatstone), OMEGA)
    assert current == pytest.approx(expected, rel=1e-13)
    assert powers["harvested"] == pytest.approx(abs(voltages[2] - voltages[3]) ** 2 / 500 / 2, rel=1e-12)
    assert stored == []


def test_normal_tree_prefers_capacitors_and_avoids_inductors():
    tree, links, cut = normal_tree(read_netlist("L1 1 2 1\nR1 2 0 1k\nC1 2 0 1n\nL2 2 3 1\nL3 3 0 1"))
    assert [e.name for e in tree] == ["C1", "L2"]
    assert [e.name for e in links] == ["R1", "L1", "L3"]
    # L2 carries the current of L3; the port's current is that of L1.
    assert cut.tolist() == [[0, 1, 0], [1, -1, 1], [0, 0, -1]]


def test_forms_of_a_netlist_agree():
    expected = (Element("R1", "R", (1, 2), 1e5, True), Element("C1", "C", (2, 0), 4.7e-8))
    as_text = "* a comment\n\nR1 1 2 100k load = true ; the load\nc1 2 0 47nF\n"
    assert [(e.kind, e.nodes, e.value, e.load) for e in Network(netlist=as_text).elements] == [
        (e.kind, e.nodes, pytest.approx(e.value), e.load) for e in expected
    ]
    tables = [
        {"name": "R1", "nodes": [1, 2], "value": 1e5, "load": True},
        {"name": "C1", "kind": "C", "nodes": ["2", "0"], "capacitance": 4.7e-8},
    ]
    assert Network(netlist=tables).elements == expected
    assert Network(netlist=["R1 1 2 1e5 load=yes", tables[1]]).elements == expected
    network = Network(netlist=expected)
    assert network == Network(netlist=tables)
    assert hash(network) == hash(Network(netlist=tables))
    # Written out as tables, it is read again.
    assert Network(netlist=[vars(e) for e in network.elements]) == network


@pytest.mark.parametrize("kind_key", ["kind", "element", "type"])
def test_unnamed_elements_are_numbered(kind_key):
    table = [{kind_key: "L", "nodes": [1, 0], "inductance": 2}, {"nodes": [1, 0], "resistance": "10k", "load": True}]
    assert Network(netlist=table).elements == (Element("L1", "L", (1, 0), 2.0), Element("R2", "R", (1, 0), 1e4, True))


@pytest.mark.parametrize(
    ("text", "number"),
    [("1", 1), ("1.5k", 1500), ("2MEG", 2e6), ("3m", 3e-3), ("4u", 4e-6), ("5µF", 5e-6), ("6n", 6e-9), ("7p", 7e-12),
     ("8f", 8e-15), ("9g", 9e9), ("1t", 1e12), (".5e-3k", 0.5), ("10kohm", 1e4), ("3H", 3), ("x", None), ("1kk", None),
     ("1 k", None), ("nan", None)],
)  # fmt: skip
def test_spice_numbers(text, number):
    assert spice_number(text) == (None if number is None else pytest.approx(number, rel=1e-15))


@pytest.mark.parametrize(
    ("netlist", "key", "found"),
    [
        (["R1 1 0 1k", "Q1 1 0 1k"], "netlist.1.kind", "'Q'"),
        (["R1 1 0 1k", "", "C1 1 0 0"], "netlist.2.value", "0"),
        (["R1 1 0 -5"], "netlist.0.value", "-5"),
        ([{"name": "R1", "nodes": [1, 0], "value": float("nan")}], "netlist.0.value", "nan"),
        ([{"name": "R1", "nodes": [1, 0], "resistance": float("inf")}], "netlist.0.resistance", "inf"),
        ([{"name": "R1", "nodes": [1, 0], "value": True}], "netlist.0.value", "True"),
        ([{"name": "R1", "nodes": [1, 0]}], "netlist.0.value", "no value"),
        ([{"name": "R1", "nodes": [1, 0], "capacitance": 1.0, "kind": "R"}], "netlist.0.capacitance", "capacitance"),
        ([{"name": "R1", "nodes": [1, 0], "ohms": 1.0}], "netlist.0.ohms", "unknown"),
        ([{"name": "R 1", "nodes": [1, 0], "value": 1.0}], "netlist.0.name", "'R 1'"),
        (["R1 1 1 1k"], "netlist.0.nodes", "'1', '1'"),
        (["R1 1 -2 1k"], "netlist.0.nodes", "-2"),
        ([{"name": "R1", "nodes": [1, True], "value": 1.0}], "netlist.0.nodes", "True"),
        ([{"name": "R1", "nodes": 1, "value": 1.0}], "netlist.0.nodes", "1"),
        (["R1 2 0 1k"], "netlist", "node 1"),
        (["R1 1 2 1k"], "netlist", "node 0"),
        ([], "netlist", "no element"),
        (["R1 1 0 1k", "C1 2 3 1n", "L1 3 2 1"], "netlist.1.nodes", "C1"),
        (["R1 1 0 1k", "r1 1 0 1k"], "netlist.1.name", "r1"),
        (["L1 1 0 1 load=true"], "netlist.0.load", "kind L"),
        ([{"name": "R1", "nodes": [1, 0], "value": 1.0, "load": "yes"}], "netlist.0.load", "'yes'"),
        (["R1 1 0 1k load=maybe"], "netlist.0", "load=maybe"),
        (["R1 1 0"], "netlist.0", "R1 1 0"),
        ([7], "netlist.0", "7"),
        (7, "netlist", "7"),
    ],
)
def test_errors_name_key_value_and_what_is_allowed(netlist, key, found):
    with pytest.raises(ParameterError) as caught:
        Network(netlist=netlist)
    assert caught.value.key == key
    assert found in caught.value.message.partition("must be")[0]
    assert is_sentence(caught.value.message)
