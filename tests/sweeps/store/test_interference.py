"""Other programs, an old file and a change of names during a run lose nothing without a word."""

import io
import os
import re
import shutil
from contextlib import suppress
from itertools import product
from pathlib import Path

import pytest
import xarray as xr

from sweeps import load_config, open_sweep, run_sweep
from sweeps.engine import estimate, executors
from sweeps.errors import Failed, StoreError
from sweeps.store import SweepWriter, reading, sweep_writer, writer
from tests.helpers.commands import call
from tests.helpers.sweep_files import data
from tests.helpers.written_files import FOUR_BLOCKS, block_results, contents, fill_blocks, schema
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


def test_a_file_that_appears_while_the_run_is_planned_is_left_alone(monkeypatch):
    """Also the complete file of another sweep."""
    fill_blocks("other.h5")
    for content, options in ((b"precious", []), (Path("other.h5").read_bytes(), ["--overwrite"])):
        planned = estimate.trial

        def planning(*arguments, content=content, planned=planned):
            Path("out.h5").write_bytes(content)
            return planned(*arguments)

        with monkeypatch.context() as patch:
            patch.setattr(estimate, "trial", planning)
            result = call("run", "sweep.yaml", "--quiet", *options)
        assert result.exit_code == 1
        assert "out.h5 was written by another program" in result.stderr
        assert Path("out.h5").read_bytes() == content
        Path("out.h5").unlink()
        shutil.rmtree(PARTS)


def test_a_file_that_appears_while_the_complete_one_goes_to_the_disk_is_left_alone(monkeypatch):
    fsync = os.fsync

    def syncing(descriptor):
        if list(Path().glob(".out.h5.*.new")):
            Path("out.h5").write_bytes(b"precious")
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", syncing)
    with pytest.raises(Failed, match="was written by another program"):
        fill_blocks("out.h5")
    assert Path("out.h5").read_bytes() == b"precious" and len(os.listdir(PARTS)) == 7


#: Where another program puts something: the pattern of a name that is there, or a name.
PLACES = {
    "out.h5": "out.h5",
    "out.h5.lock": "out.h5.lock",
    ".out.h5.*.new": None,
    "out.h5.parts/schema.h5": None,
    "out.h5.parts/.*.new": None,
    "out.h5.parts/block-*.npz": "out.h5.parts/block-000002.npz",
}
CALLS = "stat lstat fstat listdir scandir open mkdir rmdir link rename replace unlink fsync close"


def intrude(place, link):
    """Put a dangling link or a file in a place, if it is there; return its path."""
    at = max(Path().glob(place), default=PLACES[place] and Path(PLACES[place]))
    if at is None or not at.parent.is_dir():
        return []
    os.symlink("missing", "it") if link else Path("it").write_bytes(b"precious")
    os.replace("it", at)
    return [at]


def intruded(which, late, place, link, **options):
    """Put something in a place just before or after a call of a run; return whether it was made.

    Only between the look at a file and its removal or replacement, nothing can be put there that
    stays; for a draft there is another look in between.
    """
    made, put, held = [], [], []

    def noting(name, function):
        def call(*arguments, **options):
            made.extend([name] * len(held))
            now = len(made) == which + 1 and bool(held)
            if now:
                held.clear()
            if now and not late:
                put.extend(intrude(place, link))
            try:
                return function(*arguments, **options)
            finally:
                if now and late:
                    put.extend(intrude(place, link))
                held.extend([1] * now)

        return call

    def checked(*arguments, by=writer.check_parts):
        held.append(1)  # what was there before is the old sweep
        by(*arguments)

    with pytest.MonkeyPatch.context() as patch, suppress(StoreError, Failed):
        patch.setattr(writer, "check_parts", checked)
        for module, names in ((os, CALLS), (io, "open")):
            for name in names.split():
                patch.setattr(module, name, noting(name, getattr(module, name)))
        fill_blocks("out.h5", plan=FOUR_BLOCKS, **options)
    about = which, late, place, link, options, made[which : which + 2]
    soon = made[which + late : which + late + 1 + place.endswith(".new")]
    if not {"unlink", "replace"}.intersection(soon):
        for at in put:
            there = os.readlink(at) if link else at.read_bytes().decode()
            assert there == ("missing" if link else "precious"), about
        if Path("out.h5").exists() and put != [Path("out.h5")]:
            assert data("out.h5").sizes["omega"] == 6, about
    assert not Path("missing").exists(), about
    return len(made) > which


@pytest.mark.slow
@pytest.mark.parametrize(
    "step", [199, pytest.param(1, marks=pytest.mark.campaign)], ids=["some", "many"]
)
@pytest.mark.parametrize("old", [None, 2, 4])
def test_what_another_program_puts_there_at_any_call_stays_and_is_no_result(tmp_path, step, old):
    """In the place of the output, the lock, a draft, the schema or a block, old or new."""
    (tmp_path / "old").mkdir()
    if old is not None:
        fill_blocks("old/out.h5", old, plan=FOUR_BLOCKS)
    number = 0
    for options in ({}, {"resume": True}, {"overwrite": True}):
        for place, (late, link) in product(PLACES, ((False, True), (True, False))):
            which = number = (number + 7) % step
            while True:
                folder = tmp_path / "new"
                shutil.copytree("old", folder)
                with pytest.MonkeyPatch.context() as patch:
                    patch.chdir(folder)
                    went_on = intruded(which, late, place, link, **options)
                shutil.rmtree(folder)
                which += step
                if not went_on:
                    break


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_the_folder_of_the_blocks_is_taken_before_the_run_is_planned(monkeypatch):
    """In a shared folder, nobody else can then make it, and change the blocks in it."""
    mkdir, planned, write, folders = Path.mkdir, estimate.trial, SweepWriter.write, []

    def planning(*arguments):
        assert PARTS.stat().st_uid == os.geteuid() and not os.listdir(PARTS)
        folders.append(PARTS.stat().st_ino)
        Path("to have another number").touch()
        return planned(*arguments)

    def writing(*arguments):
        folders.append(PARTS.stat().st_ino)
        write(*arguments)

    def late(path, **options):
        if path.name == PARTS.name:
            os.mkdir(path)
            os.chown(path, 65534, 65534)
        mkdir(path, **options)

    monkeypatch.setattr(SweepWriter, "write", writing)
    monkeypatch.setattr(estimate, "trial", planning)
    monkeypatch.setattr(Path, "mkdir", late)
    result = call("run", "sweep.yaml", "--quiet")
    assert result.exit_code == 2 and "out.h5.parts belongs to another user" in result.stderr
    PARTS.rmdir()
    monkeypatch.setattr(Path, "mkdir", mkdir)
    assert call("run", "sweep.yaml", "--quiet").exit_code == 0
    assert not PARTS.exists() and len(set(folders)) == 1 < len(folders)


def test_a_run_that_is_refused_leaves_no_folder(monkeypatch):
    def refuse(*_):
        raise StoreError("too large")

    monkeypatch.setattr(estimate, "trial", refuse)
    assert call("run", "sweep.yaml", "--quiet").exit_code == 2
    assert os.listdir() == ["sweep.yaml"]


def test_an_opened_file_that_was_replaced_is_not_read_as_if_it_were_the_old_one():
    """xarray closes files when many are open, and opens them again by their names."""
    fill_blocks("out.h5")
    fill_blocks("other.h5")
    with xr.set_options(file_cache_maxsize=1), open_sweep("out.h5") as dataset:
        fill_blocks("out.h5", overwrite=True, plan=schema(block_size=3, numerics="2"))
        open_sweep("other.h5").close()
        with pytest.raises(StoreError, match=r"out\.h5 was replaced by another program; open"):
            dataset["poincare_x"].load()
        Path("out.h5").unlink()
        with pytest.raises(StoreError, match=r"out\.h5 was removed by another program"):
            dataset["poincare_x"].load()


def test_a_sweep_that_is_replaced_while_it_is_opened_is_not_opened(monkeypatch):
    """Its data would not have been compared with their checksums."""
    fill_blocks("out.h5")
    fill_blocks("other.h5", plan=schema(numerics="2"))
    checked = reading.check_file

    def checking(path, **options):
        digest = checked(path, **options)
        os.replace("other.h5", "out.h5")
        return digest

    monkeypatch.setattr(reading, "check_file", checking)
    with pytest.raises(StoreError, match="was replaced by another program"):
        open_sweep("out.h5")


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

    for where in ("sweeps.store.complete_file.write_schema", "sweeps.engine.estimate.trial"):
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


def test_an_empty_folder_of_blocks_that_is_removed_is_made_again(folder):
    """Another program may tidy it up while the run is planned."""
    with sweep_writer(Path("out.h5"), overwrite=True) as store:
        PARTS.rmdir()
        for block in store.begin(schema()):
            store.write(block, block_results(block))
        store.finish()
    assert open_sweep("out.h5")["status"].size == 12
