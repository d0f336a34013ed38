"""The result table of a sweep: a row for each design and shunt."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from piezoharvest.engine.response import has_merit
from piezoharvest.study import Study
from piezoharvest.sweep.place import parameters

if TYPE_CHECKING:
    import pyarrow

_FIGURES = {
    "harvested_power": "W", "mechanical_power": "W", "efficiency": "", "displacement_amplitude": "m",
    "voltage_amplitude": "V", "dc_voltage": "V", "attenuation_db": "dB", "closure": "", "figure_of_merit": "",
}  # fmt: skip
_COUNTS = ("events_per_period",)
_ENERGY = ("mechanical_in", "harvested", "damping", "hysteresis", "shunt_loss", "source")


def known_outputs(study: Study) -> dict[str, str]:
    """Units of all outputs of a study, by name; energies are per period and named as in "energy.damping"."""
    losses = [effect.name for effect in study.transducer.effects]
    return {**_FIGURES, **dict.fromkeys(_COUNTS, ""), **{f"energy.{name}": "J" for name in (*_ENERGY, *losses)}}


def wanted_outputs(study: Study) -> tuple[str, ...]:
    """Outputs of a sweep; unless the study names them, the averages of `simulate` and the energy balance error."""
    if study.sweep is not None and study.sweep.outputs is not None:
        return study.sweep.outputs
    merit = has_merit(study.transducer, study.excitation)
    return tuple(name for name in _FIGURES if merit or name != "figure_of_merit")


def paths(study: Study) -> tuple[str, ...]:
    """Paths of the swept parameters."""
    return tuple(parameter.path for parameter in study.sweep.parameters) if study.sweep else ()


def units(study: Study) -> tuple[dict[str, str], dict[str, str]]:
    """SI units of the swept parameters by path, and of the wanted outputs by name."""
    fields, outputs = parameters(study), known_outputs(study)
    wanted = {name: outputs[name] for name in wanted_outputs(study)}
    return {path: fields[path].metadata["unit"] for path in paths(study)}, wanted


def schema(study: Study) -> pyarrow.Schema:
    """Names, types and units of the columns: design, the parameters, shunt, kind, converged, the outputs."""
    import pyarrow as pa

    inputs, outputs = units(study)
    return pa.schema(
        [
            pa.field("design", pa.int64()),
            *(pa.field(path, pa.float64(), metadata={"unit": unit}) for path, unit in inputs.items()),
            pa.field("shunt", pa.int64()),
            pa.field("kind", pa.string()),
            pa.field("converged", pa.bool_()),
            *(
                pa.field(name, pa.int64() if name in _COUNTS else pa.float64(), metadata={"unit": unit})
                for name, unit in outputs.items()
            ),
        ]
    )


def tabulate(
    form: pyarrow.Schema, kinds: Sequence[str], designs: range, values: np.ndarray, answers: Mapping[str, np.ndarray]
) -> pyarrow.Table:
    """Rows of a range of designs.

    Parameters
    ----------
    Schema from `schema`.
        As `schema` gives it.
    kinds : sequence of str
        Of the shunts.
    designs : range
        Numbers of the designs.
    values : (n, p) array
        Values of the parameters.
    answers : mapping
        From `evaluate`: (n, shunts) arrays by name; values that are not finite are null in the table.
    """
    import pyarrow as pa

    shunts = len(kinds)
    columns = [
        np.repeat(np.arange(designs.start, designs.stop), shunts),
        *(np.repeat(column, shunts) for column in values.T),
        np.tile(np.arange(shunts), len(designs)),
        [*kinds] * len(designs),
        *(_known(answers[name].ravel(), name) for name in form.names[values.shape[1] + 3 :]),
    ]
    return pa.table([pa.array(column, field.type) for column, field in zip(columns, form, strict=True)], schema=form)


def _known(values: np.ndarray, name: str) -> np.ma.MaskedArray:
    """Values of an answer with those that are not finite masked."""
    masked = np.ma.masked_invalid(values)
    if name in _COUNTS:
        return np.ma.array(masked.filled(0).astype(np.int64), mask=np.ma.getmaskarray(masked))
    return masked
