"""What is not the file of a sweep is left alone, and a file that is lost in a run is missed."""

import os
import re
import shutil
import socket
import stat
import subprocess
import sys
from pathlib import Path

import h5py
import pytest

from commands import call
from sweeps import load_config, open_sweep, run_sweep
from sweeps.engine import run as runner
from sweeps.engine import workers
from sweeps.errors import Failed, StoreError
from sweeps.store import check_output, only_writer
from sweeps.store.reader import SweepFile
from sweeps.store.writer import SweepWriter
from vibroimpact import Status

CONFIG = """\
oscillator: {h: 0.1, R: 0.8, omega: {start: 1.5, stop: 3.0, num: 40}, f: 1.0}
method: {integrator: newmark, impact: plain}
record: {transient: 3, periods: 4, impacts: 2}
output: out.h5
"""


def run(*options):
    return call("run", "sweep.yaml", "--quiet", *options)


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    monkeypatch.setattr(runner, "block_size", lambda *_, **__: 10)


# What is no regular file


def fifo():
    os.mkfifo("out.h5")


def unix_socket():
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("out.h5")


def device():
    Path("out.h5").symlink_to("/dev/null")


@pytest.mark.parametrize("make", [fifo, unix_socket, device])
@pytest.mark.parametrize("option", ["--overwrite", "--resume"])
def test_what_is_no_regular_file_is_refused_and_stays(make, option):
    """Without waiting for a writer of the FIFO, too."""
    make()
    before = os.stat("out.h5").st_mode
    result = run(option)
    assert result.exit_code == 2
    assert "not a regular file" in result.stderr and "another name" in result.stderr
    assert os.stat("out.h5").st_mode == before and not stat.S_ISREG(before)
    for command in ("info", "plot"):
        result = call(command, "out.h5")
        assert result.exit_code == 2 and "not a regular file" in result.stderr
    assert sorted(path.name for path in Path().iterdir()) == ["out.h5", "sweep.yaml"]


@pytest.mark.parametrize("option", ["--overwrite", "--resume"])
def test_an_hdf5_file_of_another_program_is_not_replaced(option):
    with h5py.File("out.h5", "w") as file:
        file["precious"] = range(5)
        file.attrs["format"] = "another"
    before = Path("out.h5").read_bytes()
    result = run(option)
    assert result.exit_code == 2 and "vibroimpact did not write" in result.stderr
    assert Path("out.h5").read_bytes() == before


@pytest.mark.parametrize("kept", [0, 2500, 5000, -10])
def test_a_damaged_file_of_a_sweep_can_be_replaced(kept):
    assert run().exit_code == 0
    content = Path("out.h5").read_bytes()
    Path("out.h5").write_bytes(content[:kept])
    assert run("--overwrite").exit_code == 0
    open_sweep("out.h5").close()


# The lock and the new file beside the output


@pytest.mark.parametrize("to", ["precious", "missing"])
def test_a_link_where_the_lock_goes_is_not_followed(to):
    Path("precious").write_text("42\n")
    Path("out.h5.lock").symlink_to(to)
    result = run()
    assert result.exit_code == 2 and "out.h5.lock is needed as a lock" in result.stderr
    assert Path("precious").read_text() == "42\n"
    assert os.readlink("out.h5.lock") == to
    assert not Path("out.h5").exists() and not Path("missing").exists()


@pytest.mark.parametrize(
    "text", ["my notes\n", "42\n", "vibroimpact lock of process 1\nand more\n"]
)
def test_a_users_own_file_of_the_name_of_the_lock_stays(text):
    Path("out.h5.lock").write_text(text)
    result = run()
    assert result.exit_code == 2 and "move it" in result.stderr
    assert Path("out.h5.lock").read_text() == text


def test_an_empty_file_of_the_name_of_the_lock_is_used_and_stays():
    Path("out.h5.lock").touch()
    assert run().exit_code == 0
    assert Path("out.h5.lock").read_bytes() == b""


def test_the_lock_of_a_dead_process_is_taken_over_and_removed():
    Path("out.h5.lock").write_text("vibroimpact lock of process 999999\n")
    assert run().exit_code == 0
    assert not Path("out.h5.lock").exists()


def test_a_pipe_where_the_lock_goes_does_not_block():
    os.mkfifo("out.h5.lock")
    with pytest.raises(StoreError, match="needed as a lock"), only_writer(Path("out.h5")):
        pass


def test_only_the_new_files_of_killed_writers_are_removed():
    names = [".out.h5.new", ".out.h5.0123abcd.new.txt", f".out.h5.{os.getpid()}-0123abcd.new"]
    ended = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], stdout=-1)
    left = Path(f".out.h5.{int(ended.stdout)}-0123abcd.new")
    for name in [*names, left]:
        Path(name).write_text("x")
    assert run().exit_code == 0
    assert not left.exists()
    assert all(Path(name).read_text() == "x" for name in names)


def test_an_empty_file_becomes_the_output():
    Path("out.h5").touch()
    check_output("out.h5", resume=True)
    assert run("--resume").exit_code == 0
    open_sweep("out.h5").close()


# A file that is lost in the middle of a run


def remove():
    Path("out.h5").unlink()


def replace():
    Path("other").write_bytes(Path("out.h5").read_bytes())
    os.replace("other", "out.h5")


def truncate():
    os.truncate("out.h5", 5000)


def empty_and_restore():
    """As ``cp`` does it: the size is as before, and the content is not."""
    size = os.stat("out.h5").st_size
    os.truncate("out.h5", 0)
    os.truncate("out.h5", size)


def move_folder():
    shutil.copytree(".", "../elsewhere", dirs_exist_ok=True)
    Path("out.h5").rename("../elsewhere/out.h5")


LOSSES = {
    remove: "removed",
    replace: "replaced",
    truncate: "truncated",
    empty_and_restore: "(changed|truncated)",  # the run may look in between
    move_folder: "removed",
}


@pytest.mark.slow
@pytest.mark.parametrize("at", [0, 1, 3])
@pytest.mark.parametrize("lose", LOSSES)
@pytest.mark.parametrize("compression", ["none", "gzip"])
def test_a_lost_output_is_a_failure_that_says_so(monkeypatch, lose, at, compression):
    """Before the first block, between two, and after the last but one; each is one of four."""
    blocks = []

    def losing(*arguments, **named):
        results = compute_block(*arguments, **named)
        if len(blocks) == at:
            lose()
        blocks.append(arguments[1])
        return results

    compute_block = workers.compute_block
    monkeypatch.setattr(workers, "compute_block", losing)
    result = run("--set", f"compression={compression}")
    assert result.exit_code == 1, result.output
    assert re.search(f"out.h5 was {LOSSES[lose]} by another program", result.stderr)
    assert "to go on" not in result.stderr
    assert not list(Path().glob(".out*"))


@pytest.mark.parametrize("lose", LOSSES)
def test_a_loss_after_the_last_block_is_a_failure(monkeypatch, lose):
    finish = runner.SweepWriter.finish

    def losing(store, **options):
        finish(store, **options)
        lose()

    monkeypatch.setattr(runner.SweepWriter, "finish", losing)
    with pytest.raises(Failed, match=f"out.h5 was {LOSSES[lose]} by another"):
        run_sweep(load_config("sweep.yaml"))


# What is said after a failed --overwrite


@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("where", ["sweeps.store.writer.create", "sweeps.engine.run.estimate"])
def test_a_failed_overwrite_says_that_the_old_file_is_there(monkeypatch, failure, where):
    assert run().exit_code == 0
    before = Path("out.h5").read_bytes()

    def fail(*_, **__):
        raise failure

    monkeypatch.setattr(where, fail)
    result = run("--overwrite")
    assert result.exit_code == 1
    assert "nothing is kept of it, and the old out.h5 is as it was" in result.stderr
    assert "--resume" not in result.stderr
    assert Path("out.h5").read_bytes() == before


def test_an_overwrite_that_was_interrupted_later_speaks_of_the_new_file(monkeypatch):
    assert run().exit_code == 0
    compute_block = workers.compute_block
    done = []

    def stopping(*arguments, **named):
        if done:
            raise KeyboardInterrupt
        done.append(1)
        return compute_block(*arguments, **named)

    monkeypatch.setattr(workers, "compute_block", stopping)
    result = run("--overwrite")
    assert result.exit_code == 1
    assert "10 of 40 points kept in out.h5; to go on: " in result.stderr


# A name that changes its meaning during a run


def turn_the_link():
    Path("link.h5").unlink()
    Path("link.h5").symlink_to("other.h5")


@pytest.mark.parametrize("change", [turn_the_link, lambda: os.chdir("folder")])
def test_a_run_keeps_to_the_file_that_it_began(tmp_path, monkeypatch, change):
    """A link may be turned to another file, and a program may change its folder."""
    Path("folder").mkdir()
    Path("link.h5").symlink_to("real.h5")
    write = SweepWriter.write

    def writing(writer, block, results):
        write(writer, block, results)
        monkeypatch.setattr(SweepWriter, "write", write)
        change()

    config = load_config("sweep.yaml")
    monkeypatch.setattr(SweepWriter, "write", writing)
    run_sweep(config, "link.h5")
    assert not (tmp_path / "other.h5").exists()
    with open_sweep(tmp_path / "real.h5") as dataset:
        assert not (dataset["status"] == Status.PENDING).any()


def test_a_link_that_is_turned_while_a_file_is_checked_mixes_no_sweeps(monkeypatch):
    for path, h in (("a.h5", 0.1), ("b.h5", 0.3)):
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(SweepWriter, "write", interrupted)
            run_sweep(load_config("sweep.yaml", [f"oscillator.h={h}"]), path)
    Path("link.h5").symlink_to("a.h5")
    damaged = SweepFile.damaged

    def turning(file):
        monkeypatch.setattr(SweepFile, "damaged", damaged)
        Path("link.h5").unlink()
        Path("link.h5").symlink_to("b.h5")
        return damaged(file)

    monkeypatch.setattr(SweepFile, "damaged", turning)
    run_sweep(load_config("sweep.yaml", ["oscillator.h=0.1"]), "link.h5", resume=True)
    for path, pending in (("a.h5", False), ("b.h5", True)):
        with open_sweep(path) as dataset:
            assert ((dataset["status"] == Status.PENDING) == pending).all()


def interrupted(*_):
    raise KeyboardInterrupt
