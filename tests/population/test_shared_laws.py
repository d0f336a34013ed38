"""Three stacks whose load conducts beyond a voltage, each with values of its own: one law, by an independent solver."""

from dataclasses import replace

import numpy as np
import pytest

from piezoharvest.population import diagnose_specimens
from piezoharvest.records.specimens import load
from reports.discovery import campaigns
from reports.discovery.campaigns import CHANNELS, COLUMNS, KINDS, PARAMETERS, Made, Trial

KIND = KINDS["stack"]
KNEES, SLOPES = (1.8, 1.9, 1.7), (5e-6, 5.75e-6, 6.5e-6)  # V, S
RECORDS = ((0, 1, 2), (0, 1, 2), (0,))  # of each stack: the third has one, and none to validate with


def record(made, n, path):
    shown, noise = campaigns.channels(made.specimen, made)[n], campaigns.noise_of(made, n)
    time = np.arange(len(shown["force"])) / KIND.rate
    noisy = [shown[name] + (noise[name] if name in CHANNELS else 0.0) for name in COLUMNS]
    header = ",".join(["time_s", *COLUMNS.values()])
    np.savetxt(path, np.column_stack([time, *noisy]), "%.12g", ",", header=header, comments="")


def write(folder):
    """The campaign of all stacks, whose nominal values are off by a few per cent."""
    lines = ["[transducer]", *(f"{name} = {getattr(KIND.nominal, name)!r}" for name in PARAMETERS)]
    rng = np.random.default_rng(5)
    for n, (knee, slope, chosen) in enumerate(zip(KNEES, SLOPES, RECORDS, strict=True)):
        specimen, records = campaigns._specimen(KIND.nominal, rng), campaigns._records("stack", rng)
        conducts = lambda v, k=knee, g=slope: g * np.sign(v) * np.maximum(np.abs(v) - k, 0.0)  # noqa: E731
        made = Made(Trial("healthy", seed=100 + n), KIND, specimen, records)
        made = replace(made, specimen=campaigns.with_law(specimen, ("load", "voltage"), conducts, 2.0 * knee))
        lines += ["[[specimens]]", f'name = "stack {n + 1}"']
        for m in chosen:
            record(made, m, folder / f"{n}_{m}.csv")
            lines += ["[[specimens.records]]", f'file = "{n}_{m}.csv"', f"load_resistance = {records[m][1]!r}"]
            lines += [f'role = "{"validate" if m == 2 else "fit"}"']
    (folder / "campaign.toml").write_text("\n".join(lines))
    return folder / "campaign.toml"


@pytest.mark.slow
def test_one_law_is_found_with_values_of_each(tmp_path):
    found = diagnose_specimens(load(write(tmp_path)))
    assert found.verdict == "new_effect" and "3 of 3" in found.sentence
    for each, knee, slope in zip(found.each, KNEES, SLOPES, strict=True):
        for name, true in (("load knee.knee", knee), ("load knee.factor", slope)):
            value, std, _ = each.values[name]
            assert abs(value - true) < 4.0 * std + 1e-6 * true
            assert std < 2e-3 * true
