"""Numbers of things in messages: one of them is in the singular."""

import re
from pathlib import Path

import numpy as np
import pytest

import piezoharvest
from piezoharvest import Campaign, Hysteresis, Multisine, Transducer
from piezoharvest.counting import counted
from piezoharvest.description.parameters import ParameterError
from piezoharvest.records.errors import CampaignError

ROOT = Path(piezoharvest.__file__).parent
# f"found {len(x)} samples" and the like: a count before a plural, without `counted`.
COUNT = re.compile(r"found \{len\([^{}]*\)(?: - 1)?\} [a-z]+s\b|found (?:only )?\{count\} [a-z]+s\b")
MORE_THAN_ONE = {  # refused only where there are too many, or none
    "description/spice_language/expressions.py", "description/spice_language/reading.py",
    "description/shunts/spice_circuit.py", "description/shunts/curves/curved.py",
    "description/shunts/damping/digital.py", "description/shunts/harvesting/sshc.py", "readers/base.py",
    "records/loading.py",
}  # fmt: skip


@pytest.mark.parametrize(
    ("count", "words", "text"),
    [
        (0, ("sample",), "0 samples"),
        (1, ("sample",), "1 sample"),
        (np.int64(1), ("sample",), "1 sample"),
        (2, ("frequency", "frequencies"), "2 frequencies"),
        ("1", ("period",), "1 period"),
        ("1.5", ("period",), "1.5 periods"),
    ],
)
def test_a_number_of_things(count, words, text):
    assert counted(count, *words) == text


def test_one_of_them_is_singular_in_errors():
    nominal = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
    with pytest.raises(CampaignError, match="found 1 sample, allowed are two or more"):
        Campaign.from_arrays(
            nominal,
            [
                {
                    "data": {"force_N": np.ones(1), "displacement_m": np.ones(1)},
                    "sample_rate": 1e3,
                    "load_resistance": 1e5,
                }
            ],
        )
    with pytest.raises(ParameterError, match="found 2 values for 1 frequency, each"):
        Multisine(amplitudes=(1.0, 2.0), frequencies=(5.0,), phases=(0.0,), duration=1.0)
    with pytest.raises(ParameterError, match="found 2 for 1 threshold, each"):
        Hysteresis(thresholds=(1e-7,), weights=(1e5, 2e5))


def test_no_message_counts_without_the_singular():
    found = {path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*.py") if COUNT.search(path.read_text("utf-8"))}
    assert found <= MORE_THAN_ONE
