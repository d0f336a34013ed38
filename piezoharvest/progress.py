"""Messages on the progress of long work."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")
_FOLLOWER: ContextVar[Callable[[str], object]] = ContextVar("follower")
EVERY = 5.0  # s between two words on a stage; what is over sooner needs none


class Step(str):
    """What is being done now: of no interest once it is done, other than a remark.

    It is text, so that any function that takes messages takes it, too.

    Parameters
    ----------
    text : str
    done, total : float
        Parts of the work that are done, and all of them; a total of 0 where it is not known.
    spent : float, optional
        Time in s that the parts done took, where it is not the time since the whole work began.
    most : bool
        The total is what there may be at most.
    """

    done: float
    total: float
    spent: float | None
    most: bool

    def __new__(
        cls, text: str, done: float = 0, total: float = 0, *, spent: float | None = None, most: bool = False
    ) -> Step:
        """Make text of a class of its own, which cannot be done in `__init__`."""
        new = super().__new__(cls, text)
        new.done, new.total, new.spent, new.most = done, total, spent, most
        return new

    @property
    def line(self) -> str:
        """The text with the time left, where nothing but text is shown and the step has a time of its own."""
        spent = self.spent if self.spent is not None and self.spent >= EVERY else None
        left = time_left(self.done, self.total, spent, spent or 0.0)
        return str(self) if left is None else f"{self}, {left_in_words(left, most=self.most)}"


class Iteration(Step):
    """A step of a fit, which `Numbered` counts."""


class Stage:
    """One long stage of a job: every few seconds it tells how far it is, and nothing if it is over before.

    Parameters
    ----------
    progress : callable
        Takes the messages.
    name : str
        What is done.
    parts : str
        What is counted, in plural.
    most : bool
        The totals are what there may be at most, as of an iteration that ends when it has converged.
    """

    def __init__(self, progress: Callable[[str], object], name: str, parts: str, *, most: bool = False):
        self.progress, self.name, self.parts, self.most = progress, name, parts, most
        self.begun = self.told = time.monotonic()

    def reached(self, done: float, total: float) -> None:
        """Tell how many parts are done, of how many."""
        now = time.monotonic()
        if now - self.told < EVERY:
            return
        self.told = now
        share = f"{done} of {'at most ' if self.most else ''}{total} {self.parts}"
        self.progress(Step(f"{self.name}: {share}", done, total, spent=now - self.begun, most=self.most))

    def over(self, parts: Iterable[T], total: int | None = None) -> Iterator[T]:
        """The parts, one after the other; how many are done is told beside them. Without a length, give their total."""
        total = len(parts) if isinstance(parts, Sized) else total or 0
        for n, part in enumerate(parts, 1):
            yield part
            if n < total:
                self.reached(n, total)


def each_told(
    progress: Callable[[str], object], text: Callable[[T], str], parts: Sequence[T], *, most: bool = False
) -> Iterator[T]:
    """Parts that may take long one after the other, each told before it begins, as "testing leakage (3 of 6)".

    Parameters
    ----------
    progress : callable
        Takes the messages.
    text : callable
        What is done with a part.
    parts : sequence
    most : bool
        Later ones may take less time than those before, as a fit that ends once it is known to be worse.
    """
    begun = time.monotonic()
    for n, part in enumerate(parts):
        spent = time.monotonic() - begun
        progress(Step(f"{text(part)} ({n + 1} of {len(parts)})", n, len(parts), spent=spent, most=most))
        yield part


@contextmanager
def followed(progress: Callable[[str], object]) -> Iterator[None]:
    """Loops over records tell `progress` how far they are, whatever of a job they belong to."""
    before = _FOLLOWER.set(progress)
    try:
        yield
    finally:
        _FOLLOWER.reset(before)


def follower() -> Callable[[str], object]:
    """Function for the messages of whoever follows the job; silent where nobody does, as in another thread."""
    return _FOLLOWER.get(silent)


@contextmanager
def watched(
    progress: Callable[[str], object], name: str, share: Callable[[], float], *, most: bool = False
) -> Iterator[None]:
    """Tell every few seconds how far compiled code is, which tells nothing itself.

    Parameters
    ----------
    progress : callable
        Takes the messages, in another thread.
    name : str
        What is done.
    share : callable
        Share of the work that is done, from 0 to 1; it is called while the work goes on.
    most : bool
        The share is of the most work that there may be.
    """
    if progress is silent:
        yield
        return
    over, stage = threading.Event(), Stage(progress, name, "%", most=most)

    def watch() -> None:
        while not over.wait(max(0.1 * EVERY, 0.01)):
            stage.reached(round(100.0 * share(), 1), 100)

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


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
    logging.getLogger("piezoharvest").info("%s", line(text))


def line(text: str) -> str:
    """A message as text alone, that of a long stage with the time left."""
    return text.line if isinstance(text, Step) else text


def time_left(done: float, total: float | None, now: float | None, at: float) -> float | None:
    """Time left, s, where `done` parts of `total` were done `at` a time; None where nothing is, or it is over."""
    if not done or not total or now is None:
        return None
    left = at / done * (total - done) - (now - at)
    return left if left > 0 else None


def left_in_words(seconds: float, *, most: bool = False) -> str:
    """Time left in hours, minutes and seconds; `most`: it may be over before."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    clock = f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
    return f"{'at most' if most else 'about'} {clock} left"


def silent(text: str) -> None:
    """Take a message of work whose progress is of no interest, as that of a part of other work."""
