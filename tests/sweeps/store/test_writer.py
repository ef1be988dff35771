"""A sweep survives kills, and a resumed run ends with the same data."""

import errno
import io
import os
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

from sweeps import open_sweep
from sweeps.errors import Failed, StoreError
from sweeps.grid import Grid
from sweeps.store import complete_file, parts
from sweeps.store.replacing import draft_of
from tests.helpers.sweep_files import data
from tests.helpers.written_files import GRID, begun, block_results, contents, fill_blocks, schema
from vibroimpact.status import Status

PARTS = Path("out.h5.parts")


def done_of(path, whole):
    """Return the number of computed points of an incomplete sweep; check their values."""
    with open_sweep(path) as dataset:
        done = dataset["status"].values != Status.PENDING
        for name in ("poincare_x", "chatters", "lyapunov", "impact_v"):
            np.testing.assert_array_equal(dataset[name].values[done], whole[name].values[done])
    return int(done.sum())


def resumed(whole, **options):
    """Resume to the end, and compare the data."""
    fill_blocks("out.h5", resume=True, **options)
    xr.testing.assert_identical(data("out.h5"), whole)
    assert os.listdir() == ["out.h5"]


def test_an_incomplete_sweep_keeps_its_own_blocks():
    fill_blocks("out.h5", 2)
    with begun("out.h5", schema(block_size=5), resume=True) as (_, pending):
        assert pending == list(GRID.blocks(2))[2:]


@pytest.mark.slow
def test_the_duration_is_that_of_all_sessions(monkeypatch):
    now = 0.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    for session, blocks in enumerate((1, 1, None), 1):
        with begun("out.h5", schema(), resume=True) as (store, pending):
            now += 1000.0
            for block in pending[:blocks]:
                store.write(block, block_results(block))
            if blocks is None:
                store.finish()
        with open_sweep("out.h5") as dataset:
            assert dataset.attrs["duration"] == 1000.0 * session


CHANGES = ["oscillator.h was 0.1 and is 0.2", "oscillator.omega.num was not given and is 6"]
CHANGES += ["record.impacts was not given and is 3"]


@pytest.mark.parametrize(
    ("changed", "parts"),
    [
        ({"configuration": "oscillator: {h: 0.2, omega: {num: 6}}\nrecord: {impacts: 3}"}, CHANGES),
        ({"numerics": "2"}, ["the code that computes is another version"]),
        ({"grid": Grid(dict(reversed(GRID.axes.items())), GRID.fixed)}, ["values or another or"]),
    ],
)
@pytest.mark.parametrize("blocks", [2, None])
def test_another_sweep_is_not_resumed(changed, parts, blocks):
    fill_blocks("out.h5", blocks)
    name = "out.h5" if blocks is None else "out.h5.parts"
    before = contents(Path(name))
    with pytest.raises(StoreError, match=rf"^{name} cannot be resumed: ") as caught:
        with begun("out.h5", schema(**changed), resume=True):
            pass
    assert all(part in str(caught.value) for part in (*parts, "overwrite it", "--overwrite"))
    assert contents(Path(name)) == before


def test_a_computation_that_other_code_writes_differently_is_not_listed():
    plan = schema()
    plan.attributes["computation"] = "start: 1.5\nh: 0.1\n"
    fill_blocks("out.h5", 2, plan=plan)
    now = schema(numerics="2")
    now.attributes["computation"] = "fixed: {h: 0.1, phase: 1.5}\n"
    only = "cannot be resumed: the code that computes is another version; overwrite it"
    with pytest.raises(StoreError, match=only):
        with begun("out.h5", now, resume=True):
            pass


def test_another_name_or_compression_is_no_other_sweep():
    with begun("out.h5", schema(configuration="name: a\nh: 1\n")):
        pass
    other = "h: 1\nname: b\ncompression: gzip\n"
    with begun("out.h5", schema(configuration=other), resume=True):
        pass


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize(("call", "good"), [("write", 0), ("write", 9), ("truncate", 0)])
def test_an_error_of_a_call_of_hdf5_is_one_failure(monkeypatch, whole, call, good, compressed):
    """In the schema of a new sweep, and in the last pass; HDF5 alone would end the process."""
    done = []

    def fail(self, *given):
        done.append(given)
        if len(done) > good:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return getattr(io.FileIO, call)(self, *given)

    failing = type("Failing", (io.FileIO,), {call: fail})
    fill_blocks("out.h5", 5)
    with monkeypatch.context() as patch:
        patch.setattr(complete_file, "_Draft", type("Draft", (complete_file._Draft, failing), {}))
        for name, action in (("new.h5", "created"), ("out.h5", "completed")):
            done.clear()
            with pytest.raises(Failed, match=rf"{name} cannot be {action}: No space"):
                fill_blocks(name, resume=True, compressed=compressed)
    assert os.listdir() == ["out.h5.parts"]
    resumed(whole, compressed=compressed)


def test_the_last_pass_ends_when_the_disk_is_full(monkeypatch):
    begun = []

    def fill_disk():
        begun.append("a piece")
        monkeypatch.setattr(complete_file._Draft, "error", OSError("No space left"))

    monkeypatch.setattr(complete_file, "check", fill_disk)
    with pytest.raises(Failed, match="No space left"):
        fill_blocks("out.h5")
    assert begun == ["a piece"]


def test_a_sweep_that_is_completed_while_it_is_opened_is_read_from_its_file(monkeypatch, whole):
    """Wherever the reader is when the file gets its name and the blocks go."""
    folder = Path.cwd()
    for owner, name in ((os, "listdir"), (Path, "read_bytes"), (parts, "Parts")):
        fill_blocks("out.h5", 2)
        read = getattr(owner, name)

        def complete(*arguments, read=read, after=owner is parts, **options):
            found = [read(*arguments, **options)] if after else []
            monkeypatch.undo()
            monkeypatch.chdir(folder)
            fill_blocks("out.h5", resume=True)
            return found[0] if found else read(*arguments, **options)

        monkeypatch.setattr(owner, name, complete)
        xr.testing.assert_identical(data("out.h5"), whole)
        Path("out.h5").unlink()


@pytest.mark.parametrize("options", [{"resume": True}, {"overwrite": True}])
def test_a_folder_with_the_name_of_a_block_is_refused_and_of_a_draft_left(whole, options):
    fill_blocks("out.h5", 2)
    (PARTS / "block-000001.npz").rename("block")
    (PARTS / "block-000001.npz").mkdir()
    before = sorted(os.listdir(PARTS))
    with pytest.raises(StoreError, match=r"block-000001\.npz is a directory in the place of a b"):
        fill_blocks("out.h5", **options)
    assert sorted(os.listdir(PARTS)) == before
    (PARTS / "block-000001.npz").rmdir()
    draft = PARTS / ".block-000003.npz.1-01234567.new"
    draft.mkdir()
    fill_blocks("out.h5", **options)
    xr.testing.assert_identical(data("out.h5"), whole)
    assert draft.is_dir()


def last_block():
    return max(PARTS.glob("block-*.npz"))


@pytest.mark.slow
def test_a_block_of_another_sweep_or_of_another_number_is_not_used(whole):
    fill_blocks("out.h5", 2)
    with begun("other.h5", schema(numerics="2")) as (store, pending):
        for block in pending[:1]:
            store.write(block, block_results(block))
    blocks = sorted(PARTS.iterdir())[:2]
    shutil.copy(Path("other.h5.parts") / blocks[0].name, blocks[0])
    shutil.copy(blocks[1], PARTS / "block-000004.npz")
    assert done_of("out.h5", whole) == 2
    shutil.rmtree("other.h5.parts")
    assert fill_blocks("out.h5", resume=True) == 2
    xr.testing.assert_identical(data("out.h5"), whole)


@pytest.mark.parametrize(
    ("blocks", "piece", "compressed"),
    [(2, 1000, False), (None, 0, True), (None, 1000, False), (None, 1 << 26, False)],
)
def test_trajectories_have_lengths_of_their_own(monkeypatch, blocks, piece, compressed):
    """In a block and in the complete file, whatever part of a block is in memory at a time."""
    monkeypatch.setattr("sweeps.store.parts._PIECE", piece)
    given, random = {}, np.random.default_rng(1)

    def ragged(block):
        results = block_results(block)
        lengths = random.integers(0, 40, len(results["status"]))
        for name in ("trajectory_t", "trajectory_x", "trajectory_v"):
            results[name] = np.empty(len(lengths), object)
            results[name][:] = [random.normal(size=length) for length in lengths]
            given[name, block[0].start, block[1].start] = results[name]
        return results

    fill_blocks("out.h5", blocks, compressed, plan=schema(block_size=3), results=ragged)
    with open_sweep("out.h5") as dataset:
        assert dataset.sizes["sample"] == max(len(row) for rows in given.values() for row in rows)
        for (name, row, column), rows in given.items():
            for at, samples in enumerate(rows, column):
                found = dataset[name].values[row, at]
                np.testing.assert_array_equal(found[: len(samples)], samples)
                assert np.isnan(found[len(samples) :]).all()
    if blocks:
        with np.load(last_block()) as file:
            rows = given["trajectory_x", 0, 3]
            np.testing.assert_array_equal(file["trajectory_x"], np.concatenate(list(rows)))
            assert file["samples"].tolist() == [len(samples) for samples in rows]


@pytest.mark.slow
def test_what_killed_runs_left_in_the_folder_is_removed(whole):
    fill_blocks("out.h5", 2)
    for path in (Path("out.h5"), PARTS / "schema.h5", PARTS / "block-000003.npz"):
        draft_of(path).write_bytes(b"half of a file")
    fill_blocks("out.h5", 1, resume=True)
    assert os.listdir() == ["out.h5.parts"] and not [*PARTS.glob(".*")]
    resumed(whole)
    # A run that was killed while it removed its folder, before some of the blocks.
    for resume in (True, False):
        fill_blocks("other.h5", 2)
        os.replace("other.h5.parts/schema.h5", "other.h5.parts/.schema.h5.1-01234567.new")
        os.replace("other.h5.parts", PARTS)
        fill_blocks("out.h5", resume=resume, overwrite=not resume)
        assert not PARTS.exists()


def test_the_schema_of_an_incomplete_sweep_has_no_duration(folder):
    """So that a copy of it alone is no sweep."""
    with begun("out.h5", schema()) as (store, pending):
        store.write(pending[0], block_results(pending[0]))
    with h5py.File(PARTS / "schema.h5") as file:
        assert "duration" not in file.attrs and "started" in file.attrs
