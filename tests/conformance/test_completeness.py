"""Parts that a component needs elsewhere: what is missing is named, with the file to write it in."""

import pytest

from piezoharvest.bench.effects import registered as bench_effects
from piezoharvest.bench.solver import CIRCUITS
from piezoharvest.description import effects, shunts

# Those of the package; a user's own script may define more.
SHUNTS = [cls for cls in shunts.registered().values() if cls.__module__.startswith("piezoharvest.")]
EFFECTS = [cls for cls in effects.registered().values() if cls.__module__.startswith("piezoharvest.")]


@pytest.mark.parametrize("cls", EFFECTS, ids=lambda cls: cls.name)
def test_an_effect_has_a_twin_on_the_bench(cls):
    group = cls.__module__.split(".")[-2]
    assert cls.name in bench_effects(), (
        f"the virtual bench cannot make records with {cls.name}: write class {cls.__name__}(BenchEffect) with "
        f"name = {cls.name!r} in piezoharvest/bench/effects/{group}.py, from other equations than those of "
        f"{cls.__module__}"
    )


@pytest.mark.parametrize("cls", SHUNTS, ids=lambda cls: cls.kind)
def test_a_shunt_has_a_circuit_on_the_bench(cls):
    assert cls.kind in CIRCUITS, (
        f"no record can be made with {cls.kind}: write class {cls.__name__}(Circuit) in "
        "piezoharvest/bench/solver/loads: without a switch in circuits.py (UNSWITCHED), with one in switched.py "
        "(SWITCHED) or extraction.py (EXTRACTING), with a controller in controlled.py (CONTROLLED), self-powered in "
        "breakers.py (BREAKING)"
    )
