"""What a report and a table say of a circuit beside its name."""

import pytest

from piezoharvest.cli.tables import _keys
from piezoharvest.description.shunts import Network, Open, ParallelSSHI, Rectifier, Resistor, SpiceCircuit
from piezoharvest.description.shunts.duty_cycle import LoadPhase
from piezoharvest.description.shunts.storage import Storage
from piezoharvest.design.result import Candidate, shunt_table
from piezoharvest.report.subjects import Subject, values_of


@pytest.mark.parametrize(
    "shunt, field",
    [
        (Resistor(resistance=1e5), "resistance"),
        (Rectifier(smoothing_capacitance=1e-6, load_resistance=1e5), "load_resistance"),
        (Rectifier(dc_voltage=3.3), "dc_voltage"),  # a bridge's `resistance` is that of its diodes, a function
        (ParallelSSHI(dc_voltage=3.3, inductance=0.1, quality=5.0), "dc_voltage"),
        (Open(), None),
    ],
)
def test_what_the_load_is(shunt, field):
    candidate = object.__new__(Candidate)
    object.__setattr__(candidate, "shunt", shunt)
    subject = Subject(candidate, shunt.kind, 0)
    assert subject.load_field == field
    if field is not None:
        assert getattr(subject.with_load(2.0), field) == 2.0


def test_net_lists_of_both_kinds_have_words():
    network = Network(netlist="R1 1 0 100k load=true")
    assert dict(values_of(network))["netlist"] == "R\N{NO-BREAK SPACE}100\u202fkΩ"
    assert _keys(shunt_table(network), {}) == "R1 1-0 = 100.0 kohm, load"
    circuit = SpiceCircuit(netlist="* load\nR1 p 0 100k\n\n", load=("R1",))
    assert dict(values_of(circuit))["netlist"] == "2 lines"
    assert "netlist = 2 lines" in _keys(shunt_table(circuit), {}).splitlines()


def test_what_a_storage_feeds_is_told_by_its_keys_alone():
    phases = (LoadPhase(power=2e-3, duration=0.005, sends=True),)
    store = Storage(turn_on=5.0, turn_off=3.6, power=1e-3, phases=phases)
    shunt = Rectifier(smoothing_capacitance=22e-6, storage=store)
    assert store.line(0)  # what it computes and keeps is none of its keys
    table = shunt_table(shunt)
    phase = {"power": 2e-3, "duration": 0.005, "sends": True}
    assert table["storage"] == {"turn_on": 5.0, "turn_off": 3.6, "power": 1e-3, "phases": [phase]}
    assert _keys(table, {}).splitlines()[:3] == [
        "smoothing_capacitance = 22.00 uF", "storage.turn_on = 5.000 V", "storage.turn_off = 3.600 V",
    ]  # fmt: skip
    assert "storage.phases.0.duration = 5.000 ms" in _keys(table, {}).splitlines()
    values = dict(values_of(shunt))
    assert (values["storage: turn on"], values["storage: phases 1: power"]) == ("5\u202fV", "2\u202fmW")
