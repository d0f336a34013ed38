"""Results do not depend on the units: kilogram, metre, second, ampere rescaled, each field by the powers in its own."""

import dataclasses
from functools import cache

import pint
import pytest
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from selection import with_slow
from studies import BENCH, DRIVE, STOPS, distance

from piezoharvest.description import effects, shunts
from piezoharvest.description.excitation import SineForce
from piezoharvest.description.hysteresis import Hysteresis
from piezoharvest.description.system import System
from piezoharvest.description.transducer import Transducer
from piezoharvest.engine import simulate

UNITS = pint.get_application_registry()
DIMENSIONS = ("[mass]", "[length]", "[time]", "[current]")
DEVICE = Transducer(**BENCH, hysteresis=Hysteresis(**STOPS), effects=(effects.Leakage(resistance=1e6),))
WITHOUT_STOPS = dataclasses.replace(DEVICE, hysteresis=None)
DRIVE = SineForce(amplitude=DRIVE["amplitude"], frequency=DRIVE["frequency"])
# Elements of a network and a netlist are not fields; a series negative capacitance is unstable beside a leakage.
EXAMPLES = {
    name: shunt
    for name, shunt in examples(shunts.registered()).items()
    if shunt.kind not in ("network", "spice") and getattr(shunt, "topology", "") != "series"
}
THRESHOLDS = ("V", "C", "A", "W", "J")  # units of what does not grow with the force
VOLTAGE = 2.0  # what strain makes of open electrodes
decades = st.floats(-3, 3)
few = settings(max_examples=4, deadline=None, derandomize=True)
each_shunt = pytest.mark.parametrize("name", EXAMPLES)


def factor(unit, scales):
    """Number that a quantity of this unit is multiplied by."""
    powers = UNITS.get_dimensionality(unit)
    result = 1.0
    for dimension, scale in zip(DIMENSIONS, scales, strict=True):
        result *= scale ** float(powers.get(dimension, 0))
    return result


def rescaled(component, scales):
    """The same component in other units."""
    changes = {}
    for field in dataclasses.fields(component):
        value = getattr(component, field.name)
        if dataclasses.is_dataclass(value):
            changes[field.name] = rescaled(value, scales)
        elif isinstance(value, tuple) and value and dataclasses.is_dataclass(value[0]):
            changes[field.name] = tuple(rescaled(part, scales) for part in value)
        elif field.name in ("numerator", "denominator"):  # polynomials in 1/s, of an admittance
            by = factor("S", scales) if field.name == "numerator" else 1.0
            powers = range(len(value) - 1, -1, -1)
            changes[field.name] = tuple(
                by * factor("s", scales) ** n * coefficient for n, coefficient in zip(powers, value, strict=True)
            )
        elif "unit" in field.metadata and value is not None:
            # Of the units in the alternative, the first is that of a force.
            by = factor(field.metadata["unit"].split(" or ")[0], scales)
            changes[field.name] = tuple(by * v for v in value) if isinstance(value, tuple) else by * value
    return dataclasses.replace(component, **changes)


@cache
def in_si_units(name, device=DEVICE):
    """Response of an example, with which all others are compared."""
    return simulate(System(device, EXAMPLES[name]), DRIVE)


def check(name, scales, tolerance=1e-8):
    plain = in_si_units(name)
    found = simulate(System(rescaled(DEVICE, scales), rescaled(EXAMPLES[name], scales)), rescaled(DRIVE, scales))
    assert plain.converged, plain.message
    assert found.converged, found.message
    for field, unit in (
        ("harvested_power", "W"),
        ("mechanical_power", "W"),
        ("displacement_amplitude", "m"),
        ("voltage_amplitude", "V"),
        ("dc_voltage", "V"),
        ("period", "s"),
    ):
        rounding = 1e-9 * VOLTAGE if unit == "V" else 0.0
        same = getattr(found, field) / factor(unit, scales)
        assert same == pytest.approx(getattr(plain, field), rel=tolerance, abs=rounding), field
    assert found.attenuation_db == pytest.approx(plain.attenuation_db, abs=1e-6)
    assert found.events_per_period == plain.events_per_period


@few
@given(decades, decades, decades, decades)
@each_shunt
def test_any_units_will_do(name, kilogram, metre, second, ampere):
    check(name, tuple(10**decade for decade in (kilogram, metre, second, ampere)))


@few
@given(decades)
@pytest.mark.parametrize("name", with_slow(EXAMPLES, slow=lambda name: "{" in name))
def test_power_grows_with_the_square_of_the_force(name, decade):
    """Voltages and charges of the thresholds grow with it: a change of metre and ampere alone.

    Of variants with more fields the test of any units, which holds this one, is the quick one.
    """
    check(name, (1.0, 10**decade, 1.0, 10**decade))


def has_thresholds(component):
    values = [getattr(component, f.name) for f in dataclasses.fields(component) if f.metadata.get("unit") in THRESHOLDS]
    # A supply turns on at a voltage, and what multiplies two signals is faster at larger ones.
    return any(values) or getattr(component, "storage", None) is not None or bool(component.multiplied)


@few
@given(decades)
@pytest.mark.parametrize("name", [name for name, shunt in EXAMPLES.items() if not has_thresholds(shunt)])
def test_without_thresholds_the_force_alone_scales_everything(name, decade):
    device, by = WITHOUT_STOPS, 10**decade
    plain = in_si_units(name, device)
    found = simulate(System(device, EXAMPLES[name]), dataclasses.replace(DRIVE, amplitude=by * DRIVE.amplitude))
    assert found.converged, found.message
    assert found.harvested_power == pytest.approx(by**2 * plain.harvested_power, rel=1e-8)
    assert found.displacement_amplitude == pytest.approx(by * plain.displacement_amplitude, rel=1e-8)
    assert found.attenuation_db == pytest.approx(plain.attenuation_db, abs=1e-6)


@each_shunt
def test_mirrored_coupling_is_mirrored_electrodes(name):
    """Swapping the leads changes the sign of every electrical signal and nothing else."""
    plain = in_si_units(name)
    found = simulate(System(dataclasses.replace(DEVICE, coupling=-DEVICE.coupling), EXAMPLES[name]), DRIVE)
    assert found.harvested_power == pytest.approx(plain.harvested_power, rel=1e-9, abs=1e-18)
    assert found.displacement_amplitude == pytest.approx(plain.displacement_amplitude, rel=1e-9)
    assert found.voltage_amplitude == pytest.approx(plain.voltage_amplitude, rel=1e-9)


@each_shunt
def test_swapped_leads_from_rest(name):
    """Leaving rest is no extremum, whichever way it goes: only the signs of what is electrical change."""
    if not EXAMPLES[name].mirrors:
        pytest.skip("its half waves differ")
    length = 3.2 / DRIVE.frequency
    plain = simulate(System(DEVICE, EXAMPLES[name]), DRIVE, transient=length, samples=100).waveforms
    swapped = dataclasses.replace(DEVICE, coupling=-DEVICE.coupling)
    found = simulate(System(swapped, EXAMPLES[name]), DRIVE, transient=length, samples=100).waveforms
    assert distance(found.displacement, plain.displacement) < 1e-9
    assert distance(-found.charge, plain.charge) < 1e-9
    assert distance(found.dc_voltage, plain.dc_voltage) < 1e-9
