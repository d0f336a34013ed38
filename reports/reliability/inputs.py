"""One wrong input: a file or the tables of a command, made from valid ones, given to the program as a user would."""

from __future__ import annotations

import contextlib
import io
import json
import random
import re
import resource
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import tomli_w

from piezoharvest.cli import main
from piezoharvest.readers import ReadError, open_reader
from reports.reliability.files import ARRAYS, BINARIES, COLUMNS, NAMES, TEXTS, csv
from reports.reliability.mutation import mutate_bytes, mutate_tables, mutate_text
from reports.reliability.studies import Draw

LONG = {"file": 10.0, "tables": 60.0}  # s of processor time; the work limit ends a simulation within half of that
MEMORY = 2 * 2**30  # bytes of the process and of each that it starts: what needs more fails
SHARE_OF_FILES = 0.8
COMMANDS = ("simulate", "simulate", "simulate", "measure", "export", "sweep", "design", "identify")
PLAIN: dict[str, Any] = {
    "transducer": {"mass": 0.01, "damping": 0.2, "stiffness": 1000.0, "coupling": 1.5e-3, "capacitance": 4e-8},
    "excitation": {"kind": "sine_force", "amplitude": 0.02, "frequency": 50.6},
    "shunts": [{"kind": "resistor", "resistance": 8e4}],
}
OWN: dict[str, dict[str, Any]] = {
    "sweep": {"sweep": {"method": "grid", "outputs": ["harvested_power"], "parameters": [
        {"path": "shunts.0.resistance", "from": 1e4, "to": 1e6, "scale": "log", "count": 3}]}},
    "design": {"design": {"objective": "harvest", "candidates": ["resistor", "series_rl"], "parts": "E24",
                          "max_voltage": 60.0}},
    "measure": {"bench": {"duration": 0.2, "sample_rate": 2000.0, "seed": 1, "laser": {"sensitivity": 5e3},
                          "load_cell": {"sensitivity": 100.0, "noise": 1e-5}}},
    "identify": {"title": "bench", "transducer": PLAIN["transducer"], "channels": {
        "time": {"column": "time_s", "unit": "s"}, "force": {"column": "force_N", "unit": "N"},
        "voltage": {"column": "voltage_V", "gain": 1.0, "offset": 0.0}},
        "records": [{"file": "run.csv", "role": "fit", "drive": "force", "load_resistance": 97780.0, "rows": [2, 40]}]},
}  # fmt: skip


def attempt_input(seed: int) -> dict[str, Any]:
    """What becomes of the wrong input of a seed.

    Returns
    -------
    dict
        `seed`, `kind` (the file's name, or the command), `outcome` ("read", "done", "not to be trusted", "refused",
        "internal error", "impossible" where what is written is wrong, "slow"), `what` and `seconds` of processor time.
    """
    rng, begin = random.Random(seed), time.process_time()
    row: dict[str, Any] = {"seed": seed, "kind": "", "closure": None}
    is_file = rng.random() < SHARE_OF_FILES
    with _limited_memory(), tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of readers about their files; the program tells what it thinks of them
        row |= _of_file(rng, Path(folder)) if is_file else _of_tables(seed, rng, Path(folder))
    seconds = time.process_time() - begin
    if seconds > LONG["file" if is_file else "tables"] and row["outcome"] != "internal error":
        row |= {"outcome": "slow", "what": f"{seconds:.0f} s: {row['what']}"}
    return {**row, "seconds": round(seconds, 3)}


@contextlib.contextmanager
def _limited_memory() -> Iterator[None]:
    """Limit the memory that this process takes in addition, and that of those that it starts meanwhile.

    In what a process of the tests has already, there would be no room for a thread, whose start then waits forever.
    """
    before = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (_taken() + MEMORY, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


def _taken() -> int:
    """Bytes of data that this process has, as the system counts them for the limit."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmData")))


def _of_file(rng: random.Random, folder: Path) -> dict[str, Any]:
    """Read the columns of a wrong file by name and by number."""
    name = rng.choice([*TEXTS, *BINARIES])
    path = folder / name
    try:
        _write_wrong(name, path, rng)
    except Exception as error:  # of the library that writes: not every array can stand in every file
        return {"kind": name, "outcome": "not written", "what": f"{type(error).__name__}: {error}"[:300]}
    column = rng.choice([*NAMES, 1, 2, "force", "Kraft", "v(force_N)", "data[:, 0]", ""])
    try:
        with open_reader(path) as reader:
            reader.read([reader.resolve(column)])
    except ReadError as error:
        return {"kind": name, **_refused(error.message)}
    except Exception as error:
        return {"kind": name, "outcome": "internal error", "what": f"{type(error).__name__}: {error}"[:300]}
    return {"kind": name, "outcome": "read", "what": ""}


def _write_wrong(name: str, path: Path, rng: random.Random) -> None:
    if name in TEXTS:
        text = mutate_text(TEXTS[name](), rng)
        path.write_bytes(text.encode(rng.choice(["utf-8", "utf-8", "utf-16", "utf-8-sig"]), errors="replace"))
        return
    columns = dict(COLUMNS)
    if rng.random() < 0.5:
        columns[rng.choice(NAMES)] = rng.choice(ARRAYS)
    BINARIES[name](columns, path)
    if rng.random() < 0.6:
        path.write_bytes(mutate_bytes(path.read_bytes(), rng))


def _of_tables(seed: int, rng: random.Random, folder: Path) -> dict[str, Any]:
    """Run a command on wrong tables; `folder/in` has its input, `folder/out` is where it may write."""
    command, (inside, out) = rng.choice(COMMANDS), (folder / "in", folder / "out")
    inside.mkdir()
    (inside / "run.csv").write_text(csv().replace("time (s),force (N),voltage (V)", ",".join(NAMES)), encoding="utf-8")
    valid = _valid(command, seed)
    path = inside / "input.toml"
    try:
        path.write_text(tomli_w.dumps(mutate_tables(valid, rng)), encoding="utf-8")
    except (TypeError, UnicodeError) as error:  # a key that TOML has no form for
        return {"kind": command, "outcome": "not written", "what": str(error)[:300]}
    arguments = {"measure": ["--out", str(out)], "export": ["--out", str(out)], "sweep": ["--out", f"{out}.csv"]}
    status, printed, said = _run([command, str(path), *arguments.get(command, ["--json"])])
    found = _judged(status, printed if command in ("simulate", "design", "identify") else "", said)
    strays = sorted({each.name for each in folder.iterdir()} - {"in", "out", "out.csv"})
    left = sorted({each.name for each in inside.iterdir()} - {"run.csv", "input.toml"})
    if strays or left:
        found = {"outcome": "impossible", "what": f"written outside the given folder: {strays or left}"}
    return {"kind": command, **found}


def _valid(command: str, seed: int) -> dict[str, Any]:
    """Tables of a command that are right: of a random study, or plain ones where every key is used."""
    if command == "identify":
        return OWN[command]
    plain = command in ("sweep", "design") or seed % 2
    tables = PLAIN if plain else Draw(seed).study()
    return json.loads(json.dumps({**tables, **OWN.get(command, {})}, default=lambda each: each.item()))


def _run(arguments: Sequence[str]) -> tuple[int, str, str]:
    """Status of the program, what it prints, and what it says."""
    printed, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
        status = main(arguments)
    return status, printed.getvalue(), said.getvalue()


def _judged(status: int, printed: str, said: str) -> dict[str, Any]:
    last = said.strip().split("\n")[-1] if said.strip() else ""
    if "internal error" in said or "Traceback" in said:
        return {"outcome": "internal error", "what": last[:300]}
    if status == 2:
        return _refused(last.removeprefix("piezoharvest: ").removeprefix("error: "))
    if status not in (0, 1):
        return {"outcome": "internal error", "what": f"status {status}: {last}"[:300]}
    try:
        json.loads(printed or "{}", parse_constant=_not_json)
    except ValueError as error:
        return {"outcome": "impossible", "what": f"what is printed is no JSON: {error}"[:300]}
    if status == 1 and not last:
        return {"outcome": "impossible", "what": "status 1 without a word"}
    return {"outcome": ("done", "not to be trusted")[status], "what": last[:300]}


def _not_json(constant: str) -> None:
    raise ValueError(f"{constant} among the results")


def _refused(message: str) -> dict[str, Any]:
    """A refusal must be one line of several words without the name of an exception's class."""
    outside = re.sub(r"\(.*\)", "", message)
    sentence = len(message.split()) > 2 and "\n" not in message and not re.search(r"\b\w+Error\b", outside)
    return {"outcome": "refused" if sentence else "internal error", "what": message[:300]}
