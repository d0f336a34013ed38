"""Where stops were when a record began: records that are cut out of motions are explained to their noise."""

from pathlib import Path

import numpy as np
import pytest
from identify_runs import RECORDS, STACK
from selection import with_slow

from piezoharvest.bench import measure, write_campaign
from piezoharvest.identify import identify
from piezoharvest.identify.start_values import initial_hysteresis_state
from piezoharvest.records import load_campaign
from piezoharvest.study import study_from

FAST = {"kind": "sine_force", "amplitude": 500.0, "offset": 600.0, "frequency": 11.0}
CUT_OUT = [*RECORDS[1:3], {"load_resistance": 143.8e3, "excitation": FAST}, RECORDS[3]]


def cut_out(folder, records, duration, before):
    """Campaign of the bench whose records have lost their first samples."""
    tables = {
        "transducer": STACK, "shunts": [{"kind": "resistor", "resistance": 97.78e3}],
        "excitation": {"kind": "sine_force", "amplitude": 450.0, "offset": 550.0, "frequency": 4.0},
        "bench": {"duration": duration + 1e-3 * before, "seed": before, "records": records},
    }  # fmt: skip
    whole = write_campaign(measure(study_from(tables, Path("study.toml"))), Path(folder) / "campaign")
    for file in whole.parent.glob("*.csv"):
        head, *rows = file.read_text().splitlines(keepends=True)
        file.write_text(head + "".join(rows[before:]))
    return load_campaign(whole)


def preloads(folder, overshoot, before):
    """Records under a preload that was once higher, of which small motions about it tell the stops late."""
    rng, rate = np.random.default_rng(before), 4000.0
    time = np.arange(int(rate * (4.0 + 1e-3 * before)) + 1) / rate - 1e-3 * before

    def rise(begin, duration):
        share = np.clip((time - begin) / duration, 0.0, 1.0)
        return share**2 * (3.0 - 2.0 * share)

    preload = 200.0 * (overshoot * rise(time[0], 0.5) - (overshoot - 1.0) * rise(time[0] + 0.6, 0.4))
    turns = np.outer([0.5, 1.25, 2.75, 5.5, 9.0], time)
    waves = [np.sin(2 * np.pi * (turns + rng.uniform(size=(5, 1)))).sum(axis=0) for _ in range(2)]
    motions = [600.0 * (rise(0.5, 0.1) - rise(2.5, 0.1)), *(60.0 * rise(0.0, 0.3) * w / np.ptp(w) for w in waves)]
    for k, (load, motion) in enumerate(zip((51.43e3, 97.78e3, 143.8e3), motions, strict=True)):
        file = Path(folder) / f"force{k}.csv"
        np.savetxt(file, preload + motion, fmt="%.9g", header="force_N", comments="")
        drive = {"kind": "record", "file": str(file), "column": "force_N", "sample_rate": rate}
        yield {"load_resistance": load, "excitation": drive}


def explained(campaign):
    """Whether all records of a campaign are explained to their noise."""
    found = identify(campaign, offsets=("displacement",))
    for sums in found.found.sums:
        count = sums.count.sum()
        assert sums.squares.sum() == pytest.approx(count, abs=5.0 * np.sqrt(2.0 * count))
    for record in found.records:
        noise = record.quality.noise
        assert all(rms == pytest.approx(noise[channel], rel=0.06) for channel, rms in record.quality.rms.items())


@pytest.mark.slow
def test_stops_that_a_preload_has_left_within_their_range_are_found(tmp_path):
    explained(cut_out(tmp_path, list(preloads(tmp_path, 1.3, 2000)), 4.0, 2000))


@pytest.mark.parametrize(
    ("before", "looked"), with_slow([(0, False), (523, True), (671, True)], slow=lambda before, looked: looked)
)
def test_wherever_records_begin_they_are_explained(before, looked, tmp_path, monkeypatch):
    """Histories are looked for only where the beginning of a record leaves more than noise."""
    asked, begun = [], initial_hysteresis_state._candidate_states
    monkeypatch.setattr(
        initial_hysteresis_state, "_candidate_states", lambda one, *rest: asked.append(one) or begun(one, *rest)
    )
    explained(cut_out(tmp_path, CUT_OUT, 2.0, before))
    assert bool(asked) is looked


@pytest.mark.slow
def test_a_record_of_a_few_samples_has_a_beginning_too(tmp_path):
    short = cut_out(tmp_path, [{**CUT_OUT[0], "duration": 0.04}, *CUT_OUT[1:]], 2.0, 0)
    assert min(map(len, short.records)) < max(initial_hysteresis_state.SUM_LENGTHS)
    assert identify(short, offsets=("displacement",)).converged
