"""Blocks are in the file whole or not at all, and a resumed file ends with the same data."""

import itertools

import h5py
import numpy as np
import pytest
import xarray as xr

from sweep_files import data
from sweeps.errors import StoreError
from sweeps.grid import Grid
from sweeps.store import blocks as block_file
from sweeps.store import ledger
from sweeps.store.reader import open_sweep
from sweeps.store.variables import VARIABLES
from sweeps.store.writer import sweep_writer
from vibroimpact.status import Status
from written_files import GRID, fill_blocks, layout, results


@pytest.fixture
def whole(tmp_path):
    """Return the data of a file that was written in one go."""
    fill_blocks(tmp_path / "whole.h5")
    return data(tmp_path / "whole.h5")


# Resuming


@pytest.mark.slow
@pytest.mark.parametrize("compressed", [False, True])
def test_a_resumed_file_ends_with_the_same_data(tmp_path, whole, compressed):
    path = tmp_path / "out.h5"
    for blocks in (0, 1, 2, 0, None, None):  # the last finds nothing to do
        fill_blocks(path, blocks, compressed, resume=True)
        with open_sweep(path) as dataset, xr.open_dataset(path, engine="h5netcdf") as plain:
            xr.testing.assert_identical(dataset, plain)
    xr.testing.assert_identical(data(path), whole)


@pytest.mark.slow
def test_a_file_keeps_its_own_blocks(tmp_path, whole):
    path = tmp_path / "out.h5"
    fill_blocks(path, 2)
    with sweep_writer(path, layout(block_size=5), resume=True) as store:
        assert store.pending() == list(GRID.blocks(2))[2:]


@pytest.mark.slow
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


@pytest.mark.parametrize(
    "every",
    [pytest.param(101, marks=pytest.mark.slow), pytest.param(1, marks=pytest.mark.campaign)],
)
@pytest.mark.parametrize("compressed", [False, True])
def test_wherever_a_write_is_cut_off_the_file_opens_and_resumes(
    tmp_path, monkeypatch, whole, compressed, every
):
    """Every 101st write, or every one, is the last one, and is cut in half, in turn.

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
        last, written = last + every, 0
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


@pytest.mark.slow
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
