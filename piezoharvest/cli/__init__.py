"""The command line: `piezoharvest simulate | design | sweep | measure | check | identify | diagnose | plan`.

Beside these there are `export`, `import`, `explore`, `new`, `catalogue` and `demo`. typer only parses the arguments;
each command returns the work to be done, which `main` runs. Exit status: 0 done; 1 done, but the result is unreliable;
2 bad input; 130 interrupted, 143 terminated.
"""

from __future__ import annotations

import atexit
import errno
import gc
import math
import os
import sys
from collections.abc import Callable, Sequence
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

import piezoharvest

Work = Callable[[], int]
# A process that ends need not look for garbage: that was a quarter of the processor time of a short command.
atexit.register(gc.freeze)
MOST_ERRORS = 20  # of a campaign's data, beyond the first one
_FULL = (
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
)  # errors of a write to stdout: a full disk, or too large a file

app = typer.Typer(
    help="Piezoelectric shunt damping and energy harvesting: simulate, design, identify and diagnose from TOML files.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="Study file (TOML).", show_default=False)]
CampaignFile = Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (TOML).", show_default=False)]
ReportFolder = Annotated[Path | None, typer.Option(metavar="DIR", help="Write an HTML report into this directory.")]
SpecimenFile = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Save the identified specimen (TOML), for use in studies.")
]


def _load_effects(files: list[Path] | None) -> list[Path]:
    from piezoharvest.effect_files import load_effects

    for file in files or []:
        load_effects(file)
    return files or []


EffectFiles = Annotated[
    list[Path] | None,
    typer.Option("--effects", metavar="FILE", help="Your own effects (.py, as --save-effect writes); may be repeated.",
                 callback=_load_effects),
]  # fmt: skip


class NetlistDialect(StrEnum):
    """Programs that read netlists."""

    NGSPICE = "ngspice"
    LTSPICE = "ltspice"


AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")]


def _version(wanted: bool) -> None:
    if wanted:
        print(f"piezoharvest {piezoharvest.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", help="Show no progress on stderr, only warnings and errors.")
    ] = False,
) -> None:
    """Take the options that stand before the command."""
    from piezoharvest.cli.notes import be_quiet

    be_quiet(quiet)


def _positive(value: float | None) -> float | None:
    if value is not None and not 0 < value < math.inf:
        raise typer.BadParameter(f"found {value}, must be a finite number greater than 0")
    return value


@app.command()
def simulate(
    study: StudyFile,
    json: AsJson = False,
    transient: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Simulate a transient of this length from rest instead of the steady state.",
            callback=_positive,
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save the waveforms: .csv, .npz, .h5 or .parquet.")
    ] = None,
    uncertainty: Annotated[
        int | None,
        typer.Option(metavar="N", min=2, max=100_000, help="Give quantiles from N draws of an identified specimen."),
    ] = None,
    effects: EffectFiles = None,
) -> Work:
    """Simulate every shunt of a study.

    Computes the periodic steady state for a periodic excitation, and a transient for any other or with --transient.

    The waveform file is one table with the columns shunt (from 0), kind, time_s, drive (N or m/s^2), displacement_m,
    velocity_m_per_s, voltage_V, current_A, charge_C, hysteresis_voltage_V, dc_voltage_V and
    acceleration_m_per_s2.

    --uncertainty needs a study whose transducer is a specimen file (transducer = "FILE", as identify --save writes):
    each result is given with its 5, 50 and 95 % quantiles, from the covariance of the identified values.
    """
    from piezoharvest.cli import commands

    return partial(commands.simulate, study, as_json=json, transient=transient, out=out, uncertainty=uncertainty)


@app.command()
def design(
    study: StudyFile,
    json: AsJson = False,
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write an HTML report into this directory.")
    ] = None,
    effects: EffectFiles = None,
) -> Work:
    """Tune and rank the candidates of a study.

    The table [design] states the objective; every candidate is compared with the bound for passive linear shunts.
    """
    from piezoharvest.cli import commands

    return partial(commands.design, study, as_json=json, report=report)


@app.command()
def sweep(
    study: StudyFile,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Table to write: .parquet or .csv.", show_default=False)],
    workers: Annotated[int, typer.Option(metavar="N", min=1, help="Number of processes on this machine.")] = 1,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Use the Dask cluster of this scheduler, such as tcp://host:8786."),
    ] = None,
    json: AsJson = False,
) -> Work:
    """Simulate a study at many values of its parameters.

    The table [sweep] names the parameters and outputs. A sweep that was stopped is resumed by the same command:
    finished designs are kept in FILE.partial until FILE is complete.

    A design is one set of values of the parameters. FILE has one row for each design and shunt, with the columns
    design, the parameters by their paths, shunt (from 0), kind, converged, and the outputs; an output that has no value
    is null.
    """
    if scheduler is not None and workers > 1:
        raise typer.BadParameter("--workers is given too, but only one of the two may be", param_hint="--scheduler")
    from piezoharvest.cli import sweep_command

    return partial(sweep_command.sweep, study, out, workers=workers, scheduler=scheduler, as_json=json)


@app.command()
def measure(
    study: StudyFile,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Directory of the campaign to write.", show_default=False)],
) -> Work:
    """Measure a study on the virtual bench.

    Every record is computed by an independent solver and passed through the sensors, amplifiers and A/D converter of
    the table [bench]. DIR must be new, empty or an earlier campaign; campaign.toml and one CSV file for each record are
    written into it.
    """
    from piezoharvest.cli import commands

    return partial(commands.measure, study, out)


@app.command()
def check(campaign: CampaignFile, json: AsJson = False) -> Work:
    """Read and check the records of a campaign, without a fit.

    Prints what each record is taken for: drive, load, samples, and the range of every channel, where a wrong unit is
    easily seen. The exit status is 1 if there are warnings.
    """
    from piezoharvest.cli.on_campaigns import check_command

    return partial(check_command.check, campaign, as_json=json)


@app.command()
def identify(
    campaign: CampaignFile,
    json: AsJson = False,
    report: ReportFolder = None,
    save: SpecimenFile = None,
) -> Work:
    """Identify a transducer's parameters from measured records.

    The records of a campaign are read, checked, and fitted together. A parameter that they cannot determine keeps its
    nominal value and is reported as not identifiable.
    """
    from piezoharvest.cli.on_campaigns import identify_command

    return partial(identify_command.identify, campaign, as_json=json, report=report, save=save)


@app.command()
def diagnose(
    campaign: Annotated[
        Path | None, typer.Argument(metavar="[CAMPAIGN]", help="Campaign file (TOML).", show_default=False)
    ] = None,
    json: AsJson = False,
    report: ReportFolder = None,
    save: SpecimenFile = None,
    save_effect: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save a newly found law as an effect file (.py).")
    ] = None,
    effects: EffectFiles = None,
    batch: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Diagnose all campaigns in this folder instead of one.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="With --batch: table of verdicts to write (.csv or .jsonl).")
    ] = None,
    workers: Annotated[int, typer.Option(metavar="N", min=1, help="With --batch: number of processes.")] = 1,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="With --batch: the Dask cluster of this scheduler.")
    ] = None,
) -> Work:
    """Find out why the model does not fit the measured records.

    The model is fitted and every known effect is tested. The effects that are present are named and fitted with the
    model, and the gain is measured on the validation records. If no known effect explains what is left, a new law is
    sought: a function of one input, added at one place in the model and given as a formula. Whatever this law does
    not explain is reported as unexplained.

    With --batch, every campaign in DIR and its subfolders is diagnosed, and FILE has one row for each: verdict,
    effects, law, gain, parameters with standard errors, or the error. A batch that was stopped is resumed by the same
    command, which diagnoses only what is new or has changed.
    """
    if batch is not None:
        of_one = campaign, report, save, save_effect
        return _fleet(of_one, batch, out, effects or [], workers=workers, scheduler=scheduler, as_json=json)
    if campaign is None:
        raise typer.BadParameter("missing: give a campaign file, or --batch with a folder", param_hint="CAMPAIGN")
    if out is not None or workers > 1 or scheduler is not None:
        raise typer.BadParameter("--out, --workers and --scheduler go with --batch only", param_hint="--batch")
    from piezoharvest.cli.on_campaigns import diagnose_command

    return partial(diagnose_command.diagnose, campaign, as_json=json, report=report, save=save, save_effect=save_effect)


def _fleet(
    of_one: tuple[Path | None, ...], batch: Path, out: Path | None, effects: list[Path], *, workers: int,
    scheduler: str | None, as_json: bool,
) -> Work:  # fmt: skip
    """Work of `diagnose --batch`."""
    if any(each is not None for each in of_one):
        message = "a campaign file, --report, --save and --save-effect are for one campaign, and do not go with --batch"
        raise typer.BadParameter(message, param_hint="--batch")
    if out is None:
        raise typer.BadParameter("--out FILE is needed too, a table .csv or .jsonl", param_hint="--batch")
    if scheduler is not None and workers > 1:
        raise typer.BadParameter("--workers is given too, but only one of the two may be", param_hint="--scheduler")
    from piezoharvest.cli.on_campaigns import fleet_command

    return partial(
        fleet_command.diagnose_fleet, batch, out, effects=effects, workers=workers, scheduler=scheduler,
        as_json=as_json,
    )  # fmt: skip


@app.command()
def plan(
    campaign: CampaignFile,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Study file to write (TOML); default: print it.")
    ] = None,
    parameter: Annotated[
        str | None, typer.Option(metavar="NAME", help="Reduce the standard error of this parameter.")
    ] = None,
    json: AsJson = False,
) -> Work:
    """Plan the most informative next measurement.

    The campaign is diagnosed first. Among the sines, steps, loads and durations that its records (or its table
    [experiment]) show to be possible, the record is chosen that best distinguishes the two most likely sets of effects,
    or that most reduces the standard error of a parameter. The result is a study for piezoharvest measure.
    """
    from piezoharvest.cli.on_campaigns import plan_command

    return partial(plan_command.plan, campaign, out=out, parameter=parameter, as_json=json)


@app.command()
def explore(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Study or campaign (TOML).", show_default=False)],
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page on 127.0.0.1; 0: any free port.")] = 0,
    save: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Where the page saves the study; default: FILE-explored.toml beside FILE."),
    ] = None,
    effects: EffectFiles = None,
) -> Work:
    """Serve a page with sliders for a study or campaign.

    The page is served on this machine only, and its address is printed; no internet is needed. Power, attenuation,
    waveforms, loops and the bound follow the sliders. For a campaign, the page shows records and residuals, with
    effects that can be switched on and off. Ctrl-C stops the server.
    """
    from piezoharvest.cli import explore_command

    return partial(explore_command.explore, file, port=port, save=save)


@app.command()
def export(
    study: StudyFile,
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to write.", show_default=False)],
    form: Annotated[
        str, typer.Option("--format", metavar="FORMAT", help="Only spice, which ngspice and LTspice read.")
    ] = "spice",
    shunt: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Number of the shunt in the study, from 0.", show_default="0")
    ] = None,
    dialect: Annotated[
        NetlistDialect | None, typer.Option(help="Write for one simulator only.", show_default="both at once")
    ] = None,
    diodes: Annotated[
        str | None,
        typer.Option(metavar="MODEL", help="Diode model for the bridge, such as BAT54 or 'D(Is=2.5n N=1.75 Rs=0.57)'."),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Run it in ngspice and print both results; exit status 1 if they differ.")
    ] = False,
    tolerance: Annotated[
        float, typer.Option(metavar="SHARE", min=0.0, help="Relative difference that --check allows.")
    ] = 0.01,
) -> Work:
    """Write a netlist for ngspice and LTspice.

    The netlist starts in the steady state. A schematic for LTspice is written to a FILE that ends in .asc.
    """
    if form != "spice":
        raise typer.BadParameter(f"found {form!r}, the only format is spice", param_hint="--format")
    if out.suffix.lower() == ".asc":
        if dialect is NetlistDialect.NGSPICE:
            found = "found ngspice, but a schematic (.asc) is for LTspice"
            raise typer.BadParameter(found, param_hint="--dialect")
        dialect = NetlistDialect.LTSPICE
    from piezoharvest.cli import export_command

    options = {"dialect": dialect.value if dialect else None, "diodes": diodes}
    return partial(export_command.export, study, out, shunt, options, tolerance if check else None)


@app.command(name="import")
def import_netlist(
    netlist: Annotated[Path, typer.Argument(metavar="NETLIST", help="Netlist of ngspice or LTspice.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="File to write; default: print it.", show_default=False)
    ] = None,
    port: Annotated[
        str | None, typer.Option(metavar="PLUS,MINUS", help="Nodes of the electrodes.", show_default="p,0 or 1,0")
    ] = None,
    load: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Element whose power is harvested; may be repeated.")
    ] = None,
    subcircuit: Annotated[
        str | None, typer.Option(metavar="NAME", help="Subcircuit to use; its first two pins are the electrodes.")
    ] = None,
) -> Work:
    """Convert a netlist to a shunt: a table [[shunts]] for a study.

    The elements R, L, C, K, D, S, V, I and subcircuits of them are read where they are piecewise linear. Any other
    element is refused, with its name and line.
    """
    from piezoharvest.cli import export_command

    return partial(export_command.import_netlist, netlist, out, port, tuple(load or ()), subcircuit)


class Beginning(StrEnum):
    """What `new` writes."""

    HARVEST = "harvest"
    DAMPING = "damping"
    CAMPAIGN = "campaign"


@app.command()
def new(
    kind: Annotated[Beginning, typer.Argument(help="Kind of file to write.", show_default=False)],
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FILES",
            help="Data files of a campaign; for a study, one universal file (UFF) with the modes of the structure.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="File to write (.toml); default: harvest.toml and so on.")
    ] = None,
) -> Work:
    """Write a commented study or campaign as a starting point.

    The studies harvest and damping run as they are with simulate and design; replace their numbers with yours. For a
    campaign, times, channels, units, sample rate and, where force and displacement are known, rough nominal values are
    taken from the data files. Whatever could not be determined is marked (?). No file is ever overwritten.
    """
    from piezoharvest.cli import new_command

    return partial(new_command.new, kind, files or [], out)


def _catalogue_names(incomplete: str) -> list[str]:
    """Names of the catalogue that begin so, for the completion of a shell."""
    from piezoharvest.cli import catalogue_command

    return [name for name in catalogue_command.names() if name.startswith(incomplete)]


@app.command()
def catalogue(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME",
            help="Name of a transducer, material or part.",
            show_default="all in a table",
            autocompletion=_catalogue_names,
        ),
    ] = None,
    json: AsJson = False,
) -> Work:
    """Show the transducers, materials and parts of the catalogue.

    All are part of the package; every entry names its source.
    """
    from piezoharvest.cli import catalogue_command

    return partial(catalogue_command.show, name, as_json=json)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Directory of the report.")] = Path("piezoharvest-demo"),
) -> Work:
    """Run a worked example: design, measure, diagnose, design again.

    On the virtual bench, a harvester falls short of its design. A campaign is measured and diagnosed, the cause is
    added to the model, and the harvester is designed and measured again. The last line printed is the path of a page
    that shows the results. The files of all steps lie beside it; the page lists the commands that repeat them.
    """
    from piezoharvest.cli import demo_command

    return partial(demo_command.demo, out)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Without the program's name; default `sys.argv[1:]`.

    Returns
    -------
    int
        Exit status.
    """
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="replace")  # pyright: ignore[reportAttributeAccessIssue]
    try:
        given = _quiet_first(sys.argv[1:] if arguments is None else arguments)
        result = app(given, prog_name="piezoharvest", standalone_mode=False)
        if result == 130:  # typer has handled the interrupt itself
            raise KeyboardInterrupt
        status: Any = result() if callable(result) else result or 0
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        return _say("interrupted", 130)
    except SystemExit as ended:
        if not ended.code:  # completion of a shell, which ends the program by itself
            return 0
        return _say("interrupted", int(ended.code or 0))
    except BrokenPipeError:
        _discard_output()  # the reader of the results has closed the pipe: nothing to say
        return 141
    except Exception as error:
        status = _failed(error)
    try:
        sys.stdout.flush()
    except OSError:  # reported already
        _discard_output()
    return status


def _quiet_first(arguments: Sequence[str]) -> list[str]:
    """Arguments with --quiet before the command, wherever it stands."""
    others = [argument for argument in arguments if argument != "--quiet"]
    return others if len(others) == len(arguments) else ["--quiet", *others]


def _discard_output() -> None:
    """Discard output that Python would try to flush, and fail to, at its exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _failed(error: Exception) -> int:
    """Report an error in one line, and return the exit status."""
    if hasattr(error, "format_message") and hasattr(error, "exit_code"):  # typer, of whichever version
        context: Any = getattr(error, "ctx", None)
        command = context.command_path if context else "piezoharvest"
        said = error.format_message().rstrip(".").replace("Value error, ", "")  # of pydantic, in typer  # pyright: ignore
        return _say(f"{said} (see {command} --help)", 2)
    from piezoharvest.cli.commands import BAD_INPUT

    if isinstance(error, BAD_INPUT):
        _say(f"error: {error}", 2)
        for line in _further_errors(error):
            _say(line, 2)
        return 2
    if isinstance(error, MemoryError):
        return _say("error: there is not enough memory for this task", 2)
    if isinstance(error, OSError):
        return _say(f"error: {error}", 2 if error.errno in _FULL else 1)
    if os.environ.get("PIEZOHARVEST_TRACEBACK"):
        raise error
    hint = "PIEZOHARVEST_TRACEBACK=1 shows where"
    from piezoharvest.effect_files import place_of

    if place := place_of(error):
        return _say(f"error: {place}: this effect cannot be used ({type(error).__name__}: {error}; {hint})", 2)
    return _say(f"internal error, please report it: {type(error).__name__}: {error} ({hint})", 1)


def _further_errors(error: Exception) -> list[str]:
    """One line for each further error that the checks of a campaign found."""
    campaign: Any = getattr(error, "campaign", None)
    if campaign is None:
        return []
    further = campaign.errors[1:]
    lines = [f"error: {campaign.path.parent / found.file}: {found.place}: {found.message}" for found in further]
    left = len(lines) - MOST_ERRORS
    return lines if left <= 0 else [*lines[:MOST_ERRORS], f"error: {left} more of them are not shown"]


def _say(text: str, status: int) -> int:
    print("piezoharvest:", " ".join(text.split()), file=sys.stderr)
    return status
