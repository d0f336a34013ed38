"""What the tests of sweeps share."""

import pytest
from sweep_studies import write

from piezoharvest.cli import main


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    """Run `piezoharvest sweep` on a text in an empty folder; gives exit status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def call(text, *arguments):
        write(tmp_path, text)
        status = main(["sweep", "study.toml", *arguments])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return status, captured.out, captured.err

    return call
