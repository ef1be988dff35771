"""What a command says while its work takes long."""

import io
import re
import sys
import threading
import time

import pytest

from sweeps.cli import common
from tests.helpers.commands import call

WORKING = {
    "sweeps.attractor.partition.attractors": ("attractors", "starts.h5"),
    "sweeps.attractor.integrity.integrity": ("integrity", "starts.h5", "--at", "omega=2"),
    "sweeps.plotting.plot": ("plot", "starts.h5"),
    "sweeps.engine.estimate.expected_cost": ("run", "starts.yaml", "--dry-run", "--overwrite"),
}
STARTS = """\
oscillator: {h: 0.1, R: 0.8, omega: [2.0, 2.1], f: 1.0}
start: {x0: {start: -1, stop: 0, num: 3}, v0: {start: -1, stop: 1, num: 3}}
record: {transient: 20, periods: 4, diagnostics: [period]}
"""


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def starts(folder):
    (folder / "starts.yaml").write_text(STARTS)
    assert call("run", "starts.yaml", "--quiet").exit_code == 0


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(common, "_PATIENCE", 0.05)


@pytest.mark.slow
@pytest.mark.parametrize("work", WORKING)
def test_a_command_says_in_one_line_what_takes_long(starts, impatient, monkeypatch, work):
    module, name = work.rsplit(".", 1)
    original, say = getattr(__import__(module, fromlist=[name]), name), common.say
    told = threading.Event()
    monkeypatch.setattr(common, "say", lambda *text, **to: say(*text, **to) or told.set())

    def slow(*arguments, **named):
        assert told.wait(300)
        return original(*arguments, **named)

    monkeypatch.setattr(work, slow)
    slowly = call(*WORKING[work])
    assert slowly.exit_code == 0, slowly.stderr
    assert len(re.findall(r"^.+ \.\.\.$", slowly.stderr, re.MULTILINE)) == 1, slowly.stderr


def test_progress_never_says_more_than_everything(impatient, monkeypatch):
    """An estimate of the work may be too small: 104 % leave no time, and not a negative one."""
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with common.progress_shown("counting") as report:
        for share in (0.5, 1.0, 1.04):
            report(share)
            time.sleep(0.3)
    text = screen.getvalue()
    assert "counting" in text and "50 %, about" in text
    assert not re.search(r"1\d\d %|-\d+.* left", text)


def test_quick_work_says_nothing(capsys, monkeypatch):
    monkeypatch.setattr(common, "_PATIENCE", 60.0)
    with common.progress_shown("counting"):
        pass
    assert capsys.readouterr() == ("", "")


def test_a_terminal_shows_work_that_reports_nothing(impatient, monkeypatch):
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with common.progress_shown("measuring"):
        until = time.monotonic() + 300
        while "measuring" not in screen.getvalue():
            assert time.monotonic() < until
            time.sleep(0.01)
