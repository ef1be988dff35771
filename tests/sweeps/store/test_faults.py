"""Faults at moments of a run, and what holds then: nothing is lost without a word.

`FAULTS` is the table. Whatever happens, the run ends with one message, nothing is half written, an
old sweep and the files of other programs stay, and the run that goes on ends with the same bits.
`test_every_call.py` has the faults that may meet any call of the system.
"""

import builtins
import errno
import io
import os
import shutil
from collections.abc import Callable
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pytest
import xarray as xr

from sweeps import load_config, open_sweep, run_sweep
from sweeps.engine import estimate
from sweeps.errors import StoreError, SweepError
from sweeps.store import complete_file
from sweeps.store.paths import check_output
from sweeps.store.writer import SweepWriter
from tests.helpers.commands import call
from tests.helpers.sweep_files import data
from tests.helpers.written_files import (
    contents,
    fill_blocks,
    fill_disk,
    room_again,
)
from vibroimpact.status import Status

#: Forty points, which the tests compute in four blocks; any blocks give the same bits.
CONFIG = """\
oscillator: {h: 0.1, R: 0.8, omega: {start: 1.5, stop: 3.0, num: 40}, f: 1.0}
record: {transient: 3, periods: 4, impacts: 0, diagnostics: []}
output: out.h5
"""
PARTS = Path("out.h5.parts")
FIRST = PARTS / "block-000000.npz"


#: What is called at each moment of a run; whether it is now, from the number of calls made before.
MOMENTS = {
    "planned": (estimate, "trial", lambda made: True),
    "schema": (complete_file, "write_schema", lambda made: True),
    "block 2": (SweepWriter, "write", lambda made: made == 1),
    "block 4": (SweepWriter, "write", lambda made: made == 3),
    "completed": (SweepWriter, "finish", lambda made: True),
    "file": (complete_file, "write_schema", lambda made: made == 1),
    "fsync": (os, "fsync", lambda made: list(Path().glob(".out.h5.*.new"))),
    "end": (SweepWriter, "_remove", lambda made: True),
}


@contextmanager
def happening(fault, moment):
    """Let a fault happen, once, just before what is called at a moment of a run."""
    owner, name, is_now = MOMENTS[moment]
    function, made, happened = getattr(owner, name), [], []

    def disturbed(*arguments, **options):
        if not happened and is_now(len(made)):
            happened.append(None)
            fault()
        made.append(1)
        return function(*arguments, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(owner, name, disturbed)
        yield happened


def replace():
    shutil.copytree(PARTS, "other")
    shutil.rmtree(PARTS)
    os.replace("other", PARTS)


def empty_and_restore():
    """Like ``cp``: the size is the same, the content is not."""
    size = FIRST.stat().st_size
    os.truncate(FIRST, 0)
    os.truncate(FIRST, size)


def put_sweep():
    fill_blocks("other.h5")
    os.replace("other.h5", "out.h5")


def end_by(error):
    """Return a fault that raises an error."""

    def ends():
        raise error

    return ends


interrupt, fail = end_by(KeyboardInterrupt), end_by(OSError(errno.ENOSPC, "No space left"))


class Fault(NamedTuple):
    """A row: what happens when, and what the run says of it, and of the results that are kept.

    `blocks` is the number of blocks, of six, of another sweep that is overwritten.
    """

    moment: str
    happens: Callable
    said: str
    kept: str
    blocks: int = 0


NOTHING = "nothing is kept"
GONE = "out.h5.parts was removed by another program"
FOREIGN = "out.h5 was written by another program"
ONE, THREE, ALL = (f"{done} of 40 points kept" for done in (10, 30, 40))


def unchanged(file):
    return f"nothing of it is kept, and the old {file} is unchanged"


FAULTS = [
    # Another program takes away what is written.
    Fault("block 4", partial(shutil.rmtree, PARTS), GONE, NOTHING),
    Fault("block 2", lambda: PARTS.rename("../elsewhere"), GONE, NOTHING),
    Fault("block 2", replace, "was replaced by another program", ONE),
    Fault("block 2", FIRST.unlink, "block-000000.npz was removed by another program", THREE),
    Fault("block 4", partial(os.truncate, FIRST, 1000), "block-000000.npz is damaged", THREE),
    Fault("block 2", empty_and_restore, "block-000000.npz is damaged", THREE),
    Fault("end", Path("out.h5").unlink, "the output is gone: out.h5 does not exist", ""),
    # It puts something in the place of the output, also the complete file of another sweep.
    Fault("planned", put_sweep, FOREIGN, "0 of 40 points kept"),
    *(
        Fault(moment, lambda: Path("out.h5").write_bytes(b"precious"), FOREIGN, ALL)
        for moment in ("completed", "fsync")
    ),
    # The run is refused, fails or is interrupted: an old sweep stays until the new one is there.
    Fault("planned", end_by(StoreError("too large")), "too large", ""),
    Fault("planned", fail, "", unchanged("out.h5.parts"), 2),
    Fault("planned", interrupt, "", unchanged("out.h5"), 6),
    Fault("schema", fail, "", unchanged("out.h5"), 6),
    Fault("schema", interrupt, "", unchanged("out.h5.parts"), 2),
    Fault("block 2", interrupt, "", ONE, 6),
    Fault("file", fail, "", ALL, 6),
    # The disk is full.
    Fault("schema", fill_disk, "out.h5 cannot be created: File too large", NOTHING),
    Fault("file", fill_disk, "out.h5 cannot be completed: File too large", ALL),
    Fault("block 2", fill_disk, "out.h5 cannot be written: File too large", ONE),
    Fault("block 4", lambda: fill_disk(FIRST.stat().st_size - 100), "n: File too large", THREE),
]


@pytest.mark.slow
@pytest.mark.parametrize("row", FAULTS, ids=lambda row: row.moment)
def test_a_fault_is_said_and_loses_nothing_else(monkeypatch, path, row):
    monkeypatch.setattr(estimate, "block_size", lambda *_, **__: 10)
    if row.blocks:
        fill_blocks("out.h5", row.blocks)
    there, after = {path: contents(path) for path in Path().glob("out.h5*")}, []

    def disturb():
        try:
            row.happens()
        finally:
            after.extend(contents(path) for path in Path().glob("out.h5"))

    with room_again(), happening(disturb, row.moment) as happened:
        result = call("run", "sweep.yaml", "--quiet", "--overwrite")
    assert happened and result.exit_code == (2 if row.said == "too large" else 1)
    assert result.stderr.startswith("vibroimpact: error: ") and result.stderr.count("\n") == 1
    assert row.said in result.stderr and row.kept in result.stderr
    assert ("; to go on: " in result.stderr) == row.kept.endswith("points kept")
    assert not [name for name in os.listdir() if name.startswith(".") or name.endswith(".lock")]
    # What is at the output was there before, or another program put it there.
    out = [contents(path) for path in Path().glob("out.h5")]
    assert out == after and (Path("out.h5") not in there or out == [there[Path("out.h5")]])
    if row.kept.endswith("unchanged"):
        assert {path: contents(path) for path in Path().glob("out.h5*")} == there
    if row.kept.endswith("points kept"):
        if row.said == FOREIGN:
            Path("out.h5").unlink()
        assert call("run", "sweep.yaml", "--quiet", "--resume").exit_code == 0
        xr.testing.assert_identical(data("out.h5"), data(path))
        assert not PARTS.exists()


def test_a_lock_for_which_the_disk_has_no_room_is_not_left_behind():
    said = "cannot be locked for writing: File too large"
    with pytest.raises(StoreError, match=said), room_again():
        fill_disk()
        fill_blocks("out.h5")
    assert not Path("out.h5.lock").exists()


def turn_the_link():
    Path("link.h5").unlink()
    Path("link.h5").symlink_to("other.h5")


@pytest.mark.parametrize("change", [turn_the_link, lambda: os.chdir("folder")])
def test_a_run_keeps_to_the_file_that_it_began(tmp_path, monkeypatch, change):
    """A link may be redirected to another file, and a program may change its folder."""
    monkeypatch.setattr(estimate, "block_size", lambda *_, **__: 10)
    Path("folder").mkdir()
    Path("link.h5").symlink_to("real.h5")
    with happening(change, "block 2"):
        run_sweep(load_config("sweep.yaml"), "link.h5")
    assert not (tmp_path / "other.h5").exists() and not (tmp_path / "real.h5.parts").exists()
    with open_sweep(tmp_path / "real.h5") as dataset:
        assert not (dataset["status"] == Status.PENDING).any()


def test_an_empty_folder_of_blocks_that_is_removed_is_made_again():
    """Another program may tidy it up while the run is planned."""
    with happening(PARTS.rmdir, "planned"):
        assert call("run", "sweep.yaml", "--quiet").exit_code == 0
    assert open_sweep("out.h5")["status"].size == 40


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_the_folder_of_the_blocks_is_taken_before_the_run_is_planned(monkeypatch):
    """In a shared folder, nobody else can then make it, and change the blocks in it."""
    folders = []

    def note():
        assert PARTS.stat().st_uid == os.geteuid() and not list(PARTS.glob("block-*"))
        folders.append(PARTS.stat().st_ino)
        Path("to have another number").touch()

    def late(path, by=Path.mkdir, **options):
        if path.name == PARTS.name:
            os.mkdir(path)
            os.chown(path, 65534, 65534)
        by(path, **options)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "mkdir", late)
        result = call("run", "sweep.yaml", "--quiet")
    assert result.exit_code == 2 and "out.h5.parts belongs to another user" in result.stderr
    PARTS.rmdir()
    with happening(note, "planned"), happening(note, "schema"):
        assert call("run", "sweep.yaml", "--quiet").exit_code == 0
    assert not PARTS.exists() and len(set(folders)) == 1 < len(folders)


@pytest.mark.parametrize("complete", [False, True])
def test_a_folder_of_blocks_without_a_schema_is_kept_unless_overwritten(finished_file, complete):
    """Like a copy that was cut short; also with another file of the name of the output."""
    fill_blocks("out.h5", 3)
    (PARTS / "schema.h5").unlink()
    if complete:
        shutil.copy(finished_file, "out.h5")
    before = contents(PARTS)
    for options in ({"resume": True}, {}):
        with pytest.raises(StoreError, match=r"out\.h5\.parts has blocks but no schema\.h5, like"):
            fill_blocks("out.h5", **options)
        assert contents(PARTS) == before
    fill_blocks("out.h5", overwrite=True)
    open_sweep("out.h5").close()
    assert not PARTS.exists()


@pytest.mark.slow
def test_the_commands_read_a_sweep_that_is_not_complete(stop_after):
    """And `run` uses its configuration and resumes it."""
    with stop_after(1, size=10):
        assert call("run", "sweep.yaml", "--quiet").exit_code == 1
    Path("out.h5").touch()  # an empty file counts as none
    assert "40 points, of which 30 PENDING" in call("info", "out.h5").stdout
    assert call("export", "out.h5", "-o", "out.csv").exit_code == 0
    Path("sweep.yaml").unlink()
    assert call("run", "out.h5", "--quiet", "--resume").exit_code == 0
    assert "40 points" in call("info", "out.h5").stdout and not PARTS.exists()


class Unreadable(io.FileIO):
    """A file that is there, and whose first bytes the disk cannot read any more."""

    def read(self, size=-1):
        if self.tell() == 0:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return super().read(size)


@contextmanager
def failing_disk(name, at):
    """Let the disk fail when a file is opened, or when it is read."""

    def failing(path, *arguments, by=io.open, **options):
        if not str(path).endswith(name):
            return by(path, *arguments, **options)
        if at == "read":
            return Unreadable(path)
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with pytest.MonkeyPatch.context() as patch:
        for module in (io, builtins):
            patch.setattr(module, "open", failing)
        yield


@pytest.mark.parametrize("at", ["open", "read"])
def test_what_the_disk_cannot_read_any_more_is_neither_missing_nor_damaged(whole, at):
    """A block is named, and can be deleted."""
    fill_blocks("out.h5", 4)
    block = PARTS / "block-000002.npz"
    said = r"block-000002\.npz' cannot be read: Input/output error; if that stays so, delete that"
    for read in (lambda: fill_blocks("out.h5", resume=True), lambda: open_sweep("out.h5")):
        with failing_disk(block.name, at), pytest.raises(SweepError, match=said):
            read()
    block.unlink()
    fill_blocks("out.h5", resume=True)
    xr.testing.assert_identical(data("out.h5"), whole)
    for use in (open_sweep, check_output):
        with (
            failing_disk("out.h5", at),
            pytest.raises(StoreError, match=r"out\.h5' cannot be read"),
        ):
            use("out.h5")


def test_a_block_that_another_program_puts_there_is_neither_used_nor_removed(monkeypatch):
    """Not by a run that goes on, nor by one that is complete."""
    monkeypatch.setattr(estimate, "block_size", lambda *_, **__: 10)
    with happening(interrupt, "block 4"):
        call("run", "sweep.yaml", "--quiet")

    def put_copy():
        shutil.copy(FIRST, "copy")
        os.replace("copy", FIRST)

    command = "run", "sweep.yaml", "--quiet", "--resume"
    with happening(put_copy, "planned"):
        said = call(*command).stderr
    assert "block-000000.npz was written by another program, and is not used" in said
    with happening(lambda: FIRST.write_bytes(b"precious"), "end"):
        assert call(*command).exit_code == 0
    assert [path.read_bytes() for path in PARTS.iterdir()] == [b"precious"]
