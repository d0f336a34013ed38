"""A few periods of a sine in steady state: prediction against waiting, its derivatives, checks, and bench records."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from oracles.reference import steady
from selection import with_slow
from studies import DRIVE, STOPS, bench, objects

from piezoharvest import Creep, DisplacementLag
from piezoharvest.bench import measure, write_campaign
from piezoharvest.diagnose import diagnose
from piezoharvest.identify import identify
from piezoharvest.predict.circuit.periodic_prediction import PeriodicPrediction
from piezoharvest.predict.circuit.setting import periodic_setting
from piezoharvest.predict.parameters import parameter_of, parameters_of, put, value_at
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.records import CampaignError, load_campaign
from piezoharvest.records.harmonics import Harmonics
from piezoharvest.study import study_from

SMOOTH = {"smoothing_capacitance": 1e-7, "load_resistance": 3e5, "diode_drop": 0.3}
COIL = {"inductance": 0.1, "quality": 5.0}
CIRCUITS = {
    "resistor": {"kind": "resistor", "resistance": 8e4},
    "parallel_rlc": {"kind": "parallel_rlc", "inductance": 200.0, "resistance": 2e5, "capacitance": 8e-9},
    "rectifier": {"kind": "rectifier", **SMOOTH},
    "parallel_sshi late": {"kind": "parallel_sshi", **COIL, **SMOOTH, "phase_lag": 0.2, "on_time_error": 0.1},
    "series_sshi": {"kind": "series_sshi", **COIL, **SMOOTH, "load_resistance": 3e4},
    "sece": {"kind": "sece"},
    "ssdv early": {"kind": "ssdv", **COIL, "source_voltage": 1.0, "phase_lag": -0.2},
}
QUICK = ("resistor", "parallel_sshi late", "sece")
SINE = Harmonics(DRIVE["frequency"], 0.0, np.array([1]), np.array([-1j * DRIVE["amplitude"]]), True)
# Distorted and with a preload, so that no half of a period mirrors the other.
DISTORTED = Harmonics(50.6, 0.01, np.array([1, 2, 3]), np.array([0.03j, 1e-3, 5e-4j]), True)
NAMES = ("displacement", "velocity", "voltage", "current")


def predicted(system, harmonics, step, count, parameters=(), channels=NAMES):
    setting = periodic_setting("force", system.shunt, step, count, harmonics, system.transducer)
    prediction = PeriodicPrediction(system.transducer, setting, parameters)
    (block,) = prediction.blocks(derivatives=bool(parameters), channels=channels)
    return block


@pytest.mark.parametrize("circuit", with_slow(CIRCUITS, slow=lambda name: name not in QUICK))
def test_as_after_waiting(circuit):
    """DOP853 at 1e-12, period by period until the state repeats; with hysteresis, which remembers."""
    study = bench(CIRCUITS[circuit], damping=0.3, hysteresis=STOPS)
    wanted = steady(study, 0, tol=1e-10, samples_per_period=64)
    assert wanted.converged
    system, excitation = objects(study)
    found = predicted(system, SINE, excitation.period / 64.0, 2 * 64 + 1).values
    for name, column, values in zip(NAMES, found.T, (wanted.x, wanted.u, wanted.v, wanted.i), strict=True):
        # Samples at which a circuit switches are before it in one and after it in the other.
        off = np.abs(column[:64] - values[-65:-1]) / np.abs(values).max() if np.any(values) else np.abs(column[:64])
        assert np.mean(off < 1e-7) > 0.95, (name, off.max())
        assert np.allclose(column[64:], column[:65], rtol=0, atol=1e-8 * np.abs(column).max() + 1e-300)


@pytest.mark.parametrize("harmonics", [SINE, DISTORTED], ids=["sine", "distorted"])
@pytest.mark.parametrize("hysteresis", [None, STOPS], ids=["linear", "hysteresis"])
@pytest.mark.parametrize("circuit", with_slow(CIRCUITS, slow=lambda name: name not in QUICK))
def test_derivatives_of_the_steady_state(circuit, hysteresis, harmonics):
    """Against central differences of predictions, each of which finds its own steady state."""
    system, _ = objects(bench(CIRCUITS[circuit], **({"hysteresis": hysteresis} if hysteresis else {})))
    effects = (Creep(compliance_ratio=0.05, time_constant=0.02), DisplacementLag(time_constant=2e-3))
    system = dataclasses.replace(system, transducer=dataclasses.replace(system.transducer, effects=effects))
    device, parameters = system.transducer, parameters_of(system.transducer, {"force"})
    for n, effect in enumerate(effects):
        fields = (field for field in dataclasses.fields(effect) if "unit" in field.metadata)
        parameters += [parameter_of(effect, field, ("effects", n, field.name)) for field in fields]
    block = predicted(system, harmonics, 2.5e-4, 160, parameters)

    def moved(parameter, step):
        inner = parameter.inner(value_at(device, parameter.path)) + step
        other = put(device, parameter.path, float(np.real(parameter.outer(inner))))
        return predicted(dataclasses.replace(system, transducer=other), harmonics, 2.5e-4, 160).values

    largest = np.abs(block.values).max(axis=0)
    for k, parameter in enumerate(parameters):
        linear = abs(parameter.inner(value_at(device, parameter.path)))
        step = 1e-6 if parameter.scaling == "log" else 1e-4 * linear
        wanted, found = (moved(parameter, step) - moved(parameter, -step)) / (2.0 * step), block.derivatives[:, :, k]
        # The search ends at 1e-12 of the state, a millionth of what a step of 1e-6 changes.
        size = np.abs(wanted).max(axis=0) + 1e-5 * largest / (1.0 if parameter.scaling == "log" else linear) + 1e-300
        close = np.abs(found - wanted) <= 5e-5 * size
        # Where an event crosses a sample the difference is of two different things.
        assert np.all(close.mean(axis=0) > 0.93), (parameter.name, close.mean(axis=0))


def test_no_steady_state_is_said():
    """A negative capacitance beyond the limit of stability grows without end."""
    shunt = {"kind": "negative_capacitance", "capacitance": 1e-7, "resistance": 1e5, "topology": "parallel"}
    system, _ = objects(bench(shunt))
    with pytest.raises(PredictionError, match=r'period.*omit kind = "periodic"|without bound.*kind = "periodic"'):
        predicted(system, SINE, 2.5e-4, 160)


@pytest.mark.parametrize("periods", [2.0, 2.7, 11.3])
def test_the_drive_of_a_few_periods(periods):
    """Errors of frequency and amplitude are those of least squares: their standard errors in closed form."""
    rate, sigma, rng = 4000.0, 1e-3, np.random.default_rng(7)
    time = np.arange(round(periods / 50.6 * rate)) / rate
    clean = 0.4 + np.sin(2 * np.pi * 50.6 * time + 0.3) + 0.02 * np.cos(2 * np.pi * 151.8 * time)
    off = []
    for _ in range(20):
        found = Harmonics.of(clean + sigma * rng.normal(size=len(time)), 1.0 / rate)
        assert {1, 3} <= set(found.orders) and found.offset != 0.0
        off.append([found.frequency - 50.6, abs(found.sizes[0]) - 1.0])
    least = np.sqrt(6.0 / len(time)) * sigma / (np.pi * time[-1]), sigma * np.sqrt(2.0 / len(time))
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    assert np.all(rms > 0.5 * np.array(least)) and np.all(rms < 3.0 * np.array(least))
    again = Harmonics.of(clean, 1.0 / rate, 50.6)
    assert np.allclose(again.at(time), clean, atol=1e-12)


# Records of the bench, from some time after it has settled: resonances of 50 Hz decay in 0.03 s here.

DEVICE = {"mass": 0.010, "damping": 0.628, "stiffness": 986.96, "coupling": 1.0e-3, "capacitance": 40e-9}
SSHI = {"kind": "parallel_sshi", "inductance": 0.5, "quality": 8.0, **SMOOTH}
SENSORS = {
    "load_cell": {"sensitivity": 100.0, "noise": 2e-5},
    "laser": {"sensitivity": 5e3, "resolution": 0.0, "noise": 3e-7},
    "buffer": {"gain": 0.2, "noise": 0.02},
}
RECORDS = [{}, {"excitation": {"frequency": 49.0}}, {"excitation": {"frequency": 52.5}, "role": "validate"}]
RATE = 4000.0


def campaign_file(folder, shunt, seed, effects=(), records=RECORDS, first=0.5, periods=5, **device):
    settings = {
        "sample_rate": RATE, "duration": first + periods / 50.0, "seed": seed, "nominal_error": 0.03,
        "channels": ["displacement", "voltage"], **SENSORS, "records": records, "effects": dict(effects),
    }  # fmt: skip
    drive = {"kind": "sine_force", "amplitude": 0.1, "frequency": 50.6}
    tables = {"transducer": {**DEVICE, **device}, "excitation": drive, "shunts": [shunt], "bench": settings}
    path = write_campaign(measure(study_from(tables, Path("study.toml"))), Path(folder) / "campaign")
    rows = [int(first * RATE) + 2, int((first + periods / 50.0) * RATE) + 1]
    path.write_text(path.read_text().replace("[[records]]", f'[[records]]\nkind = "periodic"\nrows = {rows}'))
    return path


def check_values(found, true):
    for estimate in found.estimates:
        value = true[estimate.parameter.name]
        assert estimate.std is not None and estimate.std < 0.01 * abs(value), estimate
        assert abs(estimate.value - value) < 3.0 * estimate.std, estimate


@pytest.mark.parametrize("kind", [pytest.param("resistor", marks=pytest.mark.slow), "parallel_sshi"])
def test_values_of_a_bench_in_steady_state(tmp_path, kind):
    path = campaign_file(tmp_path, SSHI if kind == "parallel_sshi" else CIRCUITS["resistor"], 2, records=RECORDS[:2])
    text = path.read_text().replace(f'kind = "{SSHI["kind"]}"', f'kind = "{SSHI["kind"]}"\nfit = ["quality"]')
    path.write_text(text)
    found = identify(load_campaign(path))
    assert found.converged and not found.warnings
    assert set(found.records[0].own) == {"displacement offset", "voltage offset"}
    check_values(found, {**DEVICE, "parallel_sshi.quality": 8.0})


def test_beside_records_of_other_kinds(tmp_path):
    """A step into a resistor, and the periodic record at a stated frequency, fitted at once."""
    path = campaign_file(tmp_path / "steady", CIRCUITS["resistor"], 3, records=RECORDS[:1])
    step = {"kind": "step_force", "amplitude": 0.1, "duration": 0.15, "rise_time": 0.01}
    settings = {
        "sample_rate": RATE, "duration": 0.15, "seed": 4, "nominal_error": 0.03,
        "channels": ["displacement", "voltage"], **SENSORS, "records": [{}],
    }  # fmt: skip
    shunt = CIRCUITS["resistor"]
    tables = {"transducer": DEVICE, "excitation": step, "shunts": [shunt], "bench": settings}
    other = write_campaign(measure(study_from(tables, Path("study.toml"))), tmp_path / "step")
    data = next(other.parent.glob("*.csv"))
    data.rename(path.parent / data.name)
    record = other.read_text().split("[[records]]")[1]
    text = path.read_text().replace('kind = "periodic"', 'kind = "periodic"\nfrequency = 50.6')
    path.write_text(f"{text}\n[[records]]{record}")
    campaign = load_campaign(path)
    assert campaign.records[0].harmonics.frequency == 50.6
    check_values(identify(campaign), DEVICE)


@pytest.mark.slow
@pytest.mark.parametrize("effects", [{}, {"inversion_loss": {"quality": 5.5}}], ids=["healthy", "inversion_loss"])
def test_diagnosis(tmp_path, effects):
    found = diagnose(load_campaign(campaign_file(tmp_path, SSHI, 5, effects)))
    assert [effect.effect.name for effect in found.effects] == list(effects)


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A campaign of one record, and its text."""
    path = campaign_file(tmp_path_factory.mktemp("short"), CIRCUITS["resistor"], 1, records=RECORDS[:1])
    return path, path.read_text()


BEFORE = int(0.5 * RATE) + 2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (None, [BEFORE, BEFORE + 120], r"force.*: found 1\.53 periods of 5.*Hz, but a drive must repeat"),
        (
            None,
            [2, 402],
            "force.*found .* in addition to a sine of .*the drive must repeat within its noise; omit kind",
        ),
        ('kind = "periodic"', 'kind = "periodic"\nfrequency = 48.0', r"in addition to a sine of 48 Hz \(as stated\)"),
        ('kind = "periodic"', 'kind = "periodic"\nfrequency = -1.0', r"records\.0\.frequency: found -1"),
        ('drive = "force"', 'drive = "voltage"', r"records\.0\.drive: found 'voltage', allowed in steady state are"),
        ('kind = "periodic"', 'kind = "time"\nfrequency = 50.0', r"records\.0\.frequency: unknown key"),
    ],
)
def test_what_is_no_such_record(short, old, new, message):
    path, text = short
    rows = text.split("rows = ")[1].split("\n")[0]
    text = text.replace(old, new) if old else text.replace(rows, str(new))
    if "402" in str(new):  # the bench begins at rest: a drive that begins within the record
        file = next(path.parent.glob("*.csv"))
        head, *lines = file.read_text().splitlines()
        column = head.split(",").index("force_N")
        values = [line.split(",") for line in lines]
        for row in values[:200]:
            row[column] = f"{0.3 * float(row[column]):.9g}"
        changed = path.parent / "changed.csv"
        changed.write_text("\n".join([head, *(",".join(row) for row in values)]) + "\n")
        text = text.replace(file.name, changed.name)
    other = path.with_name("other.toml")
    other.write_text(text)
    with pytest.raises(CampaignError, match=message):
        load_campaign(other)


def test_a_response_that_still_changes_is_warned_about(short):
    path, text = short
    rows = text.split("rows = ")[1].split("\n")[0]
    other = path.with_name("early.toml")
    other.write_text(text.replace(rows, "[2, 402]"))
    found = load_campaign(other).findings[0]
    assert {(f.severity, f.check, f.channel) for f in found} >= {("warning", "periodic", "displacement")}
    assert all("all transients have decayed" in f.message for f in found if f.check == "periodic")
