"""Short campaigns for the tests of the diagnosis: predictions plus white noise, of which all statistics are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from piezoharvest.bench import measure, write_campaign
from piezoharvest.diagnose.selection.start_values import campaign_scales
from piezoharvest.identify.fitting.data import Data
from piezoharvest.identify.fitting.model import Model
from piezoharvest.identify.fitting.output_error import fit
from piezoharvest.identify.fitting.problem import Problem
from piezoharvest.identify.noise.noise_model import Noise
from piezoharvest.predict.parameters import parameters_of
from piezoharvest.predict.prediction import Prediction
from piezoharvest.records import load_campaign
from piezoharvest.study import study_from

SIGMA = {"displacement": 1.5e-8, "voltage": 1.5e-3, "current": 3.5e-8}


STACK = {"mass": 0.0158, "damping": 1250.0, "stiffness": 3.125e8, "coupling": 7.822, "capacitance": 3.2e-6}
STEP = {"kind": "step_force", "amplitude": 900.0, "offset": 100.0, "duration": 1.0, "rise_time": 0.05}
RECORDS = [
    {"load_resistance": 97.78e3, "excitation": STEP},
    {"load_resistance": 51.43e3, "excitation": {"frequency": 3.0}},
    {"load_resistance": 143.8e3, "excitation": {"amplitude": 200.0, "offset": 300.0}},
    {"load_resistance": 97.78e3, "role": "validate"},
]


def campaign(folder, effects=None, records=RECORDS, duration=2.0):
    """Campaign of the bench with short records, of a stack without hysteresis."""
    tables = {
        "transducer": STACK, "shunts": [{"kind": "resistor", "resistance": 97.78e3}],
        "excitation": {"kind": "sine_force", "amplitude": 450.0, "offset": 550.0, "frequency": 4.0},
        "bench": {"duration": duration, "seed": 1, "records": records, "effects": effects or {}},
    }  # fmt: skip
    return load_campaign(write_campaign(measure(study_from(tables, Path("study.toml"))), Path(folder) / "campaign"))


def synthetic(data: Data, transducer, rng, scale=1.0) -> Data:
    """Record with the response of a transducer to its drive, which is known exactly, and white noise."""
    prediction = Prediction(transducer, data.setting)
    values = np.concatenate([block.values for block in prediction.blocks(False)])
    places = [prediction.channels.index(channel) for channel in data.channels]
    noise = rng.standard_normal((len(values), len(places))) * [SIGMA[channel] for channel in data.channels]
    return measuring(replace(data, rest=np.zeros(len(values))), values[:, places] + scale * noise)


def measuring(data: Data, values: np.ndarray) -> Data:
    """Record with other responses."""
    made = replace(data)
    values.flags.writeable = False
    made.__dict__["values"] = values
    return made


def reading(data: Data, channel: str, change) -> Data:
    """Record in which a channel reads what `change` makes of it."""
    values, place = data.values.copy(), data.channels.index(channel)
    values[:, place] = change(values[:, place])
    return measuring(data, values)


def fitted(records, transducer, effects=(), seed=0, scale=1.0):
    """Problem with synthetic records, its fit without effects, and the scene.

    Nominal values are the true ones, and the displacement's offset is free as in a diagnosis.
    """
    rng = np.random.default_rng(seed)
    truth = replace(transducer, effects=tuple(effects))
    problem = Problem([synthetic(each, truth, rng, scale) for each in records], transducer, ("displacement",))
    # Mass and damping are far above the records' frequencies.
    kept = [p for p in parameters_of(transducer, {"force"}) if p.path[0] not in ("mass", "damping")]
    model = Model(transducer, tuple(kept), ("displacement",))
    found = fit(problem, model, noise=Noise(SIGMA), estimate_noise=False)
    return problem, found, campaign_scales(problem.data, found)
