import itertools
import types

import h5py
import numpy as np
import pytest
import xarray as xr

from sweep_files import random_results
from sweeps.config.schema import DIAGNOSTICS
from sweeps.errors import Failed, StoreError
from sweeps.grid import Grid
from sweeps.store.creation import create
from sweeps.store.layout import FORMAT_VERSION, Layout
from sweeps.store.output import check_output
from sweeps.store.reader import open_sweep, status_counts
from sweeps.store.variables import VARIABLES, bytes_per_point, held_variables
from sweeps.store.writer import sweep_writer
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

CONFIGURATION = "oscillator: {h: 0.1}\n"
GRID = Grid(
    {"R": np.array([0.8, 0.5]), "omega": np.geomspace(0.8, 4.0, 5)},
    {"h": 0.1, "f": 1.0, "p": 1.0, "clearance": 0.0, "x0": 0.0, "v0": 0.0},
)
WIDTHS = {"section": 4, "impact": 3, "sample": 6}


def layout(grid=GRID, *, widths=WIDTHS, diagnostics=DIAGNOSTICS, block_size=10):
    return Layout.of(
        grid,
        grid.blocks(block_size),
        attributes={"name": "a test", "configuration": CONFIGURATION, "numerics": "0"},
        widths=widths,
        first_section=11,
        diagnostics=diagnostics,
    )


def lay_out(path, *args, **kwargs):
    """Write a file without data."""
    with sweep_writer(path, layout(*args, **kwargs), overwrite=True):
        pass


def results(points, samples=6, widths=WIDTHS, seed=0):
    return random_results(points, {**widths, "sample": samples}, seed)


def whole(grid, seed=0, samples=6):
    """Results of every point, shaped like the grid."""
    return {
        name: array.reshape(*grid.shape, *array.shape[1:])
        for name, array in results(grid.size, samples, seed=seed).items()
    }


def part(expected, block):
    """The results of a block, out of those of every point."""
    return {
        name: array[block].reshape(-1, *array.shape[len(block) :])
        for name, array in expected.items()
    }


def write_blocks(path, expected, *, size=10, backwards=False, compressed=False):
    with sweep_writer(path, layout(block_size=size)) as store:
        for block in store.pending()[:: -1 if backwards else 1]:
            store.write(block, part(expected, block))
        store.finish(compressed=compressed)


@pytest.mark.parametrize("size", [1, 2, 5, 10])
@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("compressed", [False, True])
def test_every_variable_comes_back_from_blocks_in_any_order(tmp_path, size, backwards, compressed):
    path = tmp_path / "out.h5"
    expected = whole(GRID)
    write_blocks(path, expected, size=size, backwards=backwards, compressed=compressed)
    with open_sweep(path) as dataset:
        assert set(dataset.data_vars) == set(VARIABLES)
        for name, variable in VARIABLES.items():
            record = () if variable.record is None else (variable.record,)
            assert dataset[name].dims == ("R", "omega", *record)
            assert dataset[name].dtype == variable.dtype
            assert dataset[name].attrs["units"] == variable.unit
            np.testing.assert_array_equal(dataset[name].values, expected[name])


def test_xarray_opens_it_with_coordinates_and_attributes(tmp_path):
    path = tmp_path / "out.h5"
    write_blocks(path, whole(GRID))
    with xr.open_dataset(path, engine="h5netcdf") as dataset, open_sweep(path) as ours:
        xr.testing.assert_identical(dataset, ours)
        assert set(dataset.sizes) == {"R", "omega", "section", "impact", "sample", "exponent"}
        for name, values in GRID.axes.items():
            np.testing.assert_array_equal(dataset[name].values, values)
            assert dataset[name].attrs["long_name"] == PARAMETERS[name].meaning
            assert dataset[name].attrs["units"] == PARAMETERS[name].unit
            assert dataset[name].attrs["symbol"] == PARAMETERS[name].symbol
        assert dataset["section"].values.tolist() == [11, 12, 13, 14]
        assert dataset["impact"].values.tolist() == [0, 1, 2]
        assert dataset["exponent"].values.tolist() == [0, 1]
        assert dataset["sample"].values.tolist() == list(range(6))
        flags = dict(
            zip(
                dataset["status"].attrs["flag_meanings"].split(),
                dataset["status"].attrs["flag_values"],
                strict=True,
            )
        )
        assert flags == {status.name.lower(): status for status in Status}
        assert dataset.attrs["configuration"] == CONFIGURATION
        assert dataset.attrs["name"] == "a test"
        assert dataset.attrs["numpy_version"] == np.__version__
        assert 0.0 < dataset.attrs["duration"] < 60.0
        assert np.datetime64(dataset.attrs["started"].removesuffix("+00:00")) > np.datetime64(
            "2024"
        )


def test_parameters_that_are_not_swept_are_scalar_coordinates(tmp_path):
    """In the file itself, so that xarray alone sees them."""
    path = tmp_path / "out.h5"
    write_blocks(path, whole(GRID))
    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        for name, value in GRID.fixed.items():
            assert dataset.coords[name].shape == () and dataset[name] == value
            assert dataset[name].attrs["units"] == PARAMETERS[name].unit
            assert dataset[name].attrs["long_name"] == PARAMETERS[name].meaning
        assert "coordinates" not in dataset.attrs


@pytest.mark.parametrize("compressed", [False, True])
def test_a_single_point_has_no_axes(tmp_path, compressed):
    path = tmp_path / "out.h5"
    grid = Grid({}, dict.fromkeys(PARAMETERS, 0.5))
    given = results(1)
    with sweep_writer(path, layout(grid)) as store:
        store.write((), given)
        store.finish(compressed=compressed)
    with open_sweep(path) as dataset:
        assert dataset["status"].shape == ()
        for name in VARIABLES:
            np.testing.assert_array_equal(dataset[name].values, given[name][0])


def test_an_unwritten_single_point_is_pending(tmp_path):
    path = tmp_path / "out.h5"
    lay_out(path, Grid({}, {}))
    with open_sweep(path) as dataset:
        assert dataset["status"] == Status.PENDING
        assert np.isnan(dataset["rest_fraction"])
        for name in ("chatters", "near_grazes", "period", "period_impacts"):
            assert dataset[name] == -1
        for name in ("poincare_x", "trajectory_t"):
            assert np.isnan(dataset[name]).all()


def test_a_width_of_zero_leaves_the_variables_out(tmp_path):
    path = tmp_path / "out.h5"
    widths = {"section": 4, "impact": 0, "sample": 0}
    with sweep_writer(path, layout(widths=widths, diagnostics=())) as store:
        store.write((slice(0, 2), slice(0, 5)), results(10, widths=widths))
    with open_sweep(path) as dataset:
        assert set(dataset.sizes) == {"R", "omega", "section"}
        assert {"poincare_x", "impacts_per_period"} <= set(dataset.data_vars)
        assert not {"impact_v", "impact_phase", "trajectory_t"} & set(dataset.data_vars)


@pytest.mark.parametrize(
    ("diagnostics", "expected"),
    [
        ((), set()),
        (("period",), {"period", "period_impacts"}),
        (("lyapunov",), {"lyapunov"}),
        (DIAGNOSTICS, {"period", "period_impacts", "lyapunov"}),
    ],
)
def test_diagnostics_not_asked_for_are_left_out(tmp_path, diagnostics, expected):
    path = tmp_path / "out.h5"
    lay_out(path, diagnostics=diagnostics)
    held = held_variables(WIDTHS, diagnostics)
    with open_sweep(path) as dataset:
        assert set(dataset.data_vars) == set(held)
        assert {"period", "period_impacts", "lyapunov"} & set(held) == expected
        assert ("exponent" in dataset.sizes) == ("lyapunov" in diagnostics)


def test_every_diagnostic_has_its_variables():
    assert {variable.diagnostic for variable in VARIABLES.values()} == {None, *DIAGNOSTICS}


def test_the_estimate_is_what_the_arrays_take():
    taken = sum(array.nbytes if name != "status" else 10 for name, array in results(10).items())
    assert bytes_per_point(WIDTHS, DIAGNOSTICS) * 10 == taken


@pytest.mark.parametrize("order", [*itertools.permutations(range(3))])
@pytest.mark.parametrize("compressed", [False, True])
def test_trajectories_are_as_wide_as_the_widest_and_padded(tmp_path, order, compressed):
    path = tmp_path / "out.h5"
    grid = Grid({"omega": np.array([1.0, 2.0, 3.0])}, {})
    widths = (3, 300, 102)
    parts = [results(1, width, seed=width) for width in widths]
    with sweep_writer(path, layout(grid, block_size=1)) as store:
        for index in order:
            store.write((slice(index, index + 1),), parts[index])
        store.finish(compressed=compressed)
    with open_sweep(path) as dataset:
        assert dataset["sample"].values.tolist() == list(range(300))
        for name in VARIABLES:
            for index, width in enumerate(widths):
                row = dataset[name][index].values
                if VARIABLES[name].record == "sample":
                    assert np.isnan(row[width:]).all()
                    row = row[:width]
                np.testing.assert_array_equal(row, parts[index][name][0])


def test_a_partial_file_says_what_is_pending(tmp_path):
    path = tmp_path / "out.h5"
    given = results(2)
    given["status"][1] = Status.NON_FINITE
    with pytest.raises(KeyboardInterrupt), sweep_writer(path, layout(block_size=2)) as store:
        store.write((slice(1, 2), slice(0, 1)), results(1))
        store.write((slice(1, 2), slice(1, 3)), given)
        raise KeyboardInterrupt
    with open_sweep(path) as dataset:
        counts = dict.fromkeys(Status, 0) | {
            Status.PENDING: 7,
            Status.COMPUTED: 2,
            Status.NON_FINITE: 1,
        }
        assert status_counts(dataset) == counts
        pending = dataset["status"].values == Status.PENDING
        for name, variable in VARIABLES.items():
            if variable.dtype == "int64":
                assert (dataset[name].values[pending] == -1).all()
            if variable.dtype == "float64":
                assert np.isnan(dataset[name].values[pending]).all()
                assert np.isfinite(dataset[name].values[~pending]).all()


def test_it_is_read_lazily(tmp_path):
    path = tmp_path / "out.h5"
    lay_out(path)
    with open_sweep(path) as dataset:
        assert not dataset["poincare_x"].variable._in_memory


def test_a_block_that_does_not_fit_is_not_written(tmp_path):
    path = tmp_path / "out.h5"
    block = (slice(0, 1), slice(0, 2))
    with sweep_writer(path, layout(block_size=3)) as store:
        with pytest.raises(ValueError, match=r"impact_v has the shape \(2, 9\)"):
            store.write(block, {**results(2), "impact_v": np.zeros((2, 9))})
        with pytest.raises(ValueError, match="poincare_x has the shape"):
            store.write(block, results(3))
        with pytest.raises(ValueError, match="no variable speed"):
            store.write(block, {**results(2), "speed": np.zeros(2)})
        with pytest.raises(KeyError, match="status"):
            store.write(block, {k: v for k, v in results(2).items() if k != "status"})
        with pytest.raises(KeyError):
            store.write((slice(0, 1), slice(0, 5)), results(5))
    with open_sweep(path) as dataset:
        assert status_counts(dataset)[Status.PENDING] == GRID.size
        assert np.isnan(dataset["poincare_x"].values).all()


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
    assert list(tmp_path.iterdir()) == []


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
