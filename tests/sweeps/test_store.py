"""What is written to a file comes back, to this package and to xarray."""

import itertools
import shutil

import h5py
import numpy as np
import pytest
import xarray as xr

from stored_grids import CONFIGURATION, GRID, WIDTHS, lay_out, layout, results, whole, write_blocks
from sweeps.config.schema import DIAGNOSTICS
from sweeps.grid import Grid
from sweeps.store.reader import open_sweep, status_counts
from sweeps.store.variables import VARIABLES, bytes_per_point, held_variables
from sweeps.store.writer import sweep_writer
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status


@pytest.mark.parametrize("size", [1, 5, 10])
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


@pytest.mark.slow
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


def test_a_file_that_is_replaced_while_it_is_opened_is_opened_again(tmp_path, monkeypatch):
    """As a run does with a file that is refined, compressed or widened."""
    path, copy = tmp_path / "out.h5", tmp_path / "copy.h5"
    write_blocks(path, whole(GRID))
    shutil.copy(path, copy)
    open_hdf5 = h5py.File

    def replaced(*arguments):
        monkeypatch.setattr(h5py, "File", open_hdf5)
        copy.replace(path)
        return open_hdf5(*arguments)

    monkeypatch.setattr(h5py, "File", replaced)
    with open_sweep(path) as dataset:
        assert not copy.exists() and status_counts(dataset)[Status.PENDING] == 0


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
