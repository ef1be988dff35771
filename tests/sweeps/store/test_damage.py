"""Every change of a complete file is refused, and no damaged file gives wrong data.

Complete files, compressed or not, and the schema and a block of an incomplete sweep are changed at
some places; at every byte: ``pytest -m campaign tests/sweeps/store/test_damage.py``.
"""

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

from sweeps.errors import StoreError
from sweeps.store.variables import VARIABLES
from sweeps.store.xarray_engine import open_sweep
from tests.helpers.commands import SMALL, accepted, call, refused
from tests.helpers.sweep_files import data
from tests.helpers.written_files import GRID, fill_blocks
from vibroimpact.status import Status

CONFIG = SMALL


class Base:
    """An intact sweep, complete or not, and one of its files: the bytes and their layout."""

    def __init__(self, folder, blocks, name="out.h5", compressed=False):
        fill_blocks(folder / "out.h5", blocks, compressed)
        self.name, self.complete = name, name == "out.h5"
        files = [path for path in folder.rglob("*") if path.is_file()]
        self.files = {path.relative_to(folder): path.read_bytes() for path in files}
        self.content = self.files[Path(name)]
        self.data = data(folder / "out.h5")
        self.parts = {}
        if self.complete:
            self.parts["coordinates"] = self.content.index(GRID.axes["omega"].tobytes()), 48
            with h5py.File(folder / name) as file:
                for variable in ("poincare_x", "status"):
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


#: What becomes of the bytes c at a place: one is changed, the rest is lost, two are more.
CHANGES = {
    "changed": lambda c, at: c[:at] + bytes([c[at] ^ (1 + at % 255)]) + c[at + 1 :],
    "cut": lambda c, at: c[:at],
    "longer": lambda c, at: c[:at] + b"12" + c[at:],
}


def judge(base, content):
    """Put content in place of a file: it is refused, or what is read of it is right."""
    base.restore()
    Path(base.name).write_bytes(content)
    try:
        seen = data("out.h5")
    except StoreError as error:
        assert "out.h5" in str(error)
        return False
    assert not base.complete, "a change was not seen"
    done = (seen["status"] != Status.PENDING).values
    assert not (done & (base.data["status"] == Status.PENDING).values).any()
    for name in VARIABLES:
        found, right = seen[name].values[done], base.data[name].values[done]
        cut = ..., slice(found.shape[-1] if found.ndim > 1 else None)
        np.testing.assert_array_equal(found, right[cut])
    return True


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("name", ["complete", "packed", "empty", "begun"])
@pytest.mark.parametrize(
    "places",
    [pytest.param(5, marks=pytest.mark.slow), pytest.param(None, marks=pytest.mark.campaign)],
    ids=["some", "all"],
)
def test_no_change_of_a_file_gives_wrong_data(bases, places, name, change):
    """A sweep that goes on from it ends with the right data, or is refused."""
    base, whole = bases[name], bases["complete"].data
    last = len(base.content) - 1
    for at in np.linspace(0, last, places or last + 1).astype(int).tolist():
        seen = judge(base, CHANGES[change](base.content, at))
        if places and at == last // 2:
            try:
                fill_blocks("out.h5", resume=True)
            except StoreError:
                assert not seen
            else:
                xr.testing.assert_equal(data("out.h5"), whole)


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
    assert "out.h5 is damaged: poincare_x, status" in refused("info", "out.h5")
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
