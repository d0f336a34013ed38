"""Small studies and their reports, each written once for a run of the tests."""

import dataclasses
import re
import tempfile
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

from pages import figures_on_the_page_only

from piezoharvest.design import design
from piezoharvest.report import write_report
from piezoharvest.study import study_from

BEAM = {"mass": 0.010, "damping": 0.0628, "stiffness": 986.96, "coupling": 1.0e-3, "capacitance": 40e-9}
STACK = {"catalogue": "NAC2125-H10"}
SINE = {"kind": "sine_base", "amplitude": 2.0, "frequency": 50.6}
PUSH = {"kind": "sine_force", "amplitude": 450.0, "offset": 550.0, "frequency": 500.0}
STEP = {"kind": "step_force", "amplitude": 0.02, "duration": 0.5, "rise_time": 0.01}
NOISE = {"kind": "random_base", "psd": 0.1, "band": [20.0, 100.0], "duration": 2.0, "seed": 1}
BAND = {"objective": "damping", "band": [48.0, 53.0]}
TITLE = "bench & <beam> at $2"

# Transducer, excitation and table [design].
STUDIES = {
    "bench": (BEAM, SINE, {"candidates": ["resistor", "series_rl", "rectifier", "parallel_sshi", "sece"]}),
    "stack": (STACK, PUSH, {"candidates": ["resistor", "short"]}),
    "bridge on a stack": (STACK, PUSH, {"candidates": ["resistor", "parallel_sshi"]}),
    "band": (BEAM, SINE, {**BAND, "candidates": ["resistor", "series_rl"]}),
    "bridge over a band": (BEAM, SINE, {**BAND, "candidates": ["resistor", "rectifier"]}),
    "step": (BEAM, STEP, {"candidates": ["resistor", "rectifier"]}),
    "noise": (BEAM, NOISE, {"candidates": ["resistor", "sece"]}),
}
_KEPT = tempfile.TemporaryDirectory(prefix="piezoharvest-reports-")


def study_of(name):
    """A study of `STUDIES`."""
    transducer, excitation, options = STUDIES[name]
    table = {"title": TITLE, "transducer": transducer, "excitation": excitation, "design": options}
    return study_from(table, Path("study.toml"))


@cache
def designed(name):
    """A study of `STUDIES` and its design."""
    study = study_of(name)
    return study, design(study)


@cache
def report(name):
    """HTML file of the report of a study of `STUDIES`."""
    return write_report(*designed(name), Path(_KEPT.name) / name)


@cache
def page_of(name):
    """The same, with empty files of figures beside it."""
    with figures_on_the_page_only():
        return write_report(*designed(name), Path(_KEPT.name) / f"page of {name}")


@cache
def untrusted_report():
    """HTML file of a report whose best candidate did not converge, whose next breaks a limit, whose last failed."""
    study, result = designed("bench")
    first, second, *rest, last = result.candidates
    message = "no steady state: the periodic solution is unstable (multiplier 1.02)"
    candidates = (
        dataclasses.replace(first, converged=False, response=_failed(first.response, message)),
        dataclasses.replace(second, violates=("max_voltage",)),
        *rest,
        dataclasses.replace(
            last, converged=False, harvested_power=0.0, displacement_amplitude=0.0, attenuation_db=float("nan"),
            response=_failed(last.response, "simulation failed", waveforms=None, period=0.0, harvested_power=0.0,
                             mechanical_power=0.0, energy=dict.fromkeys(last.response.energy, 0.0)),
        ),
    )  # fmt: skip
    notes = (f"{first.shunt.kind}: not to be trusted: {message}",)
    result = dataclasses.replace(result, candidates=candidates, notes=notes)
    with figures_on_the_page_only():
        return write_report(study, result, Path(_KEPT.name) / "untrusted")


def _failed(response, message, **changes):
    return dataclasses.replace(response, converged=False, message=message, **changes)


class Page(HTMLParser):
    """Elements of a page with their attributes, and its text."""

    def __init__(self, path):
        super().__init__()
        self.source = path.read_text(encoding="utf-8")
        self.tags, self.texts = [], []
        self.feed(self.source)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.texts.append(data)

    @property
    def text(self):
        return re.sub(r"\s+", " ", " ".join(self.texts))

    def all(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


def pictures(path):
    return {file.name for file in path.parent.glob("*.png")}
