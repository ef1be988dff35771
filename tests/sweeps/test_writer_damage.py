"""Damage, a full disk, and a second writer."""

import fcntl
import os
import resource
import signal
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

import sweeps
from sweep_files import data
from sweeps.errors import Failed, StoreError
from sweeps.store.lock import only_writer
from sweeps.store.reader import open_sweep
from sweeps.store.writer import sweep_writer
from vibroimpact.status import Status
from written_files import fill_blocks, layout, results

ROOT = Path(sweeps.__file__).parents[1]


@pytest.fixture
def whole(tmp_path):
    """Return the data of a file that was written in one go."""
    fill_blocks(tmp_path / "whole.h5")
    return data(tmp_path / "whole.h5")


# Commits


class Killed(BaseException):
    """Stands for a kill: nothing is written after it."""


# Damage


@pytest.mark.slow
@pytest.mark.parametrize("compressed", [False, True])
def test_a_changed_byte_is_found_or_harmless(tmp_path, whole, compressed):
    """200 random bytes all over the file, and 100 where HDF5 keeps its own."""
    path = tmp_path / "out.h5"
    fill_blocks(path, compressed=compressed)
    good = path.read_bytes()
    random = np.random.default_rng(1)
    where = np.concatenate([random.integers(len(good), size=200), random.integers(9000, size=100)])
    found = 0
    for at in where:
        bad = bytearray(good)
        bad[at] ^= random.integers(1, 256)
        path.write_bytes(bad)
        try:
            xr.testing.assert_identical(data(path), whole)
        except StoreError as error:
            found += 1
            assert "is damaged" in str(error) or "not one that vibroimpact" in str(error)
    assert found > 200


@pytest.mark.slow
@pytest.mark.parametrize("compressed", [False, True])
def test_damaged_blocks_are_named_and_computed_again(tmp_path, whole, compressed):
    path = tmp_path / "out.h5"
    fill_blocks(path, compressed=compressed)
    with open_sweep(path) as dataset:
        value = dataset["poincare_x"].values[1, 2, 30]
    bad = bytearray(path.read_bytes())
    if compressed:
        with h5py.File(path) as file:
            chunk = file["poincare_x"].id.get_chunk_info(0)
        bad[chunk.byte_offset + chunk.size // 2] ^= 1
        named = r"block 0 \(R 0\.5 to 0\.5, omega 1 to 1\.6\), .* and 3 more of 6"
    else:
        bad[bytes(bad).index(value.tobytes())] ^= 1
        named = r"block 4 \(R 0\.8 to 0\.8, omega 2\.2 to 2\.8\) of 6"
    path.write_bytes(bad)
    with pytest.raises(StoreError, match=rf"out\.h5 is damaged: {named}; .*--resume"):
        open_sweep(path)
    open_sweep(path, verify=False).close()
    assert named.split(" ")[1] in fill_blocks(path, None, compressed, resume=True)
    xr.testing.assert_identical(data(path), whole)


@pytest.mark.slow
def test_a_file_damaged_elsewhere_is_not_resumed(tmp_path):
    path = tmp_path / "out.h5"
    fill_blocks(path, 2)
    bad = bytearray(path.read_bytes())
    bad[bytes(bad).index(np.float64(2.2).tobytes())] ^= 1  # a coordinate
    path.write_bytes(bad)
    for use in (open_sweep, lambda path: fill_blocks(path, resume=True)):
        with pytest.raises(StoreError, match=r"is damaged outside its results.* --overwrite"):
            use(path)
    fill_blocks(path, overwrite=True)


# A full disk


@contextmanager
def small_disk(size):
    """Limit the size of files, but of none that the tests themselves write."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_disk_that_is_full_before_the_start_leaves_nothing(tmp_path):
    path = tmp_path / "out.h5"
    with pytest.raises(Failed, match=r"out\.h5 cannot be created: File too large$"):
        with small_disk(12_000):
            fill_blocks(path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("compressed", [False, True])
def test_a_disk_that_is_full_at_the_end_loses_nothing(tmp_path, whole, compressed):
    path = tmp_path / "out.h5"
    with pytest.raises(Failed, match=r"out\.h5 cannot be completed: File too large$"):
        with sweep_writer(path, layout()) as store:
            for block in store.pending():
                store.write(block, results(block))
            with small_disk(12_000):
                store.finish(compressed=compressed)
    assert [file.name for file in tmp_path.iterdir() if file.suffix != ".h5"] == []
    fill_blocks(path, compressed=compressed, resume=True)
    xr.testing.assert_identical(data(path), whole)


@pytest.mark.slow
def test_a_disk_that_fills_up_loses_nothing(tmp_path, whole):
    """Only a longer trajectory, or a compressed copy, takes more room than there was."""
    path = tmp_path / "out.h5"
    with sweep_writer(path, layout()) as store:
        first, second, *_ = store.pending()
        store.write(first, results(first))
        with pytest.raises(Failed, match=r"out\.h5 cannot be written: File too large$"):
            with small_disk(path.stat().st_size):
                store.write(second, results(second, samples=10_000))
    with open_sweep(path) as dataset:
        assert int((dataset["status"] != Status.PENDING).sum()) == 2
    fill_blocks(path, resume=True)
    xr.testing.assert_identical(data(path), whole)


# One writer


def holder(path):
    """Hold the lock of `path` in another process; it prints a line when it has it."""
    code = (
        "import sys, time; from pathlib import Path; from sweeps.store.lock import only_writer\n"
        "with only_writer(Path(sys.argv[1])):\n"
        "    print('held', flush=True); time.sleep(100)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(path)],
        stdout=subprocess.PIPE,
        env={"PYTHONPATH": str(ROOT)},
    )
    assert process.stdout.readline() == b"held\n"
    return process


def test_a_second_writer_is_refused_by_number_and_a_dead_one_is_not(tmp_path):
    path = tmp_path / "out.h5"
    (tmp_path / "link.h5").symlink_to(path)
    with holder(path) as other:
        for name in (path, tmp_path / "link.h5"):
            with pytest.raises(StoreError, match=f"being written by process {other.pid};"):
                with only_writer(name):
                    pass
        other.send_signal(signal.SIGKILL)
    assert list(tmp_path.glob("*.lock"))
    with only_writer(path):
        pass
    assert not list(tmp_path.glob("*.lock"))


def test_a_lock_that_was_removed_while_it_was_waited_for_counts_for_nothing(tmp_path, monkeypatch):
    """The second opens the file of the first, which then goes, and a third comes."""
    path, flock = tmp_path / "out.h5", fcntl.flock
    first, third = ExitStack(), ExitStack()
    first.enter_context(only_writer(path))

    def slow(*arguments):
        monkeypatch.setattr(fcntl, "flock", flock)
        first.close()
        third.enter_context(only_writer(path))
        flock(*arguments)

    monkeypatch.setattr(fcntl, "flock", slow)
    with third, pytest.raises(StoreError, match=f"being written by process {os.getpid()};"):
        with only_writer(path):
            pass


@pytest.mark.slow
def test_an_overwritten_file_stays_until_the_new_one_is_there(tmp_path, monkeypatch, whole):
    path = tmp_path / "out.h5"
    fill_blocks(path)

    def kill(*_):
        raise Killed

    monkeypatch.setattr("sweeps.store.creation._seal", kill)
    with pytest.raises(Killed):
        fill_blocks(path, overwrite=True)
    xr.testing.assert_identical(data(path), whole)


@pytest.mark.slow
def test_a_reader_sees_the_finished_blocks_of_a_running_sweep(tmp_path):
    path = tmp_path / "out.h5"
    with sweep_writer(path, layout()) as store:
        for count, block in enumerate(store.pending(), 1):
            store.write(block, results(block, samples=6))
            with open_sweep(path) as dataset:
                assert int((dataset["status"] != Status.PENDING).sum()) == 2 * count
