"""A test beside each effect file that is written: what every effect has to keep, for pytest to run."""

from __future__ import annotations

from pathlib import Path

from piezoharvest.output import write_text

TEMPLATE = '''"""What the effect in {file} has to keep: `pytest {test}`."""

import dataclasses
from pathlib import Path

import pint
import pytest

from piezoharvest import Resistor, SineForce, System, Transducer, simulate
from piezoharvest.description.effects import registered
from piezoharvest.description.parameters import ParameterError
from piezoharvest.effect_files import load_effects

(NAME,) = load_effects(Path(__file__).with_name({file!r}))
EFFECT = registered()[NAME]
FIELDS = [field for field in dataclasses.fields(EFFECT) if "unit" in field.metadata]
PLAIN = Transducer(mass=0.010, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
OPPOSITE = {{"above": -1.0, "at_least": -1.0, "below": 1.0, "at_most": 1.0}}  # sides of the bounds that are refused


def run(*effects):
    """Five periods from rest."""
    system = System(dataclasses.replace(PLAIN, effects=effects), Resistor(resistance=1e5))
    try:
        return simulate(system, SineForce(amplitude=0.02, frequency=45.0), transient=5 / 45.0)
    except ParameterError as error:  # a product with a broken line: records are predicted with it, no more
        pytest.skip(f"it cannot be simulated: {{error}}")


def test_it_changes_nothing_at_its_null_value():
    strengths = [field for field in FIELDS if field.metadata["null"] is not None]
    nulls = {{field.name: field.metadata["null"] for field in strengths}}
    steps = {{field.name: nulls[field.name] + 1e-9 * (field.default - nulls[field.name]) for field in strengths}}
    assert EFFECT(**nulls).absent
    near, without = run(EFFECT(**steps)), run()  # at null it is left out
    assert near.displacement_amplitude == pytest.approx(without.displacement_amplitude, rel=1e-6)
    assert near.voltage_amplitude == pytest.approx(without.voltage_amplitude, rel=1e-6)


def test_energy_closes():
    assert not EFFECT().absent
    assert abs(run(EFFECT()).energy["closure"]) < 1e-6  # steps with smooth elements leave 1e-8


def test_every_quantity_has_a_unit_and_says_what_it_is():
    assert FIELDS
    units = pint.UnitRegistry()
    for field in FIELDS:
        units(field.metadata["unit"] or "dimensionless")
        assert field.metadata["doc"]
        assert isinstance(field.default, float)


def test_values_beyond_their_bounds_are_refused():
    for field in FIELDS:
        with pytest.raises(ParameterError):
            EFFECT(**{{field.name: float("nan")}})
        for bound, side in OPPOSITE.items():
            if field.metadata[bound] is not None:
                with pytest.raises(ParameterError):
                    EFFECT(**{{field.name: field.metadata[bound] + side * (1.0 + abs(field.metadata[bound]))}})
'''


def save_effect_test(path: Path) -> Path:
    """Write the test of an effect file beside it, as `test_FILE.py`; return where.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    target = path.with_name(f"test_{path.name}")
    write_text(TEMPLATE.format(file=path.name, test=target.name), target)
    return target
