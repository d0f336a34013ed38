"""Records that begin while the voltage is being inverted, or just before: no initial state tells that."""

import numpy as np
import pytest
from test_circuit_records import BENCH, RECORDS, SENSORS, check_values

from piezoharvest import SSDI, ParallelSSHI, Rectifier, Transducer
from piezoharvest.bench import measure, write_campaign
from piezoharvest.identify import identify
from piezoharvest.identify.fitting.circuit_start import loop_closed_at_first
from piezoharvest.identify.fitting.data import data_of
from piezoharvest.records import load_campaign
from piezoharvest.records.record import Record, Signal
from piezoharvest.study import study_from

COIL = {"kind": "ssdi", "inductance": 8.0, "quality": 8.0}  # half a period in 1.8 ms, of a period of 20 ms
RATE = 4000.0
TIME = np.arange(400) / RATE


def cut(path, before):
    """Let the files of a campaign begin some samples behind the beginning of an inversion in their middle."""
    for file in sorted(path.parent.glob("*.csv")):
        lines = file.read_text().splitlines()
        header = next(k for k, line in enumerate(lines) if "voltage" in line)
        column = next(k for k, name in enumerate(lines[header].split(",")) if "voltage" in name)
        values = np.array([float(line.split(",")[column]) for line in lines[header + 1 :] if line[:1].isdigit()])
        first = len(lines) - len(values)
        jump = np.abs(np.diff(values)) > 0.15 * np.ptp(values)
        half = len(values) // 2
        at = half + int(np.flatnonzero(jump[half:] & ~jump[half - 1 : -1])[0])
        file.write_text("\n".join(lines[:first] + lines[first + at + before :]) + "\n")
    return load_campaign(path)


def campaign(folder, before):
    bench = {
        "sample_rate": RATE, "duration": 0.6, "seed": 5, "nominal_error": 0.03,
        "channels": ["displacement", "voltage"], **SENSORS, "records": RECORDS,
    }  # fmt: skip
    drive = {"kind": "sine_force", "amplitude": 0.03, "frequency": 50.6}
    tables = {"transducer": BENCH, "excitation": drive, "shunts": [COIL], "bench": bench}
    return cut(write_campaign(measure(study_from(tables, folder / "study.toml")), folder / "campaign"), before)


@pytest.mark.parametrize("before", [2, -2])
def test_parameters_are_right_whether_a_record_begins_within_an_inversion_or_just_before(before, tmp_path):
    found = campaign(tmp_path, before)
    own = [data_of(record, found.transducer) for record in found.records]
    closed = int(np.ceil(SSDI(inductance=8.0, quality=8.0).nominal_flip_time(BENCH["capacitance"]) * RATE))
    for data in own:
        assert closed < data.hidden.sum() <= closed + 5
        assert data.setting.acted == pytest.approx(data.hidden.sum() / RATE)
    result = identify(found)
    check_values(result, BENCH)
    assert result.converged
    # With the wrong voltage of a whole half period the errors were fifteen times as large.
    assert all(each.std < 0.01 * each.value for each in result.estimates if each.parameter.name in BENCH)


def record_with(voltage):
    """A record of a voltage alone, as `loop_closed_at_first` needs it."""
    time, signal = (Signal(each, sigma, "r.csv", "", 1) for each, sigma in ((TIME, None), (voltage, 1e-3)))
    return Record("r.csv", "records.0", "fit", "force", None, 0.0, time, {"voltage": signal})


def test_first_samples_are_hidden_only_where_a_voltage_jumps():
    device = Transducer(**BENCH)
    time = TIME
    smooth = np.sin(2 * np.pi * 50 * time)
    turned = np.where(time < 1e-3, 1.0 - time / 5e-4, -1.0) + 0.2 * smooth  # inverted within the first samples
    late = np.where(time < 9e-3, 1.0, np.where(time < 10e-3, 1.0 - (time - 9e-3) / 5e-4, -1.0)) + 0.2 * smooth
    coil, bridge = SSDI(inductance=8.0, quality=8.0), Rectifier(dc_voltage=1.0)
    fast = ParallelSSHI(inductance=1e-3, quality=8.0, dc_voltage=1.0)
    assert loop_closed_at_first(record_with(turned), coil, device) > 7
    slow = SSDI(inductance=1e6, quality=8.0)  # half a period in 0.6 s, of a record of 0.1 s
    for voltage, shunt in ((smooth, coil), (late, coil), (turned, bridge), (late, fast), (turned, slow)):
        assert loop_closed_at_first(record_with(voltage), shunt, device) == 0
