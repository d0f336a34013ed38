"""Progress on stderr: on a terminal a bar with the time left, elsewhere nothing but remarks."""

import io
import sys

import pytest

from piezoharvest.cli.notes import _left, be_quiet, telling
from piezoharvest.progress import Step


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
    assert _left(done, total, now, at) == (None if left is None else pytest.approx(left))


def test_a_step_is_text():
    step = Step("record 1 of 2", 0, 2)
    assert step == "record 1 of 2" and (step.done, step.total) == (0, 2) and isinstance(step, str)
