"""One random campaign, damaged or healthy, given to the commands that read campaigns as a user would."""

from __future__ import annotations

import json
import signal
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from piezoharvest.bench.solver import SolverError
from reports.reliability.campaigns.damage import LAW, damage
from reports.reliability.campaigns.drawing import CampaignDraw, Columns, Tables
from reports.reliability.inputs import PLAIN, _judged, _run

LIMIT = 240.0  # s of processor time of a command
BENCH_LIMIT = 30.0  # s of processor time for what the bench measures
HEALTHY = 0.2
COMMANDS = ("identify",) * 6 + ("diagnose",) * 3 + ("new",)


class TookTooLongError(BaseException):
    """More processor time than a command may take; no `Exception`, as those are answered with a sentence."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise `TookTooLongError` after so much processor time of this process."""

    def stop(signum: int, frame: Any) -> None:
        raise TookTooLongError("".join(traceback.format_stack(frame)[-6:]))

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def written(seed: int, folder: Path) -> tuple[Tables, list[str], Tables]:
    """Write the campaign of a seed into a folder: its tables, the damage, the true transducer."""
    rng = np.random.default_rng((53, seed))
    healthy = bool(rng.random() < HEALTHY)
    with limited(BENCH_LIMIT):
        tables, files, truth = CampaignDraw(seed, healthy).campaign()
    done = ["healthy"] if healthy else damage(rng, tables, files)
    tables, files = json.loads(json.dumps(tables, default=lambda each: each.item())), files
    for name, columns in files.items():
        _write(folder / name, columns)
    (folder / "campaign.toml").write_text(tomli_w.dumps(tables), encoding="utf-8")
    return tables, done, truth


def _write(path: Path, columns: Columns) -> None:
    lines = [
        ",".join(columns),
        *(",".join(f"{each:.9g}" for each in row) for row in zip(*columns.values(), strict=True)),
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def attempt_campaign(seed: int, commands: Sequence[str] = COMMANDS) -> dict[str, Any]:
    """What becomes of the campaign of a seed; the command after `check` is one of `commands`.

    Returns
    -------
    dict
        `seed`, `kind` (the command after `check`), `damage`, `outcome` ("done", "not to be trusted", "refused",
        "internal error", "impossible" where what is written is wrong, "slow", "no campaign" where the bench measures
        none), `what`, `checked` (outcome of `check`), `deviations` of a healthy one, and `seconds` of processor time.
    """
    rng = np.random.default_rng((59, seed))
    command = str(rng.choice(commands))
    row: dict[str, Any] = {"seed": seed, "kind": command, "outcome": "", "what": "", "closure": None, "damage": []}
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder = Path(name)
        inside, out = folder / "in", folder / "out"
        inside.mkdir()
        out.mkdir()
        try:
            tables, row["damage"], truth = written(seed, inside)
        except (SolverError, TookTooLongError) as error:
            return {**row, "outcome": "no campaign", "what": str(error)[:300], "seconds": time.process_time() - begin}
        begin = time.process_time()
        try:
            with limited(LIMIT):
                row |= _given(command, tables, truth, inside, out, rng)
        except TookTooLongError as error:
            row |= {"outcome": "slow", "what": str(error)[-600:]}
        row["what"] = row["what"].replace(f"{folder}/", "")
    return {**row, "seconds": round(time.process_time() - begin, 3)}


def _given(command: str, tables: Tables, truth: Tables, inside: Path, out: Path, rng: np.random.Generator) -> dict:
    before = {path.name: path.read_bytes() for path in inside.iterdir()}
    path = inside / "campaign.toml"
    checked = _judged(*_run(["check", str(path), "--json"]))
    found: dict[str, Any] = {"checked": checked["outcome"]}
    if checked["outcome"] in ("internal error", "impossible"):
        return {**found, **checked, "what": f"check: {checked['what']}"}
    if command == "new":
        made = out / "made.toml"
        files = sorted(str(path) for path in inside.glob("*.csv"))
        status, printed, said = _run(["new", "campaign", *files, "--out", str(made)])
        judged = _judged(status, "", said)
        if made.exists() and judged["outcome"] in ("done", "not to be trusted"):
            again = _judged(*_run(["check", str(made), "--json"]))
            judged = again if again["outcome"] in ("internal error", "impossible") else judged
        return {**found, **judged}
    saved, report = out / "specimen.toml", out / "report"
    options = ["--json", "--save", str(saved)]
    if rng.random() < 0.1:
        options += ["--report", str(report)]
    if command == "diagnose" and rng.random() < 0.2:
        options += ["--effects", str(_law())]
    status, printed, said = _run([command, str(path), *options])
    judged = _judged(status, printed, said)
    if judged["outcome"] in ("done", "not to be trusted") and "deviation" not in judged["what"]:
        judged |= {"deviations": deviations(json.loads(printed or "{}"), truth)} if "specimens" not in tables else {}
    left = {each.name for each in out.iterdir() if each != report and not each.name.startswith("specimen")}
    if left or {path.name: path.read_bytes() for path in inside.iterdir() if path.is_file()} != before:
        judged = {"outcome": "impossible", "what": f"left {sorted(left)}, or changed what it was given"}
    if status == 2 and (saved.exists() or report.exists()):
        judged = {"outcome": "impossible", "what": f"refused, but written; {judged['what']}"}
    if saved.exists() and "specimens" not in tables and judged["outcome"] in ("done", "not to be trusted"):
        study = inside / "study.toml"
        study.write_text(tomli_w.dumps({**PLAIN, "transducer": str(saved)}), encoding="utf-8")
        used = _judged(*_run(["simulate", str(study), "--json"]))
        if used["outcome"] in ("internal error", "impossible") or (
            used["outcome"] == "refused" and "specimen.toml" in used["what"] and "quasi_static" not in used["what"]
        ):
            judged = {**used, "outcome": "impossible", "what": f"the specimen that is saved: {used['what']}"}
    return {**found, **judged}


@lru_cache
def _law() -> Path:
    """File of a user's law: the same for all campaigns, as its class stays registered in this process."""
    path = Path(tempfile.mkdtemp()) / "law.py"
    path.write_text(LAW, encoding="utf-8")
    return path


def deviations(result: Tables, truth: Tables) -> dict[str, float]:
    """Distances of what is identified from the truth in standard errors, but of what nominal values are assumed for."""
    found = {}
    for name, each in result.get("parameters", {}).items():
        if name in truth and each.get("std") and isinstance(truth[name], float) and not each.get("assumes"):
            found[name] = (each["value"] - truth[name]) / each["std"]
    return found
