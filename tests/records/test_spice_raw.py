"""Waveforms of circuit simulators as records: files made by hand in each format, and one by ngspice."""

import numpy as np
import pytest
from oracles.ngspice import needs_ngspice, run_netlist

from piezoharvest import load_campaign
from piezoharvest.readers import ReadError, open_reader

TIME = np.array([0.0, 0.1, 0.2, 0.25, 0.3, 0.4])
VALUES = np.array([TIME, 10 * TIME, -TIME])
HEADER = """Title: * a circuit
Date: today
Plotname: Transient Analysis
Flags: {flags}
No. Variables: 3
No. Points: 6
Variables:
\t0\ttime\ttime
\t1\tV(p)\tvoltage
\t2\tI(Vload)\tdevice_current
"""


def written(path, flags="real", encoding="latin-1", singles=False, text=False, plot="Transient Analysis", cut=None):
    """Write a file and return its path."""
    header = HEADER.format(flags=flags).replace("Transient Analysis", plot)
    time = VALUES[0] * np.where(np.arange(6) == 2, -1, 1)  # as LTspice marks what its compression kept
    values = np.vstack([time, VALUES[1:]])
    if text:
        lines = ["\n".join([f"{n}\t{p[0]:.9g}", *(f"\t{x:.9g}" for x in p[1:])]) for n, p in enumerate(values.T)]
        data = "Values:\n".encode(encoding) + "\n".join(lines).encode(encoding)
    else:
        of_rest = "<f4" if singles else "<f8"
        if "fastaccess" in flags:
            body = time.astype("<f8").tobytes() + values[1:].astype(of_rest).tobytes()
        else:
            body = b"".join(p[:1].astype("<f8").tobytes() + p[1:].astype(of_rest).tobytes() for p in values.T)
        data = "Binary:\n".encode(encoding) + body
    path.write_bytes((header.encode(encoding) + data)[:cut])
    return path


@pytest.mark.parametrize(
    "form",
    [
        {},
        {"text": True},
        {"encoding": "utf-16-le", "flags": "real forward", "singles": True},
        {"encoding": "utf-16-le", "flags": "real forward double"},
        {"encoding": "utf-16-le", "flags": "real forward fastaccess", "singles": True},
        {"encoding": "utf-16-le", "flags": "real", "text": True},
    ],
)
def test_every_form_is_read_at_even_times(tmp_path, form):
    with open_reader(written(tmp_path / "run.raw", **form)) as reader:
        assert reader.resolve("v(P)") == "V(p)"
        times, found = reader.time_of("V(p)"), reader.read(["V(p)", "I(Vload)"])
    assert times == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert found["V(p)"] == pytest.approx(10 * times, rel=1e-6)
    assert found["I(Vload)"] == pytest.approx(-times, rel=1e-6)


@pytest.mark.parametrize(
    ("form", "message"),
    [
        ({"plot": "DC transfer"}, "found the analysis 'DC transfer', must be a transient or AC one"),
        ({"flags": "real stepped"}, "found waveforms that are stepped"),
        ({"flags": "complex"}, "found waveforms that are complex"),
        ({"cut": -8}, "bytes of values, allowed are 144 or 96"),
        ({"text": True, "cut": -5}, "the text does not hold 6 points"),
        ({"cut": 100}, "it has no line 'Binary:' or 'Values:'"),
    ],
)
def test_what_is_no_single_whole_run_is_refused(tmp_path, form, message):
    with pytest.raises(ReadError, match=message):
        open_reader(written(tmp_path / "run.raw", **form))


@needs_ngspice
def test_a_run_of_ngspice(tmp_path):
    text = "* decay\nC1 a 0 1u IC=1\nR1 a 0 1k\n.tran 1u 2m 0 1u uic\n.save V(a)\n"
    run_netlist(text + ".meas tran m AVG V(a) from=0 to=1m\n.end\n", raw=tmp_path / "run.raw")
    with open_reader(tmp_path / "run.raw") as reader:
        times, found = reader.time_of("v(a)"), reader.read(["v(a)"])["v(a)"]
    assert found == pytest.approx(np.exp(-times / 1e-3), abs=1e-4)


@pytest.mark.parametrize(
    ("encoding", "text", "fast"),
    [("latin-1", False, ""), ("latin-1", True, ""), ("utf-16-le", False, ""), ("utf-16-le", False, " fastaccess")],
)
def test_an_ac_analysis_is_an_impedance(tmp_path, encoding, text, fast):
    """Voltage of a specimen that a source of 1 A drives, in each form, as a record of a campaign."""
    f = np.geomspace(20.0, 300.0, 40)
    s = 2j * np.pi * f
    z = 1.0 / (s * 40e-9 + 1e-6 * s / (0.01 * s**2 + 0.0628 * s + 987.0))
    values = np.array([f + 0j, z, np.ones(40)])
    header = HEADER.format(flags=f"complex forward{fast}").replace("Transient Analysis", "AC Analysis")
    header = header.replace("time\ttime", "frequency\tfrequency").replace("Points: 6", "Points: 40")
    if text:
        lines = [f"{n}\t" + "\n\t".join(f"{x.real:.15e},{x.imag:.15e}" for x in p) for n, p in enumerate(values.T)]
        data = "Values:\n".encode(encoding) + "\n".join(lines).encode(encoding)
    else:
        data = "Binary:\n".encode(encoding) + np.ascontiguousarray(values if fast else values.T).tobytes()
    (tmp_path / "ac.raw").write_bytes(header.encode(encoding) + data)
    (tmp_path / "campaign.toml").write_text(
        "[transducer]\nmass = 0.01\ndamping = 0.06\nstiffness = 990.0\ncoupling = 1e-3\ncapacitance = 41e-9\n"
        '[[records]]\nkind = "impedance"\nfile = "ac.raw"\n[records.channels]\nresponse = { column = "V(p)" }\n'
    )
    (record,) = load_campaign(tmp_path / "campaign.toml").records
    assert record.frequency == pytest.approx(f, rel=1e-12)
    assert record.response == pytest.approx(z, rel=1e-12)
    (tmp_path / "cut.raw").write_bytes((header.encode(encoding) + data)[:-24])
    with pytest.raises(ReadError), open_reader(tmp_path / "cut.raw"):
        pass
