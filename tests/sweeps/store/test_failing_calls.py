"""A system call that fails once, as on a disk of the network, costs no finished block.

Only the error that says so means that a file is missing; any other refuses or ends the run.
"""

import errno
import io
import os
import re
import shutil
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from sweeps.errors import StoreError, SweepError
from sweeps.reports import kept_text
from sweeps.store import kept_points, open_sweep
from tests.helpers.sweep_files import data
from tests.helpers.written_files import FOUR_BLOCKS, block_results, contents, fill_blocks

PARTS = Path("out.h5.parts")


@contextmanager
def one_failing(monkeypatch, which, error):
    """Let one of the calls that concern the files of the sweep fail; yield the calls made."""
    made = []

    def failing(name, function):
        def call(path, *arguments, **options):
            if not isinstance(path, int) and "out.h5" in os.fspath(path):
                made.append((name, Path(path).name))
                if len(made) == which + 1:
                    raise OSError(error, os.strerror(error), os.fspath(path))
            return function(path, *arguments, **options)

        return call

    with monkeypatch.context() as patch:
        for module, names in ((os, "stat lstat listdir scandir open"), (io, "open")):
            for name in names.split():
                patch.setattr(module, name, failing(name, getattr(module, name)))
        yield made


@pytest.mark.slow
def test_whichever_call_fails_a_resumed_run_loses_nothing(monkeypatch):
    fill_blocks("whole.h5", plan=FOUR_BLOCKS)
    whole = data("whole.h5")
    fill_blocks("out.h5", 2, plan=FOUR_BLOCKS)
    before, which, refused, computed = contents(PARTS), 0, 0, []

    def counted(block):
        computed.append(block)
        return block_results(block)

    while True:
        with one_failing(monkeypatch, which, errno.ESTALE) as made:
            try:
                fill_blocks("out.h5", plan=FOUR_BLOCKS, results=counted, resume=True)
            except SweepError:
                refused += 1
        assert len(computed) <= 2, made[which]
        if Path("out.h5").exists():
            xr.testing.assert_identical(data("out.h5"), whole)
            Path("out.h5").unlink()
            shutil.rmtree(PARTS, ignore_errors=True)
        else:
            assert before.items() <= contents(PARTS).items(), made[which]
        if len(made) <= which:
            break
        shutil.rmtree(PARTS, ignore_errors=True)
        PARTS.mkdir()
        for name, content in before.items():
            (PARTS / name).write_bytes(content)
        computed.clear()
        which += 1
    assert refused > 10


@pytest.mark.slow
@pytest.mark.parametrize("blocks", [2, None])
def test_whichever_call_fails_a_reader_sees_all_that_is_there_or_is_refused(monkeypatch, blocks):
    fill_blocks("out.h5", blocks, plan=FOUR_BLOCKS)
    there, which = data("out.h5"), 0
    counts = kept_points(Path("out.h5"))
    made = [None]
    while len(made) > which:
        with one_failing(monkeypatch, which, errno.EIO) as made:
            with suppress(StoreError):
                assert data("out.h5").equals(there)
            with suppress(StoreError):
                assert kept_points(Path("out.h5")) == counts
        which += 1
    assert which > 4 and {"stat", "open"} <= {name for name, _ in made}


def test_a_run_that_fails_while_its_blocks_cannot_be_read_does_not_say_that_none_is_kept(
    monkeypatch,
):
    fill_blocks("out.h5", 4)
    said = r"kept is not known, because .* cannot be read: Input/output error.*; to go on: CMD$"
    texts = []
    for which in range(12):
        with one_failing(monkeypatch, which, errno.EIO):
            texts.append(kept_text(Path("out.h5"), "CMD"))
    unknown = [bool(re.search(said, text)) for text in texts]
    assert sum(unknown) > 5
    assert set(np.compress(np.logical_not(unknown), texts)) <= {kept_text(Path("out.h5"), "CMD")}
    Path("out.h5").touch()
    shutil.rmtree(PARTS)
    assert kept_text(Path("out.h5"), "CMD") == "nothing is kept"


@pytest.mark.parametrize("complete", [False, True])
def test_a_folder_of_blocks_without_a_schema_is_kept_unless_overwritten(complete):
    """Like a copy that was cut short; also with another file of the name of the output."""
    fill_blocks("out.h5", 3)
    (PARTS / "schema.h5").unlink()
    if complete:
        fill_blocks("other.h5")
        os.replace("other.h5", "out.h5")
    before = contents(PARTS)
    for options in ({"resume": True}, {}):
        with pytest.raises(StoreError, match=r"out\.h5\.parts has blocks but no schema\.h5, like"):
            fill_blocks("out.h5", **options)
        assert contents(PARTS) == before
    fill_blocks("out.h5", overwrite=True)
    open_sweep("out.h5").close()
    assert not PARTS.exists()


def test_a_block_that_the_disk_cannot_read_any_more_is_named_and_can_be_deleted(monkeypatch):
    fill_blocks("whole.h5")
    fill_blocks("out.h5", 4)
    block, opened = PARTS / "block-000002.npz", io.open

    def failing(path, *arguments, **options):
        if str(path).endswith(block.name):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return opened(path, *arguments, **options)

    said = r"block-000002\.npz' cannot be read: Input/output error; if that stays so, delete that"
    for read in (lambda: fill_blocks("out.h5", resume=True), lambda: open_sweep("out.h5")):
        with monkeypatch.context() as patch, pytest.raises(SweepError, match=said):
            patch.setattr(io, "open", failing)
            read()
    block.unlink()
    fill_blocks("out.h5", resume=True)
    xr.testing.assert_identical(data("out.h5"), data("whole.h5"))
