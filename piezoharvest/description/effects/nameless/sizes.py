"""What is one number in a record, and may change a parameter from record to record; and when the record was made."""

from __future__ import annotations

from math import isnan
from typing import Any, NamedTuple


class RecordSizes(NamedTuple):
    """Sizes of a record, NaN where they are not known.

    Attributes
    ----------
    amplitude : float
        Half the range of its drive, in the drive's unit.
    frequency : float
        Of the drive's strongest line, Hz.
    displacement_amplitude : float
        sqrt(2) times the rms of the measured displacement about its mean, m: the amplitude of a sine.
    begin : float
        Start of the record since that of the campaign, s.
    length : float
        Its length, s.
    """

    amplitude: Any
    frequency: Any
    displacement_amplitude: float = float("nan")
    begin: float = float("nan")
    length: float = float("nan")


def length_of(size: RecordSizes | None) -> float:
    """Length of a record in s; of one whose length is not known, nothing is asked that depends on it: one second."""
    length = float("nan") if size is None else float(RecordSizes(*size).length)
    return 1.0 if isnan(length) else length


SIZES = RecordSizes._fields[:3]  # inputs of laws; the rest says when in the campaign the record was
