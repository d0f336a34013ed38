"""Messages on the progress of long work."""

from __future__ import annotations

import logging
from collections.abc import Callable


class Step(str):
    """What is being done now: of no interest once it is done, other than a remark.

    It is text, so that any function that takes messages takes it, too.

    Parameters
    ----------
    text : str
    done, total : int
        Parts of the work that are done, and all of them; a total of 0 where it is not known.
    """

    done: int
    total: int

    def __new__(cls, text: str, done: int = 0, total: int = 0) -> Step:
        """Make text of a class of its own, which cannot be done in `__init__`."""
        new = super().__new__(cls, text)
        new.done, new.total = done, total
        return new


class Iteration(Step):
    """A step of a fit, which `Numbered` counts."""


class Numbered:
    """Messages with their iterations numbered through all fits of one job.

    A job fits again when the noise is known better, or from another start: counted by each fit, a second "iteration 1"
    reads as if the work began anew.

    Parameters
    ----------
    progress : callable
        Takes the messages.
    """

    def __init__(self, progress: Callable[[str], object]):
        self.progress, self.count = progress, 0

    @classmethod
    def of(cls, progress: Callable[[str], object]) -> Numbered:
        """The same messages numbered; those of a job within another one have its numbers."""
        return progress if isinstance(progress, cls) else cls(progress)

    def __call__(self, text: str) -> None:
        """Pass a message on."""
        if isinstance(text, Iteration):
            self.count += 1
            text = Step(f"iteration {self.count}: {text}")
        self.progress(text)


def log(text: str) -> None:
    """Log a message for the logger `piezoharvest` at level INFO, where a caller has not said what to do with it."""
    logging.getLogger("piezoharvest").info("%s", text)


def silent(text: str) -> None:
    """Take a message of work whose progress is of no interest, as that of a part of other work."""
