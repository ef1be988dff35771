"""Blocks are in the file whole or not at all, through a kill, a full disk and a second writer."""

import fcntl
import itertools
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
from sweep_files import data, fill, random_results
from sweeps.errors import Failed, StoreError
from sweeps.grid import Grid, block_points
from sweeps.store import blocks as block_file
from sweeps.store import ledger
from sweeps.store.layout import Layout
from sweeps.store.lock import only_writer
from sweeps.store.reader import open_sweep
from sweeps.store.variables import VARIABLES
from sweeps.store.writer import sweep_writer
from vibroimpact.status import Status

ROOT = Path(sweeps.__file__).parents[1]
GRID = Grid({"R": np.array([0.5, 0.8]), "omega": np.linspace(1.0, 4.0, 6)}, {})
WIDTHS = {"section": 50, "impact": 3, "sample": 6}


def layout(configuration="oscillator: {h: 0.1}\n", numerics="1", grid=GRID, block_size=2):
    return Layout.of(
        grid,
        grid.blocks(block_size),
        attributes={"name": "a test", "configuration": configuration, "numerics": numerics},
        widths=WIDTHS,
        first_section=1,
        diagnostics=("period", "lyapunov"),
    )


def results(block, samples=None):
    """Results that depend on the block alone; its trajectories too have their own length."""
    seed = [cut.start for cut in block]
    samples = 4 + 3 * sum(seed) if samples is None else samples
    return random_results(block_points(block), {**WIDTHS, "sample": samples}, seed)


def fill_blocks(path, blocks=None, compressed=False, **options):
    """Write that many of the pending blocks; finish the file where it is complete."""
    return fill(path, layout(), results, blocks, compressed, **options)


@pytest.fixture
def whole(tmp_path):
    """Return the data of a file that was written in one go."""
    fill_blocks(tmp_path / "whole.h5")
    return data(tmp_path / "whole.h5")


# Resuming


@pytest.mark.parametrize("compressed", [False, True])
def test_a_resumed_file_ends_with_the_same_data(tmp_path, whole, compressed):
    path = tmp_path / "out.h5"
    for blocks in (0, 1, 2, 0, None, None):  # the last finds nothing to do
        fill_blocks(path, blocks, compressed, resume=True)
        with open_sweep(path) as dataset, xr.open_dataset(path, engine="h5netcdf") as plain:
            xr.testing.assert_identical(dataset, plain)
    xr.testing.assert_identical(data(path), whole)


def test_a_file_keeps_its_own_blocks(tmp_path, whole):
    path = tmp_path / "out.h5"
    fill_blocks(path, 2)
    with sweep_writer(path, layout(block_size=5), resume=True) as store:
        assert store.pending() == list(GRID.blocks(2))[2:]


def test_the_duration_is_that_of_all_sessions(tmp_path, monkeypatch):
    path, now = tmp_path / "out.h5", 0.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    for session, blocks in enumerate((1, 1, None), 1):  # every one copies the file, too
        with sweep_writer(path, layout(), resume=True) as store:
            for block in store.pending()[:blocks]:
                store.write(block, results(block))
            now += 1000.0
            if not store.pending():
                store.finish()
        with open_sweep(path) as dataset:
            assert dataset.attrs["duration"] == 1000.0 * session


def test_a_complete_file_is_left_alone(tmp_path):
    path = tmp_path / "out.h5"
    fill_blocks(path)
    before = path.read_bytes()
    fill_blocks(path, resume=True)
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("changed", "parts"),
    [
        (
            {"configuration": "oscillator: {h: 0.2, omega: {num: 6}}\nrecord: {impacts: 3}"},
            ["oscillator.h was 0.1 and is 0.2", "oscillator.omega.num was not given and is 6",
             "record.impacts was not given and is 3"],
        ),
        ({"numerics": "2"}, ["the code that computes is another version"]),
        ({"grid": Grid(dict(reversed(GRID.axes.items())), {})}, ["values or another order"]),
    ],
)  # fmt: skip
def test_another_sweep_is_not_resumed(tmp_path, changed, parts):
    path = tmp_path / "out.h5"
    fill_blocks(path, 2)
    before = path.read_bytes()
    with pytest.raises(StoreError, match=r"out\.h5 cannot be resumed: ") as caught:
        with sweep_writer(path, layout(**changed), resume=True):
            pass
    for part in (*parts, "--overwrite"):
        assert part in str(caught.value)
    assert path.read_bytes() == before


def test_another_name_is_no_other_sweep(tmp_path):
    path = tmp_path / "out.h5"
    with sweep_writer(path, layout("name: a\nh: 1\n")):
        pass
    with sweep_writer(path, layout("h: 1\nname: b\n"), resume=True):
        pass


# Commits


class Killed(BaseException):
    """Stands for a kill: nothing is written after it."""


@pytest.mark.parametrize("compressed", [False, True])
def test_wherever_a_write_is_cut_off_the_file_opens_and_resumes(
    tmp_path, monkeypatch, whole, compressed
):
    """Every 37th write is the last one, and is cut in half, in turn.

    Not where it lies in one aligned piece of 32 bytes, which memory and disk take as a whole: it
    is left out instead.
    """
    path = tmp_path / "out.h5"
    written = 0
    real = ledger.write_all

    def write_all(descriptor, part, start):
        nonlocal written
        written += 1
        if written == last and start // 32 != (start + len(part) - 1) // 32:
            real(descriptor, memoryview(part)[: len(part) // 2], start)
        if written >= last:
            raise Killed
        real(descriptor, part, start)

    last = 0
    for module in ("ledger", "creation", "blocks"):
        monkeypatch.setattr(f"sweeps.store.{module}.write_all", write_all)
    ended = False
    while not ended:
        last, written = last + 37, 0
        path.unlink(missing_ok=True)
        try:
            fill_blocks(path, 2, resume=True)
            fill_blocks(path, None, compressed, resume=True)
            ended = True
        except Killed:
            pass
        written = -(10**9)
        if path.exists():
            with open_sweep(path) as dataset, xr.open_dataset(path, engine="h5netcdf") as plain:
                xr.testing.assert_identical(dataset, plain)
                done = dataset["status"].values != Status.PENDING
                for name in ("poincare_x", "chatters", "lyapunov"):
                    expected = whole[name].values[done]
                    np.testing.assert_array_equal(dataset[name].values[done], expected)
        fill_blocks(path, None, compressed, resume=True)
        xr.testing.assert_identical(data(path), whole)
        assert [file.name for file in tmp_path.iterdir() if "out" in file.name] == ["out.h5"]
    assert last > 100


def place_of(path, name):
    """Return where the bytes of a variable start."""
    with h5py.File(path) as file:
        return file[name].id.get_offset()


def test_each_part_of_a_block_is_on_the_disk_before_the_next_is_written(tmp_path, monkeypatch):
    path = tmp_path / "out.h5"
    with sweep_writer(path, layout()) as store:
        block = store.pending()[0]
        events = []
        monkeypatch.setattr(block_file, "write_all", lambda _, data, start: events.append(start))
        monkeypatch.setattr(ledger, "write_all", lambda _, data, start: events.append(data[:4]))
        monkeypatch.setattr(block_file, "sync", lambda _: events.append("sync"))
        store.write(block, results(block, samples=6))
        monkeypatch.undo()
        store._file.ledger.reread()  # nothing was written
    names = [name for name in VARIABLES if name != "status"]
    data = [place_of(path, name) for name in names]
    status = place_of(path, "status")
    assert events == [b"WRIT", "sync", *data, "sync", status, "sync", b"DONE"]


def test_a_block_that_the_power_was_lost_in_is_pending_and_not_damaged(
    tmp_path, monkeypatch, whole
):
    """Of what was written after the last sync any part may be on the disk."""
    path = tmp_path / "out.h5"
    epochs = [[]]
    with sweep_writer(path, layout()) as store:
        _, second, longer, *_ = store.pending()
        store.write(longer, results(longer))
        before = path.read_bytes()
        for module in (ledger, block_file):
            record = lambda _, part, start: epochs[-1].append((start, bytes(part)))  # noqa: E731
            monkeypatch.setattr(module, "write_all", record)
        monkeypatch.setattr(block_file, "sync", lambda _: epochs.append([]))
        store.write(second, results(second))
        monkeypatch.undo()
        store._file.ledger.reread()
    assert [len(epoch) for epoch in epochs] == [1, len(VARIABLES) - 1, 1, 1]
    states = set()
    for number, epoch in enumerate(epochs):
        for kept in [[], epoch, *([write] for write in epoch)]:
            content = bytearray(before)
            for start, part in [*itertools.chain(*epochs[:number]), *kept]:
                content[start : start + len(part)] = part
            path.write_bytes(content)
            with open_sweep(path) as dataset:
                done = dataset["status"].values != Status.PENDING
                for name in ("poincare_x", "chatters", "lyapunov"):
                    expected = whole[name].values[done]
                    np.testing.assert_array_equal(dataset[name].values[done], expected)
            states.add(int(done.sum()))
    assert states == {2, 4}
    fill_blocks(path, resume=True)
    xr.testing.assert_identical(data(path), whole)


def test_a_box_that_is_not_contiguous_is_written_to_its_places(tmp_path):
    path = tmp_path / "out.h5"
    grid = Grid({name: np.arange(n, dtype=float) for name, n in (("h", 3), ("R", 4), ("f", 5))}, {})
    plan = layout(grid=grid, block_size=60)
    boxes = [
        (slice(h, h + 3), slice(r, r + 2), slice(f, min(f + 3, 5)))
        for h in (0,) for r in (0, 2) for f in (0, 3)
    ]  # fmt: skip
    object.__setattr__(plan, "blocks", boxes)
    with sweep_writer(path, plan) as store:
        for box in boxes:
            store.write(box, results(box, samples=6))
    with open_sweep(path) as dataset:
        for box in boxes:
            for name, array in results(box, samples=6).items():
                np.testing.assert_array_equal(
                    dataset[name].values[box], array.reshape(dataset[name].values[box].shape)
                )


# Damage


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


def test_an_overwritten_file_stays_until_the_new_one_is_there(tmp_path, monkeypatch, whole):
    path = tmp_path / "out.h5"
    fill_blocks(path)

    def kill(*_):
        raise Killed

    monkeypatch.setattr("sweeps.store.creation._seal", kill)
    with pytest.raises(Killed):
        fill_blocks(path, overwrite=True)
    xr.testing.assert_identical(data(path), whole)


def test_a_reader_sees_the_finished_blocks_of_a_running_sweep(tmp_path):
    path = tmp_path / "out.h5"
    with sweep_writer(path, layout()) as store:
        for count, block in enumerate(store.pending(), 1):
            store.write(block, results(block, samples=6))
            with open_sweep(path) as dataset:
                assert int((dataset["status"] != Status.PENDING).sum()) == 2 * count
