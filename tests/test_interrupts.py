"""Ctrl-C and SIGTERM at every moment of a command: a process of its own signals itself where it is told to."""

import signal
import subprocess
import sys

import pytest

# Interrupts itself where a module is looked for, once it is certain that it listens.
CHILD = """
import atexit, ctypes, os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background would not listen
number, place = getattr(signal, sys.argv.pop(1)), sys.argv.pop(1)

class Signal:
    def find_spec(self, name, *_):
        if name == place:
            sys.meta_path.remove(self)
            {send}

sys.meta_path.insert(0, Signal())
if place == "exit":
    atexit.register(os.kill, os.getpid(), number)
from piezoharvest.__main__ import run
sys.exit(run())
"""
DIRECTLY = "os.kill(os.getpid(), number)"
AS_TEXT = "exec('os.kill(os.getpid(), number)')"  # of which Python remembers a KeyboardInterrupt to the end
# A callback from C cannot raise, and Python ignores what it raises.
IN_CALLBACK = "ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), number))()"
STATUS = {"SIGINT": 130, "SIGTERM": 143}
STUDY = """\
[transducer]
mass = 0.01
damping = 0.0628
stiffness = 986.96
coupling = 1e-3
capacitance = 40e-9

[excitation]
kind = "sine_force"
amplitude = 0.02
frequency = 50.6

[[shunts]]
kind = "resistor"
resistance = 8e4
"""


@pytest.fixture
def interrupted(tmp_path):
    """Status and output of a command that a signal meets at a place."""
    (tmp_path / "study.toml").write_text(STUDY)

    def run(number: str, place: str, send: str = DIRECTLY) -> tuple[int, str, str]:
        code = CHILD.replace("{send}", send)
        line = [sys.executable, "-c", code, number, place, "simulate", "study.toml", "--out", "waves.csv"]
        done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.mark.parametrize("number", STATUS)
@pytest.mark.parametrize(
    ("place", "send"),
    [
        ("piezoharvest.cli", DIRECTLY),
        ("typer", AS_TEXT),
        ("piezoharvest.cli.commands", IN_CALLBACK),
        ("piezoharvest.engine.run", DIRECTLY),
        ("piezoharvest.engine.run", AS_TEXT),
    ],
)
def test_a_command_says_in_one_sentence_that_it_was_interrupted(interrupted, tmp_path, number, place, send):
    assert interrupted(number, place, send) == (STATUS[number], "", "piezoharvest: interrupted\n")
    assert [path.name for path in tmp_path.iterdir()] == ["study.toml"]


@pytest.mark.parametrize("number", STATUS)
def test_a_command_that_has_said_all_ends_without_a_word(interrupted, tmp_path, number):
    status, out, err = interrupted(number, "exit")
    assert status == -getattr(signal, number)
    assert out.startswith("study") and err == "waveforms: waves.csv\n"
    assert {path.name for path in tmp_path.iterdir()} == {"study.toml", "waves.csv"}


def test_an_ignored_interrupt_stays_ignored(tmp_path):
    """A shell has what runs in the background ignore Ctrl-C."""
    line = [sys.executable, "-c", CHILD.replace("{send}", DIRECTLY).replace("default_int_handler", "SIG_IGN")]
    done = subprocess.run([*line, "SIGINT", "typer", "--version"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
