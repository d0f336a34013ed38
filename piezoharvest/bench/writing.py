"""A campaign of the bench as a folder: the campaign file, a CSV file for each record, and the truth if asked for."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from pathlib import Path
from typing import Any

import tomli_w

from piezoharvest.bench.measuring import BenchCampaign, BenchRecord
from piezoharvest.bench.sensors import channels
from piezoharvest.description.parameters import Component
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.output import OutputError, check_directory, check_new_directory, write_table, write_text, writing
from piezoharvest.records.reading.channels import COLUMNS, UNITS

FILE, TRUTH = "campaign.toml", "truth.json"
_MARK = "# Written by piezoharvest measure"


def check_folder(path: str | Path) -> Path:
    """Make sure, before any work is done, that a campaign can be written: new or empty, or an earlier campaign.

    Raises
    ------
    OutputError
        Something else is there, or the folder above cannot be made or written to.
    """
    path = Path(path)
    check_new_directory(path.resolve().parent)
    if path.exists() and not _replaceable(path):
        found = "found a folder with other files" if path.is_dir() else "found something that is not a folder"
        raise OutputError(f"{path}: {found}, allowed is a new or empty one, or one that measure has written")
    return path


def _replaceable(path: Path) -> bool:
    """Whether a folder is empty or holds an earlier campaign of the bench and nothing else."""
    if not path.is_dir():
        return False
    names = {entry.name for entry in path.iterdir()}
    if not names:
        return True
    own = all(name in (FILE, TRUTH) or name.endswith(".csv") for name in names)
    return own and FILE in names and (path / FILE).read_text(encoding="utf-8", errors="replace").startswith(_MARK)


def write_campaign(campaign: BenchCampaign, path: str | Path) -> Path:
    """Write a campaign into a folder, which is there as a whole or not at all.

    Returns
    -------
    Path
        The campaign file.

    Raises
    ------
    OutputError
        The folder cannot be written.
    """
    path = check_folder(path)
    target = path.resolve()
    check_directory(target.parent, create=True)
    new, old = (target.with_name(f".{target.name}.{os.getpid()}.{part}") for part in ("part", "old"))
    try:
        with writing(path):
            new.mkdir()
            for record in campaign.records:
                write_table(record.columns, new / f"{record.name}.csv")
            if campaign.bench.truth:
                write_text(json.dumps(truth(campaign), indent=2) + "\n", new / TRUTH)
            write_text(f"{_MARK}: a virtual bench, not a real one.\n" + tomli_w.dumps(table(campaign)), new / FILE)
            _exchange(new, target, old)
    finally:
        shutil.rmtree(new, ignore_errors=True)
    return path / FILE


def _exchange(new: Path, target: Path, old: Path) -> None:
    """Put a folder in the place of another one, which comes back if that fails."""
    if target.exists():
        os.rename(target, old)
    try:
        os.rename(new, target)
    except OSError:
        if old.exists():
            os.rename(old, target)
        raise
    shutil.rmtree(old, ignore_errors=True)


def table(campaign: BenchCampaign) -> dict[str, Any]:
    """The campaign file: section 4 of the interface."""
    bench, found, start, entries = campaign.bench, {}, 0.0, []
    for record in campaign.records:
        base = record.setup.excitation.base
        for name, channel in channels(bench, base=base).items():
            found[name] = {"column": COLUMNS[name], "unit": UNITS[name], "sigma": channel.sigma(bench.converter)}
        entries.append(_entry(record, "base_acceleration" if base else "force", start))
        start += record.setup.duration
    return {
        "title": campaign.study.title,
        "transducer": component_table(campaign.nominal),
        "channels": found,
        "records": entries,
    }


def _entry(record: BenchRecord, drive: str, start: float) -> dict[str, Any]:
    shunt = record.setup.shunt
    if isinstance(shunt, Resistor):
        load: dict[str, Any] = {"load_resistance": shunt.resistance}
    else:
        load = {"shunt": _shunt_table(shunt)}
    return {"file": f"{record.name}.csv", "role": record.setup.role, "drive": drive, **load, "start_time": start}


def _shunt_table(shunt: Shunt) -> dict[str, Any]:
    return {"kind": shunt.kind, **component_table(shunt)}


def component_table(component: Component) -> dict[str, Any]:
    """Table of a component as a study file has it: effects by name, nothing for what is not given."""
    found: dict[str, Any] = {}
    for field in (field for field in dataclasses.fields(component) if field.init):
        value = getattr(component, field.name)
        if field.name == "effects":
            value = {effect.name: component_table(effect) for effect in value}
        elif isinstance(value, Component):
            value = component_table(value)
        elif isinstance(value, tuple):
            value = [component_table(part) if isinstance(part, Component) else part for part in value]
        if value is not None and value not in ("", [], {}):
            found[field.name] = value
    return found


def truth(campaign: BenchCampaign) -> dict[str, Any]:
    """What really stood on the bench: for `truth.json`."""
    records = []
    for record in campaign.records:
        shunt = record.setup.shunt
        for effect in campaign.effects:
            shunt = effect.connect(shunt)
        excitation = {"kind": record.setup.excitation.kind, **component_table(record.setup.excitation)}
        records.append({"file": f"{record.name}.csv", "shunt": _shunt_table(shunt), "excitation": excitation})
    return {
        "transducer": component_table(campaign.study.transducer),
        "effects": {effect.name: component_table(effect) for effect in campaign.effects},
        "bench": component_table(campaign.bench),
        "records": records,
    }
