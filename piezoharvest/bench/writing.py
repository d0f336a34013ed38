"""Output of a bench campaign: a folder with the campaign file, a CSV file for each record, optionally the truth."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomli_w

from piezoharvest.bench.measuring import BenchCampaign, BenchRecord
from piezoharvest.bench.sensors import COLUMNS, UNITS, channels
from piezoharvest.description.paths import component_table
from piezoharvest.description.shunts.base import Shunt
from piezoharvest.description.shunts.linear.resistor import Resistor
from piezoharvest.description.shunts.switching import SynchronisedShunt
from piezoharvest.output import OutputError, check_new_directory, write_table, write_text, writing
from piezoharvest.whole_folder import whole_folder

FILE, TRUTH = "campaign.toml", "truth.json"
_MARK = "# Written by piezoharvest measure"


def check_folder(path: str | Path) -> Path:
    """Check in advance that a campaign can be written: the folder is new or empty, or holds an earlier campaign.

    Raises
    ------
    OutputError
        The folder has other content, or its parent cannot be created or written to.
    """
    path = Path(path)
    check_new_directory(path.resolve().parent)
    if path.exists() and not _replaceable(path):
        found = "this directory contains other files" if path.is_dir() else "it exists and is not a directory"
        raise OutputError(
            f"{path}: {found}, must be a new or empty directory, or one that piezoharvest measure has written"
        )
    return path


def _replaceable(path: Path) -> bool:
    """True if a folder is empty or holds an earlier campaign of the bench and nothing else."""
    return path.is_dir() and set(os.listdir(path)) == _own(path)


def _own(path: Path) -> set[str]:
    """Names of the files of an earlier campaign of the bench in a folder."""
    own = {name for name in os.listdir(path) if name in (FILE, TRUTH) or name.endswith(".csv")}
    mine = FILE in own and (path / FILE).read_text(encoding="utf-8", errors="replace").startswith(_MARK)
    return own if mine else set()


def write_campaign(campaign: BenchCampaign, path: str | Path) -> Path:
    """Write a campaign into a folder, completely or not at all.

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
    with whole_folder(path, FILE, _own) as folder, writing(path):
        for record in campaign.records:
            write_table(record.columns, folder / f"{record.name}.csv")
        if campaign.bench.truth:
            write_text(json.dumps(truth(campaign), indent=2) + "\n", folder / TRUTH)
        write_text(f"{_MARK}: a virtual bench, not a real one.\n" + tomli_w.dumps(table(campaign)), folder / FILE)
    return path / FILE


def table(campaign: BenchCampaign) -> dict[str, Any]:
    """Contents of the campaign file (section 4 of the interface)."""
    bench, found, start, entries = campaign.bench, {}, 0.0, []
    for record in campaign.records:
        base = record.setup.excitation.base
        for name, channel in channels(bench, base=base).items():
            if COLUMNS[name] not in record.columns:
                continue
            scale = {"unit": UNITS[name], "sigma": channel.sigma(bench.converter)} if name != "gate" else {}
            found[name] = {"column": COLUMNS[name], **scale}
        entries.append(_entry(record, "base_acceleration" if base else "force", start, campaign.nominal.capacitance))
        start += record.setup.duration
    return {
        "title": campaign.study.title,
        "transducer": component_table(campaign.nominal),
        "channels": found,
        "records": entries,
    }


def _entry(record: BenchRecord, drive: str, start: float, capacitance: float) -> dict[str, Any]:
    shunt, period = record.label, record.setup.excitation.period
    if isinstance(shunt, SynchronisedShunt) and shunt.hold_off is None and period is not None:
        # The label leaves it to the period of the study's drive, and the samples of a drive have no period.
        shunt = replace(shunt, hold_off=shunt.switch(capacitance, period).hold_off)
    if isinstance(shunt, Resistor):
        load: dict[str, Any] = {"load_resistance": shunt.resistance}
    else:
        load = {"shunt": _shunt_table(shunt)}
    return {"file": f"{record.name}.csv", "role": record.setup.role, "drive": drive, **load, "start_time": start}


def _shunt_table(shunt: Shunt) -> dict[str, Any]:
    return {"kind": shunt.kind, **component_table(shunt)}


def truth(campaign: BenchCampaign) -> dict[str, Any]:
    """Contents of `truth.json`: the true specimen and effects."""
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
