"""Where stops were when a record began: records that are cut out of motions are explained to their noise."""

from pathlib import Path

import numpy as np
import pytest
from identify_runs import RECORDS, STACK

from piezoharvest.identify import identify
from piezoharvest.records import load_campaign
from piezoharvest.records.bench import measure, write_campaign
from piezoharvest.study import study_from

FAST = {"kind": "sine_force", "amplitude": 500.0, "offset": 600.0, "frequency": 11.0}
CUT_OUT = [*RECORDS[1:3], {"load_resistance": 143.8e3, "excitation": FAST}, RECORDS[3]]


def cut_out(folder, before):
    """Campaign of the bench whose records have lost their first samples."""
    tables = {
        "transducer": STACK, "shunts": [{"kind": "resistor", "resistance": 97.78e3}],
        "excitation": {"kind": "sine_force", "amplitude": 450.0, "offset": 550.0, "frequency": 4.0},
        "bench": {"duration": 2.0 + 1e-3 * before, "seed": before, "records": CUT_OUT},
    }  # fmt: skip
    whole = write_campaign(measure(study_from(tables, Path("study.toml"))), Path(folder) / "campaign")
    for file in whole.parent.glob("*.csv"):
        head, *rows = file.read_text().splitlines(keepends=True)
        file.write_text(head + "".join(rows[before:]))
    return load_campaign(whole)


@pytest.mark.parametrize("before", [523, 671])
def test_wherever_records_begin_they_are_explained(before, tmp_path):
    found = identify(cut_out(tmp_path, before), offsets=("displacement",))
    for sums in found.found.sums:
        count = sums.count.sum()
        assert sums.squares.sum() == pytest.approx(count, abs=5.0 * np.sqrt(2.0 * count))
    for record in found.records:
        noise = record.quality.noise
        assert all(rms == pytest.approx(noise[channel], rel=0.06) for channel, rms in record.quality.rms.items())
