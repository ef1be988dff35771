"""The command line as tests call it, in this process."""

from pathlib import Path

from typer.testing import CliRunner

from sweeps.cli.main import app


def call(*arguments):
    """Run a command and return its result; it ends as a command, not with a traceback."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert isinstance(result.exception, SystemExit | type(None)), result.exception
    return result


def accepted(*arguments):
    """Run a command that must succeed, and return what it prints."""
    result = call(*arguments)
    assert result.exit_code == 0, result.stderr
    return result.stdout


def refused(*arguments):
    """Run a command that must be refused and change no file, and return the message."""
    before = {path: path.stat().st_mtime_ns for path in Path().rglob("*")}
    result = call(*arguments)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert {path: path.stat().st_mtime_ns for path in Path().rglob("*")} == before
    assert result.stderr.startswith("vibroimpact: error: ")
    return result.stderr
