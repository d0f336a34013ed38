"""A harvester is designed, falls short on the bench, is diagnosed, and is designed again with what was learned."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomli_w

from piezoharvest.bench import measure, write_campaign
from piezoharvest.description.paths import component_table
from piezoharvest.description.shunts import Shunt
from piezoharvest.design import design
from piezoharvest.design.result import Candidate, DesignResult
from piezoharvest.diagnose import Diagnosis, diagnose
from piezoharvest.engine import simulate
from piezoharvest.engine.response import Response
from piezoharvest.output import write_text
from piezoharvest.progress import silent
from piezoharvest.records import load_campaign
from piezoharvest.records.record import Record
from piezoharvest.study import Study, load_driven_study, load_study, read_toml

PERIODS = 10  # at the end of a record, over which the power is averaged: by then it is within 0.3 % of its steady state
STEPS = (
    ("the first design", "piezoharvest design study.toml --report design"),
    ("measurement of its power", "piezoharvest measure built.toml --out measured"),
    ("the campaign", "piezoharvest measure bench.toml --out campaign"),
    ("the original model, fitted", "piezoharvest identify campaign/campaign.toml --save identified.toml"),
    ("the cause", "piezoharvest diagnose campaign/campaign.toml --report diagnosis --save specimen.toml"),
    ("what the fitted model predicts", "piezoharvest simulate identified_prediction.toml"),
    ("what the extended model predicts", "piezoharvest simulate specimen_prediction.toml"),
    ("the second design", "piezoharvest design redesign.toml"),
    ("its power", "piezoharvest measure rebuilt.toml --out remeasured"),
)
Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Look:
    """A circuit on the bench, at the excitation of the study.

    Attributes
    ----------
    shunt : Shunt
        By its label.
    record : Record
    power : float
        W, of the load, mean over the last periods of the record.
    """

    shunt: Shunt
    record: Record
    power: float


@dataclass(frozen=True, eq=False)
class Story:
    """What happened, in its order.

    Attributes
    ----------
    study : Study
    design : DesignResult
        The first one; its best candidate is built.
    first : Look
    found : Diagnosis
    fitted, extended : Response
        Of the first circuit, which no fit has seen at this excitation: by the model as it was, with fitted parameters,
        and by the one with the effects that were found.
    redesigned : Candidate
    second : Look
    """

    study: Study
    design: DesignResult
    first: Look
    found: Diagnosis
    fitted: Response
    extended: Response
    redesigned: Candidate
    second: Look

    @property
    def designed(self) -> Candidate:
        """The circuit of the first design."""
        return self.design.best

    @property
    def converged(self) -> bool:
        """True if all that it rests on can be trusted."""
        simulated = (self.fitted, self.extended, self.designed, self.redesigned)
        return self.found.search.final.converged and all(one.converged for one in simulated)


def tell(path: Path, bench: Mapping[str, Any], first: DesignResult, folder: Path, progress: Progress) -> Story:
    """Measure a design, diagnose what is missing, design again and measure that; every file is left in the folder.

    Parameters
    ----------
    path : Path
        Study of the design.
    bench : mapping
        Tables [transducer] and [bench] of the harvester as it is.
    first : DesignResult
        Its best candidate is a circuit with a switched coil and a load behind its bridge.
    folder : Path
        Existing; of the study.
    progress : callable
        Called with messages.
    """
    study, tables = load_study(path), read_toml(path)

    def written(name: str, shunt: Shunt, more: Mapping[str, Any]) -> Study:
        shunts = [{"kind": shunt.kind, **component_table(shunt)}]
        table = {"title": study.title, **more, "excitation": tables["excitation"], "shunts": shunts}
        write_text(tomli_w.dumps(table), folder / name)
        return load_driven_study(folder / name)

    built = timed(first.best.shunt, study)
    alone = {**bench, "bench": {key: value for key, value in bench["bench"].items() if key != "records"}}
    progress("measuring the design")
    measured = _look(written("built.toml", built, alone), folder / "measured")
    progress("measuring the campaign")
    campaign = write_campaign(measure(written("bench.toml", built, bench), progress), folder / "campaign")
    found = diagnose(load_campaign(campaign), progress)
    found.before.save(folder / "identified.toml")
    found.save(folder / "specimen.toml")
    fitted, extended = (
        _steady(written(f"{name}_prediction.toml", built, {"transducer": f"{name}.toml"}))
        for name in ("identified", "specimen")
    )
    progress("designing again, with the cause")
    # A command of the switch's controller, which the first design had no reason to change, is free now.
    goal = {**tables["design"], "candidates": [built.kind], "tune": ["on_time_error"]}
    changed = written("redesign.toml", first.best.shunt, {"transducer": "specimen.toml", "design": goal})
    redesigned = design(changed, silent).best
    progress("measuring the new design")
    remeasured = _look(written("rebuilt.toml", timed(redesigned.shunt, study), alone), folder / "remeasured")
    return Story(study, first, measured, found, fitted, extended, redesigned, remeasured)


def timed(shunt: Any, study: Study) -> Shunt:
    """The circuit as it is built: its switch knows a time after the extremum, not an angle of a drive."""
    assert study.excitation.period is not None
    lag = shunt.time_lag + shunt.phase_lag * study.excitation.period / (2.0 * math.pi)
    return replace(shunt, phase_lag=0.0, time_lag=lag)


def _look(study: Study, folder: Path) -> Look:
    """Measure a study's circuit, and read the power of its load off the dc voltage."""
    (record,) = load_campaign(write_campaign(measure(study, silent), folder)).records
    assert isinstance(record, Record) and study.excitation.period is not None
    (shunt,) = study.shunts
    count = round(PERIODS * study.excitation.period * record.sample_rate)
    power = float((record["dc_voltage"][-count:] ** 2).mean()) / vars(shunt)["load_resistance"]
    return Look(shunt, record, power)


def _steady(study: Study) -> Response:
    (system,) = study.systems
    return simulate(system, study.excitation)
