"""Shunts from netlists of ngspice and LTspice: closed forms, the package's own circuits, and ngspice."""

import numpy as np
import pytest
from oracles.ngspice import needs_ngspice
from studies import DRIVE, bench, objects, solve

from piezoharvest.cli import main
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.shunts import SpiceCircuit
from piezoharvest.linear import frequency_response
from piezoharvest.spice.simulators.comparison import compare

DAMPED = {"damping": 0.6, "coupling": 3e-4}
BRIDGE = """* bridge
.model ideal D(Ron={ron} Roff={roff} Vfwd={drop})
D1 p plus ideal
D2 0 plus ideal
D3 minus p ideal
D4 minus 0 ideal
Cs plus minus 0.26u
Rload plus minus 160k
"""
# A transformer, a subcircuit, a switch with a threshold, a battery: closes once a period.
MIXED = """* mixed
.param c=50n
.subckt half a b params: cap=1u
C1 a x {cap/2}
C2 x b {2*cap}
R1 x b 1meg
.ends
.model d1 D(Ron=10 Roff=1g Vfwd=0.1)
.model s1 SW(Ron=100 Roff=100meg Vt=1.5 Vh=0.5)
L1 p 0 100
L2 s 0 25
K1 L1 L2 0.95
D1 s dc d1
X1 dc 0 half cap={4*c}
S1 dc out dc 0 s1
Rout out 0 20k
V1 bat 0 0.3
R8 bat out 1meg
"""


def of_spice(text, **keys):
    return {"kind": "spice", "netlist": text, **keys}


class TestAgainstClosedForms:
    def test_transformer(self):
        study = bench(of_spice("* t\nL1 p 0 200\nL2 s 0 50\nK1 L1 L2 0.9\nRload s 0 40k\n", load=["Rload"]), **DAMPED)
        system, excitation = objects(study)
        found, omega = solve(study), 2 * np.pi * DRIVE["frequency"]
        # Seen from the electrodes: j w L1 + (w M)^2/(j w L2 + R).
        seen = 1j * omega * 200 + (omega * 0.9 * 100) ** 2 / (1j * omega * 50 + 4e4)
        t = system.transducer
        stiffness = t.stiffness - t.mass * omega**2 + 1j * omega * t.damping
        admittance = 1j * omega * t.capacitance + 1 / seen
        voltage = -1j * omega * t.coupling / admittance * excitation.amplitude
        voltage /= stiffness + 1j * omega * t.coupling**2 / admittance
        assert found.voltage_amplitude == pytest.approx(abs(voltage), rel=1e-9)
        assert found.harvested_power == pytest.approx(0.5 * abs(voltage) ** 2 * (1 / seen).real, rel=1e-9)

    def test_as_the_network_of_the_same_elements(self):
        text = "C1 1 0 10n\nC2 1 2 20n\nC3 2 0 30n\nR1 2 0 90k{}\nL1 2 3 20\nL2 3 4 30\nR2 4 0 50k\nL3 3 0 500"
        imported = of_spice("* n\n" + text.format(""), port=["1", "0"], load=["r1"])
        found = solve(bench(imported, **DAMPED))
        assert found.energy["closure"] < 1e-12
        system, excitation = objects(bench({"kind": "network", "netlist": text.format(" load")}, **DAMPED))
        wanted = frequency_response(system, [excitation.frequency]).harvested_power[0] * excitation.amplitude**2
        assert found.harvested_power == pytest.approx(wanted, rel=1e-9)

    @pytest.mark.parametrize(("law", "error"), [(("0.03", "1t"), 2e-6), (("10", "1g"), 1e-3)])
    def test_bridge(self, law, error):
        text = BRIDGE.format(ron=law[0], roff=law[1], drop="10m")
        found = solve(bench(of_spice(text, load=["Rload"]), **DAMPED))
        rectifier = {"kind": "rectifier", "smoothing_capacitance": 0.26e-6, "load_resistance": 160e3}
        wanted = solve(bench({**rectifier, "diode_drop": 0.01}, **DAMPED))
        assert found.converged
        assert found.energy["closure"] < 1e-9
        assert found.harvested_power == pytest.approx(wanted.harvested_power, rel=error)
        assert found.dc_voltage == pytest.approx(wanted.dc_voltage, rel=error)
        assert found.waveforms.event_names.count("diodes conduct") == 4

    def test_battery_takes_what_a_constant_voltage_does(self):
        loads = "Cs plus minus 0.26u\nRload plus minus 160k"
        text = BRIDGE.format(ron="0.03", roff="1t", drop="0").replace(loads, "Vb plus minus 0.4")
        found = solve(bench(of_spice(text, load=["Vb"]), **DAMPED))
        wanted = solve(bench({"kind": "rectifier", "dc_voltage": 0.4}, **DAMPED))
        assert found.harvested_power == pytest.approx(wanted.harvested_power, rel=1e-6)
        source = solve(bench(of_spice(text), **DAMPED))
        assert source.energy["source"] == pytest.approx(-found.energy["harvested"], rel=1e-9)

    def test_what_conducts_too_well_is_refused(self):
        text = BRIDGE.format(ron="1m", roff="1t", drop="0")
        with pytest.raises(ParameterError, match=r"line 3: D1: found Ron=0.001 ohm, must be 0.0247 ohm or more"):
            solve(bench(of_spice(text), **DAMPED))


@needs_ngspice
class TestAgainstNgspice:
    def test_transformer_subcircuit_switch_and_battery(self):
        figures, trusted = compare(*objects(bench(of_spice(MIXED, load=["Rout"]))))
        assert trusted
        assert figures[0].engine > 1e-5
        assert max(abs(figure.difference) for figure in figures) < 5e-3

    @pytest.mark.parametrize("capacitor", ["plus minus", "minus plus"])
    def test_the_voltage_of_the_smoothing_capacitor(self, capacitor):
        """Both programs give that across the first load, whichever way round the capacitor is written."""
        text = BRIDGE.format(ron="50", roff="10meg", drop="0.1").replace("Cs plus minus", f"Cs {capacitor}")
        figures, _ = compare(*objects(bench(of_spice(text, load=["Rload"]), **DAMPED)))
        (voltage,) = (figure for figure in figures if figure.name == "dc_voltage")
        assert voltage.engine > 0.1
        assert voltage.ngspice == pytest.approx(voltage.engine, rel=1e-3)


class TestLanguage:
    @pytest.mark.parametrize(
        ("lines", "message"),
        [
            ("D1 p 0 m\n.model m D(Is=1n N=1.8)",
             "line 2: D1: found the parameter IS in the model m .line 3., which is not"),
            ("D1 p 0 d\n.model d D", "line 2: D1: found model d .line 3., whose law is exponential"),
            ("R1 p 0 1k\nQ1 p 0 a npn", "line 3: Q1: found an element of kind Q, allowed are R, L, C, K"),
            ("V1 p a SINE(0 1 50)\nR1 a 0 1", "line 2: V1: found 'SINE 0 1 50', must be a constant"),
            ("R1 p 0 {2*x}", "line 2: R1: found 'x', which is not a parameter, known are none"),
            ("R1 p 0 __import__('os')", "line 2: R1: found"),
            ("R1 p a 1k\nR2 b c 1k\nR3 a 0 1", "line 3: R2 is not connected to the port"),
            ("V1 p 0 1", "line 2: V1 is in a loop of sources, or across the port"),
            ("I1 p a 1m\nI2 a 0 1m\nR1 p 0 1", "has no path for its current"),
            ("S1 p 0 a 0 s\n.model s SW(Ron=1 Roff=1meg Vt=1)", "only a control input is connected to node 'a'"),
            ("S1 p 0 p 0 s\n.model s SW(Vt=1 Vh=-0.1)", "a negative one gives a smooth transition"),
            ("L1 p 0 1\nL2 p 0 1\nK1 L1 L2 1", "line 4: K1: found 1, must have a magnitude between 0 and 1"),
            ("X1 p 0 amp\n", "line 2: X1: found subcircuit 'amp', which the netlist does not have"),
            (".subckt a p q\nX1 p q a\n.ends\nX1 p 0 a", "subcircuits nested more than"),
            ("R1 p 0 -5", "line 2: R1: found -5, must be a value greater than 0"),
            ("C1 p 0 1u Cpar=1n", "line 2: C1: found cpar, allowed are Rser and IC"),
            (".global vdd", "line 2: found .global, allowed are .param"),
            ("R1 p 0 1e400", "line 2: R1: found '1e400', must be a number"),
            ("R1 p 0 1e70", "line 2: R1: found 1e.70"),
            (".subckt a p q\nR1 p q 1\nR2 p q 1\n.ends\n" + "\n".join(f"X{n} p 0 a" for n in range(40)), "than 60"),
            ("R1 a b 1k", "port: no element is connected to node 'p'"),
        ],
    )  # fmt: skip
    def test_what_is_refused_is_named_by_element_and_line(self, lines, message):
        with pytest.raises(ParameterError, match=message):
            SpiceCircuit(netlist="* title\n" + lines)

    def test_a_first_line_that_could_be_an_element(self):
        with pytest.raises(ParameterError, match="line 1: found 'R1 p 0 1k': the first line is a title"):
            SpiceCircuit(netlist="R1 p 0 1k\nR2 p 0 1k")

    def test_parameters_in_any_order_and_numbers(self):
        text = "a title\n.param a={2*b+1k} b = 'pow(2, 3)*1k/2'\nR1 p 0 {a}\nC1 p 0 4.7uF ; comment\n+\n.end"
        values = {b.name: b.value for b in SpiceCircuit(netlist=text).branches}
        assert values == {"R1": 9000.0, "C1": pytest.approx(4.7e-6)}

    def test_a_net_list_of_ltspice(self, tmp_path, capsys, monkeypatch):
        monkeypatch.chdir(tmp_path)
        lines = BRIDGE.format(ron=1, roff="1g", drop=0).replace("Rload", "R§load").replace("0.26u", "0.26µ Rser=0.1")
        (tmp_path / "b.net").write_bytes((lines + ".tran 1\n.backanno\n.end\n").replace("\n", "\r\n").encode("latin-1"))
        assert main(["import", "b.net", "--load", "Rload", "--out", "b.toml"]) == 0
        assert capsys.readouterr().err == "b.net: 7 parts, 1 state, 16 configurations\n"
        study = "[transducer]\nmass=0.01\ndamping=0.6\nstiffness=987.0\ncoupling=3e-4\ncapacitance=4e-8\n"
        study += '[excitation]\nkind="sine_force"\namplitude=0.02\nfrequency=50.0\n'
        (tmp_path / "study.toml").write_text(study + (tmp_path / "b.toml").read_text())
        assert main(["simulate", "study.toml"]) == 0
        assert main(["import", "b.net", "--load", "R9"]) == 2
        assert "b.net: load: found 'r9', allowed are" in capsys.readouterr().err

    def test_a_subcircuit(self):
        shunt = SpiceCircuit(netlist=MIXED, subcircuit="half")
        assert sorted(b.name for b in shunt.branches) == ["C1", "C2", "R1"]
        assert [b.nodes for b in shunt.branches if b.name == "C2"] == [(2, 0)]
