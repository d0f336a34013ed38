"""What the page of a study shows: its shunts, simulated with the values of the sliders, beside the bound."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import tomli_w

from piezoharvest.description.excitation import Excitation
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.paths import component_table, placed, tree_of
from piezoharvest.description.transducer import Transducer
from piezoharvest.design.bound import bound_of
from piezoharvest.design.goal import Goal
from piezoharvest.design.linear_view import LinearView
from piezoharvest.design.operation import is_sine, operation_of
from piezoharvest.design.result import Bound
from piezoharvest.engine.response import Response
from piezoharvest.engine.simulation import simulate
from piezoharvest.engine.work_limit import MAX_WORK, Budget
from piezoharvest.explore.knobs import Knob, around, size
from piezoharvest.output import check_file, write_text
from piezoharvest.study import DesignOptions, Study, StudyError, read_toml
from piezoharvest.study.studies import check_systems, study_from

# Sizes of circuits that have a slider, in the order in which they are shown.
_SIZES = ("load_resistance", "resistance", "inductance", "capacitance", "quality", "dc_voltage", "source_voltage",
          "smoothing_capacitance")  # fmt: skip
_QUARTER = math.pi / 2  # rad: later or earlier than that a switch works against itself
_OFF_RESONANCE = 0.2  # relative width of the slider of the frequency
_WORK = MAX_WORK // 8  # of one answer: about a second, ten times what an answer may take to feel immediate
_SAMPLES = 256  # of a period: the figures are some 500 pixels wide


class StudyAnswer(NamedTuple):
    """What a position of the sliders gives.

    Attributes
    ----------
    study : Study
        With these values, and the shunt alone.
    response : Response
    bound : Bound or None
        None for excitations that are no sine.
    """

    study: Study
    response: Response
    bound: Bound | None


class StudyExplorer:
    """A study whose values are moved.

    Parameters
    ----------
    study : Study
        With shunts and an excitation that has a frequency, or needs none.
    """

    def __init__(self, study: Study):
        if not study.shunts:
            raise StudyError(study.path, "shunts", "missing tables [[shunts]], at least one is needed to explore")
        self.study = study

    def knobs(self, number: int) -> list[Knob]:
        """Sliders of one of the shunts, of the excitation and of the transducer."""
        shunt, driven = self.study.shunts[number], self.study.excitation
        found = [size(shunt, name, f"shunt.{name}") for name in _SIZES]
        if driven.period is not None:
            found.append(around(shunt, "phase_lag", "shunt.phase_lag", _QUARTER))
        found.append(around(driven, "frequency", "excitation.frequency", _OFF_RESONANCE, relative=True))
        found.append(size(driven, "amplitude", "excitation.amplitude", 1.0))
        coupling = around(self.study.transducer, "coupling", "transducer.coupling", 1.0, relative=True)
        return [knob for knob in [*found, coupling] if knob is not None]

    def answer(self, number: int, values: Mapping[str, float]) -> StudyAnswer:
        """Simulate a shunt with values by path.

        Raises
        ------
        ParameterError
            A value is not allowed, or does not go with the others.
        """
        changed = self._with(number, values)
        (system,) = changed.systems
        with np.errstate(all="ignore"):
            response = simulate(system, changed.excitation, samples=_SAMPLES, budget=Budget(_WORK))
            return StudyAnswer(changed, response, _bound(changed.transducer, changed.excitation))

    def save(self, number: int, values: Mapping[str, float], path: Path) -> None:
        """Write the study, with the values in one of its shunts, as TOML.

        Raises
        ------
        StudyError, ParameterError
            The file that the study is from cannot be read any more, or it names files that are not beside the new one.
        OutputError
            The file cannot be written.
        """
        changed, table = self._with(number, values), dict(read_toml(self.study.path))
        tables = {"shunt": table["shunts"][number], **table}
        for name, value in values.items():  # what was not moved stays as it was written
            part, _, key = name.partition(".")
            if part == "transducer" and not (isinstance(tables[part], dict) and key in tables[part]):
                own = component_table(changed.transducer)  # of a catalogue, a specimen or other figures
                table[part] = {name: entry for name, entry in own.items() if name != "quasi_static"}
            else:
                tables[part][key] = value
        study_from(table, check_file(path, (".toml",)))
        write_text(tomli_w.dumps(table), path)

    def _with(self, number: int, values: Mapping[str, float]) -> Study:
        """The study with one of its shunts alone, and other values."""
        tree = tree_of(list(values), list(values.values()))
        study = self.study
        changed = replace(
            study,
            transducer=placed(study.transducer, tree.get("transducer", {}), "transducer"),
            excitation=placed(study.excitation, tree.get("excitation", {}), "excitation"),
            shunts=(placed(study.shunts[number], tree.get("shunt", {}), "shunt"),),
        )
        check_systems(changed)
        return changed


@lru_cache(maxsize=8)  # a circuit's sliders leave it as it is
def _bound(transducer: Transducer, excitation: Excitation) -> Bound | None:
    """Bounds of the harvested power and of the attenuation at the frequency of a sine, which have closed forms."""
    if not is_sine(excitation):
        return None
    try:
        operation = operation_of(excitation, None, transducer)
    except ParameterError:  # no drive
        return None
    return bound_of(LinearView(transducer, operation, Goal(DesignOptions(objective="trade_off"))).working())
