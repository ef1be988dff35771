"""Paths that a sweep is not written to or read from."""

import types

import h5py
import numpy as np
import pytest

from stored_grids import GRID, WIDTHS, lay_out, layout, whole, write_blocks
from sweeps.errors import Failed, StoreError
from sweeps.grid import Grid
from sweeps.store.creation import create
from sweeps.store.layout import FORMAT_VERSION
from sweeps.store.path_checks import check_output
from sweeps.store.reader import open_sweep
from sweeps.store.writer import sweep_writer


def test_an_existing_file_is_kept_unless_told(tmp_path):
    path = tmp_path / "out.h5"
    lay_out(path)
    before = path.read_bytes()
    message = "exists; give --resume to go on with it, --overwrite to replace it, or -o"
    with pytest.raises(StoreError, match=message), sweep_writer(path, layout()):
        pass
    assert path.read_bytes() == before
    lay_out(path, widths={**WIDTHS, "section": 7})
    with open_sweep(path) as dataset:
        assert dataset.sizes["section"] == 7


def test_a_file_of_another_kind_is_never_replaced(tmp_path):
    path = tmp_path / "sweep.csv"
    path.write_bytes(b"precious")
    with pytest.raises(StoreError, match="not an HDF5 file and will not be replaced"):
        lay_out(path)
    assert path.read_bytes() == b"precious"


def test_outputs_that_are_refused(tmp_path):
    check_output(tmp_path / "new.h5")
    with pytest.raises(StoreError, match="is a directory"):
        check_output(tmp_path, overwrite=True)
    with pytest.raises(StoreError, match=r"the folder .*missing of the output new\.h5 does not"):
        check_output(tmp_path / "missing" / "new.h5", overwrite=True)
    check_output(tmp_path / f"{'x' * 247}.h5")
    with pytest.raises(StoreError, match="File name too long"):  # for that of its lock
        check_output(tmp_path / f"{'x' * 248}.h5")
    assert list(tmp_path.iterdir()) == []
    link = tmp_path / "link.h5"
    link.symlink_to("missing/new.h5")
    said = r"the folder .*missing of the output link\.h5, a link to .*new\.h5, does not exist"
    with pytest.raises(StoreError, match=said):
        check_output(link)


@pytest.mark.parametrize("ending", [".png", ".svg", ".PDF", ".yaml", ".yml", ".txt"])
def test_the_ending_of_another_kind_of_file_is_refused(tmp_path, ending):
    with pytest.raises(StoreError, match=rf"does not end in {ending}; did you mean .*z\.h5\?"):
        check_output(tmp_path / f"z{ending}", overwrite=True)
    check_output(tmp_path / "z.5")


def test_a_sweep_larger_than_the_disk_is_refused(tmp_path, monkeypatch):
    path, other = tmp_path / "out.h5", tmp_path / "other.h5"
    lay_out(other)
    free = types.SimpleNamespace(free=100_000)
    monkeypatch.setattr("shutil.disk_usage", lambda _: free)
    with pytest.raises(
        StoreError, match=r"takes about 50 MB, .* only 100 kB left; record less, or"
    ):
        check_output(path, size=50_000_000)
    other.rename(path)
    # The old file stays until the new one is laid out, and makes no room.
    with pytest.raises(StoreError, match="only 100 kB left; record less, delete the old file"):
        check_output(path, overwrite=True, size=100_001)
    check_output(path, overwrite=True, size=100_000)
    check_output(path, resume=True, size=100_001)  # which has its room already


@pytest.mark.parametrize("existing", [False, True])
@pytest.mark.parametrize(
    ("failure", "raised"),
    [
        (ValueError("Unable to create dataset\nat line 3"), Failed),
        (OSError(28, "No space left on device"), Failed),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ],
)
@pytest.mark.parametrize("where", ["_add_variable", "_fill", "_seal"])
def test_a_file_that_cannot_be_laid_out_leaves_nothing_and_loses_nothing(
    tmp_path, monkeypatch, failure, raised, existing, where
):
    path = tmp_path / "out.h5"
    if existing:
        lay_out(path)
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}

    def fail(*_, **__):
        raise failure

    monkeypatch.setattr(f"sweeps.store.creation.{where}", fail)
    with pytest.raises(raised) as caught:
        lay_out(path)
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before
    assert raised is not Failed or "out.h5 cannot be created: " in str(caught.value)
    assert "line 3" not in str(caught.value)


def test_a_grid_too_large_for_hdf5_is_refused(tmp_path, monkeypatch):
    axis = np.zeros(200_000)
    grid = Grid(dict.fromkeys(("h", "R", "f", "p"), axis), {})
    with pytest.raises(Failed, match=r"out\.h5 cannot be created"):
        lay_out(tmp_path / "out.h5", grid, block_size=grid.size)
    assert list(tmp_path.iterdir()) == []


def sweep_with(path, **attributes):
    changed = layout()
    changed.attributes.update(attributes)
    create(path, changed)


def test_files_that_are_not_ours_are_refused(tmp_path):
    path = tmp_path / "out.h5"
    with pytest.raises(StoreError, match="does not exist"):
        open_sweep(path)
    with pytest.raises(StoreError, match="is a directory"):
        open_sweep(tmp_path)
    path.write_text("name: not HDF5\n")
    with pytest.raises(StoreError, match="is not an HDF5 file"):
        open_sweep(path)
    h5py.File(path, "w").close()
    with pytest.raises(StoreError, match="not one that vibroimpact wrote"):
        open_sweep(path)
    for name in ("another", 7, np.array([1.0, 2.0])):
        with h5py.File(path, "w") as file:
            file.attrs["format"] = name
        with pytest.raises(StoreError, match="not one that vibroimpact wrote"):
            open_sweep(path)


@pytest.mark.parametrize("version", [FORMAT_VERSION + 1, 0, "one"])
def test_an_unknown_format_version_is_refused(tmp_path, version):
    path = tmp_path / "out.h5"
    sweep_with(path, format_version=version)
    with pytest.raises(
        StoreError, match=f"format version {version}, .* reads only {FORMAT_VERSION}"
    ):
        open_sweep(path)


@pytest.mark.parametrize("kept", [0.02, 0.5, 0.99])
def test_a_truncated_file_is_refused(tmp_path, kept):
    path = tmp_path / "out.h5"
    write_blocks(path, whole(GRID))
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * kept)])
    with pytest.raises(StoreError, match=r"out\.h5 .* truncated"):
        open_sweep(path)
