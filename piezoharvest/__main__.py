"""The command line as `piezoharvest` and `python -m piezoharvest`, to be ended at any moment."""

import os
import signal
import sys
import threading
from typing import Any, NoReturn

# Ctrl-C, and what containers and batch systems end a run with; a default is what Python or the system does on its own.
# A shell has what it starts in the background ignore Ctrl-C: that stays so.
DEFAULTS = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
MOMENT = 0.01  # s, after which a signal comes again: by then a callback of a library has mostly returned


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, of a class of its own.

    After a KeyboardInterrupt in code that was given as text, as dataclasses and numba have it, Python ends by the
    signal and not with its status, whatever has caught the exception since.
    """


def run() -> int:
    """Run the command line in a process that does nothing else, and return its exit status."""
    ours = [number for number, default in DEFAULTS.items() if signal.getsignal(number) is default]
    try:
        for number in ours:
            signal.signal(number, _end)
        sys.unraisablehook = _again
        _open_streams()
        from piezoharvest.cli import main  # its libraries take longer to import than many a command does to run

        return main()
    except KeyboardInterrupt:
        status = 130
    except SystemExit as ended:
        status = int(ended.code or 0)
    finally:
        for number in ours:  # all has been said and written: from now on the process ends without a word
            signal.signal(number, signal.SIG_DFL)
    print("piezoharvest: interrupted", file=sys.stderr)
    return status


def _open_streams() -> None:
    """Give the streams that a shell has closed (`>&-`) something to write to: files would get their numbers."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r+"))  # noqa: SIM115  # until the process ends


def _end(number: int, _: object) -> NoReturn:
    raise Interrupted if number == signal.SIGINT else SystemExit(128 + number)


def _again(ignored: Any) -> None:
    """Send a signal again whose exception Python had to ignore, as it came in a callback that cannot raise."""
    number = {Interrupted: signal.SIGINT, SystemExit: signal.SIGTERM}.get(ignored.exc_type)
    if number is None:
        sys.__unraisablehook__(ignored)
    else:
        threading.Timer(MOMENT, os.kill, (os.getpid(), number)).start()


if __name__ == "__main__":
    sys.exit(run())
