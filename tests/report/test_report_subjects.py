"""What a report and a table say of a circuit beside its name."""

from piezoharvest.cli.tables import _keys
from piezoharvest.description.shunts import Network, SpiceCircuit
from piezoharvest.design.result import shunt_table
from piezoharvest.report.subjects import values_of


def test_net_lists_of_both_kinds_have_words():
    network = Network(netlist="R1 1 0 100k load=true")
    assert dict(values_of(network))["netlist"] == "R\N{NO-BREAK SPACE}100\u202fkΩ"
    assert _keys(shunt_table(network), {}) == "R1 1-0 = 100.0 kohm, load"
    circuit = SpiceCircuit(netlist="* load\nR1 p 0 100k\n\n", load=("R1",))
    assert dict(values_of(circuit))["netlist"] == "2 lines"
    assert "netlist = 2 lines" in _keys(shunt_table(circuit), {}).splitlines()
