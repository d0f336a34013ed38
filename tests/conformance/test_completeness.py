"""Parts that a component needs elsewhere: what is missing is named, with the file to write it in."""

import pytest

from piezoharvest.bench.effects import registered as bench_effects
from piezoharvest.bench.solver import CIRCUITS
from piezoharvest.description import effects, shunts

# Those of the package; a user's own script may define more.
SHUNTS = [cls for cls in shunts.registered().values() if cls.__module__.startswith("piezoharvest.")]
EFFECTS = [cls for cls in effects.registered().values() if cls.__module__.startswith("piezoharvest.")]
# Without a circuit on the bench: netlists with diodes and switches, and a tracker, which takes its voltage from an
# excitation that a circuit there does not see.
NOT_ON_THE_BENCH = {"spice", "mppt"}


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
    assert cls.kind in CIRCUITS or cls.kind in NOT_ON_THE_BENCH, (
        f"no record can be made with {cls.kind}: write class {cls.__name__}(Circuit) in "
        "piezoharvest/bench/solver/loads: without a switch in circuits.py (UNSWITCHED), with one in switched.py "
        "(SWITCHED) or extraction.py (EXTRACTING), with a controller in controlled.py (CONTROLLED), self-powered in "
        "breakers.py (BREAKING), or say in NOT_ON_THE_BENCH why not"
    )
