"""Commands that write and read netlists of circuit simulators."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from piezoharvest.cli import tables
from piezoharvest.cli.commands import driven_study, with_shunts
from piezoharvest.cli.notes import note, telling
from piezoharvest.counting import counted
from piezoharvest.description.parameters import ParameterError
from piezoharvest.description.system import System
from piezoharvest.input import InputError, check_readable
from piezoharvest.output import check_file, write_text
from piezoharvest.study import Study, StudyError

MOST_BYTES = 1 << 20  # of a netlist
SCHEMATIC = re.compile(r"Version \d+(\.\d+)?\s*\nSHEET ", re.IGNORECASE)


def export(path: Path, out: Path, shunt: int | None, options: dict[str, Any], tolerance: float | None) -> int:
    """Write a study with one of its shunts as a SPICE netlist or schematic; with a tolerance, check it in ngspice."""
    check_file(out)
    study = with_shunts(driven_study(path))
    n = shunt or 0
    if not n < len(study.shunts):
        raise StudyError(
            study.path, f"shunts.{n}", f"the study has no such shunt, --shunt may be 0 to {len(study.shunts) - 1}"
        )
    from piezoharvest.spice import export_spice
    from piezoharvest.spice.export import FROM_REST

    try:
        text = export_spice(study.transducer, study.shunts[n], study.excitation, title=study.title, **options)
    except ParameterError as error:
        raise StudyError(study.path, f"shunts.{n} ({study.shunts[n].kind})", str(error)) from None
    if out.suffix.lower() == ".asc":
        from piezoharvest.spice.simulators.schematic import schematic

        text = schematic(text)
    write_text(text, out)
    if shunt is None and len(study.shunts) > 1:
        note(
            f"warning: only shunts.0 ({study.shunts[0].kind}) of {len(study.shunts)} shunts is written; "
            "--shunt N selects another"
        )
    if FROM_REST in text.partition("\n")[2] and study.excitation.period is not None:
        note(
            f"warning: shunts.{n} ({study.shunts[n].kind}): the netlist starts from rest, not in the steady state of "
            "piezoharvest simulate: its results are those of the end of its run"
        )
    print(out)
    return 0 if tolerance is None else _check(study, n, options.get("diodes"), tolerance)


def _check(study: Study, n: int, diodes: str | None, tolerance: float) -> int:
    """Run one shunt of a study in ngspice, and print both answers; 1 if they differ, or one of them cannot be had."""
    from piezoharvest.spice.simulators.comparison import compare
    from piezoharvest.spice.simulators.ngspice import NgspiceError

    where = f"shunts.{n} ({study.shunts[n].kind})"
    try:
        with telling() as tell:
            figures, trusted = compare(
                System(study.transducer, study.shunts[n]), study.excitation, diodes, progress=tell
            )
    except ParameterError as error:
        raise StudyError(study.path, where, str(error)) from None
    except NgspiceError as error:
        note(f"warning: {where}: not checked: {' '.join(str(error).split())}")
        return 1
    rows = [(f.name, f"{f.engine:.6g}", f"{f.ngspice:.6g}", f"{100 * f.difference:+z.3f} %", f.unit) for f in figures]
    tables.print_rows(f"{where}, here and in ngspice", ("", "piezoharvest", "ngspice", "difference", "unit"), rows)
    if not trusted:
        note(f"warning: {where}: the result of this simulation is not to be trusted: see piezoharvest simulate")
    wrong = [f.name for f in figures if not abs(f.difference) <= tolerance]
    if wrong:
        note(f"warning: {where}: {', '.join(wrong)} differ by more than {100 * tolerance:g} % (--tolerance)")
    return 1 if wrong or not trusted else 0


def import_netlist(
    path: Path, out: Path | None, port: str | None, load: tuple[str, ...], subcircuit: str | None
) -> int:
    """Read a netlist as a shunt, and write it as a table of a study."""
    import tomli_w

    from piezoharvest.description.shunts.spice_circuit import SpiceCircuit

    if out is not None:
        check_file(out)
    text, nodes = _text(path), _nodes(port)
    ports = [nodes] if nodes else [("p", "0"), ("1", "0")]
    for n, each in enumerate(ports, 1):
        try:
            shunt = SpiceCircuit(netlist=text, port=each, load=load, subcircuit=subcircuit)
            break
        except ParameterError as error:
            if error.key != "port" or n == len(ports):
                raise StudyError(path, "", str(error)) from None
    own = {"subcircuit": subcircuit} if subcircuit else {"port": list(shunt.port)}
    table = {"shunts": [{"kind": "spice", **own, "load": list(shunt.load), "netlist": text}]}
    written = tomli_w.dumps(table, multiline_strings=True)
    parts, choices = len(shunt.branches), len(shunt.configurations())
    sizes = ((parts, "part"), (len(shunt.states(1.0)), "state"), (choices, "configuration"))
    note(f"{path}: {', '.join(counted(*size) for size in sizes)}")
    if out is None:
        print(written, end="")
    else:
        write_text(written, out)
        print(out)
    return 0


def _nodes(port: str | None) -> tuple[str, ...] | None:
    return None if port is None else tuple(word.strip() for word in port.split(","))


def _text(path: Path) -> str:
    """Text of a netlist: UTF-8, UTF-16 with its mark, or, as LTspice writes, Latin-1."""
    try:
        check_readable(path, MOST_BYTES)
        data = path.read_bytes()
    except InputError as error:
        raise StudyError(path, "", str(error)) from None
    except OSError as error:
        raise StudyError(path, "", f"the file cannot be read ({error.strerror})") from None
    if b"\0" in data and not data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise StudyError(path, "", "found binary data, but a netlist is text")
    encoding = "utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if SCHEMATIC.match(text):
        advice = "export its netlist from LTspice (View > SPICE Netlist) and import that"
        raise StudyError(path, "", f"found a schematic of LTspice, must be a netlist: {advice}")
    return text
