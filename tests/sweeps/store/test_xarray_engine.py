"""The engine ``vibroimpact`` of xarray and `open_sweep`: no other file, nor one put there later."""

import os
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from xarray.backends import plugins

from sweeps import Refused, StoreError, open_sweep
from sweeps.store import complete_file
from sweeps.store.xarray_engine import SweepEngine
from tests.helpers.commands import SMALL
from tests.helpers.places import ROOT
from tests.helpers.sweep_files import run_in
from tests.helpers.written_files import fill_blocks, schema

GROUP = "xarray.backends"


@pytest.fixture(autouse=True)
def declared(monkeypatch):
    """Install what pyproject.toml declares, and nothing else, in xarray."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    points = [EntryPoint(*item, GROUP) for item in project["entry-points"][GROUP].items()]
    monkeypatch.setattr(plugins, "entry_points", lambda group: EntryPoints(points))
    xr.backends.refresh_engines()
    yield
    xr.backends.refresh_engines()


@pytest.fixture
def alone(monkeypatch):
    """Leave xarray without its own engines for HDF5."""
    monkeypatch.setattr(plugins, "BACKEND_ENTRYPOINTS", {})
    xr.backends.refresh_engines()


@pytest.fixture
def incomplete(folder, stop_after):
    with stop_after(2, 2), pytest.raises(KeyboardInterrupt):
        run_in(folder, SMALL, name="part.h5")
    return "part.h5"


def test_a_complete_sweep(small_file):
    with (
        open_sweep("small.h5") as ours,
        xr.open_dataset("small.h5", engine="vibroimpact") as named,
        xr.open_dataset(Path("small.h5")) as guessed,
    ):
        assert not named["poincare_x"].variable._in_memory
        assert named.identical(ours) and guessed.equals(ours)
        assert named.encoding["source"] == os.path.abspath("small.h5")


def test_an_incomplete_sweep(incomplete):
    with open_sweep(incomplete) as ours:
        for options in ({"engine": "vibroimpact"}, {}, {"chunks": {}}):
            with xr.open_dataset(incomplete, **options) as found:
                assert found.identical(ours) and (found["status"] == -1).sum() == 6


def test_no_engine_has_to_be_named(small_file, incomplete, alone):
    for path in ("small.h5", incomplete):
        assert plugins.guess_engine(path) == "vibroimpact"
        with xr.open_dataset(path) as found, open_sweep(path) as ours:
            assert found.identical(ours)


def test_chunks_are_those_of_the_file(small_file):
    with (
        h5py.File("small.h5") as file,
        open_sweep("small.h5") as ours,
        xr.open_dataset("small.h5", engine="vibroimpact", chunks={}) as found,
    ):
        chunks = {name: file[name].chunks for name in found.data_vars}
        for name, variable in found.data_vars.items():
            assert tuple(one[0] for one in variable.chunks) == chunks[name]
        assert found["poincare_x"].mean().compute() == pytest.approx(ours["poincare_x"].mean())
        assert found.identical(ours)


def test_variables_are_dropped(small_file):
    with xr.open_dataset("small.h5", engine="vibroimpact", drop_variables=["status", "a"]) as found:
        assert "status" not in found and "a" not in found.coords and "omega" in found


def test_what_is_no_sweep_is_refused():
    with pytest.raises(StoreError, match=r"missing\.h5 does not exist"):
        xr.open_dataset("missing.h5", engine="vibroimpact")
    with pytest.raises(Refused, match=r"filename_or_obj = .*expected: the path of a file"):
        xr.open_dataset(b"small.h5", engine="vibroimpact")


def test_no_other_file_is_taken(small_file, folder):
    with open_sweep("small.h5") as data:
        data.to_netcdf("derived.nc", engine="h5netcdf")  # with the attributes of a sweep
    shutil.copy("derived.nc", "derived.h5")
    Path("cut.h5").write_bytes(Path("small.h5").read_bytes()[:-1])
    old = Path("small.h5").read_bytes()[:-2] + b"4\n"
    Path("old.h5").write_bytes(old)
    Path("empty.h5").touch()
    Path("short.h5").write_bytes(b"\x89")
    with h5py.File("plain.h5", "w") as file:
        file["a"] = np.ones(3)
    if hasattr(os, "mkfifo"):
        os.mkfifo("fifo.h5")  # to read it would block
    engine = SweepEngine()
    others = [path for path in folder.iterdir() if path.name != "small.h5"]
    assert len(others) >= 7
    for path in [*others, folder, "http://localhost/a.h5", "a\0.h5", 3, b"a.h5", "x" * 5000]:
        assert engine.guess_can_open(path) is False
    assert engine.guess_can_open("small.h5") and engine.guess_can_open(Path("small.h5"))
    with xr.open_dataset("derived.nc") as found:
        assert found.sizes["omega"] == 5


def test_other_files_import_little(small_file):
    """The engine is asked about every file that a user of xarray opens."""
    code = (
        "import sys, xarray\n"
        "from sweeps.store.xarray_engine import SweepEngine\n"
        "assert not SweepEngine().guess_can_open('sweep.nc')\n"
        "assert SweepEngine().guess_can_open('small.h5')\n"
        "heavy = {'numba', 'h5py', 'pydantic', 'scipy', 'matplotlib', 'yaml', 'typer', 'rich'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout == "[]\n"


def test_a_sweep_that_is_begun_anew_meanwhile_has_no_blocks_under_the_old_schema(
    folder, stop_after, monkeypatch
):
    """The reader has read the schema of one sweep when the blocks become those of another."""
    for name, R in (("part.h5", "0.8"), ("other.h5", "0.3")):
        with stop_after(2, 2), pytest.raises(KeyboardInterrupt):
            run_in(folder, SMALL, f"oscillator.R={R}", name=name)
    with open_sweep("part.h5") as before, open_sweep("other.h5") as after:
        sweeps = {data["R"].item(): data.load() for data in (before, after)}

    def replaced(file):
        found = schema_in(file)
        if Path("other.h5.parts").exists():
            shutil.rmtree("part.h5.parts")
            Path("other.h5.parts").rename("part.h5.parts")
        return found

    schema_in = complete_file.schema_in
    monkeypatch.setattr(complete_file, "schema_in", replaced)
    with open_sweep("part.h5") as data:
        computed, expected = data["status"] != -1, sweeps[data["R"].item()]["poincare_x"]
        assert bool((data["poincare_x"] == expected).where(computed, True).all())


def test_an_opened_file_that_was_replaced_is_not_read_as_if_it_were_the_old_one():
    """xarray closes files when many are open, and opens them again by their names."""
    fill_blocks("out.h5")
    fill_blocks("other.h5")
    with xr.set_options(file_cache_maxsize=1), open_sweep("out.h5") as dataset:
        fill_blocks("out.h5", overwrite=True, plan=schema(block_size=3, numerics="2"))
        open_sweep("other.h5").close()
        with pytest.raises(StoreError, match=r"out\.h5 was replaced by another program; open"):
            dataset["poincare_x"].load()
        Path("out.h5").unlink()
        with pytest.raises(StoreError, match=r"out\.h5 was removed by another program"):
            dataset["poincare_x"].load()
        os.mkfifo("out.h5")
        with pytest.raises(StoreError, match=r"out\.h5 is a FIFO, not a regular file"):
            dataset["poincare_x"].load()
        Path("out.h5").unlink()
    for then, event in (
        ({"overwrite": True, "blocks": 2}, "replaced"),
        ({"resume": True}, "removed"),
    ):
        fill_blocks("out.h5", 2, resume=True)
        with open_sweep("out.h5") as dataset:
            fill_blocks("out.h5", **then)
            said = rf"block-000000\.npz was {event} by another program, or its sweep was completed"
            with pytest.raises(StoreError, match=said):
                dataset["poincare_x"].load()


def test_a_sweep_that_is_replaced_while_it_is_opened_is_not_opened(monkeypatch):
    """Its data would not have been compared with their checksums."""
    fill_blocks("out.h5")
    fill_blocks("other.h5", plan=schema(numerics="2"))
    checked = complete_file.check_file

    def checking(path, **options):
        digest = checked(path, **options)
        os.replace("other.h5", "out.h5")
        return digest

    monkeypatch.setattr(complete_file, "check_file", checking)
    with pytest.raises(StoreError, match="was replaced by another program"):
        open_sweep("out.h5")
