"""Every change of a complete file is refused, and no damaged file gives wrong data.

The cases are random and aimed, on complete files, compressed or not, and on the schema and a block
of an incomplete sweep. All 5,000 of them: ``pytest -m campaign tests/sweeps/store/test_damage.py``.
"""

import faulthandler
import itertools
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

from sweeps.errors import StoreError
from sweeps.store.variables import VARIABLES
from sweeps.store.xarray_engine import open_sweep
from tests.helpers.commands import SMALL, accepted, call
from tests.helpers.sweep_files import data
from tests.helpers.written_files import GRID, fill_blocks
from vibroimpact.status import Status

CONFIG = SMALL
#: Seconds after which a case counts as hung; the process then ends with a traceback.
PATIENCE = 300


class Base:
    """An intact sweep, complete or not, and one of its files: the bytes and their layout."""

    def __init__(self, folder, blocks, name="out.h5", compressed=False):
        fill_blocks(folder / "out.h5", blocks, compressed)
        self.name, self.complete = name, name == "out.h5"
        files = [path for path in folder.rglob("*") if path.is_file()]
        self.files = {path.relative_to(folder): path.read_bytes() for path in files}
        self.content = self.files[Path(name)]
        self.data = data(folder / "out.h5")
        end = len(self.content)
        self.parts = {"head": (0, min(end, 9000)), "trailer": (end - 2000, 2000)}
        self.parts |= {"end": (end - 20, 20), "superblock": (0, 96)}
        if "block" not in name:
            at = self.content.index(GRID.axes["omega"].tobytes())
            self.parts["coordinates"] = at, 48
        if self.complete:
            with h5py.File(folder / name) as file:
                for variable in ("poincare_x", "impact_v", "period", "status"):
                    chunk = file[variable].id.get_chunk_info(0)
                    self.parts[variable] = chunk.byte_offset, chunk.size

    def restore(self):
        """Write the intact files."""
        shutil.rmtree("out.h5.parts", ignore_errors=True)
        Path("out.h5").unlink(missing_ok=True)
        for path, content in self.files.items():
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content)


@pytest.fixture(scope="module")
def bases(tmp_path_factory):
    cases = {
        "complete": (None,),
        "packed": (None, "out.h5", True),
        "empty": (0, "out.h5.parts/schema.h5"),
        "begun": (3, "out.h5.parts/block-000001.npz"),
    }
    return {name: Base(tmp_path_factory.mktemp(name), *case) for name, case in cases.items()}


# The changes: each takes a random generator, a base and its bytes, and changes the bytes.


def flip(random, base, content, span=None):
    start, size = span or (0, len(content))
    for at in random.integers(start, start + size, random.integers(1, 4)):
        content[at] ^= random.integers(1, 256)


def truncate(random, base, content):
    del content[random.integers(len(content)) :]


def lose(random, base, content):
    """Remove bytes, or insert some, also at the end."""
    at = random.integers(len(content) + 1)
    if random.integers(2):
        del content[at : at + random.integers(1, 600)]
    else:
        content[at:at] = random.bytes(random.integers(1, 600))


def move(random, base, content):
    """Copy one piece over another, as a repair of the file system may do."""
    size = int(2 ** random.uniform(3, 12))
    source, target = random.integers(0, len(content) - size, 2)
    content[target : target + size] = content[source : source + size]


def aim(random, base, content):
    name = str(random.choice(sorted(base.parts)))
    flip(random, base, content, base.parts[name])


CHANGES = [flip, truncate, lose, move, aim, aim]


def judge(base, change, seed, whole):
    """Change a file, and check that it is refused, or that the data read from it are right."""
    random = np.random.default_rng(seed)
    content = bytearray(base.content)
    for _ in range(random.integers(1, 3)):
        change(random, base, content) if len(content) >= len(base.content) else None
    base.restore()
    Path(base.name).write_bytes(content)
    same = content == base.content
    try:
        seen = data("out.h5")
    except StoreError as error:
        assert not same and "out.h5" in str(error), error
        return False
    assert same or not base.complete, "a change was not seen"
    done = (seen["status"] != Status.PENDING).values
    assert not (done & (base.data["status"] == Status.PENDING).values).any()
    for name in VARIABLES:
        width = min(seen[name].shape[-1], whole[name].shape[-1])
        cut = (done, slice(width)) if seen[name].ndim == 3 else (done,)
        np.testing.assert_array_equal(seen[name].values[cut], whole[name].values[cut])
    return True


def judge_commands(base, seen, whole):
    """Commands end with a message, and a resumed run gives the right data or is refused."""
    result = call("info", "out.h5")
    assert result.exit_code == (0 if seen else 2), result.output
    try:
        fill_blocks("out.h5", resume=True)
    except StoreError:
        assert not seen
    else:
        xr.testing.assert_equal(data("out.h5"), whole)


def judged(bases, seeds):
    """Judge a case for each seed; return how many were refused."""
    whole, refused = bases["complete"].data, 0
    pairs = itertools.cycle(itertools.product(bases.values(), CHANGES))
    for seed, (base, change) in zip(seeds, pairs, strict=False):
        faulthandler.dump_traceback_later(PATIENCE, exit=True)
        try:
            seen = judge(base, change, seed, whole)
            judge_commands(base, seen, whole)
        except Exception as error:
            raise AssertionError(f"{change.__name__}, {base.name}, seed {seed}") from error
        finally:
            faulthandler.cancel_dump_traceback_later()
        refused += not seen
    return refused


@pytest.mark.slow
def test_a_sample_of_damaged_files_is_refused_or_right(bases):
    assert judged(bases, range(1000, 1020)) > 5


@pytest.mark.campaign
@pytest.mark.parametrize("start", range(10_000, 15_000, 500))
def test_five_thousand_damaged_files_are_answered(bases, start):
    print(f"{judged(bases, range(start, start + 500))} refused")


@pytest.mark.campaign
@pytest.mark.parametrize("part", range(16))
@pytest.mark.parametrize("base", ["complete", "packed"])
def test_every_byte_of_a_complete_file_is_covered(bases, base, part):
    content = bytearray(bases[base].content)
    for at in range(part, len(content), 16):
        content[at] ^= 1 + at % 255
        Path("out.h5").write_bytes(content)
        with pytest.raises(StoreError):
            open_sweep("out.h5")
        content[at] ^= 1 + at % 255


def test_every_part_of_the_table_of_checksums_is_covered(bases):
    content = bytearray(bases["complete"].content)
    end = len(content) - 20
    table = end - int.from_bytes(content[end : end + 8], "little")
    assert content[table : table + 2] == b"[["
    for at in (*range(table, end, 11), *range(end, len(content))):
        content[at] ^= 1
        Path("out.h5").write_bytes(content)
        with pytest.raises(StoreError, match=r"damaged|not a sweep"):
            open_sweep("out.h5", verify=False)
        content[at] ^= 1


@pytest.mark.parametrize("base", ["complete", "packed"])
def test_the_damaged_variables_are_named(bases, base):
    content = bytearray(bases[base].content)
    for name in ("poincare_x", "status"):
        start, size = bases[base].parts[name]
        content[start + size // 2] ^= 1
    Path("out.h5").write_bytes(content)
    with pytest.raises(StoreError, match=r"out\.h5 is damaged: poincare_x, status; .*-o NEW\.h5"):
        open_sweep("out.h5")
    open_sweep("out.h5", verify=False).close()
    with pytest.raises(StoreError, match="is damaged: poincare_x"):
        fill_blocks("out.h5", resume=True)


def test_damage_outside_the_results_is_found_without_verifying_them(bases):
    content = bytearray(bases["complete"].content)
    content[bases["complete"].parts["coordinates"][0]] ^= 1
    Path("out.h5").write_bytes(content)
    for use in (lambda p: open_sweep(p, verify=False), lambda p: fill_blocks(p, resume=True)):
        with pytest.raises(StoreError, match=r"is damaged outside its results.*overwrite it"):
            use("out.h5")
    fill_blocks("out.h5", overwrite=True)


@pytest.mark.campaign
@pytest.mark.parametrize("part", range(16))
def test_every_byte_of_a_block_is_covered_or_means_nothing(bases, part):
    base = bases["begun"]
    base.restore()
    content = bytearray(base.content)
    for at in range(part, len(content), 16):
        content[at] ^= 1 + at % 255
        Path(base.name).write_bytes(content)
        with open_sweep("out.h5") as dataset:
            done = (dataset["status"] != Status.PENDING).values
            assert done[0, :2].all() and done[0, 4:].all()
            for name in VARIABLES:
                seen, right = dataset[name].values[done], base.data[name].values[done]
                np.testing.assert_array_equal(seen, right[..., : seen.shape[-1]])
        content[at] ^= 1 + at % 255


@pytest.mark.slow
def test_a_damaged_file_is_computed_again_from_its_own_configuration():
    accepted("run", "sweep.yaml", "--quiet")
    good, content = data("small.h5"), bytearray(Path("small.h5").read_bytes())
    with h5py.File("small.h5") as file:
        content[file["poincare_v"].id.get_chunk_info(0).byte_offset] ^= 1
    Path("small.h5").write_bytes(content)
    assert "small.h5 is damaged: poincare_v" in call("info", "small.h5").stderr
    accepted("run", "small.h5", "-o", "new.h5", "--quiet")
    xr.testing.assert_identical(data("new.h5"), good)
