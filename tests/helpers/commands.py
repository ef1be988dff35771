"""Calls of the command line in this process."""

import sys
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

from typer.main import get_command
from typer.testing import CliRunner

from sweeps.cli import __main__ as process
from sweeps.cli.main import app

#: Made once: from the types of all their arguments it takes as long as a short command.
COMMANDS = get_command(app)
#: What a process does between its signals and its exit.
PROCESS = SimpleNamespace(main=lambda **_: sys.exit(process._exit_code()))
#: Ten points, computed in a moment.
SMALL = """\
name: small
oscillator:
  h: 0.1
  R: 0.8
  omega: {start: 1.5, stop: 3.0, num: 5}
  f: 1.0
  clearance: [0.0, 0.1]
method: {steps_per_period: 20}
record: {transient: 3, periods: 4, impacts: 2}
"""


def call(*arguments):
    """Run a command and return its result; it must not end with a traceback."""
    words = [str(argument) for argument in arguments]
    with (
        patch.object(sys, "argv", ["vibroimpact", *words]),
        patch("typer.main.get_command", lambda _: COMMANDS),
        patch("typer.testing._get_command", lambda _: PROCESS),
    ):
        result = CliRunner().invoke(app, words, prog_name="vibroimpact")
    assert isinstance(result.exception, SystemExit | type(None)), result.exception
    return result


def accepted(*arguments):
    """Run a command that must succeed, and return its output."""
    result = call(*arguments)
    assert result.exit_code == 0, result.stderr
    return result.stdout


def refused(*arguments):
    """Run a command that must be refused without changing a file, and return the message."""
    before = {path: path.lstat().st_mtime_ns for path in Path().rglob("*")}
    result = call(*arguments)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert {path: path.lstat().st_mtime_ns for path in Path().rglob("*")} == before
    assert result.stderr.startswith("vibroimpact: error: ")
    return result.stderr
