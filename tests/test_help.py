"""`help()` of components and results says the units."""

import inspect
from dataclasses import dataclass

import pytest

import piezoharvest as ph
from piezoharvest.cli import main
from piezoharvest.description import effects, shunts
from piezoharvest.description.parameters import Component, described, quantity

CLASSES = [*shunts.registered().values(), *effects.registered().values(), ph.Transducer, ph.SineForce, ph.Hysteresis]


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: cls.__name__)
def test_every_quantity_stands_with_its_unit(cls):
    text = inspect.getdoc(cls)
    for field in cls.__dataclass_fields__.values():
        if field.init and "unit" in field.metadata:
            unit = f" ({field.metadata['unit']})" if field.metadata["unit"] else ""
            assert f"\n{field.name} : " in text
            assert unit in text.split(f"\n{field.name} : ")[1].split("\n")[0]


def test_sections_are_in_their_order_and_own_ones_are_kept():
    text = inspect.getdoc(ph.Transducer)
    assert text.index("m x'' + b x'") < text.index("\nParameters\n---") < text.index("\nRaises\n---")
    assert "mass : float (kg)\n    Mass m of the first mode; greater than 0 kg.\n" in text
    assert "quasi_static : bool, optional" in text
    assert inspect.getdoc(ph.Resistor(resistance=1.0)) == inspect.getdoc(ph.Resistor)


def test_a_component_of_ones_own():
    class Plain(Component):
        """A class that is no dataclass yet."""

    assert Plain.__doc__ == "A class that is no dataclass yet."

    @dataclass(frozen=True, kw_only=True)
    class Made(Plain):
        """With fields."""

        size: float = quantity("m", "size of it", default=2.0, above=0)
        name: str = described("its name", default="")

    lines = ["size : float (m), optional", "    Size of it; greater than 0 m; default 2.0.", "name : str, optional"]
    assert Made.__doc__ == "\n".join(["With fields.", "", "Parameters", "----------", *lines, "    Its name."])


def test_no_summary_of_a_command_is_cut(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["--help"]) == 0
    said = capsys.readouterr().out.split("Commands:")[1]
    assert said.count("\n") > 10 and "..." not in said and "…" not in said
