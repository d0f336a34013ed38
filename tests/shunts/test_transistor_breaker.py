"""A self-powered SSHI of transistors in ngspice beside the engine's electronic breaker, and beside a lag alone."""

import math
import re
import subprocess

import pytest
from oracles.ngspice import needs_ngspice

from piezoharvest import (
    ParallelSSHI,
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
Rbase1 p base1 220k
Q1 col1 base1 high QP
Rdrive1 col1 drive1 47k
Dback1 drive1 gate1 DX
Q2 path1 gate1 0 QN
Dpath1 x path1 DX
* breaker of minima
Dlow low p DX
Clow low 0 {envelope!r}
Rbase2 p base2 220k
Q3 col2 base2 low QN
Rdrive2 col2 drive2 47k
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
meas tran highest max v(p) from={begin!r} to={end!r}
let power={dc!r}*i(Vdc)
meas tran mean avg power from={begin!r} to={end!r}
.endc
.end
"""
# What the parts do at the currents that they carry: the envelope's diode and the emitter of Q1 hold 0.67 V below the
# peak together; diodes of the bridge drop 0.5 V at 20 uA, diode and transistor of a breaker 0.65 V and 30 ohm at 10 mA.
DROP, FALLS = 0.5, 0.67
BREAKER = {"threshold": FALLS - DROP, "breaker_drop": 0.65, "switch_resistance": 30.0}


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


def of_transistors(dc, folder, collector=COLLECTOR, circuit=(), v_oc=V_OC):
    """Mean power (W) into a constant voltage."""
    return measured(dc, folder, collector, circuit, v_oc)["mean"]


def measured(dc, folder, collector, circuit, v_oc):
    """That power, and the highest voltage of the electrodes (V)."""
    period, text = 1 / FREQUENCY, NETLIST
    for before, after in dict(circuit).items():
        text = text.replace(before, after)
    text = text.replace(COLLECTOR, collector).format(
        current=CAPACITANCE * OMEGA * v_oc, frequency=FREQUENCY, capacitance=CAPACITANCE, dc=dc, inductance=INDUCTANCE,
        resistance=math.sqrt(INDUCTANCE / CAPACITANCE) / QUALITY, envelope=ENVELOPE, step=period / 2000,
        longest=period / 3000, begin=(PERIODS - 2) * period, end=PERIODS * period,
    )  # fmt: skip
    (folder / "breaker.cir").write_text(text)
    out = subprocess.run(
        ["ngspice", "-b", "breaker.cir"], cwd=folder, capture_output=True, text=True, check=False
    ).stdout
    found = dict(re.findall(r"^(mean|highest)\s*=\s*(\S+)", out, re.MULTILINE))
    assert len(found) == 2, out[-2000:]
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
    """The breaker is right within 2.5 %, where a given lag over-predicts by 3 to 12 % over the loads."""
    wanted = of_transistors(dc, tmp_path)
    loop = {"inductance": INDUCTANCE, "quality": QUALITY, "diode_drop": DROP, "dc_voltage": dc}
    found = of_engine(SelfPoweredSSHI(**loop, **BREAKER, envelope_capacitance=ENVELOPE))
    assert found == pytest.approx(wanted, rel=0.025)
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
    found = of_engine(
        SelfPoweredSSHI(
            inductance=INDUCTANCE, quality=QUALITY, diode_drop=DROP, dc_voltage=dc, **BREAKER,
            envelope_capacitance=ENVELOPE,
        )
    )  # fmt: skip
    assert found == pytest.approx(of_transistors(dc, tmp_path, WITHOUT), rel=0.016)
    assert of_transistors(dc, tmp_path) < 0.7 * found


# The base-emitter junction pulls an envelope capacitor below zero with the voltage, so that it is beside C on the whole
# way back: it takes twice the charge that the engine's takes, which begins at zero.
RIDES = {"inductance": INDUCTANCE, "quality": QUALITY, "diode_drop": DROP, "envelope_capacitance": 2 * ENVELOPE}


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("dc", [5.0, 15.0, 25.0])
def test_twice_the_envelope_is_as_good_at_every_load(dc, tmp_path):
    found = of_engine(SelfPoweredSSHI(**RIDES, dc_voltage=dc, **BREAKER))
    assert found / of_transistors(dc, tmp_path) - 1 == pytest.approx(-0.0145, abs=0.005)


@pytest.mark.slow
@needs_ngspice
def test_series_circuit_and_damping_need_twice_the_envelope(tmp_path):
    """A voltage that swings freely to 20 V: alone, the envelope is 12 % off."""
    once = {**RIDES, "envelope_capacitance": ENVELOPE}
    wanted = measured(0.0, tmp_path, WITHOUT, NO_BRIDGE, 5.0)["highest"]
    assert response(SelfPoweredSSDI(**RIDES, **BREAKER), 5.0).voltage_amplitude == pytest.approx(wanted, rel=0.015)
    assert response(SelfPoweredSSDI(**once, **BREAKER), 5.0).voltage_amplitude > 1.1 * wanted
    # Diodes of a bridge in line carry the swing's 10 mA as well: 0.69 V instead of the 0.5 V of an envelope's.
    breaker = {**BREAKER, "breaker_drop": 0.65 + 2 * (0.69 - DROP)}
    wanted = of_transistors(2.0, tmp_path, WITHOUT, SERIES, 8.0)
    found = response(SelfPoweredSeriesSSHI(**RIDES, **breaker, dc_voltage=2.0), 8.0).harvested_power
    assert found == pytest.approx(wanted, rel=0.05)
    assert response(SelfPoweredSeriesSSHI(**once, **breaker, dc_voltage=2.0), 8.0).harvested_power > 1.1 * wanted
