"""The two measured data sets, read as they are; what is found in them is justified by their notes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from piezoharvest.records import CampaignError, load_campaign

DATA = Path(__file__).parents[2].parent / "shared" / "data"
STACK, MIRROR = DATA / "picma_stack_hysteresis", DATA / "fast_steering_mirror"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured data in {DATA.name} beside the project")

# Data sheet of the P-885.91: 26 N/um, 3.1 uF; 45 um for 3.6 V before an amplifier whose gain is not told, so that the
# coupling is that of the control voltage.
PICMA = """
[transducer]
mass = 0.006
damping = 400.0
stiffness = 2.6e7
coupling = 325.0
capacitance = 3.1e-6

[channels]
voltage = { column = 1, unit = "V" }
displacement = { column = 5, unit = "um", sigma = 0.06 }
"""
# Piston motion of the mirror: what the three actuators do together, of which the three points see the mean.
PLATE = """
[transducer]
mass = 0.0089
damping = 5.0
stiffness = 3.5e5
coupling = 2.0
capacitance = 3e-6
"""


def campaign(folder, text):
    (folder / "campaign.toml").write_text(text)
    return load_campaign(folder / "campaign.toml")


def picma(name, more=""):
    return f'[[records]]\nfile = "{(STACK / name).as_posix()}"\ndrive = "voltage"\nsample_rate = 200.0\n{more}'


def mirror(level, part, realisation, gain=-1.0, point=None):
    """The mean of the three actuators and points, or one of them; both periods, one after the other."""
    used = range(3) if point is None else [point]
    columns = ", ".join(f'"[:, {n}, {realisation}, :]"' for n in used)
    response = (MIRROR / f"y_{level}mV_{part}.npy").as_posix()
    return (
        f'[[records]]\nfile = "{(MIRROR / f"u_{level}mV_{part}.npy").as_posix()}"\ndrive = "voltage"\n'
        f'sample_rate = 6400.0\nrole = "{"fit" if part == "train" else "validate"}"\n[records.channels]\n'
        f'voltage = {{ column = [{columns}], unit = "V" }}\n'
        f'displacement = {{ file = "{response}", column = [{columns}], unit = "m", gain = {gain} }}\n'
    )


class TestStack:
    def test_both_files_are_healthy(self, tmp_path):
        """Two experiments in the second file: rows of it, or all of it."""
        part = picma("Test_Vi_Do_Di.dat", "rows = [5052, 6051]\n")
        records = (picma("Model_Vi_Do.dat"), picma("Test_Vi_Do_Di.dat"), part)
        found = campaign(tmp_path, PICMA + "".join(records))
        assert found.warnings == ()
        model, test, part = found.records
        assert (len(model), len(test), len(part)) == (8027, 14155, 1000)
        assert np.ptp(model["voltage"]) == pytest.approx(3.6)
        # The notes: 45.1 um peak to peak in every cycle, of which the record has a few tenths of a micrometre more.
        assert np.ptp(model["displacement"][2000:2200]) == pytest.approx(45.1e-6, rel=0.02)
        assert model.signals["displacement"].sigma == pytest.approx(0.06e-6)
        np.testing.assert_array_equal(part["voltage"], test["voltage"][5051:6051])

    def test_the_columns_of_a_sensor_that_is_not_connected(self, tmp_path):
        with pytest.raises(CampaignError, match=r"displacement, rows 1-8027: found -0.0003") as error:
            campaign(tmp_path, PICMA.replace("column = 5", "column = 6") + picma("Model_Vi_Do.dat"))
        assert [finding.check for finding in error.value.campaign.errors] == ["constant"]

    def test_micrometres_taken_for_metres(self, tmp_path):
        with pytest.raises(CampaignError, match=r"likely a wrong unit \(is it um\?\)"):
            campaign(tmp_path, PICMA.replace('"um"', '"m"') + picma("Model_Vi_Do.dat"))

    def test_swapped_columns(self, tmp_path):
        text = PICMA.replace("column = 5", "column = 1").replace("column = 1,", "column = 5,", 1)
        with pytest.raises(CampaignError) as error:
            campaign(tmp_path, text + picma("Model_Vi_Do.dat"))
        assert {finding.check for finding in error.value.campaign.errors} <= {"swapped", "unit"}


class TestMirror:
    def test_all_records(self, tmp_path):
        """The drive goes up to 3000 Hz at 6400 Hz: straight lines between samples are not what the actuators saw."""
        counts = (("train", 6), ("test", 3))
        parts = [(level, part, n) for level in (100, 200, 300) for part, count in counts for n in range(count)]
        found = campaign(tmp_path, PLATE + "".join(mirror(*part) for part in parts))
        assert len(found.records) == 27
        assert all(len(record) == 2 * 8192 for record in found.records)
        assert [[f.check for f in findings] for findings in found.findings] == [["sample rate"]] * 27
        first = found.records[0]
        u = np.load(MIRROR / "u_100mV_train.npy")[:, :, 0, :].mean(axis=1)
        np.testing.assert_allclose(first["voltage"], np.concatenate([u[:, 0], u[:, 1]]), atol=1e-15)
        y = np.load(MIRROR / "y_100mV_train.npy")[:, :, 0, :].mean(axis=1)
        np.testing.assert_allclose(first["displacement"], -np.concatenate([y[:, 0], y[:, 1]]), atol=1e-20)

    @pytest.mark.parametrize("gain", [1.0, -1.0])
    @pytest.mark.parametrize("point", [None, 0])
    def test_too_little_likeness_for_the_sign(self, tmp_path, gain, point):
        """The points move against the voltage, but mostly in modes beyond the nominal one, or by other actuators."""
        found = campaign(tmp_path, PLATE + mirror(300, "test", 1, gain=gain, point=point))
        assert {finding.check for finding in found.warnings} == {"sample rate"}
