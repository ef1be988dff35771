"""Files with right checksums and another form are refused in one paragraph, with no traceback."""

import io
import os
import shutil
import struct
import zipfile
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from sweeps import open_sweep
from sweeps.errors import StoreError, SweepError
from sweeps.store import parts
from sweeps.store import schema as schema_file
from sweeps.store.complete_file import _add_table
from sweeps.store.replacing import TRAILER
from sweeps.store.variables import VARIABLES
from tests.helpers.commands import SMALL, accepted, refused
from tests.helpers.written_files import begun, block_results, fill_blocks, schema
from vibroimpact.status import Status

CONFIG = SMALL
SCHEMA, BLOCK = Path("out.h5.parts/schema.h5"), Path("out.h5.parts/block-000001.npz")


def with_table(path, table):
    """Give a file another table of checksums, whose own checksum is right."""
    content = path.read_bytes()
    length = int.from_bytes(content[-20:-12], "little")
    end = struct.pack("<QI8s", len(table), zlib.crc32(table), TRAILER)
    path.write_bytes(content[: -20 - length] + table + end)
    return len(content) - 20 - length


TABLES = {
    "nested": b"[" * 100_000 + b"]" * 100_000,
    "numbers": b"[1, 2]",
    "mapping": b'{"a": 1}',
    "floats": b'[["rest", 0.0, SIZE.0, 1]]',
    "short rows": b'[["rest", 0]]',
    "number": b"7",
    "text": b"\xff\xfe",
    "digits": b"[" + b"9" * 10_000 + b"]",
    "overlapping": b'[["rest", 0, 40, 1], ["rest", 20, SIZE, 1], ["rest", 20, -40, 1]]',
    "odd types": b'[["rest", "0", [], {}]]',
    "infinite": b'[["rest", 0, Infinity, 1]]',
    "no name": b"[[null, 0, SIZE, 1]]",
}


@pytest.mark.parametrize("table", TABLES)
def test_a_table_of_another_form_is_refused(finished_file, table):
    shutil.copy(finished_file, "out.h5")
    size = with_table(Path("out.h5"), b"[]")
    with_table(Path("out.h5"), TABLES[table].replace(b"SIZE", b"%d" % size))
    for verify in (True, False):
        with pytest.raises(StoreError, match="is damaged outside its results, truncated"):
            open_sweep("out.h5", verify=verify)


def in_place_of_h(make):
    """Return a change of a file that makes something else of the name h."""

    def change(file):
        del file["h"]
        make(file)

    return change


def virtual(file):
    layout = h5py.VirtualLayout((1,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "h", (1,))
    file.create_virtual_dataset("h", layout)


OUTSIDE = {"dtype": "f8", "external": [("other.h5", 0, 8)]}
IN_PLACE = {
    "group": lambda file: file.create_group("h"),
    "outside": lambda file: file.update({"h": h5py.ExternalLink("other.h5", "h")}),
    "soft": lambda file: file.update({"h": h5py.SoftLink("/f")}),
    "stored outside": lambda file: file.create_dataset("h", (1,), **OUTSIDE),
    "virtual": virtual,
    "large": lambda file: file.create_dataset("h", (1 << 50,), "f8", chunks=(1,)),
}


def without_scales(file):
    del file["status"]
    file["status"] = np.zeros((2, 6), np.int8)


def another_shape(file):
    del file["poincare_x"]
    file["poincare_x"] = np.zeros((2, 6, 3))


def typed(name, dtype):
    def change(file):
        dims = [dim[0] for dim in file[name].dims]
        shape = file[name].shape
        del file[name]
        file[name] = np.zeros(shape, dtype)
        for dim, scale in zip(file[name].dims, dims, strict=True):
            dim.attach_scale(scale)

    return change


def without(name):
    def change(file):
        del file[name]

    return change


def attribute(name, value):
    def change(file):
        del file.attrs[name]
        if value is not None:
            file.attrs[name] = value

    return change


def parameter(name, value):
    def change(file):
        file[name][...] = value

    return change


ALIASES = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]\n"
    for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
FORMS = {
    **{name: in_place_of_h(make) for name, make in IN_PLACE.items()},
    "without scales": without_scales, "another shape": another_shape,
    "texts": typed("chatters", "S4"),
    **{f"{name} of {dtype}": typed(name, dtype) for name, dtype in (
        ("poincare_x", "f2"), ("orbit_x", "i4"), ("period", "i1"), ("status", "?"))},
    **{f"without {name}": without(name) for name in ("poincare_x", "trajectory_t", "x_max")},
    "renamed": lambda file: file.move("omega", "frequency"),
    **{f"{name} = {value}": parameter(name, value) for name, values in {
        "omega": (np.nan, 0.0, 2.0), "h": (np.inf, -0.1), "R": (2.0,), "section": (-1,),
        "impact": (7,),
    }.items() for value in values},
    **{f"{name} {i}": attribute(name, value) for name, values in {
        "computation": ("", "!!python/name:os.system x", "[1]", "{", "fixed", ALIASES, None),
        "configuration": (7, None), "coordinates": ("a/b", None, 7, ""),
        "duration": ("long", None), "numerics": (None,),
    }.items() for i, value in enumerate(values)},
}  # fmt: skip


WHOLE = [(form, None) for form in FORMS]
PARTLY = [(form, 2) for form in [*FORMS][::5] if form[:8] != "duration"]


@pytest.mark.parametrize(("form", "blocks"), WHOLE + PARTLY)
def test_an_hdf5_file_of_another_form_is_refused(finished_file, form, blocks):
    """Complete, or for a fifth of the forms the schema of blocks; also by a run that resumes it."""
    path = SCHEMA if blocks else Path("out.h5")
    fill_blocks("out.h5", blocks) if blocks else shutil.copy(finished_file, path)
    shutil.copy(path, "other.h5")
    with_table(Path("other.h5"), b"[]")
    changed(path, FORMS[form])
    said = r"(does not have the form of a sweep|cannot be resumed)"
    with pytest.raises(StoreError, match=said):
        open_sweep("out.h5")
    if form[:8] != "duration":  # of which a run that resumes has no need
        with pytest.raises(SweepError, match=r"^.*$"):
            fill_blocks("out.h5", resume=True)


def changed(path, change):
    """Change a complete file, and give it right checksums again."""
    with_table(path, b"[]")
    with h5py.File(path, "r+") as file:
        change(file)
        variables = [name for name in VARIABLES if name in file]
    with path.open("r+b") as file:
        _add_table(file, variables)


def test_a_motion_that_cannot_be_is_refused():
    """Instead of a traceback, or a demand for all memory."""
    wrong = {"period": (-1, 4097), "period_impacts": (-1, 1_000_001, 2**63 - 1)}
    wrong |= {"orbit_x": (np.nan,), "orbit_v": (np.inf,)}
    text = SMALL.replace("impacts: 2}", "impacts: 2, diagnostics: [period]}")
    Path("sweep.yaml").write_text(text.replace("transient: 3", "transient: 300"))
    accepted("run", "sweep.yaml", "--quiet")
    right = Path("small.h5").read_bytes()
    for name, value in ((name, value) for name, values in wrong.items() for value in values):
        Path("small.h5").write_bytes(right)
        changed(Path("small.h5"), parameter(name, value))
        for words in (["attractors"], ["plot", "-o", "a.png", "--kind", "attractors"]):
            message = refused(*words, "small.h5")
            assert "no motion of this program" in message and message.count("\n") == 1


def test_a_trajectory_beyond_its_periods_is_refused():
    """Instead of a demand for all memory: samples are drawn in every forcing period."""
    text = "oscillator: {h: 0.1, R: 0.8, omega: 2.5, f: [1.0, 2.0]}\n"
    Path("sweep.yaml").write_text(text + "record: {periods: 2, trajectory: {every: 9}}\n")
    accepted("run", "sweep.yaml", "--quiet")
    right = Path("sweep.h5").read_bytes()
    for name, value in (("omega", 1e300), ("trajectory_t", -1e300), ("trajectory_t", 1e300)):

        def change(file, name=name, value=value):
            file[name][(..., -1) if name != "omega" else ()] = value

        Path("sweep.h5").write_bytes(right)
        changed(Path("sweep.h5"), change)
        message = refused("plot", "sweep.h5", "-o", "a.png", "--kind", "trajectory")
        assert "times out of order or beyond its 2 forcing periods: run the sweep again" in message


def test_aliases_and_tags_in_the_configuration_of_a_file_are_refused(finished_file):
    """Each level of aliases would make it ten times as large."""
    for text in (ALIASES, "name: !!python/name:os.system x\n", "- 1\n", ""):
        shutil.copy(finished_file, "out.h5")
        changed(Path("out.h5"), attribute("configuration", text))
        resumed = ["run", "sweep.yaml", "-o", "out.h5", "--resume", "--quiet"]
        for words in (["info", "out.h5", "--json"], ["run", "out.h5", "-o", "new.h5"], resumed):
            assert refused(*words).count("\n") == 1
        os.remove("out.h5")


def rewritten(change, compression=zipfile.ZIP_STORED):
    """Write a block again with changed arrays."""
    with np.load(BLOCK) as file:
        arrays = dict(file)
    arrays |= change
    with zipfile.ZipFile(BLOCK, "w", compression) as file:
        for name, array in arrays.items():
            with file.open(f"{name}.npy", "w") as member:
                np.lib.format.write_array(member, array)


SAMPLES = np.array([2, 1 << 40])
BLOCKS = {
    "compressed": ({}, zipfile.ZIP_DEFLATED),
    "another shape": ({"poincare_x": np.zeros((1, 2, 3))},),
    "less precise": ({"poincare_x": np.zeros((1, 2, 20), np.float16)},),
    "another type": ({"poincare_x": np.full((1, 2, 20), "x")},),
    "few points": ({"points": np.zeros(1)},),
    "many samples": ({"samples": SAMPLES},),
    "negative samples": ({"samples": -SAMPLES},),
    "no samples": ({"samples": np.zeros((0,), int)},),
    "nothing": ({"about": np.zeros(())},),
}


def damaged_blocks(content):
    """Yield blocks of another form, cut off, and with zeros as a checksum and the size of nothing.

    Files with other damages are in ``test_damage.py``.
    """
    for name, case in BLOCKS.items():
        BLOCK.write_bytes(content)
        rewritten(*case)
        yield name, BLOCK.read_bytes()
    BLOCK.write_bytes(content)
    with np.load(BLOCK) as file:
        about = file["about"]
    about["samples"] -= 1
    rewritten({"about": about})
    yield "fewer samples", BLOCK.read_bytes()
    number = content.index(block_results((slice(0, 1), slice(2, 4)))["poincare_v"].tobytes())
    yield "another number", content[:number] + b"\0" + content[number + 1 :]
    place = int.from_bytes(content[-6:-2], "little")  # of the table of contents
    yield "before the file", content[:-6] + (place + 9).to_bytes(4, "little") + content[-2:]
    for length in np.linspace(0, len(content) - 1, 5).astype(int):
        yield length, content[:length]
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        members = file.infolist()
    for member in members:
        entry = content.rindex(member.filename.encode()) - 46
        damaged = bytearray(content)
        damaged[entry + 16 : entry + 28] = bytes(12)  # CRC-32, compressed size, size
        if damaged != content:
            yield member.filename, damaged


def test_a_block_of_another_form_or_damaged_counts_as_not_computed():
    fill_blocks("out.h5", 2)
    for name, content in damaged_blocks(BLOCK.read_bytes()):
        BLOCK.write_bytes(content)
        found = parts.Parts(BLOCK.parent)
        assert found.damaged == 1 and [*found.entries] == [0], name
    with open_sweep("out.h5") as dataset:
        done = dataset.load()["status"].values[0] != Status.PENDING
        assert done.tolist() == [True] * 2 + [False] * 4
    with begun("out.h5", schema(), resume=True) as (store, pending):
        assert store.damaged == 1 and len(pending) == 5


def test_a_table_with_a_parameter_out_of_its_range_is_refused():
    Path("table.csv").write_text("omega\n2.0\n2.5\n")
    Path("table.yaml").write_text("oscillator: {h: 0.1, R: 0.8, f: 1.0}\npoints: table.csv\n")
    accepted("run", "table.yaml", "--quiet")
    changed(Path("table.h5"), parameter("omega", [2.0, -1.0]))
    with pytest.raises(StoreError, match="does not have the form of a sweep"):
        open_sweep("table.h5")


def test_what_the_memory_has_no_room_for_is_not_damaged(monkeypatch):
    def lacking(*_):
        raise MemoryError

    fill_blocks("out.h5", 2)
    with monkeypatch.context() as patch, pytest.raises(StoreError, match="cannot be read: Mem"):
        patch.setattr(parts.zipfile.ZipFile, "read", lacking)
        open_sweep("out.h5")
    assert fill_blocks("out.h5", resume=True) == 0
    with monkeypatch.context() as patch, pytest.raises(MemoryError):
        patch.setattr(schema_file, "_values", lacking)
        open_sweep("out.h5")
