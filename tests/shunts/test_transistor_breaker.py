"""Self-powered circuits of transistors in ngspice beside the engine's electronic breakers, and beside a lag alone."""

import math
import re
import subprocess
from typing import NamedTuple

import pytest
from oracles.ngspice import needs_ngspice

from piezoharvest import (
    ParallelSSHI,
    SelfPoweredSECE,
    SelfPoweredSeriesSSHI,
    SelfPoweredSSDI,
    SelfPoweredSSHI,
    SineForce,
    System,
    Transducer,
    simulate,
)

FREQUENCY, CAPACITANCE, V_OC, COUPLING = 42.0, 40e-9, 20.0, 2e-5
OMEGA = 2 * math.pi * FREQUENCY
INDUCTANCE, QUALITY, ENVELOPE = 0.1, 5.0, 2e-9
PERIODS = 10
# Envelope detector, comparator and switch for each sign, as in Lallart & Guyomar (2008) and Liang & Liao (2012), with
# diodes 1N4148 and transistors 2N3904 and 2N3906, by their usual SPICE parameters. The current source is the strain's.
NETLIST = """self-powered parallel SSHI of transistors
Istrain 0 p SIN(0 {current!r} {frequency})
Cp p 0 {capacitance!r}
Rp p 0 1g
D1 p plus DX
D2 0 plus DX
D3 minus p DX
D4 minus 0 DX
Vdc plus minus {dc!r}
Lloop p l {inductance!r}
Rloop l x {resistance!r}
* breaker of maxima
Dhigh p high DX
Chigh high 0 {envelope!r}
Rbase1 p base1 {base!r}
Q1 col1 base1 high QP
Rdrive1 col1 drive1 {drive!r}
Dback1 drive1 gate1 DX
Q2 path1 gate1 0 QN
Dpath1 x path1 DX
* breaker of minima
Dlow low p DX
Clow low 0 {envelope!r}
Rbase2 p base2 {base!r}
Q3 col2 base2 low QN
Rdrive2 col2 drive2 {drive!r}
Dback2 gate2 drive2 DX
Q4 path2 gate2 0 QP
Dpath2 path2 x DX
.model DX D(IS=2.52n N=1.752 RS=0.568 CJO=4p TT=20n)
.model QN NPN(IS=6.734f BF=416.4 VAF=74.03 IKF=66.78m ISE=6.734f NE=1.259 BR=0.7371 RB=10 RC=1 CJE=4.493p CJC=3.638p
+ TF=301.2p TR=239.5n)
.model QP PNP(IS=1.41f BF=180.7 VAF=18.7 IKF=80m BR=4.977 RB=10 RC=2.5 CJE=8.063p CJC=9.728p TF=179.3p TR=33.42n)
.options reltol=1e-4 abstol=1e-12 vntol=1e-6 method=gear
.tran {step!r} {end!r} 0 {longest!r} uic
.control
run
meas tran emptied find i(Lloop) when v(p)=0 fall=last
meas tran highest max v(p) from={begin!r} to={end!r}
let power={dc!r}*i(Vdc)
meas tran mean avg power from={begin!r} to={end!r}
.endc
.end
"""
# What the parts do at the currents that they carry: the envelope's diode and the emitter of Q1 hold 0.67 V below the
# peak together; diodes of the bridge drop 0.5 V at 20 uA, diode and transistor of a breaker 0.65 V and 30 ohm at 10 mA.
DROP, FALLS, PATH = 0.5, 0.67, 0.65
BREAKER = {"threshold": FALLS - DROP, "breaker_drop": PATH, "switch_resistance": 30.0}
# Without a bridge across the electrodes, whose diodes have the same drop: the envelope's holds 0.17 V at its end.
ENDS = 0.17
DETECTS = {"threshold": FALLS - ENDS, "diode_drop": ENDS, "switch_resistance": 30.0}


class Parts(NamedTuple):
    """What makes the time in which a transistor uses up the charge of an envelope, and in which its base takes it."""

    envelope: float = ENVELOPE
    base: float = 220e3
    drive: float = 47e3

    @property
    def keys(self):
        """Keys of the engine's circuit."""
        return {
            "inductance": INDUCTANCE, "quality": QUALITY, "envelope_capacitance": self.envelope,
            "base_resistance": self.base,
        }  # fmt: skip


# Envelopes of half and twice the size whose charge is used up within an inversion, too: 0.1 ms and 0.04 ms of 0.2 ms.
USUAL, SMALL, LARGE = Parts(), Parts(1e-9, 470e3, 100e3), Parts(4e-9, 220e3, 10e3)


# Between collector and base of Q4, while it blocks; and next to none.
COLLECTOR, WITHOUT = "CJC=9.728p", "CJC=0.1p"


BRIDGE = NETLIST[NETLIST.index("D1 p") : NETLIST.index("Vdc ")]
# The bridge in line with the loop instead of across it, and none.
SERIES = {
    BRIDGE: BRIDGE.replace("D2 0", "D2 l").replace("minus 0", "minus l"),
    "Lloop p l": "Lloop l l1",
    "Rloop l x": "Rloop l1 x",
}
NO_BRIDGE = {BRIDGE: "", "Vdc plus minus": "Vdc unused 0"}
# A coil for each sign of the voltage, behind a diode: once the electrodes are empty, its current goes on through
# another diode from the ground, and not through them.
EXTRACTION = {
    **NO_BRIDGE,
    "Lloop p l": "Dtake1 p a1 DX\nDfree1 0 a1 DX\nLloop a1 l",
    "Rloop l x": "Rloop l path1",
    "Dpath1 x path1 DX\n": "",
    "Dpath2 path2 x DX": ("Dtake2 a2 p DX\nDfree2 a2 0 DX\nLtwo a2 l2 {inductance!r}\nRtwo l2 path2 {resistance!r}"),
}


def of_transistors(dc, folder, collector=COLLECTOR, circuit=(), v_oc=V_OC, parts=USUAL):
    """Mean power (W) into a constant voltage."""
    return measured(dc, folder, collector, circuit, v_oc, parts)["mean"]


def measured(dc, folder, collector, circuit, v_oc, parts=USUAL):
    """That power, the highest voltage of the electrodes (V), and the coil's current where they are empty (A)."""
    period, text = 1 / FREQUENCY, NETLIST
    for before, after in dict(circuit).items():
        assert before in text
        text = text.replace(before, after)
    text = text.replace(COLLECTOR, collector).format(
        current=CAPACITANCE * OMEGA * v_oc, frequency=FREQUENCY, capacitance=CAPACITANCE, dc=dc, inductance=INDUCTANCE,
        resistance=math.sqrt(INDUCTANCE / CAPACITANCE) / QUALITY, step=period / 2000,
        longest=period / 3000, **parts._asdict(), begin=(PERIODS - 2) * period, end=PERIODS * period,
    )  # fmt: skip
    (folder / "breaker.cir").write_text(text)
    out = subprocess.run(
        ["ngspice", "-b", "breaker.cir"], cwd=folder, capture_output=True, text=True, check=False
    ).stdout
    found = dict(re.findall(r"^(mean|highest|emptied)\s*=\s*(\S+)", out, re.MULTILINE))
    assert len(found) == 3, out[-2000:]
    return {name: float(value) for name, value in found.items()}


def of_engine(shunt):
    """The power of a circuit at a transducer that it cannot move, with the same open-circuit voltage."""
    return response(shunt, V_OC).harvested_power


def response(shunt, v_oc):
    device = Transducer(mass=0.63, damping=480.0, stiffness=1e6, coupling=COUPLING, capacitance=CAPACITANCE)
    force = v_oc * CAPACITANCE / COUPLING * abs(1e6 - 0.63 * OMEGA**2 + 480j * OMEGA)
    return simulate(System(device, shunt), SineForce(amplitude=force, frequency=FREQUENCY))


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize(("dc", "lagging"), [(5.0, 0.031), (10.0, 0.049), (15.0, 0.069), (20.0, 0.091), (25.0, 0.116)])
def test_a_breaker_of_transistors(dc, lagging, tmp_path):
    """The breaker is right within 2 %, where a given lag over-predicts by 3 to 12 % over the loads."""
    wanted = of_transistors(dc, tmp_path)
    found = of_engine(SelfPoweredSSHI(**USUAL.keys, **BREAKER, diode_drop=DROP, dc_voltage=dc))
    assert found == pytest.approx(wanted, rel=0.02)
    loop = {"inductance": INDUCTANCE, "quality": QUALITY, "diode_drop": DROP, "dc_voltage": dc}
    lag = of_engine(ParallelSSHI(**loop, phase_lag=math.acos(1 - FALLS / V_OC)))
    assert lag / wanted - 1 == pytest.approx(lagging, abs=0.005)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("dc", [30.0, 35.0])
def test_a_breaker_that_fires_twice(dc, tmp_path):
    """The collector's capacitance of the PNP is why 30 V is too much for it: without, the engine is right there, too.

    At the end of a swing to -20 V, the voltage across Q4 steps by as much, and the charge of the capacitance flows
    through its base. Q4 amplifies this by its current gain, so the voltage of the electrodes falls back by 0.8 V, more
    than the other breaker takes for an extremum: it inverts a second time.
    """
    # Its swings pass 16 and 19 mA, at which diode and transistor of a breaker hold 0.84 to 0.88 V there.
    breaker = {**BREAKER, "breaker_drop": 0.755, "switch_resistance": 7.0}
    found = of_engine(SelfPoweredSSHI(**USUAL.keys, **breaker, diode_drop=DROP, dc_voltage=dc))
    assert found == pytest.approx(of_transistors(dc, tmp_path, WITHOUT), rel=0.02)
    assert of_transistors(dc, tmp_path) < 0.7 * found


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("parts", [SMALL, USUAL, LARGE])
def test_damping(parts, tmp_path):
    """A voltage that swings freely to 20 V: it is 3 to 7 % higher if the capacitors are pulled within the swing."""
    wanted = measured(0.0, tmp_path, WITHOUT, NO_BRIDGE, 5.0, parts)["highest"]
    keys = {**parts.keys, **DETECTS, "breaker_drop": PATH}
    assert response(SelfPoweredSSDI(**keys), 5.0).voltage_amplitude == pytest.approx(wanted, rel=0.02)
    keys["base_resistance"] = 0.0
    assert 1.025 < response(SelfPoweredSSDI(**keys), 5.0).voltage_amplitude / wanted < 1.075


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("parts", [SMALL, USUAL, LARGE])
def test_series_circuit(parts, tmp_path):
    """Diodes of a bridge in line carry the swing's 10 mA: each drops 0.69 V."""
    keys = {**parts.keys, **DETECTS, "breaker_drop": PATH + 2 * (0.69 - ENDS)}
    wanted = of_transistors(2.0, tmp_path, WITHOUT, SERIES, 8.0, parts)
    found = response(SelfPoweredSeriesSSHI(**keys, dc_voltage=2.0), 8.0).harvested_power
    assert found == pytest.approx(wanted, rel=0.02)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize(("v_oc", "parts"), [(5.0, USUAL), (10.0, SMALL), (10.0, USUAL), (10.0, LARGE), (20.0, USUAL)])
def test_extraction(v_oc, parts, tmp_path):
    """The energy of the coil where the electrodes are empty; the path has a diode and a transistor, as a breaker's."""
    wanted = measured(0.0, tmp_path, WITHOUT, EXTRACTION, v_oc, parts)
    found = response(SelfPoweredSECE(**parts.keys, **DETECTS, breaker_drop=PATH - ENDS), v_oc)
    assert found.voltage_amplitude == pytest.approx(wanted["highest"], rel=0.02)
    extracted = 2 * FREQUENCY * 0.5 * INDUCTANCE * wanted["emptied"] ** 2
    assert found.harvested_power == pytest.approx(extracted, rel=0.02)
