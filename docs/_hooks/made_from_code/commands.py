"""The page of all commands, made from the command line itself."""

from __future__ import annotations

from typing import Any

import typer.main

from made_from_code.reference import plain
from piezoharvest.cli import app


def page() -> str:
    """Markdown of every command with its arguments and options."""
    group: Any = typer.main.get_command(app)
    parts = [
        "# Commands\n\nExit status 0 means done, 1 that the result is not to be trusted (no steady state, energy not"
        " closed, more power than the excitation can supply, too much to compute), 2 bad input, explained in one"
        " sentence, 130 an interrupted run, 143 a terminated one.\n"
    ]
    return "\n".join([*parts, *(_command(name, command) for name, command in group.commands.items())])


def _command(name: str, command: Any) -> str:
    rows = "".join(_row(parameter) for parameter in command.params)
    table = f"| argument | meaning |\n|---|---|\n{rows}" if rows else ""
    return f"## piezoharvest {name}\n\n{plain((command.help or '').strip())}\n\n{table}"


def _row(parameter: Any) -> str:
    value = parameter.metavar or "VALUE"
    if parameter.param_type_name == "argument":
        names = value
    else:
        names = ", ".join(parameter.opts) + ("" if parameter.is_flag else f" {value}")
    return f"| `{names}` | {plain(parameter.help or '')} |\n"
