"""A campaign: measured records of one specimen, read and checked."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from piezoharvest.counting import counted
from piezoharvest.description.transducer import Transducer
from piezoharvest.notebook import Shown
from piezoharvest.records.bench_limits import BenchLimits
from piezoharvest.records.finding import Finding
from piezoharvest.records.record import FrequencyRecord, Record


@dataclass(frozen=True, eq=False, repr=False)
class Campaign(Shown):
    """Measured records of one specimen.

    Attributes
    ----------
    title : str
    path : Path
        The campaign's file.
    transducer : Transducer
        Nominal values, used as the start of a fit.
    records : tuple of Record or FrequencyRecord
        In the order of the file.
    findings : tuple of tuple of Finding
        Findings of the checks, for each record; warnings only, unless the campaign belongs to an error.
    unknown : tuple of str
        Parameters of the transducer without a value in the file: mass and damping of a quasi-static specimen.
    limits : BenchLimits
        Of records that are planned.
    """

    title: str
    path: Path
    transducer: Transducer
    records: tuple[Record | FrequencyRecord, ...]
    findings: tuple[tuple[Finding, ...], ...]
    unknown: tuple[str, ...] = ()
    limits: BenchLimits = field(default_factory=BenchLimits)

    @property
    def heading(self) -> str:
        """Its title, and how many records and warnings there are."""
        return f"{self.title}, {counted(len(self.records), 'record')}, {counted(len(self.warnings), 'warning')}"

    @property
    def rows(self) -> list[dict[str, Any]]:
        """What the records are taken for, one a row."""
        return [
            {"record": r.name, "role": r.role, "drive": r.drive if isinstance(r, Record) else r.kind,
             "load": "none" if r.shunt is None else r.shunt.kind, "samples": len(r), "channels": ", ".join(r.responses)}
            for r in self.records
        ]  # fmt: skip

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
        """True if a base acceleration is imposed in some record, which needs a mass to become a force."""
        return any(isinstance(record, Record) and record.drive == "base_acceleration" for record in self.records)

    def of_role(self, role: str) -> tuple[Record | FrequencyRecord, ...]:
        """Records with a role, "fit" or "validate"."""
        return tuple(record for record in self.records if record.role == role)
