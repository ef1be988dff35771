"""What a command says while its work takes long."""

import io
import re
import sys
import threading
import time

import pytest
from bokeh.document import Document
from rich.console import Console

from sweeps import load_config, text
from sweeps.engine.executors import LocalComputer
from sweeps.engine.sweep_run import _progress
from sweeps.explorer.live_page import LivePage
from sweeps.explorer.view import View
from tests.helpers.commands import call
from tests.helpers.interruptions import wait_until

WORKING = {
    "sweeps.attractor.attractors.attractors": ("attractors", "starts.h5"),
    "sweeps.attractor.integrity.integrity": ("integrity", "starts.h5", "--at", "omega=2"),
    "sweeps.plotting.plot": ("plot", "starts.h5"),
    "sweeps.engine.estimate.expected_cost": ("run", "starts.yaml", "--dry-run", "--overwrite"),
    "sweeps.engine.sweep_run.expected_cost": ("run", "starts.yaml", "--overwrite"),
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
    monkeypatch.setattr(text, "PATIENCE", 0.05)


@pytest.mark.slow
@pytest.mark.parametrize("work", WORKING)
def test_a_command_says_in_one_line_what_takes_long(starts, impatient, monkeypatch, work):
    module, name = work.rsplit(".", 1)
    original, say = getattr(__import__(module, fromlist=[name]), name), Console.print
    told = threading.Event()
    monkeypatch.setattr(Console, "print", lambda *words, **to: say(*words, **to) or told.set())

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
    with text.progress_shown("counting") as report:
        for share in (0.5, 1.04):
            report(share)
            time.sleep(0.3)
    shown = screen.getvalue()
    assert "counting" in shown and "50 %, about" in shown
    assert not re.search(r"1\d\d %|-\d+.* left", shown)


@pytest.mark.parametrize("name", ["short", "a name of many words that is longer than the line"])
def test_the_progress_of_a_run_shows_the_time_that_is_left(folder, name):
    (folder / "scene.yaml").write_text(f"name: {name}\n{STARTS}")
    config, screen = load_config("scene.yaml"), Terminal()
    console = Console(file=screen, force_terminal=True, width=80)
    with _progress(config, 18, LocalComputer(1), console) as advance:
        advance(1)
    shown = re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", screen.getvalue())
    lines = [line for line in shown.splitlines() if "points" in line]
    assert lines and all(line.startswith(name[:16]) for line in lines)
    assert all(re.search(r" \d+/18 points .*(\d+:\d\d:\d\d|-:--:--) *$", line) for line in lines)


@pytest.mark.parametrize("name", ["a[b]c", "[bold]", "a :car: b"])
def test_a_terminal_and_a_log_show_a_name_as_it_is(impatient, monkeypatch, name):
    """Also of work that reports nothing."""
    for screen in (Terminal(), io.StringIO()):
        monkeypatch.setattr(sys, "stderr", screen)
        monkeypatch.setenv("TERM", "xterm")
        with text.progress_shown(name):
            wait_until(lambda screen=screen: name in screen.getvalue(), "the name of the work")


def test_quiet_work_leaves_the_streams_alone(impatient, monkeypatch):
    screen, output = Terminal(), sys.stdout
    monkeypatch.setattr(sys, "stderr", screen)
    with text.progress_shown("counting", quiet=True) as report:
        report(0.5)
        time.sleep(0.2)
        assert sys.stdout is output
    assert screen.getvalue() == ""


@pytest.mark.parametrize(
    ("change", "most", "rate"),
    [
        ("oscillator.f=1", "", "periods/s"),
        ("record.transient=auto", "at most ", ""),
        ("oscillator.f=[1, 2]", "at most ", ""),  # one is computed, and the other scaled
    ],
)
def test_only_periods_that_are_computed_are_counted(folder, change, most, rate):
    scene = (
        "oscillator: {h: 0.1, R: 0.8, omega: 2.0, f: 1.0}\nrecord: {transient: 20, periods: 4}\n"
    )
    (folder / "scene.yaml").write_text(scene)
    shown = call("run", "scene.yaml", "--set", change).stderr
    assert re.search(rf"^forcing periods +{most}\d", shown, re.MULTILINE)
    assert ("periods/s" in shown) == bool(rate)
    config = load_config("scene.yaml", [change])
    page = LivePage(Document(), View.of(config), folder)
    page._report(config, config.size, 0.1, 0.2)
    assert ("periods/s" in page.controls.status.text) == bool(rate)
    page.worker.shutdown()
