"""Values at the paths of a study: the same as if they stood in its file, one by one and as a batch."""

import copy
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweep_studies import EVERYTHING

from piezoharvest.description.parameters import ParameterError
from piezoharvest.study import study_from
from piezoharvest.sweep.place import parameters, place

TABLE = tomllib.loads(EVERYTHING)
STUDY = study_from(TABLE, Path("study.toml"))
PATHS = {
    *(f"transducer.{name}" for name in ("mass", "damping", "stiffness", "coupling", "capacitance", "effective_mass")),
    *(f"transducer.hysteresis.{name}.{n}" for name in ("thresholds", "weights") for n in (0, 1)),
    *(
        f"transducer.modes.0.{name}"
        for name in ("mass", "damping", "stiffness", "coupling", "force_participation", "effective_mass")
    ),
    "transducer.sensor_participation",
    "transducer.modes.0.sensor_participation",
    "transducer.effects.leakage.resistance",
    *(f"excitation.{name}" for name in ("amplitude", "frequency", "offset")),
    "shunts.0.resistance",
    *(
        f"shunts.1.{name}"
        for name in (
            "inductance", "flip_time", "quality", "on_time_error", "phase_lag", "time_lag", "hold_off", "dc_voltage",
            "smoothing_capacitance", "load_resistance", "diode_drop", "diode_resistance", "diode_leakage", "dc_leakage",
            "diode_saturation", "saturation_voltage",
            "detector_threshold", "switch_resistance", "initial_dc_voltage", "smoothing_resistance", "gate_energy",
            "control_power", "start_voltage", "stop_voltage", "core_resistance", "self_resonance",
        )
    ),
}  # fmt: skip
# Instead of another value that the study gives, and allowed only without it; or only beside one that it does not give.
ALTERNATIVES = {"shunts.1.flip_time", "shunts.1.dc_voltage", "shunts.1.stop_voltage", "shunts.1.self_resonance"}
PLACES = sorted(PATHS - ALTERNATIVES)


def edited(path, value):
    """System and excitation of the study whose file has the value at the path."""
    table = copy.deepcopy(TABLE)
    *branches, leaf = path.split(".")
    node = table
    for word in branches:
        node = node[int(word)] if isinstance(node, list) else node[word]
    node[int(leaf) if isinstance(node, list) else leaf] = value
    study = study_from(table, Path("study.toml"))
    return study.systems, study.excitation


def value_near(path):
    """Another value, which is allowed there."""
    part = STUDY
    for word in path.split("."):
        named = {getattr(inner, "name", None): inner for inner in part} if isinstance(part, tuple) else {}
        part = named.get(word) or part[int(word)] if isinstance(part, tuple) else getattr(part, word)
    return 1.1 * part if part else 1e-3


def test_every_number_has_a_path():
    assert set(parameters(STUDY)) == PATHS


def test_whole_numbers_have_none():
    noise = {"kind": "random_force", "psd": 1e-6, "band": [10.0, 200.0], "duration": 1.0, "seed": 3}
    study = study_from({**TABLE, "excitation": noise}, Path("study.toml"))
    found = {path for path in parameters(study) if path.startswith("excitation.")}
    assert found == {"excitation.psd", "excitation.band.0", "excitation.band.1", "excitation.duration"}


@pytest.mark.parametrize("path", PLACES)
def test_a_number_is_placed_as_if_it_stood_in_the_file(path):
    value = value_near(path)
    systems, excitation = edited(path, value)
    assert (systems, excitation) != (STUDY.systems, STUDY.excitation)
    for shunt, system in enumerate(systems):
        assert place(STUDY, shunt, [path], [value]) == (system, excitation)


@given(st.lists(st.sampled_from(PLACES), min_size=1, max_size=5, unique=True))
def test_a_batch_holds_the_single_designs(paths):
    batch = np.outer([1.0, 1.01, 1.02], [value_near(path) for path in paths])
    for shunt in range(2):
        placed = place(STUDY, shunt, paths, [*batch.T[:, :, np.newaxis]])
        for n, values in enumerate(batch.tolist()):
            assert same(placed, place(STUDY, shunt, paths, values), n)


def same(batch, single, n):
    """Whether a part of a batch has in row n what the single part has."""
    if isinstance(batch, np.ndarray):
        assert batch.shape == (3, 1)
        return batch[n, 0] == single
    if isinstance(batch, tuple):
        return len(batch) == len(single) and all(same(b, s, n) for b, s in zip(batch, single, strict=True))
    if hasattr(batch, "__dataclass_fields__"):
        return all(same(getattr(batch, name), getattr(single, name), n) for name in batch.__dataclass_fields__)
    return batch == single


def test_values_of_a_component_are_placed_together():
    """One by one, the first threshold would be above the second."""
    names = [f"transducer.hysteresis.thresholds.{n}" for n in (0, 1)]
    system, _ = place(STUDY, 0, names, [5e-7, 8e-7])
    assert system.transducer.hysteresis.thresholds == (5e-7, 8e-7)


def test_values_for_another_shunt_are_left_out():
    system, _ = place(STUDY, 0, ["shunts.1.quality", "shunts.0.resistance"], [9.0, 5e3])
    assert system.shunt.resistance == 5e3


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("shunts.0.resistance", -1.0, "shunts.0.resistance: found -1.0, must be a finite number greater than 0 ohm"),
        ("transducer.modes.0.mass", 0.0, "transducer.modes.0.mass: found 0.0"),
        ("transducer.effects.leakage.resistance", 0.0, "transducer.effects.leakage.resistance: found 0.0"),
        ("transducer.hysteresis.thresholds.0", 4e-7, "transducer.hysteresis.thresholds: found 3e-07 after 4e-07"),
        ("shunts.1.flip_time", 1e-4, "shunts.1.inductance: found both inductance and flip_time"),
    ],
)
def test_what_a_component_refuses_is_named_by_its_path(path, value, message):
    with pytest.raises(ParameterError) as caught:
        place(STUDY, int(path.split(".")[1]) if path.startswith("shunts") else 0, [path], [value])
    assert str(caught.value).startswith(message)
