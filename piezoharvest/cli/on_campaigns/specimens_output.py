"""Output of `identify` and `diagnose` for a campaign of several specimens."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from piezoharvest.cli import tables
from piezoharvest.cli.notes import note
from piezoharvest.cli.on_campaigns.identification_output import identification_json as of_one
from piezoharvest.cli.on_campaigns.law_files import save_laws

if TYPE_CHECKING:
    from piezoharvest.diagnose import Diagnosis
    from piezoharvest.identify import Identification
    from piezoharvest.population import SpecimensDiagnosis, SpecimensIdentification
    from piezoharvest.population.diagnosis import OfSpecimen
    from piezoharvest.population.results import OfKind, Value

_T = TypeVar("_T")


def identified(found: SpecimensIdentification, *, as_json: bool, report: Path | None, save: Path | None) -> int:
    """Print an identification, write its reports and specimen files; exit status."""
    for text in [*(f"not to be trusted: {doubt}" for doubt in found.doubts), *found.warnings]:
        note(f"warning: {text}")
    if as_json:
        tables.print_json(identification_json(found))
    else:
        _print_values(found.specimens.title, found.kind, found.specimens.names, [_values(e) for e in found.each])
    if save is not None:
        note(f"specimens: {', '.join(map(str, found.save(save)))}")
    if report is not None:
        from piezoharvest.report import write_identification

        _write_reports(found.specimens.names, found.each, report, write_identification, as_json)
    return 1 if found.doubts else 0


def diagnosed(
    found: SpecimensDiagnosis, *, as_json: bool, report: Path | None, save: Path | None, save_effect: Path | None
) -> int:
    """Print a diagnosis, write its reports, specimen files and laws; exit status."""
    for doubt in found.doubts:
        note(f"warning: not to be trusted: {doubt}")
    if as_json:
        tables.print_json(diagnosis_json(found))
    else:
        print(f"{found.verdict}: {found.sentence}")
        _print_values(found.specimens.title, found.kind, found.specimens.names, [e.values for e in found.each])
    if save is not None:
        note(f"specimens: {', '.join(map(str, found.save(save)))}")
    alone = [each.alone for each in found.each]
    if save_effect is not None:
        with_law = (each for each in alone if each.discovery)
        save_laws(next(with_law, alone[0]), save_effect)
    if report is not None:
        from piezoharvest.report import write_diagnosis

        _write_reports(found.specimens.names, alone, report, write_diagnosis, as_json)
    return 1 if found.doubts else 0


def identification_json(found: SpecimensIdentification) -> dict[str, Any]:
    """Result as a table of the JSON output: that of one specimen for the kind, with `specimens` and `population`."""
    each = [of_one(one) for one in found.each]
    names = found.specimens.names
    return {
        "title": found.specimens.title,
        "converged": all(one["converged"] for one in each),
        "message": "; ".join(f"{name}: {one['message']}" for name, one in zip(names, each, strict=True)),
        "trusted": not found.doubts,
        "warnings": [*found.doubts, *found.warnings],
        "parameters": {name: _mean(row) for name, row in found.kind.items()},
        "population": _population(found.kind),
        "fit": {"rms": dict(found.fit.rms), "noise": dict(found.fit.noise)},
        "validation": {"rms": dict(found.validation.rms), "noise": dict(found.validation.noise)},
        "records": [{**row, "specimen": name} for name, one in zip(names, each, strict=True) for row in one["records"]],
        "specimens": [
            {
                "name": name, "alike": n not in found.pooled.apart, "differs": list(found.pooled.odd.get(n, ())),
                "parameters": {
                    e.parameter.name: {**row, "alone": {"value": e.value, "std": e.std}}
                    for e, row in zip(found.alone[n].estimates, one["parameters"].values(), strict=True)
                },
                **{key: one[key] for key in ("converged", "trusted", "fit", "validation")},
            }
            for n, (name, one) in enumerate(zip(names, each, strict=True))
        ],
    }  # fmt: skip


def diagnosis_json(found: SpecimensDiagnosis) -> dict[str, Any]:
    """Result as a table of the JSON output: that of one specimen for the kind, with `specimens` and `population`."""
    from piezoharvest.diagnose.discovery.result import as_json

    laws = next((each.alone.discovery for each in found.of_kind if each.alone.discovery), ())
    before, after = found.quality("before"), found.quality("after")
    of_model = {name: row for name, row in found.kind.items() if row.parameter.path[0] != "effects"}
    return {
        "title": found.specimens.title,
        "converged": not found.doubts,
        "verdict": found.verdict,
        "summary": found.sentence,
        "effects": [
            {"name": name, "p_value": found.p_value, "gain": found.gain, "parameters": {
                key: _mean(row) for key, row in _of(name, found.kind).items()
            }}
            for name in sorted(found.form.form)
        ],
        "discovery": [as_json(law) for law in laws] if found.verdict == "new_effect" else [],
        "alternatives": [sorted(form) for form in found.form.rivals],
        "parameters": {name: _mean(row) for name, row in of_model.items()},
        "population": _population(found.kind),
        "validation": {
            "noise": dict(after.noise), "rms_before": dict(before.rms), "rms_after": dict(after.rms),
        },
        "unexplained": found.unexplained,
        "experiment": found.experiment,
        "specimens": [
            _specimen(name, one, found.differs(n))
            for n, (name, one) in enumerate(zip(found.specimens.names, found.each, strict=True))
        ],
    }  # fmt: skip


def _specimen(name: str, one: OfSpecimen, differs: Sequence[str]) -> dict[str, Any]:
    own = one.effects
    return {
        "name": name, "alike": one.alike, "differs": list(differs), "verdict": one.alone.verdict,
        "effects": [
            {"name": kind, "parameters": {key: _value(row) for key, row in _of(kind, one.values).items()}}
            for kind in map(_kind, own)
        ],
        "parameters": {
            e.parameter.name: {
                **_value((e.value, e.std, e.parameter.unit)), "identifiable": e.identifiable, "note": e.note,
                "alone": {"value": a.value, "std": a.std},
            }
            for e, a in zip(one.estimates, one.alone.estimates, strict=True)
        },
        "validation": {
            "noise": dict(one.after.noise), "rms_before": dict(one.before.rms), "rms_after": dict(one.after.rms),
        },
    }  # fmt: skip


def _kind(effect: Any) -> str:
    from piezoharvest.population.naming import kind_of

    return kind_of(effect)


def _of(effect: str, rows: Mapping[str, _T]) -> dict[str, _T]:
    """Rows of an effect's parameters, by their own names."""
    return {key.removeprefix(f"{effect}."): row for key, row in rows.items() if key.startswith(f"{effect}.")}


def _mean(row: OfKind) -> dict[str, Any]:
    from piezoharvest.identify.identifiability import MAX_RELATIVE_ERROR, relative_error

    known = relative_error(row.mean, row.std) < MAX_RELATIVE_ERROR
    return {"value": row.mean, "std": row.std, "unit": row.parameter.unit, "identifiable": known}


def _population(kind: Mapping[str, OfKind]) -> dict[str, Any]:
    return {
        name: {"mean": row.mean, "spread": row.spread, "std": row.std, "unit": row.parameter.unit}
        for name, row in kind.items()
    }


def _value(row: tuple[float, float | None, str]) -> dict[str, Any]:
    return dict(zip(("value", "std", "unit"), row, strict=True))


def _values(found: Identification) -> dict[str, Value]:
    return {e.parameter.name: (e.value, e.std, e.parameter.unit) for e in found.estimates if e.std is not None}


def _print_values(
    title: str, kind: Mapping[str, OfKind], names: Sequence[str], each: Sequence[Mapping[str, Value]]
) -> None:
    """Print mean and spread of the kind, and the values of each specimen, a row for each parameter."""
    from piezoharvest.report.units import engineering, with_error

    rows = [
        [
            name,
            with_error(row.mean, row.std, row.parameter.unit),
            engineering(row.spread, row.parameter.unit),
            *(with_error(*values[name]) if name in values else "" for values in each),
        ]
        for name, row in kind.items()
    ]
    tables.print_rows(title, ["parameter", "mean", "spread", *names], rows)


def _write_reports(
    names: Sequence[str], each: Sequence[Identification | Diagnosis], folder: Path, write: Callable, as_json: bool
) -> None:
    """Write a report of each specimen into a folder of its own, and print their paths."""
    for n, (name, one) in enumerate(zip(names, each, strict=True), 1):
        tables.print_report(partial(write, one, folder / f"{n}"), as_json=as_json, name=name)
