"""Messages on the progress of long work."""

from __future__ import annotations


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
