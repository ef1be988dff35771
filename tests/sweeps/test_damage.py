"""Any change of any byte of a file is named, and no file, however damaged, is read as it is not.

The cases are random and aimed, on complete files, compressed or not, and on incomplete ones. All
5,000 of them: ``pytest -m campaign tests/sweeps/test_damage.py``.
"""

import faulthandler
import itertools

import h5py
import numpy as np
import pytest
import xarray as xr

from commands import call
from sweep_files import fill, random_results
from sweeps.errors import StoreError
from sweeps.grid import Grid, block_points
from sweeps.store import VARIABLES, Layout, open_sweep, sweep_writer
from sweeps.store.ledger import _SEAL, _SPAN, ROW, SUMMARY, Ledger, State, _row_check
from vibroimpact.status import Status

GRID = Grid({"R": np.array([0.5, 0.8]), "omega": np.linspace(1.0, 4.0, 6)}, {})
WIDTHS = {"section": 20, "impact": 3, "sample": 0}
#: Seconds after which a case has hung; the process then ends with a traceback.
PATIENCE = 60


def layout():
    configuration = "oscillator: {h: 0.1, R: [0.5, 0.8], omega: [1, 4]}\n"
    return Layout.of(
        GRID,
        GRID.blocks(2),
        attributes={"name": "damage", "configuration": configuration, "numerics": "1"},
        widths=WIDTHS,
        first_section=1,
        diagnostics=("period", "lyapunov"),
    )


def results(block):
    """Results that depend on the block alone, all certified."""
    arrays = random_results(block_points(block), WIDTHS, [cut.start for cut in block])
    return arrays | {"status": np.full(block_points(block), Status.CERTIFIED, np.int8)}


def contents(path):
    with open_sweep(path) as dataset:
        return dataset.load()


class Base:
    """A good file, its bytes, where what lies in them, and what a reader may see of it."""

    def __init__(self, path, blocks, compressed=False, torn=False):
        fill(path, layout(), results, blocks, compressed)
        if torn:  # a kill in the middle of the next block
            with sweep_writer(path, layout(), resume=True) as store:
                block = store.pending()[0]
                index = store._file.pending()[0]
                store._file.ledger.enter(index, State.WRITING, 1, 0)
                part = {"poincare_x": results(block)["poincare_x"].reshape(1, 2, -1)}
                store._file._put(block, part)
        self.name = path.name
        self.path = path.with_name("damaged.h5")
        self.content = path.read_bytes()
        self.data = contents(path)
        self.torn = torn
        with open(path, "rb") as file:
            ledger = Ledger.read(file.fileno())
        self.rows, self.rows_at = ledger.rows, ledger.start + SUMMARY.itemsize
        rows_end = self.rows_at + len(self.rows) * ROW.itemsize
        seal_at = self.content.rindex(b"\x89VIBRO3\n") + 8 - _SEAL.size
        self.parts = {
            "superblock": (0, 96),
            "head": (0, 9000),
            "duration": (ledger.duration, 8),
            "summary": (ledger.start, SUMMARY.itemsize),
            "rows": (self.rows_at, rows_end - self.rows_at),
            "spans": (rows_end, seal_at - rows_end),
            "seal": (seal_at, _SEAL.size),
            "coordinate": (self.content.index(GRID.axes["omega"].tobytes()), 48),
        }
        assert (seal_at - rows_end) % _SPAN.itemsize == 0
        with h5py.File(path) as file:
            for name in ("poincare_x", "impact_v", "period", "status"):
                if compressed:
                    chunk = file[name].id.get_chunk_info(0)
                    self.parts[name] = chunk.byte_offset, chunk.size
                else:
                    self.parts[name] = file[name].id.get_offset(), file[name].nbytes

    def may_change(self):
        """Return the bytes of the block that was torn: what they are says nothing."""
        if not self.torn:
            return np.zeros(len(self.content), bool)
        free = np.zeros(len(self.content), bool)
        index = int(np.flatnonzero(self.rows["state"] == State.WRITING)[0])
        block = layout().blocks[index]
        first = block[0].start * 6 + block[1].start
        with h5py.File(self.path.with_name("torn.h5")) as file:
            for name in VARIABLES:
                if name in file:
                    each = file[name].nbytes // 12
                    at = file[name].id.get_offset() + first * each
                    free[at : at + 2 * each] = True
        return free


@pytest.fixture(scope="module")
def bases(tmp_path_factory):
    folder = tmp_path_factory.mktemp("damage")
    return {
        "complete": Base(folder / "complete.h5", None),
        "packed": Base(folder / "packed.h5", None, compressed=True),
        "empty": Base(folder / "empty.h5", 0),
        "begun": Base(folder / "begun.h5", 3),
        "torn": Base(folder / "torn.h5", 3, torn=True),
    }


# The changes: each takes a random generator, a base and its bytes, and changes these.


def flip(random, base, content, span=None):
    start, size = span or (0, len(content))
    for at in random.integers(start, start + size, random.integers(1, 4)):
        content[at] ^= random.integers(1, 256)


def overwrite(random, base, content, span=None):
    start, size = span or (0, len(content))
    length = min(size, int(2 ** random.uniform(0, 12)))
    at = start + int(random.integers(0, size - length + 1))
    kind = random.integers(3)
    content[at : at + length] = (
        random.bytes(length) if kind == 0 else bytes([255 * (kind - 1)]) * length
    )


def truncate(random, base, content):
    del content[random.integers(len(content)) :]


def lengthen(random, base, content):
    content += random.bytes(int(2 ** random.uniform(0, 17)))


def lose(random, base, content):
    """Bytes are missing in the middle, or there are some more."""
    at = random.integers(len(content))
    if random.integers(2):
        del content[at : at + random.integers(1, 600)]
    else:
        content[at:at] = random.bytes(random.integers(1, 600))


def move(random, base, content):
    """A piece lies where another one was, as after a repair of the file system."""
    size = int(2 ** random.uniform(3, 12))
    source, target = random.integers(0, len(content) - size, 2)
    content[target : target + size] = content[source : source + size]


def aim(random, base, content):
    name = str(random.choice(sorted(base.parts)))
    (flip if random.integers(2) else overwrite)(random, base, content, base.parts[name])


def forge_rows(random, base, content):
    """Rows are lost, or those of other blocks, or valid ones of another state."""
    count = len(base.rows)
    chosen = random.choice(count, random.integers(1, count + 1), replace=False)
    rows, kind = base.rows.copy(), random.integers(4)
    if kind == 0:
        rows[chosen] = np.zeros((), ROW)
    elif kind == 1:
        rows[chosen] = rows[np.roll(chosen, 1)]
    else:
        rows["state"][chosen] = State.PENDING if kind == 2 else State.DONE
        rows["check"] = _row_check(rows, np.arange(count))
    content[base.rows_at : base.rows_at + rows.nbytes] = rows.tobytes()


def forge_status(random, base, content):
    """A status is none, or another one; with rows that are zero as well, and data that are not."""
    at, size = base.parts["status"]
    place = at + int(random.integers(size))
    content[place] = random.choice([0xFF, 0, 1, 2, 3, 4, 5, 77])
    if random.integers(2):
        content[base.rows_at : base.rows_at + base.rows.nbytes] = bytes(base.rows.nbytes)
    if random.integers(2):
        at, size = base.parts["poincare_x"]
        content[at : at + size] = bytes(size)


CHANGES = [flip, flip, overwrite, truncate, lengthen, lose, move, aim, aim, aim, forge_rows]
CHANGES += [forge_status]


def judge(base, change, seed):
    """Change a file, and see that it is refused, or what is seen of it is as it was."""
    random = np.random.default_rng(seed)
    content = bytearray(base.content)
    for _ in range(random.integers(1, 3)):
        change(random, base, content) if len(content) > 5000 else None
    base.path.write_bytes(content)
    same = len(content) == len(base.content)
    if same:
        changed = np.frombuffer(content, np.uint8) != np.frombuffer(base.content, np.uint8)
        same = not (changed & ~base.may_change()).any()
    try:
        seen = contents(base.path)
    except StoreError as error:
        assert not same, error
        assert "damaged.h5" in str(error)
    else:
        assert same, "a change was not seen"
        xr.testing.assert_equal(seen["status"], base.data["status"])
        known = seen.where(seen["status"] != Status.PENDING)
        xr.testing.assert_equal(known, base.data.where(base.data["status"] != Status.PENDING))
    return base.path, same


def judge_commands(path, same, whole):
    """The commands answer in words, and a resumed run ends with the right data or not at all."""
    result = call("info", str(path))
    assert result.exit_code == (0 if same else 2), result.output
    assert isinstance(result.exception, SystemExit | type(None)), result.exception
    try:
        fill(path, layout(), results, resume=True)
    except StoreError:
        assert not same
    else:
        xr.testing.assert_equal(contents(path), whole)


def judged(bases, seeds, commands):
    whole = bases["complete"].data
    pairs = itertools.cycle(itertools.product(bases.values(), CHANGES))
    counts = {True: 0, False: 0}
    for seed, (base, change) in zip(seeds, pairs, strict=False):
        faulthandler.dump_traceback_later(PATIENCE, exit=True)
        try:
            path, same = judge(base, change, seed)
            if commands:
                judge_commands(path, same, whole)
        except Exception as error:
            raise AssertionError(f"{change.__name__}, {base.name}, seed {seed}") from error
        finally:
            faulthandler.cancel_dump_traceback_later()
        counts[same] += 1
    return counts


@pytest.mark.slow
def test_a_sample_of_damaged_files_is_refused(bases):
    counts = judged(bases, range(240), commands=False)
    assert counts[False] > 200


@pytest.mark.slow
def test_a_sample_of_damaged_files_is_answered_by_the_commands(bases):
    judged(bases, range(1000, 1060), commands=True)


@pytest.mark.campaign
def test_five_thousand_damaged_files_are_answered(bases):
    counts = judged(bases, range(10_000, 15_000), commands=True)
    print(f"{counts[False]} changed and refused, {counts[True]} without a change that counts")


@pytest.mark.campaign
@pytest.mark.parametrize("base", ["complete", "packed", "begun"])
def test_every_byte_of_a_file_is_covered(bases, base):
    base = bases[base]
    for at in range(len(base.content)):
        content = bytearray(base.content)
        content[at] ^= 1 + at % 255
        base.path.write_bytes(content)
        with pytest.raises(StoreError):
            open_sweep(base.path)


# Cases that were once read as if nothing had happened


def test_a_complete_file_whose_rows_are_lost_is_no_incomplete_one(bases):
    base = bases["complete"]
    content = bytearray(base.content)
    content[base.rows_at : base.rows_at + base.rows.nbytes] = bytes(base.rows.nbytes)
    at, size = base.parts["poincare_x"]
    content[at : at + size] = bytes(size)
    base.path.write_bytes(content)
    with pytest.raises(StoreError, match=r"is damaged: block 0 .* and 3 more of 6"):
        open_sweep(base.path)


@pytest.mark.parametrize("value", [0xFF, 0x01, 77])
@pytest.mark.parametrize("name", ["complete", "empty", "begun"])
def test_one_status_that_is_another_names_its_block(bases, name, value):
    base = bases[name]
    content = bytearray(base.content)
    at, size = base.parts["status"]
    content[at + size - 1] = value
    base.path.write_bytes(content)
    if content == base.content:
        open_sweep(base.path).close()
        return
    with pytest.raises(StoreError, match=r"is damaged: block 5 .* of 6"):
        open_sweep(base.path)


def test_another_duration_is_named(bases):
    base = bases["complete"]
    content = bytearray(base.content)
    content[base.parts["duration"][0]] ^= 1
    base.path.write_bytes(content)
    with pytest.raises(StoreError, match="damaged outside its results"):
        open_sweep(base.path, verify=False)


@pytest.mark.slow
def test_damaged_blocks_of_an_incomplete_file_are_computed_again(bases):
    for name in ("empty", "begun", "torn"):
        base = bases[name]
        content = bytearray(base.content)
        at, size = base.parts["impact_v"]
        content[at + size - 1] ^= 1
        base.path.write_bytes(content)
        with pytest.raises(StoreError, match=r"is damaged: block 5 .*--resume"):
            open_sweep(base.path)
        fill(base.path, layout(), results, resume=True)
        xr.testing.assert_equal(contents(base.path), bases["complete"].data)
