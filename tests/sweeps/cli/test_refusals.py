"""Commands that are refused, interrupted or fail: message, exit code, and files kept."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
import types
from pathlib import Path

import psutil
import pytest

from sweeps import interrupts, run_sweep
from sweeps.errors import Refused, StoreError
from sweeps.interrupts import Cancelled
from sweeps.store.writer import SweepWriter
from tests.helpers.commands import SMALL, accepted, call, refused
from tests.helpers.interruptions import wait_until
from tests.helpers.places import ROOT

CONFIG = SMALL


def test_resume_and_overwrite_exclude_each_other(small_file):
    both, told = ("--resume", "--overwrite"), "--resume and --overwrite "
    assert told in refused("run", "missing.yaml", *both)
    assert told in refused("zoom", "missing.h5", "omega=2:3", *both)
    with pytest.raises(Refused, match=told):
        run_sweep("sweep.yaml", "out.h5", resume=True, overwrite=True)


@pytest.mark.parametrize("dry", [[], ["--dry-run"]])
def test_an_output_folder_that_does_not_exist_and_a_disk_that_is_too_small(monkeypatch, dry):
    told = refused("run", "sweep.yaml", "-o", "nowhere/out.h5", *dry)
    assert told.startswith("vibroimpact: error: the folder nowhere of the output out.h5 does not")
    told = refused("run", "sweep.yaml", "--set", "output=nowhere/out.h5", *dry)
    assert told.startswith("vibroimpact: error: sweep.yaml: output: the folder nowhere of the out")
    monkeypatch.setattr("shutil.disk_usage", lambda _: types.SimpleNamespace(free=1000))
    told = refused("run", "sweep.yaml", *dry)
    assert re.search(r"the sweep takes about \d+\.?\d* kB .* has only 1 kB left", told)


def test_a_folder_where_no_file_can_be_made_is_refused_before_any_work(small_file, monkeypatch):
    monkeypatch.setattr("os.access", lambda _, mode: not mode & os.W_OK)
    for command in ("run sweep.yaml", "plot small.h5", "export small.h5 -o a.csv", "init"):
        assert f"no file can be made in the folder {Path().absolute()}" in refused(*command.split())


@pytest.mark.parametrize("place", [".", "/", "", "loop", "fifo.h5", "old.h5", "text.h5"])
def test_what_is_no_file_of_a_sweep(small_file, place):
    """A folder, a link to itself, a FIFO without a writer, a file with the name of its blocks."""
    Path("loop").symlink_to("loop")
    Path("old.h5.parts").touch()
    Path("text.h5").write_text("hello")
    os.mkfifo("fifo.h5")
    said = {"loop": "Too many levels of symbolic links", "fifo.h5": "is a FIFO, not a regular file"}
    said |= {"old.h5": "error: old.h5 does not exist\n", "text.h5": "is not an HDF5 file"}
    options = {"compare": ["small.h5"], "zoom": ["omega=2:3"], "export": ["-o", "a.csv"]}
    for command in ("info", "plot", "attractors", "integrity", *options):
        message = refused(command, place, *options.get(command, ()))
        assert said.get(place, "is a directory, not a regular file") in message, (command, message)
    run = refused("run", place, "-o", "new.h5")
    assert "Errno" not in run and (place[:4] not in ("fifo", "text") or "no file of a sweep" in run)


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--at", "omega=2", "--at", "omega=3"], ["--at omega=3 ", "omega was given before"]),
        (["--at", "omega=" + "9" * 5000], ["--at omega=999", "999... is not allowed"]),
        (["--periods", "0"], ["--periods 0 is not allowed; expected: an integer >= 1"]),
        (["--periods", "2", "--kind", "map"], ["periods can be chosen for trajectory only"]),
        (["--xlim", "9:9.000000000000002"], ["xlim = 9:9.000000000000002; the data range from "]),
        (["--xlim", "3.0000001:4", "--kind", "bifurcation"], ["3.0000001:4; the data", "to 3"]),
        (["--dpi", "410", "--width", "40in"], ["of 16400 x ", "less than 16384 each way"]),
        (["--xlim", "0:1e308"], ["xlim = ", "numbers up to 4e+307 of which the first is smaller"]),
    ],
)
def test_a_picture_that_cannot_be_drawn(small_file, arguments, parts):
    message = refused("plot", "small.h5", *arguments)
    for part in parts:
        assert part in message


def test_a_cut_off_the_grid_is_told(small_file, unpainted):
    result = call("plot", "small.h5", "--at", "clearance=0.06")
    assert (result.exit_code, result.stdout) == (0, "small-clearance-0.06.png\n")
    assert result.stderr == "clearance = 0.06 is not on the grid; drawn at clearance = 0.1\n"
    near = call("plot", "small.h5", "--at", "clearance=0.09999996")
    assert near.stderr == "clearance = 0.09999996 is not on the grid; drawn at clearance = 0.1\n"
    beyond = refused("plot", "small.h5", "--at", "clearance=0.10000004")
    assert "clearance = 0.10000004 is outside the sweep: 0 to 0.1\n" in beyond
    for typed in ("0.1000000000001", "1e-12"):
        rounded = call("plot", "small.h5", "--at", f"clearance={typed}")
        assert (rounded.exit_code, rounded.stderr) == (0, "")


@pytest.mark.parametrize(
    ("request_", "told"),
    [
        ("run", "missing argument 'CONFIG...'; vibroimpact run --help"),
        ("run sweep.yaml --set", "option '--set' requires an argument; vibroimpact run --help"),
        ("run sweep.yaml --quite", "no option --quite (did you mean --quiet?); vibroimpact run"),
        ("run a --threads x", "--threads x is not allowed; expected: an integer from 1 to"),
        ("explore --port 65536", "--port 65536 is not allowed; expected: an integer from 0 to 6"),
        ("plot a.h5 --exact --classes 1/" + "1" * 5000, "expected: periods/impacts of one class"),
        ("export a.h5", "missing option '-o' / '--output'; vibroimpact export --help"),
        ("init a b", "(b); vibroimpact init --help shows what is allowed"),
        ("fly", "there is no command fly; expected: init, run, "),
        ("bench speeed", "no command speeed (did you mean speed?); expected: accuracy-speed, "),
        ("bench speed --quiet", "there is no option --quiet; vibroimpact bench speed --help"),
        ("plot a.h5 --lim 2:3", "no option --lim (did you mean --xlim or --ylim?)"),
        ("attr a.h5", "there is no command attr (did you mean attractors?); expected: init, "),
        ("--foo run", "there is no option --foo; vibroimpact --help shows what is allowed"),
    ],
)
def test_bad_arguments(request_, told):
    message = refused(*request_.split())
    assert told in message and message.count("\n") == 1


LONG = "/".join(["folder" * 8] * 6)


@pytest.mark.parametrize("start", [f"{LONG}/", "name" * 75, f"{LONG}/{'name' * 75}"])
def test_a_long_path_is_refused_by_its_name(small_file, start):
    Path(LONG).mkdir(parents=True)
    calls = [
        [command, f"{start}z.h5", *others]
        for command, others in (
            ("info", []), ("plot", []), ("zoom", ["omega=2:3"]), ("run", []),
            ("explore", ["--no-browser"]), ("export", ["-o", "a.csv"]), ("init", []),
        )
    ]  # fmt: skip
    calls += [["run", "sweep.yaml", "small.h5", "-o", f"{start}z.h5"], ["run", f"{start}.yaml"]]
    calls += [["run", "sweep.yaml", "-o", f"{start}z.txt"], ["plot", "small.h5", "--kind", start]]
    calls += [["run", "sweep.yaml", "--set", f"points={start}.csv"], [start]]
    for words in calls:
        message = refused(*words)
        assert "Errno" not in message and start[:30] in message
    if start == f"{LONG}/":
        Path("small.h5").rename(f"{LONG}/other.h5")
        Path(f"{LONG}/z.yaml").write_text(SMALL)
        assert refused("info", f"{LONG}/z.h5").endswith(f": vibroimpact run {LONG}/z.yaml\n")


@pytest.mark.parametrize("group", [[], ["bench"]])
def test_without_a_command_the_list_of_all_is_shown_whole(group):
    result = call(*group)
    assert (result.exit_code, result.stderr) == (2, accepted(*group, "--help"))
    commands = result.stderr.partition("Commands:\n")[2]
    assert commands.count("\n") >= 4 and "..." not in commands


def test_a_run_without_enough_memory_says_so(monkeypatch):
    """`store/test_faults.py` has the other ends of a run."""

    def run_sweep(*_, **__):
        raise MemoryError

    monkeypatch.setattr("sweeps.engine.sweep_run.run_sweep", run_sweep)
    result = call("run", "sweep.yaml")
    said = "vibroimpact: error: the run failed: MemoryError; nothing is kept\n"
    assert (result.exit_code, result.stderr) == (1, said)


def test_the_name_of_a_file_is_shown_as_it_is():
    for name in ("an output.h5", "overwrite=True.h5", "coordinate='x'.h5"):
        assert f"error: {name} does not exist" in refused("info", name)
    assert refused("info", "a\nb.h5").endswith("error: a\\nb.h5 does not exist\n")  # in one line


def test_an_interrupted_run_says_what_is_kept(stop_after):
    for option, done in (("--overwrite", 2), ("--resume", 4)):
        with stop_after(1, size=2):
            result = call("run", option, "sweep.yaml", "--quiet", "--set", "name=a b")
        assert result.exit_code == 1
        assert f"interrupted; {done} of 10 points kept in a b.h5.parts; " in result.stderr
        command = "vibroimpact run sweep.yaml --quiet --set 'name=a b' --resume"
        assert result.stderr.endswith(f"; to go on: {command}\n")


def test_an_interrupted_command_exits_with_1(monkeypatch):
    def interrupt(*_, **__):
        raise Cancelled  # as the handlers of a process do

    monkeypatch.setattr("sweeps.config.sweep.json_schema", interrupt)
    result = call("schema")
    assert (result.exit_code, result.stderr) == (1, "vibroimpact: error: interrupted\n")


@pytest.mark.slow
def test_a_signal_ends_the_wait_for_a_configuration_in_a_pipe():
    os.mkfifo("pipe.yaml")
    command = [sys.executable, "-m", "sweeps.cli", "run", "pipe.yaml"]
    environment = {"PYTHONPATH": str(ROOT), "PATH": ""}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as run:
        try:
            writer = os.open("pipe.yaml", os.O_WRONLY)  # waits until the command opens it
            # A signal just before the system call `read` does not end it.
            status, asleep = psutil.Process(run.pid).status, psutil.STATUS_SLEEPING
            wait_until(lambda: status() == asleep, "a command that waits")
            time.sleep(0.5)
            run.send_signal(signal.SIGTERM)
            _, stderr = run.communicate(timeout=300)
        finally:
            run.kill()
    os.close(writer)
    assert (run.returncode, stderr) == (1, "vibroimpact: error: interrupted\n")


class Callback:
    """Exceptions in it are swallowed, as in LLVM's."""

    def __init__(self, number):
        self.number = number

    def __del__(self):
        os.kill(os.getpid(), self.number)
        time.sleep(0.1)


class Held:
    """Its lock is not released, as of a file of xarray that an interrupt ends while it is opened.

    At the end of the command, xarray waits for the lock to close the file.
    """

    def __init__(self, number):
        lock = threading.Lock()
        lock.acquire()
        try:
            os.kill(os.getpid(), number)
            time.sleep(300.0)
        finally:
            lock.acquire()


def refusing(number):
    """Refuse a file because of an error that h5py makes of an interrupt."""
    try:
        os.kill(os.getpid(), number)
        time.sleep(300.0)
    except Cancelled:
        raise StoreError("small.h5 cannot be trusted") from None


@pytest.mark.parametrize("interrupted", [Callback, Held, refusing])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_command_that_waits_for_others_is_interrupted_wherever_it_is(
    small_file, monkeypatch, capfd, handlers, number, interrupted
):
    def contents(sweep):
        interrupted(number)
        wait_until(lambda: False, "the interrupt")

    monkeypatch.setattr("sweeps.opened.export.contents", contents)
    result = call("info", "small.h5")
    assert (result.exit_code, result.stderr) == (1, "vibroimpact: error: interrupted\n")
    assert capfd.readouterr().err == ""


def test_a_signal_that_comes_when_the_block_ends_is_noted_only(handlers):
    """Its exception would leave the handlers and the hook of the block."""
    with interrupts.raised_at_once():
        handler = signal.getsignal(signal.SIGINT)
    handler(signal.SIGINT, None)
    assert interrupts.signal_came()


def test_other_exceptions_in_a_callback_are_reported_as_before(monkeypatch):
    class Wrong:
        def __del__(self):
            raise KeyError

    reported = []
    monkeypatch.setattr(sys, "unraisablehook", lambda about: reported.append(about.exc_type))
    report = sys.unraisablehook
    with interrupts.raised_at_once():
        Wrong()
    assert reported == [KeyError] and sys.unraisablehook is report


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_that_the_compiler_swallows_is_not_lost(monkeypatch, capfd, handlers, number):
    written = []

    def write(self, block, results):
        written.append(block)
        Callback(number)

    monkeypatch.setattr(SweepWriter, "write", write)
    monkeypatch.setattr("sweeps.engine.estimate.block_size", lambda *_, **__: 2)
    result = call("run", "sweep.yaml", "--quiet")
    assert result.exit_code == 1
    assert result.stderr.startswith("vibroimpact: error: interrupted; 0 of 10 points kept")
    assert len(written) == 1
    assert capfd.readouterr().err == ""
