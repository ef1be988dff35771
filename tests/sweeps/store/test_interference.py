"""Other programs, an old file and a change of names during a run lose nothing without a word."""

import os
import re
import shutil
from pathlib import Path

import pytest
import xarray as xr

from sweeps import load_config, open_sweep, run_sweep
from sweeps.engine import executors
from sweeps.store import SweepWriter
from tests.helpers.commands import call
from tests.helpers.sweep_files import data
from tests.helpers.written_files import contents, fill_blocks
from vibroimpact.status import Status

CONFIG = """\
oscillator: {h: 0.1, R: 0.8, omega: {start: 1.5, stop: 3.0, num: 40}, f: 1.0}
method: {integrator: newmark, impact: plain}
record: {transient: 3, periods: 4, impacts: 2}
output: out.h5
"""
PARTS = Path("out.h5.parts")


# A file that disappears or appears during a run


@pytest.fixture
def small_blocks(monkeypatch):
    monkeypatch.setattr("sweeps.engine.estimate.block_size", lambda *_, **__: 10)


def remove():
    shutil.rmtree(PARTS)


def replace():
    shutil.copytree(PARTS, "other")
    shutil.rmtree(PARTS)
    os.replace("other", PARTS)


def remove_block():
    (PARTS / "block-000000.npz").unlink()


def truncate():
    os.truncate(PARTS / "block-000000.npz", 1000)


def empty_and_restore():
    """Like ``cp``: the size is the same, the content is not."""
    path = PARTS / "block-000000.npz"
    size = path.stat().st_size
    os.truncate(path, 0)
    os.truncate(path, size)


def move_folder():
    Path("elsewhere").mkdir()
    PARTS.rename("elsewhere/out.h5.parts")


LOSSES = {
    remove: "out.h5.parts was removed by another program",
    replace: "out.h5.parts was replaced by another program",
    remove_block: "block-000000.npz was removed by another program",
    truncate: "block-000000.npz is damaged",
    empty_and_restore: "block-000000.npz is damaged",
    move_folder: "out.h5.parts was removed by another program",
}


@pytest.mark.parametrize("at", [1, 3])
@pytest.mark.parametrize("lose", LOSSES)
def test_a_lost_block_is_a_failure_that_says_so(monkeypatch, small_blocks, lose, at):
    """Between two of four blocks, or before the last."""
    blocks = []

    def losing(self, block, results):
        if len(blocks) == at:
            lose()
        blocks.append(block)
        write(self, block, results)

    write = SweepWriter.write
    monkeypatch.setattr(SweepWriter, "write", losing)
    result = call("run", "sweep.yaml", "--quiet")
    assert result.exit_code == 1
    assert result.stderr.startswith("vibroimpact: error: the run failed: ")
    assert re.search(LOSSES[lose], result.stderr)
    assert not Path("out.h5").exists() and not list(Path().glob(".out*"))
    if lose is replace:  # the message names the kept blocks
        assert f"{10 * at} of 40 points kept in out.h5.parts; to go on: " in result.stderr


def test_a_file_that_another_program_puts_there_is_left_alone(monkeypatch):
    finish = SweepWriter.finish

    def finishing(self, *arguments, **options):
        Path("out.h5").write_bytes(b"precious")
        finish(self, *arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(SweepWriter, "finish", finishing)
        result = call("run", "sweep.yaml", "--quiet")
    assert result.exit_code == 1
    assert "out.h5 was written by another program" in result.stderr
    assert "40 of 40 points kept in out.h5.parts; to go on: " in result.stderr
    assert Path("out.h5").read_bytes() == b"precious"
    Path("out.h5").unlink()
    assert call("run", "sweep.yaml", "--quiet", "--resume").exit_code == 0
    open_sweep("out.h5").close()


def test_what_is_lost_at_the_very_end_is_said(monkeypatch):
    finish = SweepWriter.finish

    def losing(self, *arguments, **options):
        finish(self, *arguments, **options)
        Path("out.h5").unlink()

    monkeypatch.setattr(SweepWriter, "finish", losing)
    result = call("run", "sweep.yaml", "--quiet")
    assert result.exit_code == 1 and "the output is gone: out.h5 does not exist" in result.stderr


# Overwriting


@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("blocks", [2, None])
def test_a_failed_overwrite_says_that_the_old_one_is_there(monkeypatch, failure, blocks):
    fill_blocks("out.h5", blocks)
    (old,) = Path().glob("out.h5*")
    before = contents(old)

    def fail(*_, **__):
        raise failure

    for where in ("sweeps.store.parts.describe", "sweeps.engine.estimate.trial"):
        with monkeypatch.context() as patch:
            patch.setattr(where, fail)
            result = call("run", "sweep.yaml", "--quiet", "--overwrite")
        assert result.exit_code == 1
        assert f"nothing of it is kept, and the old {old} is unchanged" in result.stderr
        assert "--resume" not in result.stderr
        assert contents(old) == before


@pytest.mark.slow
def test_an_overwritten_file_stays_until_the_new_one_is_complete(monkeypatch, small_blocks, whole):
    fill_blocks("out.h5")
    compute_block, computed = executors.compute_block, []

    def stopping(*arguments, **named):
        xr.testing.assert_identical(data("out.h5"), whole)
        if computed:
            raise KeyboardInterrupt
        computed.append(1)
        return compute_block(*arguments, **named)

    with monkeypatch.context() as patch:
        patch.setattr(executors, "compute_block", stopping)
        result = call("run", "sweep.yaml", "--quiet", "--overwrite")
    assert result.exit_code == 1
    assert "10 of 40 points kept in out.h5.parts; to go on: " in result.stderr
    xr.testing.assert_identical(data("out.h5"), whole)
    assert call("run", "sweep.yaml", "--quiet", "--resume").exit_code == 0
    with open_sweep("out.h5") as dataset:
        assert dataset["status"].shape == (40,)
    assert not PARTS.exists()


@pytest.mark.slow
def test_the_commands_read_a_sweep_that_is_not_complete(stop_after):
    """And `run` uses its configuration and resumes it."""
    with stop_after(1, size=10):
        assert call("run", "sweep.yaml", "--quiet").exit_code == 1
    assert "40 points, of which 30 PENDING" in call("info", "out.h5").stdout
    for arguments in (["plot", "out.h5"], ["export", "out.h5", "-o", "out.csv"]):
        assert call(*arguments).exit_code == 0
    Path("sweep.yaml").unlink()
    assert call("run", "out.h5", "--quiet", "--resume").exit_code == 0
    assert "40 points" in call("info", "out.h5").stdout and not PARTS.exists()


# A name that changes its meaning during a run


def turn_the_link():
    Path("link.h5").unlink()
    Path("link.h5").symlink_to("other.h5")


@pytest.mark.parametrize("change", [turn_the_link, lambda: os.chdir("folder")])
def test_a_run_keeps_to_the_file_that_it_began(tmp_path, monkeypatch, change):
    """A link may be redirected to another file, and a program may change its folder."""
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
    assert not (tmp_path / "other.h5").exists() and not (tmp_path / "real.h5.parts").exists()
    with open_sweep(tmp_path / "real.h5") as dataset:
        assert not (dataset["status"] == Status.PENDING).any()
