"""Progress on stderr: on a terminal a bar with the time left, elsewhere nothing but remarks."""

import io
import logging
import sys

import numpy as np
import pytest

from piezoharvest import (
    Campaign,
    DesignOptions,
    Rectifier,
    Resistor,
    SineForce,
    Study,
    System,
    Transducer,
    design,
    diagnose,
    identify,
    progress,
    simulate,
)
from piezoharvest.cli.notes import be_quiet, telling
from piezoharvest.description.tolerance import Tolerance
from piezoharvest.engine import run
from piezoharvest.engine.memory.tables import WORK_LEFT
from piezoharvest.engine.work_limit import Budget
from piezoharvest.identify.fitting.evaluation import map_records
from piezoharvest.progress import Iteration, Numbered, Stage, Step, each_told, followed, follower, silent, time_left


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture(autouse=True)
def loud():
    yield
    be_quiet(False)


def told(stream, monkeypatch):
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    with telling() as tell:
        tell(Step("the first part", 0, 4))
        tell("a remark [that] stays")
        tell(Step("the fourth part", 3, 4))
        tell(Step("of a length that is not known"))
    return stream.getvalue()


def test_a_terminal_sees_parts_and_remarks(monkeypatch):
    text = told(Terminal(), monkeypatch)
    assert "a remark [that] stays" in text
    assert "of a length that is not known" in text and "3/4" in text


def test_each_message_is_a_line_where_there_is_no_terminal(monkeypatch):
    lines = ["the first part", "a remark [that] stays", "the fourth part", "of a length that is not known"]
    assert told(io.StringIO(), monkeypatch).splitlines() == lines


def test_quiet_is_quiet_on_a_terminal(monkeypatch):
    be_quiet(True)
    assert told(Terminal(), monkeypatch) == ""


@pytest.mark.parametrize(
    ("done", "total", "now", "at", "left"),
    [(0, 4, 5.0, 0.0, None), (1, 4, 10.0, 10.0, 30.0), (1, 4, 25.0, 10.0, 15.0), (3, 4, 50.0, 30.0, None)],
)
def test_the_time_left_is_that_of_equal_parts(done, total, now, at, left):
    assert time_left(done, total, now, at) == (None if left is None else pytest.approx(left))


def test_a_step_is_text():
    step = Step("record 1 of 2", 0, 2)
    assert step == "record 1 of 2" and (step.done, step.total) == (0, 2) and isinstance(step, str)


def test_a_long_stage_tells_every_few_seconds_what_is_left(monkeypatch):
    said, clock = [], iter([0.0, 1.0, 10.0, 11.0, 20.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    stage = Stage(said.append, "tuning", "steps", most=True)
    for done in (1, 10, 11, 20):
        stage.reached(done, 100)
    assert [step.line for step in said] == [
        "tuning: 10 of at most 100 steps, at most 1:30 left",
        "tuning: 20 of at most 100 steps, at most 1:20 left",
    ]


def test_the_time_left_of_a_stage_does_not_count_what_was_before_it(monkeypatch):
    """A bar that has shown other parts for a while takes the pace of the stage alone."""
    monkeypatch.setattr(sys, "stderr", stream := Terminal())
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "200")
    with telling() as tell:
        tell(Step("before", 1, 2))
        tell(Step("the stage", 25, 100, spent=100.0))
    assert "about 5:00 left" in stream.getvalue() or "about 4:59 left" in stream.getvalue()


def test_a_stage_is_a_line_with_the_time_left_without_a_terminal(monkeypatch):
    monkeypatch.setattr(sys, "stderr", stream := io.StringIO())
    with telling() as tell:
        tell(Step("the stage", 25, 100, spent=100.0))
    assert stream.getvalue() == "the stage, about 5:00 left\n"


def test_the_bar_of_a_stage_ends_with_it(monkeypatch):
    """What comes then is of unknown length: a bar that stayed at three of four would be of something else."""
    monkeypatch.setattr(sys, "stderr", stream := Terminal())
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "200")
    with telling() as tell:
        tell(Step("the stage", 3, 4, spent=30.0))
        tell(Step("what follows"))
    last = stream.getvalue().split("what follows")[0].splitlines()[-1]
    assert "0/?" in last and "left" not in last


def test_parts_are_told_before_they_begin(monkeypatch):
    said, clock = [], iter([0.0, 0.0, 4.0, 30.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    names = ["leakage", "creep", "friction"]
    for name in each_told(said.append, lambda name: f"testing {name}", names, most=True):
        said.append(f"tried {name}")
    assert [progress.line(text) for text in said] == [
        "testing leakage (1 of 3)", "tried leakage",
        "testing creep (2 of 3)", "tried creep",  # of what takes a few seconds no time is told
        "testing friction (3 of 3), at most 0:15 left", "tried friction",
    ]  # fmt: skip
    assert [(text.done, text.total) for text in said if isinstance(text, Step)] == [(0, 3), (1, 3), (2, 3)]


def test_parts_of_a_stage_are_counted(monkeypatch):
    said, clock = [], iter([0.0, 6.0, 12.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    assert list(Stage(said.append, "scoring laws", "places").over("abc")) == ["a", "b", "c"]
    assert [step.line for step in said] == [
        "scoring laws: 1 of 3 places, about 0:12 left",
        "scoring laws: 2 of 3 places, about 0:06 left",
    ]


@pytest.mark.parametrize("threads", ["1", "2"])
def test_who_follows_a_job_is_told_of_its_records(threads, monkeypatch):
    """Most of a long fit and diagnosis: a scored effect, a test of residuals, a validation said nothing for minutes."""
    monkeypatch.setattr(progress, "EVERY", 0.0)
    monkeypatch.setenv("OMP_NUM_THREADS", threads)
    said = []
    with followed(said.append):
        assert map_records(lambda a, b: a + b, [1, 2, 3], [4, 5, 6]) == (5, 7, 9)
    assert said == ["comparing with the model: 1 of 3 records", "comparing with the model: 2 of 3 records"]
    assert all(step.line.endswith(" left") for step in said)
    assert follower() is silent and map_records(abs, [1, 2]) == (1, 2) and len(said) == 2


def test_a_search_for_a_steady_state_tells_how_much_work_it_may_do_yet(monkeypatch):
    """It ends long before, as a rule, in a few steps that nobody can foresee."""
    monkeypatch.setattr(progress, "EVERY", 0.0)
    transducer = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
    system = System(transducer, Rectifier(load_resistance=1e5, smoothing_capacitance=1e-6, diode_drop=0.3))
    budget, said, engine, left = Budget(1000), [], run.engine, iter([900, 800])

    def slow(task, machine, *arguments):
        machine[1][WORK_LEFT] = next(left, 0)
        for _ in range(100_000_000):  # until the other thread has told it
            if said:
                break
        return engine(task, machine, *arguments)

    monkeypatch.setattr(run, "engine", slow)
    simulate(system, SineForce(amplitude=0.02, frequency=50.0), budget=budget, progress=said.append)
    assert said[0].startswith("rectifier: seeking the steady state: 10.0 of at most 100 %")
    assert said[0].line.split(", ")[1].startswith("at most ")


@pytest.mark.parametrize(
    ("stage", "kind", "options"),
    [
        ("tuning", "series_rl", {}),
        ("parts of E6, round 1", "series_rlc", {"parts": "E6"}),
        ("tuning for the worst case of", "series_rl", {"tolerance": Tolerance(mass=0.02), "worst_case": True}),
        ("front from the best for harvest", "resistor", {"objective": "trade_off"}),
    ],
)
def test_long_stages_of_a_design_tell_how_far_they_are(stage, kind, options, monkeypatch):
    """Fourteen parts at two patches took minutes behind one line."""
    monkeypatch.setattr(progress, "EVERY", 0.0)
    transducer = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
    asked, said = DesignOptions(**{"objective": "harvest", "candidates": (kind,), **options}), []
    excitation = SineForce(amplitude=0.02, frequency=50.0)
    design(Study(transducer=transducer, excitation=excitation, design=asked), said.append)
    steps = [step for step in said if isinstance(step, Step) and step.startswith(f"{kind}: {stage}")]
    assert any(0 < step.done < step.total and step.line.endswith(" left") for step in steps)


def test_a_long_transient_tells_how_far_it_is(monkeypatch):
    """Compiled code over millions of periods told nothing for minutes."""
    monkeypatch.setattr(progress, "EVERY", 0.0)
    transducer = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
    shunt = Rectifier(load_resistance=1e5, smoothing_capacitance=1e-6, diode_drop=0.3)
    system, drive, said = System(transducer, shunt), SineForce(amplitude=0.02, frequency=50.0), []
    told = simulate(system, drive, transient=400.0, samples=1, progress=said.append)
    steps = [step for step in said if isinstance(step, Step) and step.startswith("rectifier: ")]
    assert any(0 < step.done < step.total == 100 and step.line.endswith(" left") for step in steps)
    assert told == simulate(system, drive, transient=400.0, samples=1)


def test_iterations_of_all_fits_of_a_job_are_counted_together():
    """A second fit, with the noise known better, began with iteration 1 again."""
    said = []
    job = Numbered.of(said.append)
    for tell in (job, Numbered.of(job)):
        tell(Iteration("misfit 3"))
        tell("a remark")
    assert said == ["iteration 1: misfit 3", "a remark", "iteration 2: misfit 3", "a remark"]
    assert [type(text) for text in said] == [Step, str, Step, str]


@pytest.fixture(scope="module")
def campaign():
    """A quasi-static specimen that a slow sine of force drives."""
    nominal = Transducer(mass=0.01, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
    t, rng = np.arange(400) / 1000, np.random.default_rng(1)
    force = 0.02 * np.sin(2 * np.pi * 31.0 * t)
    data = {"force_N": force, "displacement_m": force / 600.0 + 1e-9 * rng.standard_normal(400)}
    return Campaign.from_arrays(nominal, [{"data": data, "sample_rate": 1000.0, "shunt": Resistor(resistance=1e5)}])


@pytest.mark.parametrize("command", [identify, diagnose, design])
def test_a_caller_who_does_not_ask_finds_the_progress_in_the_log(campaign, command, caplog):
    """A diagnosis in Python said nothing for minutes, with nothing to be switched on."""
    sine = SineForce(amplitude=0.02, frequency=50.0)
    study = Study(transducer=campaign.transducer, excitation=sine, design=DesignOptions(candidates=("resistor",)))
    work, said = study if command is design else campaign, []
    options = {"library": ()} if command is diagnose else {}  # no effect is tried: the fit alone says enough
    command(work, said.append, **options)
    with caplog.at_level(logging.INFO, logger="piezoharvest"):
        command(work, **options)
    logged = [record.getMessage() for record in caplog.records if record.name == "piezoharvest"]
    assert said and logged == said
