"""What commands say on stderr beside their results: progress, remarks and warnings."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from piezoharvest.progress import Step, followed, left_in_words, time_left
from piezoharvest.progress import line as line_of

if TYPE_CHECKING:
    from rich.progress import Progress as Bar
    from rich.progress import TaskID

Tell = Callable[[str], None]
_BEGINNINGS = ("warning:", "piezoharvest:")  # of what --quiet does not silence
_quiet = False


def be_quiet(wanted: bool) -> None:
    """Print warnings and errors alone from now on, or everything again."""
    global _quiet
    _quiet = wanted


def quiet() -> bool:
    """True if only warnings and errors are wanted."""
    return _quiet


def note(text: str) -> None:
    """Print progress, a remark or a warning to stderr."""
    if not _quiet or text.startswith(_BEGINNINGS):
        print(line_of(text), file=sys.stderr, flush=True)


@contextmanager
def telling() -> Iterator[Tell]:
    """Function for messages: a `Step` moves a bar that is gone in the end, anything else is a remark that stays.

    The time left is that of parts that take as long as those before, and shown where their number is known. Where
    stderr is no terminal, each message is a line.
    """
    with bar("{task.description}", clock=True) as found:
        if found is None:
            with followed(note):
                yield note
            return
        line, task = found

        def tell(text: str) -> None:
            if not isinstance(text, Step):
                line.console.print(text, markup=False, highlight=False, soft_wrap=True)
            elif text.total:
                at = line.tasks[task].elapsed or 0.0
                begun = 0.0 if text.spent is None else at - text.spent
                line.update(
                    task, description=text, completed=text.done, total=text.total, at=at, begun=begun, most=text.most
                )
            elif line.tasks[task].fields.get("begun"):  # a stage is over, and of this the end is not known
                line.tasks[task].total = None
                line.update(task, description=text, completed=0, at=None, begun=0.0)
            else:
                line.update(task, description=text)

        with followed(tell):
            yield tell


@contextmanager
def bar(*texts: str, clock: bool = False, rate: str = "") -> Iterator[tuple[Bar, TaskID] | None]:
    """A bar on stderr with the time left, and its one task; None where stderr is no terminal or --quiet is given.

    Parameters
    ----------
    *texts : str
        Further columns, in the format of `rich.progress.TextColumn`.
    clock : bool
        Show the time since the start as well.
    rate : str
        Show so many of these a second.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, Task, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(f"{task.speed:.0f} {rate}/s" if task.speed else f"- {rate}/s")

    class Left(ProgressColumn):
        def render(self, task: Task) -> Text:
            at = task.fields.get("at")
            if at is None:
                left = task.time_remaining
            else:
                begun = task.fields["begun"]
                left = time_left(task.completed, task.total, (task.elapsed or 0.0) - begun, at - begun)
            return Text("" if left is None else left_in_words(left, most=task.fields.get("most", False)))

    console = Console(file=sys.stderr)
    if quiet() or not console.is_terminal:
        yield None
        return
    times = [TimeElapsedColumn()] if clock else []
    rates = [Rate()] if rate else []
    columns = (BarColumn(), MofNCompleteColumn(), *rates, *times, Left(), *map(TextColumn, texts))
    with Bar(*columns, console=console, transient=clock, speed_estimate_period=3600.0) as line:
        yield line, line.add_task("", total=None)


@contextmanager
def progress_of(what: str) -> Iterator[Callable[[int, int], None]]:
    """Function of the number done and of all: a bar on stderr with rate and time left; nothing without a terminal."""
    with bar(rate=what) as found:
        if found is None:
            yield lambda done, total: None
            return
        line, task = found
        yield lambda done, total: line.update(task, completed=done, total=total)
