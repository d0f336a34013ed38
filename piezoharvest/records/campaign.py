"""A campaign: measured records of one specimen, read, checked, and ready to be fitted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from piezoharvest.description.transducer import Transducer
from piezoharvest.records.finding import Finding
from piezoharvest.records.record import FrequencyRecord, Record


@dataclass(frozen=True, eq=False)
class Campaign:
    """Measured records of one specimen.

    Attributes
    ----------
    title : str
    path : Path
        The campaign's file.
    transducer : Transducer
        Nominal values: start of a fit, not truth.
    records : tuple of Record or FrequencyRecord
        In the order of the file.
    findings : tuple of tuple of Finding
        For each record what its checks have found; warnings only, unless the campaign comes with an error.
    unknown : tuple of str
        Parameters of the transducer of which the file gives no value: mass and damping of a quasi-static specimen.
    """

    title: str
    path: Path
    transducer: Transducer
    records: tuple[Record | FrequencyRecord, ...]
    findings: tuple[tuple[Finding, ...], ...]
    unknown: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Findings of all records that are warnings."""
        return tuple(finding for some in self.findings for finding in some if finding.severity == "warning")

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Findings of all records that are errors."""
        return tuple(finding for some in self.findings for finding in some if finding.severity == "error")

    @property
    def drives_base(self) -> bool:
        """Whether a base acceleration is imposed in some record, which only a mass turns into a force."""
        return any(isinstance(record, Record) and record.drive == "base_acceleration" for record in self.records)

    def of_role(self, role: str) -> tuple[Record | FrequencyRecord, ...]:
        """Records with a role, "fit" or "validate"."""
        return tuple(record for record in self.records if record.role == role)
